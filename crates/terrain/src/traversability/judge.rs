//! From the sums over windows to the values of their cells, a row at a time.
//!
//! One loop without branches or calls, so that the compiler can do several cells at once.

use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

use super::step::NO_STEP;
use super::sums::Sums;
use super::{CAUTION, Layers, Limits, SAFE, UNKNOWN, UNSAFE};

/// The part of the layers' rows to fill.
pub(super) struct Answers<'a> {
    slope: &'a mut [f32],
    roughness: &'a mut [f32],
    step: &'a mut [f32],
    goodness: &'a mut [f32],
    certainty: &'a mut [f32],
    class: &'a mut [u8],
}

impl Answers<'_> {
    pub fn of(layers: &mut Layers, cells: Range<usize>) -> Answers<'_> {
        Answers {
            slope: &mut layers.slope_rad.values_mut()[cells.clone()],
            roughness: &mut layers.roughness_m.values_mut()[cells.clone()],
            step: &mut layers.step_m.values_mut()[cells.clone()],
            goodness: &mut layers.goodness.values_mut()[cells.clone()],
            certainty: &mut layers.certainty.values_mut()[cells.clone()],
            class: &mut layers.class.values_mut()[cells],
        }
    }
}

/// Turns the sums of windows into the values of their cells.
pub(super) struct Judge<'a> {
    limits: &'a Limits,
    resolution: f64,
    window_cells: f64,
    /// Least determinant of the x-y covariance (cells^4).
    det_min: f64,
    known_min: f64,
    quadrant_min: f64,
}

impl Judge<'_> {
    pub fn new(w: usize, resolution: f64, limits: &Limits) -> Judge<'_> {
        let (window_cells, half) = ((w * w) as f64, (w / 2) as f64);
        Judge {
            limits,
            resolution,
            window_cells,
            det_min: 1e-3 * (window_cells / 12.0).powi(2),
            known_min: limits.known_share_min * window_cells - 1e-9,
            quadrant_min: limits.quadrant_known_min * half * half - 1e-9,
        }
    }

    /// Fills a row from the sums over its windows from window `first` on, their largest 3 x 3 ranges
    /// (m), the known cells of their least known quadrants and, unless it is their known share,
    /// their certainty.
    pub fn row(
        &self,
        sums: &Sums,
        first: usize,
        ranges: &[f32],
        least: &[f64],
        trusted: Option<&[f32]>,
        out: &mut Answers,
    ) {
        let len = sums.len - first;
        let [n, y, yy, z, yz, zz, x, xx, xy, xz] =
            sums.rows.each_ref().map(|row| &row[first..][..len]);
        let (ranges, least) = (&ranges[..len], &least[..len]);
        let (slope, roughness) = (&mut out.slope[..len], &mut out.roughness[..len]);
        let (step, goodness) = (&mut out.step[..len], &mut out.goodness[..len]);
        let certainty = &mut out.certainty[..len];
        let limits = self.limits;
        let slope_ramp = Ramp::new(limits.slope_lo_rad, limits.slope_hi_rad);
        let roughness_ramp = Ramp::new(limits.roughness_lo_m, limits.roughness_hi_m);
        let step_ramp = Ramp::new(limits.step_lo_m, limits.step_hi_m);
        let per_cell = 1.0 / self.window_cells;
        let per_area = 1.0 / (self.resolution * self.resolution);
        for i in 0..len {
            // Where n is 0 all of this is NaN, which no comparison lets through.
            let per_n = 1.0 / n[i];
            let (mx, my, mz) = (x[i] * per_n, y[i] * per_n, z[i] * per_n);
            let cxx = xx[i] * per_n - mx * mx;
            let cxy = xy[i] * per_n - mx * my;
            let cyy = yy[i] * per_n - my * my;
            let cxz = xz[i] * per_n - mx * mz;
            let cyz = yz[i] * per_n - my * mz;
            let czz = zz[i] * per_n - mz * mz;
            let det = cxx * cyy - cxy * cxy;
            let has_plane = (n[i] >= 3.0) & (det >= self.det_min);
            let per_det = 1.0 / det;
            // Per cell, not per meter.
            let a = (cyy * cxz - cxy * cyz) * per_det;
            let b = (cxx * cyz - cxy * cxz) * per_det;
            let tan2 = (a * a + b * b) * per_area;
            let vertical = czz - a * cxz - b * cyz;
            let vertical = if vertical > 0.0 { vertical } else { 0.0 };
            let slope_rad = arc_tangent(tan2.sqrt());
            let roughness_m = (vertical / (1.0 + tan2)).sqrt();
            let step_m = f64::from(ranges[i]) - 2.0 * (a.abs() + b.abs());
            let step_m = if step_m > 0.0 { step_m } else { 0.0 };
            let has_step = has_plane & (ranges[i] > NO_STEP);
            let is_known = has_step & (n[i] >= self.known_min) & (least[i] >= self.quadrant_min);
            let [g_slope, g_roughness, g_step] =
                [slope_ramp.at(slope_rad), roughness_ramp.at(roughness_m), step_ramp.at(step_m)];
            let worst = if g_slope < g_roughness { g_slope } else { g_roughness };
            let worst = if worst < g_step { worst } else { g_step };
            certainty[i] = (n[i] * per_cell) as f32;
            slope[i] = if has_plane { slope_rad as f32 } else { f32::NAN };
            roughness[i] = if has_plane { roughness_m as f32 } else { f32::NAN };
            step[i] = if has_step { step_m as f32 } else { f32::NAN };
            goodness[i] = if is_known { worst as f32 } else { f32::NAN };
        }
        if let Some(trusted) = trusted {
            certainty.copy_from_slice(trusted);
        }
        let unsafe_below = limits.unsafe_below as f32;
        let caution_below = limits.caution_below as f32;
        let certain = limits.certainty_caution_below as f32;
        for ((class, g), certainty) in out.class.iter_mut().zip(goodness).zip(certainty) {
            let good = if (*g < caution_below) | (*certainty < certain) { CAUTION } else { SAFE };
            let known = if *g < unsafe_below { UNSAFE } else { good };
            *class = if g.is_nan() { UNKNOWN } else { known };
        }
    }
}

