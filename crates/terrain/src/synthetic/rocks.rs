//! Rocks by their size-frequency distribution, as half-buried super-ellipsoids.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use geometry::Grid;
use nalgebra::Point2;
use rand_chacha::ChaCha8Rng;

use super::{MAX_FEATURES, Recipe, diameter_bins, poisson, uniform};
use crate::TerrainError;

/// Share of a rock's vertical extent that is below the ground.
const BURIED: f64 = 0.3;

/// A rock: a super-ellipsoid, `(u/a)² + (v/b)²` = ρ² in plan and `ρ^p + (w/c)^p = 1` upward, turned
/// by its yaw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rock {
    /// Its center in plan (m).
    pub center: Point2<f64>,
    /// Diameter of the circle of the same area in plan (m).
    pub diameter_m: f64,
    /// Height of its top over the ground at its center (m).
    pub height_m: f64,
    /// Longer over shorter horizontal semi-axis, 1 or more.
    pub elongation: f64,
    /// Direction of the longer one, counter-clockwise from x (rad).
    pub yaw_rad: f64,
    /// Exponent p: 2 is an ellipsoid, more is boxier.
    pub exponent: f64,
}

/// Decay q (1/m) of the covered share with diameter, for abundance `k`.
fn decay(k: f64) -> f64 {
    1.79 + 0.152 / k
}

/// Number of rocks larger than `d` (m) per square meter: the integral of the covered share's
/// density over the area of one rock.
fn number_above(k: f64, d: f64) -> f64 {
    let q = decay(k);
    4.0 * k * q / PI * ((-q * d).exp() / d - q * exponential_integral(q * d))
}

/// E1(x) for x > 0: its series up to 1, its continued fraction (by Lentz) above.
fn exponential_integral(x: f64) -> f64 {
    const EULER: f64 = 0.577_215_664_901_532_9;
    if x <= 1.0 {
        let (mut sum, mut term) = (-EULER - x.ln(), -1.0);
        for n in 1..60 {
            term *= -x / f64::from(n);
            sum += term / f64::from(n);
        }
        return sum;
    }
    let mut b = x + 1.0;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for n in 1..200 {
        let a = -f64::from(n * n);
        b += 2.0;
        d = 1.0 / (a * d + b);
        c = b + a / c;
        fraction *= c * d;
    }
    fraction * (-x).exp()
}

