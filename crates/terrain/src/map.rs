//! The elevation map: an immutable height raster with its pyramid and its origin.

use std::sync::{Arc, OnceLock};

use geometry::{Grid, MaxPyramid, Raster};
use nalgebra::{Point2, Unit, Vector3};

use crate::plane::{Moments, normal_of};
use crate::{ReferenceSystem, TerrainError};

/// Largest number of nodes of a map, where nothing smaller is asked for.
pub const MAX_NODES: usize = 64_000_000;
/// Half side of the plane that a scene gets by default (m).
pub const PLANE_HALF_EXTENT_M: f64 = 20.0;
/// Resolution of the plane that a scene gets by default (m).
pub const PLANE_RESOLUTION_M: f64 = 0.5;

/// Largest share of unknown points under a footprint that still has a plane.
const FOOTPRINT_UNKNOWN_MAX: f64 = 0.4;
/// Points a side at which a footprint finer than the grid samples the surface.
const FOOTPRINT_LATTICE: usize = 5;

/// Where a map came from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// What it was made from.
    pub kind: SourceKind,
    /// True if foot-scale detail was made up by the generator: no plan for real ground may rest
    /// on it.
    pub synthetic_detail: bool,
}

/// What a map was made from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourceKind {
    /// The flat plane z = 0.
    Plane,
    /// A file, by the name it was given under.
    File {
        /// The name.
        name: String,
    },
    /// A synthetic terrain.
    Recipe {
        /// The recipe as text, with the generator's version.
        recipe: String,
        /// The seed.
        seed: u64,
    },
    /// Another map with generated detail on top.
    Detailed {
        /// The map below.
        base: Box<SourceKind>,
        /// The recipe of the detail as text, with the generator's version.
        recipe: String,
        /// The seed.
        seed: u64,
    },
}

impl Source {
    /// The flat plane.
    pub fn plane() -> Source {
        Source { kind: SourceKind::Plane, synthetic_detail: false }
    }

    /// A file of that name.
    pub fn file(name: impl Into<String>) -> Source {
        Source { kind: SourceKind::File { name: name.into() }, synthetic_detail: false }
    }
}

/// The plane that fits the ground under a square foot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootprintPlane {
    /// Height of the plane at the asked point (m).
    pub height: f64,
    /// Upward normal of the plane.
    pub normal: Unit<Vector3<f64>>,
    /// RMS distance of the ground from the plane (m).
    pub roughness: f64,
    /// Share of the points under the foot whose height is known, 0.6 to 1.
    pub known_share: f64,
}

/// Ground heights in a local `world` frame (z up, m). Immutable; a clone shares the heights.
#[derive(Debug, Clone)]
pub struct ElevationMap {
    ground: Arc<Ground>,
    source: Source,
    placement: Placement,
}

/// Where a map's local frame lies in the coordinates of its source.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Placement {
    /// What to add to local coordinates to get those of the source (m).
    pub offset: Vector3<f64>,
    /// What the coordinates of the source are; none where the source does not say.
    pub system: Option<Arc<ReferenceSystem>>,
}

#[derive(Debug)]
struct Ground {
    heights: Raster<f32>,
    pyramid: MaxPyramid,
    holes: OnceLock<Option<MaxPyramid>>,
    version: OnceLock<u64>,
}

impl ElevationMap {
    /// A map of the heights (m, NaN = unknown). Infinite heights count as unknown.
    pub fn new(mut heights: Raster<f32>, source: Source) -> ElevationMap {
        for z in heights.values_mut() {
            if !z.is_finite() {
                *z = f32::NAN;
            }
        }
        let pyramid = MaxPyramid::new(&heights);
        let ground =
            Arc::new(Ground { heights, pyramid, holes: OnceLock::new(), version: OnceLock::new() });
        ElevationMap { ground, source, placement: Placement::default() }
    }

