//! A version of the map: immutable, named by its content, its tiles shared with other versions.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, OnceLock};

use geometry::{Grid, Raster};
use nalgebra::Point2;

use super::{Cell, Flags, ReadPolicy, TILE, Tile};
use crate::traversability::Span;
use crate::{ElevationMap, MAX_NODES, Source, TerrainError};

/// Lattice indices go from minus to plus this.
pub(super) const INDEX_MAX: i32 = 1 << 24;

/// Which tile: column and row; tile (0, 0) begins at node (0, 0) of the lattice.
pub type TileIndex = [i32; 2];

/// Name of a version: the hash of its content. Shown as its first 16 hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VersionId(pub [u8; 32]);

impl fmt::Display for VersionId {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.0[..8].iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// A version of the map.
#[derive(Debug, Clone)]
pub struct MapVersion {
    resolution_m: f64,
    pub(super) tiles: BTreeMap<TileIndex, Arc<Tile>>,
    id: OnceLock<VersionId>,
}

/// What differs between two versions.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Changes {
    /// Tiles that differ, with the number of cells in each that do.
    pub tiles: Vec<(TileIndex, usize)>,
    /// Cells that differ.
    pub cells: usize,
    /// Cells whose ground became known to planners (by the default policy).
    pub appeared: usize,
    /// Cells whose ground is known to planners no longer.
    pub vanished: usize,
}

/// What planners are given.
#[derive(Debug, Clone)]
pub struct Observed {
    /// Heights; unknown where the policy gives nothing.
    pub map: ElevationMap,
    /// How far each known cell is to be trusted, 0 to 1 (see [`MapVersion::elevation`]).
    pub trust: Raster<f32>,
    /// Standard deviation of each known height at its capture (m); NaN elsewhere.
    pub sigma_m: Raster<f32>,
    /// The same against ground beside it ([`Cell::noise_m2`]): what steps and slopes are off by.
    pub noise_m: Raster<f32>,
}

impl Changes {
    /// The changed tiles as spans of a grid that [`MapVersion::elevation`] gave, for
    /// [`Layers::update`](crate::traversability::Layers::update). `None` if a changed tile lies outside:
    /// then the map has grown, and its layers are made anew.
    pub fn spans(&self, grid: &Grid) -> Option<Vec<Span>> {
        let first = [grid.origin.x, grid.origin.y].map(|v| (v / grid.resolution).round() as i64);
        let n = TILE as i64;
        let along = |index: i32, first: i64, n_cells: usize| {
            let start = usize::try_from(i64::from(index) * n - first).ok()?;
            (start + TILE <= n_cells).then_some(start..start + TILE)
        };
        let span = |([x, y], _): &(TileIndex, usize)| {
            Some(Span { xs: along(*x, first[0], grid.nx)?, ys: along(*y, first[1], grid.ny)? })
        };
        self.tiles.iter().map(span).collect()
    }
}

impl MapVersion {
    /// A map of which nothing is known.
    pub fn empty(resolution_m: f64) -> MapVersion {
        MapVersion { resolution_m, tiles: BTreeMap::new(), id: OnceLock::new() }
    }

    /// Its name.
    pub fn id(&self) -> VersionId {
        *self.id.get_or_init(|| {
            let mut hasher = blake3::Hasher::new();
            hasher.update(b"footfall map 2");
            hasher.update(&self.resolution_m.to_bits().to_le_bytes());
            for (index, tile) in &self.tiles {
                hasher.update(&index[0].to_le_bytes());
                hasher.update(&index[1].to_le_bytes());
                hasher.update(tile.hash());
            }
            VersionId(*hasher.finalize().as_bytes())
        })
    }

    /// Distance of the nodes (m).
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The tiles that hold anything, by index.
    pub fn tiles(&self) -> impl Iterator<Item = (&TileIndex, &Arc<Tile>)> {
        self.tiles.iter()
    }

