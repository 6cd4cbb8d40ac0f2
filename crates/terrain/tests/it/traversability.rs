//! Traversability on ground whose answer is known.

use geometry::{Grid, Raster};
use nalgebra::Point2;
use terrain::traversability::{
    CAUTION, Layers, Limits, SAFE, UNKNOWN, UNSAFE, explain_cell, traversability,
};
use terrain::{ElevationMap, Source, TerrainError};

const N: usize = 61;
const CELL: f64 = 0.05;
const FOOT: f64 = 0.75;

fn map(height: impl Fn(f64, f64) -> f64) -> ElevationMap {
    let grid = Grid { origin: Point2::origin(), resolution: CELL, nx: N, ny: N };
    let middle = CELL * (N / 2) as f64;
    ElevationMap::new(
        Raster::from_fn(grid, |ix, iy| {
            let p = grid.position(ix, iy);
            height(p.x - middle, p.y - middle) as f32
        }),
        Source::file("test"),
    )
}

fn layers(map: &ElevationMap) -> Layers {
    traversability(map, FOOT, &Limits::default()).unwrap()
}

/// (slope, roughness, step, goodness, class) of the middle cell.
fn middle(layers: &Layers) -> (f32, f32, f32, f32, u8) {
    let at = N / 2;
    (
        *layers.slope_rad.at(at, at),
        *layers.roughness_m.at(at, at),
        *layers.step_m.at(at, at),
        *layers.goodness.at(at, at),
        *layers.class.at(at, at),
    )
}

#[test]
fn planes_have_their_slope_and_neither_roughness_nor_step() {
    for (a, b, lift) in
        [(0.0, 0.0, 0.0), (0.1, -0.05, 0.0), (0.6, 0.8, 0.0), (0.25, 0.125, -4455.0)]
    {
        let layers = layers(&map(|x, y| a * x + b * y + lift));
        // Heights are stored as f32: half a unit in the last place, 2.4e-4 m at -4455 m.
        let tolerance = if lift == 0.0 { 1e-6 } else { 1e-3 };
        let expected = f64::hypot(a, b).atan() as f32;
        for iy in 0..N {
            for ix in 0..N {
                let [slope, roughness, step] =
                    [&layers.slope_rad, &layers.roughness_m, &layers.step_m].map(|l| *l.at(ix, iy));
                assert!((slope - expected).abs() < tolerance, "slope {slope} at {ix}, {iy}");
                assert!(roughness < tolerance, "roughness {roughness} at {ix}, {iy}");
                assert!(step < tolerance, "step {step} at {ix}, {iy}");
            }
        }
    }
}

#[test]
fn goodness_of_a_slope_follows_its_ramp() {
    for (degrees, goodness, class) in [
        (4.0, 1.0, SAFE),
        (10.0, 10.0 / 15.0, SAFE),
        (12.5, 0.5, CAUTION),
        (19.0, 1.0 / 15.0, UNSAFE),
        (30.0, 0.0, UNSAFE),
    ] {
        let tangent = f64::to_radians(degrees).tan();
        let (_, _, _, found, found_class) = middle(&layers(&map(|x, _| tangent * x)));
        assert!((f64::from(found) - goodness).abs() < 1e-4, "{degrees} deg: {found}");
        assert_eq!(found_class, class, "{degrees} deg");
    }
}

#[test]
fn a_vertical_edge_has_its_height_as_step_in_any_direction_less_the_tilt() {
    for edge in [|x: f64, _: f64| x, |_: f64, y: f64| y, |x: f64, y: f64| x + y] {
        let h = 0.1;
        let layers = layers(&map(|x, y| if edge(x, y) > 0.01 { h } else { 0.0 }));
        let at = |dx: usize| N / 2 + dx;
        // One cell from the edge of the window the tilt is nearly gone; by symmetry any corner.
        let (ix, iy) = (at(6), at(6));
        let step = f64::from(*layers.step_m.at(ix, iy));
        let tilt = f64::from(*layers.slope_rad.at(ix, iy)).tan();
        assert!(step <= h + 1e-6 && step >= h - 2.0 * CELL * 1.5 * tilt - 1e-6, "step {step}");
    }
}

#[test]
fn quarter_turns_permute_all_layers() {
    let bumpy = |x: f64, y: f64| 0.1 * (3.0 * x).sin() * (5.0 * y + x).cos() + 0.05 * x;
    let (plain, turned) = (layers(&map(bumpy)), layers(&map(|x, y| bumpy(y, -x))));
    for iy in 0..N {
        for ix in 0..N {
            // The point (x, y) of the turned map is (y, -x) of the plain one.
            let (px, py) = (iy, N - 1 - ix);
            for (a, b) in [
                (&plain.slope_rad, &turned.slope_rad),
                (&plain.roughness_m, &turned.roughness_m),
                (&plain.step_m, &turned.step_m),
                (&plain.goodness, &turned.goodness),
                (&plain.certainty, &turned.certainty),
            ] {
                let (a, b) = (*a.at(px, py), *b.at(ix, iy));
                assert!((a - b).abs() < 1e-4 || (a.is_nan() && b.is_nan()), "{a} {b}");
            }
        }
    }
}

