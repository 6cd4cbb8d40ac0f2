//! Driving along arcs: against the rotation about the arc's center, written down by hand.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Point2, Rotation2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegId, Posture};
use sim::{DriveArc, Mode, Motion, Operating, SettleOptions, SimRover, Stage, settle};

use crate::{
    GRAVITY, command, demo_robot, ground, last_detail, on_plane, path_by, raise, run, scene, stages,
};

/// In mode driving, brakes off.
fn driving(rover: SimRover) -> SimRover {
    let mut rover = rover;
    rover.command(command("mode", Motion::Mode(Operating::Driving)));
    run(&mut rover, 1.0);
    rover.command(command("off", Motion::WheelBrake { legs: Vec::new(), on: false }));
    run(&mut rover, 1.0);
    assert!(rover.frame().wheels.iter().all(|wheel| !wheel.brake));
    rover.take_events();
    rover
}

fn arc(distance: f64, turn: f64, course: f64) -> DriveArc {
    DriveArc { distance, turn, course, speed: None }
}

/// Drives to the end; looks that no wheel is faster than `most` (m/s) on the way.
fn drive(rover: &mut SimRover, id: &str, arc: DriveArc, most: f64) {
    rover.command(command(id, Motion::DriveArc(arc)));
    assert_eq!(rover.mode(), Mode::Executing, "{}", last_detail(&rover.take_events(), id));
    let radius = rover.scene().robot().leg(LegId(0)).wheel.radius;
    while rover.mode() == Mode::Executing {
        rover.advance(0.25);
        for wheel in rover.frame().wheels {
            assert!(wheel.spin_rate.abs() * radius <= most * 1.001, "{} rad/s", wheel.spin_rate);
        }
    }
    let events = rover.take_events();
    assert_eq!(stages(&events, id).last(), Some(&Stage::Completed), "{}", last_detail(&events, id));
}

fn centers(rover: &SimRover) -> Vec<Point2<f64>> {
    let robot = rover.scene().robot();
    let posture = Posture::new(robot, rover.configuration());
    robot.leg_ids().map(|leg| posture.wheel(robot, leg).center().xy()).collect()
}

fn heading(rover: &SimRover) -> f64 {
    let x = rover.configuration().world_from_base.rotation * nalgebra::Vector3::x();
    x.y.atan2(x.x)
}

#[test]
fn every_wheel_turns_about_the_center_of_the_arc() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for i in 0..6 {
        let mut rover = driving(on_plane());
        let distance = rng.random_range(-1.0..1.0);
        let turn = rng.random_range(0.1..0.5_f64).copysign(rng.random_range(-1.0..1.0));
        let course = rng.random_range(-0.6..0.6);
        // The center lies to the left of the course, at the radius.
        let before = rover.configuration().world_from_base.translation.vector.xy();
        let toward = heading(&rover) + course + FRAC_PI_2;
        let center = before + Vector2::new(toward.cos(), toward.sin()) * (distance / turn);
        let starts = centers(&rover);
        let near = starts.iter().map(|p| (p.coords - center).norm()).fold(f64::INFINITY, f64::min);
        if near < 0.3 {
            continue;
        }
        let came_from = heading(&rover);
        drive(&mut rover, &format!("arc {i}"), arc(distance, turn, course), 0.1);
        let turned = Rotation2::new(turn);
        let frame = rover.frame();
        let radius = rover.scene().robot().leg(LegId(0)).wheel.radius;
        for ((start, end), wheel) in starts.iter().zip(centers(&rover)).zip(&frame.wheels) {
            let expected = center + turned * (start.coords - center);
            assert!((end.coords - expected).norm() < 2e-4, "{end} where {expected} was expected");
            // Its axle points to the center ...
            let heads = heading(&rover) + wheel.heading.unwrap();
            let ahead = Vector2::new(heads.cos(), heads.sin());
            let arm = end.coords - center;
            assert!((ahead.dot(&arm) / arm.norm()).abs() < 1e-6, "wheel {end} heads {heads}");
            // ... and its rim has gone the length of its own arc, ahead or back.
            let left = Vector2::new(-arm.y, arm.x) / arm.norm();
            let spin = turn * arm.norm() / radius * ahead.dot(&left).signum();
            assert!((wheel.spin - spin).abs() < 1e-3, "{} rad, expected {spin}", wheel.spin);
        }
        let base = rover.configuration().world_from_base.translation.vector.xy();
        let expected = center + turned * (before - center);
        assert!((base - expected).norm() < 2e-4);
        let off = (heading(&rover) - came_from - turn).rem_euclid(2.0 * PI);
        assert!(off.min(2.0 * PI - off) < 1e-6);
        assert_eq!(frame.contacts, [true; 6]);
    }
}

