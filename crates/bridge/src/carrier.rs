//! The carrier: messages between ground and a rover that is a process of its own, over TCP.
//!
//! ```text
//! Ground ──▶ link up   ──▶ RemoteRover ══ End ══ TCP ══ End ══ RoverHost ──▶ rover
//!        ◀── link down ◀──                                     (journal)  ◀──
//! ```
//!
//! The light time is the link model's, on the ground; the carrier is as fast as it can. What it
//! promises, whichever end or connection is cut off, at whatever moment:
//!
//! - *While both processes live*: every message arrives once and in order. Each has a number; what
//!   was not confirmed is written again on the next connection, from the number on that the other
//!   end names in its greeting.
//! - *A command is not carried late*: one that could not be handed over for 10 s is taken back, and
//!   is told as expired only where it certainly never arrived. An E-stop passes what waits, ends the
//!   commands among it, and waits for as long as it takes.
//! - *The rover's process ends*: its [`journal::Journal`] has every command before it is executed, so
//!   none runs twice. Commands that it may have got are of unknown outcome until the restarted rover
//!   says how they ended; none is sent again.
//! - *The ground's process ends*: what the rover says waits for the next one, which is also told the
//!   last words on recent commands. Frames that were written and not confirmed come to that one too,
//!   perhaps a second time; their time on board tells.
//! - *Bounded*: frames (16 MiB, 4 kB before the greeting), what is written and not confirmed, what
//!   waits: then telemetry gives way, oldest first, counted.

mod clocks;
mod converse;
mod end;
mod frame;
pub mod host;
pub mod journal;
mod remote;

pub use converse::{Shared, converse};
pub use end::{Bounds, End, Fate, Identity, Parcel, Reason};
pub use frame::{
    BODY_MAX, Body, CarrierError, Decoder, GREETING_MAX, Hello, PROTOCOL, Side, encode,
};
pub use remote::{GroundEnd, RemoteRover, Said};
