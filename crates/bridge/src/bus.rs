//! Every message of every channel, encoded once, for all listeners in the process.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use tokio::sync::broadcast;
use wire::time::Timestamp;

/// A message of a channel, live or replayed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelMessage {
    /// Its channel, see `wire::live::channel`.
    pub channel: Arc<str>,
    /// Its number on that channel, from 1.
    pub sequence: u64,
    /// When it was true: on board for what the rover sent, on the ground for all else.
    pub onboard_time: Timestamp,
    /// When it was handed to the link, or written.
    pub sent_time: Timestamp,
    /// When it came to the ground.
    pub received_time: Timestamp,
    /// The message, as JSON text.
    pub json: Bytes,
}

/// What a listener gets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BusItem {
    /// The next message.
    Message(Arc<ChannelMessage>),
    /// This listener was too slow: that many messages are gone for it.
    Gap(u64),
}

/// The bus. Cloning gives another handle of the same one.
#[derive(Debug, Clone)]
pub struct Bus(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    sender: broadcast::Sender<Arc<ChannelMessage>>,
    latest: Mutex<BTreeMap<Arc<str>, Arc<ChannelMessage>>>,
}

/// A listener's end of the bus.
#[derive(Debug)]
pub struct Subscription(broadcast::Receiver<Arc<ChannelMessage>>);

impl Bus {
    /// A bus that keeps `capacity` messages for slow listeners; who is further behind gets a
    /// [`BusItem::Gap`] and goes on with the oldest message kept.
    pub fn new(capacity: usize) -> Bus {
        let (sender, _) = broadcast::channel(capacity.max(1));
        Bus(Arc::new(Shared { sender, latest: Mutex::default() }))
    }

    /// Gives `message` to all listeners.
    pub fn publish(&self, message: ChannelMessage) {
        let message = Arc::new(message);
        let mut latest = self.latest_by_channel();
        latest.insert(message.channel.clone(), message.clone());
        // No listener is not an error: the message is the latest for those to come.
        let _ = self.0.sender.send(message);
    }

    /// The latest message of every channel, in order of channel names, and a subscription that
    /// goes on exactly after them.
    pub fn subscribe(&self) -> (Vec<Arc<ChannelMessage>>, Subscription) {
        let latest = self.latest_by_channel();
        (latest.values().cloned().collect(), Subscription(self.0.sender.subscribe()))
    }

    /// The latest message of a channel.
    pub fn latest(&self, channel: &str) -> Option<Arc<ChannelMessage>> {
        self.latest_by_channel().get(channel).cloned()
    }

    fn latest_by_channel(&self) -> MutexGuard<'_, BTreeMap<Arc<str>, Arc<ChannelMessage>>> {
        // The map is whole after every statement, so a listener that panicked has not harmed it.
        self.0.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Subscription {
    /// Waits for the next message; `None` once the bus is gone.
    pub async fn next(&mut self) -> Option<BusItem> {
        match self.0.recv().await {
            Ok(message) => Some(BusItem::Message(message)),
            Err(broadcast::error::RecvError::Lagged(missed)) => Some(BusItem::Gap(missed)),
            Err(broadcast::error::RecvError::Closed) => None,
        }
    }

    /// The next message if one waits.
    pub fn try_next(&mut self) -> Option<BusItem> {
        match self.0.try_recv() {
            Ok(message) => Some(BusItem::Message(message)),
            Err(broadcast::error::TryRecvError::Lagged(missed)) => Some(BusItem::Gap(missed)),
            Err(_) => None,
        }
    }
}
