//! A plain radix-2 Fourier transform, for spectral synthesis.

use std::f64::consts::TAU;

/// A complex number (re, im); f32 is plenty for heights that end up as f32.
pub(super) type Complex = (f32, f32);

/// Inverse transform (without 1/n) of `n` x `n` values, row-major, `n` a power of two, in place.
pub(super) fn inverse_2d(values: &mut [Complex], n: usize) {
    debug_assert!(n.is_power_of_two() && values.len() == n * n);
    let plan = Plan::new(n);
    for _ in 0..2 {
        values.chunks_exact_mut(n).for_each(|row| plan.inverse(row));
        transpose(values, n);
    }
}

/// The roots of unity of one length.
struct Plan {
    n: usize,
    roots: Vec<Complex>,
}

impl Plan {
    fn new(n: usize) -> Plan {
        let root = |i: usize| {
            let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
            (cos as f32, sin as f32)
        };
        Plan { n, roots: (0..n / 2).map(root).collect() }
    }

    fn inverse(&self, row: &mut [Complex]) {
        let n = self.n;
        if n < 2 {
            return;
        }
        let shift = usize::BITS - n.trailing_zeros();
        for i in 0..n {
            let j = i.reverse_bits() >> shift;
            if i < j {
                row.swap(i, j);
            }
        }
        let mut half = 1;
        while half < n {
            let stride = n / (2 * half);
            for group in row.chunks_exact_mut(2 * half) {
                let (low, high) = group.split_at_mut(half);
                for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                    let (c, s) = self.roots[k * stride];
                    let t = (b.0 * c - b.1 * s, b.0 * s + b.1 * c);
                    *b = (a.0 - t.0, a.1 - t.1);
                    *a = (a.0 + t.0, a.1 + t.1);
                }
            }
            half *= 2;
        }
    }
}

/// Transposes in tiles, so that both sides stay in cache.
fn transpose(values: &mut [Complex], n: usize) {
    const TILE: usize = 32;
    for y0 in (0..n).step_by(TILE) {
        for x0 in (y0..n).step_by(TILE) {
            for y in y0..(y0 + TILE).min(n) {
                for x in x0.max(y + 1)..(x0 + TILE).min(n) {
                    values.swap(y * n + x, x * n + y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_sum_that_defines_it() {
        let n = 8;
        let value = |i: usize| ((i * 7 % 11) as f32 - 5.0, (i * 5 % 13) as f32 - 6.0);
        let spectrum: Vec<Complex> = (0..n * n).map(value).collect();
        let mut values = spectrum.clone();
        inverse_2d(&mut values, n);
        for (at, got) in values.iter().enumerate() {
            let (x, y) = (at % n, at / n);
            let mut sum = (0.0, 0.0);
            for (i, (re, im)) in spectrum.iter().enumerate() {
                let turns = ((i % n) * x + (i / n) * y) as f64 / n as f64;
                let (sin, cos) = (TAU * turns).sin_cos();
                sum.0 += f64::from(*re) * cos - f64::from(*im) * sin;
                sum.1 += f64::from(*re) * sin + f64::from(*im) * cos;
            }
            let off = (f64::from(got.0) - sum.0).abs() + (f64::from(got.1) - sum.1).abs();
            assert!(off < 1e-3, "off by {off} at {at}");
        }
    }
}
