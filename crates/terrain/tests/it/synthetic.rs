//! Generated ground against the laws its recipe states.

use nalgebra::Point2;
use terrain::synthetic::{Recipe, SyntheticScene, add_detail, generate, generate_scene};
use terrain::{ElevationMap, SourceKind, TerrainError};

/// Relief alone.
fn relief(hurst: f64, degrees: f64) -> Recipe {
    Recipe {
        hurst,
        slope_rms_at_1m_rad: f64::to_radians(degrees),
        rock_abundance: 0.0,
        crater_density: 0.0,
        ..Recipe::boulder_field()
    }
}

/// RMS height difference of nodes `lag` (m) apart along x and y.
fn deviation(map: &ElevationMap, lag: f64) -> f64 {
    let grid = map.grid();
    let cells = (lag / grid.resolution).round() as usize;
    let z = |ix: usize, iy: usize| f64::from(*map.heights().at(ix, iy));
    let mut squares = Vec::new();
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            if ix + cells < grid.nx {
                squares.push((z(ix + cells, iy) - z(ix, iy)).powi(2));
            }
            if iy + cells < grid.ny {
                squares.push((z(ix, iy + cells) - z(ix, iy)).powi(2));
            }
        }
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn slopes_at_one_meter_are_those_of_the_recipe() {
    for degrees in [3.0, 6.0, 10.0] {
        let map = generate(&relief(0.7, degrees), 4).unwrap();
        let slope = deviation(&map, 1.0).atan().to_degrees();
        assert!((slope / degrees - 1.0).abs() < 0.01, "{slope} deg, expected {degrees}");
    }
}

#[test]
fn slopes_at_one_meter_are_distributed_as_those_of_a_gaussian_relief() {
    let (degrees, cells) = (6.0, 20);
    let sigma = f64::to_radians(degrees).tan();
    let mut slopes = Vec::new();
    for seed in 0..8 {
        let map = generate(&relief(0.7, degrees), 100 + seed).unwrap();
        assert_eq!(map.grid().resolution, 0.05);
        for iy in 0..map.grid().ny {
            for ix in 0..map.grid().nx - cells {
                let rise = map.heights().at(ix + cells, iy) - map.heights().at(ix, iy);
                slopes.push(f64::from(rise).abs());
            }
        }
    }
    // Shares of a normal distribution within so many standard deviations (Abramowitz & Stegun, table 26.1).
    for (deviations, share) in
        [(0.5, 0.382_925), (1.0, 0.682_689), (1.5, 0.866_386), (2.0, 0.954_500)]
    {
        let n = slopes.iter().filter(|s| **s <= deviations * sigma).count();
        let found = n as f64 / slopes.len() as f64;
        assert!((found / share - 1.0).abs() < 0.1, "{found} within {deviations}, not {share}");
    }
}

#[test]
fn relief_scales_with_its_hurst_exponent() {
    for hurst in [0.4, 0.55, 0.7] {
        let slopes: Vec<f64> = (0..6)
            .map(|seed| {
                let map = generate(&relief(hurst, 5.0), seed).unwrap();
                (deviation(&map, 1.6) / deviation(&map, 0.2)).ln() / 8.0_f64.ln()
            })
            .collect();
        let found = slopes.iter().sum::<f64>() / slopes.len() as f64;
        assert!((found - hurst).abs() < 0.1, "exponent {found}, expected {hurst}");
    }
}

fn scenes(recipe: &Recipe, n: u64) -> Vec<SyntheticScene> {
    (0..n).map(|seed| generate_scene(recipe, seed).unwrap()).collect()
}

