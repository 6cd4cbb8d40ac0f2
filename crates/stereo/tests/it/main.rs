//! Tests of the crate as its users see it.
#![allow(clippy::unwrap_used)]

mod calibration;
mod camera;
mod images;
mod matching;
mod rectification;
mod surface;
