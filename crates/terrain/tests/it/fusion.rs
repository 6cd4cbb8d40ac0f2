//! The map over time against closed forms, brute force and known truth.

use std::sync::Arc;

use nalgebra::{Point2, Point3, Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::fusion::{
    Alignment, Cell, Correction, Flags, Input, MapSettings, MapVersion, Mapper, PairCell, PairDem,
    ReadPolicy, StandingWheel, TILE,
};
use terrain::traversability::{Limits, trusted_traversability};
use terrain::{Source, TerrainError};

const S: i64 = 1_000_000_000;

fn ground(height: f32, sigma: f32) -> PairCell {
    PairCell {
        height_m: height,
        lower_m: f32::NAN,
        variance_m2: sigma * sigma,
        common_m2: 0.0,
        count: 1,
        flags: Flags::NONE,
    }
}

fn hidden() -> PairCell {
    PairCell { flags: Flags::ROBOT, ..PairCell::EMPTY }
}

/// A map of one cell.
fn dot(cell: PairCell) -> Arc<PairDem> {
    Arc::new(PairDem::new(0.05, [3, -2], 1, vec![cell]).unwrap())
}

fn pair(source: u32, seconds: i64, dem: Arc<PairDem>) -> Input {
    Input::Pair { source, dem, time_ns: seconds * S, alignment: Alignment::NONE }
}

fn settings() -> MapSettings {
    MapSettings {
        growth_m2_s: 1e-6,
        variance_min_m2: 1e-9,
        repeated_share: 0.0,
        ..MapSettings::default()
    }
}

fn built(inputs: Vec<Input>) -> Mapper {
    Mapper::rebuild(settings(), inputs).unwrap()
}

fn cell(mapper: &Mapper) -> Cell {
    mapper.version().cell([3, -2])
}

#[test]
fn agreeing_heights_are_a_kalman_filter_with_growing_variance() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..200 {
        let mut inputs = Vec::new();
        // Scalar Kalman filter of a random walk: predict P += q dt, then gain K = P / (P + R).
        let (mut x, mut p, mut last) = (0.0, 0.0, 0);
        let mut n = 0;
        for source in 0..rng.random_range(2..9) {
            let time = last + rng.random_range(0..5000_i64);
            let sigma = 0.01 + 0.02 * rng.random::<f32>();
            let z = 1.0 + 0.005 * (rng.random::<f32>() - 0.5);
            inputs.push(pair(source, time, dot(ground(z, sigma))));
            let r = f64::from(sigma * sigma);
            if source == 0 {
                (x, p) = (f64::from(z), r);
            } else {
                p += 1e-6 * (time - last) as f64;
                let gain = p / (p + r);
                x += gain * (f64::from(z) - x);
                p *= 1.0 - gain;
            }
            last = time;
            n += 1;
        }
        let found = cell(&built(inputs));
        assert!((f64::from(found.height_m) - x).abs() < 1e-6, "{found:?}, expected {x}");
        assert!((f64::from(found.variance_m2) / p - 1.0).abs() < 1e-5, "{found:?}, expected {p}");
        assert_eq!((found.count, found.time_ns, found.flags), (n, last * S, Flags::NONE));
    }
}

#[test]
fn at_equal_times_the_order_does_not_matter() {
    let cells = [ground(0.10, 0.01), ground(0.11, 0.02), ground(0.105, 0.005)];
    let found: Vec<Cell> = [[0, 1, 2], [2, 1, 0], [1, 0, 2]]
        .map(|order| {
            let each = order.map(|i: usize| pair(i as u32, 7, dot(cells[i])));
            cell(&built(each.to_vec()))
        })
        .to_vec();
    let weights: f64 = [0.01, 0.02, 0.005].iter().map(|s: &f64| 1.0 / (s * s)).sum();
    for one in found {
        assert!((one.height_m - found_mean(&cells)).abs() < 1e-6);
        assert!((f64::from(one.variance_m2) * weights - 1.0).abs() < 1e-5);
    }
}

fn found_mean(cells: &[PairCell]) -> f32 {
    let weights: f64 = cells.iter().map(|c| 1.0 / f64::from(c.variance_m2)).sum();
    let sum: f64 = cells.iter().map(|c| f64::from(c.height_m) / f64::from(c.variance_m2)).sum();
    (sum / weights) as f32
}

