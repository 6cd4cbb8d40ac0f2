//! What the ground derives of the stance, and how far reachability is.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::analysis::StabilityPreference;

/// Stability of the stance as last reported, computed on the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StabilityDerived {
    /// Center of mass in `world` (m).
    pub com_m: [f64; 3],
    /// The regular support polygon (m), or none with fewer than three feet on the ground.
    pub regular: Option<PolygonAnswer>,
    /// The conservative support polygon (m).
    pub conservative: Option<PolygonAnswer>,
    /// `area`, `point` or `empty`.
    pub conservative_kind: RegionKind,
    /// Margin after the worst settlement of one standing foot (m).
    pub settlement_margin_m: Option<f64>,
    /// The foot whose settlement is worst.
    pub settlement_leg: Option<String>,
    /// Largest |torque| / limit over all joints.
    pub torque_ratio: f64,
    /// The joint with the largest ratio.
    pub torque_joint: String,
    /// Torque / limit by leg, signed, from the hip outward.
    pub torque_ratios: BTreeMap<String, Vec<f64>>,
    /// Friction, forces and energy; none where nothing stands, and in logs of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forces: Option<ForcesDerived>,
}

/// What friction, joint torques and energy say of a stance.
///
/// Normals of the ground are those that the wheels show: from the contact to the wheel's center.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ForcesDerived {
    /// Coefficient of friction taken for all contacts.
    pub friction_coefficient: f64,
    /// Where friction holds the center of mass.
    pub friction: RegionAnswer,
    /// What is left of it should any one foot be lost.
    pub friction_conservative: RegionAnswer,
    /// Where friction and joint torques hold it, at the present joint angles.
    pub torque: RegionAnswer,
    /// How much the friction may fall before the rover slips; negative: how much is missing. None if
    /// no friction would do.
    pub slip_margin: Option<f64>,
    /// By how much the center of mass must rise to tip over the weakest edge (m); none without a
    /// support polygon.
    pub energy_margin_m: Option<f64>,
    /// The same as work (J).
    pub energy_margin_j: Option<f64>,
    /// The two feet of that edge.
    pub energy_edge: Option<[String; 2]>,
    /// Smallest forces of the ground that hold the stance (N); none if none do.
    pub contact_forces_n: Option<BTreeMap<String, [f64; 3]>>,
    /// Largest |torque| / limit with the forces that spare the joints most; none if none hold.
    pub least_torque_ratio: Option<f64>,
    /// The joint that has it.
    pub least_torque_joint: Option<String>,
    /// Vertical load of each foot (N) of a compliant rover: least, expected, most within the errors
    /// of stiffness and touch-down height. None if it tips.
    pub load_share_n: Option<BTreeMap<String, [f64; 3]>>,
    /// Largest |torque| / limit within these loads.
    pub load_torque_ratio: Option<f64>,
    /// The joint that has it.
    pub load_torque_joint: Option<String>,
    /// True if the best forces, the loads within their errors, and lifted legs leave all joints
    /// within their limits.
    pub torque_safe: bool,
    /// Where the measured forces on the wheels act together, `[x, y]` (m); none if nothing bears.
    pub center_of_force_m: Option<[f64; 2]>,
}

/// Where the legs of the live rover can stand, in short.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReachSummary {
    /// What it was computed for: another text means another stance, map or preference.
    pub basis: String,
    /// What must hold while a leg is up.
    pub stability: StabilityPreference,
    /// Each leg that is done, by its name; those that are missing are still computed.
    pub legs: BTreeMap<String, LegReach>,
    /// Share of the legs done, 0 to 1.
    pub progress: f64,
    /// Why nothing is computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// How many cells of a leg are of each class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LegReach {
    /// By the names of the classes.
    pub cells: BTreeMap<String, u32>,
    /// Distance between cells (m).
    pub resolution_m: f64,
}

/// A region of centers of mass, or why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegionAnswer {
    /// `area`, `point` or `empty`.
    pub kind: RegionKind,
    /// The region; none if it is empty. `critical` names the feet that bear at the nearest edge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<PolygonAnswer>,
    /// Why it is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why_empty: Option<String>,
    /// True if it reaches so far only because feet push against each other with 100 times the weight.
    #[serde(default)]
    pub capped: bool,
}

/// What a region is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RegionKind {
    /// It has area.
    Area,
    /// A single point.
    Point,
    /// Nothing.
    Empty,
}

/// A support polygon with the margin of the center of mass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PolygonAnswer {
    /// Vertices `[x, y]` in `world` (m), counter-clockwise; a single one where the region is a
    /// point.
    pub polygon_m: Vec<[f64; 2]>,
    /// Area (m²).
    pub area_m2: f64,
    /// Distance of the center of mass from the nearest edge (m), negative outside.
    pub margin_m: f64,
    /// The edge that decides, as `[[x, y], [x, y]]` (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub critical_edge_m: Option<[[f64; 2]; 2]>,
    /// The feet that decide, by name: `leg2, leg3` at the ends of the edge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub critical: Option<String>,
}
