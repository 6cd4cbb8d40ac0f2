//! The nearest of many joint angles, by a scan over flat arrays: up to some ten thousand points in
//! six dimensions no tree is faster, and the scan runs in vector instructions.

use rover::LegAngles;

/// Points scanned at a time.
const BLOCK: usize = 64;

/// Joint angles, one array for each joint.
#[derive(Debug, Clone, Default)]
pub(crate) struct Points {
    joints: [Vec<f64>; 6],
}

impl Points {
    pub fn len(&self) -> usize {
        self.joints[0].len()
    }

    pub fn push(&mut self, angles: &LegAngles) {
        for (column, angle) in self.joints.iter_mut().zip(angles.iter()) {
            column.push(*angle);
        }
    }

    /// Takes a point out; the last one gets its index.
    pub fn swap_remove(&mut self, index: usize) {
        for column in &mut self.joints {
            column.swap_remove(index);
        }
    }

    /// Index of the nearest point by largest joint difference, and that distance (rad).
    pub fn nearest_by_largest_joint(&self, from: &LegAngles) -> Option<(usize, f64)> {
        self.nearest(from, |far, d| if d.abs() > far { d.abs() } else { far })
    }

    /// Index of the nearest point by Euclidean distance, and that distance (rad).
    pub fn nearest_by_norm(&self, from: &LegAngles) -> Option<(usize, f64)> {
        self.nearest(from, |sum, d| sum + d * d).map(|(index, squared)| (index, squared.sqrt()))
    }

    /// The first of the nearest points, joint differences gathered by `gather`.
    fn nearest(&self, from: &LegAngles, gather: impl Fn(f64, f64) -> f64) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for first in (0..self.len()).step_by(BLOCK) {
            let last = (first + BLOCK).min(self.len());
            let mut far = [0.0; BLOCK];
            for (column, angle) in self.joints.iter().zip(from.iter()) {
                for (far, x) in far.iter_mut().zip(&column[first..last]) {
                    *far = gather(*far, x - angle);
                }
            }
            for (i, far) in far[..last - first].iter().enumerate() {
                if best.is_none_or(|best| *far < best.1) {
                    best = Some((first + i, *far));
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_scan_agrees_with_a_plain_search_while_points_come_and_go() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut points, mut plain) = (Points::default(), Vec::<LegAngles>::new());
        for round in 0..500 {
            let q = LegAngles::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let by_norm = plain.iter().map(|p| (p - q).norm()).reduce(f64::min);
            let by_joint = plain.iter().map(|p| (p - q).amax()).reduce(f64::min);
            let (norm, joint) = (points.nearest_by_norm(&q), points.nearest_by_largest_joint(&q));
            assert_eq!(joint.map(|(_, far)| far), by_joint);
            assert_eq!(norm.is_some(), by_norm.is_some());
            if let (Some((i, far)), Some(expected)) = (norm, by_norm) {
                assert!((far - expected).abs() < 1e-12);
                assert!(((plain[i] - q).norm() - far).abs() < 1e-12);
            }
            points.push(&q);
            plain.push(q);
            if round % 3 == 0 {
                let i = rng.random_range(0..plain.len());
                points.swap_remove(i);
                plain.swap_remove(i);
            }
        }
    }
}
