//! Times of knots: kept where the joints can, refused where they go back.

use sim::{Mode, Motion, SimRover, Stage, TIME_MAX_S, WheelHold};

use crate::{command, joint_path, last_detail, on_plane, quickest, raise, shift_knots, stages};

/// Executes a motion; gives how long it took (s).
fn took(rover: &mut SimRover, motion: Motion) -> f64 {
    let start = rover.time_s();
    rover.command(command("x", motion));
    while rover.mode() == Mode::Executing {
        rover.advance(0.5);
    }
    let events = rover.take_events();
    assert_eq!(stages(&events, "x").last(), Some(&Stage::Completed), "{events:?}");
    events.last().unwrap().time_s - start
}

/// Leg 2 lifted by 0.1 rad, by 0.3 rad and back to 0.1 rad, at these times (s).
fn lift(rover: &SimRover, times: [f64; 4]) -> Motion {
    let here = rover.configuration().legs[1];
    let raised = [0.0, 0.1, 0.3, 0.1].map(|angle| here + raise(angle));
    joint_path("leg2", raised.into_iter().zip(times))
}

#[test]
fn a_piece_takes_the_time_between_its_knots() {
    let mut rover = on_plane();
    let motion = lift(&rover, [0.0, 4.0, 10.0, 13.5]);
    rover.command(command("a", motion));
    let start = rover.configuration().legs[1];
    for (until, raised) in [(4.0, 0.1), (10.0, 0.3), (13.5, 0.1)] {
        rover.advance(until - rover.time_s());
        let off = (rover.configuration().legs[1] - start - raise(raised)).amax();
        assert!(off < 1e-9, "{off} rad off at {until} s");
    }
    assert_eq!(rover.mode(), Mode::Idle);
}

#[test]
fn equal_times_are_as_fast_as_the_joints_and_no_time_is_too_short_for_them() {
    // On the way up the middle knot is passed at speed; at the top it stops.
    let quick = quickest(0.3) + quickest(0.2);
    for times in [[0.0; 4], [0.0, 0.5, 0.5, 1.0], [7.0, 7.0, 7.0, 7.0]] {
        let mut rover = on_plane();
        let motion = lift(&rover, times);
        let took = took(&mut rover, motion);
        let expected = quick + times[0];
        assert!((took - expected).abs() < 0.11, "{took} s, expected {expected} s");
    }
}

#[test]
fn a_shift_keeps_its_times_too() {
    let mut rover = on_plane();
    let by = nalgebra::Isometry3::translation(0.03, 0.0, 0.0);
    let knots = shift_knots(&rover, &by, 2, 6.0);
    let took = took(&mut rover, Motion::BodyPath { knots, hold: WheelHold::Brakes });
    assert!((took - 12.0).abs() < 1e-6, "{took} s");
}

#[test]
fn times_that_are_none_are_refused_by_name() {
    let table = [
        ([0.0, 2.0, 1.5, 3.0], "knot 2 is timed at 1.5 s, before the 2 s of the one before"),
        ([0.0, -1.0, 0.0, 0.0], "knot 1 is timed at -1 s; 0 to 86400 s are allowed"),
        ([0.0, 1.0, 1.0, TIME_MAX_S + 1.0], "knot 3 is timed at 86401 s; 0 to 86400 s are allowed"),
        ([0.0, f64::NAN, 1.0, 1.0], "the time of knot 1 is not finite"),
    ];
    for (times, expected) in table {
        let mut rover = on_plane();
        let motion = lift(&rover, times);
        rover.command(command("x", motion));
        assert_eq!(last_detail(&rover.take_events(), "x"), expected);
        let by = nalgebra::Isometry3::translation(0.03, 0.0, 0.0);
        let mut knots = shift_knots(&rover, &by, 3, 0.0);
        for (knot, time_s) in knots.iter_mut().zip(times) {
            knot.time_s = time_s;
        }
        rover.command(command("y", Motion::BodyPath { knots, hold: WheelHold::Brakes }));
        assert_eq!(last_detail(&rover.take_events(), "y"), expected);
        assert_eq!(rover.mode(), Mode::Idle);
    }
}
