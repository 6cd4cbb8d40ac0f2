//! Stability of stances given by their contacts.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::live::{PolygonAnswer, RegionAnswer, RegionKind};
use crate::scene::Scene;

/// `POST /analysis/stability`: polygons, margins and loads of each stance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StabilityRequest {
    /// Robot and gravity; gravity is the default of every case.
    #[serde(default)]
    pub scene: Option<Scene>,
    /// The stances. At most 10 000.
    pub cases: Vec<StabilityCase>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// Work budget: taken by every request, without effect where all of the work is done anyway.
    #[serde(default)]
    pub budget: Option<u64>,
}

/// A stance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StabilityCase {
    /// Where the feet touch. At most 64.
    pub contacts: Vec<StanceContact>,
    /// Center of mass (m).
    pub com_m: [f64; 3],
    /// Mass (kg), above zero; without it there are no forces in the answer.
    #[serde(default)]
    pub mass_kg: Option<f64>,
    /// Gravity (m/s²) along -z, 0.01 to 100; that of the scene, else 1.62 where absent.
    #[serde(default)]
    pub gravity_m_s2: Option<f64>,
    /// Edges of a linearized friction cone, 3 to 64.
    #[serde(default = "eight")]
    pub cone_edges: u32,
    /// Whether linearized cones lie inside the true ones or outside.
    #[serde(default)]
    pub cone_bound: ConeBound,
    /// Ropes that hold the rover beside its feet. At most 8; they count only with `mass_kg`.
    #[serde(default)]
    pub tethers: Vec<Tether>,
    /// How well the contacts are known: with it, `robust` tells the least margins.
    #[serde(default)]
    pub uncertainty: Option<ContactUncertainty>,
    /// Height of the energy surface wanted over the support polygon: `energy_surface` with this
    /// distance between its nodes (m).
    #[serde(default)]
    pub energy_surface_m: Option<f64>,
    /// A level direction (rad, from x towards y) along which `energy_slice` is wanted.
    #[serde(default)]
    pub energy_heading_rad: Option<f64>,
}

/// On which side of the true friction cone its linearized form lies.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ConeBound {
    /// Edges on the cone: every answer of stability is true of the cone.
    #[default]
    Inner,
    /// Planes that touch the cone: every answer of instability is true of the cone.
    Outer,
}

/// A rope that pulls only.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Tether {
    /// Where it is fixed to the rover (m).
    pub position_m: [f64; 3],
    /// Unit vector along which it pulls.
    pub direction: [f64; 3],
    /// Most that it pulls with (N).
    pub max_tension_n: f64,
}

/// Within what contacts are known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ContactUncertainty {
    /// Heights of footfalls (m), 0 to 10.
    #[serde(default)]
    pub height_m: f64,
    /// Angles of normals (rad), 0 to 1.5.
    #[serde(default)]
    pub normal_rad: f64,
    /// Coefficients of friction, 0 to 10.
    #[serde(default)]
    pub friction: f64,
}

/// A foot on the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StanceContact {
    /// Where it touches (m).
    pub position_m: [f64; 3],
    /// Unit normal of the ground; up where absent.
    #[serde(default = "up")]
    pub normal: [f64; 3],
    /// Coefficient of friction, 0 to 10.
    #[serde(default = "regolith")]
    pub friction: f64,
    /// The leg that stands here: with a `state` in the scene and a leg for every contact, torques are
    /// answered.
    #[serde(default)]
    pub leg: Option<String>,
}

fn eight() -> u32 {
    8
}

fn up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn regolith() -> f64 {
    0.7
}

/// Answer to [`StabilityRequest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StabilityAnswer {
    /// One for each case, in order.
    pub cases: Vec<CaseStability>,
}

/// What is known of one stance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CaseStability {
    /// The regular support polygon; none where the contacts enclose no area.
    pub regular: Option<PolygonAnswer>,
    /// What is left of it should any one foot slip: an area, or a point with one vertex.
    pub conservative: Option<PolygonAnswer>,
    /// `area`, `point` or `empty`.
    pub conservative_kind: RegionKind,
    /// The region of centers of mass that friction holds; none where it is empty.
    pub friction: Option<PolygonAnswer>,
    /// `area`, `point` or `empty`.
    pub friction_kind: RegionKind,
    /// What is left of the friction region should any one contact, or rope, be lost.
    pub friction_conservative: RegionAnswer,
    /// The region that friction and joint torques hold; only with legs, `mass_kg` and a state.
    pub torque: Option<RegionAnswer>,
    /// The largest |torque| / limit with the forces that spare the joints most.
    pub least_torque: Option<TorqueAnswer>,
    /// How much the friction of all contacts may fall; negative: how much more is needed. None if
    /// none would do.
    pub slip_margin: Option<f64>,
    /// Energy to tip over (J); only with `mass_kg`.
    pub energy_margin_j: Option<f64>,
    /// By how much the center of mass must rise to tip over (m).
    pub energy_margin_m: Option<f64>,
    /// The same for each edge.
    pub energy_edges: Vec<EnergyEdgeAnswer>,
    /// The energy margin over centers of mass of the same height.
    pub energy_surface: Option<EnergySurface>,
    /// The energy margin (m) along the heading asked for, 33 values to the end of the polygon.
    pub energy_slice: Option<EnergySlice>,
    /// The least margins within the uncertainty given.
    pub robust: Option<RobustAnswer>,
    /// Smallest forces of the ground within the friction cones that hold the stance (N); none without
    /// `mass_kg` or where none do. Ropes count as slack.
    pub contact_forces_n: Option<Vec<[f64; 3]>>,
    /// Vertical load of each foot (N), legs taken as springs: of their own stiffness where every contact
    /// names its leg and the case has a state, else equal ones; none without `mass_kg` or where the center
    /// of mass is outside the polygon.
    pub spring_loads_n: Option<Vec<f64>>,
    /// True if forces within the friction cones, and the ropes' limits, hold the stance.
    pub stable: bool,
    /// Why it is not shown to be stable.
    pub why_not: Option<String>,
}

/// A joint and how much it is loaded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TorqueAnswer {
    /// |torque| / limit.
    pub ratio: f64,
    /// The joint that has it.
    pub joint: String,
    /// The forces of the ground (N).
    pub forces_n: Vec<[f64; 3]>,
}

/// Tipping over the line through two contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EnergyEdgeAnswer {
    /// Indices of the contacts, from 0.
    pub contacts: [usize; 2],
    /// By how much the center of mass must rise (m); negative beyond the edge.
    pub height_m: f64,
}

/// Energy margins on a grid, row by row along x.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EnergySurface {
    /// The first node `[x, y]` (m).
    pub origin_m: [f64; 2],
    /// Distance between nodes (m).
    pub resolution_m: f64,
    /// Nodes along x and y.
    pub size: [usize; 2],
    /// Margins (m): base64 of little-endian f32, NaN outside of the support polygon.
    pub height_m: String,
}

/// Energy margins along a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EnergySlice {
    /// Distance of the last value from the center of mass (m).
    pub length_m: f64,
    /// Margins (m) at even distances from 0 on.
    pub height_m: Vec<f64>,
}

/// Least margins.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RobustAnswer {
    /// In the friction region (m); none where some case holds no center of mass.
    pub friction_margin_m: Option<f64>,
    /// Rise to tip over (m); none without a support polygon.
    pub energy_margin_m: Option<f64>,
}
