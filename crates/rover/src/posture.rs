//! Configurations, and where every link is in them (forward kinematics, F38, H2).

use nalgebra::{Isometry3, Point3, Vector6};

use crate::ik::{IkSolutions, NoSolution};
use crate::model::{LegId, LinkId, Robot};
use crate::wheel::WheelPose;

/// Joint angles of one leg, from the hip outward: rad, and m in the place of a prismatic joint.
///
/// A leg of fewer than six joints is padded: the places beyond its last joint are zero, and so are
/// their limits.
pub type LegAngles = Vector6<f64>;

/// Base pose and joint angles: q of the papers without the wheels' spin.
#[derive(Debug, Clone, PartialEq)]
pub struct Configuration {
    /// Pose of the base link in `world`.
    pub world_from_base: Isometry3<f64>,
    /// Joint angles by leg.
    pub legs: Vec<LegAngles>,
}

impl Configuration {
    /// The same configuration with one leg's angles replaced.
    pub fn with_leg(&self, leg: LegId, angles: LegAngles) -> Configuration {
        let mut changed = self.clone();
        changed.legs[leg.0] = angles;
        changed
    }
}

/// Where every link is in `world`.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    world_from_link: Vec<Isometry3<f64>>,
}

impl Posture {
    /// Forward kinematics of the whole robot; joints outside the legs stay at zero.
    pub fn new(robot: &Robot, configuration: &Configuration) -> Posture {
        let mut angles = vec![0.0; robot.joints().len()];
        for (leg, q) in robot.legs().iter().zip(&configuration.legs) {
            for (joint, q) in leg.joints.iter().zip(q.iter()) {
                angles[*joint] = *q;
            }
        }
        let mut world_from_link = Vec::with_capacity(robot.links().len());
        for link in robot.links() {
            let pose = match link.parent_joint {
                None => configuration.world_from_base,
                Some(j) => {
                    let joint = &robot.joints()[j];
                    let parent: &Isometry3<f64> = &world_from_link[joint.parent.0];
                    joint.kind.moved(parent * joint.parent_from_joint, &joint.axis, angles[j])
                }
            };
            world_from_link.push(pose);
        }
        Posture { world_from_link }
    }

    /// The same posture with one leg at other angles: only that leg's links are computed anew.
    pub fn with_leg(&self, robot: &Robot, leg: LegId, angles: &LegAngles) -> Posture {
        let mut changed = self.clone();
        changed.move_leg(robot, leg, angles);
        changed
    }

    /// As [`with_leg`](Self::with_leg), in place.
    pub fn move_leg(&mut self, robot: &Robot, leg: LegId, angles: &LegAngles) {
        let leg = robot.leg(leg);
        for &(j, place) in &leg.moves {
            let joint = &robot.joints()[j];
            let frame = self.world_from_link[joint.parent.0] * joint.parent_from_joint;
            self.world_from_link[joint.child.0] = match place {
                Some(place) => joint.kind.moved(frame, &joint.axis, angles[place]),
                None => frame,
            };
        }
    }

    /// Pose of a link in `world`.
    pub fn link(&self, link: LinkId) -> &Isometry3<f64> {
        &self.world_from_link[link.0]
    }

    /// The wheel of a leg, or its ball foot.
    pub fn wheel(&self, robot: &Robot, leg: LegId) -> WheelPose {
        let leg = robot.leg(leg);
        WheelPose {
            world_from_wheel: self.link(leg.last_link()) * leg.wheel.carrier_from_wheel,
            radius: leg.wheel.radius,
            width: leg.wheel.width,
            ball: leg.wheel.ball,
        }
    }

    /// Center of mass of the robot with its payloads, in `world` (m) (F38).
    ///
    /// A robot without mass has it at the base link's origin.
    pub fn center_of_mass(&self, robot: &Robot) -> Point3<f64> {
        let mut moment = nalgebra::Vector3::zeros();
        let mut mass = 0.0;
        for (link, pose) in robot.links().iter().zip(&self.world_from_link) {
            moment += (pose * link.com).coords * link.mass;
            mass += link.mass;
        }
        if mass > 0.0 {
            Point3::from(moment / mass)
        } else {
            self.world_from_link[0].translation.vector.into()
        }
    }

    /// Joint angles that bring a leg's wheel to `world_from_wheel` with the base where it is: all
    /// branches of a leg with a closed form, what iteration finds for another. Legs of fewer than
    /// six joints and ball feet bring the center there and leave the orientation free.
    pub fn inverse_kinematics(
        &self,
        robot: &Robot,
        leg: LegId,
        world_from_wheel: &Isometry3<f64>,
    ) -> Result<IkSolutions, NoSolution> {
        let leg = robot.leg(leg);
        let base_from_wheel = self.world_from_link[0].inverse() * world_from_wheel;
        leg.ik.solve(leg, &base_from_wheel)
    }
}