    /// The flat plane z = 0 around the origin; both lengths in meters.
    pub fn plane(half_extent_m: f64, resolution_m: f64) -> Result<ElevationMap, TerrainError> {
        let grid = centered_grid(2.0 * half_extent_m, 2.0 * half_extent_m, resolution_m)?;
        Ok(ElevationMap::new(Raster::from_fn(grid, |_, _| 0.0), Source::plane()))
    }

    /// The same heights as coming from `source`.
    pub fn with_source(self, source: Source) -> ElevationMap {
        ElevationMap { source, ..self }
    }

    /// The same heights with another offset to the source's coordinates (m).
    pub fn with_frame_offset(self, offset: Vector3<f64>) -> ElevationMap {
        let placement = Placement { offset, ..self.placement };
        ElevationMap { placement, ..self }
    }

    /// The same heights in a frame that lies so in the coordinates of a source.
    pub fn with_placement(self, placement: Placement) -> ElevationMap {
        ElevationMap { placement, ..self }
    }

    /// Where the nodes lie.
    pub fn grid(&self) -> &Grid {
        self.ground.heights.grid()
    }

    /// Height of each node (m, NaN = unknown).
    pub fn heights(&self) -> &Raster<f32> {
        &self.ground.heights
    }

    /// The pyramid of highest ground.
    pub fn pyramid(&self) -> &MaxPyramid {
        &self.ground.pyramid
    }

    /// Where heights are unknown: a pyramid of 1 at unknown nodes and 0 at known ones; none where all
    /// are known.
    pub fn holes(&self) -> Option<&MaxPyramid> {
        let find = || {
            let heights = &self.ground.heights;
            heights.values().iter().any(|z| z.is_nan()).then(|| {
                let flag = |ix, iy| f32::from(u8::from(heights.at(ix, iy).is_nan()));
                MaxPyramid::new(&Raster::from_fn(*heights.grid(), flag))
            })
        };
        self.ground.holes.get_or_init(find).as_ref()
    }

    /// Where the map came from.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// What to add to local coordinates to get those of the source (m). Zero unless the source's
    /// origin was far away or the map was moved.
    pub fn frame_offset(&self) -> Vector3<f64> {
        self.placement.offset
    }

    /// Where its frame lies in the coordinates of the source, and what those are.
    pub fn placement(&self) -> &Placement {
        &self.placement
    }

    /// Height of the triangulated surface (m); `None` outside the map and where it is unknown.
    pub fn height_at(&self, p: Point2<f64>) -> Option<f64> {
        self.surface_at(p).map(|(height, _)| height)
    }

    /// Height (m) and gradient (dz/dx, dz/dy) of the triangulated surface; `None` outside the map
    /// and where it is unknown.
    pub fn surface_at(&self, p: Point2<f64>) -> Option<(f64, [f64; 2])> {
        self.ground.heights.surface_at(p)
    }

    /// Upward normal of the surface's triangle at `p`.
    pub fn normal_at(&self, p: Point2<f64>) -> Option<Unit<Vector3<f64>>> {
        self.surface_at(p).map(|(_, gradient)| normal_of(gradient))
    }

    /// The highest ground of all squares that the rectangle touches (m), never lower than the
    /// surface over it; negative infinity where nothing is known.
    pub fn max_over(&self, min: Point2<f64>, max: Point2<f64>) -> f64 {
        self.ground.pyramid.max_over(min, max)
    }

