//! Settling against closed forms and on every kind of ground.

use collision::{Scene, survey};
use nalgebra::{Isometry3, Point2, UnitQuaternion, Vector3};
use rover::Posture;
use sim::{Misfit, SettleError, SettleOptions, Settled, SimRover, settle};
use terrain::formats::{Crop, CropCenter, ReadOptions, read_named};
use terrain::synthetic::{Recipe, add_detail, generate};

use crate::{GRAVITY, athlete, demo_robot, gap, ground, plane, pose_height, scene};

fn settle_at(scene: &Scene, x: f64, y: f64, heading: f64) -> Result<Settled, SettleError> {
    settle(scene, Point2::new(x, y), heading, "bent", &SettleOptions::default())
}

/// All that is promised of a settled rover.
#[track_caller]
fn check_stands(scene: &Scene, settled: &Settled) {
    let robot = scene.robot();
    let posture = Posture::new(robot, &settled.configuration);
    let seen = survey(scene, &posture);
    assert_eq!(seen.standing.len(), robot.legs().len());
    for leg in robot.leg_ids() {
        let gap = gap(scene, &settled.configuration, leg.0);
        assert!(gap.abs() <= 1e-4, "leg {} has a gap of {gap} m", leg.0);
        let model = robot.leg(leg);
        let angles = &settled.configuration.legs[leg.0];
        assert!((angles - model.upper).max() <= 1e-9 && (model.lower - angles).max() <= 1e-9);
    }
    assert!(seen.self_collision().is_none() && seen.terrain_collision().is_none(), "{seen:?}");
    assert!(settled.margin_m >= robot.stance().margin, "{}", settled.margin_m);
    SimRover::new(scene.clone(), settled.configuration.clone(), GRAVITY).unwrap();
}

#[test]
fn on_level_ground_the_pose_stands_as_it_is() {
    for pose in ["bent", "standing"] {
        let scene = scene(demo_robot(), plane());
        let wished = Point2::new(1.3, -2.1);
        let settled = settle(&scene, wished, 0.7, pose, &SettleOptions::default()).unwrap();
        check_stands(&scene, &settled);
        let base = settled.configuration.world_from_base;
        let height = pose_height(scene.robot(), pose);
        let expected = Isometry3::from_parts(
            Vector3::new(wished.x, wished.y, height).into(),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7),
        );
        assert!((base.translation.vector - expected.translation.vector).norm() < 1e-6, "{base}");
        assert!(base.rotation.angle_to(&expected.rotation) < 1e-6);
        assert_eq!(settled.moved_m, 0.0);
        let nominal = scene.robot().pose(pose).unwrap();
        for (angles, wanted) in settled.configuration.legs.iter().zip(&nominal.legs) {
            assert!((angles - wanted).amax() < 1e-5, "{angles} {wanted}");
        }
        // Six feet on a circle: the apothem.
        let radius = (settled.contacts[0].xy() - wished).norm();
        assert!((settled.margin_m - radius * 0.75_f64.sqrt()).abs() < 1e-4);
    }
}

#[test]
fn on_a_slope_the_base_follows_it_and_every_wheel_touches_where_the_pose_has_it() {
    for degrees in [5.0_f64, 10.0, 14.0] {
        let rise = degrees.to_radians().tan();
        let scene = scene(demo_robot(), ground(|x, y| rise * (0.8 * x + 0.6 * y)));
        let settled = settle_at(&scene, 0.5, 0.25, 0.3).unwrap();
        check_stands(&scene, &settled);
        assert_eq!(settled.moved_m, 0.0);
        let base = settled.configuration.world_from_base;
        let normal = Vector3::new(-0.8 * rise, -0.6 * rise, 1.0).normalize();
        assert!((base.rotation * Vector3::z() - normal).norm() < 1e-5);
        // A pose height above the ground, along the normal.
        let from_ground = base.translation.vector - Vector3::new(0.5, 0.25, rise * (0.4 + 0.15));
        assert!((from_ground - normal * pose_height(scene.robot(), "bent")).norm() < 1e-4);
        let nominal = scene.robot().pose("bent").unwrap();
        let level = Posture::new(scene.robot(), &nominal);
        for leg in scene.robot().leg_ids() {
            let low = level.wheel(scene.robot(), leg).lowest_point(&Vector3::z_axis());
            let miss = (settled.contacts[leg.0] - base * low).norm();
            assert!(miss < 1e-3, "{miss} m");
        }
    }
}

