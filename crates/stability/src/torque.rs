//! Joint torques that hold a posture, as shares of their limits (H5c, F49).
//!
//! The forces on the wheels are given (for instance by [`crate::loads`]); no internal forces are
//! chosen to favor a joint.

use nalgebra::{Point3, Vector3};
use rover::{LegAngles, LegId, Posture, Robot, Wrench, hold_torques};

use crate::loads::LoadBand;

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

impl TorqueReport {
    /// The same with another worst joint, if that is loaded more.
    #[must_use]
    pub fn or_worse(self, other: Option<WorstJoint>) -> TorqueReport {
        let worse = other.filter(|other| other.ratio.abs() > self.worst.ratio.abs());
        TorqueReport { worst: worse.unwrap_or(self.worst), ..self }
    }
}

impl WorstJoint {
    /// Is it loaded beyond its limit? What is not a number counts as beyond.
    pub fn is_overloaded(&self) -> bool {
        is_beyond(self.ratio)
    }
}

/// Is a share of a torque limit beyond it?
pub(crate) fn is_beyond(ratio: f64) -> bool {
    ratio.is_nan() || ratio.abs() > 1.0
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
    report(robot, ratios)
}

/// The same for vertical loads that are known within a band, on these legs, each with the point where it
/// touches the ground (`world`, m): of each joint the ratio that is farthest from zero. Without a band no
/// wheel bears anything.
pub fn ratios_within(
    robot: &Robot,
    posture: &Posture,
    standing: &[(LegId, Point3<f64>)],
    band: Option<&LoadBand>,
    gravity: f64,
) -> TorqueReport {
    // Torques are linear in the load, so the ends of the band tell.
    let farther = |a: f64, b: f64| if b.abs() > a.abs() { b } else { a };
    let of_leg = |leg: LegId| {
        let under = |load: Option<f64>, point: &Point3<f64>| {
            let force = load.map(|load| Vector3::new(0.0, 0.0, load));
            let wrench = force.map(|force| Wrench { point: *point, force });
            let torques = hold_torques(robot, posture, leg, gravity, wrench.as_ref());
            torques.zip_map(&robot.leg(leg).effort, share)
        };
        let foot = standing.iter().zip(0..).find(|((standing, _), _)| *standing == leg);
        match foot.zip(band) {
            Some((((_, point), i), band)) => {
                let ends = [&band.least_n, &band.most_n].map(|loads| loads.get(i).copied());
                under(ends[0], point).zip_map(&under(ends[1], point), farther)
            }
            None => under(None, &Point3::origin()),
        }
    };
    report(robot, robot.leg_ids().map(of_leg).collect())
}

fn report(robot: &Robot, ratios: Vec<LegAngles>) -> TorqueReport {
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
