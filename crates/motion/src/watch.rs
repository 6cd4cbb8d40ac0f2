//! Deadlines, cancellation and progress: handed in, for the planner never reads a clock.

/// Why work was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// The time was up.
    Deadline,
    /// Nobody wants the answer anymore.
    Cancelled,
}

/// What a planner is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Looks for a shift of the body.
    Shift,
    /// Looks for ways to put the wheel down.
    Footfall,
    /// Searches a path.
    Search,
    /// Shortens the path.
    Smoothing,
    /// Checks the whole step again, independently.
    Check,
}

/// Asked now and then by long work, and told what it does.
pub trait Watch {
    /// Should the work stop, and why?
    fn stopped(&mut self) -> Option<Stopped> {
        None
    }
    /// The work enters a stage.
    fn entered(&mut self, stage: Stage) {
        let _ = stage;
    }
}

/// Never stops, tells nobody.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unwatched;

impl Watch for Unwatched {}
