//! The layers of a map, block by block, at a cost that does not grow with the window.
//!
//! Six moments of each column of the window slide down the rows; ten sums over the window slide
//! along each row. Everything is in f64, in cells from the block's corner and in meters from a
//! height of the block, and starts anew in each block: nothing grows, and sums of counts and
//! coordinates are exact.

use geometry::Raster;

use super::step::{NO_STEP, Patch, largest_ranges};
use super::{Layers, Limits, UNKNOWN};

/// Cells a side of a block, at least.
const BLOCK: usize = 256;

/// Sums over a window, in cells and meters: n, y, yy, z, yz, zz, then xn, xxn, xy, xz.
type Sums = [f64; 10];

/// Fills `layers` from heights on the same grid, with an odd window of `w` cells a side.
pub(super) fn fill(heights: &Raster<f32>, w: usize, limits: &Limits, layers: &mut Layers) {
    let grid = *heights.grid();
    let side = BLOCK.max(4 * w);
    let judge = Judge::new(w, grid.resolution, limits);
    for y0 in (0..grid.ny).step_by(side) {
        for x0 in (0..grid.nx).step_by(side) {
            let block = Block {
                x0,
                y0,
                nx: side.min(grid.nx - x0),
                ny: side.min(grid.ny - y0),
                half: w / 2,
            };
            block.fill(heights, &judge, layers);
        }
    }
}

/// A rectangle of cells to answer.
struct Block {
    x0: usize,
    y0: usize,
    nx: usize,
    ny: usize,
    /// Cells from the window's center to its edge.
    half: usize,
}

impl Block {
    fn fill(&self, heights: &Raster<f32>, judge: &Judge, layers: &mut Layers) {
        let w = 2 * self.half + 1;
        let patch = self.patch(heights);
        let Some(reference) = patch.z.iter().copied().find(|z| !z.is_nan()) else { return };
        let ranges = largest_ranges(&patch, w);
        let is_whole = patch.z.iter().all(|z| !z.is_nan());
        let reference = f64::from(reference);
        let row = |iy: usize| &patch.z[(iy + 1) * patch.width + 1..][..self.nx + w - 1];
        let mut columns = Columns::new(self.nx + w - 1, self.half);
        for iy in 0..w - 1 {
            columns.enter(row(iy), reference);
        }
        let mut sums = vec![[0.0; 10]; self.nx];
        let mut quadrants = Quadrants::new(self.nx + w - 1, self.half);
        if !is_whole {
            (0..w - 1).for_each(|iy| quadrants.enter(row(iy), iy));
        }
        for iy in 0..self.ny {
            columns.enter(row(iy + w - 1), reference);
            columns.window_sums(&mut sums);
            if !is_whole {
                quadrants.slide(iy, &row);
            }
            let start = layers.class.grid().index(self.x0, self.y0 + iy);
            let ranges = &ranges[iy * self.nx..][..self.nx];
            for (ix, (sums, range)) in sums.iter().zip(ranges).enumerate() {
                let least = if is_whole { usize::MAX } else { quadrants.least(ix) };
                judge.cell(sums, *range, least, layers, start + ix);
            }
            columns.leave(row(iy), reference);
        }
    }

    /// The block's heights with a border of half a window and one cell; outside the map NaN.
    fn patch(&self, heights: &Raster<f32>) -> Patch {
        let grid = heights.grid();
        let border = self.half + 1;
        let (width, height) = (self.nx + 2 * border, self.ny + 2 * border);
        let mut z = vec![f32::NAN; width * height];
        let xs = self.x0.saturating_sub(border)..(self.x0 + self.nx + border).min(grid.nx);
        let ys = self.y0.saturating_sub(border)..(self.y0 + self.ny + border).min(grid.ny);
        for iy in ys {
            let to = (iy + border - self.y0) * width + xs.start + border - self.x0;
            let from = grid.index(xs.start, iy);
            z[to..to + xs.len()].copy_from_slice(&heights.values()[from..from + xs.len()]);
        }
        Patch { width, height, z }
    }
}

