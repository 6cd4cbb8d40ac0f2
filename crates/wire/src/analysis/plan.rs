//! One planned step.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::StabilityPreference;
use crate::live::{CommandBody, Footfall};
use crate::scene::Scene;

/// `POST /analysis/plan` and `POST /plans`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanRequest {
    /// Robot, ground, obstacles, state.
    #[serde(default)]
    pub scene: Scene,
    /// The leg that steps.
    pub leg: String,
    /// Where to.
    pub target: PlanTarget,
    /// How the free motion is searched.
    #[serde(default)]
    pub planner: Planner,
    /// Height of the waypoints above start and goal (m), 0 to 2; 0.2 times the robot's scale where
    /// absent.
    #[serde(default)]
    pub lift_m: Option<f64>,
    /// What must hold while the leg is up.
    #[serde(default)]
    pub stability: StabilityPreference,
    /// Overrides of the robot's tolerances.
    #[serde(default)]
    pub tolerances: PlanTolerances,
    /// Only the leg's free motion between two joint vectors: no lift, drop or stability verdict.
    #[serde(default)]
    pub transit_only: bool,
    /// Seed of the search; 1 where absent.
    #[serde(default = "one")]
    pub seed: u64,
    /// Work budget: most milestones of the search, 2 to 1 000 000; 10 000 where absent.
    #[serde(default)]
    pub budget: Option<u64>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// How the path is shortened.
    #[serde(default)]
    pub smoothing: PlanSmoothing,
}

/// Where a step goes: exactly one of `position_m` and `joints_rad`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanTarget {
    /// The point of ground under the wheel, in `world` (m); its height is that of the ground.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_m: Option<[f64; 3]>,
    /// Joint angles (rad) of the leg at the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints_rad: Option<Vec<f64>>,
}

/// How the free motion is searched.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Planner {
    /// The straight line in joint space if it is free, else SBL.
    #[default]
    Auto,
    /// Single-query, bi-directional, lazy.
    Sbl,
    /// A*: not supported by this version.
    Astar,
    /// The wheel along a straight line: fragile, for comparison.
    Line,
}

/// Overrides of the robot's tolerances (m).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanTolerances {
    /// Any body and ground or obstacles (m), 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment_m: Option<f64>,
    /// Any two bodies (m), 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pairs_m: Option<f64>,
}

/// How a path is shortened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanSmoothing {
    /// Stop when two rounds in a row shorten the path by less than this share, 0 to 1; 0.02 where
    /// absent (FootFall: 0.25).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop_reduction: Option<f64>,
    /// Most rounds, 0 to 1000; none leaves the path as it was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_rounds: Option<u32>,
    /// Most edges tested over all rounds, 0 to 1 000 000: the work budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_edges: Option<u32>,
}

fn one() -> u64 {
    1
}

/// Answer to [`PlanRequest`]: a planned step, or why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanAnswer {
    /// Identity of a plan of the live rover.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// `found`, `no_path`, `unreachable`, `no_lift`, `unstable`, `colliding`, `unknown_ground`,
    /// `refused` (by the final check), `deadline` or `cancelled`.
    pub outcome: String,
    /// Why, in a sentence.
    pub reason: Option<String>,
    /// The leg.
    pub leg: String,
    /// The point of ground asked for, in `world` (m).
    pub target_m: Option<[f64; 3]>,
    /// The path of the leg.
    pub waypoints: Vec<PlanWaypoint>,
    /// What the rover is to be told, in order; empty unless the plan may be sent.
    pub commands: Vec<PlanCommand>,
    /// What the final check found.
    pub findings: Vec<PlanFinding>,
    /// Work and times.
    pub statistics: PlanStatistics,
    /// What the plan rests on.
    pub basis: PlanBasis,
    /// Where the wheel comes to stand.
    pub footfall: Option<Footfall>,
    /// Margin of stability along the plan.
    pub margins: Vec<PlanMargin>,
}

/// A knot of the leg's path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanWaypoint {
    /// Joint angles (rad), from the hip outward.
    pub joints_rad: Vec<f64>,
    /// The part of the step that ends here.
    pub phase: PlanPhase,
    /// Time after the start of the step (s).
    pub time_s: f64,
}

/// Part of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlanPhase {
    /// The body moves over its feet.
    Shift,
    /// The wheel leaves the ground.
    Lift,
    /// The leg moves free of the ground.
    Transit,
    /// The wheel comes down.
    Drop,
}

/// A command of a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanCommand {
    /// In words: `Lift leg 2`.
    pub title: String,
    /// Its part of the step.
    pub phase: PlanPhase,
    /// What the rover is told.
    pub body: CommandBody,
    /// How long it takes (s).
    pub duration_s: f64,
}

/// One check of a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanFinding {
    /// Name of the check.
    pub check: String,
    /// Is it met?
    pub ok: bool,
    /// What is to spare, negative where it is missing, in the check's unit.
    pub margin: Option<f64>,
    /// Where along the step, in words.
    pub r#where: Option<String>,
    /// More, in a sentence.
    pub detail: Option<String>,
}

/// Work and times of a plan.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanStatistics {
    /// Time of the search (ms).
    pub search_ms: f64,
    /// Time of the smoothing (ms).
    pub smoothing_ms: f64,
    /// Time of the final check (ms).
    pub check_ms: f64,
    /// Configurations checked by search and smoothing.
    pub configurations_checked: u64,
    /// Milestones made by the search.
    pub milestones: u64,
    /// Ways to put the wheel down that were tried.
    pub touchdowns: u64,
    /// Length of the first path (rad).
    pub first_path_rad: f64,
    /// Length of the path (rad).
    pub length_rad: f64,
    /// Length of the straight line (rad).
    pub straight_rad: f64,
}

/// What a plan rests on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PlanBasis {
    /// Hash of the rover's state.
    pub state_hash: String,
    /// Version of the map.
    pub terrain_version: String,
    /// Version stamp of the robot model.
    pub model_hash: String,
    /// Seed of the search.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
}

/// Margin of stability at one time of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanMargin {
    /// Time after the start of the step (s).
    pub time_s: f64,
    /// Regular margin over the standing feet (m).
    pub margin_m: f64,
}
