//! A motion looked at piece by piece, from coarse to fine: what is in the way is met early, and each
//! piece is looked at only for what its parent left open. What is clear about the middle of a piece is
//! not looked at again.

use std::collections::VecDeque;

use crate::certificate::Certificate;
use crate::look::Look;

/// Most pieces of one motion.
const MOST_PIECES: usize = 1_200;

/// Share of what is clear about the middle of a piece that is taken for it.
const SURELY_CLEAR: f64 = 0.999;

/// A motion with the things to look at.
pub(crate) trait Subject {
    /// One thing to look at.
    type Item: Copy;

    /// The piece that is looked at from now on: its middle and half length as shares of the way.
    fn enter(&mut self, middle: f64, half: f64);

    /// Looks at one item over the piece.
    fn look(&mut self, item: &Self::Item) -> Look;

    /// How far the bodies of an item that has been looked at can get within the piece (m).
    fn motion(&mut self, item: &Self::Item) -> f64;

    /// Adds what is to be looked at again in place of an open item.
    fn keep_open(&mut self, item: Self::Item, open: &mut Vec<Self::Item>) {
        open.push(item);
    }
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

/// The work space of certificates; keeps its memory from one motion to the next.
pub(crate) struct Bisection<I> {
    pieces: VecDeque<Piece>,
    /// Lists of open items, one behind the other.
    open: Vec<I>,
    /// Pieces looked at so far.
    pub n_pieces: u64,
}

impl<I: Copy> Bisection<I> {
    pub fn new() -> Bisection<I> {
        Bisection { pieces: VecDeque::new(), open: Vec::new(), n_pieces: 0 }
    }

    /// Is everything in `items` clear over the whole motion? Pieces over whose half no body of an open
    /// item gets as far as `finest` (m) are not cut again.
    pub fn certify(
        &mut self,
        subject: &mut impl Subject<Item = I>,
        items: &[I],
        finest: f64,
    ) -> Certificate {
        self.open.clear();
        self.open.extend_from_slice(items);
        self.pieces.clear();
        self.pieces.push_back(Piece { middle: 0.5, half: 0.5, items: (0, items.len()) });
        let mut n = 0;
        while let Some(piece) = self.pieces.pop_front() {
            n += 1;
            self.n_pieces += 1;
            subject.enter(piece.middle, piece.half);
            let first = self.open.len();
            let (mut farthest, mut clear) = (0.0_f64, 1.0_f64);
            for k in piece.items.0..piece.items.1 {
                let item = self.open[k];
                match subject.look(&item) {
                    Look::Clear => {}
                    Look::Violated(violation) => {
                        return Certificate::Blocked { share: piece.middle, violation };
                    }
                    Look::Open(share) => {
                        clear = clear.min(share);
                        farthest = farthest.max(subject.motion(&item));
                        subject.keep_open(item, &mut self.open);
                    }
                }
            }
            if self.open.len() == first {
                continue;
            }
            if farthest < finest || n >= MOST_PIECES {
                return Certificate::Open { share: piece.middle };
            }
            let items = (first, self.open.len());
            // What is left on either side of what is clear, which rounding must not make wider.
            let clear = SURELY_CLEAR * clear * piece.half;
            let half = 0.5 * (piece.half - clear);
            let off = clear + half;
            for middle in [piece.middle - off, piece.middle + off] {
                self.pieces.push_back(Piece { middle, half, items });
            }
        }
        Certificate::Free
    }
}
