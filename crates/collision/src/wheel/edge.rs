//! Where a wheel can be nearest to an edge of the grid, in closed form.
//!
//! The wheel is convex, so its lower side over a straight edge is convex along it and the gap to ground
//! that rises evenly is so too. It is made of the wheel's round, of a flat side, and of where one of
//! the two ends, which is at a rim: the gap is least where the round is as steep as the ground, at a
//! rim, or at an end of the edge.

use arrayvec::ArrayVec;
use nalgebra::{Point2, Vector3};

use super::Cylinder;

/// Ends of the edge, the round's place, and two points of each rim.
const MOST: usize = 7;

/// A place along an edge and a point of the wheel there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    /// Share of the way along the edge, 0 to 1.
    pub share: f64,
    /// Height of the point (m).
    pub height: f64,
}

/// Points of the wheel over the edge from `a` to `b`, whose ground rises by `rise` (m): one of them is as
/// near to it as any other; none where the wheel is not over it.
pub(super) fn candidates(
    wheel: &Cylinder,
    a: Point2<f64>,
    b: Point2<f64>,
    rise: f64,
) -> ArrayVec<Candidate, MOST> {
    let mut found = ArrayVec::new();
    let mut at = |share: f64| {
        let lower = wheel.lower_side(a + (b - a) * share);
        found.extend(lower.map(|height| Candidate { share, height }));
    };
    at(0.0);
    at(1.0);
    let within = |share: &f64| (0.0..=1.0).contains(share);
    if wheel.ball {
        ball(wheel, a, b, rise).filter(within).map(at);
        return found;
    }
    let axle = wheel.axle.into_inner();
    // Level and across the axle; then across both, upward.
    let aside = axle.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or(Vector3::x());
    let up = aside.cross(&axle);
    let (from, way) = (a - wheel.center.xy(), b - a);
    let (start, rate) = (aside.xy().dot(&from), aside.xy().dot(&way));
    if rate != 0.0 {
        let tangent = rise * up.z + up.xy().dot(&way);
        let place = wheel.radius * tangent / tangent.hypot(rate) * rate.signum();
        Some((place - start) / rate).filter(within).map(at);
    }
    // A rim's points are c + r (cos · aside + sin · up): those above the line of the edge.
    let across = nalgebra::Vector2::new(-way.y, way.x);
    let (of_cos, of_sin) =
        (wheel.radius * across.dot(&aside.xy()), wheel.radius * across.dot(&up.xy()));
    let square = of_cos * of_cos + of_sin * of_sin;
    for side in [-wheel.half_width, wheel.half_width] {
        let of_one = across.dot(&(from - axle.xy() * side));
        let rest = square - of_one * of_one;
        if rest < 0.0 || square <= 0.0 {
            continue;
        }
        for root in [-rest.sqrt(), rest.sqrt()] {
            let cos = (of_cos * of_one - of_sin * root) / square;
            let sin = (of_sin * of_one + of_cos * root) / square;
            let point = axle * side + (aside * cos + up * sin) * wheel.radius;
            let share = (point.xy() - from).dot(&way) / way.norm_squared();
            if within(&share) {
                found.push(Candidate { share, height: wheel.center.z + point.z });
            }
        }
    }
    found
}

/// The share of the way at which a ball is as steep as the ground.
fn ball(wheel: &Cylinder, a: Point2<f64>, b: Point2<f64>, rise: f64) -> Option<f64> {
    let (from, way) = (a - wheel.center.xy(), b - a);
    let length = way.norm();
    let start = from.dot(&way) / length;
    // The ball's section above the edge is a disc.
    let square = wheel.radius * wheel.radius - (from.norm_squared() - start * start);
    (square >= 0.0).then(|| (square.sqrt() * rise / rise.hypot(length) - start) / length)
}
