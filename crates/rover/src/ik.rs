//! Closed-form inverse kinematics of a leg that ends in a spherical wrist.
//!
//! The leg is recognized by its joint axes at angle zero: axis 2 perpendicular to axis 1, axis 3
//! parallel to axis 2, and axes 4 to 6 meeting in one point (the *wrist*) with axis 5
//! perpendicular to axes 4 and 6. Then the wrist's position depends on joints 1 to 3 alone
//! (Pieper's decomposition): two hip-yaw branches times two knee branches, and two wrist branches
//! each: 8 at most (H23, F44). Joints 4 to 6 follow from the orientation.
//!
//! Everything is in the frame of the leg's base link, by the product of exponentials: the pose at
//! joint angles q is R₁(q₁)…R₆(q₆) applied to the pose at zero.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};

use geometry::{within_limits, wrap_to_pi};

use crate::model::{Joint, Leg};
use crate::posture::LegAngles;

/// How far axes may miss being parallel, perpendicular or concurrent (rad, m at scale 1).
const AXIS_TOLERANCE: f64 = 1e-9;

/// Joint angles beyond a limit by rounding alone count as on the limit (rad).
const LIMIT_SLACK: f64 = 1e-9;

/// Sine of the wrist's bend below which joints 4 and 6 turn about the same axis.
const SINGULAR: f64 = 1e-9;

/// Which of the up to eight solutions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Branch {
    /// The wrist lies on the leg's outward side of the first axis.
    pub outward: bool,
    /// The second branch of the knee.
    pub knee_flipped: bool,
    /// The second branch of the wrist.
    pub wrist_flipped: bool,
}

/// Joint angles that bring the wheel where it was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSolution {
    /// Joint angles (rad), each the representative within its limits where there is one.
    pub angles: LegAngles,
    /// Which branch.
    pub branch: Branch,
    /// True if all joints are within their limits.
    pub within_limits: bool,
}

/// Why no branch exists: the wrist is out of reach, whatever the limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unreachable {
    /// How far the wrist misses its reachable shell (m).
    pub distance: f64,
    /// What it misses.
    pub reason: &'static str,
}

/// The closed form of one leg, in the frame of the leg's base link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegIk {
    /// A point on axis 1, its direction, and the directions of axes 2 and 4 to 6, all at zero.
    hip: Point3<f64>,
    axis_1: Unit<Vector3<f64>>,
    axis_2: Unit<Vector3<f64>>,
    axis_4: Unit<Vector3<f64>>,
    axis_5: Unit<Vector3<f64>>,
    axis_6: Unit<Vector3<f64>>,
    /// +1 if axis 3 points along axis 2, -1 if against it.
    axis_3_sign: f64,
    /// A point on axis 2, for in-plane coordinates.
    shoulder: Point3<f64>,
    /// Offset of the wrist from axis 1 along axis 2 (m).
    offset: f64,
    /// Axis 2 to axis 3, axis 3 to wrist, in the leg's plane at zero: (length, angle).
    thigh: (f64, f64),
    calf: (f64, f64),
    /// Wheel pose at zero, and the wrist in the wheel's frame.
    zero_wheel: Isometry3<f64>,
    wheel_from_wrist: Point3<f64>,
}

