//! Maps of single pairs: from points to cells, and alignment against known truth.

use std::sync::Arc;

use nalgebra::{Point2, Point3, Rotation2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::fusion::{
    AlignSettings, Correction, Flags, MapSettings, MapVersion, Mapper, Measurement, PairDem,
    RasterizeOptions, ReadPolicy, Refusal, Tag, align, align_together, rasterize,
};
use terrain::synthetic::{Recipe, generate};
use terrain::{ElevationMap, Source, TerrainError};

fn point(x: f64, y: f64, z: f64, sigma: f64, tag: Tag) -> Measurement {
    Measurement {
        position_m: Point3::new(x, y, z),
        height_variance_m2: sigma * sigma,
        common_variance_m2: 0.0,
        footprint_m: 0.0,
        tag,
    }
}

/// Normal deviate (Box-Muller).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

#[test]
fn cells_are_the_weighted_means_of_their_points() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let points: Vec<_> = (0..20_000)
        .map(|_| {
            let (x, y) = (4.0 * rng.random::<f64>() - 2.0, 3.0 * rng.random::<f64>() - 1.0);
            let tag = [Tag::Terrain, Tag::Terrain, Tag::Terrain, Tag::Robot, Tag::ShadowBand]
                [rng.random_range(0..5)];
            let z = 0.1 * x + 0.004 * normal(&mut rng);
            Measurement {
                footprint_m: 0.12 * rng.random::<f64>(),
                ..point(x, y, z, 0.01 + 0.02 * rng.random::<f64>(), tag)
            }
        })
        .collect();
    let options = RasterizeOptions { correlated_points: 5.0, ..RasterizeOptions::default() };
    let dem = rasterize(&points, &options).unwrap().dem;
    let mut n_ground = 0;
    for ([ix, iy], cell) in dem.indexed().step_by(7) {
        let (cx, cy) = (0.05 * f64::from(ix), 0.05 * f64::from(iy));
        // In the cell, or with the node within half a pixel.
        let counts = |p: &&Measurement| {
            let (dx, dy) = ((p.position_m.x - cx).abs(), (p.position_m.y - cy).abs());
            let near = |d: f64| d <= 0.5 * p.footprint_m || d < 0.025;
            near(dx) && near(dy)
        };
        let of = |tag: Tag| points.iter().filter(counts).filter(move |p| p.tag == tag);
        let weight: f64 = of(Tag::Terrain).map(|p| 1.0 / p.height_variance_m2).sum();
        let sum: f64 = of(Tag::Terrain).map(|p| p.position_m.z / p.height_variance_m2).sum();
        let n = of(Tag::Terrain).count();
        if n == 0 {
            assert!(!cell.is_ground());
            assert_eq!(cell.flags.any(Flags::ROBOT), of(Tag::Robot).count() > 0);
            assert_eq!(cell.flags.any(Flags::SHADOW_BAND), of(Tag::ShadowBand).count() > 0);
            continue;
        }
        n_ground += 1;
        assert_eq!(usize::from(cell.count), n);
        assert!((f64::from(cell.height_m) - sum / weight).abs() < 1e-6);
        let variance = f64::min(n as f64, 5.0) / weight;
        assert!((f64::from(cell.variance_m2) / variance - 1.0).abs() < 1e-5);
        assert_eq!(cell.flags, Flags::NONE);
    }
    assert!(n_ground > 400);
}

#[test]
fn a_cell_with_two_surfaces_keeps_both() {
    let cluster =
        |z: f64| (0..4).map(move |i| point(0.001 * f64::from(i), 0.0, z, 0.01, Tag::Terrain));
    let two: Vec<_> = cluster(0.0).chain(cluster(0.3)).collect();
    let cell = rasterize(&two, &RasterizeOptions::default()).unwrap().dem.at([0, 0]);
    assert_eq!((cell.height_m, cell.lower_m, cell.flags, cell.count), (0.3, 0.0, Flags::MULTI, 4));
    // Neither four standard deviations of noise nor a single stray point is a second surface.
    for (gap, sigma) in [(0.1, 0.03), (0.02, 0.001)] {
        let one: Vec<_> = cluster(0.0)
            .chain(cluster(gap))
            .map(|p| Measurement { height_variance_m2: sigma * sigma, ..p })
            .collect();
        let cell = rasterize(&one, &RasterizeOptions::default()).unwrap().dem.at([0, 0]);
        assert_eq!(cell.flags, Flags::NONE, "a gap of {gap} m at {sigma} m");
    }
    let stray: Vec<_> = cluster(0.0).chain(cluster(1.0).take(1)).collect();
    let cell = rasterize(&stray, &RasterizeOptions::default()).unwrap().dem.at([0, 0]);
    assert_eq!(cell.flags, Flags::NONE);
}

