//! The ground server: routes, stream, jobs, configuration, command line.
//!
//! It holds no domain logic: it looks up what a request names, calls the crates below, and puts
//! their answers into the words of `wire`. Requests of a stateless analysis go the same way over
//! HTTP ([`api`]) and on the command line ([`cli`]).

pub mod analyses;
pub mod api;
pub mod app;
mod assets;
pub mod body;
pub mod cli;
mod compare;
pub mod config;
pub mod drape;
pub mod error;
mod foxglove;
pub mod gate;
pub mod imaging;
mod import;
pub mod jobs;
pub mod live;
pub mod live_reach;
pub mod log_level;
pub mod plans;
pub mod reconstruction;
pub mod replays;
pub mod robots;
pub mod scene;
pub mod security;
pub mod serve;
mod staging;
pub mod stop;
pub mod stream;
mod terrain_files;
pub mod terrain_store;
pub mod terrains;
mod unknown_ground;
pub mod world;
