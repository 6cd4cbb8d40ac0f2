//! Disparities made finer by the gray values themselves.
//!
//! Semi-global matching counts in whole disparities, and paths come from above more than from below: on
//! ground that comes nearer from row to row its disparities lag behind, by a fifth of a pixel and all in one
//! direction. Here the right image is drawn through the disparities as they are, and over a window
//! about each pixel the one shift is found that makes it the left one best (Lucas and Kanade 1981, along
//! the row). As each pixel of the window keeps its own disparity, slant and edges do no harm. Means of the
//! windows are left out, so that cameras may differ in brightness.

use std::sync::Mutex;

use super::{Disparity, HOLE, PARTS};
use crate::StereoError;
use crate::image::GrayImage;

/// How disparities are made finer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// Half the side of the window (px), 1 to 16.
    pub half: usize,
    /// Rounds, 0 to 10; none leaves the disparities as they are.
    pub rounds: usize,
    /// Least RMS gradient of a window that tells anything (gray levels a pixel).
    pub gradient_min: f32,
    /// Largest change in all (px), up to 2.
    pub change_max: f32,
}

impl Default for Refinement {
    fn default() -> Refinement {
        Refinement { half: 4, rounds: 3, gradient_min: 1.0, change_max: 0.5 }
    }
}

/// Rows that are done at once.
const BAND_ROWS: usize = 64;
/// Neighbors of a pixel that differ by more than this (px) lie on another surface.
const SAME_SURFACE: f32 = 1.0;

impl Refinement {
    fn check(&self) -> Result<(), StereoError> {
        let check = StereoError::check;
        check("half", self.half as f64, [1.0, 16.0], "1 to 16 px")?;
        check("rounds", self.rounds as f64, [0.0, 10.0], "0 to 10")?;
        check("gradient_min", self.gradient_min.into(), [1e-3, 255.0], "0.001 to 255")?;
        check("change_max", self.change_max.into(), [0.0, 2.0], "0 to 2 px").map(|_| ())
    }
}

/// Makes the disparities of a rectified pair finer. What is a hole stays one. Any number of threads gives
/// the same bits. `stop` is asked before each round.
pub fn refine(
    left: &GrayImage,
    right: &GrayImage,
    disparity: &mut Disparity,
    how: &Refinement,
    threads: usize,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(), StereoError> {
    how.check()?;
    StereoError::check("threads", threads as f64, [1.0, 64.0], "1 to 64")?;
    for (what, image) in [("left image", left), ("right image", right)] {
        if image.size() != disparity.size {
            let (image, calibration) = (image.size(), disparity.size);
            return Err(StereoError::SizeMismatch { what, image, calibration });
        }
    }
    if how.rounds == 0 {
        return Ok(());
    }
    let width = disparity.size.width;
    let coarse = disparity.values();
    let mut now = coarse.clone();
    for _ in 0..how.rounds {
        if stop() {
            return Err(StereoError::Stopped);
        }
        let rough = std::mem::replace(&mut now, vec![f32::NAN; coarse.len()]);
        by_bands(width, &mut now, threads, &|first, band| smooth(width, &rough, first, band));
        let mut next = now.clone();
        by_bands(width, &mut next, threads, &|first, band| {
            Window { left, right, now: &now, how }.shift(first, band);
        });
        now = next;
    }
    let limit = how.change_max;
    for ((parts, from), to) in disparity.parts.iter_mut().zip(&coarse).zip(&now) {
        if *parts != HOLE {
            let to = to.clamp(from - limit, from + limit).max(0.0);
            *parts = (to * f32::from(PARTS)).round() as i16;
        }
    }
    Ok(())
}

/// Does bands of whole rows, in any order.
fn by_bands(
    width: usize,
    values: &mut [f32],
    threads: usize,
    work: &(dyn Fn(usize, &mut [f32]) + Sync),
) {
    let bands = Mutex::new(values.chunks_mut(BAND_ROWS * width).enumerate());
    let run = || {
        loop {
            let next = bands.lock().map(|mut bands| bands.next());
            let Ok(Some((i, band))) = next else { return };
            work(i * BAND_ROWS, band);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(run);
        }
        run();
    });
}

