//! Closed-form inverse kinematics of a leg that ends in a spherical wrist.
//!
//! The leg is recognized by its joint axes at angle zero: axis 2 perpendicular to axis 1, axis 3
//! parallel to axis 2, and axes 4 to 6 meeting in one point (the *wrist*) with axis 5
//! perpendicular to axes 4 and 6. Then the wrist's position depends on joints 1 to 3 alone
//! (Pieper's decomposition): two hip-yaw branches times two knee branches, and two wrist branches
//! each: 8 at most (H23, F44). Joints 4 to 6 follow from the orientation.
//!
//! By the product of exponentials the pose at joint angles q is R₁(q₁)…R₆(q₆) applied to the pose
//! at zero. Turns are carried as cosine and sine, so that each joint of each branch costs one
//! arctangent. Two bases are used beside the base link's:
//!
//! - *plane*: x outward, y along axis 2, w against axis 1, of the leg at hip yaw zero. It is
//!   left-handed: a positive turn about axis 2 goes from x to w, one about axis 1 from x to y.
//! - *wrist*: axis 4, axis 5 × axis 4, axis 5, of the leg at zero.

use std::f64::consts::{PI, TAU};

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use super::{Branch, Chain, IkSolution, IkSolutions, NoSolution, Proof};
use crate::chain::Frame;
use crate::model::{JointKind, Leg};
use crate::posture::LegAngles;

/// How far axes may miss being parallel, perpendicular or concurrent (rad, m at scale 1).
const AXIS_TOLERANCE: f64 = 1e-9;

/// Joint angles beyond a limit by rounding alone count as on the limit (rad).
const LIMIT_SLACK: f64 = 1e-9;

/// What the cosine of the knee's bend may exceed 1 by rounding alone.
const ROUNDING: f64 = 1e-12;

/// Sine of the wrist's bend below which joints 4 and 6 turn about the same axis.
const SINGULAR: f64 = 1e-9;

/// Joints turned by more than this from other angles belong to other branches, nearly always (rad).
const NEAR: f64 = 0.5;

/// Which solutions are asked for.
#[derive(Clone, Copy)]
enum Wanted<'w> {
    All,
    WithinLimits(&'w Leg),
    /// Within the limits, each joint within an angle (rad) of others.
    Near(&'w Leg, &'w LegAngles, f64),
}

impl Wanted<'_> {
    /// Is an angle of a joint, in (-π, π], one that is asked for?
    #[inline]
    fn holds(&self, joint: usize, q: f64) -> bool {
        match self {
            Wanted::All => true,
            Wanted::WithinLimits(leg) => fitted(leg, joint, q).is_some(),
            Wanted::Near(leg, to, angle) => {
                fitted(leg, joint, q).is_some_and(|q| (q - to[joint]).abs() <= *angle)
            }
        }
    }
}

/// The closed form of one leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegIk {
    /// A point on axis 1.
    hip: Point3<f64>,
    /// From the base's coordinates to the plane's, from the plane's to the wrist's.
    plane_from_base: Matrix3<f64>,
    wrist_from_plane: Matrix3<f64>,
    /// A point on axis 2 as seen from the hip, in the plane (m).
    shoulder: Vector3<f64>,
    /// Offset of the wrist from axis 1 along axis 2 (m).
    offset: f64,
    /// Lengths from axis 2 to axis 3 and from axis 3 to the wrist (m).
    thigh: f64,
    calf: f64,
    /// Direction of the thigh in the plane at zero, from x to w.
    thigh_direction: Turn,
    /// Turn from the calf's direction to the thigh's at zero.
    knee_zero: Turn,
    /// +1 if axis 3 points along axis 2, -1 if against it.
    axis_3_sign: f64,
    /// Angle from axis 4 to axis 6 about axis 5 at zero (rad).
    wrist_zero: f64,
    /// Axes 5 and 6 in the wheel's frame at zero, and the wrist there (m).
    axis_5_in_wheel: Vector3<f64>,
    axis_6_in_wheel: Vector3<f64>,
    wheel_from_wrist: Point3<f64>,
}

