//! Classes by what the ground may be, not only by what it looks like.

use geometry::Raster;

use super::{CAUTION, Layers, SAFE, UNKNOWN};
use crate::TerrainError;

impl Layers {
    /// Classes with step and slope as large as `k` standard deviations of the heights allow, 0 to 10. Stereo
    /// flattens edges as far as its noise reaches: a step of 0.12 m is seen 0.07 m high from 6 m away.
    ///
    /// `sigma_m` is on the grid of the layers (m), as [`Observed::sigma_m`](crate::fusion::Observed::sigma_m);
    /// where it is NaN, nothing is safe. A step adds the difference of two heights, a slope that over the foot.
    /// No class is ever better than in `self.class`.
    pub fn cautious_class(
        &self,
        sigma_m: &Raster<f32>,
        k: f64,
    ) -> Result<Raster<u8>, TerrainError> {
        TerrainError::check("k", k, [0.0, 10.0], "0 to 10 standard deviations")?;
        let grid = *self.class.grid();
        if *sigma_m.grid() != grid {
            let (found, expected) = (sigma_m.grid(), &grid);
            let (found, expected) = ([found.nx, found.ny], [expected.nx, expected.ny]);
            return Err(TerrainError::OtherGrid { what: "sigma_m", found, expected });
        }
        let class = |ix: usize, iy: usize| {
            let class = *self.class.at(ix, iy);
            if class == UNKNOWN {
                return UNKNOWN;
            }
            let sigma = f64::from(*sigma_m.at(ix, iy));
            if sigma.is_nan() {
                return class.min(CAUTION);
            }
            let more = k * std::f64::consts::SQRT_2 * sigma;
            let of = |layer: &Raster<f32>| f64::from(*layer.at(ix, iy));
            let slope = of(&self.slope_rad) + (more / self.footprint_m).atan();
            let [slope, roughness, step] =
                self.limits.goodness(slope, of(&self.roughness_m), of(&self.step_m) + more);
            let goodness = slope.min(roughness).min(step) as f32;
            // What may be bad is used with care; what looks bad is bad.
            let may_be = self.limits.class(goodness, *self.certainty.at(ix, iy));
            if may_be == SAFE { class } else { class.min(CAUTION) }
        };
        Ok(Raster::from_fn(grid, class))
    }
}
