//! The CAHV and CAHVOR models of planetary cameras.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::StereoError;
use crate::camera::{check_place, unit};
use crate::image::ImageSize;
use crate::pinhole::factors;

/// Squared tangent up to which a point may be aside from O: 84 degrees.
const TAU_MAX: f64 = 100.0;
/// Least growth at which a pixel has a ray.
const GROWTH_MIN: f64 = 1e-9;

/// A camera by the vectors C, A, H, V and, for the lens, O and R.
///
/// A point P at d = P - C appears at x = d'·H / d'·A, y = d'·V / d'·A (Yakimovsky and Cunningham
/// 1978), where d' is d moved away from the optical axis O by the lens:
/// d' = d + (r0 + r1 τ + r2 τ²) λ, with λ = d - (d·O) O and τ = λ·λ / (d·O)² (Gennery 2006, "Generalized
/// camera calibration including fish-eye lenses", section 2). O = A and R = 0 is plain CAHV.
#[derive(Debug, Clone, PartialEq)]
pub struct Cahvor {
    size: ImageSize,
    c: Vector3<f64>,
    a: Vector3<f64>,
    h: Vector3<f64>,
    v: Vector3<f64>,
    o: Vector3<f64>,
    r: [f64; 3],
}

impl Cahvor {
    /// A camera with a lens: A and O of unit length, H and V in px.
    pub fn new(
        size: ImageSize,
        [c, a, h, v]: [Vector3<f64>; 4],
        o: Vector3<f64>,
        r: [f64; 3],
    ) -> Result<Cahvor, StereoError> {
        let size = ImageSize::new(size.width, size.height)?;
        for (field, vector) in [("C", c), ("A", a), ("H", h), ("V", v), ("O", o), ("R", r.into())] {
            for value in vector.iter() {
                StereoError::check(field, *value, [-1e7, 1e7], "finite numbers below 1e7")?;
            }
        }
        // The lens stretches the middle of the image by 1 + R[0].
        StereoError::check("R[0]", r[0], [-0.9, 10.0], "-0.9 to 10")?;
        let (a, o) = (unit("A", &a)?, unit("O", &o)?);
        let camera = Cahvor { size, c, a, h, v, o, r };
        let [fx, fy] = camera.focal();
        for (field, value) in [("H x A", fx), ("V x A", fy)] {
            StereoError::check(field, value, [1.0, 1e6], "a focal length of 1 to 1e6 px")?;
        }
        let [cx, cy] = [h.dot(&a), v.dot(&a)];
        let inside = |c: f64, n: usize| c >= -0.5 && c <= n as f64 - 0.5;
        if !(inside(cx, size.width) && inside(cy, size.height)) {
            return Err(StereoError::PrincipalPoint { cx, cy, size });
        }
        // Sine of the angle between the axes of the image.
        if a.dot(&h.cross(&v)).abs() < 0.1 * fx * fy {
            return Err(StereoError::FlatModel);
        }
        check_place(&camera.center(), size, |p| camera.direction(p), |d| camera.seen(d))?;
        Ok(camera)
    }

    /// A camera without a lens.
    pub fn cahv(size: ImageSize, cahv: [Vector3<f64>; 4]) -> Result<Cahvor, StereoError> {
        Cahvor::new(size, cahv, cahv[1], [0.0; 3])
    }

    /// Width and height of its images.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// C (m).
    pub fn center(&self) -> Point3<f64> {
        self.c.into()
    }

    /// Focal lengths along x and y (px): |A × H| and |A × V|.
    pub fn focal(&self) -> [f64; 2] {
        [self.a.cross(&self.h).norm(), self.a.cross(&self.v).norm()]
    }

    /// The axes of the image: z along A, x along the part of H across it.
    pub fn axes(&self) -> UnitQuaternion<f64> {
        let x = (self.h - self.a * self.h.dot(&self.a)).normalize();
        let y = self.a.cross(&x);
        let matrix = Matrix3::from_columns(&[x, y, self.a]);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
    }

    fn stretch(&self, tau: f64) -> f64 {
        self.r[0] + tau * (self.r[1] + tau * self.r[2])
    }