/// An angle with its cosine and sine.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    angle: f64,
    cos: f64,
    sin: f64,
}

impl Turn {
    fn of(angle: f64) -> Turn {
        let (sin, cos) = angle.sin_cos();
        Turn { angle, cos, sin }
    }

    /// The angle in (-π, π] with this cosine and sine.
    fn from_cos_sin(cos: f64, sin: f64) -> Turn {
        Turn { angle: atan2(sin, cos), cos, sin }
    }
}

/// As the function of the standard library, in (-π, π].
fn atan2(y: f64, x: f64) -> f64 {
    let angle = y.atan2(x);
    if angle <= -PI { PI } else { angle }
}

/// An angle within one turn of (-π, π], wrapped to it.
fn wrapped(angle: f64) -> f64 {
    if angle > PI {
        angle - TAU
    } else if angle <= -PI {
        angle + TAU
    } else {
        angle
    }
}

impl LegIk {
    /// Recognizes the leg from its joints; none if it has another build.
    pub(crate) fn new(chain: &Chain) -> Option<LegIk> {
        let revolute = chain.joints.iter().all(|joint| joint.kind == JointKind::Revolute);
        if chain.joints.len() != 6 || !revolute {
            return None;
        }
        let zero = chain.pose(&LegAngles::zeros());
        let (p, [a1, a2, a3, a4, a5, a6]) = (zero.points, zero.axes);
        let perpendicular = |a: &Unit<Vector3<f64>>, b| a.dot(b).abs() < AXIS_TOLERANCE;
        let parallel = a2.cross(&a3).norm() <= AXIS_TOLERANCE;
        if !(perpendicular(&a1, &a2) && parallel) {
            return None;
        }
        if !(perpendicular(&a4, &a5) && perpendicular(&a5, &a6)) {
            return None;
        }
        // The wrist is where axes 4 and 5 meet; axis 6 must pass through it.
        let wrist = intersection(&(p[3], a4), &(p[4], a5))?;
        if (wrist - p[5]).cross(&a6).norm() > AXIS_TOLERANCE {
            return None;
        }
        let plane = Matrix3::from_rows(&[
            a2.cross(&a1).transpose(),
            a2.transpose(),
            (-a1.into_inner()).transpose(),
        ]);
        let forward = a5.cross(&a4);
        let wrist_rows = Matrix3::from_rows(&[a4.transpose(), forward.transpose(), a5.transpose()]);
        let (thigh, calf) = (plane * (p[2] - p[1]), plane * (wrist - p[2]));
        let (thigh_length, calf_length) = (thigh.x.hypot(thigh.z), calf.x.hypot(calf.z));
        if thigh_length < AXIS_TOLERANCE || calf_length < AXIS_TOLERANCE {
            return None;
        }
        let (thigh_angle, calf_angle) = (thigh.z.atan2(thigh.x), calf.z.atan2(calf.x));
        let to_wheel = zero.base_from_foot.rotation.inverse();
        Some(LegIk {
            hip: p[0],
            plane_from_base: plane,
            wrist_from_plane: wrist_rows * plane.transpose(),
            shoulder: plane * (p[1] - p[0]),
            offset: (wrist - p[0]).dot(&a2),
            thigh: thigh_length,
            calf: calf_length,
            thigh_direction: Turn::of(thigh_angle),
            knee_zero: Turn::of(wrapped(thigh_angle - calf_angle)),
            axis_3_sign: a2.dot(&a3).signum(),
            wrist_zero: a6.dot(&forward).atan2(a6.dot(&a4)),
            axis_5_in_wheel: to_wheel * a5.into_inner(),
            axis_6_in_wheel: to_wheel * a6.into_inner(),
            wheel_from_wrist: zero.base_from_foot.inverse_transform_point(&wrist),
        })
    }

