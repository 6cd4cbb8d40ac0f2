//! The ground server as a whole: over HTTP in this process, over its stream, and as a program.

#![allow(clippy::unwrap_used)]

mod analyses;
mod bad_input;
mod codes;
mod command_line;
mod commanding;
mod consoles;
mod documents;
mod foxglove;
mod job;
mod log_views;
mod old_log;
mod posture;
mod real_terrain;
mod reconstruction;
mod routes;
mod soak;
mod stability;
mod stream;
mod support;
