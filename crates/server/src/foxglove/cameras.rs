//! Topics of the rover's cameras: image, calibration and place, as the flight log has them.
//!
//! The bus carries that an image came, not the image: it is taken from where it is kept when a viewer is given it, so that
//! a slow viewer holds up no images. One that is kept no more by then is told.

use axum::body::Bytes;
use bridge::bus::ChannelMessage;
use bridge::images::ReceivedImage;
use wire::foxglove::{CameraTopics, camera_messages};
use wire::live::{ImageName, ImageReceived, Side};
use wire::time::Timestamp;

use crate::app::AppState;

/// What a camera is heard of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Image,
    Calibration,
    Place,
}

/// One topic of a camera.
#[derive(Debug, Clone)]
pub struct CameraTopic {
    pair: String,
    side: Side,
    kind: Kind,
    /// Its name.
    pub name: String,
    /// Its schema.
    pub schema_name: &'static str,
}

/// What a message that an image came is on a topic of a camera.
pub enum Seen {
    /// The message of the topic.
    Content(Bytes),
    /// Nothing: it is of another camera, or one that is no pinhole has no calibration.
    Nothing,
    /// The image is kept no more.
    Gone(ImageName),
}

/// The topics of all cameras of the live rover.
pub fn topics(app: &AppState) -> Vec<CameraTopic> {
    let sides = |name: &str| [Side::Left, Side::Right].map(|side| (name.to_owned(), side));
    let cameras = app.live.rig().pairs().iter().flat_map(|pair| sides(&pair.name));
    let of_camera = |(pair, side): (String, Side)| {
        let named = CameraTopics::new(&pair, side).with_schemas();
        let kinds = [Kind::Image, Kind::Calibration, Kind::Place];
        named.into_iter().zip(kinds).map(move |((name, schema_name), kind)| CameraTopic {
            pair: pair.clone(),
            side,
            kind,
            name,
            schema_name,
        })
    };
    cameras.flat_map(of_camera).collect()
}

impl CameraTopic {
    fn is_of(&self, name: &ImageName) -> bool {
        name.pair == self.pair && name.side == self.side
    }

    /// What the message that an image came is on this topic.
    pub fn seen(&self, app: &AppState, message: &ChannelMessage) -> Seen {
        let Ok(ImageReceived { head, .. }) = serde_json::from_slice(&message.json) else {
            return Seen::Nothing;
        };
        if !self.is_of(&head.image) {
            return Seen::Nothing;
        }
        let image = app.live.locked().0.images().image(&head.image);
        match image {
            Some(image) => self.content(app, &image).map_or(Seen::Nothing, Seen::Content),
            None => Seen::Gone(head.image),
        }
    }

    /// The newest image of the camera that is kept, with its time on board.
    pub fn newest(&self, app: &AppState) -> Option<(Timestamp, Bytes)> {
        let newest = {
            let ground = app.live.locked().0;
            let images = ground.images();
            let captures = images.answers().into_iter().rev();
            captures.map(|answer| answer.capture).find_map(|capture| {
                images.image(&ImageName { capture, pair: self.pair.clone(), side: self.side })
            })
        }?;
        Some((newest.head.time, self.content(app, &newest)?))
    }

    fn content(&self, app: &AppState, image: &ReceivedImage) -> Option<Bytes> {
        let messages = camera_messages(app.live.robot(), app.live.rig(), &image.head, &image.png);
        let messages = messages.ok()?;
        match self.kind {
            Kind::Image => Some(messages.image),
            Kind::Calibration => messages.calibration,
            Kind::Place => Some(messages.place),
        }
    }
}