    pub(crate) fn scaled(&self, factor: f64) -> LegIk {
        LegIk {
            hip: self.hip * factor,
            shoulder: self.shoulder * factor,
            offset: self.offset * factor,
            thigh: self.thigh * factor,
            calf: self.calf * factor,
            wheel_from_wrist: self.wheel_from_wrist * factor,
            ..*self
        }
    }

    /// Greatest distance of the wheel's center from the first axis' reference point (m).
    pub fn reach(&self) -> f64 {
        self.shoulder.norm() + self.thigh + self.calf + self.wheel_from_wrist.coords.norm()
    }

    /// All branches that bring the wheel to `base_from_wheel`, within limits or not, in a fixed
    /// order; the error tells how far the wrist is out of reach.
    ///
    /// Where the wrist is singular (axes 4 and 6 in line) joint 4 is put to zero and one wrist
    /// branch is given; where the wrist lies on axis 1, joint 1 is put to zero.
    pub fn solve(
        &self,
        leg: &Leg,
        base_from_wheel: &Isometry3<f64>,
    ) -> Result<IkSolutions, NoSolution> {
        self.solve_frame(leg, &Frame::from(base_from_wheel), Wanted::All)
    }

    /// As [`solve`](Self::solve), but only what is within the limits, which costs less.
    pub fn solve_within(
        &self,
        leg: &Leg,
        base_from_wheel: &Frame,
    ) -> Result<IkSolutions, NoSolution> {
        self.solve_frame(leg, base_from_wheel, Wanted::WithinLimits(leg))
    }

    fn solve_frame(
        &self,
        leg: &Leg,
        base_from_wheel: &Frame,
        wanted: Wanted,
    ) -> Result<IkSolutions, NoSolution> {
        let all = matches!(wanted, Wanted::All);
        let axes = self.axes(base_from_wheel);
        let mut solutions = IkSolutions::new();
        for arm in &self.arms(&base_from_wheel.point(&self.wheel_from_wrist), wanted)? {
            let placed = arm.placed(leg);
            if all || placed.within_limits {
                let both = self.both_wrists(leg, arm, &placed, &axes, wanted);
                solutions.extend(both.into_iter().filter(|s| all || s.within_limits));
            }
        }
        Ok(solutions)
    }

    /// Of the solutions within the limits the first of those nearest to other angles, by the joint that
    /// differs most.
    pub fn solve_nearest(
        &self,
        leg: &Leg,
        base_from_wheel: &Frame,
        to: &LegAngles,
    ) -> Option<IkSolution> {
        let axes = self.axes(base_from_wheel);
        let wrist = base_from_wheel.point(&self.wheel_from_wrist);
        // What is near has nothing nearer among what is not.
        for angle in [NEAR, f64::INFINITY] {
            let wanted = Wanted::Near(leg, to, angle);
            let (mut nearest, mut least) = (None, f64::INFINITY);
            for arm in &self.arms(&wrist, wanted).ok()? {
                let placed = arm.placed(leg);
                for solution in self.both_wrists(leg, arm, &placed, &axes, wanted) {
                    let from = (solution.angles - to).amax();
                    if solution.within_limits && from < least {
                        (nearest, least) = (Some(solution), from);
                    }
                }
            }
            if nearest.is_some() && least <= angle {
                return nearest;
            }
        }
        None
    }

