//! Whether the joints bear a stance: by the loads of the compliant rover, and by the best forces.
//!
//! A stance is torque-safe if both ways to share the weight leave all joints within their limits: the
//! forces that spare the joints most ([`crate::contact_forces::least_torque`], optimistic), and the loads
//! that springs take by themselves, whatever in their band they are ([`crate::loads`]). The second are
//! vertical and balance, so where every friction cone holds the vertical they are one choice of the first,
//! and the best is no worse: the linear program is solved only where a foot stands too steep for that.

use nalgebra::Point3;
use rover::{LegId, Posture, Robot};

use crate::contact::{self, ConeModel, Contact};
use crate::contact_forces::{self, LegStatics};
use crate::loads::{LoadBand, StanceSprings};
use crate::torque::{self, TorqueReport, WorstJoint};

/// Products with half spaces above this are on the right side, but for rounding.
const ROUNDING: f64 = 1e-12;

/// Loads on these legs, each with the point where it touches the ground (`world`, m), and the torques
/// with them; `springs` are [`StanceSprings::of`] them. No loads where the rover tips.
pub fn compliant(
    robot: &Robot,
    posture: &Posture,
    com: &Point3<f64>,
    standing: &[(LegId, Point3<f64>)],
    springs: Option<&StanceSprings>,
    gravity: f64,
) -> (Option<LoadBand>, TorqueReport) {
    let band = springs.and_then(|springs| springs.band(com));
    let torque = torque::ratios_within(robot, posture, standing, band.as_ref(), gravity);
    (band, torque)
}

/// Does the friction of every one of these contacts hold a vertical force?
pub fn hold_verticals(contacts: &[Contact], cone: ConeModel) -> bool {
    let center = contact::center(contacts.iter().map(|c| c.position));
    contacts.iter().all(|c| {
        let sides = cone.half_spaces(c, &center);
        c.normal.z > 0.0 && sides.iter().all(|side| side.z >= -ROUNDING)
    })
}

/// The joint that bears most with the forces that spare the joints most, where the loads of the compliant
/// rover do not say enough: where friction does not [hold verticals](hold_verticals). `None` where it
/// does, and where no forces hold the rover, of which the friction region tells.
pub fn worst_by_best_forces(
    robot: &Robot,
    posture: &Posture,
    com: &Point3<f64>,
    standing: &[(LegId, Contact)],
    gravity: f64,
    cone: ConeModel,
) -> Option<WorstJoint> {
    let contacts: Vec<Contact> = standing.iter().map(|(_, contact)| *contact).collect();
    if hold_verticals(&contacts, cone) {
        return None;
    }
    let legs: Vec<LegStatics> = standing
        .iter()
        .map(|(leg, c)| LegStatics::new(robot, posture, *leg, &c.position, gravity))
        .collect();
    let weight = robot.mass() * gravity;
    let least = contact_forces::least_torque(&legs, &contacts, com, weight, cone).ok()??;
    let (foot, place) = least.joint;
    Some(WorstJoint { leg: standing.get(foot)?.0, place, ratio: least.ratio })
}
