//! Tests of the bridge over its public interface.

#![allow(clippy::unwrap_used)] // a test may

mod authority;
mod basis;
mod bounds;
mod bus;
mod carrier;
mod catalog;
mod chain;
mod clock;
mod commands;
mod conformance;
mod crash;
mod damage;
mod day_log;
mod disk_full;
mod estop;
mod ground;
mod histories;
mod hostile;
mod images;
mod kill;
mod large_log;
mod link;
mod partition;
mod preconditions;
mod recorder;
mod replay;
mod sim_adapter;
mod sim_fs;
mod stock_reader;
mod support;
mod variants;
mod virtual_wire;
