//! Max pyramid of a height raster: the highest ground in any rectangle in O(log n), and a descent
//! to the squares of the grid that matter.

use nalgebra::Point2;

use crate::{Grid, Raster};

/// Highest known height over blocks of 2^k × 2^k squares between nodes, for quick "nothing here
/// reaches up" tests.
#[derive(Debug, Clone)]
pub struct MaxPyramid {
    grid: Grid,
    /// Level k holds blocks of 2^k squares a side, row-major, with its own width and depth.
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    nx: usize,
    ny: usize,
    highest: Vec<f32>,
}

/// A block of squares: the ground in it lies within `min` to `max` (m) and nowhere above `top` (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Lower corner (m).
    pub min: Point2<f64>,
    /// Upper corner (m).
    pub max: Point2<f64>,
    /// Highest known ground (m); negative infinity where nothing is known.
    pub top: f64,
}

/// Most levels: a raster of 2^31 nodes a side.
const MAX_LEVELS: usize = 32;

/// Levels below which a descent is short.
const SHORT: usize = 4;

impl MaxPyramid {
    /// Builds the pyramid; unknown (NaN) nodes count as infinitely low. A raster of a single row or
    /// column has that row or column as its squares.
    pub fn new(heights: &Raster<f32>) -> MaxPyramid {
        let grid = *heights.grid();
        let (nx, ny) = (grid.nx.saturating_sub(1).max(1), grid.ny.saturating_sub(1).max(1));
        let height = |ix: usize, iy: usize| {
            if ix < grid.nx && iy < grid.ny { *heights.at(ix, iy) } else { f32::NAN }
        };
        let mut highest = Vec::with_capacity(nx * ny);
        for iy in 0..ny {
            for ix in 0..nx {
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
                // f32::max passes over NaN.
                let top = corners.map(|(dx, dy)| height(ix + dx, iy + dy));
                highest.push(top.into_iter().fold(f32::NEG_INFINITY, f32::max));
            }
        }
        let mut levels = vec![Level { nx, ny, highest }];
        while let Some(below) = levels.last()
            && (below.nx > 1 || below.ny > 1)
        {
            let above = below.halved();
            levels.push(above);
        }
        MaxPyramid { grid, levels }
    }

    /// The highest known node of all squares that the rectangle `[min, max]` (m) touches;
    /// negative infinity where there is none. Never lower than the surface over the rectangle.
    pub fn max_over(&self, min: Point2<f64>, max: Point2<f64>) -> f64 {
        let Some([x0, x1, y0, y1]) = self.squares(min, max) else { return f64::NEG_INFINITY };
        // The level on which the rectangle spans at most two or three blocks a side.
        let level = self.level_for(x1 - x0, y1 - y0);
        let Level { nx, highest, .. } = &self.levels[level];
        let mut top = f32::NEG_INFINITY;
        for iy in y0 >> level..=y1 >> level {
            for ix in x0 >> level..=x1 >> level {
                top = top.max(highest[iy * nx + ix]);
            }
        }
        f64::from(top)
    }

    /// Goes down from the blocks over the rectangle `[min, max]` (m) to its squares: into a block
    /// only where `enter` says so, and calls `square` with the lower corner's indices of each one
    /// that is reached, until it answers false.
    pub fn descend(
        &self,
        min: Point2<f64>,
        max: Point2<f64>,
        mut enter: impl FnMut(&Block) -> bool,
        mut square: impl FnMut(usize, usize) -> bool,
    ) {
        let Some([x0, x1, y0, y1]) = self.squares(min, max) else { return };
        let top_level = self.level_for(x1 - x0, y1 - y0);
        // Depth first: three siblings wait on each level below the first one. Most descents are short,
        // and a stack for the longest would take longer to clear than they do.
        if top_level < SHORT {
            let mut stack = [(0_u32, 0_u32, 0_u32); 3 * SHORT + 1];
            self.descend_from(top_level, [x0, x1, y0, y1], &mut stack, &mut enter, &mut square);
        } else {
            let mut stack = [(0_u32, 0_u32, 0_u32); 3 * MAX_LEVELS + 1];
            self.descend_from(top_level, [x0, x1, y0, y1], &mut stack, &mut enter, &mut square);
        }
    }

