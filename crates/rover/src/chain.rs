//! One leg's kinematics made fast: what moves while the base stands.
//!
//! The same forward kinematics as [`Posture`] (tests hold them together), as matrices, for the
//! planners' inner loops; and how far a point of the leg can get when the joints move a little.

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::model::{JointKind, LegId, LinkId, Robot};
use crate::posture::{LegAngles, Posture};

/// A rigid pose as matrix and origin: `p_outer = rotation * p_inner + origin`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Rotation.
    pub rotation: Matrix3<f64>,
    /// Where the inner frame's origin is (m).
    pub origin: Vector3<f64>,
}

impl Frame {
    /// The pose that changes nothing.
    pub fn identity() -> Frame {
        Frame { rotation: Matrix3::identity(), origin: Vector3::zeros() }
    }

    /// A point of the inner frame in the outer one.
    #[inline]
    pub fn point(&self, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * p.coords + self.origin)
    }

    /// First `inner`, then this.
    #[inline]
    pub fn after(&self, inner: &Frame) -> Frame {
        Frame {
            rotation: self.rotation * inner.rotation,
            origin: self.rotation * inner.origin + self.origin,
        }
    }

    /// The way back.
    pub fn inverse(&self) -> Frame {
        let back = self.rotation.transpose();
        Frame { rotation: back, origin: -(back * self.origin) }
    }

    /// The same as an isometry.
    pub fn to_isometry(&self) -> Isometry3<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        Isometry3::from_parts(self.origin.into(), UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

impl From<&Isometry3<f64>> for Frame {
    fn from(pose: &Isometry3<f64>) -> Frame {
        Frame {
            rotation: pose.rotation.to_rotation_matrix().into_inner(),
            origin: pose.translation.vector,
        }
    }
}

/// Places of a leg; a leg of fewer joints is padded.
const PLACES: usize = 6;

/// A leg whose base stands: joint angles in, link frames out.
#[derive(Debug, Clone)]
pub struct LegChain {
    world_from_parent: Frame,
    joints: ArrayVec<ChainJoint, PLACES>,
    /// Mass (kg) and first moment (kg m, in the link's frame) that each link of the leg carries.
    masses: [(f64, Vector3<f64>); PLACES],
    /// First moment of the rest of the robot in `world` (kg m).
    fixed_moment: Vector3<f64>,
    total_mass: f64,
    com_levers: LegAngles,
}

#[derive(Debug, Clone, Copy)]
struct ChainJoint {
    /// Where the joint is in the link before; no rotation is the usual case.
    origin: Vector3<f64>,
    rotation: Option<Matrix3<f64>>,
    axis: Axis,
    /// Longest way of a prismatic joint from zero (m); none for one that turns.
    stroke: Option<f64>,
}

/// A joint's axis: along a coordinate axis (which is quick) or not.
#[derive(Debug, Clone, Copy)]
enum Axis {
    /// Index of the coordinate axis, and +1 or -1.
    Along(usize, f64),
    Any(Unit<Vector3<f64>>),
}

/// Where the links of a leg are in `world`, and the axes that they turn about.
#[derive(Debug, Clone, Copy)]
pub struct LegFrames {
    /// By place from the hip outward; beyond the last joint the last link again.
    pub links: [Frame; PLACES],
    /// Direction of each joint's axis; the axis goes through the origin of its link.
    pub axes: [Vector3<f64>; PLACES],
    /// True for prismatic joints.
    pub slides: [bool; PLACES],
    /// The joint angles (rad; m for a prismatic joint) that gave all this; no numbers where they are not known.
    pub angles: LegAngles,
}

impl LegChain {
    /// Prepares `leg` with the rest of the robot as in `posture`.
    pub fn new(robot: &Robot, posture: &Posture, leg: LegId) -> LegChain {
        let model = robot.leg(leg);
        let mut masses = [(0.0, Vector3::zeros()); PLACES];
        let mut fixed_moment = Vector3::zeros();
        let mut total_mass = 0.0;
        for (i, link) in robot.links().iter().enumerate() {
            total_mass += link.mass;
            match place_of(robot, leg, LinkId(i)) {
                Some((place, place_from_link)) => {
                    masses[place].0 += link.mass;
                    masses[place].1 += (place_from_link * link.com).coords * link.mass;
                }
                None => fixed_moment += (posture.link(LinkId(i)) * link.com).coords * link.mass,
            }
        }
        let in_a_row = robot.chain_of(model);
        let joints = in_a_row.joints.iter().enumerate().map(|(place, joint)| {
            let link_from_joint = &joint.link_from_joint;
            let turned = link_from_joint.rotation.angle() > 0.0;
            let slides = joint.kind == JointKind::Prismatic;
            ChainJoint {
                origin: link_from_joint.translation.vector,
                rotation: turned
                    .then(|| link_from_joint.rotation.to_rotation_matrix().into_inner()),
                axis: Axis::of(&joint.axis),
                stroke: slides.then(|| model.lower[place].abs().max(model.upper[place].abs())),
            }
        });
        let mut chain = LegChain {
            world_from_parent: Frame::from(posture.link(LinkId(0))),
            joints: joints.collect(),
            masses,
            fixed_moment,
            total_mass,
            com_levers: LegAngles::zeros(),
        };
        chain.com_levers = chain.levers_of_com();
        chain
    }

    /// Forward kinematics.
    #[inline]
    pub fn frames(&self, angles: &LegAngles) -> LegFrames {
        self.frames_on(&self.world_from_parent, angles)
    }

    /// As [`frames`](Self::frames) with the base elsewhere.
    pub(crate) fn frames_on(&self, world_from_base: &Frame, angles: &LegAngles) -> LegFrames {
        let mut frames = LegFrames {
            links: [*world_from_base; PLACES],
            axes: [Vector3::zeros(); PLACES],
            slides: [false; PLACES],
            angles: *angles,
        };
        let mut parent = *world_from_base;
        for (place, joint) in self.joints.iter().enumerate() {
            parent.origin += parent.rotation * joint.origin;
            if let Some(rotation) = &joint.rotation {
                parent.rotation *= rotation;
            }
            frames.axes[place] = joint.axis.direction(&parent.rotation);
            frames.slides[place] = joint.stroke.is_some();
            if frames.slides[place] {
                parent.origin += frames.axes[place] * angles[place];
            } else {
                joint.axis.turn(&mut parent.rotation, angles[place]);
            }
            frames.links[place] = parent;
        }
        frames.links[self.joints.len()..].fill(parent);
        frames
    }

    /// Center of mass of the whole robot, in `world` (m).
    pub fn center_of_mass(&self, frames: &LegFrames) -> Point3<f64> {
        if self.total_mass <= 0.0 {
            return Point3::from(self.world_from_parent.origin);
        }
        let mut moment = self.fixed_moment;
        for (link, (mass, first)) in frames.links.iter().zip(&self.masses) {
            moment += link.rotation * first + link.origin * *mass;
        }
        Point3::from(moment / self.total_mass)
    }

    /// How far the center of mass can move when joint i moves by `change[i]` (rad, or m of a
    /// prismatic joint) (m).
    pub fn com_motion(&self, change: &LegAngles) -> f64 {
        self.com_levers.dot(&change.abs())
    }

    /// For each joint the largest distance, at any angles, of the moved masses' center from its
    /// axis, times their share of the robot's mass; for a prismatic joint that share itself.
    fn levers_of_com(&self) -> LegAngles {
        let mut levers = LegAngles::zeros();
        if self.total_mass <= 0.0 {
            return levers;
        }
        // From the wheel inward: the first moment that hangs on a joint is at most what hangs on
        // the next one, carried at that joint's origin, plus its own link's.
        let (mut mass, mut moment) = (0.0, 0.0);
        for (place, joint) in self.joints.iter().enumerate().rev() {
            mass += self.masses[place].0;
            moment += self.masses[place].1.norm();
            let lever = if joint.stroke.is_some() { mass } else { moment };
            levers[place] = lever / self.total_mass;
            moment += mass * (joint.origin.norm() + joint.stroke.unwrap_or(0.0));
        }
        levers
    }
}

impl LegFrames {
    /// How far any point of a body can get from where it is now while joint i turns by up to
    /// `change[i]` (rad, not negative) either way, as seen from the link at place `since` - 1 (from
    /// the base if 0).
    ///
    /// The body hangs on the link at `place` and lies within `radius` of the segment from `a` to
    /// `b` (`world`, m). Turned one after the other from the last joint inward, each joint adds no
    /// more than its angle times the distance of the body from its axis, which by then has grown
    /// by what the joints before it have added; a prismatic joint adds its way (m).
    #[inline]
    pub fn motion_bound(
        &self,
        place: usize,
        since: usize,
        [a, b]: [&Point3<f64>; 2],
        radius: f64,
        change: &LegAngles,
    ) -> f64 {
        let mut bound = 0.0;
        for joint in (since..=place).rev() {
            let angle = change[joint];
            if angle > 0.0 && self.slides[joint] {
                bound += angle;
            } else if angle > 0.0 {
                let (axis, origin) = (&self.axes[joint], &self.links[joint].origin);
                let from_axis = |p: &Point3<f64>| axis.cross(&(p.coords - origin)).norm_squared();
                let lever = from_axis(a).max(from_axis(b)).sqrt() + radius;
                bound += angle * (lever + bound);
            }
        }
        bound
    }
}

impl Axis {
    fn of(axis: &Unit<Vector3<f64>>) -> Axis {
        (0..3)
            .find(|i| (axis[*i].abs() - 1.0).abs() < 1e-15)
            .map_or(Axis::Any(*axis), |i| Axis::Along(i, axis[i].signum()))
    }

    fn direction(&self, rotation: &Matrix3<f64>) -> Vector3<f64> {
        match self {
            Axis::Along(i, sign) => rotation.column(*i) * *sign,
            Axis::Any(axis) => rotation * axis.into_inner(),
        }
    }

    /// `rotation`, then a turn about the axis.
    #[inline]
    fn turn(&self, rotation: &mut Matrix3<f64>, angle: f64) {
        // By column, so that where each number is in memory is known beforehand.
        let mix = |m: &mut Matrix3<f64>, j: usize, k: usize, angle: f64| {
            let (sin, cos) = angle.sin_cos();
            for row in 0..3 {
                let (a, b) = (m[(row, j)], m[(row, k)]);
                m[(row, j)] = a * cos + b * sin;
                m[(row, k)] = b * cos - a * sin;
            }
        };
        match self {
            Axis::Along(0, sign) => mix(rotation, 1, 2, sign * angle),
            Axis::Along(1, sign) => mix(rotation, 2, 0, sign * angle),
            Axis::Along(_, sign) => mix(rotation, 0, 1, sign * angle),
            Axis::Any(axis) => *rotation *= Rotation3::from_axis_angle(axis, angle).into_inner(),
        }
    }
}

/// The place of the leg that carries `link`, and where the link is in that place's frame; `None`
/// for links of the base or of another leg. Joints that are no part of the leg stay at zero.
pub fn place_of(robot: &Robot, leg: LegId, link: LinkId) -> Option<(usize, Isometry3<f64>)> {
    let links = &robot.leg(leg).links;
    let mut place_from_link = Isometry3::identity();
    let mut at = link;
    loop {
        if let Some(place) = links.iter().position(|l| *l == at) {
            return Some((place, place_from_link));
        }
        let joint = &robot.joints()[robot.links()[at.0].parent_joint?];
        place_from_link = joint.parent_from_joint * place_from_link;
        at = joint.parent;
    }
}