#[test]
fn rocks_cover_the_share_of_ground_that_their_law_states() {
    let coarse = Recipe {
        resolution_m: 0.5,
        crater_density: 0.0,
        rock_diameter_min_m: 0.05,
        rock_diameter_max_m: 2.5,
        flat_center_m: 0.0,
        ..Recipe::boulder_field()
    };
    for k in [0.02, 0.06, 0.19] {
        let recipe = Recipe { rock_abundance: k, ..coarse };
        let n = 40;
        let scenes = scenes(&recipe, n);
        let q = 1.79 + 0.152 / k;
        for least in [0.05, 0.2, 0.4] {
            let in_tile = |c: Point2<f64>| c.x.abs() <= 12.0 && c.y.abs() <= 12.0;
            let rocks = scenes.iter().flat_map(|s| &s.rocks);
            let rocks = rocks.filter(|r| in_tile(r.center) && r.diameter_m >= least);
            let areas = rocks.map(|r| 0.25 * std::f64::consts::PI * r.diameter_m.powi(2));
            let (sum, squares) =
                areas.fold((0.0, 0.0), |(sum, squares), a| (sum + a, squares + a * a));
            let ground = 24.0 * 24.0 * n as f64;
            let (share, sigma) = (sum / ground, f64::sqrt(squares) / ground);
            let expected = k * ((-q * least).exp() - (-q * 2.5).exp());
            let off = (share - expected).abs();
            // 10 %, or what few large rocks vary by chance.
            assert!(
                off < (0.1 * expected).max(2.5 * sigma),
                "k {k}, D {least}: {share}, {expected}"
            );
        }
    }
}

#[test]
fn craters_are_as_many_as_their_law_states() {
    let recipe = Recipe {
        rock_abundance: 0.0,
        resolution_m: 0.5,
        flat_center_m: 0.0,
        ..Recipe::boulder_field()
    };
    let n = 40;
    let scenes = scenes(&recipe, n);
    for least in [0.8, 1.5, 2.5] {
        let craters = scenes.iter().flat_map(|s| &s.craters).filter(|c| {
            c.diameter_m >= least && c.center.x.abs() <= 12.0 && c.center.y.abs() <= 12.0
        });
        let found = craters.count() as f64;
        let density = 0.25 * 10.0_f64.powf(-1.1) * (1.0 / (least * least) - 1.0 / 36.0);
        let expected = density * 24.0 * 24.0 * n as f64;
        let tolerance = (0.1 * expected).max(3.0 * expected.sqrt());
        assert!((found - expected).abs() < tolerance, "{found}, expected {expected}");
    }
}

#[test]
fn every_large_rock_stands_out_of_the_ground_around_it() {
    let scene = generate_scene(&Recipe::boulder_field(), 7).unwrap();
    let inside = |p: Point2<f64>| p.x.abs() < 11.5 && p.y.abs() < 11.5;
    let large: Vec<_> =
        scene.rocks.iter().filter(|r| r.diameter_m > 0.4 && inside(r.center)).collect();
    assert!(large.len() >= 10, "the demo shows rocks: {}", large.len());
    for rock in large {
        let around = scene.map.footprint_plane(rock.center, 0.2).unwrap();
        let reach = 0.5 * rock.diameter_m * rock.elongation.sqrt() + 0.1;
        let beside = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(x, y)| {
            let p = Point2::new(rock.center.x + reach * x, rock.center.y + reach * y);
            scene.map.height_at(p).unwrap()
        });
        let lowest = beside.into_iter().fold(f64::MAX, f64::min);
        assert!(around.height > lowest + 0.5 * rock.height_m, "{rock:?}");
    }
}

#[test]
fn the_flat_center_is_free_of_rocks_and_craters() {
    let recipe = Recipe { flat_center_m: 3.0, ..Recipe::boulder_field() };
    let bare = generate(&relief(0.7, 3.0), 5).unwrap();
    let scene = generate_scene(&recipe, 5).unwrap();
    let mut n_changed = 0;
    for (i, z) in scene.map.heights().values().iter().enumerate() {
        let grid = scene.map.grid();
        let p = grid.position(i % grid.nx, i / grid.nx);
        if p.coords.norm() <= 3.0 {
            assert_eq!(*z, bare.heights().values()[i]);
        }
        n_changed += usize::from(*z != bare.heights().values()[i]);
    }
    assert!(n_changed > 10_000);
}

