//! One planned step.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{PlanPosture, StabilityPreference};
use crate::live::{CommandBody, Footfall};
use crate::scene::{RoverState, Scene};

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
    /// Cell of the A* planner (m), 0.02 to 1 times the robot's scale; 0.2 times the scale where
    /// absent (F80).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell_m: Option<f64>,
    /// Check edges at this resolution (rad, largest joint), 0.0005 to 0.1, as published (F67). Where
    /// absent edges are certified: free at every resolution. What is offered is certified anyway.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epsilon_rad: Option<f64>,
    /// Safety buffers as in FootFall (F84, F86).
    #[serde(default)]
    pub buffers: PlanBuffers,
    /// May the body be shifted over its feet first, where the margin rule asks for it?
    #[serde(default)]
    pub shift: PlanShift,
    /// Press the wheel to its predicted load before the step ends; true where absent.
    #[serde(default = "yes")]
    pub preload: bool,
    /// Let the wheel drives hold the standing wheels in place while forks pitch, instead of the
    /// brakes (a stance of five constraints a wheel). The shift then asks the rover to hold so.
    #[serde(default)]
    pub drive_hold: bool,
}

/// Safety buffers of a plan (m). They never raise the ground under a standing wheel, under the start
/// or under the goal.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanBuffers {
    /// The ground is raised by this much for the transit (m), 0 to 1 (F84; FootFall took 0.15).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrain_lift_m: Option<f64>,
    /// Clearance added about obstacles (m), 0 to 1 (F86).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obstacle_m: Option<f64>,
}

/// May a plan shift the body over its feet first?
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlanShift {
    /// Where the margin rule asks for it.
    #[default]
    Auto,
    /// Never: the answer then says what is missing.
    Never,
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
    /// The straight way in joint space, the better of a few short runs of RRT-Connect, A* on a coarse
    /// grid, SBL: the first that finds a path (F81).
    #[default]
    Auto,
    /// Single-query, bi-directional, lazy (F68-F74).
    Sbl,
    /// A* of the wheel on a grid in task space (F80).
    Astar,
    /// Two rapidly growing random trees.
    RrtConnect,
    /// The wheel along a straight line: fragile, for comparison (F59).
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
    /// Added to every clearance (m), 0 to 1: tracking error, predicted sag and error of the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inflation_m: Option<f64>,
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

fn yes() -> bool {
    true
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
    /// Margins of stability along the plan.
    #[serde(default)]
    #[schema(required = true)]
    pub margins: PlanMargins,
    /// Where there is no plan: which constraint is in the way, and how much is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub constraint: Option<PlanConstraint>,
    /// Where there is no plan because of the place: the nearest ground found where the wheel could be
    /// put down and lifted again, in `world` (m). Whether a way leads there is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nearest_m: Option<[f64; 3]>,
    /// The way back from the end of each command to where the step began: the same path, backward,
    /// last part first. It begins with the part that undoes the last command that was executed.
    pub retreat: Vec<PlanCommand>,
    /// Load that the wheel is pressed to before it is relied on (N).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preload_n: Option<f64>,
    /// Only where the plan is no step but a posture that the adviser proposed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture: Option<PlanPosture>,
}

/// What is in the way of a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanConstraint {
    /// `reach`, `joint_limits`, `ground`, `unknown_ground`, `clearance`, `stability` or `search`
    /// (the work budget).
    pub name: String,
    /// How much is missing, in `unit`; absent where no figure says it.
    pub missing: Option<f64>,
    /// `m` or `rad`.
    pub unit: String,
    /// In a sentence.
    pub detail: String,
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
    /// The whole rover here: only where the body has been shifted, or is being shifted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stance: Option<RoverState>,
    /// May the rover be held here for as long as one likes (the margin rule holds at rest)?
    pub hold: bool,
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
    /// The wheel is pressed to its load before it is relied on.
    Preload,
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
    /// Does it hold on an assumption, which the detail tells?
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub assumed: bool,
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
    /// The planner that found the first path: `joint_line`, `astar`, `sbl`, `rrt_connect`, `line`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planner: Option<PathPlanner>,
    /// Edges asked for by search and smoothing.
    pub edges: u64,
    /// True if every piece of the motion is certified: free at every resolution.
    pub certified: bool,
}

/// A planner that finds paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PathPlanner {
    /// The straight line in joint space.
    JointLine,
    /// A* of the wheel on a grid.
    Astar,
    /// Single-query, bi-directional, lazy.
    Sbl,
    /// Two rapidly growing random trees.
    RrtConnect,
    /// The wheel along a straight line.
    Line,
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

/// Margins of stability along a plan over the feet that stand: one value of each for each time, `null`
/// where there is nothing to have a margin over. At most 64 times, even within a shift of the body and
/// within the motion of the leg; where the leg is lifted after a shift one time stands twice, on all
/// feet and without the leg. All are empty where nothing stands: for a transit alone and without a path.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanMargins {
    /// Time after the start of the step (s), never falling.
    pub time_s: Vec<f64>,
    /// In the regular support polygon (m).
    pub regular_m: Vec<Option<f64>>,
    /// In what is left of it should any one foot slip (m); for a point minus the distance to it.
    pub conservative_m: Vec<Option<f64>>,
    /// In the region that friction holds (m).
    pub friction_m: Vec<Option<f64>>,
    /// Work to tip the rover over its weakest edge (J).
    pub energy_j: Vec<Option<f64>>,
    /// By how much the center of mass must rise for that (m).
    pub energy_m: Vec<Option<f64>>,
    /// The legs of the nearest edge of the regular polygon, `leg2, leg3`.
    pub critical: Vec<Option<String>>,
}
