//! Named joints, wheels in task space, the body, brakes, modes, holds, and sequences.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use rover::{LegId, Posture};
use sim::{Frame, Gate, GoalFrame, Mode, Motion, Operating, SimRover, Stage, Step};

use crate::{command, last_detail, on_plane, path_by, raise, run, stages};

fn step(motion: Motion) -> Step {
    Step { motion, gate: None }
}

fn brake(legs: &[&str], on: bool) -> Motion {
    Motion::WheelBrake { legs: legs.iter().map(|leg| (*leg).to_owned()).collect(), on }
}

fn joint(name: &str, goal: f64) -> Motion {
    Motion::JointMove { joints: vec![(name.into(), goal)], speed: None }
}

fn offset(leg: &str, by: [f64; 3]) -> Motion {
    Motion::WheelMove {
        leg: leg.into(),
        frame: GoalFrame::Offset,
        position: by.into(),
        rotation: Vector3::zeros(),
        speed: None,
    }
}

fn wheel(rover: &SimRover, leg: usize) -> Isometry3<f64> {
    let robot = rover.scene().robot();
    Posture::new(robot, rover.configuration()).wheel(robot, LegId(leg)).world_from_wheel
}

fn refused(rover: &SimRover, motion: Motion) -> String {
    let mut rover = rover.clone();
    rover.command(command("no", motion));
    let events = rover.take_events();
    assert_eq!(stages(&events, "no").last(), Some(&Stage::Rejected));
    last_detail(&events, "no")
}

fn done(rover: &mut SimRover, id: &str, motion: Motion) {
    rover.command(command(id, motion));
    let mut seconds = 0;
    while rover.mode() == Mode::Executing && seconds < 300 {
        rover.advance(1.0);
        seconds += 1;
    }
    let events = rover.take_events();
    assert_eq!(stages(&events, id).last(), Some(&Stage::Completed), "{}", last_detail(&events, id));
}

#[test]
fn named_joints_go_to_their_angles_at_the_speed_asked_for() {
    let mut rover = on_plane();
    let before = rover.configuration().legs[1];
    let goal = before[1] - 0.2;
    let slow = Motion::JointMove {
        joints: vec![("leg2_hip_pitch".into(), goal), ("leg2_ankle_roll".into(), before[5] + 0.1)],
        speed: Some(0.02),
    };
    rover.command(command("slow", slow));
    rover.advance(9.9);
    assert_eq!(rover.mode(), Mode::Executing);
    rover.advance(0.5);
    assert_eq!(rover.mode(), Mode::Idle, "0.2 rad at 0.02 rad/s take 10 s");
    let mut expected = before;
    (expected[1], expected[5]) = (goal, before[5] + 0.1);
    assert!((rover.configuration().legs[1] - expected).amax() < 1e-9);
    let rover = on_plane();
    let text = refused(&rover, joint("leg9_hip_yaw", 0.0));
    assert!(
        text.contains("there is no joint \"leg9_hip_yaw\"") && text.contains("leg1_"),
        "{text}"
    );
    let two = vec![("leg1_hip_yaw".into(), 0.0), ("leg2_hip_yaw".into(), 0.0)];
    let text = refused(&rover, Motion::JointMove { joints: two, speed: None });
    assert!(text.contains("joints of leg1 and leg2"), "{text}");
    let text = refused(&rover, joint("leg1_hip_pitch", 3.0));
    assert!(text.contains("leg1_hip_pitch to 3.0000 rad, beyond its limits"), "{text}");
    let text = refused(&rover, joint("leg1_hip_pitch", f64::NAN));
    assert!(text.contains("not finite"), "{text}");
    let fast = Motion::JointMove { joints: vec![("leg1_hip_yaw".into(), 0.0)], speed: Some(1.0) };
    assert!(refused(&rover, fast).contains("the speed is 1; 0.0001 to 0.1 rad/s"));
}