    /// As [`solve_nearest`](Self::solve_nearest) where the nearest solution is of a `branch` and surely the only
    /// one that is near; `None` is no answer.
    ///
    /// Two branches differ by twice the bend of the knee, or of the wrist, or by the angle between both yaws: while
    /// that is more than twice as much as this one differs by, all others differ by more.
    pub fn solve_branch(
        &self,
        leg: &Leg,
        base_from_wheel: &Frame,
        to: &LegAngles,
        branch: Branch,
    ) -> Option<IkSolution> {
        let from_hip = self.from_hip(&base_from_wheel.point(&self.wheel_from_wrist));
        let radius_squared = from_hip.x * from_hip.x + from_hip.y * from_hip.y;
        let offset_squared = self.offset * self.offset;
        let forward_squared = radius_squared - offset_squared;
        // Nothing is known of what is not a number.
        if !(forward_squared > 1e-24 && radius_squared >= 1e-24) {
            return None;
        }
        let forward = forward_squared.sqrt();
        let f = if branch.outward { forward } else { -forward };
        let yaw = self.yaw(&from_hip, f, radius_squared);
        let (x, w) = (f - self.shoulder.x, from_hip.z - self.shoulder.z);
        let bent = self.bent(x, w).ok()?;
        let knee = self.knee(&bent, branch.knee_flipped, Wanted::WithinLimits(leg))?;
        let arm = Arm::new(&yaw, knee, branch.outward);
        let placed = arm.placed(leg);
        let [axis_5, axis_6] = self.axes(base_from_wheel);
        let direction = self.wrist_from_plane * arm.unturn(&axis_6);
        let fork = self.fork(&direction);
        let bend = fork.bend(&direction);
        let q6 = self.last_joint(&arm, &axis_5, &direction, &bend);
        let wrist = if branch.wrist_flipped {
            [opposite(bend.q4), fork.q5[1]?, opposite(q6)]
        } else {
            [bend.q4, fork.q5[0]?, q6]
        };
        let solution = placed.with_wrist(leg, branch.wrist_flipped, wrist);
        // The sine of an angle is no more than the angle, and the cosine no less than one less half its square.
        let from = (solution.angles - to).amax() + LIMIT_SLACK;
        let is_only = from < bent.sine.min(fork.sine)
            && offset_squared - forward_squared < (1.0 - 2.0 * from * from) * radius_squared;
        (solution.within_limits && is_only).then_some(solution)
    }

    /// Axes 5 and 6 of a wheel in the plane's basis.
    fn axes(&self, base_from_wheel: &Frame) -> [Vector3<f64>; 2] {
        let turned = self.plane_from_base * base_from_wheel.rotation;
        [turned * self.axis_5_in_wheel, turned * self.axis_6_in_wheel]
    }

    /// Both wrist branches of an arm; one where the wrist is singular. Some that are not wanted are left out.
    #[inline]
    fn both_wrists(
        &self,
        leg: &Leg,
        arm: &Arm,
        placed: &IkSolution,
        [axis_5, axis_6]: &[Vector3<f64>; 2],
        wanted: Wanted,
    ) -> ArrayVec<IkSolution, 2> {
        let mut both = ArrayVec::new();
        let direction = self.wrist_from_plane * arm.unturn(axis_6);
        let mut fork = self.fork(&direction);
        fork.q5 = fork.q5.map(|q5| q5.filter(|q5| wanted.holds(4, *q5)));
        if fork.q5 == [None, None] {
            return both;
        }
        let bend = fork.bend(&direction);
        let q6 = self.last_joint(arm, axis_5, &direction, &bend);
        if let Some(q5) = fork.q5[0] {
            both.push(placed.with_wrist(leg, false, [bend.q4, q5, q6]));
        }
        if let Some(q5) = fork.q5[1] {
            let (q4, q6) = (opposite(bend.q4), opposite(q6));
            both.push(placed.with_wrist(leg, true, [q4, q5, q6]));
        }
        both
    }

    /// Joint 6 of the first wrist branch, for a direction of axis 5 in the plane's basis.
    #[inline]
    fn last_joint(
        &self,
        arm: &Arm,
        axis_5: &Vector3<f64>,
        direction: &Vector3<f64>,
        bend: &Bend,
    ) -> f64 {
        // Axis 5 and axis 6 × axis 5 where joints 4 and 5 turn them.
        let axle = Vector3::new(0.0, -bend.sin_4, bend.cos_4);
        let wanted = self.wrist_from_plane * arm.unturn(axis_5);
        atan2(wanted.dot(&direction.cross(&axle)), wanted.dot(&axle))
    }

