//! The paths, row by row.

use pulp::{Arch, Simd, WithSimd};

use super::census::{BITS, CensusRow, count};
use super::{HOLE, Matching, PARTS};
use crate::image::GrayImage;

/// Rows above a band from which its paths start: what is farther changes next to nothing.
const WARM_ROWS: usize = 24;

/// Matches the rows of `band`, the first of which is row `first` of the image. False once stopped.
pub(super) fn match_band(
    left: &GrayImage,
    right: &GrayImage,
    how: &Matching,
    first: usize,
    band: &mut [i16],
    stop: &dyn Fn() -> bool,
) -> bool {
    match how.disparities.div_ceil(32) {
        1 => Arch::new().dispatch(Band::<32> { left, right, how, first, band, stop }),
        2 => Arch::new().dispatch(Band::<64> { left, right, how, first, band, stop }),
        3 => Arch::new().dispatch(Band::<96> { left, right, how, first, band, stop }),
        _ => Arch::new().dispatch(Band::<128> { left, right, how, first, band, stop }),
    }
}

/// A band to be matched with the widest instructions that the machine has. A closure would do, but
/// its body is not compiled for them.
struct Band<'a, const D: usize> {
    left: &'a GrayImage,
    right: &'a GrayImage,
    how: &'a Matching,
    first: usize,
    band: &'a mut [i16],
    stop: &'a dyn Fn() -> bool,
}

impl<const D: usize> WithSimd for Band<'_, D> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        run::<D>(self.left, self.right, self.how, self.first, self.band, self.stop)
    }
}

/// Costs of one path for each pixel of a row, with a guard before and after each pixel's, and the
/// least of each pixel.
struct PathRow {
    costs: Vec<u8>,
    least: Vec<u8>,
}

impl PathRow {
    fn new(width: usize, stride: usize) -> PathRow {
        let mut costs = vec![0; width * stride];
        for pixel in costs.chunks_exact_mut(stride) {
            pixel[0] = u8::MAX;
            pixel[stride - 1] = u8::MAX;
        }
        PathRow { costs, least: vec![0; width] }
    }
}

