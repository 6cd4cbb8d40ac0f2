//! Fractal relief by spectral synthesis.
//!
//! The longest wave is about as long as the tile, so that exponents near 1, whose relief is mostly
//! in longer waves, come out lower over the tile: about 0.8 for 0.9; up to 0.7 within 0.1.

use std::f64::consts::TAU;

use geometry::Grid;
use rand_chacha::ChaCha8Rng;

use super::fft::{Complex, inverse_2d};
use super::{Recipe, uniform};

/// The relief of a recipe on a grid (m, row-major).
pub(super) fn relief(grid: &Grid, recipe: &Recipe, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let spectrum = Spectrum::new(grid, recipe.hurst, rng);
    let mut heights = spectrum.heights(|_| 1.0);
    let scale = scale_to_slope(grid, recipe, &heights);
    heights.iter_mut().for_each(|z| *z *= scale);
    heights
}

/// The part of the same relief with wavelengths under `longest_m` (m), faded in over one octave.
pub(super) fn relief_below(
    grid: &Grid,
    recipe: &Recipe,
    rng: &mut ChaCha8Rng,
    longest_m: f64,
) -> Vec<f64> {
    let spectrum = Spectrum::new(grid, recipe.hurst, rng);
    let scale = scale_to_slope(grid, recipe, &spectrum.heights(|_| 1.0));
    let fade = |wavelength: f64| {
        let octaves = (longest_m / wavelength).log2().clamp(0.0, 1.0);
        octaves * octaves * (3.0 - 2.0 * octaves)
    };
    let mut heights = spectrum.heights(fade);
    heights.iter_mut().for_each(|z| *z *= scale);
    heights
}

/// Random phases on a square that holds the grid.
struct Spectrum {
    grid: Grid,
    /// Nodes a side of the square, a power of two.
    n: usize,
    amplitudes: Vec<Complex>,
}

impl Spectrum {
    fn new(grid: &Grid, hurst: f64, rng: &mut ChaCha8Rng) -> Spectrum {
        // A square somewhat larger than the grid, so that opposite edges are not alike.
        let n = (grid.nx.max(grid.ny) * 17 / 16 + 1).next_power_of_two();
        let mut amplitudes = vec![(0.0, 0.0); n * n];
        for (i, amplitude) in amplitudes.iter_mut().enumerate() {
            let (sin, cos) = uniform(rng, 0.0, TAU).sin_cos();
            let k = cycles(i % n, n).hypot(cycles(i / n, n));
            if k > 0.0 {
                let size = k.powf(-hurst - 1.0);
                *amplitude = ((size * cos) as f32, (size * sin) as f32);
            }
        }
        Spectrum { grid: *grid, n, amplitudes }
    }

    /// The grid's heights, of no particular scale, with each wavelength (m) times `gain`.
    fn heights(&self, gain: impl Fn(f64) -> f64) -> Vec<f64> {
        let n = self.n;
        let side = n as f64 * self.grid.resolution;
        let mut values = self.amplitudes.clone();
        for (i, value) in values.iter_mut().enumerate() {
            let k = cycles(i % n, n).hypot(cycles(i / n, n));
            let gain = gain(side / k.max(1e-9)) as f32;
            *value = (value.0 * gain, value.1 * gain);
        }
        inverse_2d(&mut values, n);
        let rows = values.chunks_exact(n).take(self.grid.ny);
        rows.flat_map(|row| row[..self.grid.nx].iter().map(|v| f64::from(v.0))).collect()
    }
}

/// Signed cycles per side of frequency `i` of `n`.
fn cycles(i: usize, n: usize) -> f64 {
    if i <= n / 2 { i as f64 } else { i as f64 - n as f64 }
}

/// What to multiply heights by for the recipe's RMS difference over 1 m, or over the lag nearest
/// to it that the grid has, by the power law.
fn scale_to_slope(grid: &Grid, recipe: &Recipe, heights: &[f64]) -> f64 {
    let longest = (grid.nx.min(grid.ny) / 2).max(1) as f64;
    let lag = (1.0 / grid.resolution).round().clamp(1.0, longest);
    let wanted = recipe.slope_rms_at_1m_rad.tan() * (lag * grid.resolution).powf(recipe.hurst);
    let found = rms_difference(grid, heights, lag as usize);
    if found > 0.0 { wanted / found } else { 0.0 }
}

/// RMS height difference of nodes `lag` apart along x and along y.
fn rms_difference(grid: &Grid, heights: &[f64], lag: usize) -> f64 {
    let (mut sum, mut n) = (0.0, 0_u64);
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            let z = heights[grid.index(ix, iy)];
            for (x, y) in [(ix + lag, iy), (ix, iy + lag)] {
                if x < grid.nx && y < grid.ny {
                    sum += (heights[grid.index(x, y)] - z).powi(2);
                    n += 1;
                }
            }
        }
    }
    if n == 0 { 0.0 } else { (sum / n as f64).sqrt() }
}
