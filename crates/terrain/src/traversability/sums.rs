//! Moments of the known cells of sliding windows.
//!
//! Six moments of each column of the window slide down the rows; ten sums over the window slide
//! along each row. Everything is in f64, in cells from the block's corner and in meters from a
//! height of the block, and starts anew in each block: nothing grows, and sums of counts and
//! coordinates are exact.

use super::step::Patch;

/// Number of sums over a window.
pub(super) const N_SUMS: usize = 10;
/// Windows along a row whose sums go on from each other.
const RUN: usize = 64;
/// Trust is counted in whole steps, so that its sums are exact.
const TRUST_STEPS: f32 = 65535.0;

/// Sums over each window along a row, in cells and meters: n, y, yy, z, yz, zz, xn, xxn, xy, xz.
pub(super) struct Sums {
    /// Number of windows.
    pub len: usize,
    /// A row for each sum.
    pub rows: [Vec<f64>; N_SUMS],
}

impl Sums {
    pub fn new(len: usize) -> Sums {
        Sums { len, rows: std::array::from_fn(|_| vec![0.0; len]) }
    }
}

/// Moments of each column over the rows of the window, y in cells from the row that entered last.
pub(super) struct Columns {
    half: usize,
    n: Vec<f64>,
    y: Vec<f64>,
    yy: Vec<f64>,
    z: Vec<f64>,
    yz: Vec<f64>,
    zz: Vec<f64>,
}

impl Columns {
    pub fn new(len: usize, half: usize) -> Columns {
        let zeros = || vec![0.0; len];
        let (n, y, yy, z, yz, zz) = (zeros(), zeros(), zeros(), zeros(), zeros(), zeros());
        Columns { half, n, y, yy, z, yz, zz }
    }

    /// Adds a row and moves y's origin to it.
    pub fn enter(&mut self, row: &[f32], reference: f64) {
        let len = row.len();
        let (n, y, yy) = (&mut self.n[..len], &mut self.y[..len], &mut self.yy[..len]);
        let (z, yz, zz) = (&mut self.z[..len], &mut self.yz[..len], &mut self.zz[..len]);
        for i in 0..len {
            let is_known = !row[i].is_nan();
            let known = if is_known { 1.0 } else { 0.0 };
            let height = if is_known { f64::from(row[i]) - reference } else { 0.0 };
            yy[i] += n[i] - 2.0 * y[i];
            y[i] -= n[i];
            yz[i] -= z[i];
            n[i] += known;
            z[i] += height;
            zz[i] += height * height;
        }
    }

    /// Removes the window's first row.
    pub fn leave(&mut self, row: &[f32], reference: f64) {
        let len = row.len();
        let (n, y, yy) = (&mut self.n[..len], &mut self.y[..len], &mut self.yy[..len]);
        let (z, yz, zz) = (&mut self.z[..len], &mut self.yz[..len], &mut self.zz[..len]);
        let back = 2.0 * self.half as f64;
        for i in 0..len {
            let is_known = !row[i].is_nan();
            let known = if is_known { 1.0 } else { 0.0 };
            let height = if is_known { f64::from(row[i]) - reference } else { 0.0 };
            n[i] -= known;
            y[i] += back * known;
            yy[i] -= back * back * known;
            z[i] -= height;
            yz[i] += back * height;
            zz[i] -= height * height;
        }
    }

    /// The sums over each window along the row, from window `first` on. They begin anew every
    /// [`RUN`] windows, so that a window's sums do not depend on how far the others go.
    pub fn window_sums(&self, out: &mut Sums, first: usize) {
        let w = 2 * self.half + 1;
        let column = |i: usize| -> [f64; N_SUMS] {
            let x = i as f64;
            let (n, y, z) = (self.n[i], self.y[i], self.z[i]);
            [n, y, self.yy[i], z, self.yz[i], self.zz[i], x * n, x * x * n, x * y, x * z]
        };
        for start in (first / RUN * RUN..out.len).step_by(RUN) {
            let mut sums = [0.0; N_SUMS];
            for i in start..start + w - 1 {
                let enters = column(i);
                (0..N_SUMS).for_each(|k| sums[k] += enters[k]);
            }
            for i in start..out.len.min(start + RUN) {
                let (enters, leaves) = (column(i + w - 1), column(i));
                for k in 0..N_SUMS {
                    sums[k] += enters[k];
                    out.rows[k][i] = sums[k];
                    sums[k] -= leaves[k];
                }
            }
        }
    }
}

/// Known cells of each column above and below the center row, and their sums along it.
pub(super) struct Quadrants {
    half: usize,
    low: Vec<u32>,
    high: Vec<u32>,
    low_sums: Vec<u32>,
    high_sums: Vec<u32>,
}