/// Moments of each column over the rows of the window, y in cells from the row that entered last.
struct Columns {
    half: usize,
    n: Vec<f64>,
    y: Vec<f64>,
    yy: Vec<f64>,
    z: Vec<f64>,
    yz: Vec<f64>,
    zz: Vec<f64>,
}

impl Columns {
    fn new(len: usize, half: usize) -> Columns {
        let zeros = || vec![0.0; len];
        let (n, y, yy, z, yz, zz) = (zeros(), zeros(), zeros(), zeros(), zeros(), zeros());
        Columns { half, n, y, yy, z, yz, zz }
    }

    /// Adds a row and moves y's origin to it.
    fn enter(&mut self, row: &[f32], reference: f64) {
        let len = row.len();
        let (n, y, yy) = (&mut self.n[..len], &mut self.y[..len], &mut self.yy[..len]);
        let (z, yz, zz) = (&mut self.z[..len], &mut self.yz[..len], &mut self.zz[..len]);
        for i in 0..len {
            let is_known = !row[i].is_nan();
            let known = if is_known { 1.0 } else { 0.0 };
            let height = if is_known { f64::from(row[i]) - reference } else { 0.0 };
            yy[i] += n[i] - 2.0 * y[i];
            y[i] -= n[i];
            yz[i] -= z[i];
            n[i] += known;
            z[i] += height;
            zz[i] += height * height;
        }
    }

    /// Removes the window's first row.
    fn leave(&mut self, row: &[f32], reference: f64) {
        let len = row.len();
        let (n, y, yy) = (&mut self.n[..len], &mut self.y[..len], &mut self.yy[..len]);
        let (z, yz, zz) = (&mut self.z[..len], &mut self.yz[..len], &mut self.zz[..len]);
        let back = 2.0 * self.half as f64;
        for i in 0..len {
            let is_known = !row[i].is_nan();
            let known = if is_known { 1.0 } else { 0.0 };
            let height = if is_known { f64::from(row[i]) - reference } else { 0.0 };
            n[i] -= known;
            y[i] += back * known;
            yy[i] -= back * back * known;
            z[i] -= height;
            yz[i] += back * height;
            zz[i] -= height * height;
        }
    }

    /// The sums over each window along the row.
    fn window_sums(&self, out: &mut [Sums]) {
        let w = 2 * self.half + 1;
        let column = |i: usize| -> Sums {
            let x = i as f64;
            let (n, y, z) = (self.n[i], self.y[i], self.z[i]);
            [n, y, self.yy[i], z, self.yz[i], self.zz[i], x * n, x * x * n, x * y, x * z]
        };
        let mut sums = [0.0; 10];
        for i in 0..w - 1 {
            let enters = column(i);
            (0..10).for_each(|k| sums[k] += enters[k]);
        }
        for (i, out) in out.iter_mut().enumerate() {
            let (enters, leaves) = (column(i + w - 1), column(i));
            (0..10).for_each(|k| sums[k] += enters[k]);
            *out = sums;
            (0..10).for_each(|k| sums[k] -= leaves[k]);
        }
    }
}

/// Known cells of each column above and below the center row, and their running sums along it.
struct Quadrants {
    half: usize,
    low: Vec<u32>,
    high: Vec<u32>,
    low_sums: Vec<u32>,
    high_sums: Vec<u32>,
}

impl Quadrants {
    fn new(len: usize, half: usize) -> Quadrants {
        let (low, high) = (vec![0; len], vec![0; len]);
        Quadrants { half, low, high, low_sums: vec![0; len + 1], high_sums: vec![0; len + 1] }
    }

    /// Counts row `iy` of the first window but its last row, less the row that `slide` removes.
    fn enter(&mut self, row: &[f32], iy: usize) {
        let counts = if iy < self.half { &mut self.low } else { &mut self.high };
        add_known(counts, row, 1);
    }

