//! Logs outlive versions: one as the first version wrote it, which knew fewer fields, is listed, played,
//! drawn, and its commands are taken up (F18).

use std::collections::BTreeMap;
use std::io::Cursor;

use bridge::catalog;
use bridge::clock::Clock;
use bridge::reader::Limits;
use bridge::replay::Replay;
use mcap::records::MessageHeader;
use serde_json::{Value, json};
use server::serve::Mission;
use wire::foxglove as drawn;
use wire::live::{
    CommandEvent, EventNotice, LinkReport, RoverTelemetry, StabilityDerived, TerrainNotice, Uplink,
};
use wire::time::Timestamp;

use crate::support::{Ground, TempDir, config};

const START: u64 = 1_790_000_000_000_000_000;

/// What the first version logged, with exactly the fields that it knew (wire at e22b801).
fn first_version() -> Vec<(&'static str, Value)> {
    let legs = |value: Value| -> Value {
        let of = (1..=6).map(|n| (format!("leg{n}"), value.clone()));
        of.collect::<serde_json::Map<_, _>>().into()
    };
    let base = json!({ "position_m": [0.0, 0.0, 2.0], "orientation_xyzw": [0.0, 0.0, 0.0, 1.0] });
    let state = json!({ "base": base, "joints_rad": legs(json!([0.0, 0.5, 0.5, 0.0, 0.6, 0.0])), "wheels_rad": {} });
    let polygon = json!({ "polygon_m": [[2.0, 0.0], [-1.0, 2.0], [-1.0, -2.0]], "area_m2": 6.0, "margin_m": 0.9 });
    let command = json!({
        "id": "01890a5d-ac96-774b-bcce-000000000001", "title": "Lift leg 1", "state": "sent",
        "body": { "type": "joint_path", "leg": "leg1", "knots": [
            { "joints_rad": [0.0, 0.5, 0.5, 0.0, 0.6, 0.0], "time_s": 0.0 },
            { "joints_rad": [0.0, 0.4, 0.5, 0.0, 0.6, 0.0], "time_s": 2.0 },
        ]},
        "plan": { "plan_id": "p1", "index": 0 }, "operator": "ada", "staged": "2026-09-21T14:13:20Z",
        "sent": "2026-09-21T14:13:21Z", "duration_s": 2.0, "progress": 0.0,
    });
    let counters = json!({ "sent": 3, "delivered": 2, "dropped": 0, "in_flight": 1 });
    vec![
        (
            "rover/state",
            json!({
                "state": state, "contacts": legs(json!(true)), "contact_points_m": legs(json!([1.0, 0.0, 0.0])),
                "wheel_forces_n": legs(json!([0.0, 0.0, 230.0])), "joint_torques_nm": legs(json!([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])), "mode": "idle",
            }),
        ),
        (
            "rover/stability",
            json!({
                "com_m": [0.1, 0.0, 1.9], "regular": polygon, "conservative": null, "conservative_kind": "empty",
                "settlement_margin_m": null, "settlement_leg": null, "torque_ratio": 0.4, "torque_joint": "leg1_hip_pitch",
                "torque_ratios": legs(json!([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])),
            }),
        ),
        (
            "terrain/version",
            json!({ "version": "a1b2", "source": "synthetic", "synthetic_detail": true }),
        ),
        ("event", json!({ "level": "info", "text": "session begins", "who": "server" })),
        (
            "command/event",
            json!({ "command": command, "time": "2026-09-21T14:13:21Z", "state": "sent", "who": "ada" }),
        ),
        (
            "command/uplink",
            json!({ "type": "estop", "id": "01890a5d-ac96-774b-bcce-000000000002" }),
        ),
        (
            "link/report",
            json!({
                "config": { "up_delay_s": 1.3, "down_delay_s": 1.3 }, "up": counters, "down": counters, "estop": "clear",
            }),
        ),
    ]
}

/// The log, as one file without seal or attachments; each message a second after the one before it.
fn file() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new().create(&mut bytes).unwrap();
    for (number, (topic, message)) in first_version().into_iter().enumerate() {
        let channel_id = writer.add_channel(0, topic, "json", &BTreeMap::new()).unwrap();
        let time = START + number as u64 * 1_000_000_000;
        let header = MessageHeader { channel_id, sequence: 1, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, message.to_string().as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

#[test]
fn every_message_of_the_first_version_is_understood() {
    for (channel, message) in first_version() {
        let text = message.to_string();
        let understood = match channel {
            "rover/state" => serde_json::from_str::<RoverTelemetry>(&text).err(),
            "rover/stability" => serde_json::from_str::<StabilityDerived>(&text).err(),
            "terrain/version" => serde_json::from_str::<TerrainNotice>(&text).err(),
            "event" => serde_json::from_str::<EventNotice>(&text).err(),
            "command/event" => serde_json::from_str::<CommandEvent>(&text).err(),
            "command/uplink" => serde_json::from_str::<Uplink>(&text).err(),
            _ => serde_json::from_str::<LinkReport>(&text).err(),
        };
        assert!(understood.is_none(), "{channel}: {understood:?}");
    }
}

#[tokio::test]
async fn a_log_of_the_first_version_is_listed_played_and_drawn_and_its_commands_are_taken_up() {
    let dir = TempDir::new();
    let config = config(dir.path());
    let logs = config.server.logs_dir.clone();
    std::fs::create_dir_all(&logs).unwrap();
    std::fs::write(logs.join("first.mcap"), file()).unwrap();
    let ground = Ground::of(Mission::of(config), dir).await;

    // The newest log when the server started: what was sent in it has an unknown outcome.
    let commands = ground.get("/api/v1/commands").await.json();
    assert!(commands.to_string().contains("\"overdue\""), "{commands}");
    let listed = ground.get("/api/v1/logs/first").await.json();
    assert_eq!(listed["messages"], first_version().len());

    // Played byte for byte.
    let replay = ground.post("replays", &json!({ "log": "first", "rate": 1.0 })).await;
    assert_eq!(replay.status, 201, "{}", replay.json());
    let content = catalog::open_log(&logs, "first", Limits::default()).unwrap();
    let now = ground.clock.now();
    let mut replay = Replay::open(now, "r", "first", content, None, 1.0).unwrap();
    let played = replay.advance(now.plus_seconds(100.0)).unwrap();
    let recorded = first_version();
    assert_eq!(played.len(), recorded.len());
    for (played, (channel, message)) in played.iter().zip(&recorded) {
        assert_eq!((&*played.channel, &*played.json), (*channel, message.to_string().as_bytes()));
    }

    // And drawn.
    let robot = ground.app().live.robot().clone();
    let frame: RoverTelemetry = serde_json::from_slice(&played[0].json).unwrap();
    let derived: StabilityDerived = serde_json::from_slice(&played[1].json).unwrap();
    assert!(drawn::transforms(&robot, &frame, Timestamp(START)).is_ok());
    assert!(!drawn::stance(&derived, drawn::ground_height(&frame), Timestamp(START)).is_empty());
}
