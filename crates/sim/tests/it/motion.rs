//! Commands carried out: times, ways and forces against closed forms.

use nalgebra::{Point3, Vector3};
use rover::{LegAngles, LegId, Posture};
use sim::{Mode, Motion, SimRover, Stage};

use crate::{
    GRAVITY, command, demo_robot, last_detail, on_plane, path_by, quickest, raise, run, stages,
    wheel_center,
};

/// Joint speed of the robot (rad/s).
const SPEED: f64 = 0.1;

#[track_caller]
fn check_forces(rover: &SimRover, standing: usize) {
    let frame = rover.frame();
    let weight = demo_robot().mass() * GRAVITY;
    let sum: f64 = frame.wheel_forces.iter().map(|f| f.z).sum();
    assert!((sum - weight).abs() < 1e-6 * weight, "{sum} N of {weight} N");
    let posture = Posture::new(rover.scene().robot(), &frame.configuration);
    let com = posture.center_of_mass(rover.scene().robot());
    let moment: Vector3<f64> = frame
        .contact_points
        .iter()
        .zip(&frame.wheel_forces)
        .map(|(point, force)| (point - com).cross(force))
        .sum();
    assert!(moment.xy().norm() < 1e-6 * weight, "{moment}");
    assert_eq!(frame.contacts.iter().filter(|stands| **stands).count(), standing);
    for (stands, force) in frame.contacts.iter().zip(&frame.wheel_forces) {
        assert!(*stands || force.norm() == 0.0);
    }
}

#[test]
fn an_idle_rover_reports_equal_forces_and_all_contacts() {
    let rover = on_plane();
    check_forces(&rover, 6);
    let frame = rover.frame();
    assert_eq!((frame.mode, frame.executing, frame.fault), (Mode::Idle, None, None));
    let sixth = demo_robot().mass() * GRAVITY / 6.0;
    assert!(frame.wheel_forces.iter().all(|f| (f.z - sixth).abs() < 1e-3 * sixth));
    assert!(frame.contact_points.iter().all(|p| p.z.abs() < 1e-6));
}

#[test]
fn a_path_takes_what_its_slowest_joint_needs_and_ends_at_its_last_knot() {
    let mut rover = on_plane();
    let offsets = [raise(0.3), raise(0.3) + LegAngles::new(0.2, 0.0, 0.0, 0.0, 0.0, 0.0)];
    let start = rover.configuration().clone();
    let motion = path_by(&rover, 1, &offsets);
    rover.command(command("a", motion));
    let base = rover.frame().configuration.world_from_base;
    run(&mut rover, 1.5);
    let frame = rover.frame();
    assert_eq!(frame.mode, Mode::Executing);
    let executing = frame.executing.unwrap();
    assert_eq!(executing.id, "a");
    // Half a second to come to speed, on the average at half of it, then a second at 0.1 rad/s.
    let there = start.legs[1] + raise(0.025 + 0.1);
    assert!((frame.configuration.legs[1] - there).amax() < 1e-9);
    run(&mut rover, 10.0);
    let events = rover.take_events();
    assert_eq!(stages(&events, "a"), [Stage::Received, Stage::Started, Stage::Completed]);
    // The corner is passed at a crawl: two motions but for the end of the first.
    let both = quickest(0.3) + quickest(0.2);
    let took = events[2].time_s;
    assert!(took < both && took > both - 0.11, "{took} s");
    assert!((executing.progress - 1.5 / took).abs() < 1e-9);
    let frame = rover.frame();
    assert_eq!((frame.mode, frame.executing), (Mode::Idle, None));
    assert!((frame.time_s - 11.5).abs() < 1e-9);
    assert!((frame.configuration.legs[1] - start.legs[1] - offsets[1]).amax() < 1e-12);
    assert_eq!(frame.configuration.world_from_base, base, "the base stays");
    for other in [0, 2, 3, 4, 5] {
        assert_eq!(frame.configuration.legs[other], start.legs[other]);
    }
}