    /// The cell at a lattice index.
    pub fn cell(&self, index: [i32; 2]) -> Cell {
        let (tile, [x, y]) = locate(index);
        self.tiles.get(&tile).map_or(Cell::UNKNOWN, |tile| tile.cell(x, y))
    }

    /// The cell that holds a place (m); `None` where the place is beyond the lattice.
    pub fn cell_at(&self, p: Point2<f64>) -> Option<Cell> {
        let index = [p.x, p.y].map(|v| (v / self.resolution_m).round());
        let fits = index.iter().all(|i| i.abs() <= f64::from(INDEX_MAX));
        fits.then(|| self.cell(index.map(|i| i as i32)))
    }

    /// Variance of a cell's height at a time (m²): age adds `growth_m2_s` for each second.
    pub fn variance_at(cell: &Cell, now_ns: i64, growth_m2_s: f64) -> f64 {
        let age_s = now_ns.saturating_sub(cell.time_ns).max(0) as f64 * 1e-9;
        f64::from(cell.variance_m2) + growth_m2_s * age_s
    }

    /// The height that a policy gives of a cell (m); NaN for nothing.
    pub fn read(cell: &Cell, policy: ReadPolicy) -> f32 {
        // What hides a place where a wheel stood does not change its height.
        let is_masked = cell.flags.any(Flags::MASKED) && !cell.flags.any(Flags::CONTACT);
        let is_refused = (is_masked && !policy.use_masked)
            || (cell.flags.any(Flags::CONFLICT) && !policy.use_conflicts)
            || (cell.flags.any(Flags::PRIOR) && !policy.use_prior);
        match &cell.rival {
            _ if is_refused => f32::NAN,
            Some(rival) => cell.height_m.max(rival.height_m),
            None => cell.height_m,
        }
    }

    /// The map for planners at a time on the on-board clock, over the tiles that hold anything.
    ///
    /// Trust in a cell is `min(1, observations / 4) exp(-age / tau_s)`; it enters the certainty of
    /// traversability. A place where a wheel stood counts as seen often enough. As age is part of it, layers
    /// can be judged again for changed tiles only ([`Changes::spans`]) between maps of one time. Refused if it would
    /// have more than [`MAX_NODES`] nodes, or no tile.
    pub fn elevation(
        &self,
        policy: ReadPolicy,
        now_ns: i64,
        tau_s: f64,
        source: Source,
    ) -> Result<Observed, TerrainError> {
        TerrainError::check("tau_s", tau_s, [1e-3, f64::MAX], "a time over 0 s")?;
        let ends = |axis: usize| {
            let along = self.tiles.keys().map(|index| index[axis]);
            along.clone().min().zip(along.max())
        };
        let (Some((x0, x1)), Some((y0, y1))) = (ends(0), ends(1)) else {
            return Err(TerrainError::NoKnownHeight);
        };
        let n = |low: i32, high: i32| (high - low) as usize * TILE + TILE;
        let (nx, ny) = (n(x0, x1), n(y0, y1));
        TerrainError::check_nodes(nx as f64 * ny as f64, MAX_NODES)?;
        let at = |i: i32| self.resolution_m * f64::from(i) * TILE as f64;
        let origin = Point2::new(at(x0), at(y0));
        let grid = Grid { origin, resolution: self.resolution_m, nx, ny };
        let unknown = vec![f32::NAN; grid.len()];
        let mut heights = Raster::new(grid, unknown).ok_or(TerrainError::NoKnownHeight)?;
        let mut trust = Raster::from_fn(grid, |_, _| 0.0_f32);
        let mut sigma_m = Raster::from_fn(grid, |_, _| f32::NAN);
        let mut noise_m = sigma_m.clone();
        for (index, tile) in &self.tiles {
            let first = [(index[0] - x0) as usize * TILE, (index[1] - y0) as usize * TILE];
            for y in 0..TILE {
                for x in 0..TILE {
                    let cell = tile.cell(x, y);
                    let height = MapVersion::read(&cell, policy);
                    if height.is_nan() {
                        continue;
                    }
                    let seen = if cell.flags.any(Flags::CONTACT) { 4 } else { cell.count };
                    let age_s = now_ns.saturating_sub(cell.time_ns).max(0) as f64 * 1e-9;
                    let often = (f64::from(seen) / 4.0).min(1.0);
                    let i = grid.index(first[0] + x, first[1] + y);
                    heights.values_mut()[i] = height;
                    sigma_m.values_mut()[i] = f64::from(cell.variance_m2).sqrt() as f32;
                    noise_m.values_mut()[i] = cell.noise_m2().sqrt() as f32;
                    trust.values_mut()[i] = (often * (-age_s / tau_s).exp()) as f32;
                }
            }
        }
        Ok(Observed { map: ElevationMap::new(heights, source), trust, sigma_m, noise_m })
    }

