//! One look at one distance, over a piece of a motion: is it kept all along, broken, or open?
//!
//! The same for a moving leg ([`crate::checker`]) and for the whole moving robot ([`crate::body`]). A
//! piece is looked at in its middle: what is farther apart there than must be kept and than the bodies
//! can get toward each other within the piece is clear over all of it.

use crate::checker::{Touch, Violation};
use nalgebra::Vector3;

use crate::form::{Placed, toward};
use crate::gjk::{Separation, separation_along};
use crate::ground::{
    EQUALLY_NEAR, GroundNear, Kernel, clear_of_ground, near_ground, near_known_ground,
};
use crate::scene::{Scene, Solid};
use crate::solid::{Near, Part, near, pose_of, to_parry_point, to_pose};

/// Limit of distance where only touching counts (m).
pub(crate) const TOUCHING: f64 = 1e-9;

/// Way of a body over half a piece below which the ground is looked at triangle by triangle (m at
/// scale 1).
const THOROUGH: f64 = 0.2;

/// What a look at one item says.
pub(crate) enum Look {
    /// Farther apart than asked, over the whole piece.
    Clear,
    /// Free about the middle of the piece, over this share of it; the rest is open.
    Open(f64),
    /// Nearer than it may be in the middle of the piece.
    Violated(Violation),
}

/// What is asked of a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ask {
    /// Clearance to keep (m).
    pub required: f64,
    /// How far the bodies can get toward each other within the piece (m).
    pub motion: f64,
    /// Ask for exact distances where quick bounds do not tell.
    pub fine: bool,
}

impl Ask {
    /// Distance in the middle at which all of the piece is clear (m).
    pub fn need(&self) -> f64 {
        (self.required + self.motion).max(TOUCHING)
    }

    /// Distance in the middle below which it is violated there (m).
    fn least(&self) -> f64 {
        self.required.max(TOUCHING)
    }

