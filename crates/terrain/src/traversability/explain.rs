//! All there is to say of one cell, by going through its window.

use nalgebra::{Point2, Unit, Vector3};

use geometry::Raster;

use super::{Limits, RAMP_REASONS, UNKNOWN, Window, check_trust};
use crate::plane::{Moments, normal_of};
use crate::{ElevationMap, TerrainError};

/// What makes up the goodness of one cell, or why it has none. `None`: there is no such value.
#[derive(Debug, Clone, PartialEq)]
pub struct CellExplanation {
    /// Center of the cell (m).
    pub position: Point2<f64>,
    /// Height of its node (m).
    pub height_m: Option<f64>,
    /// Height of the window's plane at the center (m).
    pub plane_height_m: Option<f64>,
    /// Upward normal of that plane.
    pub normal: Option<Unit<Vector3<f64>>>,
    /// Slope of the plane (rad).
    pub slope_rad: Option<f64>,
    /// Orthogonal RMS residual (m).
    pub roughness_m: Option<f64>,
    /// Largest 3 x 3 range less the plane's own (m).
    pub step_m: Option<f64>,
    /// Highest ground of the window over the plane, along its normal (m).
    pub protrusion_m: Option<f64>,
    /// Deepest ground of the window under the plane, along its normal (m).
    pub pit_m: Option<f64>,
    /// Ramps of slope, roughness and step.
    pub goodness_of: Option<[f64; 3]>,
    /// The least of them; `None` where the class is unknown.
    pub goodness: Option<f64>,
    /// Trust in the window's known cells over the number of its cells.
    pub certainty: f64,
    /// Known share of the window.
    pub known_share: f64,
    /// Known share of each quadrant: (low x, low y), (high x, low y), (low x, high y), (high, high).
    pub quadrant_known: [f64; 4],
    /// Class, as in [`super::Layers`].
    pub class: u8,
    /// Cells a side of the window.
    pub window: usize,
    /// Distance of the cells judged (m).
    pub resolution_m: f64,
    /// The thresholds.
    pub limits: Limits,
}

/// One of the values that goodness is the least ramp of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// `slope_rad`, `roughness_m` or `step_m`.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Goodness is 1 at this value and below.
    pub lo: f64,
    /// Goodness is 0 at this value and above.
    pub hi: f64,
    /// Goodness in between.
    pub goodness: f64,
    /// Where the default thresholds come from.
    pub reason: &'static str,
}

impl CellExplanation {
    /// Slope, roughness and step with the thresholds they were held against; the worst decides.
    /// Empty where one of them has no value.
    pub fn components(&self) -> Vec<Component> {
        let (Some(slope), Some(roughness), Some(step), Some(goodness)) =
            (self.slope_rad, self.roughness_m, self.step_m, self.goodness_of)
        else {
            return Vec::new();
        };
        let l = &self.limits;
        let parts = [
            ("slope_rad", slope, l.slope_lo_rad, l.slope_hi_rad),
            ("roughness_m", roughness, l.roughness_lo_m, l.roughness_hi_m),
            ("step_m", step, l.step_lo_m, l.step_hi_m),
        ];
        let whys = goodness.into_iter().zip(RAMP_REASONS);
        let component = |((name, value, lo, hi), (goodness, reason))| Component {
            name,
            value,
            lo,
            hi,
            goodness,
            reason,
        };
        parts.into_iter().zip(whys).map(component).collect()
    }
}

