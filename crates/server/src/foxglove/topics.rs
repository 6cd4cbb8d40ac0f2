//! The topics of the route: those that are logged, in JSON, those that viewers draw, and those of cameras.

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
use wire::time::Timestamp;

use super::Advertised;
use super::cameras::{self, CameraTopic, Seen};
use crate::app::AppState;

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
    /// Of the live rover's cameras, and where their images are.
    cameras: Vec<CameraTopic>,
    app: AppState,
}

/// What a message of its channel is on a topic.
pub enum Content {
    /// The message of the topic.
    Bytes(Bytes),
    /// Nothing.
    Nothing,
    /// It cannot be given any more, and why.
    Gone(String),
}

impl From<Option<Vec<u8>>> for Content {
    fn from(bytes: Option<Vec<u8>>) -> Content {
        bytes.map_or(Content::Nothing, |bytes| Content::Bytes(bytes.into()))
    }
}

impl Topics {
    /// The logged channels, what is drawn of a robot, and its cameras where the feed is live.
    pub fn new(app: &AppState, is_replay: bool) -> Topics {
        let cameras = if is_replay { Vec::new() } else { cameras::topics(app) };
        let robot = app.live.robot().clone();
        Topics { schemas: app.schemas.to_vec(), robot, cameras, app: app.clone() }
    }

    /// The number of topics.
    pub fn len(&self) -> usize {
        self.schemas.len() + DRAWN.len() + self.cameras.len()
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
        let drawn = DRAWN.iter().map(|(topic, _)| (topic.name, topic.schema_name));
        let seen = self.cameras.iter().map(|topic| (topic.name.as_str(), topic.schema_name));
        let drawn = drawn.chain(seen).map(|(topic, schema_name)| Advertised {
            id: 0,
            topic,
            encoding: "protobuf",
            schema_name,
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
            None => DRAWN.get(topic - self.schemas.len()).map_or(channel::IMAGE, |drawn| drawn.1),
        }
    }

    fn camera(&self, topic: usize) -> Option<&CameraTopic> {
        self.cameras.get(topic.checked_sub(self.schemas.len() + DRAWN.len())?)
    }

    /// What a topic begins with, where that is not the latest message of its channel: the newest image of a camera.
    pub fn newest(&self, topic: usize) -> Option<Option<(Timestamp, Bytes)>> {
        Some(self.camera(topic)?.newest(&self.app))
    }

    /// What a message of its channel is on a topic; none where it cannot be drawn, as a frame of a
    /// robot with other legs in the replay of an old log. `frame` is the latest of the rover: that of
    /// the message itself where it is one.
    pub fn content(
        &self,
        topic: usize,
        message: &ChannelMessage,
        frame: impl FnOnce() -> Option<Arc<RoverTelemetry>>,
    ) -> Content {
        let Some(place) = topic.checked_sub(self.schemas.len()) else {
            return Content::Bytes(message.json.clone());
        };
        if let Some(camera) = self.camera(topic) {
            return match camera.seen(&self.app, message) {
                Seen::Content(bytes) => Content::Bytes(bytes),
                Seen::Nothing => Content::Nothing,
                Seen::Gone(of) => Content::Gone(format!(
                    "{}: the image of capture {} is kept no more; it is in the flight log",
                    camera.name, of.capture
                )),
            };
        }
        let Some(((topic, _), frame)) = DRAWN.get(place).zip(frame()) else {
            return Content::Nothing;
        };
        let time = message.onboard_time;
        Content::from(match *topic {
            TRANSFORMS => drawn::transforms(&self.robot, &frame, time).ok(),
            JOINTS => Some(drawn::joints(&self.robot, &frame, time)),
            FORCES => Some(drawn::forces(&self.robot, &frame, time)),
            _ => serde_json::from_slice(&message.json)
                .ok()
                .map(|derived| drawn::stance(&derived, drawn::ground_height(&frame), time)),
        })
    }
}