#[test]
fn the_same_seed_gives_the_same_ground_and_another_one_other_ground() {
    for name in Recipe::NAMES {
        let recipe = Recipe::from_name(name).unwrap();
        let map = generate(&recipe, 42).unwrap();
        assert_eq!((map.grid().nx, map.grid().ny), (481, 481), "{name}");
        assert_eq!(map.grid().origin, Point2::new(-12.0, -12.0));
        assert!(map.heights().values().iter().all(|z| z.is_finite()));
        assert_eq!(map.version_hash(), generate(&recipe, 42).unwrap().version_hash());
        assert_ne!(map.version_hash(), generate(&recipe, 43).unwrap().version_hash());
        let SourceKind::Recipe { seed: 42, recipe: text } = &map.source().kind else { panic!() };
        assert!(text.contains("generator=1 width_m=24 "), "{text}");
    }
}

#[test]
fn detail_leaves_the_nodes_of_the_coarse_map_near_where_they_were() {
    let coarse = generate(&Recipe { resolution_m: 2.0, ..relief(0.9, 6.0) }, 9).unwrap();
    let recipe = relief(0.7, 3.0);
    let fine = add_detail(&coarse, &recipe, 1, 0.1).unwrap();
    assert_eq!(fine.grid().nx, 241);
    let mut sum = 0.0;
    for iy in 1..12 {
        for ix in 1..12 {
            let p = coarse.grid().position(ix, iy);
            sum += (fine.height_at(p).unwrap() - f64::from(*coarse.heights().at(ix, iy))).powi(2);
        }
    }
    let rms = (sum / 121.0).sqrt();
    // Wavelengths under 4 m of ground with 0.052 m over 1 m: some centimeters, not more.
    assert!(rms > 0.003 && rms < 0.1, "{rms} m");
    assert_ne!(fine.version_hash(), add_detail(&coarse, &recipe, 2, 0.1).unwrap().version_hash());
    let unknown = ElevationMap::new(
        geometry::Raster::from_fn(*coarse.grid(), |ix, iy| {
            if ix > 6 { f32::NAN } else { *coarse.heights().at(ix, iy) }
        }),
        coarse.source().clone(),
    );
    let rocky = Recipe { rock_abundance: 0.1, ..recipe };
    let fine = add_detail(&unknown, &rocky, 1, 0.1).unwrap();
    for (i, z) in fine.heights().values().iter().enumerate() {
        // The last known column borders unknown squares, which claim it.
        assert_eq!(z.is_nan(), i % 241 >= 120, "unknown stays unknown");
    }
}

#[test]
fn unusable_recipes_are_refused_by_name() {
    type Change = fn(&mut Recipe);
    let changes: [(&str, Change); 10] = [
        ("width_m", |r| r.width_m = f64::NAN),
        ("height_m", |r| r.height_m = -3.0),
        ("resolution_m", |r| r.resolution_m = 0.0),
        ("hurst", |r| r.hurst = 1.2),
        ("slope_rms_at_1m_rad", |r| r.slope_rms_at_1m_rad = 1.5),
        ("rock_abundance", |r| r.rock_abundance = f64::INFINITY),
        ("rock_diameter_max_m", |r| r.rock_diameter_max_m = 0.01),
        ("crater_density", |r| r.crater_density = -1.0),
        ("crater_diameter_min_m", |r| r.crater_diameter_min_m = 0.0),
        ("flat_center_m", |r| r.flat_center_m = f64::NAN),
    ];
    for (expected, change) in changes {
        let mut recipe = Recipe::boulder_field();
        change(&mut recipe);
        let refused = generate(&recipe, 0).unwrap_err();
        assert!(
            matches!(refused, TerrainError::OutOfRange { field, .. } if field == expected),
            "{refused}"
        );
    }
    let large = Recipe { width_m: 5000.0, height_m: 5000.0, ..Recipe::boulder_field() };
    assert!(matches!(generate(&large, 0), Err(TerrainError::TooManyNodes { .. })));
    let sandy = Recipe {
        width_m: 5e3,
        height_m: 5e3,
        resolution_m: 5.0,
        rock_diameter_min_m: 0.05,
        ..Recipe::boulder_field()
    };
    assert!(matches!(generate(&sandy, 0), Err(TerrainError::TooManyFeatures { .. })));
    let unknown = Recipe::from_name("moon").unwrap_err();
    assert_eq!(unknown, TerrainError::UnknownRecipe { name: "moon".into() });
}