/// Explains the cell that holds `p`; `None` outside the map. The same definition as
/// [`super::traversability`], but by going through the window, so that the two check each other.
pub fn explain_cell(
    map: &ElevationMap,
    p: Point2<f64>,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Option<CellExplanation>, TerrainError> {
    explain_trusted_cell(map, None, p, footprint_m, limits)
}

/// As [`explain_cell`], with trust in each cell of the map, 0 to 1, on the map's grid.
pub fn explain_trusted_cell(
    map: &ElevationMap,
    trust: Option<&Raster<f32>>,
    p: Point2<f64>,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Option<CellExplanation>, TerrainError> {
    limits.check()?;
    check_trust(map.grid(), trust)?;
    let window = Window::of(map, footprint_m)?;
    let Some(center) = window.grid.nearest(p) else { return Ok(None) };
    let view = View { map, trust, window: &window, center: (center.0 as i64, center.1 as i64) };
    Ok(Some(view.explain(limits)))
}

/// The cells around one cell.
struct View<'a> {
    map: &'a ElevationMap,
    trust: Option<&'a Raster<f32>>,
    window: &'a Window,
    center: (i64, i64),
}

impl View<'_> {
    /// Height of the cell (dx, dy) from the center (m), if known.
    fn height(&self, dx: i64, dy: i64) -> Option<f64> {
        let grid = &self.window.grid;
        let ix = usize::try_from(self.center.0 + dx).ok().filter(|ix| *ix < grid.nx)?;
        let iy = usize::try_from(self.center.1 + dy).ok().filter(|iy| *iy < grid.ny)?;
        if self.window.is_resampled {
            // Stored as f32, like the resampled map.
            return self.map.height_at(grid.position(ix, iy)).map(|z| f64::from(z as f32));
        }
        Some(f64::from(*self.map.heights().at(ix, iy))).filter(|z| !z.is_nan())
    }

    /// The known cells of the window, with x, y from its center (m).
    fn known(&self) -> Vec<(i64, i64, f64)> {
        let half = self.window.cells as i64 / 2;
        let cells = (-half..=half).flat_map(|dy| (-half..=half).map(move |dx| (dx, dy)));
        cells.filter_map(|(dx, dy)| self.height(dx, dy).map(|z| (dx, dy, z))).collect()
    }

    /// The largest 3 x 3 range (m) of the cells of the window that have two known neighbors.
    fn largest_range(&self) -> Option<f64> {
        let half = self.window.cells as i64 / 2;
        let ranges =
            (-half..=half).flat_map(|dy| (-half..=half).filter_map(move |dx| self.range(dx, dy)));
        ranges.reduce(f64::max)
    }

    fn range(&self, dx: i64, dy: i64) -> Option<f64> {
        let around = (0..9).filter(|k| *k != 4);
        let heights: Vec<f64> =
            around.filter_map(|k| self.height(dx + k % 3 - 1, dy + k / 3 - 1)).collect();
        if heights.len() < 2 {
            return None;
        }
        let all = heights.into_iter().chain(self.height(dx, dy));
        let (lo, hi) =
            all.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), z| (lo.min(z), hi.max(z)));
        Some(hi - lo)
    }

    fn explain(&self, limits: &Limits) -> CellExplanation {
        let grid = &self.window.grid;
        let (c, w) = (grid.resolution, self.window.cells);
        let known = self.known();
        let reference = known.first().map_or(0.0, |(_, _, z)| *z);
        let mut moments = Moments::default();
        for (dx, dy, z) in &known {
            moments.add(c * *dx as f64, c * *dy as f64, z - reference);
        }
        let plane = moments.fit(c * w as f64);
        let half = (w / 2) as f64;
        let share = |sx: i64, sy: i64| {
            let inside = known.iter().filter(|(dx, dy, _)| dx * sx > 0 && dy * sy > 0);
            inside.count() as f64 / (half * half)
        };
        let quadrant_known = [share(-1, -1), share(1, -1), share(-1, 1), share(1, 1)];
        let known_share = known.len() as f64 / (w * w) as f64;
        let trust = |(dx, dy, _): &(i64, i64, f64)| match self.trust {
            Some(trust) => {
                let (ix, iy) = ((self.center.0 + dx) as usize, (self.center.1 + dy) as usize);
                trust.nearest(grid.position(ix, iy)).map_or(0.0, f64::from)
            }
            None => 1.0,
        };
        let certainty = known.iter().map(trust).sum::<f64>() / (w * w) as f64;
        let step_m = plane
            .zip(self.largest_range())
            .map(|(plane, range)| (range - 2.0 * c * (plane.a.abs() + plane.b.abs())).max(0.0));
        let slope_rad = plane.map(|p| p.a.hypot(p.b).atan());
        let offsets = plane.map(|p| {
            let scale = 1.0 / (1.0 + p.a * p.a + p.b * p.b).sqrt();
            let off = known.iter().map(|(dx, dy, z)| {
                scale * (z - reference - p.d - c * (p.a * *dx as f64 + p.b * *dy as f64))
            });
            off.fold((0.0_f64, 0.0_f64), |(lo, hi), d| (lo.min(d), hi.max(d)))
        });
        let goodness_of = match (slope_rad, plane, step_m) {
            (Some(slope), Some(plane), Some(step)) => {
                Some(limits.goodness(slope, plane.roughness, step))
            }
            _ => None,
        };
        let is_known = known_share >= limits.known_share_min - 1e-12
            && quadrant_known.iter().all(|q| *q >= limits.quadrant_known_min - 1e-12);
        let goodness = goodness_of.filter(|_| is_known).map(|g| g[0].min(g[1]).min(g[2]));
        CellExplanation {
            position: grid.position(self.center.0 as usize, self.center.1 as usize),
            height_m: self.height(0, 0),
            plane_height_m: plane.map(|p| p.d + reference),
            normal: plane.map(|p| normal_of([p.a, p.b])),
            slope_rad,
            roughness_m: plane.map(|p| p.roughness),
            step_m,
            protrusion_m: offsets.map(|(_, hi)| hi),
            pit_m: offsets.map(|(lo, _)| -lo),
            goodness_of,
            goodness,
            certainty,
            known_share,
            quadrant_known,
            class: goodness.map_or(UNKNOWN, |g| limits.class(g as f32, certainty as f32)),
            window: w,
            resolution_m: c,
            limits: *limits,
        }
    }
}
