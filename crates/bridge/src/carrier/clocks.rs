//! By how much the clocks of both ends differ.

use std::collections::VecDeque;

use wire::time::Timestamp;

/// Samples kept: the least delayed of them counts.
const SAMPLES: usize = 16;
/// Clocks that differ by less (s) count as the same: the way between the ends takes some time too.
const SAME_S: f64 = 0.25;

/// The other end's clock as its beats tell it.
#[derive(Debug, Default)]
pub(super) struct PeerClock {
    samples: VecDeque<f64>,
    ahead_s: f64,
}

impl PeerClock {
    /// The first time told on a connection.
    pub fn restart(&mut self, there: Timestamp, here: Timestamp) {
        self.samples.clear();
        self.told(there, here);
    }

    /// `there` was the other end's time when it said what arrived at `here`: it is ahead by no less
    /// than the difference, and by no more than that and the time on the way.
    pub fn told(&mut self, there: Timestamp, here: Timestamp) {
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(there.seconds_since(here));
        let best = self.samples.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // Does not follow every small change: times on board are to go on evenly.
        let wanted = if best.abs() < SAME_S { 0.0 } else { best };
        if (wanted - self.ahead_s).abs() > SAME_S / 2.0 {
            self.ahead_s = wanted;
        }
    }

    pub fn ahead_s(&self) -> f64 {
        self.ahead_s
    }
}
