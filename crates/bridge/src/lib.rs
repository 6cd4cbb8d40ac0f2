//! The bridge between ground and rover: two delays, the life of a command, the flight log and its
//! replay.
//!
//! ```text
//!            ┌──────────────────────────── Ground ─────────────────────────────┐
//! server ──▶ │ CommandBook ──▶ Recorder ──synced──▶ Direction up   ──▶ adapter │ ──▶ rover
//! stream ◀── │ Bus ◀── Recorder ◀── derived channels ◀── Direction down ◀──    │ ◀──
//!            └─────────────────────────────────────────────────────────────────┘
//! Replay ◀── log file                    (no way from here to the uplink, by type)
//! ```
//!
//! - [`link`]: one [`link::Direction`] per direction, a pure queue of events that takes the time as
//!   argument.
//! - [`commands`]: [`commands::CommandBook`], whose state is a fold of its events;
//!   [`commands::Authority`], who may command.
//! - [`recorder`]: one thread that owns the log file; what is acknowledged is on the disk.
//! - [`seal`], [`recover`], [`doctor`]: complete files out of what was written, also after a crash.
//! - [`reader`], [`catalog`]: reading any MCAP file, also a hostile one, within stated limits.
//! - [`views`]: what stock viewers draw of a log, in the log.
//! - [`replay`]: a log played through the same channels.
//! - [`carrier`]: a rover that is a process of its own: connection, resumption, its memory.
//! - [`bus`]: every message, encoded once, for all listeners in the process.
//! - [`ground`]: [`ground::Ground`] ties these together; [`ground::run`] drives it.
//!
//! What is deliberately absent: HTTP, accounts (who somebody is), and every clock but
//! [`clock::Clock`].

pub mod adapter;
pub mod bookmarks;
pub mod bus;
pub mod carrier;
pub mod catalog;
pub mod clip;
pub mod clock;
pub mod commands;
pub mod doctor;
pub mod ground;
pub mod images;
pub mod link;
mod marks;
pub mod reader;
pub mod recorder;
pub mod recover;
pub mod replay;
pub mod rewrite;
pub mod seal;
pub mod segments;
pub mod sim_adapter;
pub mod verify;
pub mod views;
