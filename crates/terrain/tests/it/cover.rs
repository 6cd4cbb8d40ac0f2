//! The cover of unknown ground is above the ground.

use std::collections::BTreeMap;

use geometry::{Grid, Raster};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::cover::{CoverLimits, cover};
use terrain::synthetic::{Recipe, generate};
use terrain::{ElevationMap, Source};

fn no_hints() -> BTreeMap<(usize, usize), f32> {
    BTreeMap::new()
}

/// Discs of a width (m) cut out of a map, apart from each other, at places of a seed.
fn holed(map: &ElevationMap, width_m: f64, seed: u64) -> ElevationMap {
    let (grid, mut rng) = (*map.grid(), ChaCha8Rng::seed_from_u64(seed));
    let mut heights = map.heights().clone();
    let far = grid.far_corner();
    for _ in
        0..(0.1 * (far.x - grid.origin.x) * (far.y - grid.origin.y) / (width_m * width_m)) as usize
    {
        let at = Point2::new(
            rng.random_range(grid.origin.x + 1.0..far.x - 1.0),
            rng.random_range(grid.origin.y + 1.0..far.y - 1.0),
        );
        for i in 0..grid.len() {
            let p = grid.position(i % grid.nx, i / grid.nx);
            if (p - at).norm() <= 0.5 * width_m {
                heights.values_mut()[i] = f32::NAN;
            }
        }
    }
    ElevationMap::new(heights, Source::file("holed"))
}

/// Of the unknown nodes of a map that are covered, the share over which the truth is higher than the cover, and the
/// share of the unknown ones that are covered.
fn shares(truth: &ElevationMap, map: &ElevationMap) -> (f64, f64) {
    let covered = cover(map, &no_hints(), &CoverLimits::default()).unwrap();
    let grid = map.grid();
    let [mut unknown, mut bounded, mut over] = [0.0; 3];
    for i in 0..grid.len() {
        let (ix, iy) = (i % grid.nx, i / grid.nx);
        let z = covered.heights().nearest(grid.position(ix, iy)).unwrap();
        let known = *map.heights().at(ix, iy);
        if !known.is_nan() {
            assert_eq!(z.to_bits(), known.to_bits(), "known ground stays as it is");
            continue;
        }
        unknown += 1.0;
        bounded += f64::from(u8::from(!z.is_nan()));
        over += f64::from(u8::from(*truth.heights().at(ix, iy) > z));
    }
    (over / bounded, bounded / unknown)
}

/// Holes of up to 0.3 m: of a hundred thousand unknown nodes hardly any is higher than its cover, however rough
/// the ground, and what is higher are rocks that lie wholly within.
#[test]
fn ground_in_holes_is_below_their_cover() {
    for name in Recipe::NAMES {
        for (width_m, most) in [(0.15, 0.001), (0.3, 0.005), (0.6, 0.03)] {
            let [mut over, mut covered, n] = [0.0, 0.0, 2.0];
            for seed in [1, 2] {
                let recipe =
                    Recipe { width_m: 16.0, height_m: 16.0, ..Recipe::from_name(name).unwrap() };
                let truth = generate(&recipe, seed).unwrap();
                let (high, known) = shares(&truth, &holed(&truth, width_m, seed));
                (over, covered) = (over + high / n, covered + known / n);
            }
            println!(
                "{name}, holes of {width_m} m: {:.3} % over the cover, {:.1} % covered",
                100.0 * over,
                100.0 * covered
            );
            assert!(over <= most, "{name} {width_m}: {over}");
            assert!(covered > 0.99, "{name} {width_m}: {covered}");
        }
    }
}

#[test]
fn a_cover_rises_from_the_edge_of_a_hole_and_ends_at_its_reach() {
    let grid = Grid { origin: Point2::origin(), resolution: 0.1, nx: 41, ny: 5 };
    // Known on the left up to column 9, with a step at column 8; nothing on the right.
    let ground = |ix: usize| {
        if ix > 9 {
            f32::NAN
        } else if ix == 8 {
            0.3
        } else {
            0.0
        }
    };
    let map = ElevationMap::new(Raster::from_fn(grid, |ix, _| ground(ix)), Source::file("edge"));
    let limits = CoverLimits { edge_m: 0.1, rise_m: 0.05, slope: 0.5, reach_m: 0.3 };
    let covered = cover(&map, &no_hints(), &limits).unwrap();
    let at = |ix: f64, iy: f64| *covered.heights().nearest(Point2::new(ix, iy)).as_ref().unwrap();
    for (x, expected) in [(0.9, 0.0), (0.8, 0.3), (1.0, 0.4), (1.1, 0.45), (1.2, 0.5)] {
        // Diagonals rise more than straight ways: the middle row has neighbors on both sides.
        let found = at(x, 0.2);
        assert!(found >= expected - 1e-6 && found < expected + 0.08, "{x}: {found}, {expected}");
    }
    assert!(at(1.3, 0.2).is_nan(), "beyond its reach nothing is bounded");
    // About the map too, and no farther.
    assert!(at(0.0, -0.3) > 0.05);
    let origin = covered.grid().origin - grid.origin;
    assert!((origin.x + 0.3).abs() < 1e-9 && (origin.y + 0.3).abs() < 1e-9, "{origin}");
    // What is told of a node counts there, and for what is beside it.
    let hinted = cover(&map, &BTreeMap::from([((12, 2), 2.0)]), &limits).unwrap();
    let at = |x: f64| *hinted.heights().nearest(Point2::new(x, 0.2)).as_ref().unwrap();
    assert!(at(1.2) == 2.0 && at(1.1) > 2.0 && at(1.4) > 2.0);
    let wrong = CoverLimits { slope: -1.0, ..limits };
    assert!(cover(&map, &no_hints(), &wrong).unwrap_err().to_string().contains("slope"));
}
