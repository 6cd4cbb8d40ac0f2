//! The body shifts over its feet: where base and wheels are, what is refused, what stops it.

use std::sync::Arc;

use collision::{Obstacle, Scene};
use nalgebra::{Isometry3, Point2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegId, Posture};
use sim::{
    BODY_KNOTS_MAX, BodyKnot, Mode, Motion, SettleOptions, SimRover, Stage, WheelHold, settle,
};

use crate::{
    GRAVITY, command, demo_robot, ground, last_detail, on_plane, path_by, plane, raise, run, scene,
    shift_knots, stages, wheel_center,
};

/// Largest way of any wheel's center between two configurations (m).
fn wheels_moved(rover: &SimRover, before: &Configuration) -> f64 {
    let robot = rover.scene().robot();
    let (was, is) = (Posture::new(robot, before), Posture::new(robot, rover.configuration()));
    let moved =
        |leg: LegId| (is.wheel(robot, leg).center() - was.wheel(robot, leg).center()).norm();
    robot.leg_ids().map(moved).fold(0.0, f64::max)
}

fn shift(rover: &SimRover, by: Isometry3<f64>, n: usize) -> Motion {
    Motion::BodyPath { knots: shift_knots(rover, &by, n, 0.0), hold: WheelHold::Brakes }
}

fn along(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

fn speed(rover: &SimRover) -> f64 {
    rover.scene().robot().motion().joint_speed
}

#[test]
fn the_base_moves_as_asked_and_the_wheels_stay() {
    for by in [
        along(0.1, 0.0, 0.0),
        along(0.0, -0.1, 0.03),
        Isometry3::new(Vector3::x() * 0.05, Vector3::z() * 0.04),
    ] {
        let mut rover = on_plane();
        let start = rover.configuration().clone();
        let motion = shift(&rover, by, 4);
        rover.command(command("shift", motion));
        assert_eq!(rover.mode(), Mode::Executing, "{}", last_detail(&rover.take_events(), "shift"));
        let mut way = 0.0;
        while rover.mode() == Mode::Executing {
            let before = rover.configuration().clone();
            rover.advance(0.1);
            let frame = rover.frame();
            assert_eq!(frame.contacts, [true; 6]);
            assert!(wheels_moved(&rover, &start) < 0.002, "{} m", wheels_moved(&rover, &start));
            for (a, b) in before.legs.iter().zip(&frame.configuration.legs) {
                assert!((a - b).amax() <= speed(&rover) * 0.1 + 1e-9);
            }
            let weight: f64 = frame.wheel_forces.iter().map(|f| f.z).sum();
            assert!((weight - demo_robot().mass() * GRAVITY).abs() < 1e-6 * weight);
            let moved = start.world_from_base.inverse() * frame.configuration.world_from_base;
            assert!(moved.translation.vector.norm() + moved.rotation.angle() >= way - 1e-9);
            way = moved.translation.vector.norm() + moved.rotation.angle();
        }
        assert_eq!(stages(&rover.take_events(), "shift").last(), Some(&Stage::Completed));
        let reached = start.world_from_base * by;
        let off = reached.inverse() * rover.configuration().world_from_base;
        assert!(off.translation.vector.norm() < 1e-6 && off.rotation.angle() < 1e-6, "{off}");
        assert!(wheels_moved(&rover, &start) < 1e-6);
    }
}

#[test]
fn after_a_shift_a_leg_steps_and_the_body_shifts_back_over_five() {
    let mut rover = on_plane();
    let start = rover.configuration().world_from_base;
    let motion = shift(&rover, along(-0.06, 0.0, 0.0), 3);
    rover.command(command("out", motion));
    run(&mut rover, 20.0);
    let motion = path_by(&rover, 0, &[raise(0.2)]);
    rover.command(command("up", motion));
    run(&mut rover, 4.0);
    assert!(!rover.frame().contacts[0]);
    // The lifted leg may be left out: it goes with the base as it is.
    let lifted = wheel_center(&rover, 0);
    let mut knots = shift_knots(&rover, &along(0.06, 0.0, 0.0), 3, 0.0);
    for knot in &mut knots {
        knot.legs.retain(|(leg, _)| leg != "leg1");
    }
    rover.command(command("back", Motion::BodyPath { knots, hold: WheelHold::Brakes }));
    run(&mut rover, 20.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "back").last(), Some(&Stage::Completed), "{events:?}");
    let off = start.inverse() * rover.configuration().world_from_base;
    assert!(off.translation.vector.norm() < 1e-6, "{off}");
    assert!((wheel_center(&rover, 0) - lifted - Vector3::x() * 0.06).norm() < 1e-3);
    assert_eq!(rover.frame().contacts, [false, true, true, true, true, true]);
}

