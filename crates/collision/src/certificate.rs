//! Certificates: a motion declared free is free at every resolution.
//!
//! A joint-linear piece is looked at in its middle. What is farther from every other thing than the
//! clearance that it must keep and the way that any of its points can go within the piece
//! ([`rover::LegFrames::motion_bound`]) is clear over all of the piece; for what is not, what is left
//! on either side of what the distance clears about the middle is looked at again. Two moving bodies of
//! one leg are bounded by the joints between them. Pieces are looked at from coarse to fine, so that
//! what is in the way is met early, and each piece only at what its parent left open (planning.md,
//! sections 3 and 4: conservative advancement by motion bounds).

use rover::{LegAngles, LegFrames};

use crate::bisection::{Bisection, Subject};
use crate::checker::{Against, Allowance, Item, LegChecker, Moment, Scratch, Violation};
use crate::look::Look;

/// What is known of a joint-linear motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Certificate {
    /// Free all along, ends included, at every resolution.
    Free,
    /// Not free at this share of the way.
    Blocked {
        /// Share of the way, 0 to 1.
        share: f64,
        /// What is nearer there than it may be.
        violation: Violation,
    },
    /// Too near to something to be told apart from a touch: counts as not free.
    Open {
        /// Share of the way, 0 to 1.
        share: f64,
    },
}

impl Certificate {
    /// Is the motion free?
    pub fn is_free(&self) -> bool {
        *self == Certificate::Free
    }
}

/// Way of a body over half a piece below which the piece is not cut again (m at scale 1).
pub(crate) const FINEST: f64 = 1e-3;

/// Way of the foot over half a piece below which exact distances are asked for (m at scale 1):
/// above, a piece that quick bounds leave open is cheaper to cut.
const FINE: f64 = 0.05;

/// The work space of certificates of one checker; keeps its memory from one motion to the next.
pub struct Certifier<'c, 'a> {
    checker: &'c LegChecker<'a>,
    scratch: Scratch,
    bisection: Bisection<Item>,
}

impl<'c, 'a> Certifier<'c, 'a> {
    /// A work space for `checker`.
    pub fn new(checker: &'c LegChecker<'a>) -> Certifier<'c, 'a> {
        Certifier { checker, scratch: Scratch::new(checker), bisection: Bisection::new() }
    }

    /// The checker.
    pub fn checker(&self) -> &'c LegChecker<'a> {
        self.checker
    }

    /// Configurations looked at so far: one a piece, and one a call of [`violation`](Self::violation).
    pub fn n_looked(&self) -> u64 {
        self.bisection.n_pieces
    }

    /// The first thing nearer than it may be at these joint angles.
    pub fn violation(&mut self, angles: &LegAngles, allowance: Allowance) -> Option<Violation> {
        let frames = self.checker.chain.frames(angles);
        self.violation_in(&frames, allowance)
    }

    /// As [`violation`](Self::violation) with the leg's frames at hand.
    pub fn violation_in(&mut self, frames: &LegFrames, allowance: Allowance) -> Option<Violation> {
        self.bisection.n_pieces += 1;
        self.scratch.clear();
        self.checker.first_violation(&Moment::still(frames, allowance), &mut self.scratch)
    }

    /// Do all parts of the leg but the foot on its ground keep `extra` (m) beyond what they must?
    pub fn is_roomy(&mut self, angles: &LegAngles, allowance: Allowance, extra: f64) -> bool {
        self.bisection.n_pieces += 1;
        self.scratch.clear();
        let checker = self.checker;
        let frames = checker.chain.frames(angles);
        let moment = Moment { extra, ..Moment::still(&frames, allowance) };
        checker.items.iter().all(|item| {
            let foot = checker.moving[item.moving as usize].is_foot;
            (foot && item.against == Against::Ground)
                || matches!(checker.look(&moment, item, &mut self.scratch), Look::Clear)
        })
    }

    /// Is the joint-linear motion from `a` to `b` free? Limits of joints are not looked at.
    pub fn certify(&mut self, a: &LegAngles, b: &LegAngles, allowance: Allowance) -> Certificate {
        let checker = self.checker;
        let mut motion = LegMotion {
            checker,
            scratch: &mut self.scratch,
            ends: [a, b],
            allowance,
            frames: checker.chain.frames(a),
            change: LegAngles::zeros(),
            fine: false,
        };
        let finest = FINEST * checker.scene.robot().scale();
        self.bisection.certify(&mut motion, &checker.items, finest)
    }
}

/// A joint-linear motion of the leg, and the piece of it that is looked at.
struct LegMotion<'m, 'c, 'a> {
    checker: &'c LegChecker<'a>,
    scratch: &'m mut Scratch,
    ends: [&'m LegAngles; 2],
    allowance: Allowance<'m>,
    frames: LegFrames,
    change: LegAngles,
    fine: bool,
}

impl Subject for LegMotion<'_, '_, '_> {
    type Item = Item;

    fn enter(&mut self, middle: f64, half: f64) {
        let [a, b] = self.ends;
        self.scratch.clear();
        self.frames = self.checker.chain.frames(&(a * (1.0 - middle) + b * middle));
        self.change = (b - a).abs() * half;
        let foot = self.scratch.foot_motion(self.checker, &self.frames, &self.change);
        self.fine = foot < FINE * self.checker.scene.robot().scale();
    }

    fn look(&mut self, item: &Item) -> Look {
        let moment = Moment {
            frames: &self.frames,
            change: &self.change,
            allowance: self.allowance,
            fine: self.fine,
            touch_only: false,
            extra: 0.0,
        };
        self.checker.look(&moment, item, self.scratch)
    }

    fn motion(&mut self, item: &Item) -> f64 {
        self.scratch.motion(item.moving as usize)
    }

    /// Of a group only the members that are open are looked at again.
    fn keep_open(&mut self, item: Item, open: &mut Vec<Item>) {
        let Against::Group(group) = item.against else {
            open.push(item);
            return;
        };
        for against in self.checker.members(group) {
            let member = Item { against, ..item };
            if !matches!(self.look(&member), Look::Clear) {
                open.push(member);
            }
        }
    }
}