#[test]
fn unusable_points_are_refused_by_name() {
    let good = point(0.0, 0.0, 0.0, 0.01, Tag::Terrain);
    let refused = |p: Measurement| rasterize(&[good, p], &RasterizeOptions::default()).unwrap_err();
    type Change = fn(&mut Measurement);
    let changes: [(&str, Change); 5] = [
        ("position_m.x", |p| p.position_m.x = f64::NAN),
        ("position_m.y", |p| p.position_m.y = 1e12),
        ("position_m.z", |p| p.position_m.z = f64::NEG_INFINITY),
        ("height_variance_m2", |p| p.height_variance_m2 = 0.0),
        ("footprint_m", |p| p.footprint_m = -1.0),
    ];
    for (name, change) in changes {
        let mut p = good;
        change(&mut p);
        let found = refused(p);
        assert!(
            matches!(found, TerrainError::Point { index: 1, field, .. } if field == name),
            "{found}"
        );
    }
    // Two far points would make a map of 10^12 cells.
    let far = point(40_000.0, 40_000.0, 0.0, 0.01, Tag::Terrain);
    assert!(matches!(refused(far), TerrainError::TooManyNodes { .. }));
    let vague = point(0.0, 0.0, 0.0, 9.0, Tag::Terrain);
    let found = rasterize(&[good, vague], &RasterizeOptions::default()).unwrap();
    assert_eq!(found.n_dropped, 1);
    assert_eq!(rasterize(&[vague], &RasterizeOptions::default()), Err(TerrainError::NoKnownHeight));
}

/// What a pair sees of ground (within 4 m of a place) that tells its points in a frame that is off: a point that it
/// tells at `p` truly is at `truth.apply(p)`.
fn seen(map: &ElevationMap, truth: &Correction, center: [f64; 2], seed: u64) -> Arc<PairDem> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let sigma = 0.006;
    let mut points = Vec::new();
    while points.len() < 60_000 {
        let (x, y) = (8.0 * rng.random::<f64>() - 4.0, 8.0 * rng.random::<f64>() - 4.0);
        let p = Point2::new(center[0] + x, center[1] + y);
        let z = map.height_at(p).unwrap() + sigma * normal(&mut rng);
        // The inverse of the correction, in plain words.
        let back = p - truth.translation_m.xy() - truth.about_m;
        let told = truth.about_m + Rotation2::new(-truth.yaw_rad) * back;
        points.push(point(told.x, told.y, z - truth.translation_m.z, sigma, Tag::Terrain));
    }
    Arc::new(rasterize(&points, &RasterizeOptions::default()).unwrap().dem)
}

fn first(map: &ElevationMap) -> Mapper {
    let mut mapper = Mapper::new(MapSettings::default()).unwrap();
    let dem = seen(map, &Correction::NONE, [-1.0, 0.0], 1);
    mapper.add_pair(1, dem, 0, &AlignSettings::default()).unwrap();
    mapper
}

#[test]
fn known_offsets_are_found_on_rough_ground() {
    let recipe = Recipe { flat_center_m: 0.0, ..Recipe::boulder_field() };
    let map = generate(&recipe, 3).unwrap();
    let mapper = first(&map);
    let offsets = [
        (0.0, 0.0, 0.0, 0.0),
        (0.05, -0.03, 0.02, 0.5),
        (-0.08, 0.06, -0.05, -1.0),
        (0.02, 0.1, 0.07, 1.5),
    ];
    for (i, (dx, dy, dz, degrees)) in offsets.into_iter().enumerate() {
        let truth = Correction {
            translation_m: Vector3::new(dx, dy, dz),
            yaw_rad: f64::to_radians(degrees),
            about_m: Point2::new(1.0, 0.5),
        };
        let dem = seen(&map, &truth, [1.0, 0.5], 10 + i as u64);
        let found = align(&dem, mapper.version(), &AlignSettings::default()).unwrap();
        assert_eq!(found.refusal, None, "{offsets:?} {i}");
        let mut worst = 0.0_f64;
        for (x, y) in [(-3.0, -3.0), (4.0, -3.0), (1.0, 0.5), (4.0, 4.0), (-3.0, 4.0)] {
            let p = Point3::new(x, y, 0.0);
            worst = worst.max((found.correction.apply(p) - truth.apply(p)).norm());
        }
        assert!(worst < 0.012, "{worst} m off for {truth:?}: {found:?}");
        assert!(found.residual_after <= found.residual_before);
        assert!(found.cells > 2000, "{} cells", found.cells);
    }
}

