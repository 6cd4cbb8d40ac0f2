//! Files from elsewhere, where they are at hand.

use nalgebra::Point2;
use terrain::formats::{Crop, CropCenter, ReadOptions, read_named};
use terrain::synthetic::{Recipe, add_detail};
use terrain::traversability::{Limits, traversability};
use testkit::shared_data;

const GALE: &str = "gale_hirise_1m/missionDEM.tif";

#[test]
fn the_gale_model_has_the_extent_and_relief_its_makers_state() {
    let Some(bytes) = shared_data("gale", GALE) else { return };
    let map = read_named(GALE, &bytes, &ReadOptions::default()).unwrap();
    assert_eq!((map.grid().nx, map.grid().ny, map.grid().resolution), (348, 337, 1.0));
    // Upper left corner (8142406, -276455) m, to the meter.
    let corner = map.grid().origin.coords + map.frame_offset().xy();
    assert!((corner.x - 8_142_406.5).abs() < 1.0, "{corner}");
    assert!((corner.y - (-276_455.0 - 336.5)).abs() < 1.0, "{corner}");
    assert!(map.height_at(Point2::new(-0.5, 0.0)).is_some());
    let known = || map.heights().values().iter().filter(|z| !z.is_nan());
    let lift = map.frame_offset().z;
    let low = f64::from(known().copied().fold(f32::MAX, f32::min)) + lift;
    let high = f64::from(known().copied().fold(f32::MIN, f32::max)) + lift;
    assert!((low - -4472.67).abs() < 0.01 && (high - -4437.88).abs() < 0.01, "{low} {high}");
    let far = map.grid().far_corner();
    assert!((far.coords + map.grid().origin.coords).norm() < 1e-9, "centered");
}

#[test]
fn foot_scale_detail_on_gale_keeps_its_slopes() {
    let Some(bytes) = shared_data("gale_detail", GALE) else { return };
    let center = CropCenter::Fraction(Point2::new(0.5, 0.5));
    let crop = Some(Crop { center, width_m: 30.0 });
    let macro_map =
        read_named(GALE, &bytes, &ReadOptions { crop, ..ReadOptions::default() }).unwrap();
    let detailed = add_detail(&macro_map, &Recipe::boulder_field(), 1, 0.05).unwrap();
    assert!(detailed.source().synthetic_detail);
    assert_eq!(detailed.frame_offset(), macro_map.frame_offset());
    // Over 4 macro cells both have the same differences, but for rocks.
    let smooth = Recipe { rock_abundance: 0.0, ..Recipe::boulder_field() };
    let detailed = add_detail(&macro_map, &smooth, 1, 0.05).unwrap();
    let mut sum = 0.0;
    for i in 0..200 {
        let p = Point2::new(-10.0 + 0.05 * f64::from(i), -10.0 + 0.1 * f64::from(i));
        let q = Point2::new(p.x + 4.0, p.y);
        let rise = |m: &terrain::ElevationMap| m.height_at(q).unwrap() - m.height_at(p).unwrap();
        sum += (rise(&detailed) - rise(&macro_map)).powi(2);
    }
    let off = (sum / 200.0).sqrt();
    assert!(off < 0.05, "{off} m over 4 m");
    let layers = traversability(&detailed, 0.75, &Limits::default()).unwrap();
    assert_eq!(layers.window, 15);
}

#[test]
fn the_fractal_meshes_are_the_height_fields_their_readme_tells() {
    for (name, width, low, high) in
        [("fractal_terrain_1.off", 20.0, -1.78, 1.44), ("fractal_terrain_3.off", 10.0, -2.08, 1.32)]
    {
        let path = format!("klampt_terrains/{name}");
        let Some(bytes) = shared_data("off", &path) else { return };
        let map = read_named(name, &bytes, &ReadOptions::default()).unwrap();
        assert_eq!((map.grid().nx, map.grid().ny), (129, 129));
        assert!((map.grid().resolution - width / 128.0).abs() < 1e-9);
        assert_eq!(map.grid().origin, Point2::origin());
        let heights = map.heights().values();
        let found = heights.iter().fold((f32::MAX, f32::MIN), |(l, h), z| (l.min(*z), h.max(*z)));
        assert!(
            (f64::from(found.0) - low).abs() < 0.01 && (f64::from(found.1) - high).abs() < 0.01
        );
        // The mesh's own triangles lie on our surface: each midpoint of the first 999 faces' edges.
        let text = String::from_utf8(bytes).unwrap();
        let numbers = |line: &str| -> Vec<f64> {
            line.split_whitespace().map(|w| w.parse().unwrap()).collect()
        };
        let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).skip(2).collect();
        for face in lines[16641..].iter().take(999) {
            let corners: Vec<Vec<f64>> =
                numbers(face)[1..].iter().map(|i| numbers(lines[*i as usize])).collect();
            let center = |axis: usize| corners.iter().map(|c| c[axis]).sum::<f64>() / 3.0;
            let z = map.height_at(Point2::new(center(0), center(1))).unwrap();
            // Coordinates have 6 digits: 14.53125 m is printed as 14.5312.
            assert!((z - center(2)).abs() < 2e-4, "{face}");
        }
    }
}
