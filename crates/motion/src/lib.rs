//! One leg from here to there: SBL, smoothing, step assembly, the final check.

pub mod sbl;
pub mod smooth;
pub mod space;
pub mod watch;
