//! The simulated rover behind the adapter: frames, acks and times on board.

use std::sync::Arc;

use bridge::adapter::RoverAdapter;
use bridge::sim_adapter::SimAdapter;
use nalgebra::{Isometry3, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use sim::{SettleOptions, SimRover, settle};
use wire::check::At;
use wire::convert;
use wire::live::{
    AckStage, BodyKnot, CommandBody, Downlink, JointKnot, RoverMode, RoverTelemetry, Uplink,
};
use wire::time::Timestamp;

use crate::support::{START, after};

pub fn athlete() -> Robot {
    let folder = "robots/athlete/";
    Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    )
    .unwrap()
}

pub fn adapter() -> SimAdapter {
    let map = terrain::ElevationMap::plane(20.0, 0.5).unwrap();
    let scene = collision::Scene::new(Arc::new(athlete()), map, &[]).unwrap();
    let middle = nalgebra::Point2::origin();
    let settled = settle(&scene, middle, 0.0, "bent", &SettleOptions::default()).unwrap();
    let rover = SimRover::new(scene, settled.configuration, 1.62).unwrap();
    SimAdapter::new(START, rover)
}

fn frames(said: &[(Timestamp, Downlink)]) -> Vec<(Timestamp, &RoverTelemetry)> {
    said.iter()
        .filter_map(|(t, d)| match d {
            Downlink::Telemetry(frame) => Some((*t, frame)),
            Downlink::Ack { .. } | Downlink::Image(_) => None,
        })
        .collect()
}

fn acks(said: &[(Timestamp, Downlink)]) -> Vec<(AckStage, f64)> {
    said.iter()
        .filter_map(|(t, d)| match d {
            Downlink::Ack { stage, .. } => Some((*stage, t.seconds_since(START))),
            Downlink::Telemetry(_) | Downlink::Image(_) => None,
        })
        .collect()
}

/// Turns leg 1's hip by `turn` (rad) from where it is.
fn hip_motion(at: &RoverTelemetry, turn: f64) -> Uplink {
    let from = at.state.joints_rad["leg1"].clone();
    let mut to = from.clone();
    to[1] -= turn; // up
    let knot = |joints_rad: Vec<f64>, time_s| JointKnot { joints_rad, time_s };
    Uplink::Command {
        id: "lift".into(),
        body: CommandBody::JointPath {
            leg: "leg1".into(),
            knots: vec![knot(from, 0.0), knot(to, 1.0)],
        },
        basis_joints_rad: at.state.joints_rad.clone(),
        basis_tolerance_rad: 0.001,
        model_hash: None,
        epoch: None,
        preconditions: Vec::new(),
    }
}

#[test]
fn frames_come_ten_times_a_second_on_board_time() {
    let said = adapter().advance(after(2.0));
    let times: Vec<f64> = frames(&said).iter().map(|(t, _)| t.seconds_since(START)).collect();
    assert_eq!(times.len(), 21);
    for (i, t) in times.iter().enumerate() {
        assert!((t - 0.1 * i as f64).abs() < 1e-6, "{t}");
    }
}

#[test]
fn a_motion_takes_the_time_of_its_joint_and_is_told() {
    let mut adapter = adapter();
    let first = adapter.advance(after(0.0));
    let motion = hip_motion(frames(&first)[0].1, 0.05);
    adapter.uplink(after(1.0), motion);
    // 0.05 rad in the second that the path gives it; the joint could be twice as fast.
    let said = adapter.advance(after(3.0));
    let told = acks(&said);
    let stages: Vec<AckStage> = told.iter().map(|(stage, _)| *stage).collect();
    assert_eq!(stages, [AckStage::Received, AckStage::Started, AckStage::Completed]);
    assert!((told[1].1 - 1.0).abs() < 1e-6 && (told[2].1 - 2.0).abs() < 1e-6, "{told:?}");
    let last = frames(&said).last().unwrap().1.clone();
    assert_eq!(last.mode, RoverMode::Idle);
    assert!(!last.contacts["leg1"] && last.contacts["leg2"]);
    assert_eq!(last.wheel_forces_n["leg1"], [0.0; 3]);
}

#[test]
fn an_estop_ends_a_motion_and_refuses_the_next() {
    let mut adapter = adapter();
    let first = adapter.advance(after(0.0));
    let motion = hip_motion(frames(&first)[0].1, 0.5);
    adapter.uplink(after(1.0), motion.clone());
    adapter.uplink(after(2.0), Uplink::Estop { id: "stop".into() });
    let Uplink::Command { body, .. } = motion else { panic!() };
    let next = Uplink::Command {
        id: "next".into(),
        body,
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        epoch: None,
        preconditions: Vec::new(),
    };
    adapter.uplink(after(2.5), next);
    let said = adapter.advance(after(3.0));
    let stages: Vec<AckStage> = acks(&said).iter().map(|(stage, _)| *stage).collect();
    assert!(stages.contains(&AckStage::Aborted), "{stages:?}");
    assert_eq!(stages.last(), Some(&AckStage::Rejected));
    assert_eq!(frames(&said).last().unwrap().1.mode, RoverMode::Stopped);
}

#[test]
fn after_a_long_pause_only_its_end_is_told() {
    let mut adapter = adapter();
    let said = adapter.advance(after(7200.0));
    let n = frames(&said).len();
    assert!((290..=310).contains(&n), "{n} frames after two hours");
}

fn configuration(robot: &Robot, frame: &RoverTelemetry) -> Configuration {
    convert::configuration(&At::root("state"), robot, &frame.state).unwrap()
}

