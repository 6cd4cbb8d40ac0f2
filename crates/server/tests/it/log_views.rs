//! What the log has for stock viewers, and what that costs: a rover that shifts its body all the time,
//! the worst case, for nothing of one frame stands in the next.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use bridge::adapter::RoverAdapter;
use bridge::catalog;
use bridge::reader::Limits;
use bridge::recorder::{Record, Recorder, RecorderOptions};
use bridge::replay::Replay;
use bridge::sim_adapter::SimAdapter;
use bridge::views::{self, VIEWS_HZ, Views};
use nalgebra::{Isometry3, Point2, Vector3};
use prost::Message as _;
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use server::analyses::{Site, derive};
use testkit::note_skipped;
use wire::check::At;
use wire::convert;
use wire::foxglove::DESCRIPTORS;
use wire::foxglove::schema::{FrameTransforms, JointStates, SceneUpdate};
use wire::live::{BodyKnot, CommandBody, Downlink, RoverTelemetry, Uplink, channel};
use wire::time::Timestamp;

use crate::support::TempDir;

const START: Timestamp = Timestamp(1_790_000_000_000_000_000);
/// A shift takes so long (s).
const SHIFT_S: f64 = 6.0;

fn athlete() -> Robot {
    let folder = "robots/athlete/";
    let text = |file: &str| testkit::fixture_text(&format!("{folder}{file}"));
    Robot::from_folder(&text("robot.toml"), |file| Some(text(file)), |_| None).unwrap()
}

fn shift(robot: &Robot, number: usize, frame: &RoverTelemetry, by: Vector3<f64>) -> Uplink {
    let start = convert::configuration(&At::root("state"), robot, &frame.state).unwrap();
    let stood = Posture::new(robot, &start);
    let knot = |i: u32| {
        let part = Isometry3::from_parts((by * f64::from(i) / 4.0).into(), Default::default());
        let world_from_base = start.world_from_base * part;
        let there = Configuration { world_from_base, legs: start.legs.clone() };
        let there = Posture::new(robot, &there);
        let joints_rad = convert::by_leg(robot, |leg: LegId| {
            let wheel = stood.wheel(robot, leg).world_from_wheel;
            let all = there.inverse_kinematics(robot, leg, &wheel).unwrap();
            let change = |a: &LegAngles| (a - start.legs[leg.0]).amax();
            let angles = all.iter().map(|s| s.angles);
            let nearest = angles.min_by(|a, b| change(a).total_cmp(&change(b))).unwrap();
            nearest.iter().copied().collect()
        });
        BodyKnot { joints_rad, time_s: SHIFT_S / 4.0 * f64::from(i) }
    };
    Uplink::Command {
        id: format!("shift{number}"),
        body: CommandBody::BodyPath { knots: (0..=4).map(knot).collect(), drive_hold: false },
        basis_joints_rad: frame.state.joints_rad.clone(),
        basis_tolerance_rad: 0.001,
        model_hash: None,
        epoch: None,
        preconditions: Vec::new(),
    }
}

/// Frames of a rover that shifts to and fro, with their times.
fn frames(robot: &Arc<Robot>, shifts: usize) -> Vec<(Timestamp, RoverTelemetry)> {
    let map = terrain::ElevationMap::plane(20.0, 0.5).unwrap();
    let scene = collision::Scene::new(robot.clone(), map, &[]).unwrap();
    let options = sim::SettleOptions::default();
    let settled = sim::settle(&scene, Point2::origin(), 0.0, "bent", &options).unwrap();
    let rover = sim::SimRover::new(scene, settled.configuration, 1.62).unwrap();
    let mut adapter = SimAdapter::new(START, rover);
    let mut frames = Vec::new();
    for number in 0..=shifts {
        let said = adapter.advance(START.plus_seconds(number as f64 * (SHIFT_S + 0.3)));
        frames.extend(said.into_iter().filter_map(|(at, said)| match said {
            Downlink::Telemetry(frame) => Some((at, frame)),
            Downlink::Ack { .. } | Downlink::Image(_) => None,
        }));
        let by = if number % 2 == 0 { 0.06 } else { -0.06 };
        let last = frames.last().map(|(_, frame)| frame).unwrap();
        let now = START.plus_seconds(number as f64 * (SHIFT_S + 0.3));
        adapter.uplink(now, shift(robot, number, last, Vector3::new(by, -0.7 * by, 0.0)));
    }
    let moving = frames.windows(2).filter(|pair| pair[0].1.state != pair[1].1.state).count();
    assert!(moving * 10 > frames.len() * 7, "{moving} of {} frames are new", frames.len());
    frames
}

/// Logs the frames as the ground does, with views so many times a second; the log's id.
fn log(
    dir: &Path,
    robot: &Arc<Robot>,
    frames: &[(Timestamp, RoverTelemetry)],
    hz: Option<f64>,
) -> String {
    let site = Site { gravity: 1.62, friction: 0.7 };
    let options = RecorderOptions {
        start: START,
        schemas: server::serve::schemas(),
        protobuf: views::channels(),
        reserve_bytes: 0,
        ..RecorderOptions::default()
    };
    let mut recorder = Recorder::start(dir, options).unwrap();
    let mut views = hz.map(|hz| Views::new(robot.clone(), hz));
    for (number, (at, frame)) in frames.iter().enumerate() {
        let derived = derive(robot, &site, frame);
        let record = |name: &str, data: Vec<u8>| Record {
            channel: name.into(),
            sequence: number as u64,
            log_time: at.plus_seconds(1.3),
            publish_time: *at,
            data: data.into(),
        };
        recorder.record(record(channel::ROVER_STATE, serde_json::to_vec(frame).unwrap()));
        let stability = record(channel::ROVER_STABILITY, serde_json::to_vec(&derived).unwrap());
        recorder.record(stability);
        if let Some(views) = &mut views {
            let drawn = views.of(*at, at.plus_seconds(1.3), frame, derived.as_ref());
            drawn.into_iter().for_each(|record| recorder.record_bulk(record));
        }
    }
    let status = recorder.finish().unwrap();
    assert_eq!(status.dropped, 0);
    status.log.id
}

