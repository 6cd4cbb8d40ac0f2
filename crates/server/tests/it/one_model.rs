//! One model of the compliant rover: rule, reachability, preload of steps, simulator and what is derived of telemetry
//! give the same loads and torques on the same stances.

use std::collections::BTreeMap;
use std::sync::Arc;

use collision::{Scene, survey, touchdowns};
use motion::{Outcome, StepRequest, Target, Unwatched, plan_step};
use nalgebra::{Point2, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reachability::{CellClass, Obstruction, ReachOptions, Reason, explain};
use rover::{Configuration, LegId, Payload, Posture, Robot};
use server::analyses::{Site, derive};
use sim::SimRover;
use stability::{StanceReport, assess};
use terrain::ElevationMap;
use wire::convert;
use wire::live::RoverTelemetry;

const MOON: f64 = 1.62;
const EARTH: f64 = 9.81;

fn scene(payload_kg: f64) -> Scene {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    )
    .unwrap();
    let (com, edges) = (Point3::new(0.0, 0.0, 0.25), Vector3::new(1.2, 1.2, 0.5));
    let payload = Payload::boxed("chassis", payload_kg, com, edges);
    let robot = Arc::new(robot.with_payloads(&[payload]).unwrap());
    Scene::new(robot, ElevationMap::plane(20.0, 0.25).unwrap(), &[]).unwrap()
}

/// The rover shifted, tilted and turned over feet that stand about where they do in the bent pose; `None` where
/// the wheels do not reach.
fn random_stance(scene: &Scene, rng: &mut ChaCha8Rng) -> Option<Configuration> {
    let robot = scene.robot();
    let mut stance = robot.pose("bent").unwrap();
    let low = |c: &Configuration| {
        Posture::new(robot, c).wheel(robot, LegId(0)).lowest_point(&Vector3::z_axis()).z
    };
    stance.world_from_base.translation.z = -low(&stance);
    let posture = Posture::new(robot, &stance);
    let mut off = |most: f64| rng.random_range(-most..most);
    let places: Vec<Point2<f64>> = robot
        .leg_ids()
        .map(|leg| {
            posture.wheel(robot, leg).center().xy() + nalgebra::Vector2::new(off(0.15), off(0.15))
        })
        .collect();
    let turn = UnitQuaternion::from_euler_angles(off(0.05), off(0.05), off(0.08));
    let shift = Translation3::new(off(0.12), off(0.12), off(0.06));
    stance.world_from_base = shift * stance.world_from_base * turn;
    let posture = Posture::new(robot, &stance);
    for (leg, p) in robot.leg_ids().zip(places) {
        let near = stance.legs[leg.0];
        stance.legs[leg.0] = touchdowns(scene, &posture, leg, p, &near, 1).ok()?.first()?.angles;
    }
    let posture = Posture::new(robot, &stance);
    let seen = survey(scene, &posture);
    let sound = seen.self_collision().is_none() && seen.terrain_collision().is_none();
    (sound && seen.standing.len() == 6).then_some(stance)
}

fn judged(scene: &Scene, at: &Configuration, gravity: f64, lifted: Option<LegId>) -> StanceReport {
    let posture = Posture::new(scene.robot(), at);
    let mut feet = survey(scene, &posture).contacts(scene, &posture);
    feet.retain(|(leg, _)| Some(*leg) != lifted);
    assess(scene.robot(), &posture, &feet, gravity)
}

/// What the ground derives of a frame of the simulated rover.
fn telemetry(robot: &Robot, frame: sim::Frame) -> RoverTelemetry {
    let vector = |v: &Vector3<f64>| [v.x, v.y, v.z];
    let legs = |of: &dyn Fn(LegId) -> [f64; 3]| convert::by_leg(robot, of);
    serde_json::from_value(serde_json::json!({
        "state": convert::rover_state(robot, &frame.configuration),
        "contacts": convert::by_leg(robot, |leg| frame.contacts[leg.0]),
        "contact_points_m": legs(&|leg| vector(&frame.contact_points[leg.0].coords)),
        "wheel_forces_n": legs(&|leg| vector(&frame.wheel_forces[leg.0])),
        "joint_torques_nm": BTreeMap::<String, Vec<f64>>::new(),
        "mode": "idle",
    }))
    .unwrap()
}

