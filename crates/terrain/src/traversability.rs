//! Where a foot can stand: slope, roughness and step under it, after Morphin.
//!
//! Around each cell the known cells of a square window as wide as the foot are judged: the slope
//! of their least-squares plane, its orthogonal RMS residual (roughness), and the largest height
//! difference in any 3 x 3 cells less what the plane itself explains (step). Each is mapped to
//! \[0, 1\] by a ramp; the worst of the three is the cell's *goodness*. *Certainty*, the known share
//! of the window, is apart from it: an imported map has one observation per cell and no age.
//!
//! A cell is *unknown* if too little of its window is known, also in any one quadrant: the foot of
//! a cliff hides behind its edge. Cells outside the map count as unknown.

mod block;
mod explain;
mod judge;
mod limits;
mod step;
mod sums;

use geometry::{Grid, Raster};

use crate::{ElevationMap, TerrainError};

pub use explain::{CellExplanation, explain_cell};
pub use limits::Limits;

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
    /// Known share of the window, 0 to 1.
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
}

/// Judges every cell of the map for a foot as wide as `footprint_m` (m).
pub fn traversability(
    map: &ElevationMap,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Layers, TerrainError> {
    limits.check()?;
    let window = Window::of(map, footprint_m)?;
    let resampled;
    let heights = if window.is_resampled {
        resampled = map.resampled(window.grid.resolution)?;
        resampled.heights()
    } else {
        map.heights()
    };
    let grid = window.grid;
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
    };
    block::fill(heights, window.cells, limits, &mut layers);
    Ok(layers)
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
