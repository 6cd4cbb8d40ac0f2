//! Inverse kinematics by iteration, for legs without a closed form.
//!
//! Levenberg-Marquardt on the pose error with the geometric Jacobian, from fixed starts spread over
//! the joint limits; every iterate is within the limits. What converges is a solution by its
//! residual; that nothing converges proves nothing, unless the target is farther than the leg's
//! links are long.

use nalgebra::{Isometry3, Matrix6, Point3, Unit, UnitQuaternion, Vector3, Vector6};

use super::chain::ChainPose;
use super::{Branch, Chain, IkSolution, IkSolutions, NoSolution, Proof, Residual};
use crate::model::{JointKind, Leg, LegId, Robot};
use crate::posture::LegAngles;

/// Largest residual of a solution (m, rad).
const CONVERGED: f64 = 1e-9;

/// Starts for a target that fixes the position, and for one that fixes the orientation too.
const STARTS: (u32, u32) = (32, 96);

/// Starts in a row that find nothing new, after which a target with solutions counts as done.
const STALE: u32 = 16;

/// Steps from one start.
const ITERATIONS: usize = 60;

/// Largest step of any joint (rad, or share of the leg's reach for a prismatic joint).
const STEP: f64 = 0.6;

/// Solutions nearer than this are the same (rad, m).
const SAME: f64 = 1e-5;

/// Where a wheel or ball foot is to be, in the base link's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FootTarget {
    /// Center and orientation.
    Pose(Isometry3<f64>),
    /// Center (m), and direction of the last link's x.
    Axis(Point3<f64>, Unit<Vector3<f64>>),
    /// Center alone (m).
    Center(Point3<f64>),
}

impl FootTarget {
    fn center(&self) -> Point3<f64> {
        match self {
            FootTarget::Pose(pose) => pose.translation.vector.into(),
            FootTarget::Axis(center, _) | FootTarget::Center(center) => *center,
        }
    }

    /// What is missing: shift of the center (m), and turn (rotation vector, rad).
    fn error(&self, base_from_foot: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let shift = self.center().coords - base_from_foot.translation.vector;
        let turn = match self {
            FootTarget::Pose(pose) => {
                (pose.rotation * base_from_foot.rotation.inverse()).scaled_axis()
            }
            FootTarget::Axis(_, axis) => {
                let present = base_from_foot.rotation * Vector3::x_axis();
                // Opposite directions have no one turn between them: any about z or y will do.
                UnitQuaternion::rotation_between_axis(&present, axis)
                    .unwrap_or_else(|| {
                        let across = base_from_foot.rotation * Vector3::z_axis();
                        UnitQuaternion::from_axis_angle(&across, std::f64::consts::PI)
                    })
                    .scaled_axis()
            }
            FootTarget::Center(_) => Vector3::zeros(),
        };
        (shift, turn)
    }
}

/// The numerical solver of one leg.
#[derive(Debug, Clone, PartialEq)]
pub struct NumericalIk {
    chain: Chain,
    fixes_orientation: bool,
    /// Sum of the lengths of links and strokes (m).
    reach: f64,
}

impl NumericalIk {
    /// The numerical solver of any leg, also of one that has a closed form.
    pub fn of(robot: &Robot, leg: LegId) -> NumericalIk {
        let leg = robot.leg(leg);
        NumericalIk::new(robot.chain_of(leg), !leg.wheel.ball, &leg.lower, &leg.upper)
    }

    pub(crate) fn new(
        chain: Chain,
        has_wheel: bool,
        lower: &LegAngles,
        upper: &LegAngles,
    ) -> NumericalIk {
        let links: f64 =
            chain.joints.iter().skip(1).map(|j| j.link_from_joint.translation.vector.norm()).sum();
        let strokes: f64 = (chain.joints.iter().enumerate())
            .filter(|(_, joint)| joint.kind == JointKind::Prismatic)
            .map(|(i, _)| lower[i].abs().max(upper[i].abs()))
            .sum();
        let reach = links + strokes + chain.link_from_foot.translation.vector.norm();
        let fixes_orientation = has_wheel && chain.joints.len() == 6;
        NumericalIk { chain, fixes_orientation, reach }
    }

