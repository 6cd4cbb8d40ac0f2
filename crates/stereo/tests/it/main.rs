//! Tests of the crate as its users see it.
#![allow(clippy::unwrap_used)]
// Figures of quality, for `--nocapture`.
#![allow(clippy::print_stdout)]

mod calibration;
mod camera;
mod campaign;
mod codec;
mod images;
mod map_truth;
mod matching;
mod ortho;
mod ortho_rays;
mod ray;
mod rectification;
mod render;
mod rig;
mod self_mask;
mod surface;
