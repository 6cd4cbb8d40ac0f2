//! The rover's end: a rover that serves a ground over a carrier.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use wire::live::{AckStage, Downlink, Uplink};
use wire::time::Timestamp;

use super::converse::{Shared, converse};
use super::end::{Bounds, End, Identity};
use super::frame::{CarrierError, Side};
use super::journal::{Journal, JournalError};
use super::remote::Said;
use crate::adapter::RoverAdapter;
use crate::clock::Clock;

/// Time between two steps of the rover (s).
const STEP_S: f64 = 0.02;

/// The carrier as the rover shares it with who listens.
pub type RoverEnd = Shared<Said, Uplink>;

/// A rover, its memory, and its end of the carrier.
pub struct RoverHost {
    rover: Box<dyn RoverAdapter>,
    journal: Journal,
    shared: Arc<RoverEnd>,
}

impl RoverHost {
    /// A rover that has taken over what `journal` remembers. `run` names this run of its process,
    /// `robot` its robot model.
    pub fn new(
        now: Timestamp,
        rover: Box<dyn RoverAdapter>,
        journal: Journal,
        run: String,
        robot: String,
        bounds: Bounds,
    ) -> RoverHost {
        let end = End::new(now, Identity { side: Side::Rover, run, robot }, bounds);
        RoverHost { rover, journal, shared: Arc::new(Shared::new(end)) }
    }

    /// What a connection needs.
    pub fn shared(&self) -> Arc<RoverEnd> {
        self.shared.clone()
    }

    /// Goes on to `now`: hears, moves, speaks. After an error of the memory the rover is to end: one
    /// that cannot remember what it did must not do anything.
    pub fn step(&mut self, now: Timestamp) -> Result<(), JournalError> {
        if self.shared.end().take_fresh() {
            // Another ground, or the same one restarted: it may not know how commands ended.
            for said in self.journal.memory().last_words() {
                self.shared.end().push(now, said);
            }
        }
        loop {
            let Some(message) = self.shared.end().take_one() else { break };
            match message {
                Ok(uplink) => {
                    // Frames of before are not to be taken for frames after it.
                    self.speak(now)?;
                    self.journal.begin(now, &uplink)?;
                    self.rover.uplink(now, uplink);
                    self.speak(now)?;
                }
                Err(text) => self.refuse(now, &text),
            }
            self.shared.end().took();
        }
        self.speak(now)?;
        // Whoever is there writes it.
        self.shared.write.notify_one();
        Ok(())
    }

    fn speak(&mut self, now: Timestamp) -> Result<(), JournalError> {
        for (at, message) in self.rover.advance(now) {
            self.journal.said(at, &message)?;
            self.shared.end().push(now, Said { at, message });
        }
        Ok(())
    }

    /// A message of another version of the ground.
    fn refuse(&mut self, now: Timestamp, text: &str) {
        let value: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
        let Some(id) = value["id"].as_str() else { return };
        let detail = "this version of the rover does not know such a message";
        let (id, stage) = (id.chars().take(128).collect(), AckStage::Rejected);
        let message = Downlink::Ack { id, stage, detail: Some(detail.into()) };
        self.shared.end().push(now, Said { at: now, message });
    }
}

/// Steps the rover for ever; ends where its memory fails.
pub async fn run(host: Arc<Mutex<RoverHost>>, clock: Arc<dyn Clock>) -> JournalError {
    let arrived = {
        let host = host.lock().unwrap_or_else(PoisonError::into_inner);
        host.shared.arrived.clone()
    };
    loop {
        let stepped = {
            let mut host = host.lock().unwrap_or_else(PoisonError::into_inner);
            host.step(clock.now())
        };
        if let Err(error) = stepped {
            return error;
        }
        // Woken or not, it steps again.
        let _ = tokio::time::timeout(Duration::from_secs_f64(STEP_S), arrived.notified()).await;
    }
}

/// Takes one ground at a time for ever; others are told that there is one. A connection that has not
/// greeted yet gives way to a newer one: it may be the rest of one that was given up.
pub async fn listen(shared: Arc<RoverEnd>, listener: TcpListener, clock: Arc<dyn Clock>) {
    let mut next = None;
    loop {
        let stream = match next.take() {
            Some(stream) => stream,
            None => accept(&listener).await,
        };
        // Words on an E-stop do not wait for more to say.
        let _ = stream.set_nodelay(true);
        {
            let mut talk = std::pin::pin!(converse(&*shared, &*clock, stream));
            loop {
                let other = tokio::select! {
                    why = &mut talk => {
                        tracing::info!("the ground is no longer connected: {why}");
                        break;
                    }
                    other = accept(&listener) => other,
                };
                if !shared.end().is_up() {
                    next = Some(other);
                    break;
                }
                tokio::spawn(refuse(other));
            }
        }
        if next.is_some() {
            let why = CarrierError::Connection("a newer connection has come".into());
            shared.end().close(clock.now(), &why);
        }
    }
}

async fn accept(listener: &TcpListener) -> TcpStream {
    loop {
        match listener.accept().await {
            Ok((stream, _)) => return stream,
            Err(error) => {
                tracing::warn!("a connection could not be taken: {error}");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

async fn refuse(mut stream: TcpStream) {
    let refusal = End::<Said, Uplink>::refusal("the rover talks to another ground");
    let told = async move {
        // It may be gone; it is told as far as that goes.
        let _ = stream.write_all(&refusal).await;
        let _ = stream.shutdown().await;
    };
    let _ = tokio::time::timeout(Duration::from_secs(1), told).await;
}