#[test]
fn a_wheel_moves_in_task_space_in_each_frame_and_turns() {
    for frame in [GoalFrame::World, GoalFrame::Base, GoalFrame::Offset] {
        let mut rover = on_plane();
        let before = wheel(&rover, 1);
        let by = Vector3::new(0.05, -0.03, 0.25);
        let goal = before.translation.vector + by;
        let base = rover.configuration().world_from_base;
        let position = match frame {
            GoalFrame::World => goal,
            GoalFrame::Base => base.inverse_transform_point(&goal.into()).coords,
            GoalFrame::Offset => by,
        };
        let rotation = Vector3::z() * 0.3;
        let leg = "leg2".to_owned();
        let speed = Some(0.05);
        done(&mut rover, "go", Motion::WheelMove { leg, frame, position, rotation, speed });
        let now = wheel(&rover, 1);
        assert!((now.translation.vector - goal).norm() < 1e-6, "{frame:?}");
        // The base stands level, so that its z is that of the world.
        let turn = (now.rotation * before.rotation.inverse()).scaled_axis();
        assert!((turn - rotation).norm() < 1e-6, "{frame:?}: {turn}");
        assert!(rover.time_s() > by.norm() / 0.05);
    }
}

#[test]
fn the_body_moves_in_six_directions_over_its_wheels() {
    for (translation, rotation) in [
        (Vector3::new(0.06, -0.04, 0.05), Vector3::zeros()),
        (Vector3::zeros(), Vector3::new(0.05, -0.04, 0.08)),
    ] {
        let mut rover = on_plane();
        let before = rover.configuration().world_from_base;
        let wheels: Vec<_> = (0..6).map(|leg| wheel(&rover, leg)).collect();
        done(&mut rover, "go", Motion::BodyMove { translation, rotation, speed: Some(0.02) });
        let moved = before.inverse() * rover.configuration().world_from_base;
        assert!((moved.translation.vector - translation).norm() < 1e-6);
        assert!((moved.rotation.scaled_axis() - rotation).norm() < 1e-6);
        for (leg, was) in wheels.iter().enumerate() {
            let off = was.inverse() * wheel(&rover, leg);
            assert!(off.translation.vector.norm() < 1e-6 && off.rotation.angle() < 1e-6);
        }
    }
    let far = Vector3::new(0.0, 0.0, 3.0);
    let text = refused(
        &on_plane(),
        Motion::BodyMove { translation: far, rotation: Vector3::zeros(), speed: None },
    );
    assert!(text.contains("cannot hold its wheel where it stands"), "{text}");
}

#[test]
fn modes_and_brakes_say_what_may_move() {
    let mut rover = on_plane();
    assert!(rover.frame().wheels.iter().all(|wheel| wheel.brake));
    let text = refused(&rover, brake(&[], false));
    assert!(text.contains("releasing a brake needs mode driving"), "{text}");
    done(&mut rover, "safe", Motion::Mode(Operating::Safe));
    let up = path_by(&rover, 1, &[raise(0.1)]);
    assert!(
        refused(&rover, up.clone()).contains("a leg needs mode ready, and the rover is in safe")
    );
    done(&mut rover, "driving", Motion::Mode(Operating::Driving));
    done(&mut rover, "off", brake(&["leg4"], false));
    let on: Vec<bool> = rover.frame().wheels.iter().map(|wheel| wheel.brake).collect();
    assert_eq!(on, [true, true, true, false, true, true]);
    assert!(refused(&rover, up.clone()).contains("the brake of leg4's wheel is off"));
    assert!(refused(&rover, brake(&["leg7"], true)).contains("there is no leg \"leg7\""));
    done(&mut rover, "ready", Motion::Mode(Operating::Ready));
    assert!(rover.frame().wheels.iter().all(|wheel| wheel.brake), "ready applies all brakes");
    done(&mut rover, "up", up);
    done(&mut rover, "driving again", Motion::Mode(Operating::Driving));
    let roll = |leg: &str| Motion::WheelRoll { leg: leg.into(), angle: 1.5, speed: None };
    assert!(refused(&rover, roll("leg1")).contains("leg1's wheel stands"));
    assert!(refused(&rover, roll("leg2")).contains("the brake of leg2's wheel is on"));
    done(&mut rover, "off 2", brake(&["leg2"], false));
    done(&mut rover, "roll", roll("leg2"));
    assert!((rover.frame().wheels[1].spin - 1.5).abs() < 1e-12);
}

