//! Cameras that are not quite where, or what, their calibration says.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::sensor::normal;
use crate::StereoError;
use crate::camera::{Camera, Pinhole};

/// Errors of a pair's calibration, as standard deviations along each axis. Zero switches one off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationErrors {
    /// Focal length and principal point of pinhole cameras (px), 0 to 10.
    pub intrinsics_px: f64,
    /// Rotation of the right camera against the left one (rad), 0 to 0.1.
    pub relative_rad: f64,
    /// Place of the pair on its link (m), 0 to 1.
    pub pair: f64,
    /// Rotation of the pair on its link (rad), 0 to 0.1.
    pub pair_rad: f64,
}

impl Default for CalibrationErrors {
    fn default() -> CalibrationErrors {
        let [relative_rad, pair_rad] = [0.03_f64, 0.2].map(f64::to_radians);
        CalibrationErrors { intrinsics_px: 0.2, relative_rad, pair: 0.003, pair_rad }
    }
}

impl CalibrationErrors {
    /// What a pair of such a calibration really is: render with these, reconstruct with the others.
    pub fn actual(
        &self,
        [left, right]: [&Camera; 2],
        seed: u64,
    ) -> Result<[Camera; 2], StereoError> {
        StereoError::check("intrinsics_px", self.intrinsics_px, [0.0, 10.0], "0 to 10 px")?;
        StereoError::check("relative_rad", self.relative_rad, [0.0, 0.1], "0 to 0.1 rad")?;
        StereoError::check("pair", self.pair, [0.0, 1.0], "0 to 1 m")?;
        StereoError::check("pair_rad", self.pair_rad, [0.0, 0.1], "0 to 0.1 rad")?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| sigma * normal(&mut rng));
        let (relative, shift) = (vector(self.relative_rad), vector(self.pair));
        let turn = UnitQuaternion::from_scaled_axis(vector(self.pair_rad));
        let lenses = [vector(self.intrinsics_px), vector(self.intrinsics_px)];
        let center = nalgebra::center(&left.center(), &right.center()).coords;
        let motion = Translation3::from(center + shift)
            * Isometry3::from_parts(Translation3::identity(), turn)
            * Translation3::from(-center);
        let right = right.turned(&UnitQuaternion::from_scaled_axis(relative));
        let [a, b] = lenses;
        Ok([misfit(left, &a)?.moved(&motion), misfit(&right, &b)?.moved(&motion)])
    }
}

/// A pinhole of another focal length and principal point; other models as they are.
fn misfit(camera: &Camera, by: &Vector3<f64>) -> Result<Camera, StereoError> {
    let Camera::Pinhole(pinhole) = camera else { return Ok(camera.clone()) };
    let [fx, fy] = pinhole.focal();
    let [cx, cy] = pinhole.principal();
    Pinhole::new(
        pinhole.size(),
        [fx + by.x, fy + by.x * fy / fx],
        [cx + by.y, cy + by.z],
        *pinhole.distortion(),
        *pinhole.frame_from_camera(),
    )
    .map(Camera::Pinhole)
}