    /// Where the wrist is in the wheel's frame.
    pub fn wheel_from_wrist(&self) -> Point3<f64> {
        self.wheel_from_wrist
    }

    /// How far a wrist misses what thigh and calf can reach (m), whatever the limits: where this is
    /// zero, and only there, [`solve`](Self::solve) has an answer.
    pub fn missed(&self, wrist: &Point3<f64>) -> f64 {
        self.missed_from_hip(&self.from_hip(wrist))
    }

    /// A point of the base as seen from the hip, in the plane (m).
    pub fn from_hip(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.along_plane(&(point - self.hip))
    }

    /// A direction of the base in the plane.
    pub fn along_plane(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.plane_from_base * direction
    }

    /// As [`missed`](Self::missed) for a wrist [as seen from the hip](Self::from_hip).
    #[inline]
    pub fn missed_from_hip(&self, from_hip: &Vector3<f64>) -> f64 {
        let radius_squared = from_hip.x * from_hip.x + from_hip.y * from_hip.y;
        let forward_squared = radius_squared - self.offset * self.offset;
        if forward_squared < 0.0 {
            return self.offset.abs() - radius_squared.sqrt();
        }
        let forward = forward_squared.sqrt();
        let w = from_hip.z - self.shoulder.z;
        let square = |f: f64| (f - self.shoulder.x) * (f - self.shoulder.x) + w * w;
        self.overreach(square(forward)).min(self.overreach(square(-forward)))
    }

    /// As [`missed_from_hip`](Self::missed_from_hip) for many wrists by their coordinates: the same without
    /// branches, so that several are found at once.
    #[inline]
    pub fn misses_from_hip<const N: usize>(
        &self,
        [xs, ys, zs]: &[[f64; N]; 3],
        misses: &mut [f64; N],
    ) {
        let (l1, l2) = (self.thigh, self.calf);
        let (longest, shortest) = (1.0 + ROUNDING, (l1 - l2).abs());
        let overreach = |square: f64| {
            let cosine = (square - l1 * l1 - l2 * l2) / (2.0 * l1 * l2);
            let distance = square.sqrt();
            let missed = if cosine > 0.0 { distance - l1 - l2 } else { shortest - distance };
            if cosine.abs() <= longest { 0.0 } else { missed }
        };
        for (((missed, x), y), z) in misses.iter_mut().zip(xs).zip(ys).zip(zs) {
            let radius_squared = x * x + y * y;
            let forward_squared = radius_squared - self.offset * self.offset;
            let forward = forward_squared.sqrt();
            let w = z - self.shoulder.z;
            let square = |f: f64| (f - self.shoulder.x) * (f - self.shoulder.x) + w * w;
            let (ahead, behind) = (overreach(square(forward)), overreach(square(-forward)));
            let least = if behind < ahead { behind } else { ahead };
            let beside = self.offset.abs() - radius_squared.sqrt();
            *missed = if forward_squared < 0.0 { beside } else { least };
        }
    }

    /// How far a wrist is beyond the reach of thigh and calf (m), from the square of its distance.
    #[inline]
    fn overreach(&self, square: f64) -> f64 {
        let (l1, l2) = (self.thigh, self.calf);
        let cosine = (square - l1 * l1 - l2 * l2) / (2.0 * l1 * l2);
        if cosine.abs() <= 1.0 + ROUNDING {
            return 0.0;
        }
        let distance = square.sqrt();
        if cosine > 0.0 { distance - l1 - l2 } else { (l1 - l2).abs() - distance }
    }