/// Mean of (error / sigma)² of a cell after looks by views in this order, each with an error of its own
/// that it repeats.
fn normalized(views: &[u32], own: f32, common: f32, says: f32) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut normal = || (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
    // Each cell is a world of its own.
    let n = 3000;
    let repeated: Vec<[f32; 4]> = (0..n).map(|_| [0; 4].map(|_| common * normal())).collect();
    let look = |(i, view): (usize, &u32)| {
        let seen = |of: &[f32; 4]| PairCell {
            variance_m2: own * own + common * common,
            common_m2: says * common * common,
            ..ground(of[*view as usize] + own * normal(), 0.0)
        };
        let cells = repeated.iter().map(seen).collect();
        let dem = PairDem::new(0.05, [0, 0], 60, cells).unwrap().seen_from(*view);
        pair(i as u32, 0, Arc::new(dem))
    };
    let looks = views.iter().enumerate().map(look).collect();
    let wide = MapSettings { gate_sigmas: 50.0, ..settings() };
    let mapper = Mapper::rebuild(wide, looks).unwrap();
    let square = |i: usize| {
        let found = mapper.version().cell([(i % 60) as i32, (i / 60) as i32]);
        f64::from(found.height_m).powi(2) / f64::from(found.variance_m2)
    };
    (0..n).map(square).sum::<f64>() / n as f64
}

#[test]
fn looking_again_from_the_same_place_is_as_sure_as_it_says() {
    let (own, common) = (0.006, 0.018);
    for views in [&[0; 9][..], &[0, 1, 2, 3], &[0]] {
        let found = normalized(views, own, common, 1.0);
        assert!((found - 1.0).abs() < 0.1, "{views:?}: {found}");
    }
    // Where views alternate, it is on the safe side.
    let mixed = normalized(&[0, 1, 0, 1, 2, 0, 1, 2], own, common, 1.0);
    assert!(mixed > 0.3 && mixed < 1.05, "{mixed}");
    // Without a word of what is common, nine looks seem to be nine times as sure.
    let blind = normalized(&[0; 9], own, common, 0.0);
    assert!(blind > 6.0, "{blind}");
}

#[test]
fn age_inflates_variance_and_deletes_nothing() {
    let found = cell(&built(vec![pair(1, 100, dot(ground(0.5, 0.01)))]));
    for (seconds, expected) in [(100, 1e-4), (0, 1e-4), (10_100, 1e-4 + 1e-2)] {
        let variance = MapVersion::variance_at(&found, seconds * S, 1e-6);
        assert!((variance - expected).abs() < 1e-9, "{variance} after {seconds} s");
    }
    let year = 31_536_000 * S;
    let version = built(vec![pair(1, 100, dot(ground(0.5, 0.01)))]).version().clone();
    let read = version.elevation(ReadPolicy::default(), year, 86_400.0, Source::file("m"));
    let read = read.unwrap();
    let p = Point2::new(0.15, -0.1);
    assert_eq!(read.map.heights().nearest(p), Some(0.5));
    assert!(read.trust.nearest(p).unwrap() < 1e-6, "old ground is not trusted");
}

#[test]
fn contradictions_are_kept_until_a_third_observation_decides() {
    let (low, high) = (ground(0.0, 0.01), ground(0.2, 0.01));
    let two = built(vec![pair(1, 0, dot(low)), pair(2, 1, dot(high))]);
    let found = cell(&two);
    assert_eq!((found.height_m, found.flags), (0.0, Flags::CONFLICT));
    assert_eq!(found.rival.unwrap().height_m, 0.2);
    assert!(MapVersion::read(&found, ReadPolicy::default()).is_nan(), "unknown to planners");
    let higher = ReadPolicy { use_conflicts: true, ..ReadPolicy::default() };
    assert_eq!(MapVersion::read(&found, higher), 0.2);
    for (third, expected) in [(ground(0.002, 0.01), 0.001), (ground(0.202, 0.01), 0.201)] {
        let mut decided = two.clone();
        decided.push(pair(3, 1, dot(third))).unwrap();
        let found = cell(&decided);
        assert!((found.height_m - expected).abs() < 1e-3, "{found:?}");
        assert_eq!((found.flags, found.rival, found.count), (Flags::NONE, None, 2));
    }
    let mut open = two.clone();
    open.push(pair(3, 2, dot(ground(0.5, 0.01)))).unwrap();
    let found = cell(&open);
    assert_eq!((found.height_m, found.rival.unwrap().height_m), (0.2, 0.5), "the two newest");
    assert_eq!(found.flags, Flags::CONFLICT);
}

