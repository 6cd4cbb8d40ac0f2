//! Cells per second of traversability.
fn main() {}
