//! The largest 3 x 3 height range in each window of a block, by separable running maxima.

use std::borrow::Cow;

/// A block of heights, row-major, NaN = unknown.
#[derive(Clone)]
pub(super) struct Patch {
    pub width: usize,
    pub height: usize,
    pub z: Vec<f32>,
}

impl Patch {
    /// The first `len` cells of row `iy` within the patch's outermost cells.
    pub fn row(&self, iy: usize, len: usize) -> &[f32] {
        &self.z[(iy + 1) * self.width + 1..][..len]
    }

    /// What is at or beyond column `x` and row `y`.
    pub fn part(&self, x: usize, y: usize) -> Cow<'_, Patch> {
        if (x, y) == (0, 0) {
            return Cow::Borrowed(self);
        }
        let rows = self.z.chunks_exact(self.width).skip(y);
        let z = rows.flat_map(|row| &row[x..]).copied().collect();
        Cow::Owned(Patch { width: self.width - x, height: self.height - y, z })
    }
}

/// No 3 x 3 neighborhood of the window has two known neighbors of its center.
pub(super) const NO_STEP: f32 = f32::NEG_INFINITY;

fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// For each of the `(width - w - 1) x (height - w - 1)` windows that lie at least one cell inside
/// the patch, the largest 3 x 3 range of the cells of the window, or [`NO_STEP`].
pub(super) fn largest_ranges(patch: &Patch, w: usize) -> Vec<f32> {
    let ranges = ranges(patch);
    let (width, height) = (patch.width - 2, patch.height - 2);
    let rows = max_along_rows(ranges, width, w);
    max_along_columns(&rows, width + 1 - w, height, w)
}

/// Range of the 3 x 3 cells around each cell but the patch's outermost, or [`NO_STEP`] where fewer
/// than two of the eight neighbors are known.
fn ranges(patch: &Patch) -> Vec<f32> {
    let (width, height) = (patch.width - 2, patch.height - 2);
    let n = patch.width * patch.height;
    let (mut lo, mut hi) = (vec![0.0_f32; n], vec![0.0_f32; n]);
    let mut known = vec![0.0_f32; n];
    for (i, z) in patch.z.iter().enumerate() {
        let is_known = !z.is_nan();
        lo[i] = if is_known { *z } else { f32::INFINITY };
        hi[i] = if is_known { *z } else { f32::NEG_INFINITY };
        known[i] = if is_known { 1.0 } else { 0.0 };
    }
    let mut out = vec![0.0; width * height];
    let row = |v: &[f32], iy: usize| -> Vec<f32> { v[iy * patch.width..][..patch.width].to_vec() };
    let mut column_lo = vec![0.0; patch.width];
    let mut column_hi = vec![0.0; patch.width];
    let mut column_n = vec![0.0; patch.width];
    for iy in 0..height {
        let (l0, l1, l2) = (row(&lo, iy), row(&lo, iy + 1), row(&lo, iy + 2));
        let (h0, h1, h2) = (row(&hi, iy), row(&hi, iy + 1), row(&hi, iy + 2));
        let (n0, n1, n2) = (row(&known, iy), row(&known, iy + 1), row(&known, iy + 2));
        for x in 0..patch.width {
            column_lo[x] = min(min(l0[x], l1[x]), l2[x]);
            column_hi[x] = max(max(h0[x], h1[x]), h2[x]);
            column_n[x] = n0[x] + n1[x] + n2[x];
        }
        let out = &mut out[iy * width..][..width];
        for x in 0..width {
            let low = min(min(column_lo[x], column_lo[x + 1]), column_lo[x + 2]);
            let high = max(max(column_hi[x], column_hi[x + 1]), column_hi[x + 2]);
            let neighbors = column_n[x] + column_n[x + 1] + column_n[x + 2] - n1[x + 1];
            out[x] = if neighbors >= 2.0 { high - low } else { NO_STEP };
        }
    }
    out
}

/// Maximum of each run of `w` in every row, by doubling; rows get `w - 1` shorter.
fn max_along_rows(mut values: Vec<f32>, width: usize, w: usize) -> Vec<f32> {
    let out_width = width + 1 - w;
    let mut out = Vec::with_capacity(values.len() / width * out_width);
    let mut next = vec![0.0; width];
    for row in values.chunks_exact_mut(width) {
        let (mut run, mut len) = (1, width);
        while 2 * run <= w {
            len -= run;
            let (a, b) = (&row[..len], &row[run..][..len]);
            for ((next, a), b) in next[..len].iter_mut().zip(a).zip(b) {
                *next = max(*a, *b);
            }
            row[..len].copy_from_slice(&next[..len]);
            run *= 2;
        }
        let (a, b) = (&row[..out_width], &row[w - run..][..out_width]);
        out.extend(a.iter().zip(b).map(|(a, b)| max(*a, *b)));
    }
    out
}

/// Maximum of each run of `w` rows (van Herk: running maxima from both ends of segments of `w`).
fn max_along_columns(values: &[f32], width: usize, height: usize, w: usize) -> Vec<f32> {
    let mut from_start = values.to_vec();
    let mut from_end = values.to_vec();
    for iy in 1..height {
        if iy % w != 0 {
            let (above, row) = from_start.split_at_mut(iy * width);
            let above = &above[(iy - 1) * width..];
            for (v, a) in row[..width].iter_mut().zip(above) {
                *v = max(*v, *a);
            }
        }
    }
    for iy in (0..height - 1).rev() {
        if (iy + 1) % w != 0 {
            let (row, below) = from_end.split_at_mut((iy + 1) * width);
            for (v, b) in row[iy * width..].iter_mut().zip(&below[..width]) {
                *v = max(*v, *b);
            }
        }
    }
    let last = (w - 1) * width;
    from_end.iter().zip(&from_start[last..]).map(|(a, b)| max(*a, *b)).collect()
}