#[inline(always)]
fn run<const D: usize>(
    left: &GrayImage,
    right: &GrayImage,
    how: &Matching,
    first: usize,
    band: &mut [i16],
    stop: &dyn Fn() -> bool,
) -> bool {
    let width = left.size().width;
    let stride = D + 2;
    let index: [i16; D] = std::array::from_fn(|d| d as i16);
    let mut guarded = vec![0; stride];
    (guarded[0], guarded[stride - 1]) = (u8::MAX, u8::MAX);
    let start = guarded.clone();

    let (mut census, mut census_right) = (CensusRow::new(width), CensusRow::new(width));
    // The right census from right to left, so that disparities count upward, and nothing beyond.
    let mut mirrored: [Vec<u8>; 4] = std::array::from_fn(|_| vec![0; width + D]);
    let mut costs = vec![0_u8; width * D];
    let mut sums = vec![0_u8; width * D];
    let mut above: [PathRow; 3] = std::array::from_fn(|_| PathRow::new(width, stride));
    let mut here: [PathRow; 3] = std::array::from_fn(|_| PathRow::new(width, stride));
    let (mut before, mut after) = (start.clone(), start.clone());
    let mut winners = vec![Winner::default(); width];
    // Best key by column of the right image, from right to left.
    let mut right_keys = vec![i16::MAX; width + D];

    let warm = first.saturating_sub(WARM_ROWS);
    for y in warm..first + band.len() / width {
        if stop() {
            return false;
        }
        census.fill(left, y);
        census_right.fill(right, y);
        for (mirrored, plane) in mirrored.iter_mut().zip(&census_right.planes) {
            for (to, from) in mirrored.iter_mut().zip(plane.iter().rev()) {
                *to = *from;
            }
        }
        let row = left.row(y);
        let row_above = left.row(if y == warm { y } else { y - 1 });
        let asked = y >= first;

        // From the left, from above and along the diagonals from above.
        before.copy_from_slice(&start);
        let mut least_before = 0;
        for x in 0..width {
            let cost = &mut costs[x * D..][..D];
            match_costs::<D>(&census.planes, &mirrored, x, width, cost);
            let cost = &*cost;
            let sum = &mut sums[x * D..][..D];
            let gray = row[x];
            let p2 = |other: u8| {
                if gray.abs_diff(other) > how.edge { how.p2_edge } else { how.p2 }
            };
            // Where each path comes from; outside the image it starts anew.
            let from = [Some(x), x.checked_sub(1), (x + 1 < width).then_some(x + 1)];
            for (i, from) in from.into_iter().enumerate() {
                let (previous, least, gray_there) = match from {
                    Some(at) => {
                        let path = &above[i];
                        (&path.costs[at * stride..][..stride], path.least[at], row_above[at])
                    }
                    None => (&start[..], 0, gray),
                };
                let path = &mut here[i];
                let out = &mut path.costs[x * stride..][..stride];
                path.least[x] = if i == 0 {
                    step::<D, true>(cost, previous, least, how.p1, p2(gray_there), out, sum)
                } else {
                    step::<D, false>(cost, previous, least, how.p1, p2(gray_there), out, sum)
                };
            }
            if asked {
                let gray_there = row[x.saturating_sub(1)];
                let p2 = p2(gray_there);
                least_before =
                    step::<D, false>(cost, &before, least_before, how.p1, p2, &mut after, sum);
                std::mem::swap(&mut before, &mut after);
            }
        }
        std::mem::swap(&mut above, &mut here);
        if !asked {
            continue;
        }

        // From the right, and the winners.
        before.copy_from_slice(&start);
        let mut least_before = 0;
        right_keys.fill(i16::MAX);
        for x in (0..width).rev() {
            let cost = &costs[x * D..][..D];
            let sum = &mut sums[x * D..][..D];
            let gray_there = row[(x + 1).min(width - 1)];
            let is_edge = row[x].abs_diff(gray_there) > how.edge;
            let p2 = if is_edge { how.p2_edge } else { how.p2 };
            least_before =
                step::<D, false>(cost, &before, least_before, how.p1, p2, &mut after, sum);
            std::mem::swap(&mut before, &mut after);
            let right_keys = &mut right_keys[width - 1 - x..][..D];
            winners[x] = Winner::of::<D>(sum, right_keys, &index);
        }
        let out = &mut band[(y - first) * width..][..width];
        for (x, out) in out.iter_mut().enumerate() {
            let winner = &winners[x];
            let seen_back = (right_keys[width - 1 - x + winner.d] & 0x7f) as usize;
            *out = if winner.d < how.disparities
                && winner.is_unique(how.uniqueness_percent)
                && seen_back.abs_diff(winner.d) <= usize::from(how.left_right_max)
            {
                winner.parts()
            } else {
                HOLE
            };
        }
    }
    true
}

/// Cost of each disparity of the pixel in column `x`.
#[inline(always)]
fn match_costs<const D: usize>(
    census: &[Vec<u8>; 4],
    mirrored: &[Vec<u8>; 4],
    x: usize,
    width: usize,
    cost: &mut [u8],
) {
    let cost = &mut cost[..D];
    let l: [u8; 4] = std::array::from_fn(|i| census[i][x]);
    let start = width - 1 - x;
    let [a, b, c, d] = mirrored;
    let (a, b) = (&a[start..][..D], &b[start..][..D]);
    let (c, d) = (&c[start..][..D], &d[start..][..D]);
    for i in 0..D {
        cost[i] = count([l[0] ^ a[i], l[1] ^ b[i], l[2] ^ c[i], l[3] ^ d[i]]);
    }
    // Left of the right image there is nothing.
    if x + 1 < D {
        cost[x + 1..].fill(BITS);
    }
}