#[test]
fn goodness_falls_as_a_box_grows() {
    let mut last = layers(&map(|_, _| 0.0));
    for height in [0.02, 0.05, 0.08, 0.12, 0.2, 0.5, 2.0] {
        let boxed = |x: f64, y: f64| if x.abs() < 0.2 && y.abs() < 0.2 { height } else { 0.0 };
        let next = layers(&map(boxed));
        for (before, after) in last.goodness.values().iter().zip(next.goodness.values()) {
            assert!(after.is_nan() || *after <= before + 1e-6, "{before} then {after}");
        }
        last = next;
    }
    assert_eq!(middle(&last).4, UNSAFE);
}

#[test]
fn the_edge_of_knowledge_is_unknown_and_never_good() {
    let layers = layers(&map(|x, _| if x > 0.0 { f64::NAN } else { 0.0 }));
    let row = N / 2;
    for ix in 0..N {
        let n_known = (N / 2 + 1).min(ix + 8).saturating_sub(ix.saturating_sub(7));
        let certainty = *layers.certainty.at(ix, row);
        assert!((f64::from(certainty) - n_known as f64 / 15.0).abs() < 1e-6);
        // Half the far quadrants (7 columns) known is two columns and a bit: 30 % of 49 cells.
        let far = (N / 2 + 1).saturating_sub(ix + 1).min(7);
        let near = ix.min(7).min((N / 2 + 1).saturating_sub(ix.saturating_sub(7)));
        let is_known = n_known >= 9 && far.min(near) * 7 >= 15;
        let class = *layers.class.at(ix, row);
        assert_eq!(class, if is_known { SAFE } else { UNKNOWN }, "column {ix}");
        assert_eq!(layers.goodness.at(ix, row).is_nan(), !is_known);
    }
}

#[test]
fn nothing_known_gives_nothing() {
    let layers = layers(&map(|_, _| f64::NAN));
    assert!(layers.class.values().iter().all(|class| *class == UNKNOWN));
    assert!(layers.slope_rad.values().iter().all(|v| v.is_nan()));
    assert!(layers.certainty.values().iter().all(|v| *v == 0.0));
}

#[test]
fn a_line_of_known_cells_has_no_plane() {
    let layers = layers(&map(|x, _| if x.abs() < 0.01 { 0.0 } else { f64::NAN }));
    let at = N / 2;
    assert!(layers.slope_rad.at(at, at).is_nan());
    assert!((layers.certainty.at(at, at) - 1.0 / 15.0).abs() < 1e-6);
}

#[test]
fn the_window_is_the_nearest_odd_number_of_cells() {
    let flat = map(|_, _| 0.0);
    for (footprint, window) in [(0.75, 15), (0.69, 13), (0.72, 15), (0.45, 9), (0.8, 17), (1.0, 21)]
    {
        let layers = traversability(&flat, footprint, &Limits::default()).unwrap();
        assert_eq!(layers.window, window, "{footprint} m");
        assert!((layers.footprint_m - CELL * window as f64).abs() < 1e-12);
        assert_eq!(layers.resolution_m, CELL);
    }
}

#[test]
fn coarse_maps_are_resampled_to_a_ninth_of_the_footprint_and_say_so() {
    let grid = Grid { origin: Point2::origin(), resolution: 1.0, nx: 12, ny: 12 };
    let heights = Raster::from_fn(grid, |ix, _| 0.1 * ix as f32);
    let coarse = ElevationMap::new(heights, Source::file("coarse"));
    let layers = traversability(&coarse, 0.9, &Limits::default()).unwrap();
    assert_eq!((layers.window, layers.source_resolution_m), (9, 1.0));
    assert!((layers.resolution_m - 0.1).abs() < 1e-12);
    assert_eq!(layers.class.grid().nx, 111);
    let slope = layers.slope_rad.nearest(Point2::new(5.3, 5.3)).unwrap();
    assert!((f64::from(slope) - 0.1_f64.atan()).abs() < 1e-5);
}