#[test]
fn hidden_cells_are_unknown_with_the_last_known_ground_underneath() {
    let seen = pair(1, 10, dot(ground(0.3, 0.01)));
    let masked = built(vec![seen.clone(), pair(2, 20, dot(hidden()))]);
    let found = cell(&masked);
    assert_eq!((found.height_m, found.flags, found.time_ns), (0.3, Flags::ROBOT, 10 * S));
    assert!(MapVersion::read(&found, ReadPolicy::default()).is_nan());
    let old = ReadPolicy { use_masked: true, ..ReadPolicy::default() };
    assert_eq!(MapVersion::read(&found, old), 0.3);
    // Seen again later: uncovered. A picture from before the leg came does not uncover it.
    for (time, is_known) in [(30, true), (15, false)] {
        let mut again = masked.clone();
        again.push(pair(3, time, dot(ground(0.3, 0.01)))).unwrap();
        let read = MapVersion::read(&cell(&again), ReadPolicy::default());
        assert_eq!(!read.is_nan(), is_known, "seen at {time} s");
    }
    // A leg seen earlier does not hide ground seen later.
    let late = built(vec![seen, pair(2, 5, dot(hidden()))]);
    assert_eq!(cell(&late).flags, Flags::NONE);
}

#[test]
fn an_imported_map_gives_way_to_what_is_seen_and_never_enters_it() {
    let prior = |source| Input::Prior { source, dem: dot(ground(9.0, 0.5)), time_ns: 1000 * S };
    let seen = pair(2, 5, dot(ground(0.1, 0.01)));
    for inputs in [vec![prior(1), seen.clone()], vec![seen, prior(1)]] {
        let found = cell(&built(inputs));
        assert_eq!((found.height_m, found.flags), (0.1, Flags::NONE));
    }
    let alone = cell(&built(vec![prior(1)]));
    assert_eq!((alone.height_m, alone.flags), (9.0, Flags::PRIOR));
    assert!(MapVersion::read(&alone, ReadPolicy::default()).is_nan());
    assert_eq!(MapVersion::read(&alone, ReadPolicy::with_prior()), 9.0);
}

#[test]
fn a_wheel_sets_the_ground_that_it_stood_on() {
    let flat: Vec<PairCell> = vec![ground(0.0, 0.03); 41 * 41];
    let dem = Arc::new(PairDem::new(0.05, [-20, -20], 41, flat).unwrap());
    let normal = Unit::new_normalize(Vector3::new(-0.2, 0.1, 1.0));
    let contact = |source| Input::Contact {
        source,
        position_m: Point3::new(0.11, -0.03, 0.04),
        normal,
        radius_m: 0.12,
        variance_m2: 2.5e-5,
        time_ns: 50 * S,
    };
    let mapper = built(vec![pair(1, 0, dem.clone()), pair(2, 40, dot(hidden())), contact(3)]);
    let mut n_set = 0;
    for iy in -20..=20 {
        for ix in -20..=20 {
            let cell = mapper.version().cell([ix, iy]);
            let (dx, dy) = (0.05 * f64::from(ix) - 0.11, 0.05 * f64::from(iy) + 0.03);
            if dx.hypot(dy) <= 0.12 {
                // The plane through the contact: n . (p - contact) = 0.
                let expected = 0.04 + 0.2 * dx - 0.1 * dy;
                assert!((f64::from(cell.height_m) - expected).abs() < 1e-6);
                assert_eq!((cell.flags, cell.time_ns), (Flags::CONTACT, 50 * S));
                n_set += 1;
            } else {
                assert_eq!(cell.height_m, 0.0);
            }
        }
    }
    // Counted by hand on squared paper: 0 + 4 + 5 + 5 + 3 cells in the rows from y = -0.15 m on.
    assert_eq!(n_set, 17, "cells within 0.12 m");
    // The wheel, in later pictures of the place, does not take the height away again.
    let wheel = Arc::new(PairDem::new(0.05, [2, -1], 1, vec![hidden()]).unwrap());
    let mut later = mapper;
    later.push(pair(9, 60, wheel)).unwrap();
    let cell = later.version().cell([2, -1]);
    assert_eq!(cell.flags, Flags::CONTACT | Flags::ROBOT);
    assert_eq!(MapVersion::read(&cell, ReadPolicy::default()), cell.height_m);
}

