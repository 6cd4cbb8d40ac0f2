//! Carrying the bytes of an [`End`] over a connection, until that ends.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::de::DeserializeOwned;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::Notify;

use super::end::{End, Parcel};
use super::frame::CarrierError;
use crate::clock::Clock;

/// Longest time between two looks at what is due (s).
const LOOK_S: f64 = 0.1;
/// Bytes read at once.
const READ_BYTES: usize = 64 << 10;

/// An end that a connection and its owner share.
pub struct Shared<O, I> {
    end: Mutex<End<O, I>>,
    /// There is something to write.
    pub write: Notify,
    /// Something came, or the state has changed.
    pub arrived: Arc<Notify>,
    /// The connection is to be made anew now.
    pub again: Notify,
}

impl<O, I> Shared<O, I> {
    /// Shares an end.
    pub fn new(end: End<O, I>) -> Shared<O, I> {
        Shared {
            end: Mutex::new(end),
            write: Notify::new(),
            arrived: Arc::new(Notify::new()),
            again: Notify::new(),
        }
    }

    /// The end, locked for the length of a call.
    pub fn end(&self) -> MutexGuard<'_, End<O, I>> {
        self.end.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Talks over `stream` until it ends; tells why it did. The end is closed then.
pub async fn converse<O, I, S>(shared: &Shared<O, I>, clock: &dyn Clock, stream: S) -> CarrierError
where
    O: Parcel,
    I: DeserializeOwned,
    S: AsyncRead + AsyncWrite,
{
    let (mut reader, mut writer) = tokio::io::split(stream);
    shared.end().open(clock.now());
    let silence = Duration::from_secs_f64(shared.end().bounds().silence_s);
    let hear = async {
        let mut bytes = vec![0; READ_BYTES];
        loop {
            let n = match reader.read(&mut bytes).await {
                Ok(0) => return CarrierError::Connection("the other end has closed it".into()),
                Ok(n) => n,
                Err(error) => return CarrierError::Connection(error.to_string()),
            };
            let heard = shared.end().receive(clock.now(), &bytes[..n]);
            shared.arrived.notify_one();
            // What came asks for an answer: a greeting, a confirmation.
            shared.write.notify_one();
            if let Err(error) = heard {
                return error;
            }
        }
    };
    let say = async {
        loop {
            let (due, bytes) = {
                let mut end = shared.end();
                (end.tick(clock.now()), end.output(clock.now()))
            };
            if let Err(error) = due {
                return error;
            }
            if bytes.is_empty() {
                let look = Duration::from_secs_f64(LOOK_S);
                // Woken or not, it looks again.
                let _ = tokio::time::timeout(look, shared.write.notified()).await;
                continue;
            }
            match tokio::time::timeout(silence, writer.write_all(&bytes)).await {
                Ok(Ok(())) => {}
                Ok(Err(error)) => return CarrierError::Connection(error.to_string()),
                Err(_) => return CarrierError::Connection("it takes nothing any more".into()),
            }
        }
    };
    let why = tokio::select! {
        why = hear => why,
        why = say => why,
        () = shared.again.notified() => CarrierError::Connection("an operator asked for it anew".into()),
    };
    if let CarrierError::Refused(text) = &why {
        let bytes = End::<O, I>::refusal(text);
        // The other end may be gone; it is told as far as that goes.
        let _ = tokio::time::timeout(silence, writer.write_all(&bytes)).await;
        let _ = tokio::time::timeout(silence, writer.shutdown()).await;
    }
    shared.end().close(clock.now(), &why);
    shared.arrived.notify_one();
    why
}
