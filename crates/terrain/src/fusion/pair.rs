//! The elevation map of one camera pair.

use geometry::{Grid, Raster};
use nalgebra::{Point2, Point3, Vector2};

use super::{Correction, Flags};
use crate::{ElevationMap, MAX_NODES, TerrainError};

/// Heights of four nodes that differ by more than this times the resolution are not interpolated:
/// there is an edge between them.
const EDGE_RATIO: f32 = 1.0;

/// What one pair saw in one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairCell {
    /// Height of the (upper) surface (m); NaN where no ground was seen.
    pub height_m: f32,
    /// Height of the lower surface (m) where the cell shows two; NaN elsewhere.
    pub lower_m: f32,
    /// Variance of the height (m²).
    pub variance_m2: f32,
    /// Part of it that is one error for all that the pair sees, such as errors of its calibration (m²).
    pub common_m2: f32,
    /// Number of points.
    pub count: u16,
    /// [`Flags::ROBOT`], [`Flags::SHADOW_BAND`], [`Flags::MULTI`].
    pub flags: Flags,
}

impl PairCell {
    /// Nothing seen.
    pub const EMPTY: PairCell = PairCell {
        height_m: f32::NAN,
        lower_m: f32::NAN,
        variance_m2: f32::NAN,
        common_m2: 0.0,
        count: 0,
        flags: Flags::NONE,
    };

    /// True if ground was seen.
    pub fn is_ground(&self) -> bool {
        !self.height_m.is_nan()
    }
}

/// A rectangle of the lattice with what one pair saw in each cell.
#[derive(Debug, Clone, PartialEq)]
pub struct PairDem {
    resolution_m: f64,
    origin: [i32; 2],
    nx: usize,
    cells: Vec<PairCell>,
    view: u32,
}

impl PairDem {
    /// A DEM of `cells`, row by row along x from low to high y; node `origin` of the lattice first.
    /// `None` if their number is no multiple of `nx`, or their place is beyond the lattice.
    pub fn new(
        resolution_m: f64,
        origin: [i32; 2],
        nx: usize,
        cells: Vec<PairCell>,
    ) -> Option<PairDem> {
        let is_whole = nx > 0 && cells.len().is_multiple_of(nx) && !cells.is_empty();
        let limit = super::version::INDEX_MAX as i64;
        let near =
            |o: i32, n: usize| i64::from(o).abs() <= limit && i64::from(o) + n as i64 <= limit;
        let fits = is_whole
            && cells.len() <= MAX_NODES
            && near(origin[0], nx)
            && near(origin[1], cells.len() / nx);
        fits.then_some(PairDem { resolution_m, origin, nx, cells, view: 0 })
    }

    /// An imported map as seen with one standard deviation everywhere, resampled to the lattice.
    pub fn of_map(
        map: &ElevationMap,
        resolution_m: f64,
        sigma_m: f64,
    ) -> Result<PairDem, TerrainError> {
        TerrainError::check("resolution_m", resolution_m, [1e-3, 1e3], "a length from 0.001 m")?;
        TerrainError::check("sigma_m", sigma_m, [1e-6, 1e3], "a length from 1e-6 to 1000 m")?;
        let (near, far) = (map.grid().origin, map.grid().far_corner());
        let limit = f64::from(super::version::INDEX_MAX);
        let first = |v: f64| (v / resolution_m - 1e-9).ceil();
        let last = |v: f64| (v / resolution_m + 1e-9).floor();
        let (x0, y0, x1, y1) = (first(near.x), first(near.y), last(far.x), last(far.y));
        for value in [x0, y0, x1, y1] {
            let expected = "a map whose coordinates fit the lattice";
            TerrainError::check("map position (cells)", value, [-limit, limit], expected)?;
        }
        if x1 < x0 || y1 < y0 {
            return Err(TerrainError::TooFewNodes { nx: 0, ny: 0 });
        }
        let (nx, ny) = ((x1 - x0) as usize + 1, (y1 - y0) as usize + 1);
        TerrainError::check_nodes(nx as f64 * ny as f64, MAX_NODES)?;
        let mut cells = Vec::with_capacity(nx * ny);
        for iy in 0..ny {
            for ix in 0..nx {
                let p = Point2::new(x0 + ix as f64, y0 + iy as f64) * resolution_m;
                cells.push(map.height_at(p).map_or(PairCell::EMPTY, |z| PairCell {
                    height_m: z as f32,
                    lower_m: f32::NAN,
                    variance_m2: (sigma_m * sigma_m) as f32,
                    common_m2: 0.0,
                    count: 1,
                    flags: Flags::NONE,
                }));
            }
        }
        Ok(PairDem { resolution_m, origin: [x0 as i32, y0 as i32], nx, cells, view: 0 })
    }

    /// The same, seen from a view: what has the same number errs the same way each time. Give all that
    /// one camera pair sees one number; at least 32 in a row are told apart. All is view 0 unless told.
    #[must_use]
    pub fn seen_from(self, view: u32) -> PairDem {
        PairDem { view, ..self }
    }

    /// The view as one bit.
    pub(super) fn view_bit(&self) -> u32 {
        1 << (self.view % 32)
    }

    /// Distance of the nodes (m).
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Lattice index of its first node.
    pub fn origin(&self) -> [i32; 2] {
        self.origin
    }

    /// Cells along x and y.
    pub fn size(&self) -> [usize; 2] {
        [self.nx, self.cells.len() / self.nx]
    }

    /// All cells, row by row.
    pub fn cells(&self) -> &[PairCell] {
        &self.cells
    }

