//! Camera models: where a point appears in an image, and which ray a pixel sees.
//!
//! Pixels count from the middle of the first one: (0, 0) is the middle of the upper left pixel, x to
//! the right, y down, as in OpenCV, CAHV models and the Ames Stereo Pipeline. A camera's own axes are
//! x right, y down, z forward. Its pose is in the frame of its rig, whichever that is; lengths are
//! meters.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Unit, UnitQuaternion, Vector3};

use crate::StereoError;
pub use crate::cahvor::Cahvor;
use crate::image::{GrayImage, ImageSize};
pub use crate::pinhole::{Brown, Pinhole};

/// What a pixel sees: a ray from a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// The center of the camera (m).
    pub origin: Point3<f64>,
    /// Where it looks.
    pub direction: Unit<Vector3<f64>>,
}

/// A calibrated camera in the frame of its rig.
#[derive(Debug, Clone, PartialEq)]
pub enum Camera {
    /// Pinhole with the distortion of Brown.
    Pinhole(Pinhole),
    /// The model of Yakimovsky and Cunningham (CAHV) with the radial lens terms of Gennery.
    Cahvor(Cahvor),
}

impl Camera {
    /// Width and height of its images.
    pub fn size(&self) -> ImageSize {
        match self {
            Camera::Pinhole(camera) => camera.size(),
            Camera::Cahvor(camera) => camera.size(),
        }
    }

    /// Where the camera is (m).
    pub fn center(&self) -> Point3<f64> {
        match self {
            Camera::Pinhole(camera) => camera.frame_from_camera().translation.vector.into(),
            Camera::Cahvor(camera) => camera.center(),
        }
    }

    /// The pixel at which a point appears (px, may lie outside the image); none for what is beside
    /// or behind the camera, or so far aside that the lens model does not hold.
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        match self {
            Camera::Pinhole(camera) => camera.project(point),
            Camera::Cahvor(camera) => camera.project(point),
        }
    }

    /// How far a point is along the axis (m), if it appears within the image; what may stand in the
    /// way is not asked.
    pub fn depth_in_view(&self, point: &Point3<f64>) -> Option<f64> {
        let (pixel, size) = (self.project(point)?, self.size());
        let inside = |value: f64, n: usize| value >= 0.0 && value <= (n - 1) as f64;
        let is_inside = inside(pixel.x, size.width) && inside(pixel.y, size.height);
        is_inside.then(|| (point - self.center()).dot(&(self.axes() * Vector3::z())))
    }

    /// The ray that a pixel sees; none where the lens model does not hold.
    pub fn ray(&self, pixel: &Point2<f64>) -> Option<Ray> {
        let direction = match self {
            Camera::Pinhole(camera) => camera.direction(pixel),
            Camera::Cahvor(camera) => camera.direction(pixel),
        }?;
        Some(Ray { origin: self.center(), direction })
    }

    /// The axes of the camera in the frame: x along the rows of its image, z forward.
    pub fn axes(&self) -> UnitQuaternion<f64> {
        match self {
            Camera::Pinhole(camera) => camera.frame_from_camera().rotation,
            Camera::Cahvor(camera) => camera.axes(),
        }
    }

    /// Focal lengths in the middle of the image, along x and y (px).
    pub fn focal(&self) -> [f64; 2] {
        match self {
            Camera::Pinhole(camera) => camera.focal(),
            Camera::Cahvor(camera) => camera.focal(),
        }
    }

    /// The same camera seen from another frame, or after its frame was moved.
    pub fn moved(&self, motion: &Isometry3<f64>) -> Camera {
        match self {
            Camera::Pinhole(camera) => Camera::Pinhole(camera.moved(motion)),
            Camera::Cahvor(camera) => Camera::Cahvor(camera.moved(motion)),
        }
    }

    /// The same camera turned about its own center by a rotation in the frame.
    pub fn turned(&self, rotation: &UnitQuaternion<f64>) -> Camera {
        let center = self.center();
        let there = Isometry3::translation(center.x, center.y, center.z);
        self.moved(&(there * rotation * there.inverse()))
    }

    /// The same camera on a rig `factor` times as large: its place scales, its image stays.
    pub fn scaled(&self, factor: f64) -> Camera {
        let motion = Isometry3::from(self.center().coords * (factor - 1.0));
        self.moved(&motion)
    }

    /// The camera of the same image at another size (`size` should have the same shape).
    pub fn resized(&self, size: ImageSize) -> Result<Camera, StereoError> {
        let size = ImageSize::new(size.width, size.height)?;
        Ok(match self {
            Camera::Pinhole(camera) => Camera::Pinhole(camera.resized(size)),
            Camera::Cahvor(camera) => Camera::Cahvor(camera.resized(size)),
        })
    }

    /// That an image has the size of this calibration.
    pub fn check_image(&self, what: &'static str, image: &GrayImage) -> Result<(), StereoError> {
        let (image, calibration) = (image.size(), self.size());
        if image == calibration {
            Ok(())
        } else {
            Err(StereoError::SizeMismatch { what, image, calibration })
        }
    }
}

