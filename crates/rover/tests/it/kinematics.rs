//! Forward kinematics against hand-derived poses, inverse kinematics against forward.

use std::f64::consts::{FRAC_PI_3, PI};

use geometry::wrap_to_pi;
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, Frame, IkSolution, LegAngles, LegId, LinkId, Posture, Robot};

use crate::athlete;

/// Wheel center and fork direction of a leg with all rolls zero, by plane trigonometry: the leg
/// lies in the vertical plane at its azimuth plus hip yaw.
fn wheel_by_hand(
    leg: usize,
    yaw: f64,
    hip: f64,
    knee: f64,
    ankle: f64,
) -> (Point3<f64>, Vector3<f64>) {
    let azimuth = FRAC_PI_3 * leg as f64;
    let (a, b, c) = (hip, hip + knee, hip + knee + ankle);
    let r = 0.351 + 0.735 * a.cos() + 0.489 * b.cos() + 0.552 * c.cos();
    let z = -0.36 - 0.735 * a.sin() - 0.489 * b.sin() - 0.552 * c.sin();
    let bearing = azimuth + yaw;
    let center = Point3::new(
        1.341 * azimuth.cos() + r * bearing.cos(),
        1.341 * azimuth.sin() + r * bearing.sin(),
        z,
    );
    (center, Vector3::new(c.cos() * bearing.cos(), c.cos() * bearing.sin(), -c.sin()))
}

fn check_wheel(q: [f64; 6], leg: usize) {
    let robot = athlete();
    let legs = vec![LegAngles::from(q); 6];
    let world_from_base = Isometry3::identity();
    let posture = Posture::new(&robot, &Configuration { world_from_base, legs });
    let wheel = posture.wheel(&robot, LegId(leg));
    let (center, fork) = wheel_by_hand(leg, q[0], q[1], q[2], q[4]);
    assert!((wheel.center() - center).norm() < 1e-9, "leg {leg}: {} {center}", wheel.center());
    let x = wheel.world_from_wheel.rotation * Vector3::x();
    assert!((x - fork).norm() < 1e-9, "leg {leg}: {x} {fork}");
}

#[test]
fn wheels_are_where_plane_trigonometry_puts_them() {
    for leg in 0..6 {
        check_wheel([0.0; 6], leg);
        check_wheel([0.0, PI / 6.0, PI / 6.0, 0.0, PI / 6.0, 0.0], leg);
        check_wheel([-0.9, -0.4, 1.7, 0.0, -0.2, 0.0], leg);
        check_wheel([2.9, 1.2, -1.1, 0.0, 2.0, 0.0], leg);
    }
}

#[test]
fn the_standing_pose_has_its_published_foot_radius_and_height() {
    let robot = athlete();
    let posture = Posture::new(&robot, &robot.pose("standing").unwrap());
    for leg in robot.leg_ids() {
        let low = posture.wheel(&robot, leg).lowest_point(&Vector3::z_axis());
        // Published at a third of the size: foot at radius 0.858, hexagon 0.656 above the foot.
        assert!((low.x.hypot(low.y) / 3.0 - 0.858).abs() < 5e-4, "{low}");
        assert!((-low.z / 3.0 - 0.656).abs() < 5e-4, "{low}");
    }
}

#[test]
fn the_bent_pose_has_its_stated_foot_radius_and_height() {
    let robot = athlete();
    let posture = Posture::new(&robot, &robot.pose("bent").unwrap());
    for leg in robot.leg_ids() {
        let low = posture.wheel(&robot, leg).lowest_point(&Vector3::z_axis());
        assert!((low.x.hypot(low.y) / 3.0 - 0.748).abs() < 1e-3, "{low}");
        assert!((-low.z / 3.0 - 0.530).abs() < 1e-3, "{low}");
    }
}

#[test]
fn rolls_turn_the_wheel_about_calf_and_fork() {
    // Straight leg along x: knee roll a and ankle roll b turn the axle from y by a + b about x.
    let robot = athlete();
    let q = LegAngles::from([0.0, 0.0, 0.0, 0.4, 0.0, 0.3]);
    let configuration = Configuration { world_from_base: Isometry3::identity(), legs: vec![q; 6] };
    let axle = Posture::new(&robot, &configuration).wheel(&robot, LegId(0)).axle();
    assert!((axle.into_inner() - Vector3::new(0.0, 0.7_f64.cos(), 0.7_f64.sin())).norm() < 1e-12);
}

fn random_angles(robot: &Robot, leg: LegId, rng: &mut ChaCha8Rng) -> LegAngles {
    let leg = robot.leg(leg);
    LegAngles::from_fn(|i, _| rng.random_range(leg.lower[i]..leg.upper[i]))
}

fn random_base(rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let mut vector = || Vector3::from_fn(|_, _| rng.random_range(-2.0..2.0));
    Isometry3::from_parts(vector().into(), UnitQuaternion::from_scaled_axis(vector()))
}

/// Largest difference of two wheel poses: center (m) and orientation (rad).
fn difference(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let turn = (a.rotation.inverse() * b.rotation).angle();
    (a.translation.vector - b.translation.vector).norm().max(turn)
}