#[test]
fn straight_sideways_and_on_the_spot() {
    let mut rover = driving(on_plane());
    let radius = rover.scene().robot().leg(LegId(0)).wheel.radius;
    for (i, course) in [0.0, FRAC_PI_2, -2.5].into_iter().enumerate() {
        let (before, spins) = (centers(&rover), rover.frame().wheels);
        let toward = heading(&rover) + course;
        drive(&mut rover, &format!("straight {i}"), arc(0.5, 0.0, course), 0.1);
        for (from, to) in before.iter().zip(centers(&rover)) {
            let expected = from + Vector2::new(toward.cos(), toward.sin()) * 0.5;
            assert!((to - expected).norm() < 1e-4);
        }
        for (was, is) in spins.iter().zip(rover.frame().wheels) {
            assert!(((is.spin - was.spin).abs() - 0.5 / radius).abs() < 1e-3);
        }
    }
    let base = rover.configuration().world_from_base.translation.vector;
    let came_from = heading(&rover);
    drive(&mut rover, "spot", arc(0.0, 0.4, 0.0), 0.1);
    assert!((rover.configuration().world_from_base.translation.vector - base).norm() < 1e-9);
    assert!((heading(&rover) - came_from - 0.4).abs() < 1e-9);
}

#[test]
fn the_fastest_wheel_sets_the_time() {
    let mut rover = driving(on_plane());
    let steer = |rover: &mut SimRover, id: &str| {
        drive(rover, id, arc(0.01, 0.0, 0.0), 0.28);
    };
    // Wheels that head along already lose no time to steering.
    steer(&mut rover, "align");
    let fast = DriveArc { speed: Some(0.2), ..arc(2.0, 0.0, 0.0) };
    let start = rover.time_s();
    rover.command(command("fast", Motion::DriveArc(fast)));
    let mut seconds = 0.0;
    while rover.mode() == Mode::Executing {
        rover.advance(0.01);
        seconds = rover.time_s() - start;
    }
    // A trapezoid: way over speed, and speed over acceleration (0.05 m/s²).
    assert!((seconds - (2.0 / 0.2 + 0.2 / 0.05)).abs() < 0.02, "{seconds} s");
}

#[test]
fn what_cannot_be_driven_is_refused_by_name_and_nothing_moves() {
    let refused = |mut rover: SimRover, arc: DriveArc, expected: &str| {
        let before = rover.configuration().clone();
        rover.command(command("no", Motion::DriveArc(arc)));
        let events = rover.take_events();
        let text = last_detail(&events, "no");
        assert_eq!(stages(&events, "no").last(), Some(&Stage::Rejected), "{expected}");
        assert!(text.contains(expected), "{text}\n lacks {expected}");
        run(&mut rover, 1.0);
        assert_eq!(rover.configuration(), &before);
    };
    let ready = on_plane();
    refused(
        ready.clone(),
        arc(1.0, 0.0, 0.0),
        "driving needs mode driving, and the rover is in ready",
    );
    let rover = driving(ready.clone());
    for (bad, expected) in [
        (arc(f64::NAN, 0.0, 0.0), "the distance is not finite"),
        (arc(20.1, 0.0, 0.0), "the distance is 20.1; -20 to 20 m"),
        (arc(1.0, 7.0, 0.0), "the turn is 7;"),
        (arc(1.0, f64::INFINITY, 0.0), "the turn is not finite"),
        (arc(0.0, 0.0, 0.0), "names no distance and no turn"),
        (
            DriveArc { speed: Some(0.3), ..arc(1.0, 0.0, 0.0) },
            "the speed is 0.3; 0.001 to 0.28 m/s",
        ),
        (DriveArc { speed: Some(0.0), ..arc(1.0, 0.0, 0.0) }, "the speed is 0;"),
    ] {
        refused(rover.clone(), bad, expected);
    }
    // The center of the arc under leg 1's wheel.
    let wheel = centers(&rover)[0];
    let base = rover.configuration().world_from_base.translation.vector.xy();
    let arm = wheel.coords - base;
    let course = arm.y.atan2(arm.x) - heading(&rover) - FRAC_PI_2;
    refused(rover.clone(), arc(0.5 * arm.norm(), 0.5, course), "leg1's wheel is 0.0");
    let mut braked = rover.clone();
    braked.command(command("on", Motion::WheelBrake { legs: vec!["leg3".into()], on: true }));
    run(&mut braked, 1.0);
    braked.take_events();
    refused(braked, arc(1.0, 0.0, 0.0), "the brake of leg3's wheel is on");
    let mut lifted = ready;
    let up = path_by(&lifted, 1, &[raise(0.2)]);
    lifted.command(command("up", up));
    run(&mut lifted, 4.0);
    refused(driving(lifted), arc(1.0, 0.0, 0.0), "leg2's wheel is off the ground");
}