impl LegIk {
    /// Recognizes the leg from its joints; `Err` says which property is missing.
    pub(crate) fn new(
        joints: &[&Joint; 6],
        carrier_from_wheel: &Isometry3<f64>,
    ) -> Result<LegIk, &'static str> {
        let mut frame = Isometry3::identity();
        let mut axes = [(Point3::origin(), Vector3::x_axis()); 6];
        for (axis, joint) in axes.iter_mut().zip(joints) {
            frame *= joint.parent_from_joint;
            *axis = (frame * Point3::origin(), frame.rotation * joint.axis);
        }
        let [a1, a2, a3, a4, a5, a6] = axes;
        let perpendicular =
            |a: &Unit<Vector3<f64>>, b: &Unit<Vector3<f64>>| a.dot(b).abs() < AXIS_TOLERANCE;
        if !perpendicular(&a1.1, &a2.1) {
            return Err("its second axis is not perpendicular to its first");
        }
        if a2.1.cross(&a3.1).norm() > AXIS_TOLERANCE {
            return Err("its third axis is not parallel to its second");
        }
        if !perpendicular(&a4.1, &a5.1) || !perpendicular(&a5.1, &a6.1) {
            return Err("its wrist axes are not perpendicular to each other");
        }
        // The wrist is where axes 4 and 5 meet; axis 6 must pass through it.
        let wrist = intersection(&a4, &a5).ok_or("its fourth and fifth axes do not meet")?;
        if (wrist - a6.0).cross(&a6.1).norm() > AXIS_TOLERANCE {
            return Err("its sixth axis does not pass through its wrist");
        }
        let zero_wheel = frame * carrier_from_wheel;
        let plane = Plane::new(&a1.1, &a2.1);
        let thigh = plane.polar(&(a3.0 - a2.0));
        let calf = plane.polar(&(wrist - a3.0));
        if thigh.0 < AXIS_TOLERANCE || calf.0 < AXIS_TOLERANCE {
            return Err("its thigh or calf has no length");
        }
        Ok(LegIk {
            hip: a1.0,
            axis_1: a1.1,
            axis_2: a2.1,
            axis_4: a4.1,
            axis_5: a5.1,
            axis_6: a6.1,
            axis_3_sign: a2.1.dot(&a3.1).signum(),
            shoulder: a2.0,
            offset: (wrist - a1.0).dot(&a2.1),
            thigh,
            calf,
            zero_wheel,
            wheel_from_wrist: zero_wheel.inverse_transform_point(&wrist),
        })
    }

    pub(crate) fn scaled(&self, factor: f64) -> LegIk {
        LegIk {
            hip: self.hip * factor,
            shoulder: self.shoulder * factor,
            offset: self.offset * factor,
            thigh: (self.thigh.0 * factor, self.thigh.1),
            calf: (self.calf.0 * factor, self.calf.1),
            zero_wheel: crate::shape::scaled_isometry(&self.zero_wheel, factor),
            wheel_from_wrist: self.wheel_from_wrist * factor,
            ..*self
        }
    }

    /// Greatest distance of the wheel's center from the first axis' reference point (m).
    pub fn reach(&self) -> f64 {
        (self.shoulder - self.hip).norm()
            + self.thigh.0
            + self.calf.0
            + self.wheel_from_wrist.coords.norm()
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
    ) -> Result<Vec<IkSolution>, Unreachable> {
        let wrist = base_from_wheel * self.wheel_from_wrist;
        let mut solutions = Vec::with_capacity(8);
        for arm in self.solve_arm(&wrist)? {
            let turned = self.arm_rotation(&arm).inverse()
                * base_from_wheel.rotation
                * self.zero_wheel.rotation.inverse();
            for (wrist_flipped, wrist_angles) in self.solve_wrist(&turned) {
                solutions.push(finish(leg, &arm, wrist_flipped, wrist_angles));
            }
        }
        Ok(solutions)
    }

    /// As [`solve`](Self::solve) for a wheel center and the direction of the last axis, the spin
    /// about which is free: joint 6 is put to zero (or to its limit nearest to zero).
    pub fn solve_axis(
        &self,
        leg: &Leg,
        wheel_center: &Point3<f64>,
        axis: &Unit<Vector3<f64>>,
    ) -> Result<Vec<IkSolution>, Unreachable> {
        // The wheel center as seen from the wrist, split along the last axis at zero: what lies
        // across it would turn with the free spin, so this form asks for a center on that axis.
        let to_center = self.zero_wheel * -self.wheel_from_wrist.coords;
        let wrist = wheel_center - axis.into_inner() * to_center.dot(&self.axis_6);
        let mut solutions = Vec::with_capacity(8);
        for arm in self.solve_arm(&wrist)? {
            let direction = self.arm_rotation(&arm).inverse() * axis;
            let spin = 0.0_f64.clamp(leg.lower[5], leg.upper[5]);
            for (wrist_flipped, q4, q5) in self.point_wrist(&direction) {
                solutions.push(finish(leg, &arm, wrist_flipped, [q4, q5, spin]));
            }
        }
        Ok(solutions)
    }

    /// Hip and knee angles that bring the wrist to a point.
    fn solve_arm(&self, wrist: &Point3<f64>) -> Result<Vec<Arm>, Unreachable> {
        let plane = Plane::new(&self.axis_1, &self.axis_2);
        let from_hip = wrist - self.hip;
        let (vx, vy) = (from_hip.dot(&plane.x), from_hip.dot(&self.axis_2));
        let radius_squared = vx * vx + vy * vy;
        let forward_squared = radius_squared - self.offset * self.offset;
        if forward_squared < 0.0 {
            let distance = self.offset.abs() - radius_squared.sqrt();
            return Err(Unreachable {
                distance,
                reason: "nearer to the first axis than its offset",
            });
        }
        let forward = forward_squared.sqrt();
        let bearing = if radius_squared < 1e-24 { 0.0 } else { vy.atan2(vx) };
        let shoulder = self.shoulder - self.hip;
        let height = from_hip.dot(&plane.w) - shoulder.dot(&plane.w);
        let mut arms = Vec::with_capacity(4);
        let mut nearest = f64::INFINITY;
        let sides = if forward < 1e-12 { &[1.0][..] } else { &[1.0, -1.0][..] };
        for &side in sides {
            let hip_yaw = wrap_to_pi(bearing - self.offset.atan2(side * forward));
            let target = (side * forward - shoulder.dot(&plane.x), height);
            match self.solve_plane(target) {
                Ok(knees) => {
                    for (knee_flipped, hip_pitch, knee_pitch) in knees {
                        let angles = [hip_yaw, hip_pitch, knee_pitch];
                        arms.push(Arm { outward: side > 0.0, knee_flipped, angles });
                    }
                }
                Err(distance) => nearest = nearest.min(distance),
            }
        }
        if arms.is_empty() {
            let reason = "outside the reach of thigh and calf";
            return Err(Unreachable { distance: nearest, reason });
        }
        Ok(arms)
    }

    /// The two-link problem in the leg's plane; the error is the distance missed (m).
    fn solve_plane(&self, (x, w): (f64, f64)) -> Result<Vec<(bool, f64, f64)>, f64> {
        let ((l1, angle_1), (l2, angle_2)) = (self.thigh, self.calf);
        let distance = x.hypot(w);
        let cosine = (distance * distance - l1 * l1 - l2 * l2) / (2.0 * l1 * l2);
        if cosine.abs() > 1.0 + 1e-12 {
            return Err(if cosine > 0.0 { distance - l1 - l2 } else { (l1 - l2).abs() - distance });
        }
        let bend = cosine.clamp(-1.0, 1.0).acos();
        let straight = bend.sin() < 1e-12;
        let flips = if straight { &[false][..] } else { &[false, true][..] };
        Ok(flips
            .iter()
            .map(|&flipped| {
                let bend = if flipped { -bend } else { bend };
                let knee = bend - angle_2 + angle_1;
                let (s, c) = (angle_2 + knee).sin_cos();
                let (x0, w0) = (l1 * angle_1.cos() + l2 * c, l1 * angle_1.sin() + l2 * s);
                let hip = w.atan2(x) - w0.atan2(x0);
                (flipped, wrap_to_pi(hip), wrap_to_pi(knee * self.axis_3_sign))
            })
            .collect())
    }

    fn arm_rotation(&self, arm: &Arm) -> UnitQuaternion<f64> {
        let [q1, q2, q3] = arm.angles;
        UnitQuaternion::from_axis_angle(&self.axis_1, q1)
            * UnitQuaternion::from_axis_angle(&self.axis_2, q2 + q3 * self.axis_3_sign)
    }

    /// Joints 4 and 5 that turn axis 6 into `direction`.
    fn point_wrist(&self, direction: &Unit<Vector3<f64>>) -> Vec<(bool, f64, f64)> {
        let forward = self.axis_5.cross(&self.axis_4);
        let zero = self.axis_6.dot(&forward).atan2(self.axis_6.dot(&self.axis_4));
        let (along, across, side) =
            (direction.dot(&self.axis_4), direction.dot(&forward), direction.dot(&self.axis_5));
        let sine = across.hypot(side);
        if sine < SINGULAR {
            return vec![(false, 0.0, wrap_to_pi(sine.atan2(along) - zero))];
        }
        let bend = sine.atan2(along);
        vec![
            (false, side.atan2(across), wrap_to_pi(bend - zero)),
            (true, (-side).atan2(-across), wrap_to_pi(-bend - zero)),
        ]
    }

    /// Joints 4 to 6 whose product is `turned`.
    fn solve_wrist(&self, turned: &UnitQuaternion<f64>) -> Vec<(bool, [f64; 3])> {
        let direction = turned * self.axis_6;
        self.point_wrist(&direction)
            .into_iter()
            .map(|(flipped, q4, q5)| {
                let so_far = UnitQuaternion::from_axis_angle(&self.axis_4, q4)
                    * UnitQuaternion::from_axis_angle(&self.axis_5, q5);
                let rest = so_far.inverse() * turned * self.axis_5.into_inner();
                let across = self.axis_6.cross(&self.axis_5);
                (flipped, [q4, q5, rest.dot(&across).atan2(rest.dot(&self.axis_5))])
            })
            .collect()
    }
}

