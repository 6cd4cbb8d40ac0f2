//! By how much a pair's map is off the map.
//!
//! Point to plane (Chen & Medioni 1992) in four degrees of freedom, x, y, z and yaw: the tilt of the
//! rover is known well, its place is not. Robust weights (Huber), Gauss-Newton, and a prior about
//! zero, so that what the ground does not show, such as a shift along a plane, stays zero.

use nalgebra::{Matrix4, Point2, Point3, Rotation2, Vector3, Vector4};

use super::{Flags, MapVersion, PairDem};
use crate::TerrainError;

const ITERATIONS: usize = 30;
/// Residuals beyond this many standard deviations count less.
pub(super) const HUBER: f64 = 2.0;
/// Steps below this (m, rad) end the search.
const STEP_MIN: f64 = 1e-6;

/// Bounds of an alignment, and what is expected before anything is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlignSettings {
    /// Largest shift (m).
    pub shift_max_m: f64,
    /// Largest turn (rad).
    pub yaw_max_rad: f64,
    /// Standard deviation of the shift, each axis, before anything is seen (m).
    pub shift_sigma_m: f64,
    /// Standard deviation of the turn before anything is seen (rad).
    pub yaw_sigma_rad: f64,
    /// The same of a pair against the others of its stand, where several are aligned together (m). Usual errors of
    /// calibration put two pairs about 4 cm apart where they overlap, 4 to 5 m away, but tilt more than they shift: half of
    /// that left the least errors in heights on three synthetic grounds (of 1, 2 and 4 cm).
    pub pair_shift_sigma_m: f64,
    /// The same of its turn (rad).
    pub pair_yaw_sigma_rad: f64,
    /// Fewest cells that both know.
    pub cells_min: usize,
    /// Most cells that are used, evenly spread.
    pub cells_max: usize,
    /// Neighboring cells that share one error.
    pub correlated_cells: f64,
}

impl Default for AlignSettings {
    fn default() -> AlignSettings {
        AlignSettings {
            shift_max_m: 0.15,
            yaw_max_rad: 2.0_f64.to_radians(),
            shift_sigma_m: 0.05,
            yaw_sigma_rad: 0.6_f64.to_radians(),
            pair_shift_sigma_m: 0.02,
            pair_yaw_sigma_rad: 0.2_f64.to_radians(),
            cells_min: 200,
            cells_max: 20_000,
            correlated_cells: 9.0,
        }
    }
}

impl AlignSettings {
    pub(super) fn check(&self) -> Result<(), TerrainError> {
        let check = TerrainError::check;
        check("shift_max_m", self.shift_max_m, [0.0, 10.0], "a length up to 10 m")?;
        check("yaw_max_rad", self.yaw_max_rad, [0.0, 0.5], "an angle up to 0.5 rad")?;
        check("shift_sigma_m", self.shift_sigma_m, [1e-6, 10.0], "a length up to 10 m")?;
        check("yaw_sigma_rad", self.yaw_sigma_rad, [1e-6, 1.0], "an angle up to 1 rad")?;
        check("pair_shift_sigma_m", self.pair_shift_sigma_m, [1e-6, 10.0], "a length up to 10 m")?;
        check("pair_yaw_sigma_rad", self.pair_yaw_sigma_rad, [1e-6, 1.0], "an angle up to 1 rad")?;
        check("cells_min", self.cells_min as f64, [10.0, 1e9], "10 cells or more")?;
        check("cells_max", self.cells_max as f64, [10.0, 1e9], "10 cells or more")?;
        check("correlated_cells", self.correlated_cells, [1.0, 1e6], "1 cell or more")?;
        Ok(())
    }
}

/// A turn about a vertical axis, then a shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// The shift (m).
    pub translation_m: Vector3<f64>,
    /// The turn, counter-clockwise (rad).
    pub yaw_rad: f64,
    /// Where the axis stands (m).
    pub about_m: Point2<f64>,
}

impl Correction {
    /// Nothing is moved.
    pub const NONE: Correction = Correction {
        translation_m: Vector3::new(0.0, 0.0, 0.0),
        yaw_rad: 0.0,
        about_m: Point2::new(0.0, 0.0),
    };

    /// Where a point goes.
    pub fn apply(&self, p: Point3<f64>) -> Point3<f64> {
        let turned = self.about_m + Rotation2::new(self.yaw_rad) * (p.xy() - self.about_m);
        Point3::new(turned.x, turned.y, p.z) + self.translation_m
    }

    /// Where a place came from.
    pub(super) fn undo_xy(&self, p: Point2<f64>) -> Point2<f64> {
        let shifted = p - self.translation_m.xy();
        self.about_m + Rotation2::new(-self.yaw_rad) * (shifted - self.about_m)
    }

