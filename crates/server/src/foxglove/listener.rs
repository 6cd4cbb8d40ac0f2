//! What one viewer has subscribed to, and what it is given.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use axum::extract::ws::Message;
use bridge::bus::ChannelMessage;
use wire::live::{RoverTelemetry, channel};

use super::topics::{Content, Topics};
use super::{Request, WARNING, Wish, data, refusal, status, time_of};

/// Subscriptions of one listener.
const SUBSCRIPTIONS_MAX: usize = 256;

/// One viewer.
pub struct Listener {
    topics: Topics,
    /// Subscriptions, each to a topic.
    wishes: BTreeMap<u32, usize>,
    /// The latest message of each channel that came by: a new subscription begins with it.
    latest: BTreeMap<Arc<str>, Arc<ChannelMessage>>,
    /// The latest frame of the rover, read when something is to be drawn of it.
    frame: OnceLock<Option<Arc<RoverTelemetry>>>,
}

impl Listener {
    /// A viewer that has asked for nothing yet.
    pub fn new(topics: Topics) -> Listener {
        Listener {
            topics,
            wishes: BTreeMap::new(),
            latest: BTreeMap::new(),
            frame: OnceLock::new(),
        }
    }

    /// Does what the viewer asks; what it is answered at once.
    pub fn handle(&mut self, text: &str) -> Vec<Message> {
        match serde_json::from_str(text) {
            Ok(Request::Subscribe { subscriptions }) => {
                subscriptions.into_iter().filter_map(|wish| self.subscribe(wish)).collect()
            }
            Ok(Request::Unsubscribe { subscription_ids }) => {
                self.wishes.retain(|id, _| !subscription_ids.contains(id));
                Vec::new()
            }
            Err(error) => vec![refusal(&format!(
                "not taken: {error}; this route is read-only and takes subscribe and unsubscribe"
            ))],
        }
    }

    fn subscribe(&mut self, wish: Wish) -> Option<Message> {
        let Wish { id, channel_id } = wish;
        let topic = channel_id as usize;
        if topic >= self.topics.len() {
            return Some(refusal(&format!("there is no channel {channel_id}")));
        }
        if self.wishes.contains_key(&id) {
            return Some(refusal(&format!("subscription {id} is in use; choose another id")));
        }
        if self.wishes.len() >= SUBSCRIPTIONS_MAX {
            return Some(refusal(&format!("{SUBSCRIPTIONS_MAX} subscriptions are the most")));
        }
        self.wishes.insert(id, topic);
        if let Some(newest) = self.topics.newest(topic) {
            return newest.map(|(time, content)| data(id, time, &content));
        }
        let message = self.latest.get(self.topics.channel(topic))?;
        self.under(id, topic, message)
    }

    /// Keeps `message` for subscriptions to come.
    pub fn keep(&mut self, message: Arc<ChannelMessage>) {
        if &*message.channel == channel::ROVER_STATE {
            self.frame = OnceLock::new();
        }
        self.latest.insert(message.channel.clone(), message);
    }

    /// The frames of a message: one for each subscription, and the time where `with_time`.
    pub fn frames(&mut self, message: Arc<ChannelMessage>, with_time: bool) -> Vec<Message> {
        self.keep(message.clone());
        let time = with_time.then(|| time_of(message.received_time));
        let wishes = self.wishes.iter();
        let wished = wishes.filter(|(_, topic)| self.topics.channel(**topic) == &*message.channel);
        let content = wished.filter_map(|(id, topic)| self.under(*id, *topic, &message));
        time.into_iter().chain(content).collect()
    }

    /// A message under a subscription.
    fn under(&self, id: u32, topic: usize, message: &ChannelMessage) -> Option<Message> {
        match self.topics.content(topic, message, || self.frame()) {
            Content::Bytes(content) => Some(data(id, message.received_time, &content)),
            Content::Nothing => None,
            Content::Gone(why) => Some(status(WARNING, why)),
        }
    }

    fn frame(&self) -> Option<Arc<RoverTelemetry>> {
        let read = || {
            let message = self.latest.get(channel::ROVER_STATE)?;
            serde_json::from_slice(&message.json).ok().map(Arc::new)
        };
        self.frame.get_or_init(read).clone()
    }
}
