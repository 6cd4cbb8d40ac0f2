//! The stream, over a real socket.

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

use crate::support::Ground;

pub type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// The ground behind a port of its own: the beginning of its addresses.
pub async fn listening(ground: &Ground) -> String {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let router = ground.router.clone();
    tokio::spawn(async move {
        let (_open, closed) = tokio::sync::watch::channel(false);
        server::serve::connections::serve(listener, router, closed).await;
    });
    format!("ws://{address}")
}

async fn serve(ground: &Ground) -> String {
    format!("{}/api/v1/stream", listening(ground).await)
}

async fn frame(socket: &mut Socket) -> Value {
    loop {
        match socket.next().await.unwrap().unwrap() {
            Message::Text(text) => return serde_json::from_str(&text).unwrap(),
            Message::Ping(_) | Message::Pong(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

pub async fn say(socket: &mut Socket, request: Value) {
    socket.send(Message::text(request.to_string())).await.unwrap();
}

/// The next frame for which `wanted` holds.
async fn frame_where(socket: &mut Socket, wanted: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..1000 {
        let frame = frame(socket).await;
        if wanted(&frame) {
            return frame;
        }
    }
    panic!("no such frame among a thousand");
}

#[tokio::test]
async fn a_listener_hears_what_it_asked_for() {
    let ground = Ground::start().await;
    let (mut socket, _) = connect_async(serve(&ground).await).await.unwrap();
    assert_eq!(frame(&mut socket).await["op"], "hello");
    say(&mut socket, json!({ "op": "ping", "nonce": 7 })).await;
    assert_eq!(frame(&mut socket).await["nonce"], 7);
    say(&mut socket, json!({ "op": "subscribe", "channels": ["rover/state"] })).await;
    let first = frame(&mut socket).await;
    assert_eq!((&first["op"], &first["channel"]), (&json!("message"), &json!("rover/state")));
    let second = frame(&mut socket).await;
    assert_eq!(second["sequence"].as_u64(), first["sequence"].as_u64().map(|n| n + 1));
    assert!(second["received_time"].as_str() > second["onboard_time"].as_str());
    say(&mut socket, json!({ "op": "unsubscribe" })).await;
    say(&mut socket, json!({ "op": "subscribe" })).await;
    frame_where(&mut socket, |f| f["channel"] == "link/report").await;
    frame_where(&mut socket, |f| f["channel"] == "rover/stability").await;
}

#[tokio::test]
async fn what_cannot_be_met_is_said_and_the_stream_goes_on() {
    let ground = Ground::start().await;
    let (mut socket, _) = connect_async(serve(&ground).await).await.unwrap();
    frame(&mut socket).await;
    for (request, code) in [
        (json!({ "op": "subscribe", "channels": ["nothing"] }), "channel_unknown"),
        (json!({ "op": "subscribe", "replay": "none" }), "replay_unknown"),
        (json!({ "op": "shout" }), "wrong_type"),
        (json!([1]), "wrong_type"),
    ] {
        say(&mut socket, request).await;
        assert_eq!(frame(&mut socket).await["error"]["code"], code);
    }
    socket.send(Message::text("{")).await.unwrap();
    assert_eq!(frame(&mut socket).await["error"]["code"], "not_json");
    socket.send(Message::binary(vec![1, 2])).await.unwrap();
    assert_eq!(frame(&mut socket).await["op"], "error");
    say(&mut socket, json!({ "op": "ping", "nonce": 1 })).await;
    assert_eq!(frame(&mut socket).await["op"], "pong");
}

#[tokio::test]
async fn a_replay_gives_the_messages_of_the_log_under_its_own_name() {
    let ground = Ground::start().await;
    ground.clock.run_at(20.0);
    let logged = || async {
        ground.get("/api/v1/logs").await.json()["logs"][0]["messages"].as_u64() > Some(60)
    };
    ground.until("a log", logged).await;
    ground.clock.run_at(1.0);
    let log = ground.get("/api/v1/logs").await.json()["logs"][0]["id"].clone();
    let replay = ground.post("replays", &json!({ "log": log, "rate": 10.0 })).await.json();
    let (mut socket, _) = connect_async(serve(&ground).await).await.unwrap();
    frame(&mut socket).await;
    let subscribe =
        json!({ "op": "subscribe", "replay": replay["id"], "channels": ["rover/state"] });
    say(&mut socket, subscribe).await;
    let state = frame(&mut socket).await;
    assert_eq!((&state["op"], &state["state"]["log"]), (&json!("replay"), &log));
    let message = frame_where(&mut socket, |f| f["op"] == "message").await;
    assert_eq!((&message["replay"], &message["channel"]), (&replay["id"], &json!("rover/state")));
    // A seek gives the state of the place it goes to.
    let change = json!({ "at": replay["start"], "paused": true });
    let path = format!("/api/v1/replays/{}", replay["id"].as_str().unwrap());
    assert_eq!(ground.call("PATCH", &path, Some(&change)).await.status, 200);
    frame_where(&mut socket, |f| f["op"] == "replay" && f["state"]["paused"] == true).await;
}

#[tokio::test]
async fn listeners_are_bounded_and_pages_of_other_sites_are_not_heard() {
    let ground = Ground::with(|config| config.server.listeners_max = 1).await;
    let url = serve(&ground).await;
    let mut foreign = url.clone().into_client_request().unwrap();
    foreign.headers_mut().insert("origin", "https://evil.example".parse().unwrap());
    let refused = connect_async(foreign).await.unwrap_err();
    assert!(matches!(refused, Error::Http(answer) if answer.status() == 403));
    let (mut first, _) = connect_async(&url).await.unwrap();
    frame(&mut first).await;
    let refused = connect_async(&url).await.unwrap_err();
    assert!(matches!(refused, Error::Http(answer) if answer.status() == 429));
    first.close(None).await.unwrap();
    ground.until("a free place", || async { connect_async(&url).await.is_ok() }).await;
}