    pub(super) fn check(&self) -> Result<(), TerrainError> {
        let (t, a) = (self.translation_m, self.about_m);
        for value in [t.x, t.y, t.z] {
            let expected = "a shift up to 10 m";
            TerrainError::check("correction.translation_m", value, [-10.0, 10.0], expected)?;
        }
        for value in [a.x, a.y] {
            TerrainError::check("correction.about_m", value, [-1e6, 1e6], "a place within 1e6 m")?;
        }
        let expected = "a turn up to 0.5 rad";
        TerrainError::check("correction.yaw_rad", self.yaw_rad, [-0.5, 0.5], expected).map(drop)
    }
}

/// Why a pair is not moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Refusal {
    /// Too little ground is known to both.
    TooFewCells {
        /// Cells that both know.
        cells: usize,
        /// As many as are needed.
        needed: usize,
    },
    /// The best fit is farther than the bounds allow.
    OutOfBounds {
        /// Its shift (m).
        shift_m: f64,
        /// Its turn (rad).
        yaw_rad: f64,
    },
    /// The fit would be no better than before.
    ResidualGrows,
}

/// The outcome of an alignment.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// By how much the pair is moved; nothing if it was refused.
    pub correction: Correction,
    /// Weighted RMS of the distances to the map's planes before (standard deviations).
    pub residual_before: f64,
    /// The same after; as before if it was refused.
    pub residual_after: f64,
    /// Cells that were compared.
    pub cells: usize,
    /// Standard deviations of x, y, z (m) and yaw (rad) that are left.
    pub sigma: [f64; 4],
    /// Why it was refused, if so.
    pub refusal: Option<Refusal>,
    /// True if the correction was chosen by the operator.
    pub is_chosen: bool,
}

impl Alignment {
    /// A pair that is blended where it says it is, without being compared to anything.
    pub const NONE: Alignment = Alignment {
        correction: Correction::NONE,
        residual_before: 0.0,
        residual_after: 0.0,
        cells: 0,
        sigma: [0.0; 4],
        refusal: None,
        is_chosen: false,
    };
}

/// Aligns a pair's map to the map: ground that both know plainly, with no edge, mask, conflict or
/// imported height.
pub fn align(
    dem: &PairDem,
    map: &MapVersion,
    settings: &AlignSettings,
) -> Result<Alignment, TerrainError> {
    settings.check()?;
    let points = points(dem, settings.cells_max);
    let n = points.len().max(1) as f64;
    let center = points.iter().fold(Vector3::zeros(), |sum, (p, _)| sum + p.coords) / n;
    let about_m = Point2::from(center.xy());
    let start = Correction { about_m, ..Correction::NONE };
    let before = fit(&points, map, &start);
    let needed = settings.cells_min.min(settings.cells_max);
    let refused = |refusal, sigma| Alignment {
        residual_before: before.rms,
        residual_after: before.rms,
        cells: before.cells,
        sigma,
        refusal: Some(refusal),
        ..Alignment::NONE
    };
    let prior = [settings.shift_sigma_m, settings.shift_sigma_m, settings.shift_sigma_m];
    let prior = [prior[0], prior[1], prior[2], settings.yaw_sigma_rad];
    if before.cells < needed {
        let cells = before.cells;
        return Ok(refused(Refusal::TooFewCells { cells, needed }, prior));
    }
    let information = Matrix4::from_diagonal(&Vector4::from(prior.map(|s| 1.0 / (s * s))));
    let mut at = start;
    let mut sigma = prior;
    for _ in 0..ITERATIONS {
        let found = fit(&points, map, &at);
        let t = at.translation_m;
        let so_far = Vector4::new(t.x, t.y, t.z, at.yaw_rad);
        let share = 1.0 / settings.correlated_cells;
        let normal = found.normal * share + information;
        let right = found.right * share - information * so_far;
        let Some(inverse) = normal.try_inverse() else { break };
        let step = inverse * right;
        sigma = std::array::from_fn(|i| inverse[(i, i)].max(0.0).sqrt());
        at.translation_m += step.xyz();
        at.yaw_rad += step.w;
        let is_lost = at.translation_m.norm() > 4.0 * settings.shift_max_m
            || at.yaw_rad.abs() > 4.0 * settings.yaw_max_rad;
        if is_lost || !step.iter().all(|v| v.is_finite()) || step.norm() < STEP_MIN {
            break;
        }
    }
    let (shift_m, yaw_rad) = (at.translation_m.norm(), at.yaw_rad);
    if !(shift_m <= settings.shift_max_m && yaw_rad.abs() <= settings.yaw_max_rad) {
        return Ok(refused(Refusal::OutOfBounds { shift_m, yaw_rad }, sigma));
    }
    let after = fit(&points, map, &at);
    // The same ground is to be compared: a fit that loses sight of it is none.
    let is_worse = after.rms > before.rms || 2 * after.cells < before.cells;
    if is_worse || after.cells < needed {
        return Ok(refused(Refusal::ResidualGrows, sigma));
    }
    Ok(Alignment {
        correction: at,
        residual_before: before.rms,
        residual_after: after.rms,
        cells: after.cells,
        sigma,
        refusal: None,
        is_chosen: false,
    })
}

