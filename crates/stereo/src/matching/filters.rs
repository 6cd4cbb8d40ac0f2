//! What is done to disparities after matching. Values are parts of a pixel.

use super::HOLE;
use super::census::{HALF_X, HALF_Y};
use crate::image::GrayImage;

/// Makes holes of dark pixels, of those in 3 x 3 pixels of a dark mean, and of those about which the
/// gray values of a census window span less than `contrast`.
pub(super) fn drop_blank(image: &GrayImage, dark: u8, contrast: u8, parts: &mut [i16]) {
    let (width, height) = (image.size().width, image.size().height);
    // Sums, least and largest of the columns of the windows, their ends repeated at both borders.
    let mut sums = vec![0_u16; width + 2 * HALF_X];
    let (mut least, mut largest) = (vec![0_u8; width + 2 * HALF_X], vec![0_u8; width + 2 * HALF_X]);
    let inner = HALF_X..HALF_X + width;
    for (y, out) in parts.chunks_exact_mut(width).enumerate() {
        let row = |dy: usize| image.row((y + dy).saturating_sub(HALF_Y).min(height - 1));
        let (above, here, below) = (row(HALF_Y - 1), row(HALF_Y), row(HALF_Y + 1));
        for ((sum, a), (b, c)) in
            sums[inner.clone()].iter_mut().zip(above).zip(here.iter().zip(below))
        {
            *sum = u16::from(*a) + u16::from(*b) + u16::from(*c);
        }
        least.fill(u8::MAX);
        largest.fill(0);
        for dy in 0..=2 * HALF_Y {
            let (low, high) = (&mut least[inner.clone()], &mut largest[inner.clone()]);
            for ((low, high), gray) in low.iter_mut().zip(high).zip(row(dy)) {
                *low = (*low).min(*gray);
                *high = (*high).max(*gray);
            }
        }
        sums[HALF_X - 1] = sums[HALF_X];
        sums[HALF_X + width] = sums[HALF_X + width - 1];
        for (x, out) in out.iter_mut().enumerate() {
            let sum: u16 = sums[x + HALF_X - 1..x + HALF_X + 2].iter().sum();
            let window = x..x + 2 * HALF_X + 1;
            let low = least[window.clone()].iter().fold(u8::MAX, |a, b| a.min(*b));
            let high = largest[window].iter().fold(0, |a: u8, b| a.max(*b));
            if here[x] < dark || sum < 9 * u16::from(dark) || high - low < contrast {
                *out = HOLE;
            }
        }
    }
}

/// The median of 3 x 3 for pixels inside the image that are no hole; holes count as lowest, so a pixel
/// with more holes than values around it becomes one.
pub(super) fn median(width: usize, parts: &[i16]) -> Vec<i16> {
    let mut out = parts.to_vec();
    let height = parts.len() / width;
    for y in 1..height.saturating_sub(1) {
        let rows: [&[i16]; 3] = std::array::from_fn(|i| &parts[(y + i - 1) * width..][..width]);
        let out = &mut out[y * width + 1..][..width - 2];
        let at = |row: usize, column: usize| &rows[row][column..][..width - 2];
        let (a, b, c) = (at(0, 0), at(0, 1), at(0, 2));
        let (d, e, f) = (at(1, 0), at(1, 1), at(1, 2));
        let (g, h, k) = (at(2, 0), at(2, 1), at(2, 2));
        for x in 0..out.len() {
            let nine = [a[x], b[x], c[x], d[x], e[x], f[x], g[x], h[x], k[x]];
            let middle = median_of(nine);
            out[x] = if e[x] == HOLE { HOLE } else { middle };
        }
    }
    out
}

/// Median of nine by sorted triples: the middle of the largest minimum, the middle of the middles and
/// the least maximum.
#[inline(always)]
fn median_of([a, b, c, d, e, f, g, h, k]: [i16; 9]) -> i16 {
    let sort = |x: i16, y: i16, z: i16| {
        let (low, high) = (x.min(y), x.max(y));
        (low.min(z), low.max(high.min(z)), high.max(z))
    };
    let middle = |x: i16, y: i16, z: i16| x.min(y).max(x.max(y).min(z));
    let ((l0, m0, h0), (l1, m1, h1), (l2, m2, h2)) = (sort(a, b, c), sort(d, e, f), sort(g, h, k));
    middle(l0.max(l1).max(l2), middle(m0, m1, m2), h0.min(h1).min(h2))
}

/// Makes holes of connected areas of fewer than `area` pixels, where neighbors are connected if they
/// differ by no more than `step`.
pub(super) fn drop_speckles(width: usize, parts: &mut [i16], area: usize, step: i16) {
    if area <= 1 {
        return;
    }
    let joined = |a: i16, b: i16| {
        a != HOLE && b != HOLE && (i32::from(a) - i32::from(b)).abs() <= i32::from(step)
    };
    // Runs of connected pixels of a row, joined with those of the row above.
    let mut runs: Vec<Run> = Vec::new();
    let mut above = 0..0;
    for (y, row) in parts.chunks_exact(width).enumerate() {
        let first = runs.len();
        let mut x = 0;
        while x < width {
            if row[x] == HOLE {
                x += 1;
                continue;
            }
            let start = x;
            while x + 1 < width && joined(row[x], row[x + 1]) {
                x += 1;
            }
            x += 1;
            let i = runs.len() as u32;
            runs.push(Run { start: y * width + start, len: x - start, root: i, area: x - start });
        }
        let mut over = above.start;
        for i in first..runs.len() {
            let (from, to) =
                (runs[i].start - width.min(runs[i].start), runs[i].start + runs[i].len);
            let to = to.saturating_sub(width);
            while over < above.end && runs[over].start + runs[over].len <= from {
                over += 1;
            }
            let mut j = over;
            while j < above.end && runs[j].start < to {
                let low = runs[j].start.max(from);
                let high = (runs[j].start + runs[j].len).min(to);
                if (low..high).any(|at| joined(parts[at], parts[at + width])) {
                    join(&mut runs, i, j);
                }
                j += 1;
            }
        }
        above = first..runs.len();
    }
    for i in 0..runs.len() {
        let root = root_of(&mut runs, i);
        if runs[root].area < area {
            let Run { start, len, .. } = runs[i];
            parts[start..start + len].fill(HOLE);
        }
    }
}