    /// As [`solve`](Self::solve) for a wheel center and the direction of the last axis, the spin
    /// about which is free: joint 6 is put to zero (or to its limit nearest to zero).
    pub fn solve_axis(
        &self,
        leg: &Leg,
        wheel_center: &Point3<f64>,
        axis: &Unit<Vector3<f64>>,
    ) -> Result<IkSolutions, NoSolution> {
        // What of the center as seen from the wrist lies across the last axis would turn with the
        // free spin, so this form asks for a center on that axis.
        let to_center = -self.wheel_from_wrist.coords.dot(&self.axis_6_in_wheel);
        let wrist = wheel_center - axis.into_inner() * to_center;
        let axis_6 = self.plane_from_base * axis.into_inner();
        let q6 = 0.0_f64.clamp(leg.lower[5], leg.upper[5]);
        let mut solutions = IkSolutions::new();
        for arm in self.arms(&wrist, Wanted::All)? {
            let placed = arm.placed(leg);
            let direction = self.wrist_from_plane * arm.unturn(&axis_6);
            let fork = self.fork(&direction);
            let bend = fork.bend(&direction);
            solutions.extend(fork.q5[0].map(|q5| placed.with_wrist(leg, false, [bend.q4, q5, q6])));
            if let Some(q5) = fork.q5[1] {
                solutions.push(placed.with_wrist(leg, true, [opposite(bend.q4), q5, q6]));
            }
        }
        Ok(solutions)
    }

    /// Hip and knee angles that bring the wrist to a point; those that are not wanted are left out.
    #[inline]
    fn arms(&self, wrist: &Point3<f64>, wanted: Wanted) -> Result<ArrayVec<Arm, 4>, NoSolution> {
        let from_hip = self.plane_from_base * (wrist - self.hip);
        let radius_squared = from_hip.x * from_hip.x + from_hip.y * from_hip.y;
        let forward_squared = radius_squared - self.offset * self.offset;
        if forward_squared < 0.0 {
            let distance = self.offset.abs() - radius_squared.sqrt();
            return Err(unreachable(distance, "nearer to the first axis than its offset"));
        }
        let forward = forward_squared.sqrt();
        let height = from_hip.z - self.shoulder.z;
        let mut arms = ArrayVec::new();
        let (mut nearest, mut is_reached) = (f64::INFINITY, false);
        let sides = if forward < 1e-12 { &[1.0][..] } else { &[1.0, -1.0][..] };
        for &side in sides {
            let f = side * forward;
            let yaw = if radius_squared < 1e-24 {
                Turn::of(0.0)
            } else {
                self.yaw(&from_hip, f, radius_squared)
            };
            let x = f - self.shoulder.x;
            if !wanted.holds(0, yaw.angle) {
                nearest = nearest.min(self.overreach(x * x + height * height));
                is_reached |= nearest <= 0.0;
                continue;
            }
            match self.knees(x, height, wanted) {
                Ok(knees) => {
                    is_reached = true;
                    arms.extend(knees.into_iter().map(|knee| Arm::new(&yaw, knee, side > 0.0)));
                }
                Err(distance) => nearest = nearest.min(distance),
            }
        }
        if !is_reached {
            return Err(unreachable(nearest, "outside the reach of thigh and calf"));
        }
        Ok(arms)
    }

    /// Joint 1 where the wrist lies `f` (m) before axis 1.
    #[inline]
    fn yaw(&self, from_hip: &Vector3<f64>, f: f64, radius_squared: f64) -> Turn {
        Turn::from_cos_sin(
            (from_hip.x * f + from_hip.y * self.offset) / radius_squared,
            (from_hip.y * f - from_hip.x * self.offset) / radius_squared,
        )
    }

    /// The two-link problem in the leg's plane, without what is not wanted; the error is the distance
    /// missed (m).
    #[inline]
    fn knees(&self, x: f64, w: f64, wanted: Wanted) -> Result<ArrayVec<Knee, 2>, f64> {
        let bent = self.bent(x, w)?;
        let mut knees = ArrayVec::new();
        knees.extend(self.knee(&bent, false, wanted));
        if bent.sine >= 1e-12 {
            knees.extend(self.knee(&bent, true, wanted));
        }
        Ok(knees)
    }

