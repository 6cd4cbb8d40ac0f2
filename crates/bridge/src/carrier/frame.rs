//! Frames: a length that is bounded, a check sum, a body.

use serde::{Deserialize, Serialize};

/// Largest body of a frame (bytes).
pub const BODY_MAX: usize = 16 << 20;
/// Largest body before both ends have greeted each other (bytes).
pub const GREETING_MAX: usize = 4096;

/// Length and check sum before the body, u32 each, little-endian.
const HEADER: usize = 8;

/// Version of the protocol. Ends of different versions refuse each other.
pub const PROTOCOL: u32 = 1;

/// What went wrong on a connection; it is closed then, and opened anew.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CarrierError {
    /// A length beyond the bound: not read any further.
    #[error("a frame of {bytes} bytes was announced; at most {most} are taken")]
    TooLong {
        /// What was announced.
        bytes: usize,
        /// What is taken.
        most: usize,
    },
    /// The check sum is not that of the body.
    #[error("a frame arrived damaged: its check sum does not fit")]
    Damaged,
    /// A body that is none of this protocol.
    #[error("a frame cannot be understood: {0}")]
    NotUnderstood(String),
    /// A message is missing between this one and the one before.
    #[error("message {got} came where {expected} was due")]
    OutOfOrder {
        /// The number that came.
        got: u64,
        /// The number that was due.
        expected: u64,
    },
    /// The ends do not belong together.
    #[error("{0}")]
    Refused(String),
    /// Nothing came for too long.
    #[error("nothing was heard for {0:.1} s")]
    Silent(f64),
    /// The connection itself.
    #[error("{0}")]
    Connection(String),
}

/// Which end somebody is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The ground dials.
    Ground,
    /// The rover listens.
    Rover,
}

/// The first frame of either end.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hello {
    /// [`PROTOCOL`].
    pub protocol: u32,
    /// Which end this is.
    pub side: Side,
    /// This run of this process: another one has other memory.
    pub run: String,
    /// Digest of the robot model with its scale and payload.
    pub robot: String,
    /// The run of the other end that this one talked to last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peer_run: Option<String>,
    /// Number of the last message received from that run.
    pub received: u64,
    /// The time here (ns since 1970).
    pub time_ns: u64,
}

/// What a frame holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Body {
    /// The greeting.
    Hello(Hello),
    /// Why the other end is not talked to, in words.
    Refusal(String),
    /// A message in JSON; none where it was taken back after it had its number.
    Message {
        /// Its number, from 1 on.
        number: u64,
        /// The last message of the other way that was taken over.
        taken: u64,
        /// The message.
        json: Option<Vec<u8>>,
    },
    /// Somebody is there.
    Beat {
        /// The last message of the other way that was taken over.
        taken: u64,
        /// The time there (ns since 1970).
        time_ns: u64,
    },
}

const HELLO: u8 = 1;
const REFUSAL: u8 = 2;
const MESSAGE: u8 = 3;
const BEAT: u8 = 4;
const VOID: u8 = 5;

/// Appends a frame with this body.
pub fn encode(out: &mut Vec<u8>, body: &Body) {
    match body {
        Body::Hello(hello) => {
            // A struct of numbers and text always encodes.
            let json = serde_json::to_vec(hello).unwrap_or_default();
            put(out, HELLO, &[], &json);
        }
        Body::Refusal(why) => put(out, REFUSAL, &[], why.as_bytes()),
        Body::Message { number, taken, json: Some(json) } => {
            put(out, MESSAGE, &[*number, *taken], json);
        }
        Body::Message { number, taken, json: None } => put(out, VOID, &[*number, *taken], &[]),
        Body::Beat { taken, time_ns } => put(out, BEAT, &[*taken, *time_ns], &[]),
    }
}

/// Appends the frame of a message that is encoded already.
pub fn encode_message(out: &mut Vec<u8>, number: u64, taken: u64, json: Option<&[u8]>) {
    let kind = if json.is_some() { MESSAGE } else { VOID };
    put(out, kind, &[number, taken], json.unwrap_or_default());
}

fn put(out: &mut Vec<u8>, kind: u8, numbers: &[u64], rest: &[u8]) {
    let start = out.len();
    out.extend_from_slice(&[0; HEADER]);
    out.push(kind);
    numbers.iter().for_each(|number| out.extend_from_slice(&number.to_le_bytes()));
    out.extend_from_slice(rest);
    let body = &out[start + HEADER..];
    let (bytes, sum) = (body.len() as u32, crc32fast::hash(body));
    out[start..start + 4].copy_from_slice(&bytes.to_le_bytes());
    out[start + 4..start + HEADER].copy_from_slice(&sum.to_le_bytes());
}

/// Makes frames out of bytes as they come, in whatever pieces.
#[derive(Debug, Default)]
pub struct Decoder {
    bytes: Vec<u8>,
    read: usize,
}

impl Decoder {
    /// Takes over what came.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next frame, if it is whole, of a body of at most `most` bytes. After an error nothing more
    /// is to be read.
    pub fn next(&mut self, most: usize) -> Result<Option<Body>, CarrierError> {
        let rest = &self.bytes[self.read..];
        let Some((header, rest)) = rest.split_at_checked(HEADER) else {
            self.forget();
            return Ok(None);
        };
        let word = |at: usize| {
            u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]])
        };
        let (bytes, sum) = (word(0) as usize, word(4));
        if bytes == 0 || bytes > most {
            return Err(CarrierError::TooLong { bytes, most });
        }
        let Some(body) = rest.get(..bytes) else {
            self.forget();
            return Ok(None);
        };
        if crc32fast::hash(body) != sum {
            return Err(CarrierError::Damaged);
        }
        let decoded = decode(body)?;
        self.read += HEADER + bytes;
        Ok(Some(decoded))
    }

    /// Lets go of what was read.
    fn forget(&mut self) {
        self.bytes.drain(..self.read);
        self.read = 0;
    }
}

fn decode(body: &[u8]) -> Result<Body, CarrierError> {
    let not = |why: &str| CarrierError::NotUnderstood(why.into());
    let (kind, rest) = body.split_first().ok_or_else(|| not("it is empty"))?;
    let two = || -> Result<(u64, u64, &[u8]), CarrierError> {
        let (a, rest) = rest.split_first_chunk::<8>().ok_or_else(|| not("it is cut off"))?;
        let (b, rest) = rest.split_first_chunk::<8>().ok_or_else(|| not("it is cut off"))?;
        Ok((u64::from_le_bytes(*a), u64::from_le_bytes(*b), rest))
    };
    match *kind {
        HELLO => serde_json::from_slice(rest)
            .map(Body::Hello)
            .map_err(|error| CarrierError::NotUnderstood(format!("greeting: {error}"))),
        REFUSAL => {
            let why = String::from_utf8_lossy(rest).chars().take(400).collect();
            Ok(Body::Refusal(why))
        }
        MESSAGE => {
            let (number, taken, json) = two()?;
            Ok(Body::Message { number, taken, json: Some(json.to_vec()) })
        }
        VOID => two().map(|(number, taken, _)| Body::Message { number, taken, json: None }),
        BEAT => two().map(|(taken, time_ns, _)| Body::Beat { taken, time_ns }),
        other => Err(CarrierError::NotUnderstood(format!("kind {other} is unknown"))),
    }
}
