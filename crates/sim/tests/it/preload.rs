//! Wheels pressed into the ground: how far, and what they then bear.

use nalgebra::{Point3, Vector3};
use sim::{Mode, Motion, SimRover, Stage};

use crate::{GRAVITY, command, demo_robot, last_detail, on_plane, run, stages, wheel_center};

/// Presses the wheel of leg 1 down by `depth` (m) in a command of this identity.
fn press(rover: &mut SimRover, id: &str, depth: f64) {
    let center: Point3<f64> = wheel_center(rover, 0) - Vector3::z() * depth;
    rover.command(command(id, Motion::WheelLine { leg: "leg1".into(), center }));
    run(rover, 5.0);
}

#[test]
fn a_pressed_wheel_keeps_half_of_its_preload_and_the_rest_balance() {
    let mut rover = on_plane();
    press(&mut rover, "press", 0.01);
    assert_eq!(stages(&rover.take_events(), "press").last(), Some(&Stage::Completed));
    let frame = rover.frame();
    assert_eq!(frame.contacts, [true; 6]);
    let weight = demo_robot().mass() * GRAVITY;
    // A leg yields by 0.10 m under a sixth of the bare rover's weight on Earth (F83): 13.9 kN/m.
    let preload = 13_900.0 * 0.01;
    // The rover yields by 1/6 + 1/3 cos(60 deg k) of it at the k-th leg from leg 1.
    let shares = [0.5, -1.0 / 3.0, 0.0, 1.0 / 6.0, 0.0, -1.0 / 3.0];
    for (leg, share) in shares.into_iter().enumerate() {
        let expected = weight / 6.0 + share * preload;
        let load = frame.wheel_forces[leg].z;
        assert!((load - expected).abs() < 0.01 * weight, "leg {leg}: {load} N of {expected} N");
    }
    check_balance(&rover, GRAVITY);
    // And back, as the way was.
    press(&mut rover, "back", -0.01);
    let sixth = weight / 6.0;
    assert!(rover.frame().wheel_forces.iter().all(|f| (f.z - sixth).abs() < 1e-3 * sixth));
}

#[test]
fn loads_balance_at_every_depth_and_none_pulls() {
    // So light that the neighbors hang at the end.
    let gravity = 0.25 * GRAVITY;
    let on_moon = on_plane();
    let (scene, configuration) = (on_moon.scene().clone(), on_moon.configuration().clone());
    let mut rover = SimRover::new(scene, configuration, gravity).unwrap();
    let mut before = 0.0;
    for i in 0..6 {
        press(&mut rover, &format!("{i}"), 0.003);
        check_balance(&rover, gravity);
        let load = rover.frame().wheel_forces[0].z;
        assert!(load >= before, "{load} N after {before} N");
        before = load;
    }
    let frame = rover.frame();
    assert_eq!((frame.wheel_forces[1].z, frame.wheel_forces[5].z), (0.0, 0.0));
}

#[track_caller]
fn check_balance(rover: &SimRover, gravity: f64) {
    let frame = rover.frame();
    let robot = rover.scene().robot();
    let weight = robot.mass() * gravity;
    let sum: Vector3<f64> = frame.wheel_forces.iter().sum();
    assert!((sum - Vector3::z() * weight).norm() < 1e-9 * weight, "{sum}");
    let com = rover::Posture::new(robot, &frame.configuration).center_of_mass(robot);
    let moments = frame.contact_points.iter().zip(&frame.wheel_forces);
    let moment: Vector3<f64> = moments.map(|(point, force)| (point - com).cross(force)).sum();
    assert!(moment.xy().norm() < 1e-9 * weight, "{moment}");
    assert!(frame.wheel_forces.iter().all(|force| force.z >= 0.0));
}

#[test]
fn a_wheel_goes_no_deeper_than_the_ground_tolerance() {
    let mut rover = on_plane();
    press(&mut rover, "press", 0.03);
    assert_eq!(rover.mode(), Mode::Fault);
    let why = last_detail(&rover.take_events(), "press");
    assert!(why.starts_with("leg1's wheel met the ground 0.01 m before its goal"), "{why}");
    let depth = -crate::gap(rover.scene(), rover.configuration(), 0);
    assert!(depth > 0.015 && depth <= 0.02, "{depth} m");
    check_balance(&rover, GRAVITY);
}