/// A ramp from 1 at `lo` down to 0 at `hi`.
struct Ramp {
    hi: f64,
    per_width: f64,
}

impl Ramp {
    fn new(lo: f64, hi: f64) -> Ramp {
        Ramp { hi, per_width: 1.0 / (hi - lo) }
    }

    fn at(&self, v: f64) -> f64 {
        let g = (self.hi - v) * self.per_width;
        let g = if g > 0.0 { g } else { 0.0 };
        if g < 1.0 { g } else { 1.0 }
    }
}

/// Arc tangent of `t` >= 0 within 3e-8 (Abramowitz & Stegun 4.4.49), unlike the library's without
/// a call, and far finer than slopes are stored.
fn arc_tangent(t: f64) -> f64 {
    let is_steep = t > 1.0;
    let u = if is_steep { 1.0 / t } else { t };
    let u2 = u * u;
    let mut sum = 0.002_866_225_7;
    for term in [
        -0.016_165_736_7,
        0.042_909_613_8,
        -0.075_289_640_0,
        0.106_562_639_3,
        -0.142_088_994_4,
        0.199_935_508_5,
        -0.333_331_452_8,
        1.0,
    ] {
        sum = sum * u2 + term;
    }
    let angle = sum * u;
    if is_steep { FRAC_PI_2 - angle } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_tangent_is_the_librarys() {
        for i in 0..100_000 {
            let t = f64::from(i) * 1e-4;
            for t in [t, t * t * t] {
                let off = arc_tangent(t) - t.atan();
                assert!(off.abs() < 3e-8, "off by {off} at {t}");
            }
        }
    }
}
