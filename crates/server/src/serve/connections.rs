//! Taking connections, with bounds that one who is slow or silent cannot get around.

use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

/// Where a connection comes from.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub SocketAddr);

/// Connections at the same time, listeners on the stream apart.
const CONNECTIONS_MAX: usize = 1024;
/// The head of a request must be there within this time; also the longest pause between requests.
const HEAD_TIME: Duration = Duration::from_secs(30);
/// Pause after a connection could not be taken, as when there are no more file handles.
const FAULT_PAUSE: Duration = Duration::from_millis(100);

/// Serves until `closed` becomes true, then until the requests under way are answered.
pub async fn serve(listener: TcpListener, router: Router, mut closed: watch::Receiver<bool>) {
    let places = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    loop {
        let Ok(place) = places.clone().acquire_owned().await else { break };
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = is_true(&mut closed) => break,
        };
        let (socket, peer) = match accepted {
            Ok(socket) => socket,
            Err(error) => {
                tracing::warn!("a connection was not taken: {error}");
                tokio::time::sleep(FAULT_PAUSE).await;
                continue;
            }
        };
        if let Err(error) = socket.set_nodelay(true) {
            tracing::debug!("a connection is slower than it could be: {error}");
        }
        let router = router.clone().layer(Extension(Peer(peer)));
        tokio::spawn(connection(socket, router, closed.clone(), place));
    }
    drop(listener);
    // Each connection gives its place back when it has ended.
    let _ended = places.acquire_many(CONNECTIONS_MAX as u32).await;
}

async fn connection(
    socket: TcpStream,
    router: Router,
    mut closed: watch::Receiver<bool>,
    place: OwnedSemaphorePermit,
) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .serve_connection(TokioIo::new(socket), TowerToHyperService::new(router))
        .with_upgrades();
    let mut connection = pin!(connection);
    let outcome = tokio::select! {
        outcome = connection.as_mut() => outcome,
        () = is_true(&mut closed) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = outcome {
        tracing::debug!("a connection ended: {error}");
    }
    drop(place);
}

async fn is_true(closed: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone, which is an end too.
    let _ = closed.wait_for(|closed| *closed).await;
}
