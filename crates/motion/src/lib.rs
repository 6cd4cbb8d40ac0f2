//! One leg from here to there: SBL, smoothing, step assembly, the final check.
//!
//! A planner's result depends on its inputs, its seed and its work budget alone; deadlines and
//! cancellation come in through a [`Watch`]. Outcomes are answers, not errors. Frame `world`,
//! meters, radians, seconds.
//!
//! - [`plan_step`]: body shift, lift, transit and drop of one leg (F75), or its transit alone.
//! - [`planner`]: the planners behind one trait (F60): [`astar`], [`sbl`], [`rrt_connect`].
//! - [`smooth`]: Dijkstra and bisection as published (F77-F79), then a taut string.
//! - [`adviser`]: the cheapest change of posture that gives a wanted margin before a lift.
//! - [`rehearsal`]: what is left if a leg fails or a foot settles now, and the way back.
//! - [`shift`]: the body over its planted feet, before a leg is lifted.
//! - [`timing`]: when each knot is passed, as fast as joints and stability allow.
//! - [`check`]: the final check, which alone decides whether a step may be offered.
//! - [`trial`]: seeded scenes in which planners are compared.

mod advance;
pub mod adviser;
mod answer;
pub mod astar;
pub mod check;
mod ends;
mod failure;
mod footing;
mod leg_space;
pub mod line;
mod margins;
mod nearest;
pub mod planner;
pub mod rehearsal;
pub mod rrt_connect;
pub mod sbl;
pub mod shift;
pub mod smooth;
pub mod space;
mod step;
pub mod timing;
mod transit;
pub mod trial;
mod watch;

pub use adviser::{
    Advice, AdviceError, AdviceOptions, Answer, Change, Cost, Limit, Margins, Motion, Proposal,
    Region, Wish, advise,
};
pub use answer::{
    Buffers, Constraint, EdgeRule, Finding, Footfall, Outcome, PathPlanner, Phase, Planner,
    Statistics, StepAnswer, StepRequest, Target, Waypoint,
};
pub use margins::{MOST_SAMPLES, MarginSample, Stretch, margins_along};
pub use rehearsal::{Aftermath, LegRehearsal, Rehearsal, RehearsalOptions, WayBack, rehearse};
pub use shift::{
    Barrier, BodyClear, CertifiedBody, Freedom, NoShift, SampledBody, ShiftPlan, ShiftRequest,
    base_between, plan_shift,
};
pub use step::plan_step;
pub use timing::{TimedPath, TimedPiece, TimingError, TimingLimits, time_body_path, time_leg_path};
pub use watch::{Stage, Stopped, Unwatched, Watch};
