//! Commands that are refused, each by name, with nothing moved.

use nalgebra::{Point2, Point3, Vector3};
use rover::LegAngles;
use sim::{Basis, Command, Event, KNOTS_MAX, Mode, Motion, SettleOptions, SimRover, Stage, settle};

use crate::{
    GRAVITY, command, demo_robot, joint_path, last_detail, on_plane, path_by, plane, raise, scene,
    stages, wheel_center,
};

/// The last stage and what was said, after `motion` was commanded to an idle rover.
fn refusal(motion: Motion, basis: Option<Basis>) -> String {
    let mut rover = on_plane();
    let before = rover.frame();
    rover.command(Command { id: "x".into(), motion, basis, epoch: None });
    let events: Vec<Event> = rover.take_events();
    assert_eq!(stages(&events, "x"), [Stage::Received, Stage::Rejected], "{events:?}");
    assert_eq!(rover.frame(), before);
    last_detail(&events, "x")
}

fn here(leg: usize) -> LegAngles {
    on_plane().configuration().legs[leg]
}

fn path(leg: &str, knots: Vec<LegAngles>) -> Motion {
    joint_path(leg, knots.into_iter().map(|angles| (angles, 0.0)))
}

#[test]
fn bad_paths_are_refused_by_name() {
    let start = here(1);
    let mut nan = start;
    nan[4] = f64::NAN;
    let mut beyond = start;
    beyond[2] = 3.2;
    let mut off = start;
    off[0] += 0.011;
    let table = [
        (path("leg9", vec![start; 2]), "there is no leg \"leg9\"; the legs are leg1, leg2, leg3"),
        (path("leg2", vec![]), "the path has 0 knots; 2 to 10000 are allowed"),
        (path("leg2", vec![start]), "the path has 1 knots"),
        (path("leg2", vec![start; KNOTS_MAX + 1]), "the path has 10001 knots"),
        (path("leg2", vec![start, nan]), "leg2_ankle_pitch of knot 1 is not finite"),
        (path("leg2", vec![start, beyond]), "knot 1 takes leg2_knee_pitch to 3.2000 rad, beyond"),
        (path("leg2", vec![off, start]), "the path begins with leg2_hip_yaw at 0.0110 rad, but it"),
    ];
    for (motion, expected) in table {
        let text = refusal(motion, None);
        assert!(text.starts_with(expected), "{text}");
    }
}

#[test]
fn bad_lines_are_refused_by_name() {
    let wheel = wheel_center(&on_plane(), 1);
    let line = |leg: &str, x: f64, y: f64, z: f64| Motion::WheelLine {
        leg: leg.into(),
        center: Point3::new(wheel.x + x, wheel.y + y, wheel.z + z),
    };
    let nan = refusal(line("leg2", f64::NAN, 0.0, 0.0), None);
    assert_eq!(nan, "the goal of the wheel's center is not finite");
    let unknown = refusal(line("leg", 0.0, 0.0, 0.1), None);
    assert!(unknown.starts_with("there is no leg \"leg\""), "{unknown}");
    // Bent legs have their wrist's singular pose between here and there.
    let far = refusal(line("leg2", 0.5, 0.8, 0.0), None);
    assert!(far.ends_with("along it the leg would have to change its branch"), "{far}");
    let away = refusal(line("leg2", 1e9, 0.0, 0.0), None);
    assert!(away.starts_with("the wheel cannot follow the line: "), "{away}");
}

#[test]
fn a_line_out_of_reach_is_refused_with_where_and_how_much() {
    // The standing pose is nearly straight: its wheels reach a few centimeters further out.
    let scene = scene(demo_robot(), plane());
    let settled =
        settle(&scene, Point2::origin(), 0.0, "standing", &SettleOptions::default()).unwrap();
    let mut rover = SimRover::new(scene, settled.configuration, GRAVITY).unwrap();
    let center = wheel_center(&rover, 0) + Vector3::x() * 0.5;
    rover.command(command("out", Motion::WheelLine { leg: "leg1".into(), center }));
    let why = last_detail(&rover.take_events(), "out");
    assert!(why.starts_with("the wheel cannot follow the line: 0.0"), "{why}");
    assert!(why.contains("of 0.500 m along it the goal is out of reach by 0.00"), "{why}");
}

#[test]
fn a_command_checked_against_another_state_is_refused() {
    let present = here(3);
    let mut other = present;
    other[1] += 0.03;
    let motion = || path("leg2", vec![here(1), here(1) + raise(0.1)]);
    let basis = |leg: &str, angles: LegAngles, tolerance: f64| {
        Some(Basis { legs: vec![(leg.into(), angles)], tolerance })
    };
    let off = refusal(motion(), basis("leg4", other, 0.02));
    assert!(off.starts_with("the command was checked with leg4_hip_pitch at"), "{off}");
    assert!(off.ends_with("more than 0.02 rad away: plan again"), "{off}");
    let unknown = refusal(motion(), basis("leg7", present, 0.02));
    assert!(unknown.starts_with("there is no leg \"leg7\""), "{unknown}");
    for tolerance in [-0.1, f64::NAN] {
        let text = refusal(motion(), basis("leg4", present, tolerance));
        assert!(text.starts_with("the basis tolerance is"), "{text}");
    }
    other[1] = f64::NAN;
    let text = refusal(motion(), basis("leg4", other, 0.02));
    assert!(text.starts_with("leg4_hip_pitch of the basis is not finite"), "{text}");
    // Within the tolerance it is carried out.
    let mut rover = on_plane();
    other[1] = present[1] + 0.019;
    let basis = basis("leg4", other, 0.02);
    rover.command(Command { id: "ok".into(), motion: motion(), basis, epoch: None });
    assert_eq!(rover.mode(), Mode::Executing);
}

#[test]
fn one_command_at_a_time() {
    let mut rover = on_plane();
    let motion = path_by(&rover, 1, &[raise(0.2)]);
    rover.command(command("first", motion));
    rover.advance(0.5);
    let motion = path_by(&rover, 3, &[raise(0.2)]);
    rover.command(command("second", motion));
    let events = rover.take_events();
    assert_eq!(stages(&events, "second"), [Stage::Received, Stage::Rejected]);
    assert_eq!(
        last_detail(&events, "second"),
        "the rover executes first; wait for its end or stop it"
    );
    assert_eq!(rover.frame().executing.unwrap().id, "first");
}
