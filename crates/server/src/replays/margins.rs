//! The margins of the last minutes before a replay's place, from what was derived when the log was written: so
//! that they need not be played to be seen after a jump.
//!
//! The log is read backward piece by piece, and the replay goes on between two pieces.

use bridge::bus::ChannelMessage;
use serde::Deserialize;
use wire::live::channel;
use wire::resources::{MarginsThen, ReplayMargins};

use super::Player;
use crate::error::ApiError;
use crate::stop::Stop;

/// How far back (s on board).
const SPAN_S: f64 = 300.0;
/// One sample stands for this long (ns on board).
const BUCKET_NS: u64 = 500_000_000;
/// Most pieces of a log that one answer reads.
const MOST_PIECES: usize = 400;
/// Most messages that one answer looks at.
const MOST_MESSAGES: usize = 30_000;

/// Of `rover/stability` what is asked for here; logs of older versions lack some of it.
#[derive(Deserialize)]
struct Logged {
    regular: Option<Polygon>,
    conservative: Option<Polygon>,
    #[serde(default)]
    forces: Option<Forces>,
}

#[derive(Deserialize)]
struct Forces {
    friction: Region,
}

#[derive(Deserialize)]
struct Region {
    #[serde(default)]
    region: Option<Polygon>,
}

#[derive(Deserialize)]
struct Polygon {
    margin_m: f64,
}

impl Player {
    /// The margins before the place where the replay is.
    pub fn margins(&self, stop: &Stop) -> Result<ReplayMargins, ApiError> {
        let mut place = self.locked().place();
        let mut newest = None;
        let (mut samples, mut n_messages): (Vec<MarginsThen>, usize) = (Vec::new(), 0);
        for _ in 0..MOST_PIECES {
            stop.check()?;
            let piece = self.locked().earlier(channel::ROVER_STABILITY, place)?;
            let Some((messages, before)) = piece else {
                return Ok(answer(samples, true));
            };
            place = before;
            n_messages += messages.len();
            for message in messages.iter().rev() {
                let newest = *newest.get_or_insert(message.onboard_time);
                if newest.seconds_since(message.onboard_time) > SPAN_S {
                    return Ok(answer(samples, true));
                }
                if let Some(sample) = sample(message) {
                    gather(&mut samples, sample);
                }
            }
            if n_messages > MOST_MESSAGES {
                break;
            }
        }
        Ok(answer(samples, false))
    }
}

fn answer(mut samples: Vec<MarginsThen>, complete: bool) -> ReplayMargins {
    // On board, messages may have come in another order than on the ground.
    samples.sort_by_key(|sample| sample.at);
    ReplayMargins { samples, complete }
}

/// What a message tells; none of one that cannot be read.
fn sample(message: &ChannelMessage) -> Option<MarginsThen> {
    let logged: Logged = serde_json::from_slice(&message.json).ok()?;
    let margin = |polygon: Option<Polygon>| polygon.map(|polygon| polygon.margin_m);
    Some(MarginsThen {
        at: message.onboard_time,
        regular_m: margin(logged.regular),
        conservative_m: margin(logged.conservative),
        friction_m: margin(logged.forces.and_then(|forces| forces.friction.region)),
    })
}

/// Adds an older sample: the least of a bucket stands for it, and where there was none for a moment, that
/// moment is the least.
fn gather(samples: &mut Vec<MarginsThen>, older: MarginsThen) {
    let bucket = |sample: &MarginsThen| sample.at.0 / BUCKET_NS;
    let least = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a.min(b));
    match samples.last_mut().filter(|last| bucket(last) == bucket(&older)) {
        Some(last) => {
            last.regular_m = least(last.regular_m, older.regular_m);
            last.conservative_m = least(last.conservative_m, older.conservative_m);
            last.friction_m = least(last.friction_m, older.friction_m);
        }
        None => samples.push(older),
    }
}
