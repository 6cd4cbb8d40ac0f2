//! The simulated rover behind the adapter: frames, acks and times on board.

use std::sync::Arc;

use bridge::adapter::RoverAdapter;
use bridge::sim_adapter::SimAdapter;
use sim::{SettleOptions, SimRover, settle};
use wire::live::{AckStage, CommandBody, Downlink, JointKnot, RoverMode, RoverTelemetry, Uplink};
use wire::time::Timestamp;

use crate::support::{START, after};

fn adapter() -> SimAdapter {
    let folder = "robots/athlete/";
    let robot = rover::Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    let map = terrain::ElevationMap::plane(20.0, 0.5).unwrap();
    let scene = collision::Scene::new(Arc::new(robot.unwrap()), map, &[]).unwrap();
    let middle = nalgebra::Point2::origin();
    let settled = settle(&scene, middle, 0.0, "bent", &SettleOptions::default()).unwrap();
    let rover = SimRover::new(scene, settled.configuration, 1.62).unwrap();
    SimAdapter::new(START, rover)
}

fn frames(said: &[(Timestamp, Downlink)]) -> Vec<(Timestamp, &RoverTelemetry)> {
    said.iter()
        .filter_map(|(t, d)| match d {
            Downlink::Telemetry(frame) => Some((*t, frame)),
            Downlink::Ack { .. } => None,
        })
        .collect()
}

fn acks(said: &[(Timestamp, Downlink)]) -> Vec<(AckStage, f64)> {
    said.iter()
        .filter_map(|(t, d)| match d {
            Downlink::Ack { stage, .. } => Some((*stage, t.seconds_since(START))),
            Downlink::Telemetry(_) => None,
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
    // 0.05 rad at the robot's 0.1 rad/s.
    let said = adapter.advance(after(3.0));
    let told = acks(&said);
    let stages: Vec<AckStage> = told.iter().map(|(stage, _)| *stage).collect();
    assert_eq!(stages, [AckStage::Received, AckStage::Started, AckStage::Completed]);
    assert!((told[1].1 - 1.0).abs() < 1e-6 && (told[2].1 - 1.5).abs() < 1e-6, "{told:?}");
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
