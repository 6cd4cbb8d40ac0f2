//! What viewers draw, read as they read it: by the descriptors that travel with the messages.

use std::collections::BTreeMap;

use prost_reflect::{DescriptorPool, DynamicMessage, ReflectMessage, Value};
use rover::Robot;
use wire::convert;
use wire::foxglove::{self, DESCRIPTORS, FORCES, JOINTS, STANCE, TRANSFORMS, Topic};
use wire::live::{PolygonAnswer, RegionKind, RoverMode, RoverTelemetry, StabilityDerived};
use wire::time::Timestamp;

/// 2026-11-23T12:00:00.000000007Z.
const TIME: Timestamp = Timestamp(1_795_435_200_000_000_007);

fn athlete() -> Robot {
    let text = |file: &str| testkit::fixture_text(&format!("robots/athlete/{file}"));
    Robot::from_folder(&text("robot.toml"), |file| Some(text(file)), |_| None).unwrap()
}

/// The standing pose: base 1.968 m above level ground, all wheels down (planning notes, section 1).
fn standing(robot: &Robot) -> RoverTelemetry {
    let mut configuration = robot.pose("standing").unwrap();
    configuration.world_from_base.translation.vector.z = 1.968;
    let legs = || robot.legs().iter().map(|leg| leg.name.clone());
    RoverTelemetry {
        state: convert::rover_state(robot, &configuration),
        contacts: legs().map(|leg| (leg, true)).collect(),
        contact_points_m: legs().map(|leg| (leg, [2.0, 1.0, 0.0])).collect(),
        wheel_forces_n: legs().map(|leg| (leg, [0.0, 3.0, 4.0])).collect(),
        joint_torques_nm: legs().map(|leg| (leg, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).collect(),
        mode: RoverMode::Idle,
        executing: None,
        fault: None,
        operation: None,
    }
}

fn read(topic: Topic, bytes: &[u8]) -> DynamicMessage {
    let pool = DescriptorPool::decode(DESCRIPTORS).unwrap();
    let descriptor = pool.get_message_by_name(topic.schema_name).unwrap();
    let message = DynamicMessage::decode(descriptor, bytes).unwrap();
    assert_eq!(message.unknown_fields().count(), 0);
    message
}

fn number(message: &DynamicMessage, path: &[&str]) -> f64 {
    match field(message, path) {
        Value::F64(number) => number,
        other => panic!("{path:?} is {other:?}"),
    }
}

fn text(message: &DynamicMessage, name: &str) -> String {
    message.get_field_by_name(name).unwrap().as_str().unwrap().to_owned()
}

fn field(message: &DynamicMessage, path: &[&str]) -> Value {
    let value = message.get_field_by_name(path[0]).unwrap().into_owned();
    match path {
        [_] => value,
        [_, rest @ ..] => field(value.as_message().unwrap(), rest),
        [] => unreachable!(),
    }
}

fn list(message: &DynamicMessage, name: &str) -> Vec<DynamicMessage> {
    let value = message.get_field_by_name(name).unwrap();
    value.as_list().unwrap().iter().map(|item| item.as_message().unwrap().clone()).collect()
}

#[test]
fn every_link_has_its_pose_in_the_world() {
    let robot = athlete();
    let bytes = foxglove::transforms(&robot, &standing(&robot), TIME).unwrap();
    let transforms = list(&read(TRANSFORMS, &bytes), "transforms");
    assert_eq!(transforms.len(), robot.links().len());
    let by_name: BTreeMap<String, &DynamicMessage> =
        transforms.iter().map(|transform| (text(transform, "child_frame_id"), transform)).collect();
    assert!(transforms.iter().all(|transform| text(transform, "parent_frame_id") == "world"));
    let base = &robot.links()[0].name;
    assert_eq!(number(by_name[base], &["translation", "z"]), 1.968);
    for leg in robot.legs() {
        // The wheels of a rover that stands are their radius above the ground; the notes round.
        let wheel = by_name[&robot.links()[leg.wheel_link.0].name];
        let z = number(wheel, &["translation", "z"]);
        assert!((z - leg.wheel.radius).abs() < 2e-3, "{z}");
    }
    let stamp = field(&transforms[0], &["timestamp"]);
    let stamp = stamp.as_message().unwrap();
    assert_eq!(field(stamp, &["seconds"]), Value::I64(1_795_435_200));
    assert_eq!(field(stamp, &["nanos"]), Value::I32(7));
}

#[test]
fn joints_come_by_their_names_with_angle_and_torque() {
    let robot = athlete();
    let bytes = foxglove::joints(&robot, &standing(&robot), TIME);
    let joints = &list(&read(JOINTS, &bytes), "joints")[0];
    let names = field(joints, &["name"]);
    assert_eq!(names.as_list().unwrap().len(), 36);
    let efforts = field(joints, &["effort"]);
    assert_eq!(efforts.as_list().unwrap()[8], Value::F64(3.0));
    let first = robot.joints()[robot.legs()[0].joints[0]].name.clone();
    assert_eq!(names.as_list().unwrap()[0], Value::String(first));
}

#[test]
fn forces_are_arrows_that_point_where_the_force_does() {
    let robot = athlete();
    let bytes = foxglove::forces(&robot, &standing(&robot), TIME);
    let entities = list(&read(FORCES, &bytes), "entities");
    let arrows = list(&entities[0], "arrows");
    assert_eq!(arrows.len(), 6);
    for arrow in arrows {
        // A force of (0, 3, 4) N where each foot bears 4 N: 0.6 m for 4 N.
        let length = number(&arrow, &["shaft_length"]) + number(&arrow, &["head_length"]);
        assert!((length - 0.75).abs() < 1e-12);
        let part = |name| number(&arrow, &["pose", "orientation", name]);
        let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
            part("w"),
            part("x"),
            part("y"),
            part("z"),
        ));
        let direction = turn * nalgebra::Vector3::x();
        assert!((direction - nalgebra::Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-12);
    }
}