#[test]
fn a_lifted_wheel_is_told_and_its_load_goes_to_the_others() {
    let mut rover = on_plane();
    let motion = path_by(&rover, 1, &[raise(0.2)]);
    rover.command(command("up", motion));
    run(&mut rover, 2.5);
    let frame = rover.frame();
    assert_eq!(frame.contacts, [true, false, true, true, true, true]);
    check_forces(&rover, 5);
    // The five carry by the hexagon's rule, 5 : 3 : 2 : 3 : 5 of 18, but for the shift of the
    // center of mass by the lifted leg.
    let weight = demo_robot().mass() * GRAVITY;
    for (leg, share) in [(0, 5.0), (2, 5.0), (3, 3.0), (5, 3.0), (4, 2.0)] {
        let off = frame.wheel_forces[leg].z / weight - share / 18.0;
        assert!(off.abs() < 0.02, "leg {leg}: {off}");
    }
    // The lifted leg holds its own links, as its neighbors would without the ground.
    let lifted = frame.joint_torques[1];
    assert!(lifted.norm() > 1.0 && lifted.norm() < frame.joint_torques[0].norm());
    let wheel_low = wheel_center(&rover, 1) - Vector3::z() * 0.264;
    assert!((frame.contact_points[1].z - wheel_low.z).abs() < 0.02);
    // And back: it stands again.
    let motion = path_by(&rover, 1, &[-raise(0.2)]);
    rover.command(command("down", motion));
    run(&mut rover, 4.0);
    check_forces(&rover, 6);
    assert_eq!(rover.frame().mode, Mode::Idle);
}

#[test]
fn a_wheel_line_is_straight_and_keeps_the_wheels_orientation() {
    let mut rover = on_plane();
    let start = wheel_center(&rover, 3);
    let up = start + Vector3::new(0.0, 0.0, 0.3);
    rover.command(command("up", Motion::WheelLine { leg: "leg4".into(), center: up }));
    run(&mut rover, 60.0);
    assert_eq!(stages(&rover.take_events(), "up").last(), Some(&Stage::Completed));
    let goal = up + Vector3::new(0.1, -0.25, 0.1);
    let before = orientation(&rover, 3);
    rover.command(command("over", Motion::WheelLine { leg: "leg4".into(), center: goal }));
    let mut looks = 0;
    while rover.mode() == Mode::Executing {
        rover.advance(0.05);
        let along = (goal - up).normalize();
        let center = wheel_center(&rover, 3);
        let off = (center - up) - along * (center - up).dot(&along);
        assert!(off.norm() < 2e-5, "{} m off the line", off.norm());
        assert!(orientation(&rover, 3).angle_to(&before) < 2e-5);
        looks += 1;
    }
    assert!(looks > 20 && (wheel_center(&rover, 3) - goal).norm() < 1e-9);
}

fn orientation(rover: &SimRover, leg: usize) -> nalgebra::UnitQuaternion<f64> {
    let robot = rover.scene().robot();
    let posture = Posture::new(robot, rover.configuration());
    posture.wheel(robot, LegId(leg)).world_from_wheel.rotation
}

#[test]
fn no_joint_is_faster_than_its_speed_on_a_line() {
    let mut rover = on_plane();
    let center = wheel_center(&rover, 0) + Vector3::new(0.05, 0.15, 0.2);
    rover.command(command("line", Motion::WheelLine { leg: "leg1".into(), center }));
    let mut before = rover.configuration().legs[0];
    while rover.mode() == Mode::Executing {
        rover.advance(0.03);
        let now = rover.configuration().legs[0];
        assert!((now - before).amax() <= SPEED * 0.03 + 1e-9);
        before = now;
    }
    assert_eq!(last_detail(&rover.take_events(), "line"), "");
}

#[test]
fn the_length_of_ticks_does_not_change_what_comes_of_a_path() {
    let end = |tick: f64| {
        let mut rover = on_plane();
        let motion = path_by(&rover, 2, &[raise(0.25), raise(0.1)]);
        rover.command(command("a", motion));
        while rover.time_s() < 5.5 {
            rover.advance(tick);
        }
        (rover.configuration().clone(), rover.take_events())
    };
    let (coarse, coarse_events) = end(5.5);
    let (fine, fine_events) = end(0.01);
    assert!((coarse.legs[2] - fine.legs[2]).amax() < 1e-12);
    let at = |events: &[sim::Event]| events.last().map(|e| (e.stage, e.time_s)).unwrap();
    assert_eq!(at(&coarse_events).0, Stage::Completed);
    assert!((at(&coarse_events).1 - at(&fine_events).1).abs() < 1e-9);
}

#[test]
fn a_tick_that_is_no_time_changes_nothing() {
    let mut rover = on_plane();
    let before = rover.frame();
    for dt in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        rover.advance(dt);
    }
    assert_eq!(rover.frame(), before);
}

#[test]
fn goals_where_the_wheel_already_is_are_reached_at_once() {
    let mut rover = on_plane();
    let center: Point3<f64> = wheel_center(&rover, 5);
    rover.command(command("still", Motion::WheelLine { leg: "leg6".into(), center }));
    rover.advance(0.1);
    let events = rover.take_events();
    assert_eq!(stages(&events, "still").last(), Some(&Stage::Completed));
    assert!(events.last().unwrap().time_s < 1e-6);
}
