//! A connection between two ends of a carrier in virtual time: delivers bytes in pieces, is cut off
//! and made anew.

use std::sync::Arc;

use bridge::carrier::Parcel;
use bridge::carrier::host::RoverEnd;
use bridge::carrier::{CarrierError, GroundEnd, Shared};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use serde::de::DeserializeOwned;
use wire::time::Timestamp;

/// How a connection is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// Both ends are told at once.
    Closed,
    /// Nothing arrives any more, and nobody is told.
    Silent,
}

/// The connection.
#[derive(Default)]
pub struct VirtualWire {
    up: Vec<u8>,
    down: Vec<u8>,
    connected: bool,
    cut: Option<(Cut, Timestamp)>,
    dial_at: Timestamp,
    /// Bytes in damaged frames are flipped with this probability for each delivery.
    pub damage: f64,
}

impl VirtualWire {
    /// Nothing passes until then.
    pub fn cut(&mut self, how: Cut, until: Timestamp) {
        self.cut = Some((how, until));
    }

    /// One of the processes has died, and with it the connection.
    pub fn reset(&mut self) {
        self.connected = false;
        self.up.clear();
        self.down.clear();
    }

    pub fn is_cut(&self, now: Timestamp) -> bool {
        self.cut.is_some_and(|(_, until)| now < until)
    }

    /// Goes on to `now`.
    pub fn step(
        &mut self,
        now: Timestamp,
        ground: &Arc<GroundEnd>,
        rover: &Arc<RoverEnd>,
        rng: &mut ChaCha8Rng,
    ) {
        if self.is_cut(now) && self.cut.is_some_and(|(how, _)| how == Cut::Closed) {
            self.close(now, ground, rover, None);
        }
        if !self.connected && !self.is_cut(now) && now >= self.dial_at {
            ground.end().open(now);
            rover.end().open(now);
            self.connected = true;
        }
        if !self.connected {
            // A real end would be told by its dialing task.
            let _ = ground.end().tick(now);
            return;
        }
        for _ in 0..20 {
            let ticked = ground.end().tick(now);
            let ticked = ticked.and_then(|()| rover.end().tick(now));
            if let Err(why) = ticked {
                self.close(now, ground, rover, Some(why));
                return;
            }
            self.up.extend(ground.end().output(now));
            self.down.extend(rover.end().output(now));
            if self.is_cut(now) {
                // As TCP has it: what is under way comes later, or the connection ends.
                return;
            }
            let heard = deliver(&mut self.up, now, &**rover, self.damage, rng)
                .and_then(|()| deliver(&mut self.down, now, &**ground, self.damage, rng));
            if let Err(why) = heard {
                self.close(now, ground, rover, Some(why));
                return;
            }
        }
    }

    fn close(
        &mut self,
        now: Timestamp,
        ground: &Arc<GroundEnd>,
        rover: &Arc<RoverEnd>,
        why: Option<CarrierError>,
    ) {
        if self.connected {
            let why = why.unwrap_or(CarrierError::Connection("cut".into()));
            ground.end().close(now, &why);
            rover.end().close(now, &why);
        }
        self.reset();
        self.dial_at = now.plus_seconds(0.5);
    }
}

/// Delivers a random part of what is under way.
fn deliver<O: Parcel, I: DeserializeOwned>(
    bytes: &mut Vec<u8>,
    now: Timestamp,
    to: &Shared<O, I>,
    damage: f64,
    rng: &mut ChaCha8Rng,
) -> Result<(), CarrierError> {
    let n = if bytes.is_empty() { 0 } else { rng.random_range(0..=bytes.len()) };
    let mut piece: Vec<u8> = bytes.drain(..n).collect();
    if n > 0 && damage > 0.0 && rng.random_bool(damage) {
        let at = rng.random_range(0..n);
        piece[at] ^= 1 << (rng.next_u32() % 8);
    }
    to.end().receive(now, &piece)
}