/// The rover, driving, on ground of these heights.
fn on(height: impl Fn(f64, f64) -> f64) -> SimRover {
    let scene = scene(demo_robot(), ground(height));
    let options = SettleOptions { places: 1, ..SettleOptions::default() };
    let settled = settle(&scene, Point2::new(-3.0, 0.0), 0.0, "bent", &options).unwrap();
    driving(SimRover::new(scene, settled.configuration, GRAVITY).unwrap())
}

#[test]
fn ground_that_is_steep_unknown_or_stepped_is_refused_before_the_rover_moves() {
    let refusal = |mut rover: SimRover| {
        let before = rover.configuration().clone();
        rover.command(command("no", Motion::DriveArc(arc(5.0, 0.0, 0.0))));
        assert_eq!(rover.configuration(), &before);
        last_detail(&rover.take_events(), "no")
    };
    let text =
        refusal(on(|x, _| if x > 2.0 { (x - 2.0) * 20_f64.to_radians().tan() } else { 0.0 }));
    assert!(text.contains("slopes by"), "{text}");
    let text = refusal(on(|x, _| if x > 2.0 { f64::NAN } else { 0.0 }));
    assert!(text.contains("is unknown"), "{text}");
    let text = refusal(on(|x, y| if x > 1.9 && y.abs() < 3.0 { 0.2 } else { 0.0 }));
    assert!(text.contains("step") || text.contains("slopes"), "{text}");
}

#[test]
fn over_rolling_ground_all_wheels_stand_and_the_deck_keeps_its_tilt() {
    let mut rover = on(|x, y| 0.08 * (0.9 * x).sin() * (0.7 * y).cos());
    let tilt = rover.configuration().world_from_base.rotation * nalgebra::Vector3::z();
    let tolerance = rover.scene().robot().stance().ground_tolerance;
    rover.command(command("go", Motion::DriveArc(arc(2.0, 0.2, 0.0))));
    assert_eq!(rover.mode(), Mode::Executing, "{}", last_detail(&rover.take_events(), "go"));
    while rover.mode() == Mode::Executing {
        rover.advance(0.5);
        let frame = rover.frame();
        assert_eq!(frame.contacts, [true; 6], "{:?}", rover.take_events());
        for (point, height) in frame.contact_points.iter().map(|p| (p, 0.08)) {
            let under = height * (0.9 * point.x).sin() * (0.7 * point.y).cos();
            assert!((point.z - under).abs() < tolerance + 0.01, "{point} over {under}");
        }
    }
    assert_eq!(stages(&rover.take_events(), "go").last(), Some(&Stage::Completed));
    let turned = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), 0.2);
    let now = rover.configuration().world_from_base.rotation * nalgebra::Vector3::z();
    assert!((turned * tilt - now).norm() < 1e-9);
}

#[test]
fn a_stop_and_an_estop_end_a_drive_where_it_is() {
    let mut rover = driving(on_plane());
    rover.command(command("go", Motion::DriveArc(arc(2.0, 0.0, 0.0))));
    while rover.frame().wheels[0].spin_rate == 0.0 {
        rover.advance(0.25);
    }
    run(&mut rover, 5.0);
    rover.estop("e");
    let here = rover.configuration().clone();
    run(&mut rover, 3.0);
    assert_eq!(rover.configuration(), &here);
    let frame = rover.frame();
    assert!(frame.wheels.iter().all(|wheel| wheel.brake && wheel.spin_rate == 0.0));
    assert_eq!(stages(&rover.take_events(), "go").last(), Some(&Stage::Aborted));
}
