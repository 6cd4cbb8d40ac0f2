//! `WS /api/v1/stream`: the channels of the live rover and of replays.
//!
//! Each listener has one bounded queue. When it is full, nothing waits for it but its own
//! subscriptions: what they lose meanwhile is told as a gap.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use bridge::bus::{Bus, BusItem, ChannelMessage};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::AbortHandle;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use wire::live::channel;
use wire::resources::{ErrorInfo, StreamFrame, StreamRequest};

use crate::app::AppState;
use crate::body;
use crate::error::ApiError;
use crate::replays::ReplayItem;

/// Frames that wait for one listener.
const QUEUE: usize = 256;
/// Sources (live and replays) of one listener.
const SOURCES_MAX: usize = 5;
/// Longest message of a listener (bytes).
pub const REQUEST_BYTES_MAX: usize = 64 * 1024;
/// A listener is asked for a sign of life this often.
const PING: Duration = Duration::from_secs(15);
/// A listener that gives no sign of life, or takes nothing, for so long is let go.
const SILENCE: Duration = Duration::from_secs(45);

/// Serves one listener until it goes.
pub async fn serve(mut socket: WebSocket, app: AppState) {
    let (queue, mut frames) = mpsc::channel::<Utf8Bytes>(QUEUE);
    let mut sources = Sources { app: app.clone(), queue, tasks: BTreeMap::new() };
    let hello =
        StreamFrame::Hello { now: app.clock.now(), connection: uuid::Uuid::now_v7().to_string() };
    if !send(&mut socket, text_of(&hello)).await {
        return;
    }
    let mut closing = app.closing.clone();
    let mut ping = interval(PING);
    ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut heard = Instant::now();
    loop {
        let alive = tokio::select! {
            message = socket.recv() => {
                heard = Instant::now();
                match message {
                    Some(Ok(Message::Text(text))) => match sources.handle(&text) {
                        Some(answer) => send(&mut socket, text_of(&answer)).await,
                        None => true,
                    },
                    Some(Ok(Message::Binary(_))) => {
                        let answer = error_frame("wrong_type", "the stream takes text frames");
                        send(&mut socket, text_of(&answer)).await
                    }
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => true,
                    Some(Ok(Message::Close(_)) | Err(_)) | None => false,
                }
            }
            Some(frame) = frames.recv() => send(&mut socket, frame).await,
            _ = ping.tick() => {
                heard.elapsed() < SILENCE
                    && timeout(SILENCE, socket.send(Message::Ping(Default::default())))
                        .await
                        .is_ok_and(|sent| sent.is_ok())
            }
            () = closed(&mut closing) => false,
        };
        if !alive {
            break;
        }
    }
    // A listener that is gone already needs no farewell.
    let _ = timeout(Duration::from_secs(1), socket.send(Message::Close(None))).await;
}

/// Completes when the server ends.
async fn closed(closing: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone, which is an end too.
    let _ = closing.wait_for(|closing| *closing).await;
}

async fn send(socket: &mut WebSocket, text: Utf8Bytes) -> bool {
    timeout(SILENCE, socket.send(Message::Text(text))).await.is_ok_and(|sent| sent.is_ok())
}

fn text_of(frame: &StreamFrame) -> Utf8Bytes {
    serde_json::to_string(frame).unwrap_or_default().into()
}

fn error_frame(code: &str, message: &str) -> StreamFrame {
    StreamFrame::Error { error: ApiError::new(code, message).0 }
}

/// What a listener has subscribed to: a task for each source, ended when the listener goes.
struct Sources {
    app: AppState,
    queue: mpsc::Sender<Utf8Bytes>,
    /// By replay; `None` is the live rover.
    tasks: BTreeMap<Option<String>, AbortHandle>,
}

impl Drop for Sources {
    fn drop(&mut self) {
        self.tasks.values().for_each(AbortHandle::abort);
    }
}

impl Sources {
    /// Does what the listener asks; what it is answered at once.
    fn handle(&mut self, text: &str) -> Option<StreamFrame> {
        match body::parse::<StreamRequest>(text.as_bytes()) {
            Err(error) => Some(StreamFrame::Error { error: error.info() }),
            Ok(StreamRequest::Ping { nonce }) => {
                Some(StreamFrame::Pong { nonce, now: self.app.clock.now() })
            }
            Ok(StreamRequest::Unsubscribe { replay }) => {
                if let Some(task) = self.tasks.remove(&replay) {
                    task.abort();
                }
                None
            }
            Ok(StreamRequest::Subscribe { channels, replay }) => {
                self.subscribe(channels, replay).err().map(|error| StreamFrame::Error { error })
            }
        }
    }

    fn subscribe(
        &mut self,
        channels: Option<Vec<String>>,
        replay: Option<String>,
    ) -> Result<(), ErrorInfo> {
        let wanted = wanted(channels)?;
        if self.tasks.len() >= SOURCES_MAX && !self.tasks.contains_key(&replay) {
            return Err(ApiError::new("busy", "one listener hears 5 sources at most").0);
        }
        let queue = self.queue.clone();
        let task = match &replay {
            None => tokio::spawn(forward_live(self.app.live.bus.clone(), wanted, queue)),
            Some(id) => {
                let player = self.app.replays.get(id).map_err(|error| error.0)?;
                let id = id.clone();
                let (shown, receiver) = player.subscribe();
                let state = player.state();
                drop(player);
                tokio::spawn(async move {
                    let first = StreamFrame::Replay { state };
                    if queue.send(text_of(&first)).await.is_ok() {
                        forward_replay(&id, shown, receiver, wanted, queue).await;
                    }
                })
            }
        };
        if let Some(before) = self.tasks.insert(replay, task.abort_handle()) {
            before.abort();
        }
        Ok(())
    }
}

