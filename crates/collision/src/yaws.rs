//! What turns with the hip yaw alone: looked at once for each small piece of that joint's range.
//!
//! Housings about the hip are always near to the base, so that rooms about them are soon used up; but where they
//! are depends on one joint, and what is clear over a piece of its range stays so.

use rover::{JointKind, LegAngles, LegFrames};

use crate::checker::{Item, LegChecker};

/// Length of a piece (rad).
const PIECE: f64 = 0.005;

/// By piece of the first joint's range, the items of a part that are not clear over all of it; none where
/// that has not been asked.
pub(crate) struct Yaws {
    lower: f64,
    pieces: Vec<Option<Vec<Item>>>,
    /// How far a point of the part is from the joint's axis at most (m).
    radius: f64,
}

impl Yaws {
    /// For a part that the first joint alone moves, within `radius` (m) of its axis; none if that joint does
    /// not turn between limits.
    pub fn new(checker: &LegChecker, radius: f64) -> Option<Yaws> {
        let robot = checker.scene.robot();
        let leg = robot.leg(checker.leg());
        let range = leg.upper[0] - leg.lower[0];
        let turns = robot.joints()[leg.joints[0]].kind == JointKind::Revolute;
        let is_bounded = (0.0..=2.0 * std::f64::consts::TAU).contains(&range);
        (turns && is_bounded).then(|| {
            let n = (range / PIECE).floor() as usize + 1;
            Yaws { lower: leg.lower[0], pieces: vec![None; n], radius }
        })
    }

    /// The piece of a configuration; none beyond the range, and where the angles are not known.
    pub fn piece(&self, frames: &LegFrames) -> Option<usize> {
        let at = ((frames.angles[0] - self.lower) / PIECE).floor();
        (at >= 0.0 && at < self.pieces.len() as f64).then_some(at as usize)
    }

    /// Is the piece of a configuration known to be clear all over?
    pub fn is_clear(&self, frames: &LegFrames) -> bool {
        let open = self.piece(frames).and_then(|piece| self.pieces[piece].as_ref());
        open.is_some_and(Vec::is_empty)
    }

    /// The items of a piece to be looked at each time: those that `open_about` the middle of the piece says, within
    /// the way that the part may go from there (m).
    pub fn open(
        &mut self,
        checker: &LegChecker,
        piece: usize,
        open_about: impl FnOnce(&LegFrames, f64) -> Vec<Item>,
    ) -> &[Item] {
        self.pieces[piece].get_or_insert_with(|| {
            let mut angles = LegAngles::zeros();
            angles[0] = self.lower + (piece as f64 + 0.5) * PIECE;
            // Half a piece, and something for rounding at its ends.
            open_about(&checker.chain.frames(&angles), 0.501 * PIECE * self.radius)
        })
    }
}
