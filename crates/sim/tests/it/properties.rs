//! Seeded commands of all kinds on rough ground: what holds whatever is commanded.

use nalgebra::{Point2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegAngles, Posture};
use sim::{Mode, Motion, SettleOptions, SimRover, Stage, settle};
use stability::support_polygon;
use terrain::synthetic::{Recipe, generate};

use crate::{GRAVITY, athlete, command, gap, joint_path, scene, stages, wheel_center};

fn small_rover(seed: u64) -> SimRover {
    let recipe =
        Recipe { width_m: 10.0, height_m: 10.0, flat_center_m: 0.0, ..Recipe::boulder_field() };
    let scene = scene(athlete().scaled(1.0 / 3.0).unwrap(), generate(&recipe, seed).unwrap());
    let options = SettleOptions::default();
    let settled = settle(&scene, Point2::origin(), 0.3, "bent", &options).unwrap();
    SimRover::new(scene, settled.configuration, GRAVITY).unwrap()
}

fn random_motion(rng: &mut ChaCha8Rng, rover: &SimRover) -> Motion {
    let leg = rng.random_range(0..6);
    let name = format!("leg{}", leg + 1);
    match rng.random_range(0..10) {
        0 => Motion::Stop,
        1..4 => {
            let mut offset = Vector3::from_fn(|_, _| rng.random_range(-0.15..0.15));
            offset.z += 0.03;
            Motion::WheelLine { leg: name, center: wheel_center(rover, leg) + offset }
        }
        _ => {
            let mut knots = vec![rover.configuration().legs[leg]];
            for _ in 0..rng.random_range(1..4) {
                let mut step = LegAngles::from_fn(|_, _| rng.random_range(-0.3..0.3));
                step[1] -= 0.2;
                knots.push(knots[knots.len() - 1] + step);
            }
            joint_path(&name, knots.into_iter().map(|angles| (angles, 0.0)))
        }
    }
}

/// Whatever was commanded, this holds.
fn check_rover(rover: &SimRover, base: &nalgebra::Isometry3<f64>) {
    let robot = rover.scene().robot();
    let frame = rover.frame();
    assert_eq!(&frame.configuration.world_from_base, base);
    let tolerance = robot.stance().ground_tolerance;
    for leg in robot.leg_ids() {
        let gap = gap(rover.scene(), &frame.configuration, leg.0);
        assert!(gap >= -tolerance - 1e-9, "leg {} is {gap} m in the ground", leg.0);
        assert_eq!(frame.contacts[leg.0], gap <= tolerance);
    }
    let posture = Posture::new(robot, &frame.configuration);
    let standing = frame.contact_points.iter().zip(&frame.contacts);
    let contacts: Vec<_> = standing.filter(|(_, c)| **c).map(|(p, _)| *p).collect();
    let depth =
        support_polygon::regular(&contacts).unwrap().depth_of(posture.center_of_mass(robot).xy());
    assert!(depth >= 0.0, "the center of mass is {depth} m inside");
    let sum: f64 = frame.wheel_forces.iter().map(|f| f.z).sum();
    let weight = robot.mass() * GRAVITY;
    assert!((sum - weight).abs() < 1e-6 * weight);
    assert!(frame.wheel_forces.iter().all(|f| f.z >= 0.0));
    assert_eq!(frame.executing.is_some(), frame.mode == Mode::Executing);
    assert_eq!(frame.fault.is_some(), frame.mode == Mode::Fault);
}

#[test]
fn no_command_tips_the_rover_or_drives_a_wheel_into_the_ground() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut ends = std::collections::BTreeMap::new();
    for seed in 0..4 {
        let mut rover = small_rover(seed);
        let base = rover.configuration().world_from_base;
        let mut events = Vec::new();
        for i in 0..120 {
            let motion = random_motion(&mut rng, &rover);
            rover.command(command(&format!("{i}"), motion));
            for _ in 0..rng.random_range(1..30) {
                let before = rover.configuration().clone();
                let dt = rng.random_range(0.01..0.6);
                rover.advance(dt);
                for (a, b) in before.legs.iter().zip(&rover.configuration().legs) {
                    assert!((a - b).amax() <= 0.1 * dt + 1e-9, "faster than the joints' speed");
                }
            }
            check_rover(&rover, &base);
            if rover.mode() == Mode::Fault {
                rover.release(&format!("release {i}"));
            }
            events.extend(rover.take_events());
        }
        rover.estop("end");
        events.extend(rover.take_events());
        assert!(events.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s));
        for i in 0..120 {
            let told = stages(&events, &format!("{i}"));
            let last = *told.last().unwrap();
            let ended = [Stage::Rejected, Stage::Completed, Stage::Failed, Stage::Aborted];
            assert!(ended.contains(&last), "{told:?}");
            assert_eq!(told.iter().filter(|stage| ended.contains(stage)).count(), 1, "{told:?}");
            *ends.entry(format!("{last:?}")).or_insert(0) += 1;
        }
    }
    // Each way to end is there, so that the above says something.
    assert!(ends.len() == 4 && ends.values().all(|n| *n >= 10), "{ends:?}");
}
