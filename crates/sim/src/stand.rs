//! The wheels over the ground, and what stands on them.

use collision::{Scene, contact_center, wheel_ground};
use geometry::ConvexPolygon;
use nalgebra::{Point3, Vector3};
use rover::{LegId, Posture};
use stability::support_polygon;

/// One wheel over the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Foot {
    /// Its vertical gap to the ground is within the ground tolerance, or it is deeper.
    pub stands: bool,
    /// The wheel's point nearest to the ground; for a standing wheel the middle of its contact (m).
    pub point: Point3<f64>,
}

/// The wheel of `leg` over the ground of the scene.
pub(crate) fn foot(scene: &Scene, posture: &Posture, leg: LegId) -> Foot {
    let robot = scene.robot();
    let wheel = posture.wheel(robot, leg);
    let Some(gap) = wheel_ground(&wheel, scene.map(), |_| true).nearest else {
        return Foot { stands: false, point: wheel.lowest_point(&Vector3::z_axis()) };
    };
    let stands = gap.gap <= robot.stance().ground_tolerance;
    let point = if stands {
        contact_center(&wheel, scene.map(), &gap)
    } else {
        gap.ground + Vector3::z() * gap.gap
    };
    Foot { stands, point }
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
    let names: Vec<&str> = standing(feet)
        .into_iter()
        .filter(|(other, _)| *other != leg)
        .map(|(other, _)| scene.robot().leg(other).name.as_str())
        .collect();
    if names.is_empty() { "no leg".into() } else { names.join(", ") }
}