#[test]
fn too_steep_a_slope_is_refused_for_that() {
    let scene = scene(demo_robot(), ground(|x, _| 0.4 * x));
    match settle_at(&scene, 0.0, 0.0, 0.0) {
        Err(SettleError::NoPlace { reason: Misfit::Slope, count, tries, .. }) => {
            // Some places at the border of the map fail for that first.
            assert!(count > tries / 2, "{count} of {tries}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn beside_a_cliff_a_place_away_from_it_is_found() {
    let scene = scene(demo_robot(), ground(|x, _| if x > 0.0 { -3.0 } else { 0.0 }));
    let settled = settle_at(&scene, 0.0, 0.0, 0.0).unwrap();
    check_stands(&scene, &settled);
    assert!((1.0..=5.0).contains(&settled.moved_m), "{}", settled.moved_m);
    let heights: Vec<f64> = settled.contacts.iter().map(|p| p.z).collect();
    assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-3), "all on one side: {heights:?}");
}

#[test]
fn at_a_cliff_with_no_way_aside_it_says_why_not() {
    let scene = scene(demo_robot(), ground(|x, _| if x > 0.0 { -3.0 } else { 0.0 }));
    let options = SettleOptions { radius_m: 0.5, places: 8, ..SettleOptions::default() };
    let error = settle(&scene, Point2::origin(), 0.0, "bent", &options).unwrap_err();
    let text = error.to_string();
    let SettleError::NoPlace { tries, reason: Misfit::Slope, reasons, count, .. } = error else {
        panic!("{text}")
    };
    assert_eq!(tries, 8 * 5);
    assert_eq!(reasons.iter().map(|(_, count)| count).sum::<usize>(), tries);
    assert_eq!(reasons[0].1, count);
    assert!(text.starts_with("no place to stand within 0.5 m of (0.00, 0.00): "), "{text}");
    assert!(text.contains(&format!("{count} of 40 tries fail because ")), "{text}");
}

#[test]
fn off_the_map_there_is_no_ground() {
    let scene = scene(demo_robot(), ground(|_, _| 0.0));
    match settle_at(&scene, 50.0, 0.0, 0.0) {
        Err(SettleError::NoPlace { reason: Misfit::UnknownGround, count, tries, .. }) => {
            assert_eq!(count, tries);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_step_under_one_side_is_stood_on() {
    // 0.3 m up under the wheels at positive x: the plane leans, the legs do the rest.
    let scene = scene(demo_robot(), ground(|x, _| if x > 0.0 { 0.3 } else { 0.0 }));
    let options = SettleOptions { places: 1, ..SettleOptions::default() };
    let settled = settle(&scene, Point2::new(0.0, 0.0), 0.0, "bent", &options).unwrap();
    check_stands(&scene, &settled);
    let high = settled.contacts.iter().filter(|p| p.z > 0.29).count();
    assert_eq!(high, 3, "{:?}", settled.contacts);
}

#[test]
fn boulder_fields_are_stood_on_at_full_and_third_scale() {
    for seed in 1..=4 {
        let map =
            generate(&Recipe { flat_center_m: 0.0, ..Recipe::boulder_field() }, seed).unwrap();
        let scene = scene(demo_robot(), map.clone());
        let settled = settle_at(&scene, 1.0, -1.0, 0.4).unwrap();
        check_stands(&scene, &settled);
        let small = crate::scene(athlete().scaled(1.0 / 3.0).unwrap(), map);
        let settled = settle_at(&small, 1.0, -1.0, 0.4).unwrap();
        check_stands(&small, &settled);
    }
}

#[test]
fn highlands_are_stood_on_somewhere() {
    for seed in 1..=3 {
        let map = generate(&Recipe::rough_highlands(), seed).unwrap();
        let scene = scene(demo_robot(), map);
        let settled = settle_at(&scene, 0.0, 0.0, 0.0).unwrap();
        check_stands(&scene, &settled);
    }
}

#[test]
fn the_same_wish_gives_the_same_answer() {
    let map = generate(&Recipe::boulder_field(), 7).unwrap();
    let scene = scene(demo_robot(), map);
    assert_eq!(settle_at(&scene, 6.0, 5.0, 0.0), settle_at(&scene, 6.0, 5.0, 0.0));
}

#[test]
fn a_third_scale_rover_stands_on_the_fractal_mesh() {
    let name = "klampt_terrains/fractal_terrain_1.off";
    let Some(bytes) = testkit::shared_data("settle_fractal", name) else { return };
    let map = read_named(name, &bytes, &ReadOptions::default()).unwrap();
    let middle = map.grid().origin + 0.5 * (map.grid().far_corner() - map.grid().origin);
    let scene = scene(athlete().scaled(1.0 / 3.0).unwrap(), map);
    for (dx, dy) in [(0.0, 0.0), (4.0, -3.0), (-5.0, 2.0)] {
        let settled = settle_at(&scene, middle.x + dx, middle.y + dy, 0.0).unwrap();
        check_stands(&scene, &settled);
    }
}

#[test]
fn the_rover_stands_in_gale_crater_with_detail() {
    let name = "gale_hirise_1m/missionDEM.tif";
    let Some(bytes) = testkit::shared_data("settle_gale", name) else { return };
    let center = CropCenter::Fraction(Point2::new(0.5, 0.5));
    let crop = Some(Crop { center, width_m: 24.0 });
    let coarse = read_named(name, &bytes, &ReadOptions { crop, ..ReadOptions::default() }).unwrap();
    let map = add_detail(&coarse, &Recipe::boulder_field(), 7, 0.05).unwrap();
    let middle = map.grid().origin + 0.5 * (map.grid().far_corner() - map.grid().origin);
    let scene = scene(demo_robot(), map);
    let settled = settle_at(&scene, middle.x, middle.y, 0.0).unwrap();
    check_stands(&scene, &settled);
}

#[test]
fn bad_wishes_are_refused_by_name() {
    let scene = scene(athlete(), plane());
    let text = |x: f64, heading: f64, pose: &str, options: SettleOptions| {
        settle(&scene, Point2::new(x, 0.0), heading, pose, &options).unwrap_err().to_string()
    };
    let standard = SettleOptions::default();
    assert!(text(0.0, 0.0, "sitting", standard).contains("the robot's poses are bent, standing"));
    assert!(text(f64::NAN, 0.0, "bent", standard).starts_with("the wished x is NaN"));
    assert!(text(0.0, f64::INFINITY, "bent", standard).starts_with("the heading is inf"));
    for (options, field) in [
        (SettleOptions { radius_m: -1.0, ..standard }, "radius_m"),
        (SettleOptions { places: 0, ..standard }, "places"),
        (SettleOptions { places: 10_001, ..standard }, "places"),
        (SettleOptions { tilt_max_rad: f64::NAN, ..standard }, "tilt_max_rad"),
    ] {
        assert!(text(0.0, 0.0, "bent", options).starts_with(field));
    }
}

#[test]
fn a_rover_is_only_made_where_it_stands() {
    let scene = scene(athlete(), plane());
    let settled = settle_at(&scene, 0.0, 0.0, 0.0).unwrap().configuration;
    let refused = |change: &dyn Fn(&mut rover::Configuration), gravity| {
        let mut configuration = settled.clone();
        change(&mut configuration);
        SimRover::new(scene.clone(), configuration, gravity).map(|_| ()).unwrap_err().to_string()
    };
    let lifted = refused(&|c| c.world_from_base.translation.z += 0.1, GRAVITY);
    assert!(lifted.starts_with("0 wheels stand"), "{lifted}");
    let sunk = refused(&|c| c.world_from_base.translation.z -= 0.1, GRAVITY);
    assert!(sunk.ends_with(" would be in the ground"), "{sunk}");
    let missing = refused(&|c| c.legs.truncate(5), GRAVITY);
    assert!(missing.starts_with("the configuration has 5 legs"), "{missing}");
    let unknown = refused(&|c| c.legs[2][3] = f64::NAN, GRAVITY);
    assert!(unknown.contains("not finite"), "{unknown}");
    assert!(refused(&|_| (), 0.0).starts_with("gravity is 0"));
    // Legs 1 to 3 and 6 up: the center of mass is beside the feet that stay.
    let up =
        refused(&|c| [0, 1, 2].iter().for_each(|leg| c.legs[*leg] += crate::raise(0.3)), GRAVITY);
    assert!(up.contains("outside the support"), "{up}");
}

#[test]
fn robots_with_other_legs_settle_on_ground_of_their_size() {
    for (name, scale) in [("quadruped", 0.2), ("hexapod", 0.1), ("slider", 0.5)] {
        let robot = crate::load(name);
        let hill = ground(|x, y| 0.05 * scale * (0.7 * x).sin() * (0.5 * y).cos());
        let scene = scene(robot, hill);
        let options = SettleOptions::default();
        let settled = settle(&scene, Point2::new(0.2, 0.1), 0.4, "standing", &options).unwrap();
        check_stands(&scene, &settled);
    }
}
