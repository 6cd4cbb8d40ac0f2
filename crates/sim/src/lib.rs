//! The simulated rover: a rigid stand-in that takes commands and reports frames as a real one does.
//!
//! The rover is rigid and statically stable (F9): it stands on three held wheels or more. Either
//! one leg moves and the base does not, or all standing legs move at once and the base shifts over
//! wheels that stay, or all wheels roll along an arc. No compliance but for the loads told of pressed wheels, no dynamics. Time
//! comes in through [`SimRover::advance`] alone; there is no clock, no random number, no I/O, and
//! the same calls give the same frames. Frame `world` (z up), meters, radians, newtons.
//!
//! - [`settle`]: a configuration in which the rover stands on a map near a wished place;
//! - [`SimRover`]: commands in, [`Event`]s and [`Frame`]s out, with its own guards and E-stop;
//! - [`Cameras`]: images on order, sent in pieces.

mod arc;
mod cameras;
mod closure;
mod command;
mod drive;
mod frame;
mod guard;
mod line;
mod memory;
mod path;
mod phase;
mod preview;
mod refusal;
mod rover;
mod settle;
mod stand;
mod steer;
mod trace;

pub use cameras::{
    CAPTURES_MAX, Cameras, Drawing, Effects, IMAGE_BYTES_MAX, ImageName, ImageOrder, ImageRefusal,
    ImageWord, KEPT_BYTES_MAX, Missing, PAIRS_MAX, PIECE_BYTES, RATE_BPS, SCALE, Side, scaled,
};
pub use command::{
    BODY_KNOTS_MAX, Basis, BodyKnot, Command, DriveArc, Gate, GateFn, GoalFrame, ID_LENGTH_MAX,
    JointKnot, KNOTS_MAX, Motion, Operating, START_TOLERANCE_RAD, STEPS_MAX, Step, TIME_MAX_S,
    WheelHold,
};
pub use drive::{DRIVE_DISTANCE_MAX, DRIVE_SLOPE_MAX, DRIVE_SPEED, DRIVE_SPEED_MAX};
pub use frame::{Event, Executing, Frame, Mode, Stage, WheelFrame};
pub use guard::Fault;
pub use memory::REMEMBERED_IDS;
pub use preview::{Preview, PreviewError};
pub use refusal::Refusal;
pub use rover::{ReseatError, SimRover, StandError};
pub use settle::{Misfit, SettleError, SettleOptions, Settled, settle};