    /// The least-squares plane over the nodes in the square of side `width_m` (m) around `p`.
    ///
    /// Where the cells are so coarse that fewer than 3 x 3 nodes fall in it, over 5 x 5 points of
    /// the surface instead. `None` if more than 40 % of the points are unknown (outside the map
    /// counts as unknown), if the known ones lie on a line, or if `width_m` is not positive.
    pub fn footprint_plane(&self, p: Point2<f64>, width_m: f64) -> Option<FootprintPlane> {
        if !(p.x.is_finite() && p.y.is_finite() && width_m > 0.0 && width_m.is_finite()) {
            return None;
        }
        let grid = self.grid();
        let half = 0.5 * width_m;
        // Nodes of the endless lattice in the square, so that those off the map count as unknown.
        let ends = |p: f64, origin: f64| {
            let slack = 1e-9;
            let first = ((p - half - origin) / grid.resolution - slack).ceil();
            let last = ((p + half - origin) / grid.resolution + slack).floor();
            (first, last - first + 1.0)
        };
        let ((x0, columns), (y0, rows)) = (ends(p.x, grid.origin.x), ends(p.y, grid.origin.y));
        let mut moments = Moments::default();
        let reference = self.reference_near(p);
        let n_points = if columns < 3.0 || rows < 3.0 {
            let step = width_m / (FOOTPRINT_LATTICE - 1) as f64;
            for i in 0..FOOTPRINT_LATTICE * FOOTPRINT_LATTICE {
                let x = step * (i % FOOTPRINT_LATTICE) as f64 - half;
                let y = step * (i / FOOTPRINT_LATTICE) as f64 - half;
                if let Some(z) = self.height_at(Point2::new(p.x + x, p.y + y)) {
                    moments.add(x, y, z - reference);
                }
            }
            (FOOTPRINT_LATTICE * FOOTPRINT_LATTICE) as f64
        } else {
            let clip = |first: f64, count: f64, n: usize| {
                let n = n as f64;
                first.clamp(0.0, n) as usize..(first + count).clamp(0.0, n) as usize
            };
            let (xs, heights) = (clip(x0, columns, grid.nx), self.heights().values());
            for iy in clip(y0, rows, grid.ny) {
                let start = grid.position(xs.start, iy) - p;
                let row = &heights[grid.index(0, iy)..][xs.clone()];
                for (k, z) in row.iter().enumerate() {
                    if !z.is_nan() {
                        let x = start.x + grid.resolution * k as f64;
                        moments.add(x, start.y, f64::from(*z) - reference);
                    }
                }
            }
            columns * rows
        };
        let known_share = moments.n / n_points;
        if known_share < 1.0 - FOOTPRINT_UNKNOWN_MAX - 1e-9 {
            return None;
        }
        let plane = moments.fit(width_m)?;
        Some(FootprintPlane {
            height: plane.d + reference,
            normal: normal_of([plane.a, plane.b]),
            roughness: plane.roughness,
            known_share,
        })
    }

    /// A known height near `p` (m), so that moments lose no digits; 0 where none is near.
    fn reference_near(&self, p: Point2<f64>) -> f64 {
        let z = self.heights().nearest(p).filter(|z| !z.is_nan());
        z.map_or_else(|| self.height_at(p).unwrap_or(0.0), f64::from)
    }

    /// The map moved by `shift` (m). The offset to the source's coordinates follows.
    pub fn translated(&self, shift: Vector3<f64>) -> ElevationMap {
        let mut grid = *self.grid();
        grid.origin += shift.xy();
        let moved = |z: &f32| (f64::from(*z) + shift.z) as f32;
        let values = self.heights().values().iter().map(moved).collect();
        self.derived(grid, values).with_frame_offset(self.placement.offset - shift)
    }

    /// The nodes inside the square of side `width_m` (m) around `center`.
    pub fn cropped(&self, center: Point2<f64>, width_m: f64) -> Result<ElevationMap, TerrainError> {
        TerrainError::check("crop.width_m", width_m, [f64::MIN_POSITIVE, 1e12], "a width over 0")?;
        for value in [center.x, center.y] {
            TerrainError::check("crop.center", value, [-1e12, 1e12], "a finite position")?;
        }
        let slack = 1e-9 * self.grid().resolution;
        let half = nalgebra::Vector2::repeat(0.5 * width_m + slack);
        let (xs, ys) = self.grid().nodes_within(center - half, center + half);
        if xs.len() < 2 || ys.len() < 2 {
            return Err(TerrainError::CropTooSmall {
                x_m: center.x,
                y_m: center.y,
                width_m,
                nx: xs.len(),
                ny: ys.len(),
            });
        }
        let origin = self.grid().position(xs.start, ys.start);
        let grid = Grid { origin, nx: xs.len(), ny: ys.len(), ..*self.grid() };
        let row = |iy: usize| &self.heights().values()[iy * self.grid().nx..][xs.clone()];
        let values = ys.flat_map(row).copied().collect();
        Ok(self.derived(grid, values))
    }

