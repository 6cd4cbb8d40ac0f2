//! The space a planner searches: joint angles of one leg, which of them are free, and which
//! straight edges between them.

use nalgebra::Isometry3;
use rand::{Rng, RngExt};
use rover::LegAngles;

/// Joint angles between limits, and the verdict on each and on the straight edges between them.
///
/// A space takes edges for free by one of two rules: certified, which holds at every resolution,
/// or sampled at [`Space::epsilon`], as published (F67). Where a joint is locked, both limits are
/// the same.
pub trait Space {
    /// Lower limits (rad).
    fn lower(&self) -> &LegAngles;
    /// Upper limits (rad).
    fn upper(&self) -> &LegAngles;
    /// Are these angles free of collision, within tolerances and stable? Asked for angles within
    /// the limits only.
    fn is_free(&mut self, angles: &LegAngles) -> bool;
    /// Is the straight edge free by the rule of the space, its ends included?
    fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool;
    /// Resolution (rad, largest joint) of the sampled rule; `None` where edges are certified.
    fn epsilon(&self) -> Option<f64>;
    /// Configurations looked at so far; each piece of a certificate counts as one.
    fn n_checked(&self) -> u64;
}

/// A space of a leg with a wheel, for planners in task space.
pub trait WheelSpace: Space {
    /// Pose of the wheel in `world`.
    fn wheel(&self, angles: &LegAngles) -> Isometry3<f64>;
    /// All branches within the limits that bring the wheel to this pose in `world`.
    fn angles_at(&self, wheel: &Isometry3<f64>) -> Vec<LegAngles>;
}

/// Largest difference of any joint (rad): the distance of SBL.
pub fn distance(a: &LegAngles, b: &LegAngles) -> f64 {
    (a - b).amax()
}

/// Euclidean length (rad) of a path through these angles.
pub fn path_length(path: &[LegAngles]) -> f64 {
    path.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
}

/// The angles at a share of the way from `a` to `b`; joints that agree keep their value exactly.
pub(crate) fn along(a: &LegAngles, b: &LegAngles, share: f64) -> LegAngles {
    a + (b - a) * share
}

/// Is the straight edge from `a` to `b` free at resolution `epsilon` (rad, largest joint)?
///
/// Bisection from coarse to fine (F67), ends not looked at. Free edges are checked at points no
/// farther apart than `epsilon`; the points do not depend on the order of a and b.
pub fn edge_is_sampled_free(
    space: &mut (impl Space + ?Sized),
    a: &LegAngles,
    b: &LegAngles,
    epsilon: f64,
) -> bool {
    let mut score = 0;
    while distance(a, b) / f64::from(1_u32 << score) > epsilon {
        if !middles_are_free(space, a, b, score) {
            return false;
        }
        score += 1;
    }
    true
}

/// Are the middles of the 2^score equal pieces of an edge free?
pub(crate) fn middles_are_free(
    space: &mut (impl Space + ?Sized),
    a: &LegAngles,
    b: &LegAngles,
    score: u32,
) -> bool {
    let n_pieces = 1_u64 << score;
    (0..n_pieces).all(|i| {
        let t = (i as f64 + 0.5) / n_pieces as f64;
        space.is_free(&(a * (1.0 - t) + b * t))
    })
}

/// Evenly distributed angles between two corners; a locked joint (equal corners) keeps its value.
pub(crate) fn sample_between(
    lower: &LegAngles,
    upper: &LegAngles,
    rng: &mut impl Rng,
) -> LegAngles {
    LegAngles::from_fn(|i, _| {
        if upper[i] > lower[i] { rng.random_range(lower[i]..=upper[i]) } else { lower[i] }
    })
}