#[test]
fn a_plane_shows_its_height_and_nothing_else() {
    let map = ElevationMap::plane(12.0, 0.5).unwrap();
    let mapper = first(&map);
    let truth = Correction {
        translation_m: Vector3::new(0.1, -0.05, 0.03),
        yaw_rad: 0.01,
        about_m: Point2::origin(),
    };
    let dem = seen(&map, &truth, [1.0, 0.5], 5);
    let found = align(&dem, mapper.version(), &AlignSettings::default()).unwrap();
    let t = found.correction.translation_m;
    assert!((t.z - 0.03).abs() < 1e-3 && t.xy().norm() < 5e-3, "{t}");
    assert!(found.correction.yaw_rad.abs() < 2e-3);
    assert!(found.sigma[2] < 1e-3 && found.sigma[0] > 2.0 * found.sigma[2], "{:?}", found.sigma);
}

#[test]
fn what_is_too_far_or_has_too_little_in_common_stays_where_it_is() {
    let map = generate(&Recipe::boulder_field(), 4).unwrap();
    let mut mapper = first(&map);
    let high = Correction { translation_m: Vector3::new(0.0, 0.0, 0.3), ..Correction::NONE };
    let dem = seen(&map, &high, [0.0, 0.0], 6);
    let found = mapper.add_pair(2, dem, 1, &AlignSettings::default()).unwrap();
    let Some(Refusal::OutOfBounds { shift_m, .. }) = found.refusal else { panic!("{found:?}") };
    assert!((shift_m - 0.3).abs() < 0.02, "{shift_m}");
    assert_eq!(found.correction, Correction::NONE);
    let beside = seen(&map, &Correction::NONE, [7.9, 7.9], 7);
    let found = mapper.add_pair(3, beside, 2, &AlignSettings::default()).unwrap();
    assert_eq!(found.refusal, Some(Refusal::TooFewCells { cells: 0, needed: 200 }));
    assert_eq!(mapper.pairs().count(), 3);
}

#[test]
fn blended_pairs_are_as_near_the_truth_as_they_say() {
    let recipe = Recipe { rock_abundance: 0.0, crater_density: 0.0, ..Recipe::boulder_field() };
    let map = generate(&recipe, 8).unwrap();
    let mut mapper = first(&map);
    for (i, (dx, dz)) in [(0.04, 0.03), (-0.05, -0.02), (0.02, 0.05)].into_iter().enumerate() {
        let truth = Correction { translation_m: Vector3::new(dx, 0.02, dz), ..Correction::NONE };
        let dem = seen(&map, &truth, [0.3 * i as f64, 0.2], 20 + i as u64);
        let settings = AlignSettings::default();
        let found = mapper.add_pair(2 + i as u32, dem, i as i64, &settings).unwrap();
        assert_eq!(found.refusal, None);
    }
    let read = mapper.version().elevation(ReadPolicy::default(), 0, 1e9, Source::file("m"));
    let read = read.unwrap();
    let (mut squares, mut normalized, mut n) = (0.0, 0.0, 0.0);
    for iy in -60..60 {
        for ix in -60..60 {
            let cell = mapper.version().cell([ix, iy]);
            let p = Point2::new(0.05 * f64::from(ix), 0.05 * f64::from(iy));
            let (Some(z), Some(truth)) = (read.map.height_at(p), map.height_at(p)) else {
                continue;
            };
            squares += (z - truth).powi(2);
            normalized += (z - truth).powi(2) / MapVersion::variance_at(&cell, 0, 0.0);
            n += 1.0;
        }
    }
    let (rmse, ratio) = (f64::sqrt(squares / n), f64::sqrt(normalized / n));
    assert!(n > 14_000.0, "{n} cells known");
    assert!(rmse < 0.004, "RMSE {rmse} m");
    assert!(ratio < 1.3, "errors are {ratio} of what the map says");
}

