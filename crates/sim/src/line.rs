//! A wheel's straight line as joint angles: closed-form inverse kinematics along one branch.

use nalgebra::{Isometry3, Point3};
use rover::{Branch, IkSolution, LegAngles, LegId, Posture, Robot};

use crate::command::{Refusal, START_TOLERANCE_RAD, joint_name};

/// Distance of the samples along a line, as a share of the leg's reach (5 mm of about 2.5 m). What
/// is joint-linear between two of them leaves the line by some micrometers.
const SAMPLE_SHARE: f64 = 0.002;

/// Largest change of a joint from one sample to the next (rad): more is no motion of the wheel of
/// a few millimeters but a change of branch, or a pass through a singular pose.
const JUMP: f64 = 0.2;

/// Knots along the straight line of the wheel's center from where it is to `center` (`world`, m),
/// with the wheel's orientation kept; the first knot is `present`, where the leg is.
pub(crate) fn wheel_line(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    present: &LegAngles,
    center: &Point3<f64>,
) -> Result<Vec<LegAngles>, Refusal> {
    if !center.coords.iter().all(|v| v.is_finite()) {
        return Err(Refusal::NotFinite { what: "the goal of the wheel's center".into() });
    }
    let start = posture.wheel(robot, leg).world_from_wheel;
    let way = center - Point3::from(start.translation.vector);
    let length = way.norm();
    let sample = SAMPLE_SHARE * robot.leg(leg).ik.reach();
    // A line longer than twice the reach leaves it early: that many samples find it.
    let n = (length / sample).ceil().clamp(1.0, 2.0 / SAMPLE_SHARE);
    let mut line = Line { robot, posture, leg, length, branch: None };
    let mut knots = vec![*present];
    for i in 0..=n as usize {
        let share = i as f64 / n;
        let pose =
            Isometry3::from_parts((start.translation.vector + way * share).into(), start.rotation);
        let last = knots[knots.len() - 1];
        let angles = line.solve(&pose, &last, share * length)?;
        if i > 0 {
            knots.push(angles);
        }
    }
    Ok(knots)
}

struct Line<'a> {
    robot: &'a Robot,
    posture: &'a Posture,
    leg: LegId,
    length: f64,
    /// The branch that the leg is on, once it is known.
    branch: Option<Branch>,
}

impl Line<'_> {
    /// Joint angles on the leg's branch that bring the wheel to `pose`, `at` meters along the line
    /// and one sample after `last`.
    fn solve(
        &mut self,
        pose: &Isometry3<f64>,
        last: &LegAngles,
        at: f64,
    ) -> Result<LegAngles, Refusal> {
        let length = self.length;
        let all = self
            .posture
            .inverse_kinematics(self.robot, self.leg, pose)
            .map_err(|missed| Refusal::OutOfReach { at, length, missing: missed.distance })?;
        let change = |s: &IkSolution| (s.angles - last).amax();
        let near = |a: &&IkSolution, b: &&IkSolution| change(a).total_cmp(&change(b));
        let Some(branch) = self.branch else {
            // Where the leg is: the solution that it has.
            let here = all.iter().min_by(near).filter(|s| change(s) <= START_TOLERANCE_RAD);
            let here = here.ok_or(Refusal::LineBranch { at, length })?;
            self.branch = Some(here.branch);
            return Ok(here.angles);
        };
        let on_branch = all.iter().find(|s| s.branch == branch);
        let solution = on_branch.ok_or(Refusal::LineBranch { at, length })?;
        if change(solution) > JUMP {
            return Err(Refusal::LineBranch { at, length });
        }
        if !solution.within_limits {
            let joint = self.joint_beyond(&solution.angles);
            return Err(Refusal::LineLimit { at, length, joint });
        }
        Ok(solution.angles)
    }

    /// The joint that is furthest beyond a limit.
    fn joint_beyond(&self, angles: &LegAngles) -> String {
        let model = self.robot.leg(self.leg);
        let beyond = (angles - model.upper).sup(&(model.lower - angles));
        joint_name(self.robot, self.leg, beyond.imax())
    }
}
