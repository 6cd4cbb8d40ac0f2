//! One leg in many configurations that are much alike: what was in the way last is looked at first.

use rover::{Frame, LegAngles, LegChain, LegFrames};

use crate::checker::{Against, Allowance, LegChecker, Moment, Scratch, Touch};
use crate::look::Look;

/// What was in the way last, of a configuration like the next one. Starts as nothing in particular.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Hint(usize);

/// Answers as [`LegChecker::violation_at`] does whether a configuration is free; where it is not, it
/// names some violation, not the first. Holds what checks can use again.
pub struct QuickChecker<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
    /// From the link that carries the wheel to the wheel's frame.
    wheel_from_carrier: Frame,
    /// Frames of which only the carrier's counts.
    carried: LegFrames,
}

/// What is in the way of a foot, whatever the other joints of its leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootTouch {
    /// What touches what.
    pub touch: Touch,
    /// True if it is the wheel itself, which is the same solid whatever the pitch of its fork.
    pub is_wheel: bool,
}

impl<'c> QuickChecker<'c> {
    /// Prepares quick checks.
    pub fn new(checker: &'c LegChecker<'c>) -> QuickChecker<'c> {
        let wheel = &checker.scene.robot().leg(checker.leg()).wheel;
        QuickChecker {
            checker,
            scratch: Scratch::new(checker),
            wheel_from_carrier: Frame::from(&wheel.carrier_from_wheel.inverse()),
            carried: checker.chain().frames(&LegAngles::zeros()),
        }
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

    /// As [`touch_at`](Self::touch_at) for a wheel in `world`, before its leg's joint angles are known:
    /// nothing unless the hint is about the wheel, or what is fixed to its fork, and about what does not
    /// move with the leg.
    pub fn foot_touch_at(
        &mut self,
        wheel: &Frame,
        allowance: Allowance,
        hint: Hint,
    ) -> Option<FootTouch> {
        let item = self.checker.items.get(hint.0)?;
        let moving = &self.checker.moving[usize::from(item.moving)];
        if !moving.is_foot || matches!(item.against, Against::Own(_)) {
            return None;
        }
        let carrier = wheel.after(&self.wheel_from_carrier);
        self.carried.links.fill(carrier);
        if moving.place + 1 < self.checker.scene.robot().leg(self.checker.leg()).n_joints() {
            // A part that does not turn with the last joint: where that link would have to be.
            let part = carrier.after(&moving.link_from_part);
            self.carried.links[moving.place] = part.after(&moving.place_from_part().inverse());
        }
        self.scratch.clear();
        let moment = Moment::still(&self.carried, allowance);
        match self.checker.look(&moment, item, &mut self.scratch) {
            Look::Violated(violation) => {
                Some(FootTouch { touch: violation.touch, is_wheel: moving.part.is_wheel })
            }
            Look::Clear | Look::Open(_) => None,
        }
    }
}
