//! Straight lines of the wheel in task space, executed as joint-linear pieces (F59, F75).

use nalgebra::{Isometry3, Translation3};
use rover::{LegAngles, LegId, Posture, Robot};

/// Largest change of a joint between two samples of one branch (rad): a larger one is a jump to
/// another branch or a singularity.
const JUMP: f64 = 0.35;

/// How far the wheel's center may leave the line between two knots (m at scale 1).
const DEVIATION: f64 = 0.002;

/// Distance between samples (m at scale 1).
const SAMPLING: f64 = 0.02;

/// Why a wheel cannot follow a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LineError {
    /// Out of reach (or beyond the limits on this branch) from this share of the way on.
    OutOfReach {
        /// Share of the way that can be followed, 0 to 1.
        share: f64,
        /// How far the wrist misses its reach there (m), zero where limits are in the way.
        distance: f64,
    },
}

/// Knots whose joint-linear pieces keep the wheel on the line from where `angles` has it to
/// `goal` (in `world`), within 2 mm (scaled), its orientation turning evenly. The first knot is
/// `angles`; the branch is kept.
pub fn wheel_line(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    angles: &LegAngles,
    goal: &Isometry3<f64>,
) -> Result<Vec<LegAngles>, LineError> {
    let start = posture.with_leg(robot, leg, angles).wheel(robot, leg).world_from_wheel;
    let line = Line { robot, posture, leg, start, goal: *goal };
    let length = (goal.translation.vector - start.translation.vector).norm();
    let turn = start.rotation.angle_to(&goal.rotation);
    let n = (length / (SAMPLING * robot.scale())).max(turn / 0.05).ceil().clamp(4.0, 4_000.0);
    let mut samples = vec![*angles];
    for i in 1..=n as usize {
        let t = i as f64 / n;
        let before = samples[samples.len() - 1];
        let here = line
            .solve(t, &before)
            .map_err(|distance| LineError::OutOfReach { share: (i - 1) as f64 / n, distance })?;
        samples.push(here);
    }
    let mut knots = vec![*angles];
    line.thin(&samples, 0, samples.len() - 1, &mut knots);
    Ok(knots)
}

struct Line<'a> {
    robot: &'a Robot,
    posture: &'a Posture,
    leg: LegId,
    start: Isometry3<f64>,
    goal: Isometry3<f64>,
}

impl Line<'_> {
    fn at(&self, t: f64) -> Isometry3<f64> {
        let (a, b) = (self.start.translation.vector, self.goal.translation.vector);
        let rotation = self
            .start
            .rotation
            .try_slerp(&self.goal.rotation, t, 1e-9)
            .unwrap_or(if t < 0.5 { self.start.rotation } else { self.goal.rotation });
        Isometry3::from_parts(Translation3::from(a * (1.0 - t) + b * t), rotation)
    }

    /// Angles at `t` on the branch of `before`; the error is the distance missed (m).
    fn solve(&self, t: f64, before: &LegAngles) -> Result<LegAngles, f64> {
        let solutions = self
            .posture
            .inverse_kinematics(self.robot, self.leg, &self.at(t))
            .map_err(|missed| missed.distance)?;
        solutions
            .iter()
            .filter(|s| s.within_limits)
            .map(|s| (s.angles, (s.angles - before).amax()))
            .filter(|(_, change)| *change < JUMP)
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(angles, _)| angles)
            .ok_or(0.0)
    }

    /// Adds the samples after `first` up to `last` that are needed to stay near the line.
    fn thin(&self, samples: &[LegAngles], first: usize, last: usize, knots: &mut Vec<LegAngles>) {
        let mut stack = vec![(first, last)];
        while let Some((a, b)) = stack.pop() {
            let middle = (a + b) / 2;
            if b - a > 1 && !self.stays_near(samples, a, b) {
                stack.push((middle, b));
                stack.push((a, middle));
            } else {
                knots.push(samples[b]);
            }
        }
    }

    /// Does the joint-linear piece from sample `a` to `b` keep near the samples between?
    fn stays_near(&self, samples: &[LegAngles], a: usize, b: usize) -> bool {
        let n = samples.len() - 1;
        (a + 1..b).all(|i| {
            let t = (i - a) as f64 / (b - a) as f64;
            let angles = samples[a] * (1.0 - t) + samples[b] * t;
            let wheel = self.posture.with_leg(self.robot, self.leg, &angles);
            let center = wheel.wheel(self.robot, self.leg).world_from_wheel.translation.vector;
            let on_line = self.at(i as f64 / n as f64).translation.vector;
            (center - on_line).norm() <= DEVIATION * self.robot.scale()
        })
    }
}
