//! Synthetic ground: fractal relief, craters and rocks, from a recipe and a seed.
//!
//! - *Relief*: spectral synthesis, amplitude falling as |k|^-(H + 1), scaled so that the RMS
//!   height difference over 1 m is the tangent of the recipe's slope (power law of exponent H).
//! - *Rocks*: the area covered by rocks of diameter D or more is `k exp(-q D)`,
//!   `q = 1.79 + 0.152 / k` (Golombek & Rapp 1997), Poisson in each bin of diameter.
//! - *Craters*: `0.0794 f / D²` per square meter larger than D (m), fresh to degraded.
//!
//! One seed gives the same ground every time; relief, rocks and craters draw from streams of their
//! own, so that changing one leaves the others as they were.

mod craters;
mod detail;
mod fft;
mod fractal;
mod recipe;
mod rocks;

use geometry::Raster;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::map::centered_grid;
use crate::{ElevationMap, Source, SourceKind, TerrainError};

pub use craters::Crater;
pub use detail::add_detail;
pub use recipe::Recipe;
pub use rocks::Rock;

/// Largest number of nodes that are generated.
pub const MAX_NODES: usize = 4200 * 4200;
/// Version of the generator: changes whenever the same recipe and seed give other ground.
pub const GENERATOR_VERSION: u32 = 1;
/// Largest number of rocks, and of craters.
const MAX_FEATURES: u64 = 2_000_000;

/// A synthetic map with what lies in it.
#[derive(Debug, Clone)]
pub struct SyntheticScene {
    /// The ground, rocks and craters included.
    pub map: ElevationMap,
    /// The rocks, largest first.
    pub rocks: Vec<Rock>,
    /// The craters, largest first.
    pub craters: Vec<Crater>,
}

/// The ground of a recipe, centered on the origin.
pub fn generate(recipe: &Recipe, seed: u64) -> Result<ElevationMap, TerrainError> {
    generate_scene(recipe, seed).map(|scene| scene.map)
}

/// As [`generate`], with the rocks and craters that were placed.
pub fn generate_scene(recipe: &Recipe, seed: u64) -> Result<SyntheticScene, TerrainError> {
    recipe.check()?;
    let grid = centered_grid(recipe.width_m, recipe.height_m, recipe.resolution_m)?;
    TerrainError::check_nodes(grid.len() as f64, MAX_NODES)?;
    let mut heights = fractal::relief(&grid, recipe, &mut stream(seed, 1));
    let craters = craters::place(&grid, recipe, &mut stream(seed, 2))?;
    craters.iter().for_each(|crater| crater.dig(&grid, &mut heights));
    let rocks = rocks::place(&grid, recipe, &mut stream(seed, 3))?;
    rocks::set(&rocks, &grid, &mut heights);
    let values = heights.iter().map(|z| *z as f32).collect();
    let heights = Raster::new(grid, values).expect("one height per node of the grid");
    let kind = SourceKind::Recipe { recipe: recipe.to_string(), seed };
    let map = ElevationMap::new(heights, Source { kind, synthetic_detail: true });
    Ok(SyntheticScene { map, rocks, craters })
}

/// One of the independent random streams of a seed.
fn stream(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

/// A uniform number in `[lo, hi)`.
fn uniform(rng: &mut ChaCha8Rng, lo: f64, hi: f64) -> f64 {
    lo + (hi - lo) * rng.random::<f64>()
}

/// A Poisson number of the given mean, as the sum of numbers of small mean (Knuth's product).
fn poisson(rng: &mut ChaCha8Rng, mean: f64) -> u64 {
    let (mut left, mut n) = (mean, 0);
    while left > 0.0 {
        let part = left.min(20.0);
        left -= part;
        let floor = (-part).exp();
        let mut product = rng.random::<f64>();
        while product > floor {
            n += 1;
            product *= rng.random::<f64>();
        }
    }
    n
}

/// Bins of diameter, from `min` to `max` (m), 2 % wide.
fn diameter_bins(min: f64, max: f64) -> impl Iterator<Item = (f64, f64)> {
    let n = ((max / min).ln() / 1.02_f64.ln()).ceil().max(1.0);
    let edge = move |i: u32| min * (max / min).powf(f64::from(i) / n);
    (0..n as u32).map(move |i| (edge(i), edge(i + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poisson_numbers_have_mean_and_variance_of_their_law() {
        let mut rng = stream(1, 0);
        for mean in [0.3, 4.0, 57.0] {
            let n = 20_000;
            let draws: Vec<f64> = (0..n).map(|_| poisson(&mut rng, mean) as f64).collect();
            let average = draws.iter().sum::<f64>() / f64::from(n);
            let variance = draws.iter().map(|d| (d - average).powi(2)).sum::<f64>() / f64::from(n);
            let sigma = (mean / f64::from(n)).sqrt();
            assert!((average - mean).abs() < 5.0 * sigma, "mean {average}, expected {mean}");
            assert!((variance / mean - 1.0).abs() < 0.06, "variance {variance}, expected {mean}");
        }
    }

    #[test]
    fn diameter_bins_cover_the_range_without_gaps() {
        let bins: Vec<_> = diameter_bins(0.05, 2.5).collect();
        assert!((bins[0].0 - 0.05).abs() < 1e-12 && (bins[bins.len() - 1].1 - 2.5).abs() < 1e-9);
        assert!(bins.windows(2).all(|pair| pair[0].1 == pair[1].0));
    }
}