#[test]
fn moving_a_map_by_whole_cells_moves_its_cells_and_edges_stay_edges() {
    let mut points = Vec::new();
    for iy in 0..40 {
        for ix in 0..40 {
            let z = if ix < 20 { 0.0 } else { 0.3 };
            points.push(point(0.05 * f64::from(ix), 0.05 * f64::from(iy), z, 0.01, Tag::Terrain));
        }
    }
    let dem = rasterize(&points, &RasterizeOptions::default()).unwrap().dem;
    let shift =
        |x: f64, z: f64| Correction { translation_m: Vector3::new(x, 0.0, z), ..Correction::NONE };
    let moved = dem.moved(&shift(0.1, 0.5));
    for ([ix, iy], cell) in dem.indexed() {
        let there = moved.at([ix + 2, iy]);
        assert!((there.height_m - cell.height_m - 0.5).abs() < 1e-6, "{ix}, {iy}: {there:?}");
    }
    let half = dem.moved(&shift(0.02, 0.0));
    let is_edge = |z: f32| z.is_nan() || z.abs() < 1e-6 || (z - 0.3).abs() < 1e-6;
    assert!(half.cells().iter().all(|cell| is_edge(cell.height_m)), "no cell between the steps");
}

/// A strip of what a pair sees, told by `truth` off, with errors in common of `common` (m).
fn strip(map: &ElevationMap, truth: &Correction, x: [f64; 2], common: f64, seed: u64) -> PairDem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut points = Vec::new();
    while points.len() < 30_000 {
        let p = Point2::new(
            x[0] + (x[1] - x[0]) * rng.random::<f64>(),
            4.0 * rng.random::<f64>() - 2.0,
        );
        let z = map.height_at(p).unwrap() + 0.006 * normal(&mut rng);
        let back = p - truth.translation_m.xy() - truth.about_m;
        let told = truth.about_m + Rotation2::new(-truth.yaw_rad) * back;
        points.push(Measurement {
            common_variance_m2: common * common,
            ..point(told.x, told.y, z - truth.translation_m.z, 0.006, Tag::Terrain)
        });
    }
    // Its noise is known: relief comes on top in the field only.
    let options = RasterizeOptions { relief_share: 0.0, ..RasterizeOptions::default() };
    rasterize(&points, &options).unwrap().dem
}