impl Quadrants {
    pub fn new(len: usize, half: usize) -> Quadrants {
        let (low, high) = (vec![0; len], vec![0; len]);
        Quadrants { half, low, high, low_sums: vec![0; len + 1], high_sums: vec![0; len + 1] }
    }

    /// Counts row `iy` of the first window but its last row, less the row that `slide` removes.
    pub fn enter(&mut self, row: &[f32], iy: usize) {
        let counts = if iy < self.half { &mut self.low } else { &mut self.high };
        add_known(counts, row, 1);
    }

    /// Moves the halves to the window that starts at row `iy`.
    pub fn slide<'a>(&mut self, iy: usize, row: &impl Fn(usize) -> &'a [f32]) {
        let half = self.half;
        if iy > 0 {
            add_known(&mut self.low, row(iy - 1), u32::MAX);
            add_known(&mut self.low, row(iy + half - 1), 1);
        }
        // `high` covers rows iy + half .. iy + 2 half here; drop the center row, take the last.
        add_known(&mut self.high, row(iy + half), u32::MAX);
        add_known(&mut self.high, row(iy + 2 * half), 1);
    }

    /// Sums along the row.
    pub fn sum(&mut self) {
        for (sums, counts) in [(&mut self.low_sums, &self.low), (&mut self.high_sums, &self.high)] {
            let mut sum = 0;
            for (to, count) in sums[1..].iter_mut().zip(counts) {
                sum += count;
                *to = sum;
            }
        }
    }

    /// Known cells of the least known quadrant of window `ix`.
    pub fn least(&self, ix: usize) -> f64 {
        let (left, right) = (ix..ix + self.half, ix + self.half + 1..ix + 2 * self.half + 1);
        let count = |sums: &[u32], xs: &std::ops::Range<usize>| sums[xs.end] - sums[xs.start];
        let low = count(&self.low_sums, &left).min(count(&self.low_sums, &right));
        let high = count(&self.high_sums, &left).min(count(&self.high_sums, &right));
        f64::from(low.min(high))
    }
}

/// Adds `amount` (1, or its wrapping negative) wherever the row is known.
fn add_known(counts: &mut [u32], row: &[f32], amount: u32) {
    for (count, z) in counts.iter_mut().zip(row) {
        *count = count.wrapping_add(if !z.is_nan() { amount } else { 0 });
    }
}

/// Sums of trust in the known cells of each window.
pub(super) struct Trusts {
    /// Trust in steps, row by row; 0 where the height is unknown.
    steps: Vec<u32>,
    w: usize,
    columns: Vec<u32>,
    certainty: Vec<f32>,
}

impl Trusts {
    /// Sums over patches of heights and of trust, 0 to 1, as [`Columns`] has them of heights.
    pub fn new(heights: &Patch, trust: &Patch, len: usize, w: usize) -> Trusts {
        let rows = (0..heights.height - 2).map(|iy| (heights.row(iy, len), trust.row(iy, len)));
        let steps = |(z, trust): (&f32, &f32)| {
            let steps = (trust.clamp(0.0, 1.0) * TRUST_STEPS + 0.5) as i32;
            if z.is_nan() { 0 } else { steps as u32 }
        };
        let steps = rows.flat_map(|(z, trust)| z.iter().zip(trust).map(steps)).collect();
        Trusts { steps, w, columns: vec![0; len], certainty: vec![0.0; len + 1 - w] }
    }

    /// Moves to the window that starts at row `iy`.
    pub fn slide(&mut self, iy: usize) {
        let len = self.columns.len();
        let first_entering = if iy == 0 { 0 } else { iy + self.w - 1 };
        for row in self.steps.chunks_exact(len).take(iy + self.w).skip(first_entering) {
            self.columns.iter_mut().zip(row).for_each(|(sum, steps)| *sum += steps);
        }
        if iy > 0 {
            let row = &self.steps[(iy - 1) * len..][..len];
            self.columns.iter_mut().zip(row).for_each(|(sum, steps)| *sum -= steps);
        }
    }

    /// The certainty of each window.
    pub fn certainty(&mut self) -> &[f32] {
        let w = self.w;
        let per_whole = 1.0 / (f64::from(TRUST_STEPS) * (w * w) as f64);
        let mut sum: u64 = self.columns[..w - 1].iter().map(|n| u64::from(*n)).sum();
        let ends = self.columns[w - 1..].iter().zip(&self.columns);
        for (certainty, (enters, leaves)) in self.certainty.iter_mut().zip(ends) {
            sum += u64::from(*enters);
            *certainty = (sum as i64 as f64 * per_whole) as f32;
            sum -= u64::from(*leaves);
        }
        &self.certainty
    }
}
