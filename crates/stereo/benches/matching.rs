//! CPU time of matching a frame, against a block matcher and an SGM written straight from the paper.

#![allow(clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::matching::{Matching, Refinement, match_rectified, refine};
use stereo::{GrayImage, ImageSize};

/// Blurred noise over ground that recedes upward, with sensor noise.
fn pair(width: usize, height: usize) -> [GrayImage; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let wide = width + 256;
    let raw: Vec<f32> = (0..wide * (height + 4)).map(|_| rng.random_range(-1.0..1.0)).collect();
    let at = |x: usize, y: usize| {
        let window = (0..9).map(|k| raw[(y + k / 3) * wide + (x + k % 3).min(wide - 1)]);
        window.sum::<f32>()
    };
    let size = ImageSize::new(width, height).unwrap();
    [0, 1].map(|side| {
        let mut gray = |x: usize, y: usize| {
            let shift = side * (10 + y * 90 / height);
            let noise: f32 = rng.random_range(-3.0..3.0);
            (128.0 + 25.0 * at(x + shift, y) + noise).clamp(0.0, 255.0) as u8
        };
        let pixels = (0..size.len()).map(|i| gray(i % width, i / width)).collect();
        GrayImage::new(size, pixels).unwrap()
    })
}

/// Sums of absolute differences over 9 x 9 by running column sums, the winner, no tests at all.
fn block_match(left: &GrayImage, right: &GrayImage, disparities: usize) -> Vec<u8> {
    const HALF: usize = 4;
    let (width, height) = (left.size().width, left.size().height);
    let mut best = vec![u32::MAX; width * height];
    let mut found = vec![0_u8; width * height];
    let mut columns = vec![0_u32; width];
    for d in 0..disparities {
        columns.fill(0);
        let difference = |x: usize, y: usize| {
            u32::from(left.row(y)[x].abs_diff(right.row(y)[x.saturating_sub(d)]))
        };
        for y in 0..height {
            for (x, column) in columns.iter_mut().enumerate() {
                *column += difference(x, y);
                if y > 2 * HALF {
                    *column -= difference(x, y - 2 * HALF - 1);
                }
            }
            if y < 2 * HALF {
                continue;
            }
            let row = (y - HALF) * width;
            let mut sum: u32 = columns[..2 * HALF].iter().sum();
            for x in HALF..width - HALF {
                sum += columns[x + HALF];
                if sum < best[row + x] {
                    (best[row + x], found[row + x]) = (sum, d as u8);
                }
                sum -= columns[x - HALF];
            }
        }
    }
    found
}

/// Semi-global matching as published: a volume of costs, five paths, 16-bit sums, the winner.
fn plain_sgm(left: &GrayImage, right: &GrayImage, disparities: usize) -> Vec<u8> {
    let (width, height) = (left.size().width, left.size().height);
    let census = |image: &GrayImage| -> Vec<u64> {
        let mut words = vec![0; width * height];
        for y in 3..height - 3 {
            for x in 4..width - 4 {
                let center = image.row(y)[x];
                let mut word = 0_u64;
                for dy in 0..7 {
                    for dx in 0..9 {
                        word = word << 1 | u64::from(image.row(y + dy - 3)[x + dx - 4] < center);
                    }
                }
                words[y * width + x] = word;
            }
        }
        words
    };
    let (a, b) = (census(left), census(right));
    let mut cost = vec![62_u16; width * height * disparities];
    for i in 0..width * height {
        for d in 0..disparities.min(i % width + 1) {
            cost[i * disparities + d] = (a[i] ^ b[i - d]).count_ones() as u16;
        }
    }
    let mut sums = vec![0_u16; cost.len()];
    let mut path = vec![0_u16; cost.len()];
    for (dx, dy) in [(1_i64, 0_i64), (-1, 0), (0, 1), (1, 1), (-1, 1)] {
        for y in 0..height {
            for k in 0..width {
                let x = if dx < 0 { width - 1 - k } else { k };
                let i = (y * width + x) * disparities;
                let (px, py) = (x as i64 - dx, y as i64 - dy);
                let inside = px >= 0 && px < width as i64 && py >= 0;
                if !inside {
                    path[i..i + disparities].copy_from_slice(&cost[i..i + disparities]);
                } else {
                    let p = (py as usize * width + px as usize) * disparities;
                    let least = *path[p..p + disparities].iter().min().unwrap();
                    for d in 0..disparities {
                        let mut best = path[p + d].min(least + 60);
                        if d > 0 {
                            best = best.min(path[p + d - 1] + 7);
                        }
                        if d + 1 < disparities {
                            best = best.min(path[p + d + 1] + 7);
                        }
                        path[i + d] = cost[i + d] + best - least;
                    }
                }
                for d in 0..disparities {
                    sums[i + d] += path[i + d];
                }
            }
        }
    }
    let winner = |costs: &[u16]| {
        costs.iter().enumerate().min_by_key(|(_, cost)| **cost).map_or(0, |(d, _)| d as u8)
    };
    sums.chunks_exact(disparities).map(winner).collect()
}

fn frames(c: &mut Criterion) {
    for (width, height, disparities) in [(741, 500, 64), (1024, 768, 128)] {
        let [left, right] = pair(width, height);
        let how = Matching { disparities, threads: 1, ..Matching::default() };
        // A group for each size: a baseline is one of its own size.
        let name = format!("matching {width} x {height} of {disparities} disparities");
        let mut group = c.benchmark_group(&name);
        group.sample_size(10);
        group.bench_function("one thread", |b| {
            b.iter(|| match_rectified(black_box(&left), &right, &how, &|| false).unwrap());
        });
        let coarse = match_rectified(&left, &right, &how, &|| false).unwrap();
        let finer = Refinement::default();
        group.bench_function("refinement, one thread", |b| {
            b.iter(|| {
                let mut disparity = coarse.clone();
                refine(black_box(&left), &right, &mut disparity, &finer, 1, &|| false).unwrap();
                disparity
            });
        });
        group.bench_function("block matcher", |b| {
            b.iter(|| block_match(black_box(&left), &right, disparities));
        });
        group.bench_function("SGM straight from the paper (baseline)", |b| {
            b.iter(|| plain_sgm(black_box(&left), &right, disparities));
        });
        group.finish();
    }
}

criterion_group!(benches, frames);
criterion_main!(benches);
