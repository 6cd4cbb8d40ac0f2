//! Stability against closed forms, independent oracles and degenerate input.