    /// What differs from an older version. Tiles that both share are not looked into.
    pub fn changes_since(&self, before: &MapVersion) -> Changes {
        let mut changes = Changes::default();
        let unknown = Arc::new(Tile::default());
        let mut indices: Vec<_> = self.tiles.keys().chain(before.tiles.keys()).collect();
        indices.sort_unstable();
        indices.dedup();
        for index in indices {
            let of = |map: &MapVersion| map.tiles.get(index).unwrap_or(&unknown).clone();
            let (new, old) = (of(self), of(before));
            if Arc::ptr_eq(&new, &old) || new.hash() == old.hash() {
                continue;
            }
            let n_before = changes.cells;
            for y in 0..TILE {
                for x in 0..TILE {
                    let (new, old) = (new.cell(x, y), old.cell(x, y));
                    changes.cells += usize::from(!is_same(&new, &old));
                    let is_known = |c: &Cell| !MapVersion::read(c, ReadPolicy::default()).is_nan();
                    changes.appeared += usize::from(is_known(&new) && !is_known(&old));
                    changes.vanished += usize::from(!is_known(&new) && is_known(&old));
                }
            }
            if changes.cells > n_before {
                changes.tiles.push((*index, changes.cells - n_before));
            }
        }
        changes
    }

    /// The tile, to be changed: copied first if another version shares it. A new one beyond `most` is
    /// refused before memory is taken for it.
    pub(super) fn tile_mut(
        &mut self,
        index: TileIndex,
        most: usize,
    ) -> Result<&mut Tile, TerrainError> {
        if self.tiles.len() >= most && !self.tiles.contains_key(&index) {
            let n_tiles = self.tiles.len() + 1;
            return Err(TerrainError::TooManyTiles { n_tiles, tiles_max: most });
        }
        self.id = OnceLock::new();
        Ok(Arc::make_mut(self.tiles.entry(index).or_default()))
    }
}

/// The tile of a lattice index, and where in it.
pub(super) fn locate([ix, iy]: [i32; 2]) -> (TileIndex, [usize; 2]) {
    let n = TILE as i32;
    ([ix.div_euclid(n), iy.div_euclid(n)], [ix.rem_euclid(n) as usize, iy.rem_euclid(n) as usize])
}

fn is_same(a: &Cell, b: &Cell) -> bool {
    let float = |a: f32, b: f32| a == b || (a.is_nan() && b.is_nan());
    float(a.height_m, b.height_m)
        && float(a.variance_m2, b.variance_m2)
        && float(a.common_m2, b.common_m2)
        && float(a.repeated_m2, b.repeated_m2)
        && a.views == b.views
        && float(a.lower_m, b.lower_m)
        && (a.count, a.time_ns, a.source, a.flags) == (b.count, b.time_ns, b.source, b.flags)
        && (a.masked_ns, a.rival) == (b.masked_ns, b.rival)
}
