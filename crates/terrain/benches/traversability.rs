//! Cells per second of traversability with a window of 15 x 15, against going through each window.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geometry::{Grid, Raster};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::traversability::{Limits, Span, explain_cell, traversability, trusted_traversability};
use terrain::{ElevationMap, Source};

const CELL: f64 = 0.05;
const FOOTPRINT: f64 = 0.75;

/// Wavy ground with a share of holes.
fn map(n: usize, holes: f64) -> ElevationMap {
    let grid = Grid { origin: Point2::origin(), resolution: CELL, nx: n, ny: n };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let heights = Raster::from_fn(grid, |ix, iy| {
        let (x, y) = (CELL * ix as f64, CELL * iy as f64);
        let wave = 0.3 * (0.8 * x).sin() * (0.5 * y + 0.2 * x).cos();
        let is_hole = rng.random::<f64>() < holes;
        if is_hole { f32::NAN } else { (wave + 0.02 * rng.random::<f64>()) as f32 }
    });
    ElevationMap::new(heights, Source::file("bench"))
}

fn layers(c: &mut Criterion) {
    let mut group = c.benchmark_group("traversability");
    let limits = Limits::default();
    group.sample_size(20);
    for (name, holes) in [("whole", 0.0), ("2 % holes", 0.02)] {
        let map = map(1024, holes);
        group.throughput(Throughput::Elements(1024 * 1024));
        group.bench_function(BenchmarkId::new("1024 x 1024", name), |b| {
            b.iter(|| traversability(black_box(&map), FOOTPRINT, &limits));
        });
    }
    let whole = map(1024, 0.02);
    let trust = Raster::from_fn(*whole.grid(), |ix, _| 1.0 / (1.0 + ix as f32));
    group.bench_function("1024 x 1024, 2 % holes, trusted", |b| {
        b.iter(|| trusted_traversability(black_box(&whole), &trust, FOOTPRINT, &limits));
    });
    let mut layers = traversability(&whole, FOOTPRINT, &limits).expect("a usable footprint");
    let tile = [Span { xs: 256..512, ys: 256..512 }];
    group.throughput(Throughput::Elements(256 * 256));
    group.bench_function("a changed tile, 256 x 256 of 1024 x 1024", |b| {
        b.iter(|| layers.update(black_box(&whole), None, &tile));
    });
    let small = map(64, 0.02);
    group.throughput(Throughput::Elements(64 * 64));
    group.bench_function("brute force, 64 x 64, 2 % holes", |b| {
        let grid = *small.grid();
        b.iter(|| {
            for i in 0..grid.len() {
                let p = grid.position(i % grid.nx, i / grid.nx);
                black_box(explain_cell(&small, p, FOOTPRINT, &limits)).ok();
            }
        });
    });
    group.finish();
}

criterion_group!(benches, layers);
criterion_main!(benches);