#[test]
fn the_stance_is_drawn_just_above_the_ground() {
    let robot = athlete();
    let frame = standing(&robot);
    let regular = PolygonAnswer {
        polygon_m: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
        area_m2: 0.5,
        margin_m: 0.1,
        critical_edge_m: None,
        critical: None,
    };
    let derived = StabilityDerived {
        com_m: [0.2, 0.3, 1.9],
        regular: Some(regular),
        conservative: None,
        conservative_kind: RegionKind::Empty,
        settlement_margin_m: None,
        settlement_leg: None,
        torque_ratio: 0.0,
        torque_joint: String::new(),
        torque_ratios: BTreeMap::new(),
        forces: None,
    };
    let bytes = foxglove::stance(&derived, foxglove::ground_height(&frame), TIME);
    let entities = list(&read(STANCE, &bytes), "entities");
    let lines = list(&entities[0], "lines");
    assert_eq!(lines.len(), 2);
    let corners = list(&lines[0], "points");
    assert_eq!(number(&corners[1], &["x"]), 1.0);
    assert!(corners.iter().all(|corner| (number(corner, &["z"]) - 0.02).abs() < 1e-12));
    assert_eq!(lines[0].descriptor().full_name(), "foxglove.LinePrimitive");
    let com = &list(&entities[0], "spheres")[0];
    assert_eq!(number(com, &["pose", "position", "z"]), 1.9);
}

#[test]
fn a_frame_of_another_robot_is_refused_by_the_field_that_tells() {
    let robot = athlete();
    let mut frame = standing(&robot);
    frame.state.joints_rad.remove("leg3");
    let refused = foxglove::transforms(&robot, &frame, TIME).unwrap_err();
    assert!(refused.to_string().contains("leg3"), "{refused}");
}