    /// How far the knee is bent where the wrist is at a place of the plane; the error is the distance missed (m).
    #[inline]
    fn bent(&self, x: f64, w: f64) -> Result<Bent, f64> {
        let (l1, l2) = (self.thigh, self.calf);
        let square = x * x + w * w;
        let cosine = (square - l1 * l1 - l2 * l2) / (2.0 * l1 * l2);
        if cosine.abs() > 1.0 + ROUNDING {
            return Err(self.overreach(square));
        }
        let cosine = cosine.clamp(-1.0, 1.0);
        let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
        Ok(Bent { x, w, square, bend: cosine.acos(), cosine, sine })
    }

    /// One branch of a bent knee, if it is wanted.
    #[inline]
    fn knee(&self, bent: &Bent, flipped: bool, wanted: Wanted) -> Option<Knee> {
        let (l1, l2) = (self.thigh, self.calf);
        let Bent { x, w, square, cosine, .. } = *bent;
        let (bend, sine) = if flipped { (-bent.bend, -bent.sine) } else { (bent.bend, bent.sine) };
        let (thigh, zero) = (&self.thigh_direction, &self.knee_zero);
        let knee_pitch = wrapped(wrapped(bend + zero.angle) * self.axis_3_sign);
        if !wanted.holds(2, knee_pitch) {
            return None;
        }
        // Where thigh and calf lead at hip pitch zero.
        let x0 = l1 * thigh.cos + l2 * (thigh.cos * cosine - thigh.sin * sine);
        let w0 = l1 * thigh.sin + l2 * (thigh.sin * cosine + thigh.cos * sine);
        let hip = if square > 0.0 {
            Turn::from_cos_sin((x * x0 + w * w0) / square, (w * x0 - x * w0) / square)
        } else {
            Turn::of(0.0)
        };
        if !wanted.holds(1, hip.angle) {
            return None;
        }
        let (ck, sk) = (zero.cos * cosine - zero.sin * sine, zero.sin * cosine + zero.cos * sine);
        let pitch = (hip.cos * ck - hip.sin * sk, hip.sin * ck + hip.cos * sk);
        Some(Knee { flipped, hip_pitch: hip.angle, knee_pitch, pitch })
    }

    /// Joint 5 of both branches that turn axis 6 into `direction` (in the wrist's basis).
    fn fork(&self, direction: &Vector3<f64>) -> Fork {
        let sine = (direction.y * direction.y + direction.z * direction.z).sqrt();
        let bend = sine.atan2(direction.x);
        let first = Some(wrapped(bend - self.wrist_zero));
        let second = (sine >= SINGULAR).then(|| wrapped(-bend - self.wrist_zero));
        Fork { sine, q5: [first, second] }
    }
}

impl Fork {
    /// Joint 4 of the first branch.
    fn bend(&self, direction: &Vector3<f64>) -> Bend {
        let sine = self.sine;
        if sine < SINGULAR {
            return Bend { q4: 0.0, cos_4: 1.0, sin_4: 0.0 };
        }
        Bend {
            q4: atan2(direction.z, direction.y),
            cos_4: direction.y / sine,
            sin_4: direction.z / sine,
        }
    }
}

fn unreachable(distance: f64, reason: &'static str) -> NoSolution {
    NoSolution { proof: Proof::Unreachable, distance, reason }
}

/// Half a turn on, in (-π, π].
fn opposite(angle: f64) -> f64 {
    if angle > 0.0 { angle - PI } else { angle + PI }
}

/// Sine of the wrist's bend, and joint 5 of both branches; one where the wrist is singular.
struct Fork {
    sine: f64,
    q5: [Option<f64>; 2],
}

/// Joint 4 of the first branch.
struct Bend {
    q4: f64,
    cos_4: f64,
    sin_4: f64,
}

