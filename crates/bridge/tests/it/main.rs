//! Tests of the bridge over its public interface.

#![allow(clippy::unwrap_used)] // a test may

mod authority;
mod basis;
mod bus;
mod clock;
mod commands;
mod estop;
mod ground;
mod histories;
mod hostile;
mod link;
mod recorder;
mod replay;
mod sim_adapter;
mod stock_reader;
mod support;
