//! Offsets, trust, and judging again only what changed.

use geometry::{Grid, Raster};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::traversability::{
    Layers, Limits, Span, explain_cell, explain_trusted_cell, traversability,
    trusted_traversability,
};
use terrain::{ElevationMap, Source, TerrainError};

const CELL: f64 = 0.05;
const FOOT: f64 = 0.75;

fn grid(nx: usize, ny: usize) -> Grid {
    Grid { origin: Point2::new(-3.0, 1.0), resolution: CELL, nx, ny }
}

fn map_of(heights: Raster<f32>) -> ElevationMap {
    ElevationMap::new(heights, Source::file("test"))
}

/// Waves, boxes and holes whose heights are whole 1/1024 m.
fn rough(rng: &mut ChaCha8Rng, nx: usize, ny: usize) -> Raster<f32> {
    Raster::from_fn(grid(nx, ny), |ix, iy| {
        let (x, y) = (ix as f64, iy as f64);
        let wave = 0.2 * (0.11 * x).sin() * (0.07 * y + 0.02 * x).cos();
        let rock = if (ix / 9 + iy / 7) % 11 == 0 { 0.11 } else { 0.0 };
        let z = ((wave + rock + 0.01 * rng.random::<f64>()) * 1024.0).round() / 1024.0;
        if rng.random::<f64>() < 0.04 { f32::NAN } else { z as f32 }
    })
}

fn bits(layers: &Layers) -> Vec<u32> {
    let rasters = [
        &layers.slope_rad,
        &layers.roughness_m,
        &layers.step_m,
        &layers.goodness,
        &layers.certainty,
    ];
    let floats = rasters.iter().flat_map(|layer| layer.values()).map(|v| v.to_bits());
    floats.chain(layers.class.values().iter().map(|class| u32::from(*class))).collect()
}

#[test]
fn the_same_ground_four_kilometers_lower_has_the_same_layers_to_the_bit() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let high = rough(&mut rng, 120, 90);
    let mut low = high.clone();
    // Whole 1/1024 m at -4455 m are f32 numbers: a step in the last place is 1/2048 m.
    low.values_mut().iter_mut().for_each(|z| *z -= 4455.0);
    assert!(high.values().iter().zip(low.values()).all(|(a, b)| a.is_nan() || b + 4455.0 == *a));
    let judge = |heights: Raster<f32>| traversability(&map_of(heights), FOOT, &Limits::default());
    assert_eq!(bits(&judge(high).unwrap()), bits(&judge(low).unwrap()));
}

#[test]
fn judging_again_what_changed_equals_judging_anew_to_the_bit() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let limits = Limits::default();
    for round in 0..12 {
        let (nx, ny) = (rng.random_range(20..700), rng.random_range(20..560));
        let mut heights = rough(&mut rng, nx, ny);
        if round == 0 {
            heights.values_mut().fill(f32::NAN);
        }
        let footprint = [FOOT, 0.45, 1.55][round % 3];
        let with_trust = round % 2 == 1;
        let mut trust = Raster::from_fn(grid(nx, ny), |_, _| rng.random::<f32>());
        let given = |trust: &Raster<f32>| with_trust.then(|| trust.clone());
        let judge = |heights: &Raster<f32>, trust: &Raster<f32>| {
            let map = map_of(heights.clone());
            match given(trust) {
                Some(trust) => trusted_traversability(&map, &trust, footprint, &limits),
                None => traversability(&map, footprint, &limits),
            }
            .unwrap()
        };
        let mut layers = judge(&heights, &trust);
        for _ in 0..4 {
            let spans: Vec<Span> = (0..rng.random_range(1..4))
                .map(|_| {
                    let (x, y) = (rng.random_range(0..nx), rng.random_range(0..ny));
                    let xs = x..(x + rng.random_range(1..80)).min(nx);
                    Span { xs, ys: y..(y + rng.random_range(1..60)).min(ny) }
                })
                .collect();
            for span in &spans {
                for iy in span.ys.clone() {
                    for ix in span.xs.clone() {
                        let i = heights.grid().index(ix, iy);
                        let is_hole = rng.random::<f64>() < 0.3;
                        heights.values_mut()[i] =
                            if is_hole { f32::NAN } else { rng.random::<f32>() };
                        trust.values_mut()[i] = rng.random();
                    }
                }
            }
            let map = map_of(heights.clone());
            let judged = layers.update(&map, given(&trust).as_ref(), &spans).unwrap();
            assert!(judged <= nx * ny);
            assert_eq!(bits(&layers), bits(&judge(&heights, &trust)), "{nx} x {ny}");
        }
    }
}