#[test]
fn where_the_robot_moved_the_ground_is_less_sure() {
    let flat: Vec<PairCell> = vec![ground(0.0, 0.02); 81 * 81];
    let dem = Arc::new(PairDem::new(0.05, [-40, -40], 81, flat).unwrap());
    let event =
        Input::Disturbance { position_m: Point2::origin(), radius_m: 1.0, variance_m2: 4e-4 };
    let mapper = built(vec![pair(1, 0, dem), event]);
    for (index, expected) in [([0, 0], 8e-4), ([20, 0], 8e-4), ([15, 15], 4e-4)] {
        let variance = mapper.version().cell(index).variance_m2;
        assert!((variance - expected).abs() < 1e-9, "{index:?}: {variance}");
    }
}

/// Random pairs over a few tiles: ground with noise and steps, holes, masks; and other inputs.
fn random_inputs(rng: &mut ChaCha8Rng, n: u32) -> Vec<Input> {
    (0..n)
        .map(|source| {
            let origin = [rng.random_range(-300..100), rng.random_range(-300..100)];
            let (nx, ny) = (rng.random_range(20..200), rng.random_range(20..200));
            let time_ns = i64::from(rng.random_range(0..50)) * S;
            let cells = (0..nx * ny)
                .map(|i| match rng.random_range(0..10) {
                    0 => PairCell::EMPTY,
                    1 => hidden(),
                    2 => PairCell { flags: Flags::MULTI, lower_m: -0.3, ..ground(0.4, 0.02) },
                    _ => ground(
                        0.02 * ((i % nx) as f32 * 0.1).sin() + 0.03 * rng.random::<f32>(),
                        0.01,
                    ),
                })
                .collect();
            let dem = Arc::new(PairDem::new(0.05, origin, nx, cells).unwrap());
            match rng.random_range(0..9) {
                0 => Input::Prior { source, dem, time_ns },
                1 => Input::Contact {
                    source,
                    position_m: Point3::new(-3.0 + rng.random::<f64>(), -2.0, 0.1),
                    normal: Vector3::z_axis(),
                    radius_m: 0.2,
                    variance_m2: 1e-5,
                    time_ns,
                },
                2 => Input::Disturbance {
                    position_m: Point2::new(-3.0, -2.0 + rng.random::<f64>()),
                    radius_m: 1.0,
                    variance_m2: 4e-4,
                },
                3 => {
                    let correction = Correction {
                        translation_m: Vector3::new(0.03, -0.07, 0.02) * rng.random::<f64>(),
                        yaw_rad: 0.02 * rng.random::<f64>(),
                        about_m: Point2::new(-2.0, -1.0),
                    };
                    let alignment = Alignment { correction, ..Alignment::NONE };
                    Input::Pair { source, dem, time_ns, alignment }
                }
                4 => Input::Stood {
                    source,
                    wheel: StandingWheel {
                        center_m: Point3::new(-3.2 + 0.4 * rng.random::<f64>(), -2.0, 0.25),
                        axle: Unit::new_normalize(Vector3::new(1.0, rng.random(), 0.1)),
                        radius_m: 0.264,
                        width_m: 0.24,
                        ball: false,
                    },
                    most_m: 0.2,
                    variance_m2: 1e-4,
                    time_ns,
                },
                _ => Input::Pair { source, dem, time_ns, alignment: Alignment::NONE },
            }
        })
        .collect()
}

fn bytes(version: &MapVersion) -> Vec<u8> {
    version.tiles().flat_map(|(_, tile)| tile.to_bytes()).collect()
}

#[test]
fn the_same_inputs_give_the_same_bytes_and_removing_one_is_never_having_had_it() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for _ in 0..6 {
        let inputs = random_inputs(&mut rng, 9);
        let mapper = built(inputs.clone());
        let again = std::thread::spawn({
            let inputs = inputs.clone();
            move || built(inputs)
        });
        let again = again.join().unwrap();
        assert_eq!(bytes(mapper.version()), bytes(again.version()));
        assert_eq!(mapper.version().id(), again.version().id());
        let Some(source) = inputs[rng.random_range(0..9)].source() else { continue };
        let before = mapper.version().clone();
        let mut fewer = mapper.clone();
        fewer.remove(source).unwrap();
        let never: Vec<Input> =
            inputs.iter().filter(|i| i.source() != Some(source)).cloned().collect();
        let never = built(never);
        assert_eq!(bytes(fewer.version()), bytes(never.version()));
        assert_eq!(fewer.version().id(), never.version().id());
        assert_eq!(before.id(), again.version().id(), "the version before is as it was");
    }
}

