//! Certificates: a motion declared free is free at every resolution.
//!
//! A joint-linear piece is looked at in its middle. What is farther from every other thing than the
//! clearance that it must keep and the way that any of its points can go within the piece
//! ([`rover::LegFrames::motion_bound`]) is clear over all of the piece; for what is not, the piece is
//! cut in two. Two moving bodies of one leg are bounded by the joints between them. Pieces are looked
//! at from coarse to fine, so that what is in the way is met early, and each piece only at what its
//! parent left open (planning.md, sections 3 and 4: conservative advancement by motion bounds).

use std::collections::VecDeque;

use rover::{LegAngles, LegFrames};

use crate::checker::{Against, Allowance, Item, LegChecker, Look, Moment, Scratch, Violation};

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
const FINEST: f64 = 1e-3;

/// Way of the foot over half a piece below which exact distances are asked for (m at scale 1):
/// above, a piece that quick bounds leave open is cheaper to cut.
const FINE: f64 = 0.05;

/// Most pieces of one motion.
const MOST_PIECES: usize = 1_200;

/// The work space of certificates of one checker; keeps its memory from one motion to the next.
pub struct Certifier<'c, 'a> {
    checker: &'c LegChecker<'a>,
    scratch: Scratch,
    pieces: VecDeque<Piece>,
    /// Lists of open items, one behind the other.
    open: Vec<Item>,
    n_pieces: u64,
}

/// Part of a motion that is still to be looked at.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Middle and half length, as shares of the way.
    middle: f64,
    half: f64,
    /// Its items in `open`.
    items: (usize, usize),
}

impl<'c, 'a> Certifier<'c, 'a> {
    /// A work space for `checker`.
    pub fn new(checker: &'c LegChecker<'a>) -> Certifier<'c, 'a> {
        Certifier {
            checker,
            scratch: Scratch::new(checker),
            pieces: VecDeque::new(),
            open: Vec::new(),
            n_pieces: 0,
        }
    }

    /// The checker.
    pub fn checker(&self) -> &'c LegChecker<'a> {
        self.checker
    }

    /// Configurations looked at so far: one a piece, and one a call of [`violation`](Self::violation).
    pub fn n_looked(&self) -> u64 {
        self.n_pieces
    }

    /// The first thing nearer than it may be at these joint angles.
    pub fn violation(&mut self, angles: &LegAngles, allowance: Allowance) -> Option<Violation> {
        let frames = self.checker.chain.frames(angles);
        self.violation_in(&frames, allowance)
    }

    /// As [`violation`](Self::violation) with the leg's frames at hand.
    pub fn violation_in(&mut self, frames: &LegFrames, allowance: Allowance) -> Option<Violation> {
        self.n_pieces += 1;
        self.scratch.clear();
        self.checker.first_violation(&Moment::still(frames, allowance), &mut self.scratch)
    }

    /// Do all parts of the leg but the foot on its ground keep `extra` (m) beyond what they must?
    pub fn is_roomy(&mut self, angles: &LegAngles, allowance: Allowance, extra: f64) -> bool {
        self.n_pieces += 1;
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
        let scale = checker.scene.robot().scale();
        let way = (b - a).abs();
        self.open.clear();
        self.open.extend_from_slice(&checker.items);
        self.pieces.clear();
        self.pieces.push_back(Piece { middle: 0.5, half: 0.5, items: (0, self.open.len()) });
        let mut n = 0;
        while let Some(piece) = self.pieces.pop_front() {
            n += 1;
            self.n_pieces += 1;
            self.scratch.clear();
            let frames = checker.chain.frames(&(a * (1.0 - piece.middle) + b * piece.middle));
            let change = way * piece.half;
            let moment = Moment {
                frames: &frames,
                change: &change,
                allowance,
                fine: self.scratch.foot_motion(checker, &frames, &change) < FINE * scale,
                touch_only: false,
                extra: 0.0,
            };
            let first = self.open.len();
            let mut farthest = 0.0_f64;
            for k in piece.items.0..piece.items.1 {
                let item = self.open[k];
                match checker.look(&moment, &item, &mut self.scratch) {
                    Look::Clear => {}
                    Look::Violated(violation) => {
                        return Certificate::Blocked { share: piece.middle, violation };
                    }
                    Look::Open => {
                        farthest = farthest.max(self.scratch.motion(item.moving as usize));
                        self.keep_open(&moment, item);
                    }
                }
            }
            if self.open.len() == first {
                continue;
            }
            if farthest < FINEST * scale || n >= MOST_PIECES {
                return Certificate::Open { share: piece.middle };
            }
            let items = (first, self.open.len());
            let half = 0.5 * piece.half;
            for middle in [piece.middle - half, piece.middle + half] {
                self.pieces.push_back(Piece { middle, half, items });
            }
        }
        Certificate::Free
    }

    /// Of a group only the members that are open are looked at again.
    fn keep_open(&mut self, moment: &Moment, item: Item) {
        let Against::Group(group) = item.against else {
            self.open.push(item);
            return;
        };
        for against in self.checker.members(group) {
            let member = Item { against, ..item };
            if !matches!(self.checker.look(moment, &member, &mut self.scratch), Look::Clear) {
                self.open.push(member);
            }
        }
    }
}