    /// The share of the piece that is clear about its middle, where the nearest thing is `distance` (m)
    /// away: what moves by a share of its way gets no farther than by that share of the bound, for
    /// the bound of a joint-linear motion grows no slower than the way.
    fn clear_share(&self, distance: f64) -> f64 {
        let spare = distance - EQUALLY_NEAR - self.least();
        if self.motion > 0.0 { (spare / self.motion).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// How far distances are worth asking for (m).
    fn limit(&self) -> f64 {
        if self.fine { self.need() } else { self.least() }
    }
}

/// Of two rules of which one must hold: what the second one adds, which applies to the middle of the
/// piece, and to all of it if `surely`.
pub(crate) fn better(first: Look, second: Look, surely: bool) -> Look {
    match (first, second) {
        (Look::Clear, _) => Look::Clear,
        (_, Look::Clear) if surely => Look::Clear,
        (Look::Open(a), Look::Open(b)) if surely => Look::Open(a.max(b)),
        (Look::Violated(_), Look::Open(b)) if surely => Look::Open(b),
        (Look::Violated(_), Look::Clear | Look::Open(_)) => Look::Open(0.0),
        (Look::Violated(_), violated) => violated,
        (first, _) => first,
    }
}

/// Two links of the robot.
pub(crate) fn look_at_pair([a, b]: [&Part; 2], [at_a, at_b]: [&Placed; 2], ask: Ask) -> Look {
    let Some(n) = toward(at_a, &a.form, at_b, &b.form, ask.need()) else { return Look::Clear };
    match separation_along(&(at_a, &a.form), &(at_b, &b.form), ask.limit(), n) {
        Separation::Apart if ask.fine => Look::Clear,
        Separation::Near { least, .. } if least < ask.least() => {
            let near = Near { distance: least, place: at_b.center() };
            Look::Violated(violation(Touch::Links(a.link, b.link), near, ask.required))
        }
        Separation::Near { least, .. } if ask.fine => Look::Open(ask.clear_share(least)),
        Separation::Apart | Separation::Near { .. } => Look::Open(0.0),
    }
}

/// A part against the obstacles with these indices.
pub(crate) fn look_at_solids(
    scene: &Scene,
    part: &Part,
    placed: &Placed,
    solids: &[usize],
    ask: Ask,
) -> Look {
    let mut clear: Option<f64> = None;
    for &i in solids {
        let solid = &scene.solids[i];
        let n = toward(placed, &part.form, &solid.placed, &solid.form, ask.need());
        let Some(n) = n else { continue };
        match quick_solid(placed, part, solid, ask.limit(), n) {
            None if ask.fine => {}
            Some(near) if near.distance < ask.least() => {
                let touch = Touch::Obstacle(part.link, i);
                return Look::Violated(violation(touch, near, ask.required));
            }
            found => {
                let share = found.filter(|_| ask.fine).map_or(0.0, |n| ask.clear_share(n.distance));
                clear = Some(clear.map_or(share, |clear| clear.min(share)));
            }
        }
    }
    clear.map_or(Look::Clear, Look::Open)
}

/// A part against the ground, all of which must be known. A single configuration and short pieces are
/// decided here; a long piece is cut rather than looked at closely.
pub(crate) fn look_at_ground(scene: &Scene, part: &Part, placed: &Placed, ask: Ask) -> Look {
    let thorough = !ask.fine && ask.motion < THOROUGH * scene.robot().scale();
    if clear_of_ground(scene, part, placed, ask.need(), thorough) {
        return Look::Clear;
    }
    let (link, required) = (part.link, ask.required);
    let ground = |required: f64, reach: f64| {
        // The nearest ground counts, not the first that leaves the piece open.
        let kernel = Kernel::Quick { enough: ask.least() };
        near_ground(scene, part, placed, required, reach, kernel)
    };
    if ask.fine {
        match ground(ask.need(), ask.need()) {
            GroundNear::Clear => return Look::Clear,
            GroundNear::Near(near) if near.distance < ask.least() => {
                return Look::Violated(violation(Touch::Ground(link), near, required));
            }
            GroundNear::Near(near) => return Look::Open(ask.clear_share(near.distance)),
            // Unknown ground within the reach of the piece: is it within that of its middle?
            GroundNear::Unknown(_) => {}
        }
    }
    match ground(required, ask.least()) {
        GroundNear::Clear => Look::Open(0.0),
        GroundNear::Near(near) => Look::Violated(violation(Touch::Ground(link), near, required)),
        GroundNear::Unknown(place) => {
            let touch = Touch::UnknownGround(link);
            Look::Violated(Violation { touch, distance: 0.0, required, place })
        }
    }
}

/// As [`look_at_ground`], for the ground that is known: what is not counts as nothing.
pub(crate) fn look_at_known_ground(scene: &Scene, part: &Part, placed: &Placed, ask: Ask) -> Look {
    let limit = ask.limit();
    let kernel = Kernel::Quick { enough: ask.required };
    match near_known_ground(scene, part, placed, limit, kernel) {
        Some(near) if near.distance < ask.least() => {
            Look::Violated(violation(Touch::Ground(part.link), near, ask.required))
        }
        None if ask.fine => Look::Clear,
        None | Some(_) => Look::Open(0.0),
    }
}

pub(crate) fn violation(touch: Touch, near: Near, required: f64) -> Violation {
    Violation { touch, distance: near.distance, required, place: near.place }
}

/// As [`near_solid`], for searches: never too great.
fn quick_solid(
    placed: &Placed,
    part: &Part,
    solid: &Solid,
    reach: f64,
    n: Vector3<f64>,
) -> Option<Near> {
    if solid.mesh {
        return near_solid(placed, part, solid, reach);
    }
    match separation_along(&(placed, &part.form), &(&solid.placed, &solid.form), reach, n) {
        Separation::Apart => None,
        Separation::Near { least, .. } => {
            Some(Near { distance: least, place: solid.placed.center() })
        }
    }
}

/// The exact distance from an obstacle, if less than `reach` (m).
pub(crate) fn near_solid(placed: &Placed, part: &Part, solid: &Solid, reach: f64) -> Option<Near> {
    let pose = to_pose(&solid.world_from_solid);
    // A mesh is a surface to parry: a part wholly inside it would touch nothing.
    let center = placed.center();
    if solid.mesh && solid.shape.contains_point(&pose, to_parry_point(&center)) {
        return Some(Near { distance: 0.0, place: center });
    }
    near(&pose_of(&placed.frame), &*part.shape.0, &pose, &*solid.shape.0, reach)
}