fn wheels(robot: &Robot, configuration: &Configuration) -> Vec<Isometry3<f64>> {
    let posture = Posture::new(robot, configuration);
    robot.leg_ids().map(|leg| posture.wheel(robot, leg).world_from_wheel).collect()
}

/// A shift by `by` (m, in the base's frame) in 4 pieces and 12 s, by closed-form inverse kinematics.
fn shift(robot: &Robot, frame: &RoverTelemetry, by: Vector3<f64>) -> Uplink {
    let start = configuration(robot, frame);
    let stood = wheels(robot, &start);
    let knot = |i: u32| {
        let share = f64::from(i) / 4.0;
        let world_from_base =
            start.world_from_base * Isometry3::from_parts((by * share).into(), Default::default());
        let there =
            Posture::new(robot, &Configuration { world_from_base, legs: start.legs.clone() });
        let joints_rad = convert::by_leg(robot, |leg: LegId| {
            let all = there.inverse_kinematics(robot, leg, &stood[leg.0]).unwrap();
            let change = |a: &LegAngles| (a - start.legs[leg.0]).amax();
            let angles = all.iter().map(|s| s.angles);
            let nearest = angles.min_by(|a, b| change(a).total_cmp(&change(b))).unwrap();
            nearest.iter().copied().collect()
        });
        BodyKnot { joints_rad, time_s: 3.0 * f64::from(i) }
    };
    Uplink::Command {
        id: "shift".into(),
        body: CommandBody::BodyPath { knots: (0..=4).map(knot).collect(), drive_hold: false },
        basis_joints_rad: frame.state.joints_rad.clone(),
        basis_tolerance_rad: 0.001,
        model_hash: None,
        epoch: None,
        preconditions: Vec::new(),
    }
}

#[test]
fn a_shift_goes_up_as_json_and_comes_down_as_a_base_that_moves_over_wheels_that_stand() {
    let (robot, mut adapter) = (athlete(), adapter());
    let said = adapter.advance(after(0.0));
    let first = frames(&said)[0].1.clone();
    let by = Vector3::new(0.08, -0.06, 0.0);
    let json = serde_json::to_string(&shift(&robot, &first, by)).unwrap();
    assert!(json.contains(r#""body":{"type":"body_path","knots":[{"joints_rad":{"leg1":["#));
    let uplink: Uplink = serde_json::from_str(&json).unwrap();
    adapter.uplink(after(1.0), uplink);
    let said = adapter.advance(after(15.0));
    let told = acks(&said);
    let stages: Vec<AckStage> = told.iter().map(|(stage, _)| *stage).collect();
    assert_eq!(stages, [AckStage::Received, AckStage::Started, AckStage::Completed]);
    assert!((told[2].1 - 13.0).abs() < 1e-6, "{told:?}");
    let start = configuration(&robot, &first);
    let stood = wheels(&robot, &start);
    let mut way = 0.0;
    for (_, frame) in frames(&said) {
        let now = configuration(&robot, frame);
        for (wheel, stood) in wheels(&robot, &now).iter().zip(&stood) {
            let off = (wheel.translation.vector - stood.translation.vector).norm();
            assert!(off < 0.002, "{off} m");
        }
        assert!(frame.contacts.values().all(|stands| *stands));
        let moved = start.world_from_base.inverse() * now.world_from_base;
        assert!(moved.translation.vector.norm() >= way - 1e-9);
        way = moved.translation.vector.norm();
    }
    assert!((way - 0.1).abs() < 1e-6, "{way} m");
    assert_eq!(frames(&said).last().unwrap().1.mode, RoverMode::Idle);
}

#[test]
fn an_estop_in_the_midst_of_a_shift_leaves_all_wheels_standing() {
    let (robot, mut adapter) = (athlete(), adapter());
    let said = adapter.advance(after(0.0));
    let first = frames(&said)[0].1.clone();
    adapter.uplink(after(1.0), shift(&robot, &first, Vector3::new(0.1, 0.0, 0.0)));
    adapter.uplink(after(6.0), Uplink::Estop { id: "stop".into() });
    let said = adapter.advance(after(8.0));
    let stages: Vec<AckStage> = acks(&said).iter().map(|(stage, _)| *stage).collect();
    assert!(stages.contains(&AckStage::Aborted), "{stages:?}");
    let all = frames(&said);
    let (halted, last) = (all[all.len() - 15].1, all[all.len() - 1].1);
    assert_eq!((last.mode, &last.state), (RoverMode::Stopped, &halted.state));
    assert!(last.contacts.values().all(|stands| *stands));
    let moved = last.state.base.position_m[0] - first.state.base.position_m[0];
    assert!(moved > 0.02 && moved < 0.08, "{moved} m");
}

#[test]
fn a_knot_that_lacks_a_joint_is_refused() {
    let (robot, mut adapter) = (athlete(), adapter());
    let said = adapter.advance(after(0.0));
    let uplink = shift(&robot, frames(&said)[0].1, Vector3::x() * 0.05);
    let Uplink::Command { body: CommandBody::BodyPath { mut knots, .. }, .. } = uplink else {
        panic!()
    };
    knots[2].joints_rad.get_mut("leg3").unwrap().pop();
    let command = Uplink::Command {
        id: "short".into(),
        body: CommandBody::BodyPath { knots, drive_hold: false },
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        epoch: None,
        preconditions: Vec::new(),
    };
    adapter.uplink(after(1.0), command);
    let said = adapter.advance(after(1.0));
    let refused = said.iter().find_map(|(_, message)| match message {
        Downlink::Ack { stage: AckStage::Rejected, detail, .. } => detail.clone(),
        _ => None,
    });
    assert_eq!(
        refused.unwrap(),
        "knot 2: leg3 has 5 joint angles; as many as it has joints are wanted: 6"
    );
}
