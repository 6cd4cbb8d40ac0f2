//! A leg's joints in a row, with what is fixed between them folded in.

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::model::JointKind;
use crate::posture::LegAngles;
use crate::shape::scaled_isometry;

/// One joint: revolute or prismatic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ChainJoint {
    /// Pose of the joint in the link that the joint before it carries (in the base for the first).
    pub link_from_joint: Isometry3<f64>,
    /// Axis in the joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// How it moves.
    pub kind: JointKind,
}

/// The joints of a leg from the hip outward, and its foot.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Chain {
    pub joints: ArrayVec<ChainJoint, 6>,
    /// Center of the wheel or of the ball foot in the last link.
    pub link_from_foot: Isometry3<f64>,
}

/// Where the joints and the foot are at some angles, in the base.
pub(crate) struct ChainPose {
    /// A point on each joint's axis.
    pub points: [Point3<f64>; 6],
    /// Direction of each joint's axis.
    pub axes: [Unit<Vector3<f64>>; 6],
    pub base_from_foot: Isometry3<f64>,
}

impl Chain {
    pub fn pose(&self, angles: &LegAngles) -> ChainPose {
        let mut points = [Point3::origin(); 6];
        let mut axes = [Vector3::x_axis(); 6];
        let mut frame = Isometry3::identity();
        for (i, joint) in self.joints.iter().enumerate() {
            frame *= joint.link_from_joint;
            points[i] = frame.translation.vector.into();
            axes[i] = frame.rotation * joint.axis;
            frame = joint.kind.moved(frame, &joint.axis, angles[i]);
        }
        ChainPose { points, axes, base_from_foot: frame * self.link_from_foot }
    }

    pub fn scaled(&self, factor: f64) -> Chain {
        let mut chain = self.clone();
        for joint in &mut chain.joints {
            joint.link_from_joint = scaled_isometry(&joint.link_from_joint, factor);
        }
        chain.link_from_foot = scaled_isometry(&chain.link_from_foot, factor);
        chain
    }
}
