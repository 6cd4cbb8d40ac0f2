//! Joint torques that hold the robot still.

use nalgebra::{Point3, Vector3};

use crate::model::{LegId, Robot};
use crate::posture::{LegAngles, Posture};

/// A force at a point, in `world`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// Where it acts (m).
    pub point: Point3<f64>,
    /// The force (N).
    pub force: Vector3<f64>,
}

/// Torques of a leg's joints (N m) that hold its links, and the force of the ground on its wheel,
/// against gravity (m/s², along -z of `world`).
///
/// A joint's torque and the moments of all that lies beyond it, taken about its axis, sum to zero.
pub fn hold_torques(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    gravity: f64,
    ground: Option<&Wrench>,
) -> LegAngles {
    let leg = robot.leg(leg);
    let mut torques = LegAngles::zeros();
    // From the wheel inward, gather force and moment about the world's origin.
    let mut force = ground.map_or(Vector3::zeros(), |w| w.force);
    let mut moment = ground.map_or(Vector3::zeros(), |w| w.point.coords.cross(&w.force));
    let outer = [leg.wheel_link];
    for place in (0..6).rev() {
        let here = if place == 5 { &outer[..] } else { &[] };
        for id in here.iter().chain([&leg.links[place]]) {
            let link = &robot.links()[id.0];
            let weight = Vector3::new(0.0, 0.0, -link.mass * gravity);
            force += weight;
            moment += (posture.link(*id) * link.com).coords.cross(&weight);
        }
        let joint = &robot.joints()[leg.joints[place]];
        // The joint's origin and axis are fixed in its child link, whatever its angle.
        let frame = posture.link(leg.links[place]);
        let axis = frame.rotation * joint.axis;
        let about_joint = moment - frame.translation.vector.cross(&force);
        torques[place] = -axis.dot(&about_joint);
    }
    torques
}
