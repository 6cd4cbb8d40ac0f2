//! The layers of a map, block by block, at a cost that hardly grows with the window.

use geometry::Raster;

use super::judge::{Answers, Judge};
use super::step::{Patch, largest_ranges};
use super::sums::{Columns, Quadrants, Sums};
use super::{Layers, Limits};

/// Cells a side of a block, at least.
const BLOCK: usize = 256;

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
        let mut sums = Sums::new(self.nx);
        let mut least = vec![f64::INFINITY; self.nx];
        let mut quadrants = Quadrants::new(self.nx + w - 1, self.half);
        if !is_whole {
            (0..w - 1).for_each(|iy| quadrants.enter(row(iy), iy));
        }
        for iy in 0..self.ny {
            columns.enter(row(iy + w - 1), reference);
            columns.window_sums(&mut sums);
            if !is_whole {
                quadrants.slide(iy, &row);
                least.iter_mut().enumerate().for_each(|(ix, n)| *n = quadrants.least(ix));
            }
            let start = layers.class.grid().index(self.x0, self.y0 + iy);
            let mut answers = Answers::of(layers, start..start + self.nx);
            judge.row(&sums, &ranges[iy * self.nx..][..self.nx], &least, &mut answers);
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