    /// Moves the halves to the window that starts at row `iy`.
    fn slide<'a>(&mut self, iy: usize, row: &impl Fn(usize) -> &'a [f32]) {
        let half = self.half;
        if iy > 0 {
            add_known(&mut self.low, row(iy - 1), u32::MAX);
            add_known(&mut self.low, row(iy + half - 1), 1);
        }
        // `high` covers rows iy + half .. iy + 2 half here; drop the center row, take the last.
        add_known(&mut self.high, row(iy + half), u32::MAX);
        add_known(&mut self.high, row(iy + 2 * half), 1);
        for (sums, counts) in [(&mut self.low_sums, &self.low), (&mut self.high_sums, &self.high)] {
            let mut sum = 0;
            for (to, count) in sums[1..].iter_mut().zip(counts) {
                sum += count;
                *to = sum;
            }
        }
    }

    /// Known cells of the least known quadrant of window `ix`.
    fn least(&self, ix: usize) -> usize {
        let (left, right) = (ix..ix + self.half, ix + self.half + 1..ix + 2 * self.half + 1);
        let count = |sums: &[u32], xs: &std::ops::Range<usize>| sums[xs.end] - sums[xs.start];
        let low = count(&self.low_sums, &left).min(count(&self.low_sums, &right));
        let high = count(&self.high_sums, &left).min(count(&self.high_sums, &right));
        low.min(high) as usize
    }
}

/// Adds `amount` (1, or its wrapping negative) wherever the row is known.
fn add_known(counts: &mut [u32], row: &[f32], amount: u32) {
    for (count, z) in counts.iter_mut().zip(row) {
        *count = count.wrapping_add(if !z.is_nan() { amount } else { 0 });
    }
}

/// Turns the sums of a window into the values of its cell.
struct Judge<'a> {
    limits: &'a Limits,
    resolution: f64,
    window_cells: f64,
    /// Least determinant of the x-y covariance (cells^4).
    det_min: f64,
    known_min: f64,
    quadrant_min: f64,
}

impl Judge<'_> {
    fn new(w: usize, resolution: f64, limits: &Limits) -> Judge<'_> {
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

    fn cell(&self, sums: &Sums, range: f32, least: usize, layers: &mut Layers, at: usize) {
        let [n, y, yy, z, yz, zz, x, xx, xy, xz] = *sums;
        if n < 1.0 {
            return;
        }
        let per_n = 1.0 / n;
        let certainty = (n / self.window_cells) as f32;
        layers.certainty.values_mut()[at] = certainty;
        let (mx, my, mz) = (x * per_n, y * per_n, z * per_n);
        let (cxx, cxy, cyy) = (xx * per_n - mx * mx, xy * per_n - mx * my, yy * per_n - my * my);
        let (cxz, cyz, czz) = (xz * per_n - mx * mz, yz * per_n - my * mz, zz * per_n - mz * mz);
        let det = cxx * cyy - cxy * cxy;
        if n < 3.0 || det < self.det_min {
            return;
        }
        // Per cell, not per meter.
        let a = (cyy * cxz - cxy * cyz) / det;
        let b = (cxx * cyz - cxy * cxz) / det;
        let tan2 = (a * a + b * b) / (self.resolution * self.resolution);
        let vertical = (czz - a * cxz - b * cyz).max(0.0);
        let slope = tan2.sqrt().atan();
        let roughness = (vertical / (1.0 + tan2)).sqrt();
        layers.slope_rad.values_mut()[at] = slope as f32;
        layers.roughness_m.values_mut()[at] = roughness as f32;
        if range == NO_STEP {
            return;
        }
        let step = (f64::from(range) - 2.0 * (a.abs() + b.abs())).max(0.0);
        layers.step_m.values_mut()[at] = step as f32;
        if n < self.known_min || (least as f64) < self.quadrant_min {
            layers.class.values_mut()[at] = UNKNOWN;
            return;
        }
        let [g_slope, g_roughness, g_step] = self.limits.goodness(slope, roughness, step);
        let goodness = g_slope.min(g_roughness).min(g_step) as f32;
        layers.goodness.values_mut()[at] = goodness;
        layers.class.values_mut()[at] = self.limits.class(goodness, certainty);
    }
}