#[test]
fn every_branch_reproduces_the_wheel_pose_and_the_generating_one_is_among_them() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut tried = 0;
    while tried < 10_000 {
        let leg = LegId(rng.random_range(0..6));
        let q = random_angles(&robot, leg, &mut rng);
        if q[4].sin().abs() < 1e-3 {
            continue; // near the wrist's singularity joints 4 and 6 cannot be told apart
        }
        tried += 1;
        let configuration =
            Configuration { world_from_base: random_base(&mut rng), legs: vec![q; 6] };
        let posture = Posture::new(&robot, &configuration);
        let wanted = posture.wheel(&robot, leg).world_from_wheel;
        let solutions = posture.inverse_kinematics(&robot, leg, &wanted).unwrap();
        assert!(solutions.len() <= 8);
        for s in &solutions {
            let got = posture.with_leg(&robot, leg, &s.angles).wheel(&robot, leg).world_from_wheel;
            assert!(difference(&got, &wanted) < 1e-9, "{s:?}");
        }
        let mut inside = solutions.iter().filter(|s| s.within_limits);
        assert!(inside.any(|s| (s.angles - q).amax() < 1e-4), "{q} {solutions:?}");
    }
}

/// Gauss-Newton with a numerical Jacobian from `start`: joint angles that reach `wanted`, or none.
fn solve_numerically(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    wanted: &Isometry3<f64>,
    start: LegAngles,
) -> Option<LegAngles> {
    let error = |q: &LegAngles| {
        let got = posture.with_leg(robot, leg, q).wheel(robot, leg).world_from_wheel;
        let shift = wanted.translation.vector - got.translation.vector;
        let turn = (wanted.rotation * got.rotation.inverse()).scaled_axis();
        LegAngles::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
    };
    let mut q = start;
    for _ in 0..60 {
        let e = error(&q);
        if e.norm() < 1e-11 {
            return Some(q);
        }
        let mut jacobian = nalgebra::Matrix6::zeros();
        for i in 0..6 {
            let mut step = LegAngles::zeros();
            step[i] = 1e-6;
            jacobian.set_column(i, &((error(&(q - step)) - error(&(q + step))) / 2e-6));
        }
        let damped = jacobian.transpose() * jacobian + nalgebra::Matrix6::identity() * 1e-9;
        let step = damped.lu().solve(&(jacobian.transpose() * e))?;
        q += step * (1.0 / step.amax().max(1.0));
    }
    None
}

#[test]
fn no_solution_that_iteration_finds_is_missing_among_the_branches() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut found = 0;
    for _ in 0..60 {
        let leg = LegId(rng.random_range(0..6));
        let configuration = Configuration {
            world_from_base: random_base(&mut rng),
            legs: vec![random_angles(&robot, leg, &mut rng); 6],
        };
        let posture = Posture::new(&robot, &configuration);
        let wanted = posture.wheel(&robot, leg).world_from_wheel;
        let solutions = posture.inverse_kinematics(&robot, leg, &wanted).unwrap();
        for _ in 0..40 {
            let start = random_angles(&robot, leg, &mut rng);
            let Some(q) = solve_numerically(&robot, &posture, leg, &wanted, start) else {
                continue;
            };
            if q[4].sin().abs() < 1e-3 {
                continue;
            }
            found += 1;
            let same =
                |s: &rover::IkSolution| (0..6).all(|i| wrap_to_pi(s.angles[i] - q[i]).abs() < 1e-5);
            assert!(solutions.iter().any(same), "{q} is missing in {solutions:?}");
        }
    }
    assert!(found > 500, "the iteration found only {found} solutions: no evidence");
}

#[test]
fn solutions_for_an_axis_point_the_fork_along_it() {
    let robot = athlete();
    let posture = Posture::new(&robot, &robot.pose("bent").unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for _ in 0..2_000 {
        let leg = LegId(rng.random_range(0..6));
        let q = random_angles(&robot, leg, &mut rng);
        let wheel = posture.with_leg(&robot, leg, &q).wheel(&robot, leg);
        let fork = Unit::new_normalize(wheel.world_from_wheel.rotation * Vector3::x());
        let model = robot.leg(leg);
        let solutions = model.ik.solve_axis(model, &wheel.center(), &fork).unwrap();
        assert!(!solutions.is_empty());
        for s in solutions {
            let got = posture.with_leg(&robot, leg, &s.angles).wheel(&robot, leg);
            assert!((got.center() - wheel.center()).norm() < 1e-9);
            let x = got.world_from_wheel.rotation * Vector3::x();
            assert!((x - fork.into_inner()).norm() < 1e-9);
        }
    }
}

#[test]
fn the_quick_questions_answer_as_all_branches_do() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let (mut n_within, mut n_missed) = (0, 0);
    for _ in 0..3_000 {
        let leg = robot.leg(LegId(rng.random_range(0..6)));
        let to = Vector3::from_fn(|_, _| rng.random_range(-3.5..3.5));
        let turn = Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0));
        let wheel = Isometry3::new(to, turn);
        let frame = Frame::from(&wheel);
        let ik = leg.ik.closed_form().unwrap();
        let missed = ik.missed(&frame.point(&ik.wheel_from_wrist()));
        match leg.ik.solve(leg, &wheel) {
            Ok(mut all) => {
                assert_eq!(missed, 0.0);
                all.retain(|s| s.within_limits);
                n_within += all.len();
                let within = leg.ik.solve_within(leg, &frame).unwrap();
                assert_eq!(within, all);
                let near = random_angles(&robot, LegId(0), &mut rng);
                let from = |q: &LegAngles| (q - near).amax();
                let least = all.iter().map(|s| from(&s.angles)).min_by(f64::total_cmp);
                let nearest = leg.ik.solve_nearest(leg, &frame, &near, None);
                assert_eq!(nearest.map(|s| from(&s.angles)), least);
            }
            Err(none) => {
                n_missed += 1;
                assert!((missed - none.distance).abs() < 1e-12, "{missed} {none:?}");
                assert!(leg.ik.solve_within(leg, &frame).is_err());
            }
        }
    }
    assert!(n_within > 100 && n_missed > 1_000, "{n_within} {n_missed}");
}

