//! Where one leg can stand, and why not elsewhere (F42-F47): a class, a reason and a margin for
//! each cell of the ground around it. Does not plan.
//!
//! Cells lie on a grid whose nodes are multiples of its resolution, so that two answers of the
//! same resolution fall on each other. Frame `world`, meters.
//!
//! - [`reach`], [`reach_legs`]: all cells, of one leg or of several;
//! - [`reach_again`]: an answer brought up to date where the ground has changed;
//! - [`explain`]: one cell in full: what stands in the way, by name, and what would help.

mod again;
mod answer;
mod cell;
mod explain;
mod look;
mod mend;
mod reach;
mod stance;
mod strip;

pub use again::{Area, reach_again};
pub use answer::{CellClass, GroundClasses, ReachGrid, ReachOptions, Reason, WheelHeading};
pub use explain::{Explanation, Obstruction, explain};
pub use mend::Mend;
pub use reach::{reach, reach_legs};
