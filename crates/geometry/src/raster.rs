//! Rasters: values on the nodes of a regular, axis-parallel grid in the world's x-y plane.

use nalgebra::Point2;

/// Where the nodes of a raster lie.
///
/// Node `(ix, iy)` is at `origin + resolution · (ix, iy)`; a value belongs to the node, and the
/// square of side `resolution` around it is its *cell*. Between nodes a raster of heights is the
/// surface of two triangles per square of four nodes, split along the diagonal from
/// `(ix + 1, iy)` to `(ix, iy + 1)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Position of node (0, 0) (m).
    pub origin: Point2<f64>,
    /// Distance between neighboring nodes (m), > 0.
    pub resolution: f64,
    /// Number of nodes along x.
    pub nx: usize,
    /// Number of nodes along y.
    pub ny: usize,
}

impl Grid {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nx * self.ny
    }

    /// True if the grid has no node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of node `(ix, iy)` (m).
    pub fn position(&self, ix: usize, iy: usize) -> Point2<f64> {
        Point2::new(
            self.origin.x + self.resolution * ix as f64,
            self.origin.y + self.resolution * iy as f64,
        )
    }

    /// Index of node `(ix, iy)` in row-major order (rows along x, from low to high y).
    pub fn index(&self, ix: usize, iy: usize) -> usize {
        iy * self.nx + ix
    }

    /// The node whose cell holds `p`, or `None` outside the grid.
    pub fn nearest(&self, p: Point2<f64>) -> Option<(usize, usize)> {
        let fx = ((p.x - self.origin.x) / self.resolution).round();
        let fy = ((p.y - self.origin.y) / self.resolution).round();
        let inside = fx >= 0.0 && fy >= 0.0 && fx < self.nx as f64 && fy < self.ny as f64;
        inside.then_some((fx as usize, fy as usize))
    }

    /// The last node's position (m): the corner opposite to `origin`.
    pub fn far_corner(&self) -> Point2<f64> {
        self.position(self.nx.saturating_sub(1), self.ny.saturating_sub(1))
    }

    /// The half-open index ranges of the nodes in the rectangle `[min, max]` (m), clipped to the
    /// grid and possibly empty.
    pub fn nodes_within(
        &self,
        min: Point2<f64>,
        max: Point2<f64>,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let range = |lo: f64, hi: f64, origin: f64, n: usize| {
            let first = ((lo - origin) / self.resolution).ceil().clamp(0.0, n as f64);
            let last = ((hi - origin) / self.resolution).floor().clamp(-1.0, n as f64 - 1.0);
            first as usize..((last + 1.0) as usize).max(first as usize)
        };
        (range(min.x, max.x, self.origin.x, self.nx), range(min.y, max.y, self.origin.y, self.ny))
    }
}

/// Values on the nodes of a [`Grid`], row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster<T> {
    grid: Grid,
    values: Vec<T>,
}

impl<T> Raster<T> {
    /// A raster from row-major values; `None` if their number does not fit the grid.
    pub fn new(grid: Grid, values: Vec<T>) -> Option<Raster<T>> {
        (values.len() == grid.len()).then_some(Raster { grid, values })
    }

    /// A raster whose value at each node is `value(ix, iy)`.
    pub fn from_fn(grid: Grid, mut value: impl FnMut(usize, usize) -> T) -> Raster<T> {
        let mut values = Vec::with_capacity(grid.len());
        for iy in 0..grid.ny {
            for ix in 0..grid.nx {
                values.push(value(ix, iy));
            }
        }
        Raster { grid, values }
    }

    /// Where the nodes lie.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The values, row-major.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// The values, row-major, to be changed in place.
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The value at node `(ix, iy)`; panics outside the grid.
    pub fn at(&self, ix: usize, iy: usize) -> &T {
        &self.values[self.grid.index(ix, iy)]
    }
}

impl<T: Copy> Raster<T> {
    /// The value of the cell that holds `p`, or `None` outside the grid.
    pub fn nearest(&self, p: Point2<f64>) -> Option<T> {
        self.grid.nearest(p).map(|(ix, iy)| *self.at(ix, iy))
    }
}