#[test]
fn the_pairs_of_a_stand_are_fitted_to_each_other_by_no_more_than_they_share() {
    let recipe = Recipe { flat_center_m: 0.0, ..Recipe::boulder_field() };
    let map = generate(&recipe, 5).unwrap();
    let off = |dz: f64, degrees: f64| Correction {
        translation_m: Vector3::new(0.0, 0.0, dz),
        yaw_rad: f64::to_radians(degrees),
        about_m: Point2::origin(),
    };
    // Three strips in a row, each overlapping the next by a meter; the middle one is off.
    let truths = [off(0.0, 0.0), off(0.012, 0.0), off(0.0, 0.0)];
    let spans = [[-5.5, -1.5], [-2.5, 2.5], [1.5, 5.5]];
    let settings = AlignSettings { pair_shift_sigma_m: 0.02, ..AlignSettings::default() };
    let fitted = |common: f64| {
        let dems: Vec<PairDem> =
            (0..3).map(|i| strip(&map, &truths[i], spans[i], common, 40 + i as u64)).collect();
        let seams = |by: &[Correction]| {
            let mut worst = 0.0_f64;
            for k in 0..2 {
                let x = [-2.0, 2.0][k];
                let z =
                    |i: usize| by[i].apply(Point3::new(x, 0.0, 0.0)).z - truths[i].translation_m.z;
                worst = worst.max((z(k) - z(k + 1)).abs());
            }
            worst
        };
        let map = MapVersion::empty(0.05);
        let found = align_together(&dems.iter().collect::<Vec<_>>(), &map, &settings).unwrap();
        assert!(found.iter().all(|f| f.refusal.is_none()), "{found:?}");
        let by: Vec<Correction> = found.iter().map(|f| f.correction).collect();
        let z: Vec<f64> = by.iter().map(|c| c.translation_m.z).collect();
        (seams(&by), z)
    };
    let (seam, z) = fitted(0.0);
    assert!(seam < 0.002, "{seam} {z:?}");
    // Nothing tells where all three are: they stay about where they said on the whole.
    assert!(z.iter().sum::<f64>().abs() < 0.004, "{z:?}");
    // Where each may be 5 cm off in a way that no shift mends, what they differ by says little.
    let (seam, z) = fitted(0.05);
    assert!(seam > 0.008 && z.iter().all(|z| z.abs() < 0.004), "{seam} {z:?}");
    // With the map, the rover's place is found: all are moved as one.
    let mapper = first(&map);
    let place = Correction { translation_m: Vector3::new(0.05, -0.04, 0.06), ..off(0.0, 0.8) };
    let dems: Vec<PairDem> =
        (0..2).map(|i| strip(&map, &place, spans[i], 0.0, 50 + i as u64)).collect();
    let dems: Vec<&PairDem> = dems.iter().collect();
    for found in align_together(&dems, mapper.version(), &AlignSettings::default()).unwrap() {
        for p in [Point3::new(-4.0, 1.0, 0.0), Point3::new(0.0, -1.0, 0.0)] {
            let miss = (found.correction.apply(p) - place.apply(p)).norm();
            assert!(miss < 0.015, "{miss}: {found:?}");
        }
    }
    // One that is too far off stays, and does not draw the others along.
    let far = strip(&map, &off(0.4, 0.0), spans[1], 0.0, 60);
    let [left, right] = [0, 2].map(|i| strip(&map, &truths[i], spans[i], 0.0, 61 + i as u64));
    let loose = AlignSettings { pair_shift_sigma_m: 1.0, shift_sigma_m: 1.0, ..settings };
    let found = align_together(&[&left, &far, &right], mapper.version(), &loose).unwrap();
    assert!(matches!(found[1].refusal, Some(Refusal::OutOfBounds { .. })), "{:?}", found[1]);
    for found in [&found[0], &found[2]] {
        assert!(found.correction.translation_m.norm() < 0.01, "{found:?}");
    }
}

/// One point a cell, of so little noise that relief alone counts.
fn raster(height: impl Fn(i32, i32) -> f64, relief_share: f64) -> PairDem {
    let nodes = (0..9).flat_map(|iy| (0..9).map(move |ix| (ix, iy)));
    let points: Vec<Measurement> = nodes
        .map(|(ix, iy)| Measurement {
            position_m: Point3::new(0.05 * f64::from(ix), 0.05 * f64::from(iy), height(ix, iy)),
            height_variance_m2: 1e-8,
            common_variance_m2: 1e-6,
            footprint_m: 0.0,
            tag: Tag::Terrain,
        })
        .collect();
    rasterize(&points, &RasterizeOptions { relief_share, ..RasterizeOptions::default() })
        .unwrap()
        .dem
}

#[test]
fn heights_are_as_unsure_as_the_relief_about_them() {
    // A plane has none, however steep.
    let plane = |ix: i32, iy: i32| 0.03 * f64::from(ix) - 0.02 * f64::from(iy);
    let (with, without) = (raster(plane, 0.5), raster(plane, 0.0));
    for (a, b) in with.cells().iter().zip(without.cells()) {
        assert!((a.variance_m2 - b.variance_m2).abs() < 1e-8, "{a:?} {b:?}");
    }
    // Of nine heights the middle one is 0.09 m up: they are 0.09² (1 - 1/9) from their plane, over six degrees of freedom.
    let with = raster(|ix, iy| if (ix, iy) == (4, 4) { 0.09 } else { 0.0 }, 0.5);
    let expected = 0.25 * 0.0081 * (8.0 / 9.0) / 6.0;
    let found = f64::from(with.at([4, 4]).variance_m2);
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    assert_eq!(with.at([4, 4]).common_m2, without.at([4, 4]).common_m2);
    assert!(with.at([1, 4]).variance_m2 < 2e-6, "three cells off nothing is the matter");
}
