//! Forward and inverse kinematics.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::scene::{Pose, RoverState, Scene};

/// `POST /analysis/kinematics`: where everything is in each state.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct KinematicsRequest {
    /// Robot, ground and obstacles.
    #[serde(default)]
    pub scene: Scene,
    /// The states; the scene's own where absent. At most 10 000.
    #[serde(default)]
    pub states: Option<Vec<RoverState>>,
    /// `true` for the poses of all links, or the names of some; none where absent.
    #[serde(default)]
    pub links: Option<LinksWanted>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// Work budget: taken by every request, without effect where all of the work is done anyway.
    #[serde(default)]
    pub budget: Option<u64>,
}

/// Which links' poses are wanted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum LinksWanted {
    /// All or none.
    All(bool),
    /// These.
    Named(Vec<String>),
}

/// Answer to [`KinematicsRequest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct KinematicsAnswer {
    /// One for each state, in order.
    pub states: Vec<StateKinematics>,
}

/// Where everything is in one state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StateKinematics {
    /// Center of mass with payloads, in `world` (m).
    pub com_m: [f64; 3],
    /// The wheels by leg.
    pub wheels: BTreeMap<String, WheelKinematics>,
    /// Poses of links in `world`, where asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<BTreeMap<String, Pose>>,
    /// Legs whose wheel stands on the ground.
    pub standing: Vec<String>,
    /// Two links that overlap.
    pub self_collision: Option<PairDistance>,
    /// A link that reaches into ground or an obstacle; standing wheels may touch at their contacts.
    pub terrain_collision: Option<LinkDistance>,
    /// Pairs nearer than the robot's tolerances ask for, colliding ones included; `terrain` and
    /// `obstacle` stand for ground and obstacles.
    pub violates_tolerance: Vec<ToleranceViolation>,
    /// Torques that hold the state under gravity, loads shared among the standing wheels as by
    /// springs of each leg's own stiffness (N m; forces in N of prismatic joints), by leg from the hip outward.
    pub joint_torques_nm: BTreeMap<String, Vec<f64>>,
}

/// Where a wheel is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WheelKinematics {
    /// Center, in `world` (m).
    pub position_m: [f64; 3],
    /// Orientation: y is the axle, x the fork's direction.
    pub orientation_xyzw: [f64; 4],
    /// The wheel's point that touches the ground, or would touch it first, in `world` (m).
    pub contact_m: [f64; 3],
    /// Height of that point above the ground (m); negative inside, none over unknown ground.
    pub gap_m: Option<f64>,
}

/// Two links and their distance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PairDistance {
    /// Names of the links.
    pub pair: [String; 2],
    /// Distance (m), zero where they overlap.
    pub distance_m: f64,
}

/// A link and its distance from ground or obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LinkDistance {
    /// Name of the link.
    pub link: String,
    /// Distance (m), zero where it reaches in.
    pub distance_m: f64,
    /// Index of the obstacle, where it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obstacle: Option<usize>,
}

/// A pair nearer than it may be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ToleranceViolation {
    /// Names of the links; `terrain` or `obstacle` in second place for those.
    pub pair: [String; 2],
    /// Distance (m).
    pub distance_m: f64,
    /// Distance to be kept (m).
    pub tolerance_m: f64,
}

/// `POST /analysis/inverse-kinematics`: all branches of a leg for each wheel pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct InverseKinematicsRequest {
    /// Robot and base pose; ground and obstacles do not matter.
    #[serde(default)]
    pub scene: Scene,
    /// The leg.
    pub leg: String,
    /// Wheel poses. At most 10 000.
    pub targets: Vec<WheelTarget>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// Work budget: taken by every request, without effect where all of the work is done anyway.
    #[serde(default)]
    pub budget: Option<u64>,
}

/// Where a wheel is to be: its center, and exactly one of `orientation_xyzw` and `axis`. For a leg of
/// fewer than six joints or with a ball foot the center alone, and neither.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelTarget {
    /// Wheel center, in `world` (m).
    pub position_m: [f64; 3],
    /// Orientation of the wheel: y is the axle, x the fork's direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation_xyzw: Option<[f64; 4]>,
    /// Direction of the last link's x (unit vector in `world`); the spin about it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
}

/// Answer to [`InverseKinematicsRequest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InverseKinematicsAnswer {
    /// One for each target, in order.
    pub targets: Vec<TargetSolutions>,
}

/// The branches of one target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TargetSolutions {
    /// Joint angles (rad; m for a prismatic joint) of every branch within the limits, or, where the
    /// leg has no closed form, of the solutions that iteration finds: at most 8.
    pub solutions: Vec<Vec<f64>>,
    /// Residual of each solution; absent for the closed form, which is exact to rounding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residuals: Option<Vec<SolutionResidual>>,
    /// Why there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unreachable: Option<UnreachableTarget>,
}

/// By how much forward kinematics of a solution misses its target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SolutionResidual {
    /// Distance of the wheel center from where it should be (m).
    pub position_m: f64,
    /// Turn that is missing (rad); zero where the orientation is free.
    pub angle_rad: f64,
}

/// Why a target has no solution.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct UnreachableTarget {
    /// How far the leg's wrist misses its reachable shell (m); zero where only limits forbid it. For
    /// a leg without closed form how far the target is beyond its reach, or how near iteration came.
    pub nearest_m: f64,
    /// True if it is proven that there is no solution; false if iteration found none.
    pub proven: bool,
    /// What forbids it.
    pub reason: String,
}
