//! The ground server as a whole: over HTTP in this process, over its stream, and as a program.

#![allow(clippy::unwrap_used)]

mod admin;
mod analyses;
mod bad_input;
mod clean_stop;
mod codes;
mod command_line;
mod commanding;
mod consoles;
mod contact;
mod documents;
mod drape;
mod foxglove;
mod images;
mod job;
mod log_views;
mod map_truth;
mod old_log;
mod one_model;
mod plan_record;
mod posture;
mod real_terrain;
mod reconstruction;
mod replay_margins;
mod routes;
mod rover_process;
mod sequences;
mod slow_consoles;
mod soak;
mod stability;
mod stream;
mod support;