#[test]
fn rule_simulator_and_what_is_derived_of_telemetry_give_the_same_loads() {
    let scene = scene(300.0);
    let robot = scene.robot();
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    let (mut compared, mut uneven) = (0, 0.0_f64);
    while compared < 200 {
        let Some(at) = random_stance(&scene, &mut rng) else { continue };
        let Ok(rover) = SimRover::new(scene.clone(), at.clone(), MOON) else { continue };
        let report = judged(&scene, &at, MOON, None);
        let (weight, loads) = (robot.mass() * MOON, report.loads.clone().unwrap());
        let frame = rover.frame();
        for (force, load) in frame.wheel_forces.iter().zip(&loads.expected_n) {
            // Wheels stand as deep as rounding.
            assert!((force.z - load).abs() < 1e-4 * weight, "{} {load}", force.z);
        }
        let site = Site { gravity: MOON, friction: 0.7 };
        let forces = derive(robot, &site, &telemetry(robot, frame)).unwrap().forces.unwrap();
        let share = forces.load_share_n.unwrap();
        for (i, leg) in report.standing.iter().enumerate() {
            let expected = [loads.least_n[i], loads.expected_n[i], loads.most_n[i]];
            let derived = share[&robot.leg(*leg).name];
            let near = |(a, b): (f64, f64)| (a - b).abs() < 1e-6 * weight;
            assert!(derived.into_iter().zip(expected).all(near), "{derived:?} {expected:?}");
        }
        let worst = report.torque.worst.ratio.abs();
        assert!((forces.load_torque_ratio.unwrap() - worst).abs() < 1e-6, "{worst}");
        assert_eq!(forces.torque_safe, !report.torque.worst.is_overloaded());
        let most = loads.expected_n.iter().copied().fold(0.0, f64::max);
        uneven = uneven.max(most / weight);
        compared += 1;
    }
    assert!(uneven > 0.22, "all loads are about a sixth: {uneven}");
}

#[test]
fn steps_press_their_wheel_to_the_load_that_the_rule_tells() {
    let scene = scene(300.0);
    let robot = scene.robot();
    let mut rng = ChaCha8Rng::seed_from_u64(72);
    let mut compared = 0;
    while compared < 12 {
        let Some(at) = random_stance(&scene, &mut rng) else { continue };
        let leg = LegId(compared % 6);
        let p = Posture::new(robot, &at).wheel(robot, leg).center();
        let to = Point3::new(p.x + rng.random_range(-0.1..0.1), p.y + 0.1, 0.0);
        let request = StepRequest::new(leg, Target::Ground(to), 1.0);
        let answer = plan_step(&scene, &at, MOON, &request, &mut Unwatched);
        let (Outcome::Found, Some(load)) = (answer.outcome, answer.preload) else { continue };
        // Where the wheel just touches: before it is pressed in.
        let preload = answer.waypoints.iter().position(|w| w.phase == motion::Phase::Preload);
        let touch = &answer.waypoints[preload.unwrap() - 1];
        let shifted = answer.waypoints.iter().rev().find_map(|w| w.stance.clone()).unwrap_or(at);
        let down = shifted.with_leg(leg, touch.angles);
        let loads = judged(&scene, &down, MOON, None);
        let i = loads.standing.iter().position(|standing| *standing == leg).unwrap();
        let expected = loads.loads.unwrap().expected_n[i];
        assert!((load - expected).abs() < 1e-3 * expected, "{load} N, {expected} N");
        compared += 1;
    }
}

#[test]
fn reachability_refuses_for_torque_where_the_rule_does_and_names_the_same_joint() {
    let scene = scene(420.0);
    let robot = scene.robot();
    let mut rng = ChaCha8Rng::seed_from_u64(73);
    let options = ReachOptions { workers: 1, ..ReachOptions::default() };
    let (mut reachable, mut refused) = (0, 0);
    for case in 0..40 {
        let Some(at) = random_stance(&scene, &mut rng) else { continue };
        let leg = LegId(case % 6);
        let p = Posture::new(robot, &at).wheel(robot, leg).center().xy();
        let told = explain(&scene, &at, EARTH, leg, p, &options).unwrap();
        let Some(way) = told.way else { continue };
        let report = judged(&scene, &at.with_leg(leg, way.angles), EARTH, Some(leg));
        match (told.class, told.reason, told.obstruction) {
            (CellClass::Reachable, ..) => {
                assert!(!report.torque.worst.is_overloaded(), "case {case}");
                reachable += 1;
            }
            (_, Reason::Torque, Some(Obstruction::Torque { joint, ratio })) => {
                let worst = report.torque.worst;
                assert!((ratio - worst.ratio).abs() < 1e-9, "case {case}: {ratio} {worst:?}");
                let index = robot.leg(worst.leg).joints[worst.place];
                assert_eq!(joint, robot.joints()[index].name);
                refused += 1;
            }
            _ => {}
        }
    }
    assert!(reachable > 3 && refused > 3, "{reachable} reachable, {refused} refused for torque");
}