#[test]
fn a_correction_taken_back_gives_the_map_as_it_was() {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let inputs = random_inputs(&mut rng, 8);
    let mut mapper = built(inputs);
    let plain = mapper.pairs().find(|pair| pair.alignment.correction == Correction::NONE);
    let source = plain.unwrap().source;
    let id = mapper.version().id();
    let correction = Correction {
        translation_m: Vector3::new(0.05, 0.02, -0.1),
        yaw_rad: 0.01,
        about_m: Point2::new(1.0, 2.0),
    };
    mapper.correct(source, correction).unwrap();
    assert_ne!(mapper.version().id(), id);
    let record = mapper.pairs().find(|pair| pair.source == source).unwrap();
    assert!(record.alignment.is_chosen && record.alignment.correction == correction);
    let all = mapper.inputs().to_vec();
    assert_eq!(built(all).version().id(), mapper.version().id(), "as rebuilt from its inputs");
    mapper.correct(source, Correction::NONE).unwrap();
    assert_eq!(mapper.version().id(), id);
}

#[test]
fn changes_are_the_cells_that_differ_and_other_tiles_are_shared() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..2 {
        let mut mapper = built(random_inputs(&mut rng, 5));
        let before = mapper.version().clone();
        let next = random_inputs(&mut rng, 12)
            .into_iter()
            .find(|i| matches!(i, Input::Pair { source, .. } if *source >= 5));
        mapper.push(next.unwrap()).unwrap();
        let after = mapper.version().clone();
        let changes = after.changes_since(&before);
        let (mut n, mut appeared, mut vanished) = (0, 0, 0);
        let bits = |c: &Cell| {
            let floats = [c.height_m, c.variance_m2, c.lower_m].map(f32::to_bits);
            (floats, c.count, c.time_ns, c.source, c.flags, c.masked_ns, format!("{:?}", c.rival))
        };
        let known = |c: &Cell| !MapVersion::read(c, ReadPolicy::default()).is_nan();
        for iy in -512..512 {
            for ix in -512..512 {
                let (a, b) = (before.cell([ix, iy]), after.cell([ix, iy]));
                n += usize::from(bits(&a) != bits(&b));
                appeared += usize::from(!known(&a) && known(&b));
                vanished += usize::from(known(&a) && !known(&b));
            }
        }
        assert_eq!((changes.cells, changes.appeared, changes.vanished), (n, appeared, vanished));
        assert_eq!(changes.tiles.iter().map(|(_, n)| n).sum::<usize>(), n);
        for (index, tile) in before.tiles() {
            let is_changed = changes.tiles.iter().any(|(changed, _)| changed == index);
            let (_, new) = after.tiles().find(|(other, _)| *other == index).unwrap();
            assert!(is_changed || Arc::ptr_eq(tile, new) || tile.hash() == new.hash());
        }
        assert_eq!(before.changes_since(&before).cells, 0);
    }
}

#[test]
fn layers_judged_again_for_changed_tiles_are_those_of_the_new_version() {
    let mut rng = ChaCha8Rng::seed_from_u64(14);
    let floor = |source| {
        let cells = vec![ground(0.0, 0.01); 700 * 300];
        pair(source, 0, Arc::new(PairDem::new(0.05, [-500, -200], 700, cells).unwrap()))
    };
    let mut mapper = built(vec![floor(100)]);
    let read = |version: &MapVersion| {
        let policy = ReadPolicy::default();
        version.elevation(policy, 60 * S, 1e4, Source::file("m")).unwrap()
    };
    let limits = Limits::default();
    let observed = read(mapper.version());
    let mut layers = trusted_traversability(&observed.map, &observed.trust, 0.75, &limits).unwrap();
    let mut n_partial = 0;
    for input in random_inputs(&mut rng, 8) {
        let before = mapper.version().clone();
        mapper.push(input).unwrap();
        let observed = read(mapper.version());
        let changes = mapper.version().changes_since(&before);
        let anew = trusted_traversability(&observed.map, &observed.trust, 0.75, &limits).unwrap();
        match changes.spans(observed.map.grid()) {
            Some(spans) if layers.class.grid() == observed.map.grid() => {
                let judged = layers.update(&observed.map, Some(&observed.trust), &spans).unwrap();
                n_partial += usize::from(judged < observed.map.grid().len());
            }
            _ => layers = anew.clone(),
        }
        let bits = |layer: &geometry::Raster<f32>| -> Vec<u32> {
            layer.values().iter().map(|v| v.to_bits()).collect()
        };
        assert_eq!(layers.class.values(), anew.class.values());
        assert_eq!(bits(&layers.goodness), bits(&anew.goodness));
        assert_eq!(bits(&layers.certainty), bits(&anew.certainty));
    }
    assert!(n_partial > 3, "{n_partial} of 8 inputs were judged in part");
}

