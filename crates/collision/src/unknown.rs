//! Ground that nobody has seen, below a leg.

use nalgebra::Point3;
use rover::{Frame, LegId, LinkId, Posture};

use crate::form::Placed;
use crate::ground::is_all_known;
use crate::pairs::Body;
use crate::scene::Scene;

/// A link over ground that nobody has seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverUnknown {
    /// The link.
    pub link: LinkId,
    /// Below its middle, at the height that the ground is taken to have at most (m).
    pub place: Point3<f64>,
    /// How far the link's lower end is above the highest that unknown ground below it is taken to be (m).
    pub above: f64,
}

/// Of a leg's links over ground that the map of the scene does not know, or beside the map, the one that is least above
/// what covers it ([`Scene::with_cover`]); none where all below the leg is known.
pub fn over_unknown(scene: &Scene, posture: &Posture, leg: LegId) -> Option<OverUnknown> {
    let of_leg = |body: Body| matches!(body, Body::Leg { leg: of, .. } if of == leg);
    let over = scene.parts.iter().filter(|part| of_leg(part.body)).filter_map(|part| {
        let frame = Frame::from(&(posture.link(part.link) * part.link_from_part));
        let placed = Placed::new(frame, &part.core);
        let (low, high) = placed.aabb(&part.form);
        if is_all_known(scene.map(), low.xy(), high.xy()) {
            return None;
        }
        let top = scene.cover().max_over(low.xy(), high.xy());
        let center = placed.center();
        let bound = scene.cover().height_at(center.xy()).unwrap_or(top);
        let place = Point3::new(center.x, center.y, bound);
        Some(OverUnknown { link: part.link, place, above: low.z - top })
    });
    over.min_by(|a, b| a.above.total_cmp(&b.above))
}
