//! Joint-linear paths of one leg or several, at bounded joint speed and acceleration.
//!
//! The path is followed exactly: joint-linear from knot to knot, no corner is cut. How fast the
//! angles go along it is a trapezoid in each piece: up to [`JOINT_ACCELERATION`], no joint faster
//! than the robot's joint speed, and slower where the command gives the piece more time. A path
//! starts and ends at rest. At a knot it stops, unless the joints' velocities change there by no
//! more than [`JOLT`], and along a run of short pieces by no more than the acceleration: so that a
//! straight line of the wheel, which is hundreds of knots, is one motion.

use nalgebra::Vector6;
use rover::{LegAngles, LegId};

/// Largest acceleration of a joint along a piece (rad/s²): full speed in half a second. The base
/// shifts by some 0.6 m a radian, so that its 0.12 m/s² stay below the 0.16 m/s² that a shift on
/// the Moon may take (planning notes, braking by margin).
pub(crate) const JOINT_ACCELERATION: f64 = 0.2;

/// Largest jump of a joint's velocity at a knot (rad/s): what the acceleration gives in 0.05 s.
const JOLT: f64 = 0.05 * JOINT_ACCELERATION;

/// A path of some legs: joint-linear between knots, at each knot at a known time.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TimedPath {
    legs: Vec<LegId>,
    /// Angles (rad) in the order of `legs`.
    knots: Vec<Vec<LegAngles>>,
    pieces: Vec<Piece>,
}

/// How fast a piece is passed. Lengths are changes of the joint that moves most (rad).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    /// When it begins (s).
    start: f64,
    /// How long it takes (s).
    duration: f64,
    /// Length of the path before it.
    before: f64,
    length: f64,
    /// Speeds at its first knot, between, and at its last knot (rad/s).
    speeds: [f64; 3],
}

impl TimedPath {
    /// The path through `knots` (angles in the order of `legs`, one knot or more). Each piece takes
    /// `at_least` (s) of its own, or longer where `joint_speed` (rad/s) and acceleration ask for
    /// it.
    pub fn new(
        legs: Vec<LegId>,
        knots: Vec<Vec<LegAngles>>,
        at_least: &[f64],
        joint_speed: f64,
    ) -> TimedPath {
        let lengths: Vec<f64> = knots.windows(2).map(|k| largest_change(&k[0], &k[1])).collect();
        let fastest: Vec<f64> = lengths
            .iter()
            .zip(at_least)
            .map(
                |(length, time)| {
                    if *time > 0.0 { joint_speed.min(length / time) } else { joint_speed }
                },
            )
            .collect();
        let at_knots = speeds_at_knots(&knots, &lengths, &fastest);
        let (mut start, mut before) = (0.0, 0.0);
        let pieces = lengths
            .iter()
            .zip(at_least)
            .zip(at_knots.windows(2))
            .map(|((length, time), ends)| {
                let piece = Piece::new(*length, *time, [ends[0], ends[1]], joint_speed);
                let placed = Piece { start, before, ..piece };
                start += piece.duration;
                before += length;
                placed
            })
            .collect();
        TimedPath { legs, knots, pieces }
    }

    /// How many pieces it has.
    pub fn n_pieces(&self) -> usize {
        self.pieces.len()
    }

    /// The angles (rad) of all legs of the robot, with these of the path's legs among them.
    pub fn applied(&self, all: &[LegAngles], moved: &[LegAngles]) -> Vec<LegAngles> {
        let mut all = all.to_vec();
        for (leg, angles) in self.legs.iter().zip(moved) {
            all[leg.0] = *angles;
        }
        all
    }

    /// How long the whole path takes (s).
    pub fn duration(&self) -> f64 {
        self.pieces.last().map_or(0.0, |piece| piece.start + piece.duration)
    }

    /// Joint angles (rad) `t` seconds after the start, in the order of the legs; before and after
    /// it the ends.
    pub fn at(&self, t: f64) -> Vec<LegAngles> {
        let Some((i, share)) = self.place(t) else { return self.goal().to_vec() };
        self.between(i, share)
    }

    /// Length passed (rad) `t` seconds after the start.
    pub fn length_at(&self, t: f64) -> f64 {
        match self.place(t) {
            Some((i, share)) => self.pieces[i].before + share * self.pieces[i].length,
            None => self.pieces.last().map_or(0.0, |last| last.before + last.length),
        }
    }

    /// The last knot.
    pub fn goal(&self) -> &[LegAngles] {
        &self.knots[self.knots.len() - 1]
    }

    /// Angles along the whole path at most `step` (rad) apart, in each piece `least` looks or more
    /// and `most` or fewer, each with its time (s).
    pub fn looks(
        &self,
        step: f64,
        least: usize,
        most: usize,
    ) -> impl Iterator<Item = (f64, Vec<LegAngles>)> {
        let looks_of = move |piece: &Piece| ((piece.length / step) as usize + 1).clamp(least, most);
        let start = (0.0, self.knots[0].clone());
        let pieces = self.pieces.iter().enumerate();
        std::iter::once(start).chain(pieces.flat_map(move |(i, piece)| {
            let n = looks_of(piece);
            (1..=n).map(move |k| {
                let share = k as f64 / n as f64;
                (piece.start + piece.time_at(share * piece.length), self.between(i, share))
            })
        }))
    }