/// A place of the wrist in the leg's plane (m), the square of its distance from axis 2, and how far the knee is
/// bent for it.
struct Bent {
    x: f64,
    w: f64,
    square: f64,
    bend: f64,
    cosine: f64,
    sine: f64,
}

/// One solution of the two-link problem, with cosine and sine of the sum of both turns.
struct Knee {
    flipped: bool,
    hip_pitch: f64,
    knee_pitch: f64,
    pitch: (f64, f64),
}

/// Joints 1 to 3 of one branch, and cosine and sine of the turns about axes 1 and 2.
struct Arm {
    branch: Branch,
    angles: [f64; 3],
    yaw: (f64, f64),
    pitch: (f64, f64),
}

impl Arm {
    #[inline]
    fn new(yaw: &Turn, knee: Knee, outward: bool) -> Arm {
        Arm {
            branch: Branch { outward, knee_flipped: knee.flipped, wrist_flipped: false },
            angles: [yaw.angle, knee.hip_pitch, knee.knee_pitch],
            yaw: (yaw.cos, yaw.sin),
            pitch: knee.pitch,
        }
    }

    /// A direction in the plane's basis with the turns of joints 1 to 3 undone.
    fn unturn(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let ((c1, s1), (c2, s2)) = (self.yaw, self.pitch);
        let (x, y) = (v.x * c1 + v.y * s1, v.y * c1 - v.x * s1);
        Vector3::new(x * c2 + v.z * s2, y, v.z * c2 - x * s2)
    }

    /// A solution whose joints 4 to 6 are still to be filled in.
    fn placed(&self, leg: &Leg) -> IkSolution {
        let mut solution = IkSolution {
            angles: LegAngles::zeros(),
            branch: self.branch,
            within_limits: true,
            residual: None,
        };
        for (i, q) in self.angles.into_iter().enumerate() {
            solution.place(leg, i, q);
        }
        solution
    }
}

impl IkSolution {
    fn with_wrist(&self, leg: &Leg, wrist_flipped: bool, wrist: [f64; 3]) -> IkSolution {
        let mut solution = *self;
        solution.branch.wrist_flipped = wrist_flipped;
        for (i, q) in wrist.into_iter().enumerate() {
            solution.place(leg, 3 + i, q);
        }
        solution
    }

    /// Joint `i` at `q` in (-π, π], or a whole turn from there if only that is within its limits.
    fn place(&mut self, leg: &Leg, i: usize, q: f64) {
        let fitted = fitted(leg, i, q);
        self.angles[i] = fitted.unwrap_or(q);
        self.within_limits &= fitted.is_some();
    }
}

/// An angle of joint `i` within its limits that is `q` in (-π, π] or a whole turn from there.
fn fitted(leg: &Leg, i: usize, q: f64) -> Option<f64> {
    let (lower, upper) = (leg.lower[i], leg.upper[i]);
    let inside = |q: f64| q >= lower - LIMIT_SLACK && q <= upper + LIMIT_SLACK;
    let other = if q > 0.0 { q - TAU } else { q + TAU };
    let q = [q, other].into_iter().find(|q| inside(*q))?;
    Some(q.max(lower).min(upper))
}

type Line = (Point3<f64>, Unit<Vector3<f64>>);

fn intersection(a: &Line, b: &Line) -> Option<Point3<f64>> {
    let normal = a.1.cross(&b.1);
    let denominator = normal.norm_squared();
    if denominator < AXIS_TOLERANCE {
        return None;
    }
    let between = b.0 - a.0;
    let on_a = a.0 + a.1.into_inner() * (between.cross(&b.1).dot(&normal) / denominator);
    let on_b = b.0 + b.1.into_inner() * (between.cross(&a.1).dot(&normal) / denominator);
    ((on_a - on_b).norm() < AXIS_TOLERANCE).then_some(on_a)
}
