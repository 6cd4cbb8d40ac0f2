//! The simulated rover: a rigid stand-in that takes commands and reports frames as a real one does.
//!
//! The rover is rigid and statically stable (F9): it stands on three held wheels or more. Either
//! one leg moves and the base does not, or all standing legs move at once and the base shifts over
//! wheels that stay. No compliance but for the loads told of pressed wheels, no dynamics. Time
//! comes in through [`SimRover::advance`] alone; there is no clock, no random number, no I/O, and
//! the same calls give the same frames. Frame `world` (z up), meters, radians, newtons.
//!
//! - [`settle`]: a configuration in which the rover stands on a map near a wished place;
//! - [`SimRover`]: commands in, [`Event`]s and [`Frame`]s out, with its own guards and E-stop;
//! - [`Cameras`]: images on order, sent in pieces.

mod cameras;
mod closure;
mod command;
mod frame;
mod guard;
mod line;
mod memory;
mod path;
mod rover;
mod settle;
mod stand;

pub use cameras::{
    CAPTURES_MAX, Cameras, Drawing, Effects, IMAGE_BYTES_MAX, ImageName, ImageOrder, ImageRefusal,
    ImageWord, KEPT_BYTES_MAX, Missing, PAIRS_MAX, PIECE_BYTES, RATE_BPS, SCALE, Side, scaled,
};
pub use command::{
    BODY_KNOTS_MAX, Basis, BodyKnot, Command, ID_LENGTH_MAX, JointKnot, KNOTS_MAX, Motion, Refusal,
    START_TOLERANCE_RAD, TIME_MAX_S, WheelHold,
};
pub use frame::{Event, Executing, Frame, Mode, Stage};
pub use guard::Fault;
pub use memory::REMEMBERED_IDS;
pub use rover::{ReseatError, SimRover, StandError};
pub use settle::{Misfit, SettleError, SettleOptions, Settled, settle};
