//! Inverse kinematics of legs: the closed form where the leg has one, iteration where it has not.
//!
//! Everything is in the frame of the robot's base link.

mod chain;
mod closed_form;
mod numerical;

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

pub(crate) use self::chain::{Chain, ChainJoint};
pub use self::closed_form::LegIk;
pub use self::numerical::{FootTarget, NumericalIk};
use crate::chain::Frame;
use crate::model::Leg;
use crate::posture::LegAngles;

/// Most solutions that are given for one target.
pub const MAX_SOLUTIONS: usize = 8;

/// Solutions in a fixed order; they live on the stack.
pub type IkSolutions = ArrayVec<IkSolution, MAX_SOLUTIONS>;

/// Which of the up to eight solutions.
///
/// For a numerical solver the flags are signs that only change where the leg is singular: that of
/// the Jacobian's determinant (`knee_flipped`), and that of the wrist's bend (`wrist_flipped`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Branch {
    /// The wrist (the foot, for a numerical solver) lies on the leg's outward side of the first
    /// axis.
    pub outward: bool,
    /// The second branch of the knee.
    pub knee_flipped: bool,
    /// The second branch of the wrist.
    pub wrist_flipped: bool,
}

/// By how much forward kinematics of a solution misses its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Distance of the wheel center from where it should be (m).
    pub position: f64,
    /// Turn that is missing (rad); zero where the orientation is free.
    pub angle: f64,
}

/// Joint angles that bring the wheel where it was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSolution {
    /// Joint angles (rad; m for a prismatic joint), each the representative within its limits where
    /// there is one; zero beyond the leg's last joint.
    pub angles: LegAngles,
    /// Which branch.
    pub branch: Branch,
    /// True if all joints are within their limits.
    pub within_limits: bool,
    /// What forward kinematics misses, for solutions found by iteration: at most 1e-9 m and 1e-9
    /// rad. None for the closed form, which is exact to rounding.
    pub residual: Option<Residual>,
}

/// What is known of a target without solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Proof {
    /// It is out of reach, whatever the limits.
    Unreachable,
    /// Iteration found no solution within the limits; there may be one.
    NotFound,
}

/// Why there is no solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoSolution {
    /// Whether that is proven.
    pub proof: Proof,
    /// How far the wrist misses its reachable shell, or the foot the leg's reach, or the best try
    /// the target (m).
    pub distance: f64,
    /// What is missed, for people.
    pub reason: &'static str,
}

/// How a leg's inverse kinematics is solved.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // one a leg; a box would only add a step
pub enum LegSolver {
    /// All branches of a leg of six revolute joints that ends in a spherical wrist.
    ClosedForm(LegIk),
    /// Iteration from fixed starts, for every other leg.
    Numerical(NumericalIk),
}

impl LegSolver {
    /// Solutions that bring the wheel to `base_from_wheel`, or, for a solver that does not
    /// [fix the orientation](Self::fixes_orientation), its center to that one's.
    pub fn solve(
        &self,
        leg: &Leg,
        base_from_wheel: &Isometry3<f64>,
    ) -> Result<IkSolutions, NoSolution> {
        match self {
            LegSolver::ClosedForm(ik) => ik.solve(leg, base_from_wheel),
            LegSolver::Numerical(ik) if ik.fixes_orientation() => {
                ik.solve(leg, &FootTarget::Pose(*base_from_wheel))
            }
            LegSolver::Numerical(ik) => {
                ik.solve(leg, &FootTarget::Center(base_from_wheel.translation.vector.into()))
            }
        }
    }

    /// As [`solve`](Self::solve), but only what is within the limits.
    pub fn solve_within(
        &self,
        leg: &Leg,
        base_from_wheel: &Frame,
    ) -> Result<IkSolutions, NoSolution> {
        match self {
            LegSolver::ClosedForm(ik) => ik.solve_within(leg, base_from_wheel),
            LegSolver::Numerical(_) => {
                let mut solutions = self.solve(leg, &base_from_wheel.to_isometry())?;
                solutions.retain(|s| s.within_limits);
                Ok(solutions)
            }
        }
    }

    /// Of the solutions [within the limits](Self::solve_within) the first of those nearest to other
    /// angles, by the joint that differs most; none if there is none. Where a `branch` is given it is tried
    /// first: the answer is the same, and comes sooner if it is of that one.
    pub fn solve_nearest(
        &self,
        leg: &Leg,
        base_from_wheel: &Frame,
        to: &LegAngles,
        branch: Option<Branch>,
    ) -> Option<IkSolution> {
        match self {
            LegSolver::ClosedForm(ik) => branch
                .and_then(|branch| ik.solve_branch(leg, base_from_wheel, to, branch))
                .or_else(|| ik.solve_nearest(leg, base_from_wheel, to)),
            LegSolver::Numerical(_) => {
                let all = self.solve_within(leg, base_from_wheel).ok()?;
                let from = |s: &IkSolution| (s.angles - to).amax();
                all.into_iter().min_by(|a, b| from(a).total_cmp(&from(b)))
            }
        }
    }

    /// The closed form, if the leg has one.
    pub fn closed_form(&self) -> Option<&LegIk> {
        match self {
            LegSolver::ClosedForm(ik) => Some(ik),
            LegSolver::Numerical(_) => None,
        }
    }

    /// Solutions for a wheel center and the direction of the last link's x, the spin about which is
    /// free; for a solver that does not fix the orientation, for the center alone.
    pub fn solve_axis(
        &self,
        leg: &Leg,
        wheel_center: &Point3<f64>,
        axis: &Unit<Vector3<f64>>,
    ) -> Result<IkSolutions, NoSolution> {
        match self {
            LegSolver::ClosedForm(ik) => ik.solve_axis(leg, wheel_center, axis),
            LegSolver::Numerical(ik) if ik.fixes_orientation() => {
                ik.solve(leg, &FootTarget::Axis(*wheel_center, *axis))
            }
            LegSolver::Numerical(ik) => ik.solve(leg, &FootTarget::Center(*wheel_center)),
        }
    }

    /// True if a target's orientation counts: legs of six joints with a wheel. Legs of fewer joints
    /// and ball feet are solved for the position of the foot.
    pub fn fixes_orientation(&self) -> bool {
        match self {
            LegSolver::ClosedForm(_) => true,
            LegSolver::Numerical(ik) => ik.fixes_orientation(),
        }
    }

    /// Greatest distance of the wheel's center from the first axis' reference point (m).
    pub fn reach(&self) -> f64 {
        match self {
            LegSolver::ClosedForm(ik) => ik.reach(),
            LegSolver::Numerical(ik) => ik.reach(),
        }
    }

    pub(crate) fn scaled(&self, factor: f64) -> LegSolver {
        match self {
            LegSolver::ClosedForm(ik) => LegSolver::ClosedForm(ik.scaled(factor)),
            LegSolver::Numerical(ik) => LegSolver::Numerical(ik.scaled(factor)),
        }
    }
}
