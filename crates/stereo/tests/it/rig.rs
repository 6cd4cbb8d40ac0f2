//! The rig of `athlete`, and what it would see.

use geometry::Grid;
use nalgebra::{Point2, Point3, Vector3};
use rover::Posture;
use stereo::StereoError;
use stereo::coverage::coverage;
use stereo::rig::Rig;
use terrain::ElevationMap;
use testkit::fixture_text;

use crate::matching::never;
use crate::ray::{athlete, standing};

pub fn rig() -> Rig {
    Rig::from_toml(&fixture_text("robots/athlete/robot.toml"), &athlete()).unwrap()
}

#[test]
fn the_nine_pairs_are_where_the_paper_has_them() {
    let rig = rig();
    let names: Vec<&str> = rig.pairs().iter().map(|pair| pair.name.as_str()).collect();
    let expected = ["nav1", "nav2", "nav3", "nav4", "nav5", "nav6", "haz1", "haz2", "haz3"];
    assert_eq!(names, expected);
    for (i, pair) in rig.pairs().iter().enumerate() {
        let middle = nalgebra::center(&pair.left.center(), &pair.right.center()).coords;
        let look = pair.left.axes() * Vector3::z();
        let azimuth = middle.y.atan2(middle.x).to_degrees().rem_euclid(360.0);
        if i < 6 {
            // On a face of the hexagon, outward and a little down.
            assert!((azimuth - (30.0 + 60.0 * i as f64)).abs() < 0.1, "{azimuth}");
            assert!(look.dot(&middle) > 0.0 && look.z < 0.0 && look.z > -0.5);
        } else {
            // At three alternate vertices, inward and down.
            assert!((azimuth - (60.0 + 120.0 * (i - 6) as f64)).abs() < 0.1, "{azimuth}");
            assert!(look.xy().dot(&middle.xy()) < 0.0 && look.z < -0.7);
        }
        // Level, the right camera to the right.
        let right = pair.left.axes() * Vector3::x();
        let across = pair.right.center() - pair.left.center();
        assert!(right.z.abs() < 1e-9 && (across.normalize() - right).norm() < 1e-9);
        assert_eq!(pair.raw_bytes(), 2 * 1024 * 768);
    }
}

#[test]
fn a_third_of_the_robot_has_a_third_of_the_rig() {
    let small = athlete().scaled(1.0 / 3.0).unwrap();
    let small = Rig::from_toml(&fixture_text("robots/athlete/robot.toml"), &small).unwrap();
    for (pair, third) in rig().pairs().iter().zip(small.pairs()) {
        let place = Point3::from(pair.right.center().coords / 3.0);
        assert!((third.right.center() - place).norm() < 1e-12);
        assert!((third.range[1] * 3.0 - pair.range[1]).abs() < 1e-12);
        assert_eq!(third.left.focal(), pair.left.focal());
    }
}

#[test]
fn mistakes_in_a_rig_are_named() {
    let robot = athlete();
    let table = "[[camera_pairs]]\nname = \"a\"\nlink = \"chassis\"\nposition_m = [0, 0, 0]\n\
        azimuth_rad = 0.0\nelevation_rad = 0.0\nbaseline_m = 0.2\nsize_px = [64, 48]\n\
        field_of_view_rad = 1.0\nrange_m = [0.5, 9.0]\n";
    let read = |text: &str| Rig::from_toml(text, &robot);
    assert_eq!(read(table).unwrap().pairs().len(), 1);
    assert_eq!(read("name = \"other\"").unwrap(), Rig::default());
    let wrong = |from: &str, to: &str| read(&table.replace(from, to)).unwrap_err().to_string();
    assert!(wrong("chassis", "mast").contains("no link \"mast\""));
    assert!(wrong("baseline_m = 0.2", "baseline_m = -0.2").contains("baseline_m is -0.2"));
    assert!(wrong("azimuth_rad = 0.0", "azimuth_rad = 30.0").contains("azimuth_rad"), "degrees");
    assert!(wrong("elevation_rad = 0.0", "elevation_rad = -20").contains("elevation_rad"));
    assert!(wrong("[0.5, 9.0]", "[9.0, 0.5]").contains("beyond the nearest"));
    assert!(wrong("[64, 48]", "[64000, 48000]").contains("64000"));
    assert!(wrong("[64, 48]", "[-64, 48]").contains("do not parse"));
    assert!(wrong("baseline_m", "baseline").contains("baseline"));
    let twice = read(&format!("{table}{table}")).unwrap_err();
    assert!(matches!(twice, StereoError::Pair { .. }), "{twice}");
}