#[test]
fn what_viewers_draw_costs_the_log_a_fifth() {
    let robot = Arc::new(athlete());
    let frames = frames(&robot, 20);
    let seconds = frames.last().unwrap().0.seconds_since(START);
    let dir = TempDir::new();
    let size = |hz: Option<f64>| {
        let id = log(dir.path(), &robot, &frames, hz);
        catalog::log_info(dir.path(), &id).unwrap().size as f64 / seconds * 3600.0
    };
    let [none, used, all] = [None, Some(VIEWS_HZ), Some(f64::INFINITY)].map(size);
    eprintln!(
        "{} frames of {seconds:.0} s; an hour of log: {:.1} MB, with views at {VIEWS_HZ} Hz {:.1} MB, \
         of every frame {:.1} MB",
        frames.len(),
        none / 1e6,
        used / 1e6,
        all / 1e6
    );
    assert!(used > none * 1.01 && used < none * 1.25, "{used} against {none}");
    assert!(all > none * 2.0, "at full rate they would cost much more: {all} against {none}");
}

#[test]
fn the_views_in_a_log_are_those_of_its_frames() {
    let robot = Arc::new(athlete());
    let frames = frames(&robot, 3);
    let dir = TempDir::new();
    let id = log(dir.path(), &robot, &frames, Some(VIEWS_HZ));
    let messages = catalog::read_log(dir.path(), &id, Limits::default()).unwrap().messages;
    // The file is sound, and says by itself what its messages are.
    let file = catalog::log_path(dir.path(), &id).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    assert_eq!(bridge::doctor::examine(&*bytes, bridge::seal::OWN).unwrap().findings, []);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    for channel in summary.channels.values().filter(|c| c.message_encoding == "protobuf") {
        let schema = channel.schema.as_ref().unwrap();
        assert_eq!((&*schema.encoding, &*schema.data), ("protobuf", DESCRIPTORS));
        assert!(schema.name.starts_with("foxglove."), "{}", schema.name);
    }
    let of = |topic: &str| -> Vec<_> {
        messages.iter().filter(|m| *m.channel == *topic).cloned().collect()
    };
    let transforms = of("/tf");
    // One in a second, and the first.
    let expected = frames.last().unwrap().0.seconds_since(START).floor() as usize + 1;
    assert!(transforms.len().abs_diff(expected) <= 1, "{} of {expected}", transforms.len());
    for message in &transforms {
        assert_eq!(&*message.encoding, "protobuf");
        let (_, frame) = frames.iter().find(|(at, _)| *at == message.publish_time).unwrap();
        let drawn = FrameTransforms::decode(&*message.data).unwrap();
        assert_eq!(drawn.transforms.len(), robot.links().len());
        let base = drawn.transforms.iter().find(|t| t.child_frame_id == "base_link");
        let base = base.unwrap_or(&drawn.transforms[0]).translation.unwrap();
        let place = frame.state.base.position_m;
        assert!((base.x - place[0]).abs() < 1e-9 && (base.y - place[1]).abs() < 1e-9);
    }
    for message in of("/joints") {
        let (_, frame) = frames.iter().find(|(at, _)| *at == message.publish_time).unwrap();
        let drawn = JointStates::decode(&*message.data).unwrap();
        let angles: Vec<f64> =
            robot.legs().iter().flat_map(|leg| frame.state.joints_rad[&leg.name].clone()).collect();
        assert_eq!(drawn.joints[0].position, angles);
    }
    for topic in ["/scene/forces", "/scene/stance"] {
        let scenes = of(topic);
        assert_eq!(scenes.len(), transforms.len(), "{topic}");
        for message in scenes {
            let drawn = SceneUpdate::decode(&*message.data).unwrap();
            assert!(!drawn.entities[0].arrows.is_empty() || !drawn.entities[0].lines.is_empty());
        }
    }
    // A replay draws them anew and leaves these out.
    let content = catalog::open_log(dir.path(), &id, Limits::default()).unwrap();
    let mut replay = Replay::open(START, "r", &id, content, None, 1.0).unwrap();
    let played = replay.advance(START.plus_seconds(1e4)).unwrap();
    assert_eq!(played.len(), 2 * frames.len());
    assert!(played.iter().all(|message| !views::is_view(&message.channel)));
    let end = replay.seek(START, START.plus_seconds(1e4)).unwrap();
    assert_eq!(end.len(), 2, "the state at the end is a frame and what follows from it");

    let test = "server::the_views_in_a_log_are_those_of_its_frames";
    let web = testkit::project_dir().join("web");
    if !web.join("node_modules/@mcap/core").is_dir() {
        return note_skipped(test, "web/node_modules has no @mcap/core");
    }
    let mut node = Command::new("node");
    let output = node.arg(web.join("conformance/mcap.mjs")).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counts = String::from_utf8(output.stdout).unwrap();
    assert!(counts.contains(&format!("/tf {}\n", transforms.len())), "{counts}");
}
