//! Where one leg can stand, and why not elsewhere (F42-F47): a class, a reason and a margin for
//! each cell of the ground around it. Does not plan.
//!
//! Cells lie on a grid whose nodes are multiples of its resolution, so that two answers of the
//! same resolution fall on each other. Frame `world`, meters.

mod reach;

pub use reach::{CellClass, ReachGrid, ReachOptions, Reason, reach};
