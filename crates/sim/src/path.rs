//! Joint-linear paths at joint speed.

use rover::LegAngles;

/// A path of one leg: joint-linear between knots, at each knot at a known time.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TimedPath {
    knots: Vec<LegAngles>,
    /// When each knot is reached after the start (s), not decreasing.
    times: Vec<f64>,
}

impl TimedPath {
    /// Each piece takes the time that its slowest joint needs at `joint_speed` (rad/s). There must
    /// be a knot.
    pub fn new(knots: Vec<LegAngles>, joint_speed: f64) -> TimedPath {
        let mut time = 0.0;
        let mut times = vec![0.0];
        for piece in knots.windows(2) {
            time += (piece[1] - piece[0]).amax() / joint_speed;
            times.push(time);
        }
        TimedPath { knots, times }
    }

    /// How long the whole path takes (s).
    pub fn duration(&self) -> f64 {
        self.times[self.times.len() - 1]
    }

    /// Joint angles `t` seconds after the start; before and after it the ends.
    pub fn at(&self, t: f64) -> LegAngles {
        let next = self.times.partition_point(|time| *time <= t);
        if next == self.times.len() {
            return self.goal();
        }
        if next == 0 {
            return self.knots[0];
        }
        let (from, to) = (self.times[next - 1], self.times[next]);
        self.knots[next - 1].lerp(&self.knots[next], (t - from) / (to - from))
    }

    /// The last knot.
    pub fn goal(&self) -> LegAngles {
        self.knots[self.knots.len() - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angles(first: f64, last: f64) -> LegAngles {
        LegAngles::new(first, 0.0, 0.0, 0.0, 0.0, last)
    }

    #[test]
    fn each_piece_takes_what_its_slowest_joint_needs() {
        let path = TimedPath::new(vec![angles(0.0, 0.0), angles(0.2, 0.4), angles(0.5, 0.3)], 0.1);
        assert!((path.duration() - (4.0 + 3.0)).abs() < 1e-12);
        assert!((path.at(2.0) - angles(0.1, 0.2)).amax() < 1e-12);
        assert!((path.at(5.5) - angles(0.35, 0.35)).amax() < 1e-12);
        assert_eq!((path.at(-1.0), path.at(99.0)), (angles(0.0, 0.0), angles(0.5, 0.3)));
    }

    #[test]
    fn a_path_that_goes_nowhere_takes_no_time() {
        let path = TimedPath::new(vec![angles(0.3, 0.0); 3], 0.1);
        assert_eq!((path.duration(), path.at(0.0)), (0.0, angles(0.3, 0.0)));
    }
}