/// One pixel further along a path (Hirschmüller 2008, eq. 14); gives the least cost.
#[inline(always)]
fn step<const D: usize, const FIRST: bool>(
    cost: &[u8],
    previous: &[u8],
    least: u8,
    p1: u8,
    p2: u8,
    out: &mut [u8],
    sum: &mut [u8],
) -> u8 {
    let (cost, sum, out) = (&cost[..D], &mut sum[..D], &mut out[1..=D]);
    let (lower, same, higher) = (&previous[..D], &previous[1..=D], &previous[2..D + 2]);
    // At most 31 + 40 + 40.
    let jump = least.wrapping_add(p2);
    let mut least_here = u8::MAX;
    for d in 0..D {
        let near = lower[d].min(higher[d]).saturating_add(p1);
        let best = same[d].min(near).min(jump).wrapping_sub(least);
        let l = cost[d].wrapping_add(best);
        out[d] = l;
        least_here = least_here.min(l);
        // Only sums far above the best reach the end of the range.
        sum[d] = if FIRST { l } else { sum[d].saturating_add(l) };
    }
    least_here
}

/// The best disparity of a pixel, the costs about it, and the least elsewhere.
#[derive(Clone, Copy, Default)]
struct Winner {
    d: usize,
    lower: u8,
    best: u8,
    higher: u8,
    second: u8,
    inner: bool,
}

impl Winner {
    /// Finds the winner of `sum`, which is spent by it, and enters all sums for the right image.
    #[inline(always)]
    fn of<const D: usize>(sum: &mut [u8], right_keys: &mut [i16], index: &[i16; D]) -> Winner {
        let (sum, right_keys) = (&mut sum[..D], &mut right_keys[..D]);
        let mut best = i16::MAX;
        for d in 0..D {
            // Sum and disparity in one number: the least has the lowest disparity among equals.
            let key = (i16::from(sum[d]) << 7) | index[d];
            right_keys[d] = right_keys[d].min(key);
            best = best.min(key);
        }
        let d = (best & 0x7f) as usize;
        let inner = d > 0 && d + 1 < D;
        let lower = if d > 0 { sum[d - 1] } else { u8::MAX };
        let higher = if d + 1 < D { sum[d + 1] } else { u8::MAX };
        sum[d.saturating_sub(1)..(d + 2).min(D)].fill(u8::MAX);
        let second = sum.iter().fold(u8::MAX, |least, s| least.min(*s));
        Winner { d, lower, best: (best >> 7) as u8, higher, second, inner }
    }

    fn is_unique(&self, percent: u8) -> bool {
        let (best, second) = (u32::from(self.best), u32::from(self.second));
        second * (100 - u32::from(percent)) >= best * 100 && second > best
    }

    /// Disparity in parts of a pixel: the vertex of the parabola through the costs.
    fn parts(&self) -> i16 {
        let whole = PARTS * self.d as i16;
        let [lower, best, higher] = [self.lower, self.best, self.higher].map(i32::from);
        let bend = lower + higher - 2 * best;
        if !self.inner || bend <= 0 {
            return whole;
        }
        let shift = (i32::from(PARTS) * (lower - higher) + bend) / (2 * bend);
        whole + shift as i16
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::image::ImageSize;

    #[test]
    fn wider_instructions_change_no_bit() {
        let size = ImageSize::new(90, 40).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let noise: Vec<u8> = (0..size.len() + 11).map(|_| rng.random()).collect();
        let left = GrayImage::new(size, noise[..size.len()].to_vec()).unwrap();
        let right = GrayImage::new(size, noise[11..].to_vec()).unwrap();
        let how = Matching { disparities: 32, ..Matching::default() };
        let (mut plain, mut wide) = (vec![HOLE; 90 * 30], vec![HOLE; 90 * 30]);
        assert!(run::<32>(&left, &right, &how, 10, &mut plain, &|| false));
        assert!(match_band(&left, &right, &how, 10, &mut wide, &|| false));
        assert_eq!(plain, wide);
        let n_right = plain.iter().filter(|parts| parts.abs_diff(11 * PARTS) < 64).count();
        assert!(n_right > 60 * 30, "{n_right}");
    }
}
