//! The pinhole camera with Brown's distortion, as OpenCV defines it.

use nalgebra::{Isometry3, Matrix2, Point2, Point3, Unit, Vector2, Vector3};

use crate::StereoError;
use crate::camera::check_place;
use crate::image::ImageSize;

/// Coefficients of Brown's distortion in the order of OpenCV.
///
/// A point (x, y) of the plane z = 1 appears at
/// x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and likewise for y with p1 and p2
/// exchanged (D. C. Brown, "Close-range camera calibration", 1971; OpenCV, `calib3d`).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Brown {
    /// Radial, r².
    pub k1: f64,
    /// Radial, r⁴.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, r⁶.
    pub k3: f64,
}

/// Points farther aside than this from the axis (as a tangent) are never seen: 84 degrees.
const TANGENT_MAX: f64 = 10.0;

impl Brown {
    fn radial(&self, r2: f64) -> f64 {
        1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
    }

    /// How fast the distorted radius grows with the true one, without the tangential terms.
    fn growth(&self, r2: f64) -> f64 {
        1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3))
    }

    /// Square of the radius up to which the model is one to one: beyond it the image would fold over.
    fn limit(&self) -> f64 {
        const STEPS: usize = 1000;
        let at = |i: usize| (TANGENT_MAX * i as f64 / STEPS as f64).powi(2);
        let Some(folded) = (0..=STEPS).find(|i| self.growth(at(*i)) <= 0.0) else {
            return at(STEPS);
        };
        let (mut free, mut folded) = (at(folded.max(1) - 1), at(folded));
        for _ in 0..60 {
            let middle = 0.5 * (free + folded);
            if self.growth(middle) > 0.0 { free = middle } else { folded = middle }
        }
        free
    }

    /// Where the point (x, y) of the plane z = 1 appears on it.
    fn distorted(&self, p: &Vector2<f64>) -> Vector2<f64> {
        let r2 = p.norm_squared();
        let (xy, radial) = (2.0 * p.x * p.y, self.radial(r2));
        Vector2::new(
            p.x * radial + self.p1 * xy + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p2 * xy + self.p1 * (r2 + 2.0 * p.y * p.y),
        )
    }

    fn jacobian(&self, p: &Vector2<f64>) -> Matrix2<f64> {
        let r2 = p.norm_squared();
        let radial = self.radial(r2);
        // d radial / d r2, times two.
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let cross = slope * p.x * p.y + 2.0 * (self.p1 * p.x + self.p2 * p.y);
        Matrix2::new(
            radial + slope * p.x * p.x + 2.0 * self.p1 * p.y + 6.0 * self.p2 * p.x,
            cross,
            cross,
            radial + slope * p.y * p.y + 2.0 * self.p2 * p.x + 6.0 * self.p1 * p.y,
        )
    }

    /// The point that appears at `seen`, by Newton's method; none beyond the fold at `limit`.
    fn undistorted(&self, seen: &Vector2<f64>, limit: f64) -> Option<Vector2<f64>> {
        const ITERATIONS: usize = 40;
        if *self == Brown::default() {
            return (seen.norm_squared() <= limit).then_some(*seen);
        }
        let bound = limit.sqrt();
        let mut p = *seen;
        if p.norm() > bound {
            p *= 0.9 * bound / p.norm();
        }
        for _ in 0..ITERATIONS {
            let miss = self.distorted(&p) - seen;
            if miss.norm() <= 1e-12 * (1.0 + seen.norm()) {
                return (p.norm_squared() <= limit).then_some(p);
            }
            let mut step = self.jacobian(&p).try_inverse()? * miss;
            // A step never leaves the region where the model is one to one by much.
            let longest = 0.5 * (0.1 + p.norm());
            if step.norm() > longest {
                step *= longest / step.norm();
            }
            p -= step;
        }
        let miss = (self.distorted(&p) - seen).norm();
        (miss < 1e-10 && p.norm_squared() <= limit).then_some(p)
    }
}

/// A pinhole camera with Brown's distortion.
#[derive(Debug, Clone, PartialEq)]
pub struct Pinhole {
    size: ImageSize,
    focal: [f64; 2],
    principal: [f64; 2],
    distortion: Brown,
    frame_from_camera: Isometry3<f64>,
    limit: f64,
}