#[test]
fn wheels_steer_in_place_to_their_headings() {
    let mut rover = on_plane();
    done(&mut rover, "driving", Motion::Mode(Operating::Driving));
    done(&mut rover, "off", brake(&["leg1", "leg5"], false));
    let before: Vec<_> = (0..6).map(|leg| wheel(&rover, leg)).collect();
    let base = rover.configuration().world_from_base;
    let headings = vec![("leg1".into(), 0.4), ("leg5".into(), -0.7)];
    done(&mut rover, "steer", Motion::WheelSteer { headings });
    assert_eq!(rover.configuration().world_from_base, base);
    for (leg, was) in before.iter().enumerate() {
        let now = wheel(&rover, leg);
        assert!((now.translation.vector - was.translation.vector).norm() < 1e-6, "leg {leg}");
        let heading = match leg {
            0 => 0.4,
            4 => -0.7,
            _ => {
                assert_eq!(&now, was);
                continue;
            }
        };
        // A wheel heads both ways: its axle is across the heading.
        let axle = base.rotation.inverse() * now.rotation * Vector3::y();
        assert!((axle.x * f64::cos(heading) + axle.y * f64::sin(heading)).abs() < 1e-6);
    }
}

#[test]
fn a_hold_ends_what_is_under_way_and_brakes() {
    let mut rover = on_plane();
    let up = path_by(&rover, 1, &[raise(0.3)]);
    rover.command(command("up", up));
    run(&mut rover, 1.0);
    rover.command(command("hold", Motion::Hold));
    run(&mut rover, 1.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "up").last(), Some(&Stage::Aborted));
    assert_eq!(stages(&events, "hold"), [Stage::Received, Stage::Started, Stage::Completed]);
    assert_eq!(rover.mode(), Mode::Idle);
    // With nothing under way it is there at once.
    rover.command(command("again", Motion::Hold));
    assert_eq!(stages(&rover.take_events(), "again"), [Stage::Received, Stage::Completed]);
}

#[test]
fn a_sequence_goes_in_order_tells_its_step_and_stops_at_the_first_failure() {
    let mut rover = on_plane();
    let goal = rover.configuration().legs[1][1] - 0.2;
    let steps = vec![
        step(joint("leg2_hip_pitch", goal)),
        step(Motion::Mode(Operating::Driving)),
        step(brake(&["leg2"], false)),
        step(joint("leg3_hip_pitch", goal)),
        step(Motion::Hold),
    ];
    rover.command(command("all", Motion::Sequence(steps)));
    let mut seen = Vec::new();
    let mut least = 0.0;
    while rover.mode() == Mode::Executing {
        if let Some(executing) = rover.frame().executing {
            assert!(executing.progress >= least - 1e-12);
            least = executing.progress;
            seen.push(executing.step.unwrap());
        }
        rover.advance(0.1);
    }
    seen.dedup();
    assert_eq!(seen, [[1, 5], [2, 5], [3, 5]]);
    // Leg 3 beside the lifted leg 2 would tip the rover.
    let events = rover.take_events();
    assert_eq!(stages(&events, "all"), [Stage::Received, Stage::Started, Stage::Failed]);
    let text = last_detail(&events, "all");
    assert!(text.starts_with("step 4 of 5: leg3 "), "{text}");
    assert!(text.ends_with("; step 5 was not begun"), "{text}");
    assert_eq!(rover.mode(), Mode::Idle);
    assert!(!rover.frame().wheels[1].brake, "step 5 would have braked");
    done(&mut rover, "rest", Motion::Sequence(vec![step(Motion::Hold)]));
    assert!(rover.frame().wheels[1].brake);
}

