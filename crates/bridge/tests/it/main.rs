//! Tests of the bridge over its public interface.

#![allow(clippy::unwrap_used)] // a test may

mod authority;
mod basis;
mod bus;
mod chain;
mod clock;
mod commands;
mod crash;
mod damage;
mod disk_full;
mod estop;
mod ground;
mod histories;
mod hostile;
mod kill;
mod link;
mod preconditions;
mod recorder;
mod replay;
mod sim_adapter;
mod sim_fs;
mod stock_reader;
mod support;