/// Plain ground of a pair (m) with its variance (m²).
fn points(dem: &PairDem, most: usize) -> Vec<(Point3<f64>, f64)> {
    let c = dem.resolution_m();
    let plain = || dem.indexed().filter(|(_, cell)| cell.is_ground() && cell.flags == Flags::NONE);
    let stride = plain().count().div_ceil(most.max(1)).max(1);
    plain()
        .step_by(stride)
        .map(|([ix, iy], cell)| {
            let z = f64::from(cell.height_m);
            (Point3::new(c * f64::from(ix), c * f64::from(iy), z), f64::from(cell.variance_m2))
        })
        .collect()
}

/// Normal equations of one step, and how well the points fit now.
struct Fit {
    normal: Matrix4<f64>,
    right: Vector4<f64>,
    /// Robust RMS residual in standard deviations.
    rms: f64,
    cells: usize,
}

fn fit(points: &[(Point3<f64>, f64)], map: &MapVersion, at: &Correction) -> Fit {
    let mut fit = Fit { normal: Matrix4::zeros(), right: Vector4::zeros(), rms: 0.0, cells: 0 };
    for (p, variance) in points {
        let moved = at.apply(*p);
        let Some(plane) = plane(&of_map(map), map.resolution_m(), moved.xy()) else { continue };
        let [a, b] = plane.gradient;
        let scale = 1.0 / (1.0 + a * a + b * b);
        let residual = plane.height - moved.z;
        let sigma2 = scale * (variance + plane.variance);
        let off = (scale * residual * residual / sigma2).sqrt();
        let weight = if off > HUBER { HUBER / off } else { 1.0 };
        let arm = moved.xy() - at.about_m - at.translation_m.xy();
        // Change of (moved.z - plane height) with x, y, z and yaw.
        let j = Vector4::new(-a, -b, 1.0, a * arm.y - b * arm.x);
        let w = weight * scale / sigma2;
        fit.normal += w * j * j.transpose();
        fit.right += w * residual * j;
        let cost = if off > HUBER { HUBER * (2.0 * off - HUBER) } else { off * off };
        fit.rms += cost;
        fit.cells += 1;
    }
    fit.rms = (fit.rms / fit.cells.max(1) as f64).sqrt();
    fit
}

/// Ground about a place.
pub(super) struct Plane {
    /// At the asked place (m).
    pub height: f64,
    pub gradient: [f64; 2],
    /// Of the height, what the plane does not explain included (m²).
    pub variance: f64,
    /// The part of it that is common to all cells there (m²).
    pub common: f64,
}

/// The plane through the nine cells around a place, if all are plain ground: of these `cell` tells height (m),
/// variance and its common part (m²).
pub(super) fn plane(
    cell: &dyn Fn([i32; 2]) -> Option<[f64; 3]>,
    c: f64,
    p: Point2<f64>,
) -> Option<Plane> {
    let (ix, iy) = ((p.x / c).round() as i32, (p.y / c).round() as i32);
    let (mut z, mut zx, mut zy, mut zz, mut own, mut common) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let reference = cell([ix, iy])?[0];
    for k in 0..9 {
        let (dx, dy) = (k % 3 - 1, k / 3 - 1);
        let [height, variance, shared] = cell([ix + dx, iy + dy])?;
        let h = height - reference;
        z += h;
        zx += h * f64::from(dx);
        zy += h * f64::from(dy);
        zz += h * h;
        own += variance - shared;
        common += shared;
    }
    let (mean, a, b) = (z / 9.0, zx / 6.0, zy / 6.0);
    let unexplained = (zz / 9.0 - mean * mean - (a * a + b * b) * 6.0 / 9.0).max(0.0);
    let (u, v) = (p.x / c - f64::from(ix), p.y / c - f64::from(iy));
    Some(Plane {
        height: reference + mean + a * u + b * v,
        gradient: [a / c, b / c],
        // Neighbors share their errors, so their mean is not taken to lessen them.
        variance: (own + common) / 9.0 + unexplained,
        common: common / 9.0,
    })
}

/// Height (m), variance and its common part (m²) of plain ground of a map. The map is what others are
/// brought to: what its cells have in common does not count.
pub(super) fn of_map(map: &MapVersion) -> impl Fn([i32; 2]) -> Option<[f64; 3]> + '_ {
    let bad = Flags::MASKED | Flags::CONFLICT | Flags::MULTI | Flags::PRIOR;
    move |index| {
        let cell = map.cell(index);
        let is_plain = cell.is_ground() && !cell.flags.any(bad);
        is_plain.then(|| [cell.height_m, cell.variance_m2, 0.0].map(f64::from))
    }
}
