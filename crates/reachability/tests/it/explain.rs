//! Why not here: names, numbers and mends that hold.

use collision::{Obstacle, Scene};
use nalgebra::{Isometry3, Point2, Translation3, Vector3};
use reachability::{CellClass, Mend, Obstruction, ReachOptions, Reason, explain};
use rover::{Configuration, LegAngles, LegId, Posture};
use stability::rule::Preference;
use terrain::ElevationMap;

use crate::scenes::{athlete, standing};

const LEG: LegId = LegId(0);

fn scene(obstacles: &[Obstacle]) -> Scene {
    Scene::new(athlete(), ElevationMap::plane(12.0, 0.1).unwrap(), obstacles).unwrap()
}

/// The configuration with the body moved over its wheels.
fn moved(scene: &Scene, start: &Configuration, by: &Vector3<f64>) -> Configuration {
    let robot = scene.robot();
    let mut after = start.clone();
    after.world_from_base = Translation3::from(*by) * start.world_from_base;
    let (before, posture) = (Posture::new(robot, start), Posture::new(robot, &after));
    for leg in robot.leg_ids() {
        let wheel = before.wheel(robot, leg).world_from_wheel;
        let from = |q: &LegAngles| (q - start.legs[leg.0]).amax();
        let all = posture.inverse_kinematics(robot, leg, &wheel).unwrap();
        let within = all.iter().filter(|s| s.within_limits).map(|s| s.angles);
        after.legs[leg.0] = within.min_by(|a, b| from(a).total_cmp(&from(b))).unwrap();
    }
    after
}

#[test]
fn every_mend_that_is_offered_makes_the_place_reachable() {
    let scene = scene(&[]);
    let start = standing(scene.robot());
    let options = ReachOptions { resolution: 0.05, ..Default::default() };
    let (mut shifts, mut places) = (0, 0);
    for ix in 0..8 {
        for y in [-0.6, 0.0, 0.9] {
            let p = Point2::new(2.6 + 0.1 * f64::from(ix), y);
            let answer = explain(&scene, &start, 1.62, LEG, p, &options).unwrap();
            for mend in &answer.mends {
                let (start, p) = match mend {
                    Mend::Shift(by) => {
                        shifts += 1;
                        (moved(&scene, &start, by), p)
                    }
                    Mend::Place { at, distance } => {
                        places += 1;
                        assert!(((at - p).norm() - distance).abs() < 1e-12);
                        (start.clone(), *at)
                    }
                };
                let mended = explain(&scene, &start, 1.62, LEG, p, &options).unwrap();
                assert_eq!(mended.class, CellClass::Reachable, "{p}: {mend:?}");
            }
            assert_eq!(answer.class == CellClass::Reachable, answer.reason == Reason::None);
            if answer.class == CellClass::Reachable {
                assert!(answer.mends.is_empty() && answer.way.is_some() && answer.raised.is_some());
            }
        }
    }
    assert!(shifts > 3 && places > 3, "{shifts} {places}");
}

#[test]
fn a_rock_is_named_with_its_place() {
    let boulder = Obstacle::Box {
        world_from_box: Isometry3::translation(2.25, 0.6, 0.3),
        half_extents: Vector3::new(0.2, 0.2, 0.3),
    };
    let scene = scene(&[boulder]);
    let start = standing(scene.robot());
    let p = Point2::new(2.25, 0.6);
    let answer = explain(&scene, &start, 1.62, LEG, p, &ReachOptions::default()).unwrap();
    assert_eq!(answer.class, CellClass::Colliding);
    let Some(Obstruction::Bodies { other, place, lifted, .. }) = answer.obstruction else {
        panic!("{:?}", answer.obstruction);
    };
    assert_eq!((other.as_str(), lifted), ("obstacle 1", false));
    assert!((place.xy() - p).norm() < 1.0);
    assert!(answer.text.contains("obstacle 1"), "{}", answer.text);
}

#[test]
fn a_stance_that_fails_names_the_legs_it_would_tip_over() {
    let scene = scene(&[]);
    let start = standing(scene.robot());
    let options = ReachOptions { preference: Preference::Conservative, ..Default::default() };
    let answer = explain(&scene, &start, 1.62, LEG, Point2::new(2.4, 0.0), &options).unwrap();
    assert_eq!((answer.class, answer.reason), (CellClass::Unstable, Reason::Margin));
    assert!(answer.missing.unwrap() > 0.0 && answer.margin_m.unwrap() > 0.0);
    let Some(Obstruction::Stance { critical, .. }) = answer.obstruction else {
        panic!("{:?}", answer.obstruction);
    };
    assert!(critical.is_some());
}

#[test]
fn a_place_that_is_not_a_number_has_no_explanation() {
    let scene = scene(&[]);
    let start = standing(scene.robot());
    let p = Point2::new(f64::NAN, 0.0);
    assert_eq!(explain(&scene, &start, 1.62, LEG, p, &ReachOptions::default()), None);
    let far = Point2::new(1e12, 0.0);
    let answer = explain(&scene, &start, 1.62, LEG, far, &ReachOptions::default()).unwrap();
    assert_eq!((answer.class, answer.reason), (CellClass::Unreachable, Reason::OutOfReach));
    assert!(answer.mends.is_empty() && answer.text.contains("no mend was found"));
}