    fn descend_from(
        &self,
        top_level: usize,
        [x0, x1, y0, y1]: [usize; 4],
        stack: &mut [(u32, u32, u32)],
        enter: &mut impl FnMut(&Block) -> bool,
        square: &mut impl FnMut(usize, usize) -> bool,
    ) {
        for iy in y0 >> top_level..=y1 >> top_level {
            for ix in x0 >> top_level..=x1 >> top_level {
                // A raster has fewer than 2^31 nodes a side.
                stack[0] = (top_level as u32, ix as u32, iy as u32);
                let mut n = 1;
                while n > 0 {
                    n -= 1;
                    let (level, ix, iy) = stack[n];
                    let (level, ix, iy) = (level as usize, ix as usize, iy as usize);
                    if !enter(&self.block(level, ix, iy)) {
                        continue;
                    }
                    if level == 0 {
                        if !square(ix, iy) {
                            return;
                        }
                        continue;
                    }
                    let below = level - 1;
                    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let (jx, jy) = (2 * ix + dx, 2 * iy + dy);
                        let inside = jx >= x0 >> below
                            && jx <= x1 >> below
                            && jy >= y0 >> below
                            && jy <= y1 >> below;
                        if inside {
                            stack[n] = (below as u32, jx as u32, jy as u32);
                            n += 1;
                        }
                    }
                }
            }
        }
    }

    /// First and last square along x and y that the rectangle touches; none beside the grid.
    fn squares(&self, min: Point2<f64>, max: Point2<f64>) -> Option<[usize; 4]> {
        let Level { nx, ny, .. } = self.levels[0];
        let range = |lo: f64, hi: f64, origin: f64, n: usize| {
            // A rectangle that ends on a line between two squares touches both.
            let first = ((lo - origin) / self.grid.resolution).ceil() - 1.0;
            let last = ((hi - origin) / self.grid.resolution).floor();
            let touches = first <= last && first <= n as f64 - 1.0 && last >= -1.0;
            touches.then(|| {
                let end = n as f64 - 1.0;
                (first.clamp(0.0, end) as usize, last.clamp(0.0, end) as usize)
            })
        };
        let origin = self.grid.origin;
        let (x0, x1) = range(min.x, max.x, origin.x, nx)?;
        let (y0, y1) = range(min.y, max.y, origin.y, ny)?;
        Some([x0, x1, y0, y1])
    }

    fn level_for(&self, span_x: usize, span_y: usize) -> usize {
        let span = span_x.max(span_y);
        let level = (usize::BITS - span.leading_zeros()) as usize;
        level.saturating_sub(1).min(self.levels.len() - 1)
    }

    fn block(&self, level: usize, ix: usize, iy: usize) -> Block {
        let (grid, Level { nx, highest, .. }) = (&self.grid, &self.levels[level]);
        let last = (&self.levels[0].nx, &self.levels[0].ny);
        Block {
            min: grid.position(ix << level, iy << level),
            max: grid.position(((ix + 1) << level).min(*last.0), ((iy + 1) << level).min(*last.1)),
            top: f64::from(highest[iy * nx + ix]),
        }
    }
}

impl Level {
    fn halved(&self) -> Level {
        let (nx, ny) = (self.nx.div_ceil(2), self.ny.div_ceil(2));
        let mut highest = Vec::with_capacity(nx * ny);
        for iy in 0..ny {
            for ix in 0..nx {
                let xs = 2 * ix..(2 * ix + 2).min(self.nx);
                let block = (2 * iy..(2 * iy + 2).min(self.ny))
                    .flat_map(|y| xs.clone().map(move |x| self.highest[y * self.nx + x]));
                highest.push(block.fold(f32::NEG_INFINITY, f32::max));
            }
        }
        Level { nx, ny, highest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spike() -> MaxPyramid {
        let grid = Grid { origin: Point2::new(0.0, 0.0), resolution: 1.0, nx: 37, ny: 21 };
        let mut heights = Raster::from_fn(grid, |_, _| 0.0_f32);
        heights.values_mut()[grid.index(30, 11)] = 5.0;
        MaxPyramid::new(&heights)
    }

    #[test]
    fn a_single_spike_is_seen_by_every_rectangle_that_holds_it() {
        let pyramid = spike();
        assert_eq!(pyramid.max_over(Point2::new(29.6, 10.8), Point2::new(30.2, 11.1)), 5.0);
        assert_eq!(pyramid.max_over(Point2::new(0.0, 0.0), Point2::new(36.0, 20.0)), 5.0);
        assert_eq!(pyramid.max_over(Point2::new(2.0, 2.0), Point2::new(3.0, 3.0)), 0.0);
        assert_eq!(
            pyramid.max_over(Point2::new(90.0, 2.0), Point2::new(93.0, 3.0)),
            f64::NEG_INFINITY
        );
    }

    #[test]
    fn the_descent_reaches_the_squares_that_are_entered_and_no_others() {
        let pyramid = spike();
        let squares = |enter: fn(&Block) -> bool| {
            let mut reached = Vec::new();
            let (min, max) = (Point2::new(20.5, 3.5), Point2::new(33.5, 17.5));
            pyramid.descend(min, max, enter, |ix, iy| {
                reached.push((ix, iy));
                true
            });
            reached.sort_unstable();
            reached
        };
        assert_eq!(squares(|block| block.top > 1.0), [(29, 10), (29, 11), (30, 10), (30, 11)]);
        let all: Vec<_> = (20..=33).flat_map(|x| (3..=17).map(move |y| (x, y))).collect();
        assert_eq!(squares(|_| true), all);
        let mut n = 0;
        pyramid.descend(
            Point2::new(0.0, 0.0),
            Point2::new(36.0, 20.0),
            |_| true,
            |_, _| {
                n += 1;
                n < 3
            },
        );
        assert_eq!(n, 3);
    }
}
