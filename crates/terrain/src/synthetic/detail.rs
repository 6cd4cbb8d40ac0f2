//! Foot-scale detail under a coarse map, such as an orbital elevation model.

use geometry::Raster;
use nalgebra::Point2;

use super::{MAX_NODES, Recipe, fractal, rocks, stream};
use crate::{ElevationMap, Source, SourceKind, TerrainError};

/// The map at `resolution_m` (m): its smooth surface (bicubic where 4 x 4 nodes are known, else
/// triangles), plus the recipe's relief at wavelengths under two of the map's cells, faded in over
/// one octave so that the map's own slopes stay, plus the recipe's rocks. Unknown stays unknown.
///
/// The recipe's extents, resolution and craters are not used; its flat center lies around the
/// map's center. Crop large maps first.
pub fn add_detail(
    macro_map: &ElevationMap,
    recipe: &Recipe,
    seed: u64,
    resolution_m: f64,
) -> Result<ElevationMap, TerrainError> {
    recipe.check()?;
    let macro_cell = macro_map.grid().resolution;
    let expected = "a length from 0.001 m to the map's own";
    TerrainError::check("resolution_m", resolution_m, [1e-3, macro_cell], expected)?;
    let grid = macro_map.resampled_grid(resolution_m)?;
    TerrainError::check_nodes(grid.len() as f64, MAX_NODES)?;
    let longest = 2.0 * macro_cell;
    let mut heights = fractal::relief_below(&grid, recipe, &mut stream(seed, 1), longest);
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            let p = grid.position(ix, iy);
            heights[grid.index(ix, iy)] += smooth_height(macro_map, p).unwrap_or(f64::NAN);
        }
    }
    let rocks = rocks::place(&grid, recipe, &mut stream(seed, 3))?;
    rocks::set(&rocks, &grid, &mut heights);
    let values = heights.iter().map(|z| *z as f32).collect();
    let heights = Raster::new(grid, values).expect("one height per node of the grid");
    let base = Box::new(macro_map.source().kind.clone());
    let kind = SourceKind::Detailed { base, recipe: recipe.to_string(), seed };
    let map = ElevationMap::new(heights, Source { kind, synthetic_detail: true });
    Ok(map.with_placement(macro_map.placement().clone()))
}

/// Height of the map's surface at `p` (m): Catmull-Rom through its nodes where it can be.
fn smooth_height(map: &ElevationMap, p: Point2<f64>) -> Option<f64> {
    let grid = map.grid();
    let from_origin = (p - grid.origin) / grid.resolution;
    let (u, v) = (from_origin.x, from_origin.y);
    let (ix, iy) = (u.floor(), v.floor());
    let fits = |i: f64, n: usize| i >= 1.0 && i + 2.0 < n as f64;
    if !(fits(ix, grid.nx) && fits(iy, grid.ny)) {
        return map.height_at(p);
    }
    let (wx, wy) = (weights(u - ix), weights(v - iy));
    let mut sum = 0.0;
    for (dy, wy) in wy.iter().enumerate() {
        for (dx, wx) in wx.iter().enumerate() {
            let z = *map.heights().at(ix as usize + dx - 1, iy as usize + dy - 1);
            sum += wx * wy * f64::from(z);
        }
    }
    if sum.is_nan() { map.height_at(p) } else { Some(sum) }
}

/// Catmull-Rom weights of four nodes at -1, 0, 1, 2, for `t` in 0 to 1.
fn weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}
