//! Where a foot can stand: slope, roughness and step under it, after Morphin.
//!
//! Around each cell the known cells of a square window as wide as the foot are judged: the slope
//! of their least-squares plane, its orthogonal RMS residual (roughness), and the largest height
//! difference in any 3 x 3 cells less what the plane itself explains (step). Each is mapped to
//! \[0, 1\] by a ramp; the worst of the three is the cell's *goodness*. *Certainty* is apart from it:
//! the sum of the trust in the known cells of the window, over the number of its cells. Trust, 0 to 1,
//! comes from number and age of observations ([`crate::fusion::MapVersion::elevation`]); an imported
//! map has full trust everywhere, so that its certainty is the known share. As a sum, certainty never
//! rises where cells are lost.
//!
//! A cell is *unknown* if too little of its window is known, also in any one quadrant: the foot of
//! a cliff hides behind its edge. Cells outside the map count as unknown.

mod block;
mod cautious;
mod explain;
mod judge;
mod limits;
mod step;
mod sums;

use geometry::{Grid, Raster};

use crate::{ElevationMap, TerrainError};

pub use block::Span;
pub use cautious::Doubt;
pub use explain::{CellExplanation, Component, explain_cell, explain_trusted_cell};
pub use limits::{Limits, RAMP_REASONS};

/// Class of a cell that is not known well enough.
pub const UNKNOWN: u8 = 0;
/// Class of a cell that is known to be bad.
pub const UNSAFE: u8 = 1;
/// Class of a cell to use with care.
pub const CAUTION: u8 = 2;
/// Class of a good cell.
pub const SAFE: u8 = 3;

/// Fewest cells a side of the window; coarser maps are resampled.
const WINDOW_MIN: f64 = 9.0;
/// Most cells a side of the window.
const WINDOW_MAX: f64 = 1023.0;

/// The answer for every cell, NaN where there is no value.
#[derive(Debug, Clone)]
pub struct Layers {
    /// Slope of the window's plane (rad).
    pub slope_rad: Raster<f32>,
    /// Orthogonal RMS residual of that plane (m).
    pub roughness_m: Raster<f32>,
    /// Largest 3 x 3 range, less the plane's own (m).
    pub step_m: Raster<f32>,
    /// Worst of the three ramps, 0 to 1; NaN where the class is unknown.
    pub goodness: Raster<f32>,
    /// Trust in the window's known cells over the number of its cells, 0 to 1.
    pub certainty: Raster<f32>,
    /// [`UNKNOWN`], [`UNSAFE`], [`CAUTION`] or [`SAFE`].
    pub class: Raster<u8>,
    /// Side of the window actually used (m): `window` cells.
    pub footprint_m: f64,
    /// Cells a side of the window, odd.
    pub window: usize,
    /// Distance of the cells of these layers (m).
    pub resolution_m: f64,
    /// Distance of the map's own cells (m). Larger than `resolution_m` if they were coarser than
    /// the footprint / 9 and so the map was resampled.
    pub source_resolution_m: f64,
    limits: Limits,
    has_trust: bool,
    /// Height from which each block's sums count (m).
    references: Vec<f32>,
}

impl Layers {
    /// The thresholds that were used.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Judges again what has to do with the changed cells of the map, and only that: afterwards the
    /// layers are those of the map as it is now, to the bit. Gives the number of cells judged.
    ///
    /// `map` and `trust` are to differ from those that were judged in the cells of `changed` only.
    /// Where the grid is another one, or the map is resampled, everything is judged anew.
    pub fn update(
        &mut self,
        map: &ElevationMap,
        trust: Option<&Raster<f32>>,
        changed: &[Span],
    ) -> Result<usize, TerrainError> {
        let is_resampled = self.resolution_m != self.source_resolution_m;
        let is_same = self.class.grid() == map.grid() && self.has_trust == trust.is_some();
        if is_resampled || !is_same {
            *self = judge(map, trust, self.footprint_m, &self.limits)?;
            return Ok(self.class.grid().len());
        }
        check_trust(map.grid(), trust)?;
        let (limits, window) = (self.limits, self.window);
        let ground = block::Ground { heights: map.heights(), trust };
        Ok(block::fill(&ground, window, &limits, self, Some(changed)))
    }

