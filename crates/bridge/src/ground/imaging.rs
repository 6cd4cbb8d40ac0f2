//! Images that come down: told, logged, asked for again.

use std::sync::Arc;

use bytes::Bytes;
use wire::foxglove::CameraTopics;
use wire::live::{
    EventLevel, Executing, ImageDown, ImageReceived, ImageUp, LinkClass, Uplink, channel,
};
use wire::time::Timestamp;

use super::Ground;
use crate::images::{CaptureState, Images, ReceivedImage};
use crate::recorder::Record;

/// What the log keeps of an image for viewers, as messages of its topics; injected, so that the bridge
/// knows no cameras. Called with the ground locked: it is to take no longer than copying the image.
pub type CameraRecords = Box<dyn Fn(&ReceivedImage) -> Vec<(String, Bytes)> + Send>;

impl Ground {
    /// What is logged of images; without this only that they came.
    pub fn log_images(&mut self, records: CameraRecords) {
        self.cameras = Some(records);
    }

    /// The images that have come, and are on the way.
    pub fn images(&self) -> &Images {
        &self.images
    }

    /// Takes in the images of a capture of an earlier session; false if there is no room, or it is known.
    pub fn bring_back_images(&mut self, capture: &str, images: Vec<Arc<ReceivedImage>>) -> bool {
        self.images.bring_back(capture, images)
    }

    /// Gives up the images of a capture that are not here yet, on board, too; false if there are none.
    pub fn let_images_go(&mut self, now: Timestamp, who: &str, capture: &str) -> bool {
        let now = self.tick(now);
        if !self.images.let_go(capture) {
            return false;
        }
        self.ask_of_images(now, ImageUp::LetGo { capture: capture.to_owned() });
        let text = "let images go that were on the way";
        self.notice(now, EventLevel::Info, who, text);
        true
    }

    pub(super) fn receive_image(&mut self, sent: Timestamp, arrived: Timestamp, part: ImageDown) {
        let capture = match &part {
            ImageDown::Head(head) => head.image.capture.clone(),
            ImageDown::Piece { image, .. } => image.capture.clone(),
            ImageDown::End { capture, .. } | ImageDown::Gone { capture } => capture.clone(),
        };
        if let Some(image) = self.images.receive(arrived, part) {
            self.keep_image(sent, arrived, &image);
        }
        // As long as something comes, the command is not overdue.
        if let Some(progress) = self.images.progress(&capture)
            && self.images.state(&capture) == Some(&CaptureState::OnTheWay)
        {
            self.book.progress(arrived, &Executing { command_id: capture, progress, step: None });
        }
    }

    /// Logs an image that is here, and tells of it.
    fn keep_image(&mut self, sent: Timestamp, arrived: Timestamp, image: &ReceivedImage) {
        let head = &image.head;
        let records = self.cameras.as_ref().map(|records| records(image)).unwrap_or_default();
        self.latest_log_time = self.latest_log_time.max(arrived);
        for (topic, data) in records {
            let known = self.topics.entry(topic);
            let name: Arc<str> = Arc::from(known.key().as_str());
            let (channel, sequence) = known.or_insert((name, 0));
            *sequence += 1;
            self.recorder.record_bulk(Record {
                channel: channel.clone(),
                sequence: *sequence,
                log_time: self.latest_log_time,
                publish_time: head.time,
                data,
            });
        }
        let topic = CameraTopics::new(&head.image.pair, head.image.side).image;
        let received = ImageReceived { head: head.clone(), topic };
        self.put(channel::IMAGE, head.time, sent, arrived, &received);
    }

    /// Asks for what is missing, and lets go what is complete.
    pub(super) fn ask_for_images(&mut self, now: Timestamp) {
        let light = self.light_times(now);
        let word_s = light.up_s + light.down_s + light.spread_s;
        for ask in self.images.ask(now, word_s, light.spread_s) {
            if let ImageUp::LetGo { capture } = &ask {
                self.tell_end_of(now, &capture.clone());
            }
            self.ask_of_images(now, ask);
        }
    }

    fn tell_end_of(&mut self, now: Timestamp, capture: &str) {
        let (level, text) = match self.images.state(capture) {
            Some(CaptureState::Incomplete { why }) => {
                (EventLevel::Warning, format!("images did not come whole: {why}"))
            }
            _ => (EventLevel::Info, "all images of a request are here".to_owned()),
        };
        self.notice(now, level, "server", &text);
    }

    fn ask_of_images(&mut self, now: Timestamp, ask: ImageUp) {
        let uplink = Uplink::Image(ask);
        match self.offer_up(now, LinkClass::Housekeeping, uplink.clone()) {
            Ok(()) => {
                self.put(channel::COMMAND_UPLINK, now, now, now, &uplink);
            }
            Err(full) => tracing::debug!("images were not asked for: {full}"),
        }
    }
}
