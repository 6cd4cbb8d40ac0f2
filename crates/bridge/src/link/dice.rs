//! What is drawn at random: a stream of its own for each purpose, so that one does not shift another.
//! Only sums and products of uniform numbers: the same on every machine.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{DirectionModel, Jitter, Loss};

/// Draws of a truncated normal before its end is taken.
const DRAWS_MAX: usize = 64;

#[derive(Debug)]
pub(super) struct Dice {
    loss: ChaCha8Rng,
    corruption: ChaCha8Rng,
    duplication: ChaCha8Rng,
    jitter: ChaCha8Rng,
    /// The bad state of the burst model.
    bad: bool,
}

impl Dice {
    pub fn new(seed: u64) -> Dice {
        let stream = |number| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(number);
            rng
        };
        Dice {
            loss: stream(1),
            corruption: stream(2),
            duplication: stream(3),
            jitter: stream(4),
            bad: false,
        }
    }

    /// Is a frame lost, and is it damaged?
    pub fn frame(&mut self, model: &DirectionModel) -> (bool, bool) {
        (self.loses(model.loss), happens(&mut self.corruption, model.corruption))
    }

    /// Whether a message arrives a second time, and that copy damaged.
    pub fn again(&mut self, model: &DirectionModel) -> Option<bool> {
        happens(&mut self.duplication, model.duplication)
            .then(|| happens(&mut self.duplication, model.corruption))
    }

    pub fn jitter_ns(&mut self, jitter: &Jitter) -> u64 {
        let seconds = match *jitter {
            Jitter::None {} => return 0,
            Jitter::Uniform { most_s } => self.jitter.random::<f64>() * most_s,
            Jitter::TruncatedNormal { sigma_s, most_s } => {
                let mut draws = (0..DRAWS_MAX).map(|_| (normal(&mut self.jitter) * sigma_s).abs());
                draws.find(|seconds| *seconds <= most_s).unwrap_or(most_s)
            }
        };
        (seconds * 1e9) as u64
    }

    fn loses(&mut self, loss: Loss) -> bool {
        match loss {
            Loss::None {} => false,
            Loss::Bernoulli { probability } => happens(&mut self.loss, probability),
            Loss::GilbertElliott { to_bad, to_good, loss_good, loss_bad } => {
                let lost = happens(&mut self.loss, if self.bad { loss_bad } else { loss_good });
                self.bad ^= happens(&mut self.loss, if self.bad { to_good } else { to_bad });
                lost
            }
        }
    }
}

fn happens(rng: &mut ChaCha8Rng, probability: f64) -> bool {
    probability > 0.0 && rng.random::<f64>() < probability
}

/// Nearly normal, variance 1: the sum of twelve uniform numbers less its mean.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}
