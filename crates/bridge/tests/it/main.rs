//! Tests of the bridge over its public interface.

#![allow(clippy::unwrap_used)] // a test may

mod bus;
mod commands;
mod estop;
mod ground;
mod hostile;
mod link;
mod recorder;
mod replay;
mod sim_adapter;
mod stock_reader;
mod support;