/// The rocks of a recipe that touch the grid, largest first.
pub(super) fn place(
    grid: &Grid,
    recipe: &Recipe,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<Rock>, TerrainError> {
    let k = recipe.rock_abundance;
    if k <= 0.0 {
        return Ok(Vec::new());
    }
    let (min, max) = (recipe.rock_diameter_min_m, recipe.rock_diameter_max_m);
    let (near, far) = (grid.origin, grid.far_corner());
    let area = |margin: f64| (far.x - near.x + 2.0 * margin) * (far.y - near.y + 2.0 * margin);
    let expected = area(max) * (number_above(k, min) - number_above(k, max));
    if expected > MAX_FEATURES as f64 {
        return Err(TerrainError::TooManyFeatures { what: "rocks", expected, max: MAX_FEATURES });
    }
    let mut rocks = Vec::new();
    for (lo, hi) in diameter_bins(min, max) {
        let margin = hi;
        let density = number_above(k, lo) - number_above(k, hi);
        for _ in 0..poisson(rng, area(margin) * density) {
            let rock = Rock {
                center: Point2::new(
                    uniform(rng, near.x - margin, far.x + margin),
                    uniform(rng, near.y - margin, far.y + margin),
                ),
                diameter_m: uniform(rng, lo, hi),
                height_m: 0.0,
                elongation: uniform(rng, 1.0, 1.5),
                yaw_rad: uniform(rng, 0.0, TAU),
                exponent: uniform(rng, 2.0, 4.0),
            };
            let rock = Rock { height_m: rock.diameter_m * uniform(rng, 0.3, 0.7), ..rock };
            let from_center = nalgebra::distance(&rock.center, &nalgebra::center(&near, &far));
            let is_clear =
                recipe.flat_center_m <= 0.0 || from_center - rock.reach_m() > recipe.flat_center_m;
            if is_clear {
                rocks.push(rock);
            }
        }
    }
    rocks.sort_by(|a, b| b.diameter_m.total_cmp(&a.diameter_m));
    Ok(rocks)
}

impl Rock {
    /// The horizontal semi-axes (m), longer first.
    pub fn semi_axes_m(&self) -> [f64; 2] {
        let stretch = self.elongation.sqrt();
        [0.5 * self.diameter_m * stretch, 0.5 * self.diameter_m / stretch]
    }

    /// Radius of the circle around the center that holds the rock in plan (m).
    pub fn reach_m(&self) -> f64 {
        self.semi_axes_m()[0]
    }

    /// Area in plan (m²).
    pub fn area_m2(&self) -> f64 {
        FRAC_PI_4 * self.diameter_m * self.diameter_m
    }

    /// Height of the rock's upper surface over the ground at its center (m); `None` beside it.
    pub fn top_at(&self, p: Point2<f64>) -> Option<f64> {
        let d = p - self.center;
        let (sin, cos) = self.yaw_rad.sin_cos();
        let [a, b] = self.semi_axes_m();
        let rho2 = ((cos * d.x + sin * d.y) / a).powi(2) + ((cos * d.y - sin * d.x) / b).powi(2);
        if rho2 >= 1.0 {
            return None;
        }
        // The vertical semi-axis and how far its center is above the ground.
        let c = 0.5 * self.height_m / (1.0 - BURIED);
        let rise = self.height_m - c;
        Some(rise + c * (1.0 - rho2.powf(0.5 * self.exponent)).powf(1.0 / self.exponent))
    }
}

/// Sets the rocks on the ground as it is under them (m, row-major); unknown ground stays unknown.
pub(super) fn set(rocks: &[Rock], grid: &Grid, heights: &mut [f64]) {
    let bare = heights.to_vec();
    for rock in rocks {
        let at = |v: f64, n: usize| v.round().clamp(0.0, n as f64 - 1.0) as usize;
        let center = (rock.center - grid.origin) / grid.resolution;
        let ground = bare[grid.index(at(center.x, grid.nx), at(center.y, grid.ny))];
        let reach = nalgebra::Vector2::repeat(rock.reach_m());
        let (xs, ys) = grid.nodes_within(rock.center - reach, rock.center + reach);
        for iy in ys {
            for ix in xs.clone() {
                let Some(top) = rock.top_at(grid.position(ix, iy)) else { continue };
                let z = &mut heights[grid.index(ix, iy)];
                if ground + top > *z {
                    *z = ground + top;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_integral_has_its_tabled_values() {
        // Abramowitz & Stegun, tables 5.1 and 5.2.
        for (x, expected) in [(0.5, 0.559_773_595), (1.0, 0.219_383_934), (2.0, 0.048_900_511)] {
            assert!((exponential_integral(x) - expected).abs() < 1e-9, "E1({x})");
        }
    }

    #[test]
    fn number_above_is_the_integral_of_the_covered_share() {
        let (k, d) = (0.06, 0.1);
        let q = 1.79 + 0.152 / k;
        let dx = 1e-4;
        let density = |x: f64| 4.0 * k * q / (PI * x * x) * (-q * x).exp();
        let sum: f64 = (0..100_000).map(|i| density(d + dx * (f64::from(i) + 0.5)) * dx).sum();
        assert!((number_above(k, d) / sum - 1.0).abs() < 1e-4);
    }

    #[test]
    fn a_rock_is_as_high_at_its_center_and_as_large_in_plan_as_it_says() {
        let rock = Rock {
            center: Point2::new(1.0, -2.0),
            diameter_m: 0.8,
            height_m: 0.4,
            elongation: 1.4,
            yaw_rad: 0.7,
            exponent: 3.0,
        };
        assert!((rock.top_at(rock.center).unwrap() - 0.4).abs() < 1e-12);
        let step = 0.002;
        let inside = (-400..400)
            .flat_map(|i| (-400..400).map(move |j| (f64::from(i), f64::from(j))))
            .filter(|(i, j)| rock.top_at(Point2::new(1.0 + step * i, -2.0 + step * j)).is_some());
        let area = inside.count() as f64 * step * step;
        let expected = PI * 0.4 * 0.4;
        assert!((area / expected - 1.0).abs() < 0.01, "area {area}, expected {expected}");
    }
}