impl Pinhole {
    /// A camera of focal lengths and principal point (px) at a pose in its frame.
    pub fn new(
        size: ImageSize,
        focal: [f64; 2],
        principal: [f64; 2],
        distortion: Brown,
        frame_from_camera: Isometry3<f64>,
    ) -> Result<Pinhole, StereoError> {
        let size = ImageSize::new(size.width, size.height)?;
        for (field, value) in [("fx", focal[0]), ("fy", focal[1])] {
            StereoError::check(field, value, [1.0, 1e6], "a focal length of 1 to 1e6 px")?;
        }
        let Brown { k1, k2, p1, p2, k3 } = distortion;
        for (field, value) in [("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)] {
            StereoError::check(field, value, [-1e3, 1e3], "a coefficient of -1000 to 1000")?;
        }
        for value in frame_from_camera.translation.vector.iter() {
            StereoError::check("camera center", *value, [-1e7, 1e7], "meters, below 1e7")?;
        }
        let [cx, cy] = principal;
        let inside = |c: f64, n: usize| c >= -0.5 && c <= n as f64 - 0.5;
        if !(inside(cx, size.width) && inside(cy, size.height)) {
            return Err(StereoError::PrincipalPoint { cx, cy, size });
        }
        let limit = distortion.limit();
        let camera = Pinhole { size, focal, principal, distortion, frame_from_camera, limit };
        let center = frame_from_camera.translation.vector.into();
        check_place(&center, size, |p| camera.direction(p), |d| camera.seen(d))?;
        Ok(camera)
    }

    /// Width and height of its images.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Focal lengths (px).
    pub fn focal(&self) -> [f64; 2] {
        self.focal
    }

    /// Principal point (px).
    pub fn principal(&self) -> [f64; 2] {
        self.principal
    }

    /// Distortion.
    pub fn distortion(&self) -> &Brown {
        &self.distortion
    }

    /// Pose in the frame.
    pub fn frame_from_camera(&self) -> &Isometry3<f64> {
        &self.frame_from_camera
    }

    pub(crate) fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.seen(&(point.coords - self.frame_from_camera.translation.vector))
    }

    /// The pixel at which what is at `d` from the center, in the frame, appears.
    fn seen(&self, d: &Vector3<f64>) -> Option<Point2<f64>> {
        let p = self.frame_from_camera.rotation.inverse_transform_vector(d);
        if p.z.is_nan() || p.z <= 0.0 {
            return None;
        }
        let ideal = Vector2::new(p.x / p.z, p.y / p.z);
        let seen = self.distortion.distorted(&ideal);
        let at = |i: usize| self.focal[i] * seen[i] + self.principal[i];
        (ideal.norm_squared() <= self.limit).then(|| Point2::new(at(0), at(1)))
    }

    pub(crate) fn direction(&self, pixel: &Point2<f64>) -> Option<Unit<Vector3<f64>>> {
        let at = |i: usize| (pixel[i] - self.principal[i]) / self.focal[i];
        let seen = Vector2::new(at(0), at(1));
        if !seen.iter().all(|v| v.is_finite()) {
            return None;
        }
        let ideal = self.distortion.undistorted(&seen, self.limit)?;
        let direction = self.frame_from_camera.rotation * Vector3::new(ideal.x, ideal.y, 1.0);
        Some(Unit::new_normalize(direction))
    }

    pub(crate) fn moved(&self, motion: &Isometry3<f64>) -> Pinhole {
        Pinhole { frame_from_camera: motion * self.frame_from_camera, ..self.clone() }
    }

    pub(crate) fn resized(&self, size: ImageSize) -> Pinhole {
        let [sx, sy] = factors(self.size, size);
        let [fx, fy] = self.focal;
        let [cx, cy] = self.principal;
        let principal = [(cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5];
        Pinhole { size, focal: [fx * sx, fy * sy], principal, ..self.clone() }
    }
}

/// How much wider and higher another size is.
pub(crate) fn factors(from: ImageSize, to: ImageSize) -> [f64; 2] {
    [to.width as f64 / from.width as f64, to.height as f64 / from.height as f64]
}