/// Joints 1 to 3 of one branch.
struct Arm {
    outward: bool,
    knee_flipped: bool,
    angles: [f64; 3],
}

/// The leg's plane at hip yaw zero: x outward, w against axis 1, so that a positive turn about
/// axis 2 goes from x to w.
struct Plane {
    x: Vector3<f64>,
    w: Vector3<f64>,
}

impl Plane {
    fn new(axis_1: &Unit<Vector3<f64>>, axis_2: &Unit<Vector3<f64>>) -> Plane {
        Plane { x: axis_2.cross(axis_1), w: -axis_1.into_inner() }
    }

    fn polar(&self, v: &Vector3<f64>) -> (f64, f64) {
        let (x, w) = (v.dot(&self.x), v.dot(&self.w));
        (x.hypot(w), w.atan2(x))
    }
}

fn finish(leg: &Leg, arm: &Arm, wrist_flipped: bool, wrist: [f64; 3]) -> IkSolution {
    let raw = [arm.angles[0], arm.angles[1], arm.angles[2], wrist[0], wrist[1], wrist[2]];
    let mut angles = LegAngles::zeros();
    let mut inside = true;
    for (i, q) in raw.into_iter().enumerate() {
        match within_limits(q, leg.lower[i], leg.upper[i], LIMIT_SLACK) {
            Some(q) => angles[i] = q,
            None => {
                inside = false;
                angles[i] = wrap_to_pi(q);
            }
        }
    }
    let branch = Branch { outward: arm.outward, knee_flipped: arm.knee_flipped, wrist_flipped };
    IkSolution { angles, branch, within_limits: inside }
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
