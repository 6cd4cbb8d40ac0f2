//! Classes by what the ground may be, not only by what it looks like.

use geometry::Raster;
use nalgebra::{Point2, Vector2};

use super::{CAUTION, CellExplanation, Layers, Limits, SAFE, UNKNOWN};
use crate::TerrainError;

/// What doubt of the heights makes of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Doubt {
    /// Standard deviations that count, k.
    pub sigmas: f64,
    /// Standard deviation of the height (m); NaN where there is none.
    pub sigma_m: f64,
    /// Step that may be there (m).
    pub step_m: f64,
    /// Slope that may be there (rad).
    pub slope_rad: f64,
    /// The class as the cell looks.
    pub class_as_seen: u8,
}

/// One cell as it looks.
struct AsSeen {
    class: u8,
    slope_rad: f64,
    roughness_m: f64,
    step_m: f64,
    certainty: f32,
}

impl AsSeen {
    /// Its class with so much doubt, and what that is made of.
    fn doubted(&self, sigma_m: f64, k: f64, footprint_m: f64, limits: &Limits) -> (u8, Doubt) {
        let more = k * std::f64::consts::SQRT_2 * sigma_m;
        let (step_m, slope_rad) =
            (self.step_m + more, self.slope_rad + (more / footprint_m).atan());
        let class_as_seen = self.class;
        let doubt = Doubt { sigmas: k, sigma_m, step_m, slope_rad, class_as_seen };
        if self.class == UNKNOWN {
            return (UNKNOWN, doubt);
        }
        if sigma_m.is_nan() {
            return (self.class.min(CAUTION), doubt);
        }
        let [slope, roughness, step] = limits.goodness(slope_rad, self.roughness_m, step_m);
        let goodness = slope.min(roughness).min(step) as f32;
        // What may be bad is used with care; what looks bad is bad.
        let may_be = limits.class(goodness, self.certainty);
        (if may_be == SAFE { self.class } else { self.class.min(CAUTION) }, doubt)
    }
}

fn check(k: f64) -> Result<f64, TerrainError> {
    TerrainError::check("k", k, [0.0, 10.0], "0 to 10 standard deviations")
}

impl Layers {
    /// Classes with step and slope as large as `k` standard deviations of the heights allow, 0 to 10. Stereo
    /// flattens edges as far as its noise reaches: a step of 0.12 m is seen 0.07 m high from 6 m away.
    ///
    /// `sigma_m` is on the grid of the layers (m), as [`Observed::sigma_m`](crate::fusion::Observed::sigma_m);
    /// where it is NaN, nothing is safe. The largest under the foot counts: a step is as unsure as the heights that make
    /// it. A step adds the difference of two heights, a slope that over the foot.
    /// No class is ever better than in `self.class`.
    pub fn cautious_class(
        &self,
        sigma_m: &Raster<f32>,
        k: f64,
    ) -> Result<Raster<u8>, TerrainError> {
        check(k)?;
        let grid = *self.class.grid();
        if *sigma_m.grid() != grid {
            let (found, expected) = (sigma_m.grid(), &grid);
            let (found, expected) = ([found.nx, found.ny], [expected.nx, expected.ny]);
            return Err(TerrainError::OtherGrid { what: "sigma_m", found, expected });
        }
        let worst = worst_about(sigma_m, self.window / 2);
        let class = |ix: usize, iy: usize| {
            let of = |layer: &Raster<f32>| f64::from(*layer.at(ix, iy));
            let seen = AsSeen {
                class: *self.class.at(ix, iy),
                slope_rad: of(&self.slope_rad),
                roughness_m: of(&self.roughness_m),
                step_m: of(&self.step_m),
                certainty: *self.certainty.at(ix, iy),
            };
            seen.doubted(of(&worst), k, self.footprint_m, &self.limits).0
        };
        Ok(Raster::from_fn(grid, class))
    }

    /// The layers with their classes replaced by those of [`Layers::cautious_class`]; all else is as it looks.
    /// [`Layers::update`] gives what it judges again its plain class.
    pub fn with_doubt(mut self, sigma_m: &Raster<f32>, k: f64) -> Result<Layers, TerrainError> {
        self.class = self.cautious_class(sigma_m, k)?;
        Ok(self)
    }
}

/// The largest known value within so many nodes along each axis; unknown where the node itself is.
fn worst_about(values: &Raster<f32>, half: usize) -> Raster<f32> {
    let grid = *values.grid();
    let around = |i: usize, n: usize| i.saturating_sub(half)..(i + half + 1).min(n);
    let largest = |all: &mut dyn Iterator<Item = f32>| all.fold(f32::NAN, f32::max);
    let rows = Raster::from_fn(grid, |ix, iy| {
        largest(&mut around(ix, grid.nx).map(|x| *values.at(x, iy)))
    });
    Raster::from_fn(grid, |ix, iy| match values.at(ix, iy) {
        own if own.is_nan() => f32::NAN,
        _ => largest(&mut around(iy, grid.ny).map(|y| *rows.at(ix, y))),
    })
}

impl CellExplanation {
    /// The largest of what is known at the nodes of its window; NaN where its own is not known. This is what counts as
    /// doubt in a cell: a step is as unsure as the heights that make it, wherever under the foot they are.
    pub fn worst(&self, known: impl Fn(Point2<f64>) -> f32) -> f32 {
        if known(self.position).is_nan() {
            return f32::NAN;
        }
        let half = self.window as i32 / 2;
        let nodes = (-half..=half).flat_map(|y| (-half..=half).map(move |x| Vector2::new(x, y)));
        let at = |node: Vector2<i32>| self.position + node.map(f64::from) * self.resolution_m;
        nodes.map(|node| known(at(node))).fold(f32::NAN, f32::max)
    }

    /// The class of [`Layers::cautious_class`] for this cell, and what it is made of; `None` where slope, roughness or
    /// step have no value, and the class stays what it is.
    pub fn doubted(&self, sigma_m: f64, k: f64) -> Result<Option<(u8, Doubt)>, TerrainError> {
        check(k)?;
        let (Some(slope), Some(roughness), Some(step)) =
            (self.slope_rad, self.roughness_m, self.step_m)
        else {
            return Ok(None);
        };
        let seen = AsSeen {
            class: self.class,
            // As the layers keep them.
            slope_rad: f64::from(slope as f32),
            roughness_m: f64::from(roughness as f32),
            step_m: f64::from(step as f32),
            certainty: self.certainty as f32,
        };
        let footprint_m = self.window as f64 * self.resolution_m;
        Ok(Some(seen.doubted(sigma_m, k, footprint_m, &self.limits)))
    }
}
