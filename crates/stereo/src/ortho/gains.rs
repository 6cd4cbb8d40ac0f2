//! One gain for each view, so that views agree where they show the same ground.

use nalgebra::{DMatrix, DVector};

use super::Shown;

/// Standard deviation of gray values. Brown and Lowe take 10, which would leave a sixth of a difference.
const GRAY_SIGMA: f64 = 2.0;
/// Standard deviation of gains (Brown and Lowe: 0.1).
const GAIN_SIGMA: f64 = 0.1;
/// No gain is beyond this.
const GAIN_RANGE: [f64; 2] = [0.25, 4.0];

/// The gains g that make least
/// ½ Σᵢⱼ Nᵢⱼ ((gᵢ Iᵢⱼ - gⱼ Iⱼᵢ)² / σ_N² + (1 - gᵢ)² / σ_g²), with Nᵢⱼ the number of places that both i and j show and Iᵢⱼ the mean
/// gray value of i there: where that is stationary. A view without common ground keeps 1.
pub(super) fn gains(shown: &[Shown<'_>]) -> Vec<f64> {
    let n = shown.len();
    let mut matrix = DMatrix::<f64>::zeros(n, n);
    let mut right = DVector::<f64>::zeros(n);
    let (for_gray, for_gain) = (GRAY_SIGMA.powi(-2), GAIN_SIGMA.powi(-2));
    for (i, one) in shown.iter().enumerate() {
        for (j, two) in shown.iter().enumerate() {
            if i == j {
                continue;
            }
            let (mut count, mut mine, mut other) = (0.0, 0.0, 0.0);
            for (a, b) in one.gray.iter().zip(&two.gray) {
                if !(a.is_nan() || b.is_nan()) {
                    count += 1.0;
                    mine += f64::from(*a);
                    other += f64::from(*b);
                }
            }
            if count == 0.0 {
                continue;
            }
            let (mine, other) = (mine / count, other / count);
            // Each pair of views stands in the sum twice: as (i, j) and as (j, i).
            matrix[(i, i)] += count * (2.0 * mine * mine * for_gray + for_gain);
            matrix[(i, j)] -= count * 2.0 * mine * other * for_gray;
            right[i] += count * for_gain;
        }
        if matrix[(i, i)] == 0.0 {
            (matrix[(i, i)], right[i]) = (1.0, 1.0);
        }
    }
    let [low, high] = GAIN_RANGE;
    match matrix.cholesky() {
        Some(solver) => solver.solve(&right).iter().map(|gain| gain.clamp(low, high)).collect(),
        None => vec![1.0; n],
    }
}
