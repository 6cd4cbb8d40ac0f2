//! Stereo cameras: models, rectification, matching, triangulation with covariance.
//!
//! Everything here is values in, values out: text of calibrations, gray images, robot and ground.
//! Nothing reads files or clocks; parallel work is in threads that end with the call and gives the
//! same bits as one thread. Lengths are meters, angles radians. Pixels count from the middle of the
//! upper left one: x right, y down; a camera's axes are x right, y down, z forward.
//!
//! - [`camera`]: pinhole with Brown's distortion, CAHV, CAHVOR; [`calibration`]: their files.
//! - [`rectification`]: both images as one ideal pair; [`epipolar`]: whether their rows agree.
//! - [`matching`]: disparities of a rectified pair, by semi-global matching.
//! - [`surface`]: points with covariance; [`pair`]: all of it for one pair, with its health.
//! - [`ray`]: rays against ground and robot; [`render`]: images of simulated cameras, and their truth.
//! - [`codec`]: images as PNG.
//! - [`rig`]: the pairs of a robot; [`coverage`]: what they would see, before they are asked.
//! - [`sag`]: how far legs sag, by what is seen of them.
//! - [`self_mask`]: which points are the robot itself.
//! - [`ortho`]: images laid over the ground that they show.

mod cahvor;
pub mod calibration;
pub mod camera;
pub mod codec;
pub mod coverage;
pub mod epipolar;
mod error;
mod image;
pub mod matching;
pub mod ortho;
pub mod pair;
mod pinhole;
pub mod ray;
pub mod rectification;
pub mod render;
pub mod rig;
pub mod sag;
pub mod self_mask;
pub mod surface;

pub use error::StereoError;
pub use image::{GrayImage, ImageSize, MAX_PIXELS};
