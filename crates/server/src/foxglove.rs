//! `WS /foxglove`: the channels of the live rover or of a replay, for viewers that speak the
//! Foxglove WebSocket protocol. Read-only: there is no operation that could reach the rover.
//!
//! Beside the logged channels, in JSON, there is what viewers draw in three dimensions, in protobuf:
//! [`wire::foxglove`]; and of the live rover its cameras, each image with calibration and place. Both subprotocols of viewers in use are taken; what is served here is the same in both. A
//! listener that takes too little loses the oldest messages of the bus, and is told how many.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use bridge::bus::{BusItem, ChannelMessage, Subscription};
use bytes::{BufMut, Bytes, BytesMut};
use serde::{Deserialize, Serialize};
use tokio::sync::{broadcast, watch};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use wire::time::Timestamp;

mod cameras;
mod listener;
mod topics;

use listener::Listener;
use topics::Topics;

use crate::app::AppState;
use crate::error::ApiError;
use crate::replays::ReplayItem;

/// Subprotocols taken, the current one first.
pub const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

/// A listener is asked for a sign of life this often.
const PING: Duration = Duration::from_secs(15);
/// A listener that gives no sign of life, or takes nothing, for so long is let go.
const SILENCE: Duration = Duration::from_secs(45);
/// Opcode of a message, and of the time.
const MESSAGE_DATA: u8 = 1;
const TIME: u8 = 2;

/// What a listener hears: the live rover, or one replay.
pub struct Feed {
    name: String,
    shown: Vec<Arc<ChannelMessage>>,
    source: Source,
}

enum Source {
    Live(Subscription),
    Replay(broadcast::Receiver<ReplayItem>),
}

/// What comes next of a feed.
enum Next {
    Message(Arc<ChannelMessage>),
    Missed(u64),
    Nothing,
    End,
}

impl Feed {
    /// The feed of a replay, or of the live rover where none is named.
    pub fn open(app: &AppState, replay: Option<&str>) -> Result<Feed, ApiError> {
        Ok(match replay {
            None => {
                let (shown, subscription) = app.live.bus.subscribe();
                Feed { name: "FootFall".into(), shown, source: Source::Live(subscription) }
            }
            Some(id) => {
                let (shown, receiver) = app.replays.get(id)?.subscribe();
                let name = format!("FootFall, replay {id}");
                Feed { name, shown, source: Source::Replay(receiver) }
            }
        })
    }
}

impl Source {
    async fn next(&mut self) -> Next {
        match self {
            Source::Live(subscription) => match subscription.next().await {
                Some(BusItem::Message(message)) => Next::Message(message),
                Some(BusItem::Gap(missed)) => Next::Missed(missed),
                None => Next::End,
            },
            Source::Replay(receiver) => match receiver.recv().await {
                Ok(ReplayItem::Message(message)) => Next::Message(message),
                Ok(ReplayItem::State(_)) => Next::Nothing,
                Err(broadcast::error::RecvError::Lagged(missed)) => Next::Missed(missed),
                Err(broadcast::error::RecvError::Closed) => Next::End,
            },
        }
    }
}

/// What a listener may ask.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Request {
    Subscribe {
        subscriptions: Vec<Wish>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
}

/// One wish of a subscription: messages of the channel come under this id.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Wish {
    id: u32,
    channel_id: u32,
}

/// What a listener is told in text.
#[derive(Debug, Serialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
enum Notice<'a> {
    ServerInfo {
        name: &'a str,
        capabilities: &'a [&'a str],
        supported_encodings: [&'a str; 0],
        metadata: BTreeMap<&'a str, &'a str>,
        session_id: String,
    },
    Advertise {
        channels: Vec<Advertised<'a>>,
    },
    Status {
        level: u8,
        message: String,
    },
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Advertised<'a> {
    id: usize,
    topic: &'a str,
    encoding: &'a str,
    schema_name: &'a str,
    schema_encoding: &'a str,
    schema: Cow<'a, str>,
}

/// Levels of a status.
const WARNING: u8 = 1;
const ERROR: u8 = 2;

/// Serves one listener until it goes.
pub async fn serve(mut socket: WebSocket, app: AppState, feed: Feed) {
    let Feed { name, shown, mut source } = feed;
    let is_replay = matches!(source, Source::Replay(_));
    let topics = Topics::new(&app, is_replay);
    if !greet(&mut socket, &name, is_replay, &topics).await {
        return;
    }
    let mut listener = Listener::new(topics);
    for message in shown {
        listener.keep(message);
    }
    let mut closing = app.closing.clone();
    let mut ping = interval(PING);
    ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut heard = Instant::now();
    loop {
        let frames = tokio::select! {
            message = socket.recv() => {
                heard = Instant::now();
                match message {
                    Some(Ok(Message::Text(text))) => listener.handle(&text),
                    Some(Ok(Message::Binary(_))) => vec![refusal("this route takes no binary messages: it is read-only")],
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => Vec::new(),
                    Some(Ok(Message::Close(_)) | Err(_)) | None => break,
                }
            }
            next = source.next() => match next {
                Next::Message(message) => listener.frames(message, is_replay),
                Next::Missed(missed) => {
                    let message = format!("{missed} messages were not sent: this viewer takes too little");
                    vec![status(WARNING, message)]
                }
                Next::Nothing => Vec::new(),
                Next::End => break,
            },
            _ = ping.tick() => match heard.elapsed() < SILENCE {
                true => vec![Message::Ping(Default::default())],
                false => break,
            },
            () = closed(&mut closing) => break,
        };
        if !send_all(&mut socket, frames).await {
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

async fn send_all(socket: &mut WebSocket, frames: Vec<Message>) -> bool {
    for frame in frames {
        if !timeout(SILENCE, socket.send(frame)).await.is_ok_and(|sent| sent.is_ok()) {
            return false;
        }
    }
    true
}

async fn greet(socket: &mut WebSocket, name: &str, is_replay: bool, topics: &Topics) -> bool {
    let info = Notice::ServerInfo {
        name,
        capabilities: if is_replay { &["time"] } else { &[] },
        supported_encodings: [],
        metadata: BTreeMap::from([("version", env!("CARGO_PKG_VERSION"))]),
        session_id: uuid::Uuid::now_v7().to_string(),
    };
    let channels = Notice::Advertise { channels: topics.advertised() };
    send_all(socket, vec![text_of(&info), text_of(&channels)]).await
}

/// What comes under a subscription, with the time at which it came to the ground.
fn data(subscription: u32, time: Timestamp, content: &[u8]) -> Message {
    let mut frame = BytesMut::with_capacity(13 + content.len());
    frame.put_u8(MESSAGE_DATA);
    frame.put_u32_le(subscription);
    frame.put_u64_le(time.0);
    frame.put_slice(content);
    Message::Binary(frame.freeze())
}

fn time_of(time: Timestamp) -> Message {
    let mut frame = [TIME; 9];
    frame[1..].copy_from_slice(&time.0.to_le_bytes());
    Message::Binary(Bytes::copy_from_slice(&frame))
}

fn refusal(message: &str) -> Message {
    status(ERROR, message.into())
}

fn status(level: u8, message: String) -> Message {
    text_of(&Notice::Status { level, message })
}

fn text_of(notice: &Notice<'_>) -> Message {
    let text: Utf8Bytes = serde_json::to_string(notice).unwrap_or_default().into();
    Message::Text(text)
}