    pub(crate) fn scaled(&self, factor: f64) -> NumericalIk {
        NumericalIk { chain: self.chain.scaled(factor), reach: self.reach * factor, ..self.clone() }
    }

    /// True if the whole wheel pose is solved for, not its center alone.
    pub fn fixes_orientation(&self) -> bool {
        self.fixes_orientation
    }

    /// Upper bound of the distance of the foot's center from the first joint (m): the sum of the
    /// lengths of the links and of the strokes of prismatic joints.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Up to [`MAX_SOLUTIONS`](super::MAX_SOLUTIONS) solutions within the limits, in the order
    /// found. A leg with more joints than the target fixes has more solutions than are given.
    pub fn solve(&self, leg: &Leg, target: &FootTarget) -> Result<IkSolutions, NoSolution> {
        let hip = self.chain.pose(&LegAngles::zeros()).points[0];
        let beyond = (target.center() - hip).norm() - self.reach;
        if beyond > CONVERGED {
            let reason = "farther than the leg's links are long";
            return Err(NoSolution { proof: Proof::Unreachable, distance: beyond, reason });
        }
        let n_starts = match target {
            FootTarget::Center(_) => STARTS.0,
            FootTarget::Pose(_) | FootTarget::Axis(..) => STARTS.1,
        };
        let mut solutions = IkSolutions::new();
        let (mut nearest, mut stale) = (f64::INFINITY, 0);
        for index in 0..n_starts {
            let (solution, residual) = self.descend(leg, target, start(leg, index));
            nearest = nearest.min(residual.position);
            let is_new = |s: &IkSolution| {
                solutions.iter().all(|other| (other.angles - s.angles).amax() > SAME)
            };
            match solution.filter(is_new) {
                Some(solution) => {
                    stale = 0;
                    if solutions.try_push(solution).is_err() || solutions.is_full() {
                        break;
                    }
                }
                None => stale += 1,
            }
            if stale >= STALE && !solutions.is_empty() {
                break;
            }
        }
        if solutions.is_empty() {
            let reason = "no solution within the limits was found by iteration";
            return Err(NoSolution { proof: Proof::NotFound, distance: nearest, reason });
        }
        Ok(solutions)
    }

    /// The solution that iteration from `start` leads to, if it leads to one.
    pub fn refine(&self, leg: &Leg, target: &FootTarget, start: &LegAngles) -> Option<IkSolution> {
        self.descend(leg, target, *start).0
    }

    /// Levenberg-Marquardt from `start`, and the residual it ends with.
    fn descend(
        &self,
        leg: &Leg,
        target: &FootTarget,
        start: LegAngles,
    ) -> (Option<IkSolution>, Residual) {
        let n = self.chain.joints.len();
        // Turns count as the shift they cause at the leg's end.
        let arm = self.reach.max(f64::MIN_POSITIVE);
        let weighed = |(shift, turn): (Vector3<f64>, Vector3<f64>)| {
            let turn = turn * arm;
            Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
        };
        let clamped = |q: LegAngles| q.sup(&leg.lower).inf(&leg.upper);
        let mut q = clamped(start);
        let mut pose = self.chain.pose(&q);
        let mut error = weighed(target.error(&pose.base_from_foot));
        let mut damping = 1e-3;
        let mut polished = 0;
        for _ in 0..ITERATIONS {
            let mut jacobian = self.jacobian(&pose, target, arm);
            let gradient = jacobian.transpose() * error;
            for i in 0..n {
                let held = (q[i] <= leg.lower[i] && gradient[i] < 0.0)
                    || (q[i] >= leg.upper[i] && gradient[i] > 0.0);
                if held {
                    jacobian.column_mut(i).fill(0.0);
                }
            }
            let normal =
                jacobian.transpose() * jacobian + Matrix6::identity() * (damping * arm * arm);
            let Some(cholesky) = normal.cholesky() else { break };
            let mut step = cholesky.solve(&(jacobian.transpose() * error));
            let longest = (0..n).map(|i| step[i].abs() / self.step_of(i)).fold(0.0, f64::max);
            step /= longest.max(1.0);
            let tried = clamped(q + step);
            let tried_pose = self.chain.pose(&tried);
            let tried_error = weighed(target.error(&tried_pose.base_from_foot));
            if tried_error.norm_squared() < error.norm_squared() {
                (q, pose, error) = (tried, tried_pose, tried_error);
                damping = (damping * 0.1).max(1e-15);
            } else {
                damping *= 10.0;
            }
            // Two steps more than enough: the last digits are cheap.
            let done = residual(&error, arm);
            polished += usize::from(done.position <= CONVERGED && done.angle <= CONVERGED);
            if polished > 2 || damping > 1e6 || error == Vector6::zeros() {
                break;
            }
        }
        let residual = residual(&error, arm);
        let found = residual.position <= CONVERGED && residual.angle <= CONVERGED;
        let solution = found.then(|| IkSolution {
            angles: q,
            branch: self.branch(&pose, target, arm),
            within_limits: true,
            residual: Some(residual),
        });
        (solution, residual)
    }