/// How far a matrix may be off a rotation: calibration files carry about seven digits.
const ROTATION_DEVIATION_MAX: f64 = 1e-3;

/// The rotation nearest to a matrix that is one but for rounding.
pub fn rotation_from_matrix(
    field: &str,
    matrix: &Matrix3<f64>,
) -> Result<UnitQuaternion<f64>, StereoError> {
    let deviation = (matrix * matrix.transpose() - Matrix3::identity()).abs().max();
    let determinant = matrix.determinant();
    if deviation <= ROTATION_DEVIATION_MAX && determinant > 0.0 {
        Ok(UnitQuaternion::from_matrix(matrix))
    } else {
        // NaN comes here too.
        Err(StereoError::NotARotation { field: field.to_owned(), deviation, determinant })
    }
}

/// A vector of unit length but for rounding, made exactly so.
pub(crate) fn unit(field: &str, v: &Vector3<f64>) -> Result<Vector3<f64>, StereoError> {
    let length = v.norm();
    if (length - 1.0).abs() <= 1e-3 {
        Ok(v / length)
    } else {
        Err(StereoError::NotAUnitVector { field: field.to_owned(), length })
    }
}

/// Largest error of a place in the image that comes of where the camera is (px).
const PLACE_ERROR_MAX_PX: f64 = 2.5e-4;

/// That a point 1 m before a camera can be told from its neighbors: the numbers that there are for it lie as far apart as
/// its distance from the origin of the frame asks for, and the lens shows that gap as so many pixels.
pub(crate) fn check_place(
    center: &Point3<f64>,
    size: ImageSize,
    direction: impl Fn(&Point2<f64>) -> Option<Unit<Vector3<f64>>>,
    seen: impl Fn(&Vector3<f64>) -> Option<Point2<f64>>,
) -> Result<(), StereoError> {
    const STEP_M: f64 = 1e-6;
    let gap_m = f64::EPSILON * (1.0 + center.coords.amax());
    let shares = [0.0, 0.25, 0.5, 0.75, 1.0];
    let at = |share: f64, n: usize| share * (n - 1) as f64;
    for (u, v) in shares.into_iter().flat_map(|v| shares.map(|u| (u, v))) {
        let pixel = Point2::new(at(u, size.width), at(v, size.height));
        let Some(d) = direction(&pixel).map(Unit::into_inner) else { continue };
        let Some(here) = seen(&d) else { continue };
        let there =
            [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| seen(&(d + STEP_M * axis)));
        let per_m: f64 =
            there.into_iter().flatten().map(|there| (there - here).norm() / STEP_M).sum();
        let error_px = 0.5 * gap_m * per_m;
        if error_px > PLACE_ERROR_MAX_PX {
            let distance_m = center.coords.norm();
            return Err(StereoError::CameraTooFar { distance_m, error_px });
        }
    }
    Ok(())
}
