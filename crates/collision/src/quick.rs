//! One leg in many configurations that are much alike: what was in the way last is looked at first.

use rover::{LegChain, LegFrames};

use crate::checker::{Allowance, LegChecker, Moment, Scratch, Touch};
use crate::look::Look;

/// Answers as [`LegChecker::violation_at`] does whether a configuration is free; where it is not, it
/// names some violation, not the first. Holds what checks can use again.
pub struct QuickChecker<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
    /// All that is looked at, by its number: what was in the way last comes first.
    order: Vec<u16>,
}

impl<'c> QuickChecker<'c> {
    /// Prepares quick checks.
    pub fn new(checker: &'c LegChecker<'c>) -> QuickChecker<'c> {
        let order = (0..checker.items.len() as u16).collect();
        QuickChecker { checker, scratch: Scratch::new(checker), order }
    }

    /// The kinematics of the moving leg.
    pub fn chain(&self) -> &'c LegChain {
        self.checker.chain()
    }

    /// Something nearer than it may be; `None` if all is free. `frames` are of the checker's
    /// [`chain`](Self::chain).
    pub fn touch(&mut self, frames: &LegFrames, allowance: Allowance) -> Option<Touch> {
        let moment = Moment::still(frames, allowance);
        self.scratch.clear();
        let (checker, scratch) = (self.checker, &mut self.scratch);
        let mut found = None;
        for (place, item) in self.order.iter().enumerate() {
            let item = &checker.items[*item as usize];
            if let Look::Violated(violation) = checker.look(&moment, item, scratch) {
                found = Some((place, violation.touch));
                break;
            }
        }
        let (place, touch) = found?;
        self.order[..=place].rotate_right(1);
        Some(touch)
    }
}
