//! Stops, E-stops, and the guards that stop the rover by itself.

use std::sync::Arc;

use collision::{Obstacle, Scene};
use nalgebra::{Isometry3, Vector3};
use rover::LegAngles;
use sim::{Mode, Motion, ReseatError, SettleOptions, SimRover, Stage, settle};

use crate::{
    GRAVITY, athlete, command, demo_robot, gap, ground, last_detail, on_plane, path_by, plane,
    raise, run, scene, stages, wheel_center,
};

#[test]
fn a_stop_ends_the_motion_where_it_is_and_the_rover_takes_commands_again() {
    let mut rover = on_plane();
    let start = rover.configuration().legs[1];
    let motion = path_by(&rover, 1, &[raise(0.4)]);
    rover.command(command("up", motion));
    run(&mut rover, 1.0);
    rover.command(command("halt", Motion::Stop));
    let halted = rover.configuration().clone();
    assert!((halted.legs[1] - start - raise(0.075)).amax() < 1e-9);
    run(&mut rover, 3.0);
    assert_eq!(rover.configuration(), &halted);
    let events = rover.take_events();
    assert_eq!(stages(&events, "up"), [Stage::Received, Stage::Started, Stage::Aborted]);
    assert_eq!(last_detail(&events, "up"), "ended by a stop command after 22 % of its time");
    assert_eq!(stages(&events, "halt"), [Stage::Received, Stage::Completed]);
    let motion = path_by(&rover, 1, &[-raise(0.1)]);
    rover.command(command("down", motion));
    assert_eq!(rover.mode(), Mode::Executing);
}

#[test]
fn an_estop_holds_until_it_is_released() {
    let mut rover = on_plane();
    let motion = path_by(&rover, 1, &[raise(0.4)]);
    rover.command(command("up", motion));
    run(&mut rover, 1.0);
    rover.estop("e1");
    let halted = rover.configuration().clone();
    run(&mut rover, 1.0);
    assert_eq!((rover.mode(), rover.configuration()), (Mode::Stopped, &halted));
    let motion = path_by(&rover, 1, &[-raise(0.1)]);
    rover.command(command("down", motion.clone()));
    rover.command(command("halt", Motion::Stop));
    rover.estop("e1");
    let events = rover.take_events();
    assert_eq!(stages(&events, "up").last(), Some(&Stage::Aborted));
    assert_eq!(stages(&events, "down"), [Stage::Received, Stage::Rejected]);
    assert!(last_detail(&events, "down").contains("release the stop first"));
    assert_eq!(stages(&events, "halt").last(), Some(&Stage::Completed));
    assert_eq!(rover.mode(), Mode::Stopped, "a stop command ends no E-stop");
    rover.release("r1");
    assert_eq!(rover.mode(), Mode::Idle);
    // The same release once more, after another stop: it counts once.
    rover.estop("e2");
    rover.release("r1");
    assert_eq!(rover.mode(), Mode::Stopped);
    rover.release("r2");
    rover.command(command("again", motion));
    assert_eq!(rover.mode(), Mode::Executing);
    let events = rover.take_events();
    assert_eq!(stages(&events, "r1"), [Stage::Received, Stage::Completed, Stage::Received]);
    rover.release("r3");
    assert_eq!(rover.mode(), Mode::Executing, "a release ends no command");
    assert_eq!(last_detail(&rover.take_events(), "r3"), "no stop was in force");
}

#[test]
fn a_wheel_that_meets_the_ground_stops_within_tolerance_and_says_how_far_it_had_to_go() {
    let mut rover = on_plane();
    let goal = wheel_center(&rover, 1) - Vector3::z() * 0.25;
    rover.command(command("dig", Motion::WheelLine { leg: "leg2".into(), center: goal }));
    run(&mut rover, 30.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "dig"), [Stage::Received, Stage::Started, Stage::Failed]);
    let tolerance = rover.scene().robot().stance().ground_tolerance;
    let depth = -gap(rover.scene(), rover.configuration(), 1);
    assert!(depth <= tolerance && depth > tolerance - 0.006, "{depth}");
    let frame = rover.frame();
    assert_eq!(frame.mode, Mode::Fault);
    let fault = frame.fault.unwrap();
    assert_eq!(fault, "leg2's wheel met the ground 0.23 m before its goal");
    assert_eq!(last_detail(&events, "dig"), fault);
    assert!(frame.contacts[1]);
    // Until released it moves no more; then it may lift the wheel out again.
    let up = goal + Vector3::z() * 0.4;
    let lift = Motion::WheelLine { leg: "leg2".into(), center: up };
    rover.command(command("early", lift.clone()));
    assert_eq!(stages(&rover.take_events(), "early").last(), Some(&Stage::Rejected));
    rover.release("r");
    assert_eq!((rover.mode(), rover.frame().fault), (Mode::Idle, None));
    rover.command(command("lift", lift));
    run(&mut rover, 30.0);
    assert_eq!(stages(&rover.take_events(), "lift").last(), Some(&Stage::Completed));
}

#[test]
fn a_rock_on_the_way_stops_the_wheel() {
    // Leg 1 stands at x = 2.2, y = 0; beside it is a ridge 0.5 m high.
    let ridge = ground(|x, y| if x > 1.8 && (0.5..0.8).contains(&y) { 0.5 } else { 0.0 });
    let configuration = on_plane().configuration().clone();
    let mut rover = SimRover::new(scene(demo_robot(), ridge), configuration, GRAVITY).unwrap();
    let low = wheel_center(&rover, 0) + Vector3::z() * 0.15;
    rover.command(command("up", Motion::WheelLine { leg: "leg1".into(), center: low }));
    run(&mut rover, 30.0);
    let over = low + Vector3::y() * 0.5;
    rover.command(command("over", Motion::WheelLine { leg: "leg1".into(), center: over }));
    run(&mut rover, 60.0);
    let fault = rover.frame().fault.unwrap();
    assert!(fault.starts_with("leg1's wheel met the ground 0."), "{fault}");
}

