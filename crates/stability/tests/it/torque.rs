//! Joint torques against the published figures for the same model and their invariants.

use nalgebra::Vector3;
use rover::{LegId, Robot, Wrench};
use stability::{assess, spring_share, torque};

use crate::{athlete, contacts, loaded, on_plane};

/// Largest |torque| / limit of a pose that stands level on these legs on Earth, as equal springs.
fn worst_ratio(robot: &Robot, pose: &str, standing: &[usize]) -> f64 {
    let posture = on_plane(robot, pose);
    let feet = contacts(robot, &posture, standing);
    let points: Vec<_> = feet.iter().map(|(_, p)| *p).collect();
    let com = posture.center_of_mass(robot);
    let loads = spring_share(&points, &com, robot.mass() * 9.8).expect("the stance holds");
    let wrench = |((leg, point), load): (&(LegId, _), &f64)| {
        (*leg, Wrench { point: *point, force: Vector3::z() * *load })
    };
    let ground: Vec<_> = feet.iter().zip(&loads).map(wrench).collect();
    torque::ratios(robot, &posture, &ground, 9.8).worst.ratio.abs()
}

#[track_caller]
fn check(robot: &Robot, pose: &str, standing: &[usize], expected: f64) {
    let ratio = worst_ratio(robot, pose, standing);
    assert!((ratio - expected).abs() < 0.0151, "{ratio} on {standing:?}, expected {expected}");
}

const SIX: [usize; 6] = [0, 1, 2, 3, 4, 5];
const FIVE: [usize; 5] = [1, 2, 3, 4, 5];
const TRIPOD: [usize; 3] = [0, 2, 4];
const NEIGHBORS_GONE: [usize; 4] = [2, 3, 4, 5];

#[test]
fn the_standing_pose_bears_what_planning_notes_say_of_equal_springs() {
    let robot = athlete();
    check(&robot, "standing", &SIX, 0.20);
    check(&robot, "standing", &FIVE, 0.55);
    check(&robot, "standing", &TRIPOD, 0.72);
    check(&robot, "standing", &NEIGHBORS_GONE, 1.24);
}

#[test]
fn a_payload_of_a_third_overloads_the_tripod_but_not_the_bent_pose() {
    let robot = loaded();
    check(&robot, "standing", &SIX, 0.38);
    check(&robot, "standing", &FIVE, 0.85);
    check(&robot, "standing", &TRIPOD, 1.08);
    check(&robot, "standing", &NEIGHBORS_GONE, 1.78);
    check(&robot, "bent", &SIX, 0.21);
    check(&robot, "bent", &FIVE, 0.50);
    check(&robot, "bent", &TRIPOD, 0.65);
}

#[test]
fn ratios_do_not_change_with_scale() {
    let robot = athlete();
    let small = robot.scaled(1.0 / 3.0).unwrap();
    let ratio = worst_ratio(&robot, "bent", &FIVE);
    assert!((worst_ratio(&small, "bent", &FIVE) - ratio).abs() < 1e-9);
}

#[test]
fn a_lifted_leg_holds_its_own_links_only() {
    let robot = athlete();
    let posture = on_plane(&robot, "bent");
    let report = assess(&robot, &posture, &contacts(&robot, &posture, &FIVE), 9.8);
    let hanging = torque::ratios(&robot, &posture, &[], 9.8);
    assert_eq!(report.torque.ratios[0], hanging.ratios[0]);
    assert_ne!(report.torque.ratios[1], hanging.ratios[1]);
    assert_ne!(report.torque.worst.leg, LegId(0));
}

#[test]
fn the_worst_joint_is_the_one_with_the_largest_share() {
    let robot = athlete();
    let posture = on_plane(&robot, "standing");
    let report = assess(&robot, &posture, &contacts(&robot, &posture, &FIVE), 1.62).torque;
    let worst = report.ratios[report.worst.leg.0][report.worst.place];
    assert_eq!(worst, report.worst.ratio);
    assert!(report.ratios.iter().all(|leg| leg.amax() <= worst.abs()));
}
