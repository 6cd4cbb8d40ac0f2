//! C5: the ground falls silent at any instant; the rover ends in a stance with its margin, and holds.

use nalgebra::{Isometry3, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::LegAngles;
use sim::{BodyKnot, Mode, Motion, SimRover, Stage, WheelHold};
use stability::support_polygon;

use crate::{command, last_detail, on_plane, path_by, raise, run, shifted, stages, wheel_center};

const SILENCE_S: f64 = 1.0;

/// The margin of the standing wheels (m), from what the rover reports.
fn margin(rover: &SimRover) -> f64 {
    let frame = rover.frame();
    let robot = rover.scene().robot();
    let standing = frame.contacts.iter().zip(&frame.contact_points);
    let contacts: Vec<_> = standing.filter(|(stands, _)| **stands).map(|(_, at)| *at).collect();
    let com = rover::Posture::new(robot, &frame.configuration).center_of_mass(robot);
    support_polygon::regular(&contacts).unwrap().depth_of(com.xy())
}

/// The body over its wheels, by `by` (m) in its own frame.
fn sway(rover: &SimRover, by: Vector2<f64>) -> Motion {
    let (robot, here) = (rover.scene().robot(), rover.configuration());
    let to = shifted(robot, here, &Isometry3::translation(by.x, by.y, 0.0));
    let knot = |legs: &[rover::LegAngles]| BodyKnot {
        legs: robot.leg_ids().map(|leg| (robot.leg(leg).name.clone(), legs[leg.0])).collect(),
        time_s: 0.0,
    };
    let knots = vec![knot(&here.legs), knot(&to)];
    Motion::BodyPath { knots, hold: WheelHold::Brakes }
}

#[test]
fn c5_silence_at_any_instant_ends_in_a_stable_hold() {
    let n = 1000;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut instants: Vec<f64> = (0..n).map(|_| rng.random_range(0.0..100.0)).collect();
    instants.sort_by(f64::total_cmp);
    let mut rover = on_plane();
    rover.set_silence_max(Some(SILENCE_S));
    let limit = rover.scene().robot().stance().margin;
    let (mut cut_in_motion, mut walked) = (0, rover.clone());
    let mut number = 0;
    for instant in instants {
        // One walk, cut at each instant in a copy of the rover. Commands continue their numbers.
        while walked.time_s() < instant {
            if walked.mode() == Mode::Idle {
                let leg = (number / 2) % 6;
                let motion = match number % 14 {
                    12 => sway(&walked, Vector2::new(0.05, 0.0)),
                    13 => sway(&walked, Vector2::new(-0.05, 0.0)),
                    n if n % 2 == 0 => path_by(&walked, leg, &[raise(0.3)]),
                    _ => path_by(&walked, leg, &[-raise(0.3)]),
                };
                walked.command(command(&format!("c{number}"), motion));
                number += 1;
                let events = walked.take_events();
                assert!(events.iter().all(|e| e.stage != Stage::Rejected), "{events:?}");
            }
            walked.heard_ground();
            walked.advance(0.1_f64.min(instant - walked.time_s()).max(1e-9));
        }
        let mut cut = walked.clone();
        cut.heard_ground();
        let silent_from = cut.time_s();
        let moving = cut.mode() == Mode::Executing;
        run(&mut cut, SILENCE_S - 0.2);
        assert_ne!(cut.mode(), Mode::Fault, "not before its time");
        run(&mut cut, 20.0);
        let hold = cut.configuration().clone();
        assert!(margin(&cut) >= limit - 1e-9, "cut at {silent_from} s: {} m", margin(&cut));
        let stopped = cut.mode() == Mode::Fault;
        cut_in_motion += usize::from(moving && stopped);
        if stopped {
            let fault = cut.frame().fault.unwrap();
            assert!(fault.contains("nothing was heard from the ground"), "{fault}");
        } else {
            assert_eq!(cut.mode(), Mode::Idle, "it had come to its end before");
        }
        run(&mut cut, 5.0);
        assert_eq!(*cut.configuration(), hold, "it holds");
        // And takes nothing until it is cleared.
        let next = path_by(&cut, 0, &[raise(0.05)]);
        cut.heard_ground();
        cut.command(command("next", next));
        let told = cut.take_events();
        if stopped {
            assert_eq!(stages(&told, "next"), [Stage::Received, Stage::Rejected]);
            let detail = last_detail(&told, "next");
            assert!(detail.contains("release the stop first"), "{detail}");
            cut.release("clear");
            assert_eq!(cut.mode(), Mode::Idle);
        }
    }
    assert!(cut_in_motion > n / 10, "{cut_in_motion} of {n} were cut in motion");
}

#[test]
fn a_rover_without_margin_moves_on_until_it_has_some() {
    let mut rover = on_plane();
    let limit = rover.scene().robot().stance().margin;
    // With legs 1 and 2 up the others hold the center of mass by a hand's breadth, once the body has
    // gone away from these two.
    let base = rover.configuration().world_from_base.translation.vector.xy();
    let both = (wheel_center(&rover, 0).coords + wheel_center(&rover, 1).coords).xy() / 2.0;
    let away = sway(&rover, (base - both).normalize() * 0.1);
    rover.command(command("away", away));
    run(&mut rover, 10.0);
    rover.command(command("leg 2 up", path_by(&rover, 1, &[raise(0.2)])));
    run(&mut rover, 10.0);
    let told = rover.take_events();
    assert!(told.iter().all(|event| event.stage != Stage::Rejected), "{told:?}");
    assert!(margin(&rover) >= limit);

    rover.set_silence_max(Some(1.2));
    rover.heard_ground();
    let motion = path_by(&rover, 0, &[raise(0.2), LegAngles::zeros()]);
    rover.command(command("up and down", motion));
    run(&mut rover, 2.0);
    assert_eq!(stages(&rover.take_events(), "up and down"), [Stage::Received, Stage::Started]);
    assert!(margin(&rover) < limit, "{} m is no case for this test", margin(&rover));
    assert_eq!(rover.mode(), Mode::Executing, "no freeze without margin");
    run(&mut rover, 30.0);
    assert!(margin(&rover) >= limit, "down again: {}", margin(&rover));
    let told = rover.take_events();
    let ends = [Stage::Aborted, Stage::Completed];
    assert!(ends.contains(stages(&told, "up and down").last().unwrap()));
}
