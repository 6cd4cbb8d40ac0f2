//! How a leg gives way under load: joints and tire as springs in series.
//!
//! With the joints' stiffnesses on the diagonal of `K`, the Jacobian `J` of the contact over the joints
//! and a tire that gives way by 1/t to every side, a force `f` on the foot moves the contact by `C f`
//! against the base, `C = J K⁻¹ Jᵀ + 1/t` (Salisbury, IEEE CDC 1980, for joints; springs in series).
//! Links are rigid, and the own weight of the leg does not enter: deflections are counted from the
//! posture at hand.
//!
//! Frame `world`, meters, newtons, radians.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::model::{JointKind, LegId, Robot};
use crate::posture::{LegAngles, Posture};

/// Stiffness of joints and tires, and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// Stiffness of a leg's joints from the hip outward (N m/rad; N/m of prismatic ones), and of its
    /// tire (N/m; infinite for a rigid one). None where a single figure stands for the whole leg.
    pub springs: Option<(LegAngles, f64)>,
    /// Stiffness is within this share of what it is said to be, 0 to below 1.
    pub stiffness_error: f64,
    /// Heights at which feet were put down are within this (m); none where they are taken to be within a
    /// fifth of the deflection of a leg under its part of the weight.
    pub touchdown_error: Option<f64>,
}

impl Compliance {
    /// Loads stay and lengths scale, so that every deflection keeps its share of the leg: torques and
    /// joint stiffness grow with the factor; what is load over length falls with it.
    pub(crate) fn scaled(&self, factor: f64, is_prismatic: impl Fn(usize) -> bool) -> Compliance {
        let springs = self.springs.map(|(joints, tire)| {
            let scaled = |place: usize, k: f64| match is_prismatic(place) {
                true => k / factor,
                false => k * factor,
            };
            let places = joints.iter().enumerate();
            (LegAngles::from_iterator(places.map(|(i, k)| scaled(i, *k))), tire / factor)
        });
        let touchdown_error = self.touchdown_error.map(|error| error * factor);
        Compliance { springs, touchdown_error, ..*self }
    }
}

/// How far (m) the contact of a leg moves against the base per newton on it, to all sides: the matrix
/// `C` of the file's header. `None` where the robot tells one figure for the whole leg.
pub fn leg_compliance(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    contact: &Point3<f64>,
) -> Option<Matrix3<f64>> {
    let (stiffness, tire) = robot.compliance().springs?;
    let model = robot.leg(leg);
    let joints = (0..model.n_joints()).map(|place| {
        let joint = &robot.joints()[model.joints[place]];
        // The joint's origin and axis are fixed in its child link, whatever its angle.
        let frame = posture.link(model.links[place]);
        let axis: Vector3<f64> = frame.rotation * joint.axis.into_inner();
        let way = match joint.kind {
            JointKind::Prismatic => axis,
            _ => axis.cross(&(contact.coords - frame.translation.vector)),
        };
        way * way.transpose() / stiffness[place]
    });
    Some(joints.sum::<Matrix3<f64>>() + Matrix3::identity() / tire)
}

/// Vertical load over deflection (N/m) of a leg whose foot is free to give way sideward: from its joints
/// and tire in this posture, else the robot's single figure.
pub fn vertical_stiffness(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    contact: &Point3<f64>,
) -> f64 {
    let springs = leg_compliance(robot, posture, leg, contact);
    springs.map_or(robot.stance().leg_stiffness, |compliance| 1.0 / compliance[(2, 2)])
}