#[test]
fn unknown_never_becomes_safe_by_age_masks_conflicts_or_imports() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let limits = Limits::default();
    let classes = |version: &MapVersion, seconds: i64| {
        let read = version.elevation(ReadPolicy::default(), seconds * S, 1e4, Source::file("m"));
        let read = read.unwrap();
        let layers = trusted_traversability(&read.map, &read.trust, 0.75, &limits).unwrap();
        (*read.map.grid(), read.map.heights().clone(), layers.class)
    };
    for _ in 0..4 {
        let flat: Vec<PairCell> = (0..120 * 90)
            .map(|_| if rng.random::<f64>() < 0.3 { PairCell::EMPTY } else { ground(0.0, 0.01) })
            .collect();
        let dem = Arc::new(PairDem::new(0.05, [-60, -50], 120, flat).unwrap());
        let mut mapper = built(vec![pair(0, 0, dem.clone())]);
        let (grid, heights, young) = classes(mapper.version(), 0);
        let (_, _, old) = classes(mapper.version(), 1_000_000);
        for (a, b) in young.values().iter().zip(old.values()) {
            assert!(*b <= *a || *a != 0, "age made {a} into {b}");
            assert!(*b < 3, "ground of eleven days is never plainly safe");
        }
        // Neither a mask, nor a contradiction, nor an imported map tells planners of a cell.
        let worse: Vec<PairCell> = dem
            .cells()
            .iter()
            .map(|c| match rng.random_range(0..3) {
                0 => hidden(),
                1 if c.is_ground() => ground(1.0, 0.01),
                _ => PairCell::EMPTY,
            })
            .collect();
        let worse = Arc::new(PairDem::new(0.05, [-60, -50], 120, worse).unwrap());
        mapper.push(pair(1, 5, worse)).unwrap();
        let import = Arc::new(
            PairDem::new(0.05, [-60, -50], 120, vec![ground(0.0, 0.3); 120 * 90]).unwrap(),
        );
        mapper.push(Input::Prior { source: 2, dem: import, time_ns: 9 * S }).unwrap();
        let (again, fewer, after) = classes(mapper.version(), 9);
        assert_eq!(grid, again);
        for (i, (a, b)) in heights.values().iter().zip(fewer.values()).enumerate() {
            assert!(!a.is_nan() || b.is_nan(), "cell {i} became known");
        }
        for (a, b) in young.values().iter().zip(after.values()) {
            assert!(*a != 0 || *b == 0, "unknown became {b}");
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_and_changes_nothing() {
    let mut mapper = built(vec![pair(1, 0, dot(ground(0.0, 0.01)))]);
    let id = mapper.version().id();
    let far = Arc::new(PairDem::new(0.05, [1 << 22, 0], 1, vec![ground(0.0, 0.1)]).unwrap());
    let coarse = Arc::new(PairDem::new(0.1, [0, 0], 1, vec![ground(0.0, 0.1)]).unwrap());
    let wide: Vec<PairCell> = vec![ground(0.0, 0.1); 5000 * TILE];
    let wide = Arc::new(PairDem::new(0.05, [0, 0], 5000, wide).unwrap());
    let refused = |mapper: &mut Mapper, input| mapper.push(input).unwrap_err();
    assert!(matches!(
        refused(&mut mapper, pair(1, 0, dot(hidden()))),
        TerrainError::MapSource { source_id: 1, .. }
    ));
    assert!(matches!(
        refused(&mut mapper, pair(2, 0, coarse)),
        TerrainError::OtherResolution { .. }
    ));
    let nan = Input::Disturbance {
        position_m: Point2::new(f64::NAN, 0.0),
        radius_m: 1.0,
        variance_m2: 1.0,
    };
    assert!(matches!(refused(&mut mapper, nan), TerrainError::OutOfRange { .. }));
    let small = MapSettings { tiles_max: 19, ..settings() };
    let mut small = Mapper::new(small).unwrap();
    assert!(matches!(refused(&mut small, pair(3, 0, wide)), TerrainError::TooManyTiles { .. }));
    assert_eq!(small.version().tiles().count(), 0);
    mapper.push(pair(9, 0, far)).unwrap();
    mapper.remove(9).unwrap();
    assert_eq!(mapper.version().id(), id);
    assert!(matches!(mapper.remove(9), Err(TerrainError::MapSource { source_id: 9, .. })));
}