impl Raster<f32> {
    /// Height and gradient (dz/dx, dz/dy) of the triangulated surface at `p`; `None` outside the
    /// grid or where a node of the triangle is NaN (unknown).
    pub fn surface_at(&self, p: Point2<f64>) -> Option<(f64, [f64; 2])> {
        let grid = &self.grid;
        let u = (p.x - grid.origin.x) / grid.resolution;
        let v = (p.y - grid.origin.y) / grid.resolution;
        let (nx, ny) = (grid.nx.checked_sub(1)?, grid.ny.checked_sub(1)?);
        // The far edge belongs to the last square, and rounding there must not push p outside.
        let slack = 1e-9;
        if !(u >= -slack && v >= -slack && u <= nx as f64 + slack && v <= ny as f64 + slack) {
            return None;
        }
        let ix = (u.max(0.0) as usize).min(nx.checked_sub(1)?);
        let iy = (v.max(0.0) as usize).min(ny.checked_sub(1)?);
        let (fu, fv) = (u - ix as f64, v - iy as f64);
        let z = |dx: usize, dy: usize| f64::from(*self.at(ix + dx, iy + dy));
        let (z10, z01) = (z(1, 0), z(0, 1));
        let (base, du, dv, fu, fv) = if fu + fv <= 1.0 {
            let z00 = z(0, 0);
            (z00, z10 - z00, z01 - z00, fu, fv)
        } else {
            let z11 = z(1, 1);
            (z11, z11 - z01, z11 - z10, fu - 1.0, fv - 1.0)
        };
        let height = base + du * fu + dv * fv;
        height.is_finite().then_some((height, [du / grid.resolution, dv / grid.resolution]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid { origin: Point2::new(-1.0, 2.0), resolution: 0.5, nx: 5, ny: 4 }
    }

    #[test]
    fn a_plane_is_reproduced_everywhere_with_its_gradient() {
        let plane = Raster::from_fn(grid(), |ix, iy| {
            let p = grid().position(ix, iy);
            (0.25 * p.x - 0.5 * p.y + 3.0) as f32
        });
        for (x, y) in [(-1.0, 2.0), (0.13, 2.77), (0.9, 3.49), (1.0, 3.5)] {
            let (z, [zx, zy]) = plane.surface_at(Point2::new(x, y)).unwrap();
            assert!((z - (0.25 * x - 0.5 * y + 3.0)).abs() < 1e-12);
            assert!((zx - 0.25).abs() < 1e-12 && (zy + 0.5).abs() < 1e-12);
        }
        assert_eq!(plane.surface_at(Point2::new(1.1, 3.0)), None);
        assert_eq!(plane.surface_at(Point2::new(f64::NAN, 3.0)), None);
    }

    #[test]
    fn one_unknown_node_hides_only_its_own_triangles() {
        let mut raster = Raster::from_fn(grid(), |_, _| 1.0_f32);
        raster.values_mut()[0] = f32::NAN;
        assert_eq!(raster.surface_at(Point2::new(-0.9, 2.1)), None);
        assert!(raster.surface_at(Point2::new(-0.6, 2.4)).is_some(), "the upper triangle is known");
    }

    #[test]
    fn nodes_within_a_rectangle_are_those_inside_it() {
        let (xs, ys) = grid().nodes_within(Point2::new(-0.6, 1.0), Point2::new(0.5, 2.6));
        assert_eq!((xs, ys), (1..4, 0..2));
        let (xs, _) = grid().nodes_within(Point2::new(5.0, 0.0), Point2::new(6.0, 1.0));
        assert!(xs.is_empty());
    }

    #[test]
    fn nearest_is_the_cell_around_the_node() {
        assert_eq!(grid().nearest(Point2::new(-0.76, 2.24)), Some((0, 0)));
        assert_eq!(grid().nearest(Point2::new(-0.74, 2.26)), Some((1, 1)));
        assert_eq!(grid().nearest(Point2::new(-1.3, 2.0)), None);
    }
}