#[test]
fn a_leg_that_meets_another_or_an_obstacle_stops() {
    // Turned towards each other by a radian, the wheels of legs 1 and 2 are in each other's way.
    let mut rover = on_plane();
    let turn = |angle: f64| raise(0.1) + LegAngles::new(angle, 0.0, 0.0, 0.0, 0.0, 0.0);
    let motion = path_by(&rover, 1, &[raise(0.1), turn(-1.0), turn(-1.0) - raise(0.1)]);
    rover.command(command("right", motion));
    run(&mut rover, 30.0);
    assert_eq!(rover.frame().contacts, [true; 6]);
    let motion = path_by(&rover, 0, &[raise(0.1), turn(1.3)]);
    rover.command(command("left", motion));
    run(&mut rover, 30.0);
    let fault = rover.frame().fault.unwrap();
    assert!(fault.starts_with("leg1_") && fault.contains(" met leg2_"), "{fault}");

    let robot = demo_robot();
    let bare = scene(robot.clone(), plane());
    let settled =
        settle(&bare, nalgebra::Point2::origin(), 0.0, "bent", &SettleOptions::default()).unwrap();
    let wall = Obstacle::Box {
        world_from_box: Isometry3::translation(2.2, 0.9, 0.5),
        half_extents: Vector3::new(0.5, 0.1, 0.5),
    };
    let walled = Scene::new(Arc::new(robot), plane(), &[wall]).unwrap();
    let mut rover = SimRover::new(walled, settled.configuration, GRAVITY).unwrap();
    let motion = path_by(&rover, 0, &[raise(0.1), turn(1.0)]);
    rover.command(command("turn", motion));
    run(&mut rover, 30.0);
    let fault = rover.frame().fault.unwrap();
    assert!(fault.contains("met obstacle 0"), "{fault}");
}

#[test]
fn what_would_tip_the_rover_is_refused_before_it_moves() {
    let mut rover = on_plane();
    for leg in [0, 2] {
        let motion = path_by(&rover, leg, &[raise(0.15)]);
        rover.command(command(&format!("up{leg}"), motion));
        run(&mut rover, 5.0);
    }
    assert_eq!(rover.frame().contacts, [false, true, false, true, true, true]);
    rover.take_events();
    // Without leg 2 the feet 4, 5, 6 are left: the line of 4 and 6 is half the radius of the feet
    // (2.24 m) from the middle, and the lifted legs are on the other side.
    let before = rover.configuration().clone();
    let motion = path_by(&rover, 1, &[raise(0.15)]);
    rover.command(command("tip", motion));
    run(&mut rover, 5.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "tip"), [Stage::Received, Stage::Rejected]);
    let why = last_detail(&events, "tip");
    assert!(why.starts_with("leg2 would be off the ground with the center of mass 1.1"), "{why}");
    assert!(why.ends_with("outside the support of leg4, leg5, leg6"), "{why}");
    assert_eq!(rover.configuration(), &before);
    // Standing on 2, 4 and 6 after lifting 5 as well is fine; a further leg leaves two.
    let motion = path_by(&rover, 4, &[raise(0.15)]);
    rover.command(command("tripod", motion));
    run(&mut rover, 5.0);
    let motion = path_by(&rover, 3, &[raise(0.15)]);
    rover.command(command("two", motion));
    let events = rover.take_events();
    assert_eq!(stages(&events, "tripod").last(), Some(&Stage::Completed));
    let why = last_detail(&events, "two");
    assert_eq!(why, "leg4 cannot leave the ground: 2 other wheels stand, and 3 are needed");
}

#[test]
fn only_an_idle_rover_is_put_elsewhere() {
    let mut rover = on_plane();
    let ramp = scene(demo_robot(), ground(|x, _| 0.1 * x));
    let there = |scene: &Scene| {
        let place = nalgebra::Point2::new(1.0, 1.0);
        settle(scene, place, 0.5, "bent", &SettleOptions::default()).unwrap().configuration
    };
    let motion = path_by(&rover, 1, &[raise(0.2)]);
    rover.command(command("up", motion));
    assert_eq!(rover.reseat(ramp.clone(), there(&ramp)), Err(ReseatError::NotIdle));
    run(&mut rover, 3.0);
    rover.estop("e");
    assert_eq!(rover.reseat(ramp.clone(), there(&ramp)), Err(ReseatError::NotIdle));
    rover.release("r");
    let before = rover.frame();
    // On the plane's configuration it would hang over the ramp.
    let hanging = before.configuration.clone();
    let refused = rover.reseat(ramp.clone(), hanging);
    assert!(matches!(refused, Err(ReseatError::Stand(_))), "{refused:?}");
    assert_eq!(rover.frame(), before, "a refused move changes nothing");
    rover.reseat(ramp.clone(), there(&ramp)).unwrap();
    assert_eq!(rover.configuration(), &there(&ramp));
    assert_eq!(rover.frame().contacts, [true; 6]);
    let light = scene(athlete(), plane());
    rover.reseat(light.clone(), there(&light)).unwrap();
    let weight: f64 = rover.frame().wheel_forces.iter().map(|f| f.z).sum();
    assert!((weight - 850.0 * GRAVITY).abs() < 1e-3);
}
