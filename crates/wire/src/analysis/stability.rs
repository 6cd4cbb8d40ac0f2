//! Stability of stances given by their contacts.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::live::{PolygonAnswer, RegionKind};
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
}

/// A foot on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
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
    /// The friction polygon: not computed by this version.
    pub friction: Option<PolygonAnswer>,
    /// The torque-feasible region: needs the robot, not computed by this version.
    pub torque: Option<PolygonAnswer>,
    /// Energy to tip over (J); not computed by this version.
    pub energy_margin_j: Option<f64>,
    /// The same as a height (m); not computed by this version.
    pub energy_margin_m: Option<f64>,
    /// Force of the ground on each foot (N), vertical, legs taken as equal springs; none without
    /// `mass_kg` or where the center of mass is outside the polygon.
    pub contact_forces_n: Option<Vec<[f64; 3]>>,
    /// True if vertical forces within every friction cone hold the stance.
    pub stable: bool,
    /// Why it is not shown to be stable.
    pub why_not: Option<String>,
}
