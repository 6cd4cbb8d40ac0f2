//! Max pyramid of a height raster: the highest ground in any rectangle in O(log n).

use nalgebra::Point2;

use crate::{Grid, Raster};

/// Highest known height over blocks of 2^k × 2^k nodes, for quick "nothing here reaches up" tests.
#[derive(Debug, Clone)]
pub struct MaxPyramid {
    grid: Grid,
    /// Level k holds blocks of 2^k nodes a side, row-major, with its own width.
    levels: Vec<(usize, Vec<f32>)>,
}

impl MaxPyramid {
    /// Builds the pyramid; unknown (NaN) nodes count as infinitely low.
    pub fn new(heights: &Raster<f32>) -> MaxPyramid {
        let grid = *heights.grid();
        let lowest = |z: f32| if z.is_nan() { f32::NEG_INFINITY } else { z };
        let base: Vec<f32> = heights.values().iter().map(|z| lowest(*z)).collect();
        let mut levels = vec![(grid.nx, base)];
        let (mut nx, mut ny) = (grid.nx, grid.ny);
        while nx > 1 || ny > 1 {
            let (width, below) = &levels[levels.len() - 1];
            let (mx, my) = (nx.div_ceil(2), ny.div_ceil(2));
            let mut level = Vec::with_capacity(mx * my);
            for iy in 0..my {
                for ix in 0..mx {
                    let xs = 2 * ix..(2 * ix + 2).min(nx);
                    let block = (2 * iy..(2 * iy + 2).min(ny))
                        .flat_map(|y| xs.clone().map(move |x| below[y * width + x]));
                    level.push(block.fold(f32::NEG_INFINITY, f32::max));
                }
            }
            levels.push((mx, level));
            (nx, ny) = (mx, my);
        }
        MaxPyramid { grid, levels }
    }

    /// The highest known node of all squares that the rectangle `[min, max]` (m) touches;
    /// negative infinity where there is none. Never lower than the surface over the rectangle.
    pub fn max_over(&self, min: Point2<f64>, max: Point2<f64>) -> f64 {
        let pad = self.grid.resolution;
        let (xs, ys) = self.grid.nodes_within(
            Point2::new(min.x - pad, min.y - pad),
            Point2::new(max.x + pad, max.y + pad),
        );
        if xs.is_empty() || ys.is_empty() {
            return f64::NEG_INFINITY;
        }
        // The level on which the rectangle spans at most three blocks a side.
        let span = xs.len().max(ys.len());
        let level = (usize::BITS - (span / 2).leading_zeros()) as usize;
        let level = level.min(self.levels.len() - 1);
        let (width, blocks) = &self.levels[level];
        let mut highest = f32::NEG_INFINITY;
        for iy in ys.start >> level..=(ys.end - 1) >> level {
            for ix in xs.start >> level..=(xs.end - 1) >> level {
                highest = highest.max(blocks[iy * width + ix]);
            }
        }
        f64::from(highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_spike_is_seen_by_every_rectangle_that_holds_it() {
        let grid = Grid { origin: Point2::new(0.0, 0.0), resolution: 1.0, nx: 37, ny: 21 };
        let mut heights = Raster::from_fn(grid, |_, _| 0.0_f32);
        heights.values_mut()[grid.index(30, 11)] = 5.0;
        let pyramid = MaxPyramid::new(&heights);
        assert_eq!(pyramid.max_over(Point2::new(29.6, 10.8), Point2::new(30.2, 11.1)), 5.0);
        assert_eq!(pyramid.max_over(Point2::new(0.0, 0.0), Point2::new(36.0, 20.0)), 5.0);
        assert_eq!(pyramid.max_over(Point2::new(2.0, 2.0), Point2::new(3.0, 3.0)), 0.0);
        assert_eq!(
            pyramid.max_over(Point2::new(90.0, 2.0), Point2::new(93.0, 3.0)),
            f64::NEG_INFINITY
        );
    }
}