#[test]
fn a_changed_tile_costs_little_more_than_itself() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut heights = rough(&mut rng, 1024, 1024);
    let mut layers = traversability(&map_of(heights.clone()), FOOT, &Limits::default()).unwrap();
    for iy in 256..512 {
        for ix in 512..768 {
            heights.values_mut()[iy * 1024 + ix] += 0.5;
        }
    }
    let changed = [Span { xs: 512..768, ys: 256..512 }];
    let judged = layers.update(&map_of(heights), None, &changed).unwrap();
    // The tile and half a window and one cell about it.
    assert_eq!(judged, (256 + 2 * 8) * (256 + 2 * 8));
}

#[test]
fn certainty_is_the_trust_in_known_cells_over_all_cells() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let heights = rough(&mut rng, 60, 50);
    let map = map_of(heights.clone());
    let trust = Raster::from_fn(grid(60, 50), |_, _| rng.random::<f32>());
    let layers = trusted_traversability(&map, &trust, FOOT, &Limits::default()).unwrap();
    for _ in 0..400 {
        let (cx, cy) = (rng.random_range(0..60_usize), rng.random_range(0..50_usize));
        let mut sum = 0.0;
        for iy in cy.saturating_sub(7)..(cy + 8).min(50) {
            for ix in cx.saturating_sub(7)..(cx + 8).min(60) {
                if !heights.at(ix, iy).is_nan() {
                    sum += f64::from(*trust.at(ix, iy));
                }
            }
        }
        let found = f64::from(*layers.certainty.at(cx, cy));
        assert!((found - sum / 225.0).abs() < 1e-5, "{found}, expected {}", sum / 225.0);
        let p = map.grid().position(cx, cy);
        let cell = explain_trusted_cell(&map, Some(&trust), p, FOOT, &Limits::default());
        let cell = cell.unwrap().unwrap();
        assert!((cell.certainty - sum / 225.0).abs() < 1e-9);
        assert_eq!(cell.class, *layers.class.at(cx, cy));
    }
}

#[test]
fn full_trust_is_no_other_than_none_given_and_losing_trust_or_cells_never_helps() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let limits = Limits::default();
    let heights = rough(&mut rng, 80, 70);
    let map = map_of(heights.clone());
    let full = Raster::from_fn(grid(80, 70), |_, _| 1.0);
    let plain = traversability(&map, FOOT, &limits).unwrap();
    let mut before = trusted_traversability(&map, &full, FOOT, &limits).unwrap();
    for (a, b) in plain.certainty.values().iter().zip(before.certainty.values()) {
        assert!((a - b).abs() < 1e-6);
    }
    let (mut heights, mut trust) = (heights, full);
    for _ in 0..5 {
        for (z, t) in heights.values_mut().iter_mut().zip(trust.values_mut()) {
            *t *= 0.6 + 0.4 * rng.random::<f32>();
            if rng.random::<f64>() < 0.05 {
                *z = f32::NAN;
            }
        }
        let after = trusted_traversability(&map_of(heights.clone()), &trust, FOOT, &limits);
        let after = after.unwrap();
        for (a, b) in after.certainty.values().iter().zip(before.certainty.values()) {
            assert!(a <= b, "{a} after {b}");
        }
        for (a, b) in after.class.values().iter().zip(before.class.values()) {
            assert!(*b != 0 || *a == 0, "unknown became {a}");
        }
        before = after;
    }
}

#[test]
fn what_is_explained_names_thresholds_and_where_they_come_from() {
    let tilted = Raster::from_fn(grid(40, 40), |ix, _| 0.2 * CELL as f32 * ix as f32);
    let cell = explain_cell(&map_of(tilted), Point2::new(-2.0, 2.0), FOOT, &Limits::default());
    let components = cell.unwrap().unwrap().components();
    assert_eq!(
        components.iter().map(|c| c.name).collect::<Vec<_>>(),
        ["slope_rad", "roughness_m", "step_m"]
    );
    let slope = components[0];
    assert!((slope.value - 0.2_f64.atan()).abs() < 1e-6 && slope.hi == 20.0_f64.to_radians());
    let expected = (slope.hi - slope.value) / (slope.hi - slope.lo);
    assert!((slope.goodness - expected).abs() < 1e-9);
    assert!(components.iter().all(|c| c.reason.len() > 20));
}

#[test]
fn trust_of_another_map_or_beyond_one_is_refused() {
    let map = map_of(rough(&mut ChaCha8Rng::seed_from_u64(6), 30, 30));
    let judge = |trust: &Raster<f32>| {
        trusted_traversability(&map, trust, FOOT, &Limits::default()).unwrap_err()
    };
    let other = Raster::from_fn(grid(30, 29), |_, _| 1.0);
    assert!(matches!(judge(&other), TerrainError::OtherGrid { what: "trust", .. }));
    for bad in [1.5, -0.1, f32::NAN] {
        let trust = Raster::from_fn(grid(30, 30), |ix, _| if ix == 3 { bad } else { 1.0 });
        assert!(matches!(judge(&trust), TerrainError::OutOfRange { field: "trust", .. }));
    }
}