    /// The piece at `t`, and the share of its length that is passed; `None` from the end on.
    fn place(&self, t: f64) -> Option<(usize, f64)> {
        let next = self.pieces.partition_point(|piece| piece.start + piece.duration <= t);
        let piece = self.pieces.get(next)?;
        Some((next, piece.share_at((t - piece.start).max(0.0))))
    }

    fn between(&self, piece: usize, share: f64) -> Vec<LegAngles> {
        let (from, to) = (&self.knots[piece], &self.knots[piece + 1]);
        from.iter().zip(to).map(|(from, to)| from.lerp(to, share)).collect()
    }
}

impl Piece {
    /// The trapezoid that takes `time` (s), or as little longer as can be, with these speeds at its
    /// ends, which the acceleration can join.
    fn new(length: f64, time: f64, [entry, exit]: [f64; 2], joint_speed: f64) -> Piece {
        let a = JOINT_ACCELERATION;
        if length <= 0.0 {
            let (start, before) = (0.0, 0.0);
            return Piece { start, before, duration: time, length: 0.0, speeds: [0.0; 3] };
        }
        // With the cruise speed v the piece takes v/a - (entry + exit)/a + peak²/(a v) seconds; at
        // the peak the trapezoid is a triangle.
        let peak = (a * length + 0.5 * (entry * entry + exit * exit)).sqrt();
        let sum = a * time + entry + exit;
        let root = sum * sum - 4.0 * peak * peak;
        let wished = if root >= 0.0 { 2.0 * peak * peak / (sum + root.sqrt()) } else { peak };
        let cruise = wished.min(joint_speed).min(peak).max(entry).max(exit);
        let mut piece =
            Piece { start: 0.0, duration: 0.0, before: 0.0, length, speeds: [entry, cruise, exit] };
        let [up, down] = piece.ramps();
        piece.duration =
            (cruise - entry) / a + (length - up - down).max(0.0) / cruise + (cruise - exit) / a;
        piece
    }

    /// Lengths of speeding up and of slowing down.
    fn ramps(&self) -> [f64; 2] {
        let [entry, cruise, exit] = self.speeds;
        [entry, exit].map(|end| (cruise * cruise - end * end) / (2.0 * JOINT_ACCELERATION))
    }

    /// Share of the length that is passed `t` seconds after its start.
    fn share_at(&self, t: f64) -> f64 {
        if self.length <= 0.0 {
            return 0.0;
        }
        let (a, [entry, cruise, exit]) = (JOINT_ACCELERATION, self.speeds);
        let left = self.duration - t;
        let passed = if t < (cruise - entry) / a {
            entry * t + 0.5 * a * t * t
        } else if left < (cruise - exit) / a {
            self.length - exit * left - 0.5 * a * left * left
        } else {
            self.ramps()[0] + cruise * (t - (cruise - entry) / a)
        };
        (passed / self.length).clamp(0.0, 1.0)
    }

    /// When `passed` (rad) of the piece are passed, after its start (s).
    fn time_at(&self, passed: f64) -> f64 {
        let (a, [entry, cruise, exit]) = (JOINT_ACCELERATION, self.speeds);
        let ([up, down], left) = (self.ramps(), self.length - passed);
        // The time that a ramp from `end` takes for this length.
        let ramp = |end: f64, length: f64| ((end * end + 2.0 * a * length).sqrt() - end) / a;
        if self.length <= 0.0 || left <= 0.0 {
            self.duration
        } else if passed <= up {
            ramp(entry, passed)
        } else if left <= down {
            self.duration - ramp(exit, left)
        } else {
            (cruise - entry) / a + (passed - up) / cruise
        }
    }
}

/// Speed along the path (rad/s) at each knot: zero at the ends, else what turn, neighbors and
/// acceleration allow.
fn speeds_at_knots(knots: &[Vec<LegAngles>], lengths: &[f64], fastest: &[f64]) -> Vec<f64> {
    let mut speeds = vec![0.0; knots.len()];
    for i in 1..lengths.len() {
        if lengths[i - 1] <= 0.0 || lengths[i] <= 0.0 {
            continue;
        }
        let turn = turn(&knots[i - 1..=i + 1], [lengths[i - 1], lengths[i]]);
        let sharp =
            (JOLT / turn).min((JOINT_ACCELERATION * lengths[i - 1].min(lengths[i]) / turn).sqrt());
        speeds[i] = sharp.min(fastest[i - 1]).min(fastest[i]);
    }
    let joined = |from: f64, length: f64| (from * from + 2.0 * JOINT_ACCELERATION * length).sqrt();
    for i in 1..speeds.len() {
        speeds[i] = speeds[i].min(joined(speeds[i - 1], lengths[i - 1]));
    }
    for i in (1..speeds.len()).rev() {
        speeds[i - 1] = speeds[i - 1].min(joined(speeds[i], lengths[i - 1]));
    }
    speeds
}