struct Run {
    start: usize,
    len: usize,
    root: u32,
    area: usize,
}

fn root_of(runs: &mut [Run], mut i: usize) -> usize {
    while runs[i].root as usize != i {
        // Every other link is shortened on the way.
        let up = runs[i].root as usize;
        runs[i].root = runs[up].root;
        i = up;
    }
    i
}

fn join(runs: &mut [Run], i: usize, j: usize) {
    let (i, j) = (root_of(runs, i), root_of(runs, j));
    if i != j {
        let (low, high) = (i.min(j), i.max(j));
        runs[high].root = low as u32;
        runs[low].area += runs[high].area;
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn noise(rng: &mut ChaCha8Rng, n: usize, values: i16, holes: f64) -> Vec<i16> {
        let mut value = || {
            if rng.random::<f64>() < holes { HOLE } else { rng.random_range(0..values) }
        };
        (0..n).map(|_| value()).collect()
    }

    #[test]
    fn the_median_is_the_fifth_of_nine_sorted() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..200 {
            let parts = noise(&mut rng, 7 * 6, 30, 0.3);
            let out = median(7, &parts);
            for (i, value) in out.iter().enumerate() {
                let (x, y) = (i % 7, i / 7);
                let inside = (1..6).contains(&x) && (1..5).contains(&y);
                let mut nine: Vec<i16> = (0..9)
                    .filter_map(|k| parts.get((i + (k / 3) * 7 + k % 3).checked_sub(8)?).copied())
                    .collect();
                nine.sort_unstable();
                let expected = if inside && parts[i] != HOLE { nine[4] } else { parts[i] };
                assert_eq!(*value, expected);
            }
        }
    }

    #[test]
    fn speckles_are_the_small_areas_of_a_flood() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (width, height) = (23, 17);
        for round in 0..300 {
            let parts = noise(&mut rng, width * height, 4, 0.4);
            let (area, step) = (2 + round % 9, (round % 3) as i16);
            let mut filtered = parts.clone();
            drop_speckles(width, &mut filtered, area, step);
            for i in 0..parts.len() {
                if parts[i] == HOLE {
                    assert_eq!(filtered[i], HOLE);
                    continue;
                }
                let mut seen = vec![false; parts.len()];
                let mut stack = vec![i];
                seen[i] = true;
                let mut n = 0;
                while let Some(at) = stack.pop() {
                    n += 1;
                    let (x, y) = (at % width, at / width);
                    let mut visit = |to: usize| {
                        let close =
                            parts[to] != HOLE && parts[to].abs_diff(parts[at]) <= step as u16;
                        if close && !seen[to] {
                            seen[to] = true;
                            stack.push(to);
                        }
                    };
                    if x > 0 {
                        visit(at - 1)
                    }
                    if x + 1 < width {
                        visit(at + 1)
                    }
                    if y > 0 {
                        visit(at - width)
                    }
                    if y + 1 < height {
                        visit(at + width)
                    }
                }
                assert_eq!(filtered[i], if n < area { HOLE } else { parts[i] });
            }
        }
    }

    #[test]
    fn dark_and_even_places_are_holes() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (width, height) = (40_i32, 24_i32);
        let size = crate::ImageSize::new(width as usize, height as usize).unwrap();
        let mut gray = |i: usize| {
            let spread = [1, 4, 9, 60][i % 40 / 10];
            (i / 480 * 12 + 3) as u8 + rng.random_range(0..spread)
        };
        let pixels: Vec<u8> = (0..size.len()).map(&mut gray).collect();
        let image = GrayImage::new(size, pixels).unwrap();
        for (dark, contrast) in [(0, 0), (8, 0), (0, 6), (9, 5)] {
            let mut parts = vec![5; size.len()];
            drop_blank(&image, dark, contrast, &mut parts);
            for (i, part) in parts.iter().enumerate() {
                let (x, y) = (i as i32 % width, i as i32 / width);
                let at = |dx: i32, dy: i32| {
                    let (x, y) = ((x + dx).clamp(0, width - 1), (y + dy).clamp(0, height - 1));
                    image.at(x as usize, y as usize)
                };
                let window = |hx: i32, hy: i32| {
                    (-hy..=hy).flat_map(move |dy| (-hx..=hx).map(move |dx| (dx, dy)))
                };
                let mean: f64 =
                    window(1, 1).map(|(dx, dy)| f64::from(at(dx, dy))).sum::<f64>() / 9.0;
                let grays = || window(4, 3).map(|(dx, dy)| at(dx, dy));
                let span = grays().max().unwrap() - grays().min().unwrap();
                let blank = at(0, 0) < dark || mean < f64::from(dark) || span < contrast;
                assert_eq!(*part == HOLE, blank, "({x}, {y}) {dark} {contrast}");
            }
        }
    }
}
