//! Damaged files, from good ones: the same for tests and for long runs.

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

/// How many rounds to go; fifty times as many where `FOOTFALL_FULL` is 1.
pub fn rounds(rounds: usize) -> usize {
    if std::env::var("FOOTFALL_FULL").is_ok_and(|v| v == "1") { 50 * rounds } else { rounds }
}

/// A file damaged in one to five places among its first `within` bytes: a byte changed or lost, the
/// rest cut off, or one of the pieces put in.
pub fn damaged(rng: &mut ChaCha8Rng, good: &[u8], within: usize, pieces: &[&str]) -> Vec<u8> {
    let mut bytes = good.to_vec();
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..bytes.len().min(within).max(1));
        match rng.random_range(0..4) {
            0 => bytes[at] = rng.next_u32() as u8,
            1 => drop(bytes.remove(at)),
            2 => bytes.truncate(at.max(20)),
            _ => {
                let piece = pieces[rng.random_range(0..pieces.len())];
                drop(bytes.splice(at..at, piece.bytes()));
            }
        }
    }
    bytes
}