#[test]
fn on_flat_ground_the_rig_leaves_the_ring_of_the_paper() {
    let robot = athlete();
    let (_, posture) = standing(&robot);
    let rig = rig();
    let map = ElevationMap::plane(8.0, 0.1).unwrap();
    let grid = Grid { origin: Point2::new(-6.0, -6.0), resolution: 0.08, nx: 151, ny: 151 };
    let pairs: Vec<_> = rig.pairs().iter().collect();
    let covered = coverage(&pairs, &robot, &posture, &map, &grid, &never).unwrap();
    let counts = covered.counts();
    let mut share = vec![[0.0_f64; 2]; 60];
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            let r = (grid.position(ix, iy).coords.norm() / 0.1) as usize;
            if let Some(ring) = share.get_mut(r) {
                ring[0] += 1.0;
                ring[1] += f64::from(u8::from(*counts.at(ix, iy) > 0));
            }
        }
    }
    let share: Vec<f64> = share.into_iter().map(|[n, seen]| seen / n).collect();
    let shown: Vec<String> = share.iter().map(|s| format!("{:.0}", 100.0 * s)).collect();
    println!("share of each ring of 0.1 m that is seen (%): {}", shown.join(" "));
    let between = |from: usize, to: usize| share[from..to].iter().sum::<f64>() / (to - from) as f64;
    assert!(between(0, 15) > 0.9, "the HazCams see the ground below the body");
    assert!(between(32, 33) < 0.1, "hardly anybody sees the ring of 3.2 to 3.3 m");
    assert!(between(42, 55) > 0.9, "the NavCams see what is beyond");
    for pair in &covered.pairs {
        assert!(pair.area > 1.0, "{}: {}", pair.name, pair.area);
    }
    // By hand, nav1 straight ahead of itself 6 m from the middle, at slope distance and angle.
    let nav = &covered.pairs[0];
    let azimuth = 30.0_f64.to_radians();
    let at = Point2::new(5.0 * azimuth.cos(), 5.0 * azimuth.sin());
    let (ix, iy) = grid.nearest(at).unwrap();
    let seen = f64::from(*nav.ground_resolution.at(ix, iy));
    let height = posture.link(robot.link_id("chassis").unwrap()).translation.z - 0.06;
    let flat = grid.position(ix, iy).coords.norm() - 1.32;
    let slant = flat.hypot(height);
    let focal = 512.0 / 37.5_f64.to_radians().tan();
    let off_axis = (height.atan2(flat) - 7.0_f64.to_radians()).cos();
    let expected = slant * off_axis / focal / (height / slant);
    assert!((seen / expected - 1.0).abs() < 0.03, "{seen} {expected}");
}

#[test]
fn legs_hide_ground_and_a_lifted_leg_gives_it_back() {
    let robot = athlete();
    let (configuration, posture) = standing(&robot);
    let rig = rig();
    let map = ElevationMap::plane(6.0, 0.1).unwrap();
    let grid = Grid { origin: Point2::new(-4.0, -4.0), resolution: 0.1, nx: 81, ny: 81 };
    // The first HazCam looks at the fifth leg, at 240 degrees.
    let haz = [rig.pair("haz1").unwrap()];
    let area = |posture: &Posture| {
        coverage(&haz, &robot, posture, &map, &grid, &never).unwrap().pairs[0].area
    };
    let standing = area(&posture);
    let mut lifted = configuration.legs[4];
    // The thigh up by 60 degrees.
    lifted[1] -= std::f64::consts::FRAC_PI_3;
    let lifted = area(&Posture::new(&robot, &configuration.with_leg(rover::LegId(4), lifted)));
    println!("haz1 sees {standing:.2} m² with leg 5 standing and {lifted:.2} m² with it lifted");
    assert!(lifted > standing + 0.1, "{lifted} {standing}");
    let stopped = coverage(&haz, &robot, &posture, &map, &grid, &|| true);
    assert_eq!(stopped, Err(StereoError::Stopped));
}