fn refused(rover: &mut SimRover, knots: Vec<BodyKnot>) -> String {
    let before = rover.frame();
    rover.command(command("x", Motion::BodyPath { knots, hold: WheelHold::Brakes }));
    let events = rover.take_events();
    assert_eq!(stages(&events, "x"), [Stage::Received, Stage::Rejected], "{events:?}");
    assert_eq!(rover.frame(), before);
    last_detail(&events, "x")
}

#[test]
fn bad_body_paths_are_refused_by_name() {
    let good = shift_knots(&on_plane(), &along(0.05, 0.0, 0.0), 2, 0.0);
    let changed = |change: &dyn Fn(&mut Vec<BodyKnot>)| {
        let mut knots = good.clone();
        change(&mut knots);
        knots
    };
    let all = "leg1, leg2, leg3, leg4, leg5, leg6";
    let table = [
        (vec![], "the path has 0 knots; 2 to 1000 are allowed".to_owned()),
        (vec![good[0].clone()], "the path has 1 knots; 2 to 1000 are allowed".into()),
        (
            vec![good[0].clone(); BODY_KNOTS_MAX + 1],
            "the path has 1001 knots; 2 to 1000 are allowed".into(),
        ),
        (
            changed(&|k| k[1].legs[3].0 = "leg9".into()),
            format!("there is no leg \"leg9\"; the legs are {all}"),
        ),
        (
            changed(&|k| drop(k[2].legs.pop())),
            format!("knot 2 moves leg1, leg2, leg3, leg4, leg5, but knot 0 {all}; all knots move the same legs"),
        ),
        (
            changed(&|k| k.iter_mut().for_each(|k| drop(k.legs.remove(1)))),
            "leg2 stands, but the body path does not move it; it moves leg1, leg3, leg4, leg5, leg6".into(),
        ),
        (
            changed(&|k| k.iter_mut().for_each(|k| k.legs[1].0 = "leg1".into())),
            "knot 0 moves leg1, leg1, leg3,".into(),
        ),
        (
            changed(&|k| k[1].legs[4].1[2] = 3.2),
            "knot 1 takes leg5_knee_pitch to 3.2000 rad, beyond its limits of".into(),
        ),
        (
            changed(&|k| k[1].legs[4].1[2] = f64::INFINITY),
            "leg5_knee_pitch of knot 1 is not finite".into(),
        ),
        (
            changed(&|k| k[0].legs[2].1[0] += 0.02),
            "the path begins with leg3_hip_yaw at 0.0200 rad, but it is at".into(),
        ),
    ];
    for (knots, expected) in table {
        let text = refused(&mut on_plane(), knots);
        assert!(text.starts_with(&expected), "{text}\n{expected}");
    }
}

#[test]
fn legs_that_pull_against_each_other_are_refused_with_the_slip() {
    let mut rover = on_plane();
    let mut knots = shift_knots(&rover, &along(0.05, 0.0, 0.0), 2, 0.0);
    knots[2].legs[3].1[0] += 0.02;
    let text = refused(&mut rover, knots);
    assert!(text.contains(" s after the start leg4's wheel would slip by 0.00"), "{text}");
    assert!(text.contains("more than 0.0050 m: the legs pull"), "{text}");
    // One long piece leaves the way between its knots by more than the tolerance.
    let rover = on_plane();
    let text = refused(&mut rover.clone(), shift_knots(&rover, &along(0.0, 0.3, 0.0), 1, 0.0));
    assert!(text.contains("'s wheel would slip by"), "{text}");
}

#[test]
fn a_shift_that_would_tip_the_rover_is_refused_with_how_far() {
    let mut rover = on_plane();
    // Back from legs 1 and 2, so that both can be lifted; with both up, the way forward again would
    // take the center of mass over the line from leg 3 to leg 6.
    let (sin, cos) = 30.0_f64.to_radians().sin_cos();
    let motion = shift(&rover, along(-0.2 * cos, -0.2 * sin, 0.0), 8);
    rover.command(command("back", motion));
    run(&mut rover, 30.0);
    for leg in [0, 1] {
        let motion = path_by(&rover, leg, &[raise(0.1)]);
        rover.command(command(&format!("up {leg}"), motion));
        run(&mut rover, 3.0);
        assert!(!rover.frame().contacts[leg], "{:?}", rover.take_events());
    }
    rover.take_events();
    let knots = shift_knots(&rover, &along(0.2 * cos, 0.2 * sin, 0.0), 8, 0.0);
    let text = refused(&mut rover, knots);
    assert!(text.contains(" s after the start the center of mass would be 0.0"), "{text}");
    assert!(text.ends_with(" m outside the support of leg3, leg4, leg5, leg6"), "{text}");
}