/// The channels to hear; none means all.
fn wanted(channels: Option<Vec<String>>) -> Result<Option<BTreeSet<String>>, ErrorInfo> {
    let Some(channels) = channels else { return Ok(None) };
    if let Some(unknown) = channels.iter().find(|name| !channel::ALL.contains(&name.as_str())) {
        let name: String = unknown.chars().take(64).collect();
        let message = format!("there is no channel {name:?}; there is {}", channel::ALL.join(", "));
        return Err(ApiError::new("channel_unknown", message).0);
    }
    Ok(Some(channels.into_iter().collect()))
}

fn is_wanted(wanted: &Option<BTreeSet<String>>, message: &ChannelMessage) -> bool {
    wanted.as_ref().is_none_or(|names| names.contains(&*message.channel))
}

async fn forward_live(bus: Bus, wanted: Option<BTreeSet<String>>, queue: mpsc::Sender<Utf8Bytes>) {
    let (latest, mut subscription) = bus.subscribe();
    drop(bus);
    for message in latest.iter().filter(|message| is_wanted(&wanted, message)) {
        if queue.send(message_frame(None, message)).await.is_err() {
            return;
        }
    }
    while let Some(item) = subscription.next().await {
        let frame = match item {
            BusItem::Message(message) if is_wanted(&wanted, &message) => {
                message_frame(None, &message)
            }
            BusItem::Message(_) => continue,
            BusItem::Gap(missed) => text_of(&StreamFrame::Gap { replay: None, missed }),
        };
        if queue.send(frame).await.is_err() {
            return;
        }
    }
}

async fn forward_replay(
    id: &str,
    shown: Vec<Arc<ChannelMessage>>,
    mut receiver: broadcast::Receiver<ReplayItem>,
    wanted: Option<BTreeSet<String>>,
    queue: mpsc::Sender<Utf8Bytes>,
) {
    for message in shown.iter().filter(|message| is_wanted(&wanted, message)) {
        if queue.send(message_frame(Some(id), message)).await.is_err() {
            return;
        }
    }
    loop {
        let frame = match receiver.recv().await {
            Ok(ReplayItem::Message(message)) if is_wanted(&wanted, &message) => {
                message_frame(Some(id), &message)
            }
            Ok(ReplayItem::Message(_)) => continue,
            Ok(ReplayItem::State(state)) => text_of(&StreamFrame::Replay { state }),
            Err(broadcast::error::RecvError::Lagged(missed)) => {
                text_of(&StreamFrame::Gap { replay: Some(id.into()), missed })
            }
            Err(broadcast::error::RecvError::Closed) => return,
        };
        if queue.send(frame).await.is_err() {
            return;
        }
    }
}

/// A message as a frame: the same text as [`StreamFrame::Message`] gives, without reading the
/// message's JSON again for every listener.
fn message_frame(replay: Option<&str>, message: &ChannelMessage) -> Utf8Bytes {
    let json = std::str::from_utf8(&message.json).unwrap_or("null");
    let quoted = |text: &str| serde_json::Value::from(text).to_string();
    let replay = replay.map(|id| format!("\"replay\":{},", quoted(id))).unwrap_or_default();
    format!(
        "{{\"op\":\"message\",{replay}\"channel\":{},\"sequence\":{},\"onboard_time\":\"{}\",\
         \"sent_time\":\"{}\",\"received_time\":\"{}\",\"message\":{json}}}",
        quoted(&message.channel),
        message.sequence,
        message.onboard_time.to_rfc3339(),
        message.sent_time.to_rfc3339(),
        message.received_time.to_rfc3339(),
    )
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::time::Timestamp;

    #[test]
    fn a_message_frame_reads_like_the_wire_says() {
        let message = ChannelMessage {
            channel: "rover/state".into(),
            sequence: 7,
            onboard_time: Timestamp(1),
            sent_time: Timestamp(2),
            received_time: Timestamp(3),
            json: r#"{"a":[1,2]}"#.into(),
        };
        for replay in [None, Some("r\"1")] {
            let text = message_frame(replay, &message);
            let frame: StreamFrame = serde_json::from_str(&text).unwrap();
            let expected = StreamFrame::Message {
                replay: replay.map(String::from),
                channel: "rover/state".into(),
                sequence: 7,
                onboard_time: Timestamp(1),
                sent_time: Timestamp(2),
                received_time: Timestamp(3),
                message: serde_json::json!({"a": [1, 2]}),
            };
            assert_eq!(frame, expected);
        }
    }

    #[test]
    fn channels_that_are_not_there_are_refused_by_name() {
        assert_eq!(wanted(None).unwrap(), None);
        assert!(wanted(Some(vec!["event".into()])).unwrap().unwrap().contains("event"));
        assert_eq!(wanted(Some(vec!["evnt".into()])).unwrap_err().code, "channel_unknown");
    }
}
