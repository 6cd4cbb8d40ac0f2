//! Rectification: two calibrated cameras to images whose rows are epipolar lines.
//!
//! Both images are redrawn as an ideal camera of one focal length and one principal point would have
//! seen them, turned about the centers of the two cameras until its rows are along the baseline (Fusiello,
//! Trucco and Verri 2000, "A compact algorithm for rectification of stereo pairs"). A point at depth z
//! then has the disparity focal · baseline / z, and none is negative.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::StereoError;
use crate::camera::Camera;
use crate::image::{GrayImage, ImageSize};

/// What the rectified images are to be like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectifyOptions {
    /// Width and height; those of the left image where none are given.
    pub size: Option<ImageSize>,
    /// Factor on the focal length, 0.1 to 10: below 1 shows more of a wide lens, at less detail.
    pub zoom: f64,
}

impl Default for RectifyOptions {
    fn default() -> RectifyOptions {
        RectifyOptions { size: None, zoom: 1.0 }
    }
}

/// The geometry of a rectified pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectifiedGeometry {
    /// Width and height of both images.
    pub size: ImageSize,
    /// Focal length (px).
    pub focal: f64,
    /// Principal point of both images (px).
    pub principal: Point2<f64>,
    /// Distance of the cameras (m).
    pub baseline: f64,
    /// Pose of the rectified left camera in the frame of the rig: x along the baseline.
    pub frame_from_rectified: Isometry3<f64>,
}

impl RectifiedGeometry {
    /// Depth (m) of a disparity (px); infinite at zero.
    pub fn depth(&self, disparity: f64) -> f64 {
        self.focal * self.baseline / disparity
    }

    /// Pixel in the left image and disparity of a point of the rig's frame; none behind the cameras.
    pub fn project(&self, point: &Point3<f64>) -> Option<(Point2<f64>, f64)> {
        let p = self.frame_from_rectified.inverse_transform_point(point);
        (p.z > 0.0).then(|| {
            let pixel = self.principal + p.coords.xy() * (self.focal / p.z);
            (pixel, self.focal * self.baseline / p.z)
        })
    }

    /// The rectified left or right camera.
    pub fn camera(&self, side: Side) -> Result<Camera, StereoError> {
        let shift = match side {
            Side::Left => 0.0,
            Side::Right => self.baseline,
        };
        let pose = self.frame_from_rectified * Isometry3::translation(shift, 0.0, 0.0);
        let lens = crate::camera::Brown::default();
        let principal = [self.principal.x, self.principal.y];
        crate::camera::Pinhole::new(self.size, [self.focal; 2], principal, lens, pose)
            .map(Camera::Pinhole)
    }
}

/// One camera of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left camera: disparities and points are of its pixels.
    Left,
    /// The right camera.
    Right,
}

/// Parts of a pixel that a map resolves.
const FRACTIONS: i32 = 32;

/// Where a rectified pixel comes from: four pixels from (x, y) on and their weights. 6 bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tap {
    x: u16,
    y: u16,
    fx: u8,
    fy: u8,
}

const OUTSIDE: Tap = Tap { x: u16::MAX, y: 0, fx: 0, fy: 0 };

/// Both images after rectification, and which of their pixels are real.
#[derive(Debug, Clone, PartialEq)]
pub struct RectifiedPair {
    /// The left image; 0 outside of what the camera saw.
    pub left: GrayImage,
    /// The right image.
    pub right: GrayImage,
    /// Pixels that the left camera saw.
    pub left_seen: Vec<bool>,
    /// Pixels that the right camera saw.
    pub right_seen: Vec<bool>,
}

/// Maps from two cameras to their rectified images: made once for a pair of calibrations.
#[derive(Debug, Clone)]
pub struct Rectification {
    geometry: RectifiedGeometry,
    sizes: [ImageSize; 2],
    maps: [Vec<Tap>; 2],
}

/// Cosine of the largest angle between the rows of an image and the baseline: 45 degrees.
const ALONG_MIN: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Cosine of the largest angle between the cameras: 40 degrees.
const PARALLEL_MIN: f64 = 0.766;

impl Rectification {
    /// The common rectification of two cameras given in one frame.
    pub fn new(
        left: &Camera,
        right: &Camera,
        options: &RectifyOptions,
    ) -> Result<Rectification, StereoError> {
        let geometry = geometry_of(left, right, options)?;
        let map = |camera: &Camera| map_of(&geometry, camera);
        let maps = [map(left), map(right)];
        Ok(Rectification { geometry, sizes: [left.size(), right.size()], maps })
    }

    /// The geometry of the rectified pair.
    pub fn geometry(&self) -> &RectifiedGeometry {
        &self.geometry
    }

    /// Redraws both images.
    pub fn apply(&self, left: &GrayImage, right: &GrayImage) -> Result<RectifiedPair, StereoError> {
        let [(left, left_seen), (right, right_seen)] =
            [self.redraw(Side::Left, left)?, self.redraw(Side::Right, right)?];
        Ok(RectifiedPair { left, right, left_seen, right_seen })
    }

