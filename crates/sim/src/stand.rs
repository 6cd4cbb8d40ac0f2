//! The wheels over the ground, and what stands on them.

use collision::{Scene, contact_center, wheel_ground};
use geometry::ConvexPolygon;
use nalgebra::{Point3, Vector3};
use rover::{LegId, Posture, Robot};
use stability::loads::{LegSpring, compliant_share, leg_springs};
use stability::support_polygon;

use crate::command::names;

/// One wheel over the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Foot {
    /// Its vertical gap to the ground is within the ground tolerance, or it is deeper.
    pub stands: bool,
    /// The wheel's point nearest to the ground; for a standing wheel the middle of its contact (m).
    pub point: Point3<f64>,
    /// How deep it is pressed into the ground (m), negative above it; zero where none is known.
    pub depth: f64,
}

/// The wheel of `leg` over the ground of the scene.
pub(crate) fn foot(scene: &Scene, posture: &Posture, leg: LegId) -> Foot {
    let robot = scene.robot();
    let wheel = posture.wheel(robot, leg);
    let Some(gap) = wheel_ground(&wheel, scene.map(), |_| true).nearest else {
        let point = wheel.lowest_point(&Vector3::z_axis());
        return Foot { stands: false, point, depth: 0.0 };
    };
    let stands = gap.gap <= robot.stance().ground_tolerance;
    let point = if stands {
        contact_center(&wheel, scene.map(), &gap)
    } else {
        gap.ground + Vector3::z() * gap.gap
    };
    Foot { stands, point, depth: -gap.gap }
}

/// All wheels, by leg.
pub(crate) fn feet(scene: &Scene, posture: &Posture) -> Vec<Foot> {
    scene.robot().leg_ids().map(|leg| foot(scene, posture, leg)).collect()
}

/// The legs that stand, with their contacts.
pub(crate) fn standing(feet: &[Foot]) -> Vec<(LegId, Point3<f64>)> {
    let legs = feet.iter().enumerate().filter(|(_, foot)| foot.stands);
    legs.map(|(i, foot)| (LegId(i), foot.point)).collect()
}

/// The support polygon of all wheels that stand but that of `leg`, if there is one.
pub(crate) fn support_without(feet: &[Foot], leg: LegId) -> Option<ConvexPolygon> {
    let contacts: Vec<Point3<f64>> = standing(feet)
        .into_iter()
        .filter(|(other, _)| *other != leg)
        .map(|(_, contact)| contact)
        .collect();
    support_polygon::regular(&contacts).ok()
}

/// The names of the legs that stand but `leg`, for people.
pub(crate) fn names_without(scene: &Scene, feet: &[Foot], leg: LegId) -> String {
    let others: Vec<LegId> =
        standing(feet).into_iter().map(|(other, _)| other).filter(|other| *other != leg).collect();
    names(scene.robot(), &others)
}

/// Vertical force of the ground on each wheel (N), by leg, zero for wheels that do not stand.
///
/// Legs are vertical springs that push only, each of its own stiffness in this posture. The rover in the
/// simulation is rigid, so its wheels stand as deep in the ground as they were driven: a wheel pressed
/// deeper than the others by d bears more by its stiffness times d, as far as the rover does not yield.
pub(crate) fn loads(robot: &Robot, posture: &Posture, feet: &[Foot], gravity: f64) -> Vec<f64> {
    let standing = standing(feet);
    let contacts: Vec<_> = standing.iter().map(|(_, contact)| *contact).collect();
    let mut springs: Vec<LegSpring> = leg_springs(robot, posture, &standing);
    for (spring, (leg, _)) in springs.iter_mut().zip(&standing) {
        spring.pressed_m = feet[leg.0].depth;
    }
    let com = posture.center_of_mass(robot);
    let weight = robot.mass() * gravity;
    let shares = compliant_share(&contacts, &com, weight, &springs);
    let mut loads = vec![0.0; feet.len()];
    for ((leg, _), share) in standing.iter().zip(shares.iter().flatten()) {
        loads[leg.0] = *share;
    }
    loads
}
