//! Tests of the messages over their public interface.

#![allow(clippy::unwrap_used)] // a test may

mod foxglove;