/// Largest change of any joint's velocity at the middle one of three knots, per speed along the
/// path.
fn turn(knots: &[Vec<LegAngles>], lengths: [f64; 2]) -> f64 {
    let legs = knots[0].iter().zip(&knots[1]).zip(&knots[2]);
    let change = |((a, b), c): ((&LegAngles, &LegAngles), &LegAngles)| {
        let velocities: Vector6<f64> = (c - b) / lengths[1] - (b - a) / lengths[0];
        velocities.amax()
    };
    legs.map(change).fold(0.0, f64::max)
}

fn largest_change(from: &[LegAngles], to: &[LegAngles]) -> f64 {
    from.iter().zip(to).map(|(from, to)| (to - from).amax()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEED: f64 = 0.1;
    /// What one start or stop costs (s).
    const RAMP_S: f64 = 0.5 * SPEED / JOINT_ACCELERATION;

    fn angles(first: f64, last: f64) -> Vec<LegAngles> {
        vec![LegAngles::new(first, 0.0, 0.0, 0.0, 0.0, last)]
    }

    fn path(knots: Vec<Vec<LegAngles>>, at_least: &[f64]) -> TimedPath {
        TimedPath::new(vec![LegId(0)], knots, at_least, SPEED)
    }

    fn check_near(value: f64, expected: f64) {
        assert!((value - expected).abs() < 1e-9, "{value}, expected {expected}");
    }

    #[test]
    fn a_piece_takes_what_its_slowest_joint_needs_and_a_ramp_at_each_end() {
        let path = path(vec![angles(0.0, 0.0), angles(0.2, 0.4)], &[0.0]);
        check_near(path.duration(), 4.0 + 2.0 * RAMP_S);
        let half = path.at(0.5 * path.duration());
        assert!((half[0] - angles(0.1, 0.2)[0]).amax() < 1e-12);
        assert_eq!((path.at(-1.0), path.at(99.0)), (angles(0.0, 0.0), angles(0.2, 0.4)));
    }

    #[test]
    fn a_piece_with_more_time_takes_just_that() {
        for time in [4.5, 5.0, 17.0, 3_600.0] {
            let path = path(vec![angles(0.0, 0.0), angles(0.0, 0.4)], &[time]);
            check_near(path.duration(), time.max(4.0 + 2.0 * RAMP_S));
        }
        // Knots at one place with time between them are a pause.
        let knots = vec![angles(0.0, 0.0), angles(0.0, 0.4), angles(0.0, 0.4), angles(0.0, 0.0)];
        let path = path(knots, &[6.0, 2.0, 6.0]);
        check_near(path.duration(), 14.0);
        assert_eq!(path.at(7.0), angles(0.0, 0.4));
    }

    #[test]
    fn a_straight_line_of_many_knots_is_one_motion_and_a_corner_is_nearly_a_stop() {
        let line = |n: usize| (0..=n).map(|i| angles(0.4 * i as f64 / n as f64, 0.0)).collect();
        check_near(path(line(1), &[0.0]).duration(), path(line(40), &[0.0; 40]).duration());
        let corner = path(vec![angles(0.0, 0.0), angles(0.4, 0.0), angles(0.4, 0.4)], &[0.0; 2]);
        let stops = 8.0 + 4.0 * RAMP_S;
        assert!(corner.duration() <= stops && corner.duration() > stops - 0.11);
    }

    #[test]
    fn joints_keep_speed_and_acceleration_through_all_kinds_of_knots() {
        // A curve of short pieces, a corner, a pause and slow pieces.
        let mut knots: Vec<_> = (0..60)
            .map(|i| 0.02 * f64::from(i))
            .map(|t: f64| angles(0.3 * t.sin(), 0.3 * t.cos()))
            .collect();
        knots.extend([angles(0.0, 0.1), angles(0.0, 0.1), angles(0.3, 0.1), angles(0.31, 0.0)]);
        let mut times = vec![0.0; knots.len() - 1];
        times[59..].copy_from_slice(&[0.0, 1.5, 6.0, 0.1]);
        let path = path(knots, &times);
        let tick = 0.05;
        let n = (path.duration() / tick) as usize + 2;
        let at: Vec<LegAngles> = (0..n).map(|i| path.at(i as f64 * tick)[0]).collect();
        let velocities: Vec<_> = at.windows(2).map(|w| (w[1] - w[0]) / tick).collect();
        for pair in velocities.windows(2) {
            assert!(pair[1].amax() <= SPEED + 1e-9);
            // Along the piece, by the turn, and a jolt: each as much as the acceleration.
            let change = (pair[1] - pair[0]).amax() / tick;
            assert!(change <= 3.0 * JOINT_ACCELERATION + 1e-9, "{change} rad/s²");
        }
        for (time, look) in path.looks(0.01, 1, 1000) {
            assert!((path.at(time)[0] - look[0]).amax() < 1e-9, "at {time} s");
        }
    }

    #[test]
    fn a_path_that_goes_nowhere_takes_no_time() {
        let path = path(vec![angles(0.3, 0.0); 3], &[0.0; 2]);
        assert_eq!((path.duration(), path.at(0.0)), (0.0, angles(0.3, 0.0)));
    }
}
