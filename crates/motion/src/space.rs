//! The space a planner searches: joint angles of one leg, and which of them are free.

use rover::LegAngles;

/// Joint angles between limits, and the verdict on each.
pub trait Space {
    /// Lower limits (rad).
    fn lower(&self) -> &LegAngles;
    /// Upper limits (rad).
    fn upper(&self) -> &LegAngles;
    /// Are these angles free of collision, within tolerances and stable? Asked for angles within
    /// the limits only.
    fn is_free(&mut self, angles: &LegAngles) -> bool;
}

/// Largest difference of any joint (rad): the distance of SBL.
pub fn distance(a: &LegAngles, b: &LegAngles) -> f64 {
    (a - b).amax()
}

/// Euclidean length (rad) of a path through these angles.
pub fn path_length(path: &[LegAngles]) -> f64 {
    path.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
}

/// Is the straight edge from `a` to `b` free at resolution `epsilon` (rad, largest joint)?
///
/// Bisection from coarse to fine (F67), ends not looked at. Free edges are checked at points no
/// farther apart than `epsilon`; the points do not depend on the order of a and b.
pub fn edge_is_free(space: &mut impl Space, a: &LegAngles, b: &LegAngles, epsilon: f64) -> bool {
    let mut pieces = 1_u64;
    while distance(a, b) / pieces as f64 > epsilon {
        for i in 0..pieces {
            let t = (i as f64 + 0.5) / pieces as f64;
            if !space.is_free(&(a * (1.0 - t) + b * t)) {
                return false;
            }
        }
        pieces *= 2;
    }
    true
}