    /// How fast the seen distance from the axis grows with the true one, at tan² = `tau`.
    fn growth(&self, tau: f64) -> f64 {
        1.0 + self.r[0] + tau * (3.0 * self.r[1] + tau * 5.0 * self.r[2])
    }

    pub(crate) fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.seen(&(point.coords - self.c))
    }

    /// The pixel at which what is at `d` from the center appears.
    fn seen(&self, d: &Vector3<f64>) -> Option<Point2<f64>> {
        let along = d.dot(&self.o);
        if along.is_nan() || along <= 0.0 {
            return None;
        }
        let aside = d - self.o * along;
        let tau = aside.norm_squared() / (along * along);
        // What a pixel at the very edge of the model sees is seen there, whatever the rounding.
        if !self.holds(tau, TAU_MAX * (1.0 + 1e-6), 0.0) {
            return None;
        }
        let seen = d + aside * self.stretch(tau);
        let alpha = seen.dot(&self.a);
        (alpha > 0.0).then(|| Point2::new(seen.dot(&self.h) / alpha, seen.dot(&self.v) / alpha))
    }

    /// True up to the angle at which the lens model folds the image over: where the growth is above `least` from the
    /// axis to there, and no farther than `tau_max`.
    fn holds(&self, tau: f64, tau_max: f64, least: f64) -> bool {
        // The growth is a parabola in tau: least at an end, or at its vertex.
        let vertex = -0.3 * self.r[1] / self.r[2];
        let places = [Some(0.0), Some(tau), Some(vertex).filter(|v| *v > 0.0 && *v < tau)];
        tau <= tau_max && places.into_iter().flatten().all(|tau| self.growth(tau) > least)
    }

    pub(crate) fn direction(&self, pixel: &Point2<f64>) -> Option<Unit<Vector3<f64>>> {
        if !(pixel.x.is_finite() && pixel.y.is_finite()) {
            return None;
        }
        let across = (self.v - self.a * pixel.y).cross(&(self.h - self.a * pixel.x));
        // The sign that looks forward.
        let seen = across.try_normalize(0.0)? * across.dot(&self.a).signum();
        let along = seen.dot(&self.o);
        if along.is_nan() || along <= 0.0 {
            return None;
        }
        let aside = seen - self.o * along;
        let tangent = aside.norm() / along;
        if tangent == 0.0 {
            return Some(Unit::new_unchecked(seen));
        }
        // The true tangent t has t (1 + r0 + r1 t² + r2 t⁴) = the seen one; Newton.
        let mut t = tangent;
        for _ in 0..40 {
            let miss = t * (1.0 + self.stretch(t * t)) - tangent;
            if miss.abs() < 1e-14 * (1.0 + tangent) {
                break;
            }
            let growth = self.growth(t * t);
            if growth.abs() < GROWTH_MIN {
                return None;
            }
            t -= miss / growth;
        }
        let miss = t * (1.0 + self.stretch(t * t)) - tangent;
        let is_solved = miss.abs() < 1e-12 * (1.0 + tangent) && t > 0.0;
        if !(is_solved && self.holds(t * t, TAU_MAX, GROWTH_MIN)) {
            return None;
        }
        Some(Unit::new_normalize(self.o * along + aside * (t / tangent)))
    }

    pub(crate) fn moved(&self, motion: &Isometry3<f64>) -> Cahvor {
        let turn = |v: &Vector3<f64>| motion.rotation * v;
        Cahvor {
            c: (motion * Point3::from(self.c)).coords,
            a: turn(&self.a),
            h: turn(&self.h),
            v: turn(&self.v),
            o: turn(&self.o),
            ..self.clone()
        }
    }

    pub(crate) fn resized(&self, size: ImageSize) -> Cahvor {
        let [sx, sy] = factors(self.size, size);
        let scaled = |v: &Vector3<f64>, s: f64| v * s + self.a * (0.5 * s - 0.5);
        Cahvor { size, h: scaled(&self.h, sx), v: scaled(&self.v, sy), ..self.clone() }
    }
}