#[test]
fn an_estop_in_the_midst_stops_all_legs_and_the_wheels_stand() {
    let mut rover = on_plane();
    let start = rover.configuration().clone();
    let motion = shift(&rover, along(0.1, 0.0, 0.0), 4);
    rover.command(command("shift", motion.clone()));
    run(&mut rover, 1.5);
    rover.estop("e");
    let halted = rover.frame();
    run(&mut rover, 2.0);
    let frame = rover.frame();
    assert_eq!((frame.mode, &frame.configuration), (Mode::Stopped, &halted.configuration));
    assert_eq!(frame.contacts, [true; 6]);
    assert!(wheels_moved(&rover, &start) < 0.002);
    let moved = start.world_from_base.inverse() * frame.configuration.world_from_base;
    let way = moved.translation.vector.x;
    assert!(way > 0.01 && way < 0.09, "{way} m");
    let changed = frame.configuration.legs.iter().zip(&start.legs);
    assert!(changed.map(|(a, b)| (a - b).amax()).all(|change| change > 1e-3));
    let events = rover.take_events();
    assert_eq!(stages(&events, "shift").last(), Some(&Stage::Aborted));
    // Released, it takes the same shift no more, and the rest of it.
    rover.release("r");
    rover.command(command("again", motion));
    let why = last_detail(&rover.take_events(), "again");
    assert!(why.starts_with("the path begins with leg"), "{why}");
    let motion = shift(&rover, along(0.1 - way, 0.0, 0.0), 4);
    rover.command(command("rest", motion));
    run(&mut rover, 20.0);
    let moved = start.world_from_base.inverse() * rover.configuration().world_from_base;
    assert!((moved.translation.vector - Vector3::x() * 0.1).norm() < 1e-3, "{moved}");
}

#[test]
fn what_the_body_meets_on_its_way_stops_it_before() {
    let start = on_plane();
    // A slab 0.05 m above the payload on the chassis, which reaches 0.5 m above the base.
    let top = start.configuration().world_from_base.translation.vector.z + 0.5;
    let slab = Obstacle::Box {
        world_from_box: Isometry3::translation(0.0, 0.0, top + 0.1),
        half_extents: Vector3::new(0.4, 0.4, 0.05),
    };
    let scene = Scene::new(Arc::new(demo_robot()), plane(), &[slab]).unwrap();
    let mut rover = SimRover::new(scene, start.configuration().clone(), GRAVITY).unwrap();
    let motion = shift(&rover, along(0.0, 0.0, 0.12), 6);
    rover.command(command("up", motion));
    run(&mut rover, 30.0);
    assert_eq!(rover.mode(), Mode::Fault);
    let why = last_detail(&rover.take_events(), "up");
    assert!(why.ends_with("met obstacle 0 while the body shifted"), "{why}");
    assert!(wheels_moved(&rover, start.configuration()) < 0.002);
    assert_eq!(rover.frame().contacts, [true; 6]);
}

#[test]
fn random_shifts_on_rough_ground_keep_wheels_and_balance() {
    let mut rng = ChaCha8Rng::seed_from_u64(47);
    let map = ground(|x, y| 0.1 * (0.9 * x).sin() + 0.08 * (1.1 * y + 0.4).cos());
    let scene = scene(demo_robot(), map);
    let settled = settle(&scene, Point2::origin(), 0.3, "bent", &SettleOptions::default()).unwrap();
    let start = SimRover::new(scene, settled.configuration, GRAVITY).unwrap();
    let (mut done, mut n) = (0, 0);
    for i in 0..10 {
        let mut rover = start.clone();
        let before = rover.configuration().clone();
        let mut side = |most: f64| rng.random_range(-most..most);
        let by = Isometry3::new(
            Vector3::new(side(0.12), side(0.12), side(0.05)),
            Vector3::new(side(0.03), side(0.03), side(0.05)),
        );
        let motion = shift(&rover, by, 8);
        rover.command(command(&format!("{i}"), motion));
        while rover.mode() == Mode::Executing {
            rover.advance(side(0.5) + 0.6);
            assert!(wheels_moved(&rover, &before) <= 0.005, "{i}");
            let frame = rover.frame();
            let weight: f64 = frame.wheel_forces.iter().map(|f| f.z).sum();
            assert!((weight - demo_robot().mass() * GRAVITY).abs() < 1e-6 * weight);
            assert_eq!(frame.contacts, [true; 6]);
            n += 1;
        }
        let told = rover.take_events();
        if stages(&told, &format!("{i}")).last() == Some(&Stage::Completed) {
            let reached = before.world_from_base * by;
            let off = reached.inverse() * rover.configuration().world_from_base;
            assert!(off.translation.vector.norm() < 1e-6, "{off}");
            done += 1;
        }
    }
    assert!(done >= 6 && n > 20, "{done} shifts, {n} looks");
}
