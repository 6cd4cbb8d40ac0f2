//! Joint torques that hold the robot still.

use nalgebra::{Point3, Vector3};

use crate::model::{JointKind, LegId, Robot};
use crate::posture::{LegAngles, Posture};

/// A force at a point, in `world`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// Where it acts (m).
    pub point: Point3<f64>,
    /// The force (N).
    pub force: Vector3<f64>,
}

/// Torques of a leg's joints (N m; forces in N of prismatic ones) that hold its links and what is
/// fixed to them, and the force of the ground on its wheel, against gravity (m/s², along -z of
/// `world`).
///
/// A joint's torque and the moments of all that lies beyond it, taken about its axis, sum to zero;
/// so do a prismatic joint's force and the forces along its axis.
pub fn hold_torques(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    gravity: f64,
    ground: Option<&Wrench>,
) -> LegAngles {
    let id = leg;
    let leg = robot.leg(leg);
    let mut torques = LegAngles::zeros();
    // From the wheel inward, gather force and moment about the world's origin.
    let mut force = ground.map_or(Vector3::zeros(), |w| w.force);
    let mut moment = ground.map_or(Vector3::zeros(), |w| w.point.coords.cross(&w.force));
    for place in (0..leg.n_joints()).rev() {
        for (joint, _) in &leg.moves {
            let child = robot.joints()[*joint].child;
            if robot.body_of(child) != Some((id, place)) {
                continue;
            }
            let link = &robot.links()[child.0];
            let weight = Vector3::new(0.0, 0.0, -link.mass * gravity);
            force += weight;
            moment += (posture.link(child) * link.com).coords.cross(&weight);
        }
        let joint = &robot.joints()[leg.joints[place]];
        // The joint's origin and axis are fixed in its child link, whatever its angle.
        let frame = posture.link(leg.links[place]);
        let axis = frame.rotation * joint.axis;
        let about_joint = moment - frame.translation.vector.cross(&force);
        torques[place] = match joint.kind {
            JointKind::Prismatic => -axis.dot(&force),
            _ => -axis.dot(&about_joint),
        };
    }
    torques
}
