//! Placeholder until the matcher is in.
fn main() {}
