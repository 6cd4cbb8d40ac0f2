//! Ground that nobody has seen, below a leg.

use nalgebra::{Point2, Point3};
use rover::{Frame, LegId, LinkId, Posture};

use crate::form::Placed;
use crate::ground::is_all_known;
use crate::pairs::Body;
use crate::scene::Scene;

/// Places below a link that are looked at, along each axis.
const PLACES: usize = 5;

/// A link over ground that nobody has seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverUnknown {
    /// The link.
    pub link: LinkId,
    /// A place below it that nobody has seen, at the height that the ground is taken to have at most (m).
    pub place: Point3<f64>,
    /// How far the link's lowest point is above that (m); negative where the link is beside the place rather than over it.
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
        // The highest of some places below that nobody has seen.
        let share = |i: usize| i as f64 / (PLACES - 1) as f64;
        let at = |i: usize| {
            let (x, y) = (share(i % PLACES), share(i / PLACES));
            Point2::new(low.x + (high.x - low.x) * x, low.y + (high.y - low.y) * y)
        };
        let unseen = (0..PLACES * PLACES).map(at).filter(|p| scene.map().height_at(*p).is_none());
        let bounded = unseen
            .filter_map(|p| scene.cover().height_at(p).map(|bound| Point3::new(p.x, p.y, bound)));
        let place = bounded.max_by(|a, b| a.z.total_cmp(&b.z))?;
        Some(OverUnknown { link: part.link, place, above: low.z - place.z })
    });
    over.min_by(|a, b| a.above.total_cmp(&b.above))
}
