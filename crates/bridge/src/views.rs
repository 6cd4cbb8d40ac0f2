//! What viewers of others draw, in the log itself: poses of all links, joints, forces and stance as
//! Foxglove messages in protobuf, so that a sealed file shows the rover without our server.
//!
//! They follow from `rover/state` and `rover/stability`, which stand in the log in full. Of every frame
//! they would be more than the log without them: an hour of a rover that moves all the time has 85 MB
//! without, 210 MB with (server `log_views` counts). So the log has them at [`VIEWS_HZ`], which
//! costs a fifth at most. A replay leaves them out: whoever watches one gets them drawn anew, of every frame.

use std::sync::Arc;

use bytes::Bytes;
use rover::Robot;
use wire::foxglove::{self as drawn, DESCRIPTORS, FORCES, JOINTS, STANCE, TRANSFORMS, Topic};
use wire::live::{RoverTelemetry, StabilityDerived};
use wire::time::Timestamp;

use crate::recorder::{ProtobufChannel, Record};

/// How often the log has what viewers draw (1/s of on-board time).
pub const VIEWS_HZ: f64 = 1.0;
/// Times of frames may be off by so much (s).
const EARLY_S: f64 = 0.02;

/// All topics of this module.
const TOPICS: [Topic; 4] = [TRANSFORMS, JOINTS, FORCES, STANCE];

/// The channels, for [`crate::recorder::RecorderOptions::protobuf`].
pub fn channels() -> Vec<ProtobufChannel> {
    let channel = |topic: &Topic| ProtobufChannel {
        channel: topic.name.into(),
        schema_name: topic.schema_name.into(),
        descriptors: Bytes::from_static(DESCRIPTORS),
    };
    TOPICS.iter().map(channel).collect()
}

/// True for a channel of this module.
pub fn is_view(channel: &str) -> bool {
    TOPICS.iter().any(|topic| topic.name == channel)
}

/// Draws frames of one robot, not more often than asked for.
#[derive(Debug)]
pub struct Views {
    robot: Arc<Robot>,
    channels: [Arc<str>; 4],
    period_s: f64,
    last: Option<Timestamp>,
    sequence: u64,
}

impl Views {
    /// Views of a robot at most `rate_hz` times a second; of every frame where that is infinite.
    pub fn new(robot: Arc<Robot>, rate_hz: f64) -> Views {
        let channels = TOPICS.map(|topic| topic.name.into());
        Views { robot, channels, period_s: 1.0 / rate_hz, last: None, sequence: 0 }
    }

    /// The records of a frame: none where it is too early, or not a frame of this robot.
    pub fn of(
        &mut self,
        onboard: Timestamp,
        received: Timestamp,
        frame: &RoverTelemetry,
        derived: Option<&StabilityDerived>,
    ) -> Vec<Record> {
        let early = |last: Timestamp| {
            let since_s = onboard.seconds_since(last);
            (0.0..self.period_s - EARLY_S).contains(&since_s)
        };
        if self.last.is_some_and(early) {
            return Vec::new();
        }
        // Another robot's legs: an old log, for example.
        let Ok(transforms) = drawn::transforms(&self.robot, frame, onboard) else {
            return Vec::new();
        };
        self.last = Some(onboard);
        self.sequence += 1;
        let joints = drawn::joints(&self.robot, frame, onboard);
        let forces = drawn::forces(&self.robot, frame, onboard);
        let stance = derived.map(|d| drawn::stance(d, drawn::ground_height(frame), onboard));
        let drawn = [Some(transforms), Some(joints), Some(forces), stance];
        let record = |(channel, data): (&Arc<str>, Option<Vec<u8>>)| {
            Some(Record {
                channel: channel.clone(),
                sequence: self.sequence,
                log_time: received,
                publish_time: onboard,
                data: data?.into(),
            })
        };
        self.channels.iter().zip(drawn).filter_map(record).collect()
    }
}