    /// The cell at a lattice index; empty outside.
    pub fn at(&self, [ix, iy]: [i32; 2]) -> PairCell {
        let [nx, ny] = self.size();
        let x = i64::from(ix) - i64::from(self.origin[0]);
        let y = i64::from(iy) - i64::from(self.origin[1]);
        if x < 0 || y < 0 || x >= nx as i64 || y >= ny as i64 {
            return PairCell::EMPTY;
        }
        self.cells[y as usize * nx + x as usize]
    }

    /// Cells with their lattice indices, row by row.
    pub fn indexed(&self) -> impl Iterator<Item = ([i32; 2], &PairCell)> {
        let (nx, [x0, y0]) = (self.nx, self.origin);
        self.cells
            .iter()
            .enumerate()
            .map(move |(i, cell)| ([x0 + (i % nx) as i32, y0 + (i / nx) as i32], cell))
    }

    /// Heights on a grid (m), NaN where no ground was seen.
    pub fn heights(&self) -> Raster<f32> {
        let [nx, ny] = self.size();
        let origin = Point2::from(self.origin.map(|i| f64::from(i) * self.resolution_m));
        let grid = Grid { origin, resolution: self.resolution_m, nx, ny };
        Raster::from_fn(grid, |ix, iy| self.cells[iy * nx + ix].height_m)
    }

    /// The DEM moved by a correction, on the same lattice.
    ///
    /// Heights are interpolated between four nodes of ground, but not across an edge: there, and
    /// where a node is missing, the nearest node's is taken. Without a shift in x, y or yaw the cells
    /// stay as they are but for their height.
    pub fn moved(&self, by: &Correction) -> PairDem {
        let lift = |cell: &PairCell| {
            let z = |h: f32| (f64::from(h) + by.translation_m.z) as f32;
            PairCell { height_m: z(cell.height_m), lower_m: z(cell.lower_m), ..*cell }
        };
        if by.translation_m.xy() == Vector2::zeros() && by.yaw_rad == 0.0 {
            return PairDem { cells: self.cells.iter().map(lift).collect(), ..self.clone() };
        }
        let c = self.resolution_m;
        let ([x0, y0], [x1, y1]) = self.moved_ends(by);
        let (nx, ny) = ((x1 - x0) as usize + 1, (y1 - y0) as usize + 1);
        let mut cells = Vec::with_capacity(nx * ny);
        for iy in y0..y0 + ny as i32 {
            for ix in x0..x0 + nx as i32 {
                let p = by.undo_xy(Point2::new(c * f64::from(ix), c * f64::from(iy))) / c;
                cells.push(lift(&self.sample(p)));
            }
        }
        PairDem { resolution_m: c, origin: [x0, y0], nx, cells, view: self.view }
    }

    /// Lattice indices of the first and the last cell.
    pub(super) fn ends(&self) -> ([i32; 2], [i32; 2]) {
        let ([x, y], [nx, ny]) = (self.origin, self.size());
        ([x, y], [x + nx as i32 - 1, y + ny as i32 - 1])
    }

    /// [`Self::ends`] after [`Self::moved`].
    pub(super) fn moved_ends(&self, by: &Correction) -> ([i32; 2], [i32; 2]) {
        let (low, high) = self.ends();
        if by.translation_m.xy() == Vector2::zeros() && by.yaw_rad == 0.0 {
            return (low, high);
        }
        let c = self.resolution_m;
        let corners = [low, [high[0], low[1]], [low[0], high[1]], high].map(|[x, y]| {
            let p = Point3::new(c * f64::from(x), c * f64::from(y), 0.0);
            by.apply(p).xy() / c
        });
        let limit = f64::from(super::version::INDEX_MAX);
        let end = |axis: usize, pick: fn(f64, f64) -> f64| {
            let along = corners.iter().map(|p| p[axis]);
            along.reduce(pick).unwrap_or(0.0).clamp(-limit, limit)
        };
        let low = [0, 1].map(|axis| end(axis, f64::min).floor() as i32);
        let high = [0, 1].map(|axis| end(axis, f64::max).ceil() as i32);
        (low, high)
    }

    /// The cell at a place between nodes (cells).
    fn sample(&self, p: Point2<f64>) -> PairCell {
        let nearest = self.at([p.x.round() as i32, p.y.round() as i32]);
        let (x, y) = (p.x.floor(), p.y.floor());
        let corner = |dx: i32, dy: i32| self.at([x as i32 + dx, y as i32 + dy]);
        let four = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        let is_plain = |cell: &PairCell| cell.is_ground() && cell.flags == Flags::NONE;
        let low = four.iter().map(|cell| cell.height_m).fold(f32::INFINITY, f32::min);
        let high = four.iter().map(|cell| cell.height_m).fold(f32::NEG_INFINITY, f32::max);
        if !four.iter().all(is_plain) || high - low > EDGE_RATIO * self.resolution_m as f32 {
            return nearest;
        }
        let (u, v) = (p.x - x, p.y - y);
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let mean = |of: fn(&PairCell) -> f32| -> f32 {
            let sum: f64 = four.iter().zip(weights).map(|(c, w)| w * f64::from(of(c))).sum();
            sum as f32
        };
        PairCell {
            height_m: mean(|cell| cell.height_m),
            // Neighbors share their errors, so averaging is not taken to reduce them.
            variance_m2: mean(|cell| cell.variance_m2),
            common_m2: mean(|cell| cell.common_m2),
            ..nearest
        }
    }
}
