//! Errors that all points of a pair have in common: no number of points lessens them.

use nalgebra::{Point3, Vector3};

use super::SurfacePoint;
use crate::rectification::RectifiedGeometry;
use crate::render::CalibrationErrors;

/// Errors of all points of a pair at once, as standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CommonErrors {
    /// Of all disparities (px).
    pub disparity_px: f64,
    /// Place of the pair, along each axis (m).
    pub place: f64,
    /// Rotation of the pair, about each axis (rad).
    pub turn_rad: f64,
}

impl CommonErrors {
    /// What errors of a calibration do to a pair: principal points and the turn of one camera against
    /// the other shift all disparities. Pixels are those of the rectified images.
    pub fn of(errors: &CalibrationErrors, geometry: &RectifiedGeometry) -> CommonErrors {
        let shift = geometry.focal * errors.relative_rad;
        // Both principal points.
        let variance = shift * shift + 2.0 * errors.intrinsics_px * errors.intrinsics_px;
        CommonErrors {
            disparity_px: variance.sqrt(),
            place: errors.pair,
            turn_rad: errors.pair_rad,
        }
    }

    /// Variance of a point's height above its ground by these (m²); `up` is (-a, -b, 1) of ground of
    /// gradient (a, b).
    pub fn height_variance(
        &self,
        geometry: &RectifiedGeometry,
        point: &SurfacePoint,
        up: &Vector3<f64>,
    ) -> f64 {
        let eye = Point3::from(geometry.frame_from_rectified.translation.vector);
        let way = point.position - eye;
        // One more pixel of disparity d draws a point nearer by the d-th part of its way.
        let by_disparity = up.dot(&way) / f64::from(point.disparity) * self.disparity_px;
        // up . (w x way) = w . (way x up) for a turn w.
        let by_turn = self.turn_rad * way.cross(up).norm();
        let by_place = self.place * up.norm();
        by_disparity.powi(2) + by_turn.powi(2) + by_place.powi(2)
    }
}