    fn redraw(&self, side: Side, image: &GrayImage) -> Result<(GrayImage, Vec<bool>), StereoError> {
        let (i, what) = match side {
            Side::Left => (0, "left image"),
            Side::Right => (1, "right image"),
        };
        let (image_size, calibration) = (image.size(), self.sizes[i]);
        if image_size != calibration {
            return Err(StereoError::SizeMismatch { what, image: image_size, calibration });
        }
        let map = &self.maps[i];
        let pixels = map.iter().map(|tap| {
            if *tap == OUTSIDE {
                return 0;
            }
            let (x, y) = (usize::from(tap.x), usize::from(tap.y));
            let (upper, lower) = (&image.row(y)[x..x + 2], &image.row(y + 1)[x..x + 2]);
            let (fx, fy) = (u32::from(tap.fx), u32::from(tap.fy));
            let along = |row: &[u8]| u32::from(row[0]) * (32 - fx) + u32::from(row[1]) * fx;
            ((along(upper) * (32 - fy) + along(lower) * fy + 512) >> 10) as u8
        });
        let redrawn = GrayImage::new(self.geometry.size, pixels.collect())?;
        Ok((redrawn, map.iter().map(|tap| *tap != OUTSIDE).collect()))
    }
}

fn geometry_of(
    left: &Camera,
    right: &Camera,
    options: &RectifyOptions,
) -> Result<RectifiedGeometry, StereoError> {
    StereoError::check("zoom", options.zoom, [0.1, 10.0], "a factor of 0.1 to 10")?;
    let across = right.center() - left.center();
    let baseline = across.norm();
    if !(baseline.is_finite() && baseline > 1e-6) {
        return Err(StereoError::NoBaseline { baseline_m: baseline });
    }
    let x = across / baseline;
    let axis = |v: Vector3<f64>| (left.axes() * v + right.axes() * v) * 0.5;
    let forward = (left.axes() * Vector3::z()).dot(&(right.axes() * Vector3::z()));
    if forward < PARALLEL_MIN {
        let what = "the cameras look apart by more than 40 degrees";
        return Err(StereoError::NotAPair { what });
    }
    let along = axis(Vector3::x()).normalize().dot(&x);
    if along < -ALONG_MIN {
        return Err(StereoError::Swapped);
    }
    if along < ALONG_MIN {
        let what = "the cameras stand above or behind each other, not side by side; turn the images \
                    and their calibration if they stand above each other";
        return Err(StereoError::NotAPair { what });
    }
    let look = axis(Vector3::z());
    let z = (look - x * look.dot(&x)).normalize();
    let matrix = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let rotation = Rotation3::from_matrix_unchecked(matrix);
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    let size = options.size.unwrap_or(left.size());
    let size = ImageSize::new(size.width, size.height)?;
    let ratio = size.width as f64 / left.size().width as f64;
    let focals = [left.focal(), right.focal()].concat();
    let focal = options.zoom * ratio * focals.iter().sum::<f64>() / focals.len() as f64;
    // What both cameras see in the middle of their images comes to the middle.
    let middle = |camera: &Camera| {
        let ImageSize { width, height } = camera.size();
        let center = Point2::new(0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0));
        camera.ray(&center).map(|ray| {
            let ray = rotation.inverse() * ray.direction.into_inner();
            ray.xy() / ray.z
        })
    };
    let (Some(a), Some(b)) = (middle(left), middle(right)) else {
        let what = "the lens model of a camera does not hold in the middle of its image";
        return Err(StereoError::NotAPair { what });
    };
    let center = Point2::new(0.5 * (size.width as f64 - 1.0), 0.5 * (size.height as f64 - 1.0));
    let principal = center - (a + b) * (0.5 * focal);
    let frame_from_rectified = Isometry3::from_parts(left.center().into(), rotation);
    Ok(RectifiedGeometry { size, focal, principal, baseline, frame_from_rectified })
}

fn map_of(geometry: &RectifiedGeometry, camera: &Camera) -> Vec<Tap> {
    let RectifiedGeometry { size, focal, principal, .. } = *geometry;
    let rotation = geometry.frame_from_rectified.rotation;
    let center = camera.center();
    let last = camera.size();
    let tap = |i: usize| {
        let (u, v) = ((i % size.width) as f64, (i / size.width) as f64);
        let ray = Vector3::new((u - principal.x) / focal, (v - principal.y) / focal, 1.0);
        let Some(at) = camera.project(&(center + rotation * ray)) else { return OUTSIDE };
        let axis = |value: f64, n: usize| {
            // Parts of a pixel; the last pixel is all weight on the second of the two.
            let parts = (value * f64::from(FRACTIONS)).round();
            let most = FRACTIONS * (n as i32 - 1);
            (parts >= 0.0 && parts <= f64::from(most)).then(|| {
                let first = (parts as i32 / FRACTIONS).min(n as i32 - 2);
                (first as u16, (parts as i32 - FRACTIONS * first) as u8)
            })
        };
        match (axis(at.x, last.width), axis(at.y, last.height)) {
            (Some((x, fx)), Some((y, fy))) => Tap { x, y, fx, fy },
            _ => OUTSIDE,
        }
    };
    (0..size.len()).map(tap).collect()
}
