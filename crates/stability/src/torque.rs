//! Joint torques that hold a posture, as shares of their limits (H5c, F49).
//!
//! The forces on the wheels are given (for instance by [`crate::loads`]); no internal forces are
//! chosen to favor a joint.

use rover::{LegAngles, LegId, Posture, Robot, Wrench, hold_torques};

/// Joint torques of a posture against their limits.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueReport {
    /// Torque over its limit, signed, by leg and from the hip outward: within -1 to 1 is allowed.
    /// A joint without a torque limit above zero has zero if it bears nothing, else infinity.
    pub ratios: Vec<LegAngles>,
    /// The joint that is nearest to its limit or furthest past it.
    pub worst: WorstJoint,
}

/// The joint that is loaded most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorstJoint {
    /// Its leg.
    pub leg: LegId,
    /// Its place in the leg, 0 at the hip.
    pub place: usize,
    /// Its torque over its limit, signed.
    pub ratio: f64,
}

/// The torques that hold `posture` under `gravity` (m/s², along -z of `world`) with these forces
/// of the ground on the wheels (N, in `world`); a leg that is not named holds its own links only.
pub fn ratios(
    robot: &Robot,
    posture: &Posture,
    ground: &[(LegId, Wrench)],
    gravity: f64,
) -> TorqueReport {
    let ratios: Vec<LegAngles> = robot
        .leg_ids()
        .map(|leg| {
            let wrench = ground.iter().find(|(standing, _)| *standing == leg).map(|(_, w)| w);
            let torques = hold_torques(robot, posture, leg, gravity, wrench);
            torques.zip_map(&robot.leg(leg).effort, share)
        })
        .collect();
    let joints = robot.leg_ids().zip(&ratios).flat_map(|(leg, ratios)| {
        ratios.iter().enumerate().map(move |(place, ratio)| WorstJoint {
            leg,
            place,
            ratio: *ratio,
        })
    });
    let worst = joints
        .reduce(|a, b| if b.ratio.abs() > a.ratio.abs() { b } else { a })
        .expect("a robot has one leg or more");
    TorqueReport { ratios, worst }
}

pub(crate) fn share(torque: f64, limit: f64) -> f64 {
    if limit > 0.0 {
        torque / limit
    } else if torque == 0.0 {
        0.0
    } else {
        torque.signum() * f64::INFINITY
    }
}