#[test]
fn unusable_footprints_and_limits_are_refused_by_name() {
    let flat = map(|_, _| 0.0);
    for footprint in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
        let refused = traversability(&flat, footprint, &Limits::default()).unwrap_err();
        let TerrainError::OutOfRange { field, .. } = refused else { panic!("{refused}") };
        assert_eq!(field, "footprint_m");
    }
    type Change = fn(&mut Limits);
    let fields: [(&str, Change); 4] = [
        ("slope_hi_rad", |l| l.slope_hi_rad = l.slope_lo_rad),
        ("roughness_lo_m", |l| l.roughness_lo_m = f64::NAN),
        ("step_hi_m", |l| l.step_hi_m = f64::INFINITY),
        ("known_share_min", |l| l.known_share_min = 1.5),
    ];
    for (expected, change) in fields {
        let mut limits = Limits::default();
        change(&mut limits);
        let refused = traversability(&flat, FOOT, &limits).unwrap_err();
        assert!(
            matches!(refused, TerrainError::OutOfRange { field, .. } if field == expected),
            "{refused}"
        );
    }
}

#[test]
fn an_explained_box_protrudes_by_its_height_over_the_tilt() {
    let boxed = map(|x, y| if x.abs() < 0.07 && y.abs() < 0.07 { 0.3 } else { 0.0 });
    let p = Point2::new(CELL * 30.0, CELL * 30.0);
    let cell = explain_cell(&boxed, p, FOOT, &Limits::default()).unwrap().unwrap();
    // 3 x 3 of the 15 x 15 cells are 0.3 m up: the level plane lies at their mean.
    let mean = 0.3 * 9.0 / 225.0;
    assert!((cell.plane_height_m.unwrap() - mean).abs() < 1e-7);
    assert!((cell.protrusion_m.unwrap() - (0.3 - mean)).abs() < 1e-6);
    assert!((cell.pit_m.unwrap() - mean).abs() < 1e-7);
    assert!((cell.step_m.unwrap() - 0.3).abs() < 1e-7);
    assert_eq!((cell.goodness, cell.class), (Some(0.0), UNSAFE));
    assert_eq!(explain_cell(&boxed, Point2::new(9.0, 0.0), FOOT, &Limits::default()), Ok(None));
}

#[test]
fn cautious_classes_are_those_of_ground_that_is_worse_by_so_many_sigmas() {
    // A plane with a step of 6 cm: safe as it looks.
    let grid = Grid { origin: Point2::origin(), resolution: 0.05, nx: 81, ny: 61 };
    let heights = Raster::from_fn(grid, |ix, _| if ix < 40 { 0.0 } else { 0.06_f32 });
    let map = ElevationMap::new(heights, Source::file("step"));
    let layers = traversability(&map, 0.55, &Limits::default()).unwrap();
    let at = |class: &Raster<u8>, ix: usize| *class.at(ix, 30);
    assert_eq!((at(&layers.class, 40), at(&layers.class, 20)), (SAFE, SAFE));
    let sigma = |s: f32| Raster::from_fn(grid, |_, _| s);
    // 0.06 + 1.414 x 0.02 m has a goodness of 0.46, 0.06 + 1.414 x 0.004 m one of 0.71.
    for (s, k, expected) in
        [(0.02, 1.0, CAUTION), (0.004, 1.0, SAFE), (0.02, 0.0, SAFE), (0.004, 5.0, CAUTION)]
    {
        let class = layers.cautious_class(&sigma(s), k).unwrap();
        assert_eq!(at(&class, 40), expected, "{s} {k}");
        assert_eq!(at(&class, 20), SAFE, "no step here: {s} {k}");
        let better = class.values().iter().zip(layers.class.values()).filter(|(a, b)| a > b);
        assert_eq!(better.count(), 0);
        let unknown = |c: &&u8| **c == UNKNOWN;
        assert_eq!(
            class.values().iter().filter(unknown).count(),
            layers.class.values().iter().filter(unknown).count()
        );
    }
    // One height that is not sure matters to every foot over it, and to no other.
    let once = |ix, iy| if (ix, iy) == (45, 30) { 0.05 } else { 0.001 };
    let once = Raster::from_fn(grid, once);
    let class = layers.cautious_class(&once, 1.0).unwrap();
    for ix in 35..46 {
        let is_over = 45 - ix <= 5;
        assert_eq!(at(&class, ix), if is_over { CAUTION } else { SAFE }, "{ix}");
        let cell = explain_cell(&map, grid.position(ix, 30), 0.55, &Limits::default());
        let cell = cell.unwrap().unwrap();
        let worst = cell.worst(|p| once.nearest(p).unwrap_or(f32::NAN));
        assert_eq!(worst, if is_over { 0.05 } else { 0.001 }, "{ix}");
        assert_eq!(cell.doubted(worst.into(), 1.0).unwrap().unwrap().0, at(&class, ix));
    }
    let nothing = layers.cautious_class(&sigma(f32::NAN), 1.0).unwrap();
    assert_eq!(at(&nothing, 20), CAUTION);
    let small = Raster::from_fn(Grid { nx: 80, ..grid }, |_, _| 0.0);
    let refused = layers.cautious_class(&small, 1.0).unwrap_err().to_string();
    assert!(refused.contains("sigma_m"), "{refused}");
}