/// The mean of the 5 x 5 pixels about each on the same surface: single pixels' noise is no slant.
fn smooth(width: usize, coarse: &[f32], first: usize, band: &mut [f32]) {
    let height = coarse.len() / width;
    for (row, out) in band.chunks_exact_mut(width).enumerate() {
        let y = first + row;
        for (x, out) in out.iter_mut().enumerate() {
            let middle = coarse[y * width + x];
            if middle.is_nan() {
                continue;
            }
            // Only whole pairs across the middle, which a slant does not pull to one side.
            let (mut sum, mut n) = (middle, 1.0_f32);
            for k in 0..12 {
                let (dx, dy) = (k % 5, k / 5);
                let (a, b) = ((x + dx, y + dy), (x + 4 - dx, y + 4 - dy));
                let at = |(x, y): (usize, usize)| {
                    let inside = (2..width + 2).contains(&x) && (2..height + 2).contains(&y);
                    if inside { coarse[(y - 2) * width + x - 2] } else { f32::NAN }
                };
                let (a, b) = (at(a), at(b));
                if (a - middle).abs() <= SAME_SURFACE && (b - middle).abs() <= SAME_SURFACE {
                    sum += a + b;
                    n += 2.0;
                }
            }
            *out = sum / n;
        }
    }
}

/// One round.
struct Window<'a> {
    left: &'a GrayImage,
    right: &'a GrayImage,
    now: &'a [f32],
    how: &'a Refinement,
}

/// What is summed over windows: 1, e, g, e g, g g of residual e and gradient g.
const SUMS: usize = 5;

impl Window<'_> {
    /// Shifts the disparities of the rows from `first` on.
    fn shift(&self, first: usize, band: &mut [f32]) {
        let size = self.left.size();
        let (width, half) = (size.width, self.how.half);
        let rows = band.len() / width;
        let (from, to) = (first.saturating_sub(half), (first + rows + half).min(size.height));
        // Of each row its terms; then sums over the columns of windows, then along the rows.
        let terms: Vec<[Vec<f32>; SUMS]> = (from..to).map(|y| self.terms(y)).collect();
        let padded = width + 2 * half;
        let mut columns: [Vec<f32>; SUMS] = std::array::from_fn(|_| vec![0.0; padded]);
        let mut sums: [Vec<f32>; SUMS] = std::array::from_fn(|_| vec![0.0; width]);
        let window = ((2 * half + 1) * (2 * half + 1)) as f32;
        let least = self.how.gradient_min * self.how.gradient_min;
        for (row, out) in band.chunks_exact_mut(width).enumerate() {
            let y = first + row;
            let (low, high) = (y.saturating_sub(half).max(from), (y + half + 1).min(to));
            for k in 0..SUMS {
                let column = &mut columns[k][half..][..width];
                column.fill(0.0);
                for terms in &terms[low - from..high - from] {
                    for (sum, term) in column.iter_mut().zip(&terms[k]) {
                        *sum += term;
                    }
                }
                let sum = &mut sums[k];
                sum.fill(0.0);
                for dx in 0..=2 * half {
                    for (sum, column) in sum.iter_mut().zip(&columns[k][dx..]) {
                        *sum += column;
                    }
                }
            }
            let [n, e, g, eg, gg] = &sums;
            for (x, out) in out.iter_mut().enumerate() {
                let n = n[x];
                let power = gg[x] - g[x] * g[x] / n;
                if n >= 0.3 * window && power >= least * n {
                    let shift = -(eg[x] - e[x] * g[x] / n) / power;
                    *out += shift.clamp(-0.5, 0.5);
                }
            }
        }
    }

    /// The terms of a row.
    fn terms(&self, y: usize) -> [Vec<f32>; SUMS] {
        let width = self.left.size().width;
        let mut terms: [Vec<f32>; SUMS] = std::array::from_fn(|_| vec![0.0; width]);
        let (left, right) = (self.left.row(y), self.right.row(y));
        let now = &self.now[y * width..][..width];
        for x in 1..width.saturating_sub(1) {
            // A hole compares false.
            let at = x as f32 - now[x];
            if !(at >= 1.0 && at < (width - 2) as f32) {
                continue;
            }
            let i = at as usize;
            let t = at - i as f32;
            let [a, b, c, d] = [i - 1, i, i + 1, i + 2].map(|i| f32::from(right[i]));
            // Catmull and Rom's cubic and its slope.
            let (p, q, r) =
                (0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d, 0.5 * (d - a) + 1.5 * (b - c));
            let seen = b + t * (p + t * (q + t * r));
            let slope = p + t * (2.0 * q + t * 3.0 * r);
            let own = 0.5 * (f32::from(left[x + 1]) - f32::from(left[x - 1]));
            let (e, g) = (f32::from(left[x]) - seen, 0.5 * (slope + own));
            for (sum, term) in terms.iter_mut().zip([1.0, e, g, e * g, g * g]) {
                sum[x] = term;
            }
        }
        terms
    }
}
