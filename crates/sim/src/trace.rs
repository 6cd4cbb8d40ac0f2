//! A leg that follows its wheel: closed-form inverse kinematics along one branch.

use nalgebra::Isometry3;
use rover::{Branch, IkSolution, LegAngles, LegId, Robot};

use crate::command::{START_TOLERANCE_RAD, joint_name};

/// Largest change of a joint from one sample to the next (rad): more is no motion of the wheel of
/// a few millimeters but a change of branch, or a pass through a singular pose.
const JUMP: f64 = 0.2;

/// Why a leg does not follow.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Lost {
    /// The pose is out of reach by so much (m).
    Reach(f64),
    /// This joint would leave its limits.
    Limit(String),
    /// It would have to change its branch.
    Branch,
}

impl std::fmt::Display for Lost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Lost::Reach(missing) => write!(f, "it is out of reach by {missing:.3} m"),
            Lost::Limit(joint) => write!(f, "{joint} would leave its limits"),
            Lost::Branch => f.write_str("the leg would have to change its branch"),
        }
    }
}

/// A leg on its way.
pub(crate) struct Trace<'a> {
    robot: &'a Robot,
    leg: LegId,
    /// The branch that the leg is on, once it is known.
    branch: Option<Branch>,
    last: LegAngles,
}

impl<'a> Trace<'a> {
    /// A leg that is at these angles. The first pose to follow is to be where it is.
    pub fn new(robot: &'a Robot, leg: LegId, present: LegAngles) -> Trace<'a> {
        Trace { robot, leg, branch: None, last: present }
    }

    /// Joint angles on the leg's branch that bring the wheel to a pose from the base, near to the one
    /// before.
    pub fn follow(&mut self, base_from_wheel: &Isometry3<f64>) -> Result<LegAngles, Lost> {
        let model = self.robot.leg(self.leg);
        let all = model
            .ik
            .solve(model, base_from_wheel)
            .map_err(|missed| Lost::Reach(missed.distance))?;
        let change = |s: &IkSolution| (s.angles - self.last).amax();
        let near = |a: &&IkSolution, b: &&IkSolution| change(a).total_cmp(&change(b));
        let Some(branch) = self.branch else {
            // Where the leg is: the solution that it has.
            let here = all.iter().min_by(near).filter(|s| change(s) <= START_TOLERANCE_RAD);
            let here = here.ok_or(Lost::Branch)?;
            (self.branch, self.last) = (Some(here.branch), here.angles);
            return Ok(here.angles);
        };
        let solution = all.iter().find(|s| s.branch == branch).ok_or(Lost::Branch)?;
        if change(solution) > JUMP {
            return Err(Lost::Branch);
        }
        if !solution.within_limits {
            return Err(Lost::Limit(self.joint_beyond(&solution.angles)));
        }
        self.last = solution.angles;
        Ok(solution.angles)
    }

    /// The joint that is furthest beyond a limit.
    fn joint_beyond(&self, angles: &LegAngles) -> String {
        let model = self.robot.leg(self.leg);
        let beyond = (angles - model.upper).sup(&(model.lower - angles));
        joint_name(self.robot, self.leg, beyond.imax())
    }
}