    fn step_of(&self, joint: usize) -> f64 {
        match self.chain.joints[joint].kind {
            JointKind::Prismatic => STEP * self.reach,
            _ => STEP,
        }
    }

    /// What a unit of each joint does to the foot: shift (m), and turn times `arm` where it counts.
    fn jacobian(&self, pose: &ChainPose, target: &FootTarget, arm: f64) -> Matrix6<f64> {
        let foot = pose.base_from_foot.translation.vector;
        let present = pose.base_from_foot.rotation * Vector3::x();
        let mut jacobian = Matrix6::zeros();
        for (i, joint) in self.chain.joints.iter().enumerate() {
            let axis = pose.axes[i].into_inner();
            let (shift, turn) = match joint.kind {
                JointKind::Prismatic => (axis, Vector3::zeros()),
                _ => (axis.cross(&(foot - pose.points[i].coords)), axis),
            };
            let turn = match target {
                FootTarget::Pose(_) => turn,
                // A spin about the direction itself does not count.
                FootTarget::Axis(..) => turn - present * present.dot(&turn),
                FootTarget::Center(_) => Vector3::zeros(),
            };
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&shift);
            jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&(turn * arm));
        }
        jacobian
    }

    fn branch(&self, pose: &ChainPose, target: &FootTarget, arm: f64) -> Branch {
        let jacobian = self.jacobian(pose, target, arm);
        let n = self.chain.joints.len();
        let determinant = match (target, n) {
            (FootTarget::Center(_), 3) => jacobian.fixed_view::<3, 3>(0, 0).determinant(),
            (FootTarget::Pose(_), 6) => jacobian.determinant(),
            _ => 0.0,
        };
        let out = pose.axes[1].cross(&pose.axes[0]);
        let foot = Point3::from(pose.base_from_foot.translation.vector);
        let [.., a4, a5, a6] = &pose.axes;
        Branch {
            outward: n < 2 || (foot - pose.points[1]).dot(&out) >= 0.0,
            knee_flipped: determinant < 0.0,
            wrist_flipped: n == 6 && a4.cross(a5).dot(a6) < 0.0,
        }
    }
}

fn residual(weighed: &Vector6<f64>, arm: f64) -> Residual {
    Residual {
        position: weighed.fixed_rows::<3>(0).norm(),
        angle: weighed.fixed_rows::<3>(3).norm() / arm,
    }
}

/// The start of that index within the limits: their middle, then points of the Halton sequence.
fn start(leg: &Leg, index: u32) -> LegAngles {
    let bases = [2, 3, 5, 7, 11, 13];
    let share = |i: usize| if index == 0 { 0.5 } else { radical_inverse(index, bases[i]) };
    LegAngles::from_fn(|i, _| leg.lower[i] + share(i) * (leg.upper[i] - leg.lower[i]))
}

/// The digits of `index` mirrored at the point, in a base: evenly spread over (0, 1).
fn radical_inverse(mut index: u32, base: u32) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while index > 0 {
        digit /= f64::from(base);
        value += digit * f64::from(index % base);
        index /= base;
    }
    value
}
