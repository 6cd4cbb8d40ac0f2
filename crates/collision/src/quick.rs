//! One leg in many configurations that are much alike: what was in the way last is looked at first.

use rover::{LegChain, LegFrames};

use crate::checker::{Allowance, LegChecker, Moment, Scratch, Touch};
use crate::look::Look;

/// What was in the way last, of a configuration like the next one. Starts as nothing in particular.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Hint(usize);

/// Answers as [`LegChecker::violation_at`] does whether a configuration is free; where it is not, it
/// names some violation, not the first. Holds what checks can use again.
pub struct QuickChecker<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
}

impl<'c> QuickChecker<'c> {
    /// Prepares quick checks.
    pub fn new(checker: &'c LegChecker<'c>) -> QuickChecker<'c> {
        QuickChecker { checker, scratch: Scratch::new(checker) }
    }

    /// The kinematics of the moving leg.
    pub fn chain(&self) -> &'c LegChain {
        self.checker.chain()
    }

    /// Something nearer than it may be; `None` if all is free. `frames` are of the checker's
    /// [`chain`](Self::chain).
    pub fn touch(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<Touch> {
        if let Some(touch) = self.touch_at(frames, allowance, *hint) {
            return Some(touch);
        }
        let moment = Moment::still(frames, allowance);
        let (checker, scratch) = (self.checker, &mut self.scratch);
        for (place, item) in checker.items.iter().enumerate().filter(|(place, _)| *place != hint.0)
        {
            if let Look::Violated(violation) = checker.look(&moment, item, scratch) {
                *hint = Hint(place);
                return Some(violation.touch);
            }
        }
        None
    }

    /// As [`touch`](Self::touch), but looks only at what the hint says.
    pub fn touch_at(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        hint: Hint,
    ) -> Option<Touch> {
        self.scratch.clear();
        let item = self.checker.items.get(hint.0)?;
        let moment = Moment::still(frames, allowance);
        match self.checker.look(&moment, item, &mut self.scratch) {
            Look::Violated(violation) => Some(violation.touch),
            Look::Clear | Look::Open(_) => None,
        }
    }
}