    /// The surface sampled every `resolution_m` (m) from the same first node; unknown stays
    /// unknown. Coarser sampling than the map's own averages nothing.
    pub fn resampled(&self, resolution_m: f64) -> Result<ElevationMap, TerrainError> {
        let grid = self.resampled_grid(resolution_m)?;
        let heights = Raster::from_fn(grid, |ix, iy| {
            self.height_at(grid.position(ix, iy)).map_or(f32::NAN, |z| z as f32)
        });
        Ok(ElevationMap::new(heights, self.source.clone()).with_placement(self.placement.clone()))
    }

    /// The grid of [`Self::resampled`].
    pub(crate) fn resampled_grid(&self, resolution_m: f64) -> Result<Grid, TerrainError> {
        TerrainError::check("resolution_m", resolution_m, [1e-4, 1e6], "a length from 1e-4 m")?;
        let ratio = self.grid().resolution / resolution_m;
        let count = |n: usize| (n.saturating_sub(1) as f64 * ratio + 1e-9).floor() + 1.0;
        let (nx, ny) = (count(self.grid().nx), count(self.grid().ny));
        TerrainError::check_nodes(nx * ny, MAX_NODES)?;
        let (nx, ny) = (nx as usize, ny as usize);
        if nx < 2 || ny < 2 {
            return Err(TerrainError::TooFewNodes { nx, ny });
        }
        Ok(Grid { origin: self.grid().origin, resolution: resolution_m, nx, ny })
    }

    /// A hash (FNV-1a, 64 bits) of the grid and the heights: names a version of the ground. The
    /// same on every machine; where the map came from does not enter.
    pub fn version_hash(&self) -> u64 {
        *self.ground.version.get_or_init(|| {
            let grid = self.grid();
            let head = [grid.origin.x, grid.origin.y, grid.resolution].map(|v| (v + 0.0).to_bits());
            let heights = self.heights().values().iter();
            // All NaN are one unknown, and both zeros are one height.
            let bits = heights.map(|z| if z.is_nan() { u32::MAX } else { (z + 0.0).to_bits() });
            let words =
                head.into_iter().chain([grid.nx as u64, grid.ny as u64]).chain(bits.map(u64::from));
            words.fold(0xcbf2_9ce4_8422_2325, |hash: u64, word| {
                (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3)
            })
        })
    }

    /// A map of other heights of the same source in the same frame.
    fn derived(&self, grid: Grid, values: Vec<f32>) -> ElevationMap {
        let heights = Raster::new(grid, values).expect("one height per node of the grid");
        ElevationMap::new(heights, self.source.clone()).with_placement(self.placement.clone())
    }
}

/// A grid of `width` x `height` around the origin (m), both ends included.
pub(crate) fn centered_grid(
    width: f64,
    height: f64,
    resolution: f64,
) -> Result<Grid, TerrainError> {
    TerrainError::check("resolution_m", resolution, [1e-4, 1e6], "a length from 1e-4 to 1e6 m")?;
    let count = |field, extent: f64| {
        TerrainError::check(field, extent, [resolution, 1e9], "a length of one cell or more (m)")
            .map(|extent| (extent / resolution).round() + 1.0)
    };
    let (nx, ny) = (count("width_m", width)?, count("height_m", height)?);
    TerrainError::check_nodes(nx * ny, MAX_NODES)?;
    let origin = Point2::new(-0.5 * resolution * (nx - 1.0), -0.5 * resolution * (ny - 1.0));
    Ok(Grid { origin, resolution, nx: nx as usize, ny: ny as usize })
}