    /// Makes cells unknown.
    fn forget(&mut self, span: &Span) {
        let grid = *self.class.grid();
        for iy in span.ys.clone() {
            let row = grid.index(span.xs.start, iy)..grid.index(span.xs.end, iy);
            for layer in
                [&mut self.slope_rad, &mut self.roughness_m, &mut self.step_m, &mut self.goodness]
            {
                layer.values_mut()[row.clone()].fill(f32::NAN);
            }
            self.certainty.values_mut()[row.clone()].fill(0.0);
            self.class.values_mut()[row].fill(UNKNOWN);
        }
    }
}

/// Judges every cell of the map for a foot as wide as `footprint_m` (m), with full trust in what is
/// known.
pub fn traversability(
    map: &ElevationMap,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Layers, TerrainError> {
    judge(map, None, footprint_m, limits)
}

/// As [`traversability`], with trust in each cell of the map, 0 to 1, on the map's grid.
pub fn trusted_traversability(
    map: &ElevationMap,
    trust: &Raster<f32>,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Layers, TerrainError> {
    judge(map, Some(trust), footprint_m, limits)
}

fn judge(
    map: &ElevationMap,
    trust: Option<&Raster<f32>>,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Layers, TerrainError> {
    limits.check()?;
    check_trust(map.grid(), trust)?;
    let window = Window::of(map, footprint_m)?;
    let grid = window.grid;
    let (finer_heights, finer_trust);
    let ground = if window.is_resampled {
        finer_heights = map.resampled(grid.resolution)?;
        finer_trust = trust.map(|trust| {
            Raster::from_fn(grid, |ix, iy| trust.nearest(grid.position(ix, iy)).unwrap_or(0.0))
        });
        block::Ground { heights: finer_heights.heights(), trust: finer_trust.as_ref() }
    } else {
        block::Ground { heights: map.heights(), trust }
    };
    let mut layers = Layers {
        slope_rad: filled(grid, f32::NAN),
        roughness_m: filled(grid, f32::NAN),
        step_m: filled(grid, f32::NAN),
        goodness: filled(grid, f32::NAN),
        certainty: filled(grid, 0.0),
        class: filled(grid, UNKNOWN),
        footprint_m: window.cells as f64 * grid.resolution,
        window: window.cells,
        resolution_m: grid.resolution,
        source_resolution_m: map.grid().resolution,
        limits: *limits,
        has_trust: trust.is_some(),
        references: Vec::new(),
    };
    block::fill(&ground, window.cells, limits, &mut layers, None);
    Ok(layers)
}

/// Refuses trust on another grid than the map's, or outside 0 to 1.
fn check_trust(grid: &Grid, trust: Option<&Raster<f32>>) -> Result<(), TerrainError> {
    let Some(trust) = trust else { return Ok(()) };
    if trust.grid() != grid {
        let (found, expected) = (trust.grid(), grid);
        let (found, expected) = ([found.nx, found.ny], [expected.nx, expected.ny]);
        return Err(TerrainError::OtherGrid { what: "trust", found, expected });
    }
    match trust.values().iter().find(|t| !(0.0..=1.0).contains(*t)) {
        Some(t) => {
            TerrainError::check("trust", f64::from(*t), [0.0, 1.0], "a share from 0 to 1").map(drop)
        }
        None => Ok(()),
    }
}

fn filled<T: Copy>(grid: Grid, value: T) -> Raster<T> {
    Raster::new(grid, vec![value; grid.len()]).expect("one value per node of the grid")
}

/// The window of a footprint on a map.
pub(crate) struct Window {
    /// The cells it runs over.
    pub grid: Grid,
    /// Cells a side, odd.
    pub cells: usize,
    /// True if `grid` is finer than the map's own.
    pub is_resampled: bool,
}

impl Window {
    pub fn of(map: &ElevationMap, footprint_m: f64) -> Result<Window, TerrainError> {
        let expected = "a width from 0.001 m to 1000 m";
        TerrainError::check("footprint_m", footprint_m, [1e-3, 1e3], expected)?;
        let finest = footprint_m / WINDOW_MIN;
        let is_resampled = map.grid().resolution > finest * (1.0 + 1e-9);
        let grid = if is_resampled { map.resampled_grid(finest)? } else { *map.grid() };
        // The nearest odd number; a tie goes to the larger one.
        let cells = 2.0 * ((footprint_m / grid.resolution - 1.0) / 2.0 + 1e-9).round() + 1.0;
        if cells > WINDOW_MAX {
            return Err(TerrainError::OutOfRange {
                field: "footprint_m",
                value: footprint_m,
                expected: "a footprint of at most 1023 cells",
            });
        }
        Ok(Window { grid, cells: cells as usize, is_resampled })
    }
}
