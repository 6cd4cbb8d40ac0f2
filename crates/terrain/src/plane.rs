//! Least-squares planes `z = a x + b y + d` from the moments of known points.

use nalgebra::{Unit, Vector3};

/// Sums over known points; x, y relative to some near origin, z relative to some near height (m).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    pub n: f64,
    x: f64,
    y: f64,
    z: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    xz: f64,
    yz: f64,
    zz: f64,
}

/// A fitted plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlaneFit {
    /// dz/dx.
    pub a: f64,
    /// dz/dy.
    pub b: f64,
    /// Height over the moments' origin, relative to their reference height (m).
    pub d: f64,
    /// Orthogonal RMS residual (m), over n points (not n - 3).
    pub roughness: f64,
}

impl Moments {
    pub fn add(&mut self, x: f64, y: f64, z: f64) {
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.z += z;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
        self.xz += x * z;
        self.yz += y * z;
        self.zz += z * z;
    }

    /// The plane, or `None` if the points lie so nearly on a line that it is arbitrary: where the
    /// determinant of their x-y covariance is under 1e-3 (width² / 12)², `width` (m) that of the
    /// window they fill.
    pub fn fit(&self, width: f64) -> Option<PlaneFit> {
        let n = self.n;
        if n < 3.0 {
            return None;
        }
        let (mx, my, mz) = (self.x / n, self.y / n, self.z / n);
        let (cxx, cxy, cyy) = (self.xx / n - mx * mx, self.xy / n - mx * my, self.yy / n - my * my);
        let (cxz, cyz, czz) = (self.xz / n - mx * mz, self.yz / n - my * mz, self.zz / n - mz * mz);
        let det = cxx * cyy - cxy * cxy;
        if det < 1e-3 * (width * width / 12.0).powi(2) {
            return None;
        }
        let a = (cyy * cxz - cxy * cyz) / det;
        let b = (cxx * cyz - cxy * cxz) / det;
        let vertical = (czz - a * cxz - b * cyz).max(0.0);
        let roughness = (vertical / (1.0 + a * a + b * b)).sqrt();
        Some(PlaneFit { a, b, d: mz - a * mx - b * my, roughness })
    }
}

/// The upward unit normal of a surface of gradient (a, b).
pub(crate) fn normal_of([a, b]: [f64; 2]) -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::new(-a, -b, 1.0))
}
