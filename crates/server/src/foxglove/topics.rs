//! The topics of the route: those that are logged, in JSON, and those that viewers draw.

use std::borrow::Cow;
use std::sync::Arc;

use axum::body::Bytes;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bridge::bus::ChannelMessage;
use bridge::recorder::ChannelSchema;
use rover::Robot;
use wire::foxglove::{self as drawn, DESCRIPTORS, FORCES, JOINTS, STANCE, TRANSFORMS, Topic};
use wire::live::{RoverTelemetry, channel};

use super::Advertised;

/// Topics that are drawn, each with the channel that it follows from.
const DRAWN: [(Topic, &str); 4] = [
    (TRANSFORMS, channel::ROVER_STATE),
    (JOINTS, channel::ROVER_STATE),
    (FORCES, channel::ROVER_STATE),
    (STANCE, channel::ROVER_STABILITY),
];

/// All topics of one listener. A topic goes by its place among them.
pub struct Topics {
    schemas: Vec<ChannelSchema>,
    robot: Arc<Robot>,
}

impl Topics {
    /// The logged channels, and what is drawn of a robot.
    pub fn new(schemas: &[ChannelSchema], robot: Arc<Robot>) -> Topics {
        Topics { schemas: schemas.to_vec(), robot }
    }

    /// The number of topics.
    pub fn len(&self) -> usize {
        self.schemas.len() + DRAWN.len()
    }

    /// All topics, as viewers are told.
    pub fn advertised(&self) -> Vec<Advertised<'_>> {
        let logged = self.schemas.iter().map(|schema| Advertised {
            id: 0,
            topic: &schema.channel,
            encoding: "json",
            schema_name: &schema.name,
            schema_encoding: "jsonschema",
            schema: Cow::from(&schema.schema_json),
        });
        let drawn = DRAWN.iter().map(|(topic, _)| Advertised {
            id: 0,
            topic: topic.name,
            encoding: "protobuf",
            schema_name: topic.schema_name,
            schema_encoding: "protobuf",
            schema: Cow::from(STANDARD.encode(DESCRIPTORS)),
        });
        let numbered = logged.chain(drawn).enumerate();
        numbered.map(|(id, channel)| Advertised { id, ..channel }).collect()
    }

    /// The channel that a topic follows from.
    pub fn channel(&self, topic: usize) -> &str {
        match self.schemas.get(topic) {
            Some(schema) => &schema.channel,
            None => DRAWN[topic - self.schemas.len()].1,
        }
    }

    /// What a message of its channel is on a topic; none where it cannot be drawn, as a frame of a
    /// robot with other legs in the replay of an old log. `frame` is the latest of the rover: that of
    /// the message itself where it is one.
    pub fn content(
        &self,
        topic: usize,
        message: &ChannelMessage,
        frame: impl FnOnce() -> Option<Arc<RoverTelemetry>>,
    ) -> Option<Bytes> {
        let Some(place) = topic.checked_sub(self.schemas.len()) else {
            return Some(message.json.clone());
        };
        let (topic, time) = (DRAWN.get(place)?.0, message.onboard_time);
        let frame = frame()?;
        let bytes = match topic {
            TRANSFORMS => drawn::transforms(&self.robot, &frame, time).ok()?,
            JOINTS => drawn::joints(&self.robot, &frame, time),
            FORCES => drawn::forces(&self.robot, &frame, time),
            _ => {
                let derived = serde_json::from_slice(&message.json).ok()?;
                drawn::stance(&derived, drawn::ground_height(&frame), time)
            }
        };
        Some(bytes.into())
    }
}