/// Oracle: all branches, one after the other.
#[test]
fn the_nearest_solution_is_so_whichever_branch_is_tried_first() {
    let robot = athlete();
    let posture = Posture::new(&robot, &robot.pose("bent").unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let (mut n_solved, mut n_first, mut n_other) = (0, 0, 0);
    for i in 0..6_000 {
        let id = LegId(rng.random_range(0..6));
        let leg = robot.leg(id);
        let near = random_angles(&robot, id, &mut rng);
        // From hardly moved to moved so far that another branch may be nearer.
        let most = [1e-3, 0.03, 0.3, 1.0][i % 4];
        let moved = near + LegAngles::from_fn(|_, _| rng.random_range(-most..most));
        let world_from_wheel =
            posture.with_leg(&robot, id, &moved).wheel(&robot, id).world_from_wheel;
        let wheel = posture.link(LinkId(0)).inverse() * world_from_wheel;
        let all = leg.ik.solve(leg, &wheel).unwrap();
        let within: Vec<_> = all.iter().filter(|s| s.within_limits).collect();
        let from = |q: &LegAngles| (q - near).amax();
        let mut nearest: Option<&IkSolution> = None;
        for s in &within {
            if nearest.is_none_or(|best| from(&s.angles) < from(&best.angles)) {
                nearest = Some(s);
            }
        }
        let frame = Frame::from(&wheel);
        n_solved += usize::from(nearest.is_some());
        for tried in &all {
            let found = leg.ik.solve_nearest(leg, &frame, &near, Some(tried.branch));
            assert_eq!(found.as_ref(), nearest, "{near:?} {:?}", tried.branch);
            let first = leg.ik.closed_form().unwrap();
            let first = first.solve_branch(leg, &frame, &near, tried.branch);
            assert!(first.is_none() || first.as_ref() == nearest);
            n_first += usize::from(first.is_some());
            let is_it = nearest.is_some_and(|best| best.branch == tried.branch);
            n_other += usize::from(first.is_none() && is_it);
        }
    }
    assert!(n_solved > 3_000 && n_first > 1_500 && n_other > 100, "{n_solved} {n_first} {n_other}");
}

#[test]
fn a_wheel_out_of_reach_is_told_by_how_much() {
    // Straight out along x at hip-pitch height the wrist can be 1.224 m from the hip-pitch axis.
    let robot = athlete();
    let posture = Posture::new(&robot, &robot.pose("bent").unwrap());
    let wrist_x = 1.341 + 0.351 + 0.735 + 0.489;
    let wheel = Isometry3::translation(wrist_x + 0.5 + 0.552, 0.0, -0.36);
    let missed = posture.inverse_kinematics(&robot, LegId(0), &wheel).unwrap_err();
    assert!((missed.distance - 0.5).abs() < 1e-9, "{missed:?}");
}

#[test]
fn scale_shrinks_lengths_and_leaves_angles() {
    let robot = athlete();
    let third = robot.scaled(1.0 / 3.0).unwrap();
    let full = Posture::new(&robot, &robot.pose("standing").unwrap());
    let small = Posture::new(&third, &third.pose("standing").unwrap());
    for leg in robot.leg_ids() {
        let (a, b) = (full.wheel(&robot, leg), small.wheel(&third, leg));
        assert!((a.center().coords / 3.0 - b.center().coords).norm() < 1e-12);
        assert!((b.radius - 0.088).abs() < 1e-12);
        let again = small.inverse_kinematics(&third, leg, &b.world_from_wheel).unwrap();
        let (_, q) = &third.poses().iter().find(|(name, _)| name == "standing").unwrap();
        assert!(again.iter().any(|s| (s.angles - q).amax() < 1e-9));
        assert!((robot.leg(leg).effort[0] - 3.0 * third.leg(leg).effort[0]).abs() < 1e-9);
    }
    assert_ne!(robot.hash(), third.hash());
    assert!((robot.mass() - third.mass()).abs() < 1e-9);
    assert!(robot.scaled(f64::NAN).is_err() && robot.scaled(0.0).is_err());
}