#[test]
fn what_a_step_waits_for_is_asked_when_it_begins() {
    let gate = |what: fn(&Frame) -> bool| {
        Some(Gate(Arc::new(
            move |frame: &Frame| {
                if what(frame) { Ok(()) } else { Err("it is not so".to_owned()) }
            },
        )))
    };
    let braked = gate(|frame| frame.wheels.iter().all(|wheel| wheel.brake));
    let mode = |operating| Motion::Mode(operating);
    // Holds before the first step, not before the third.
    let steps = vec![
        Step { motion: mode(Operating::Driving), gate: braked.clone() },
        step(brake(&["leg1"], false)),
        Step { motion: mode(Operating::Ready), gate: braked.clone() },
        step(mode(Operating::Safe)),
    ];
    let mut rover = on_plane();
    rover.command(command("s", Motion::Sequence(steps.clone())));
    run(&mut rover, 3.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "s"), [Stage::Received, Stage::Started, Stage::Failed]);
    let text = last_detail(&events, "s");
    let expected = "step 3 of 4: a condition does not hold: it is not so; step 4 was not begun";
    assert_eq!(text, expected);
    assert_eq!(rover.frame().operating, Operating::Driving, "steps 3 and 4 were not begun");
    assert_eq!(rover.mode(), Mode::Idle);
    // Now it does not hold before the first: nothing begins.
    rover.command(command("t", Motion::Sequence(steps)));
    let events = rover.take_events();
    assert_eq!(stages(&events, "t"), [Stage::Received, Stage::Rejected]);
}

#[test]
fn the_rest_of_a_sequence_can_be_cancelled_and_stops_end_all_of_it() {
    let mut rover = on_plane();
    let here = rover.configuration().legs[1][1];
    let steps = vec![
        step(joint("leg2_hip_pitch", here - 0.2)),
        step(joint("leg2_hip_pitch", here)),
        step(Motion::Hold),
    ];
    rover.command(command("s", Motion::Sequence(steps)));
    run(&mut rover, 0.5);
    rover.command(command("cut", Motion::CancelRest));
    run(&mut rover, 5.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "cut").last(), Some(&Stage::Completed));
    assert_eq!(last_detail(&events, "cut"), "2 steps were cancelled");
    assert_eq!(stages(&events, "s").last(), Some(&Stage::Aborted));
    let text = last_detail(&events, "s");
    assert!(text.starts_with("step 1 of 3: done; the rest was cancelled"), "{text}");
    assert!((rover.configuration().legs[1][1] - (here - 0.2)).abs() < 1e-9);
}

#[test]
fn sequences_that_are_none_are_refused_by_name() {
    let rover = on_plane();
    let none = Motion::Sequence(Vec::new());
    assert!(refused(&rover, none).contains("0 steps; 1 to 100"));
    let many = Motion::Sequence(vec![step(Motion::Hold); 101]);
    assert!(refused(&rover, many).contains("101 steps; 1 to 100"));
    for (motion, what) in [
        (Motion::Stop, "a stop is no step"),
        (Motion::CancelRest, "a cancellation of the rest is no step"),
        (Motion::Sequence(vec![step(Motion::Hold)]), "a sequence is no step"),
    ] {
        let text = refused(&rover, Motion::Sequence(vec![step(Motion::Hold), step(motion)]));
        assert!(text.contains(what), "{text}");
    }
}

#[test]
fn a_preview_goes_from_step_to_step_and_changes_nothing() {
    let rover = on_plane();
    let here = rover.configuration().legs[1][1];
    let up = || step(joint("leg2_hip_pitch", here - 0.2));
    let good = Motion::Sequence(vec![up(), step(joint("leg2_hip_pitch", here))]);
    let seen = rover.preview(&good).unwrap();
    assert_eq!(seen.steps_s.len(), 2);
    // 0.2 rad at 0.1 rad/s, and half a second to speed up and to slow down.
    assert!((seen.duration_s - 5.0).abs() < 1e-6, "{} s", seen.duration_s);
    // After two other legs are up, a third and a fourth would leave too few.
    let raise = |leg: &str| step(offset(leg, [0.0, 0.0, 0.2]));
    let bad = Motion::Sequence(vec![raise("leg1"), raise("leg2"), raise("leg3"), raise("leg4")]);
    let error = rover.preview(&bad).unwrap_err();
    assert!(error.step.unwrap() >= 1, "{error}");
    assert_eq!(rover.preview(&good).unwrap(), seen);
    assert_eq!(rover.mode(), Mode::Idle);
}
