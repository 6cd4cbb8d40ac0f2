//! Small craters: a parabolic bowl, a raised rim and ejecta.

use geometry::Grid;
use nalgebra::Point2;
use rand_chacha::ChaCha8Rng;

use super::{MAX_FEATURES, Recipe, diameter_bins, poisson, uniform};
use crate::TerrainError;

/// Craters larger than 1 m per square meter of mature lunar ground: 10^-1.1.
const DENSITY_AT_1M: f64 = 0.079_432_823_472_428_15;
/// Depth over diameter of a fresh crater, and of the most degraded one.
const DEPTH_SHARE: [f64; 2] = [0.2, 0.05];
/// Rim height over diameter of a fresh crater; it fades with the depth.
const RIM_SHARE: f64 = 0.036;
/// Where ejecta end, in crater radii.
const REACH: f64 = 3.0;

/// A crater.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crater {
    /// Its center (m).
    pub center: Point2<f64>,
    /// Diameter of its rim (m).
    pub diameter_m: f64,
    /// From rim to floor (m).
    pub depth_m: f64,
}

/// The craters of a recipe that touch the grid, largest first.
pub(super) fn place(
    grid: &Grid,
    recipe: &Recipe,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<Crater>, TerrainError> {
    let (min, max) = (recipe.crater_diameter_min_m, recipe.crater_diameter_max_m);
    let (near, far) = (grid.origin, grid.far_corner());
    let number = |lo: f64, hi: f64| {
        let margin = 0.5 * REACH * hi;
        let area = (far.x - near.x + 2.0 * margin) * (far.y - near.y + 2.0 * margin);
        (area * recipe.crater_density * DENSITY_AT_1M * (lo.powi(-2) - hi.powi(-2)), margin)
    };
    let expected: f64 = diameter_bins(min, max).map(|(lo, hi)| number(lo, hi).0).sum();
    if expected > MAX_FEATURES as f64 {
        return Err(TerrainError::TooManyFeatures { what: "craters", expected, max: MAX_FEATURES });
    }
    let mut craters = Vec::new();
    for (lo, hi) in diameter_bins(min, max) {
        let (mean, margin) = number(lo, hi);
        for _ in 0..poisson(rng, mean) {
            let center = Point2::new(
                uniform(rng, near.x - margin, far.x + margin),
                uniform(rng, near.y - margin, far.y + margin),
            );
            let diameter_m = uniform(rng, lo, hi);
            let depth_m = diameter_m * uniform(rng, DEPTH_SHARE[1], DEPTH_SHARE[0]);
            let crater = Crater { center, diameter_m, depth_m };
            let from_center = nalgebra::distance(&center, &nalgebra::center(&near, &far));
            let is_clear = recipe.flat_center_m <= 0.0
                || from_center - crater.reach_m() > recipe.flat_center_m;
            if is_clear {
                craters.push(crater);
            }
        }
    }
    craters.sort_by(|a, b| b.diameter_m.total_cmp(&a.diameter_m));
    Ok(craters)
}

impl Crater {
    /// Radius of all ground it changes (m).
    pub fn reach_m(&self) -> f64 {
        0.5 * REACH * self.diameter_m
    }

    /// What it adds to the ground at distance `r` (m) from its center (m).
    pub fn height_at(&self, r: f64) -> f64 {
        let rho = 2.0 * r / self.diameter_m;
        let rim = RIM_SHARE / DEPTH_SHARE[0] * self.depth_m;
        if rho < 1.0 {
            return rim - self.depth_m * (1.0 - rho * rho);
        }
        // Ejecta fall with the cube of the distance, shifted to end at their reach.
        let end = REACH.powi(-3);
        rim * ((rho.powi(-3) - end) / (1.0 - end)).max(0.0)
    }

    /// Adds the crater to the ground (m, row-major).
    pub(super) fn dig(&self, grid: &Grid, heights: &mut [f64]) {
        let reach = nalgebra::Vector2::repeat(self.reach_m());
        let (xs, ys) = grid.nodes_within(self.center - reach, self.center + reach);
        for iy in ys {
            for ix in xs.clone() {
                let r = nalgebra::distance(&grid.position(ix, iy), &self.center);
                heights[grid.index(ix, iy)] += self.height_at(r);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fresh_crater_has_the_proportions_of_the_literature() {
        let crater = Crater { center: Point2::origin(), diameter_m: 10.0, depth_m: 2.0 };
        assert!((crater.height_at(5.0) - 0.36).abs() < 1e-12, "rim of 0.036 D");
        assert!((crater.height_at(5.0) - crater.height_at(0.0) - 2.0).abs() < 1e-12, "0.2 D deep");
        assert_eq!(crater.height_at(15.0), 0.0);
        assert!((crater.height_at(5.0 - 1e-9) - crater.height_at(5.0)).abs() < 1e-8);
    }
}
