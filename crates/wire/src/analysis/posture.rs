//! The posture adviser and the leg-loss rehearsal.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{PlanBasis, PlanCommand, PlanFinding, PlanMargins, PlanWaypoint};
use crate::scene::{RoverState, Scene};

/// `POST /analysis/posture`: `advice`, `rehearsal`, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PostureRequest {
    /// Robot, ground, obstacles, state.
    #[serde(default)]
    pub scene: Scene,
    /// The cheapest change of posture before a leg is lifted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub advice: Option<AdviceRequest>,
    /// What is left if a leg fails or a foot settles now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rehearsal: Option<RehearsalRequest>,
    /// Seed of the search; 1 where absent.
    #[serde(default = "one")]
    pub seed: u64,
    /// Work budget: poses of the chassis that may be looked at by each of the two, 0 to 1 000 000;
    /// 120 000 where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<u64>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deadline_s: Option<f64>,
}

/// What is wished for, and what may change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AdviceRequest {
    /// The leg that is to be lifted.
    pub leg: String,
    /// Wanted regular margin without the leg (m), 0 to 1000; the robot's m1 where that is more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regular_m: Option<f64>,
    /// Wanted conservative margin (m), 0 to 1000, where full loss of one more leg must be survived.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conservative_m: Option<f64>,
    /// Wanted margin in the region that friction holds (m), 0 to 1000; the robot's m1 where that is
    /// more. All along the way friction is then asked for m1 too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction_m: Option<f64>,
    /// Which way the chassis may go.
    #[serde(default)]
    pub chassis: PostureFreedom,
    /// May the leg be lifted and folded first? True where absent.
    #[serde(default = "yes")]
    pub fold: bool,
    /// May one other foot be put down elsewhere first? True where absent.
    #[serde(default = "yes")]
    pub replace: bool,
    /// Wheel drives hold the standing wheels while forks pitch, instead of the brakes.
    #[serde(default)]
    pub drive_hold: bool,
}

/// What is rehearsed.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RehearsalRequest {
    /// How far the ground settles under a foot (m), 0 to 2 times the robot's scale; the robot's s where
    /// absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settlement_m: Option<f64>,
}

/// Which way the chassis may go.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PostureFreedom {
    /// To all sides, keeping its height and attitude.
    Level,
    /// In all six directions.
    #[default]
    Whole,
}

fn one() -> u64 {
    1
}

fn yes() -> bool {
    true
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureAnswer {
    /// Identity of an answer about the live rover that is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// The advice, if asked for.
    pub advice: Option<PostureAdvice>,
    /// The rehearsal, if asked for.
    pub rehearsal: Option<PostureRehearsal>,
    /// What the answer rests on.
    pub basis: PlanBasis,
}

/// What is advised.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureAdvice {
    /// The leg that is to be lifted.
    pub leg: String,
    /// How it ended.
    pub outcome: PostureOutcome,
    /// Margins without the leg as the rover stands.
    pub before: PostureMargins,
    /// With `found`: ways to meet the wish, cheapest first.
    pub proposals: Vec<PostureProposal>,
    /// With `best`: the posture with most that can be gone to.
    pub best: Option<PostureBest>,
    /// What each kind of change that does not meet the wish runs into.
    pub limits: Vec<PostureLimit>,
    /// Poses of the chassis looked at.
    pub poses_looked_at: u64,
}

/// How an advice ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PostureOutcome {
    /// The wish is met as the rover stands.
    AlreadyMet,
    /// There are proposals.
    Found,
    /// The wish was not met; the best is told.
    Best,
}

/// What a proposal changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PostureChange {
    /// The chassis, with all feet where they are.
    Chassis,
    /// The leg is lifted and folded, then the chassis moves if it has to.
    Fold,
    /// Another foot is put down elsewhere first.
    Replace,
}

/// A posture that can be gone to: every piece of the motion is certified, the final check passed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureProposal {
    /// What changes.
    pub change: PostureChange,
    /// With `replace`: the leg whose foot is put down elsewhere.
    pub replaced_leg: Option<String>,
    /// How to get there.
    #[serde(flatten)]
    pub motion: PostureMotion,
    /// The posture.
    pub end: RoverState,
    /// Its margins without the leg.
    pub margins: PostureMargins,
    /// What it costs.
    pub cost: PostureCost,
}

/// A motion that may be executed: every piece is certified, the final check passed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureMotion {
    /// The leg that moves by itself; where only the chassis moves, the leg that is to be lifted, or that
    /// the rehearsal is about.
    pub leg: String,
    /// The motion with the whole rover at each knot: joint angles are those of `leg`, times go on from
    /// one command to the next. Empty where nothing has to move.
    pub waypoints: Vec<PlanWaypoint>,
    /// How to get there, in order; empty where nothing has to move.
    pub commands: Vec<PlanCommand>,
    /// The way back, last part first.
    pub retreat: Vec<PlanCommand>,
    /// What the final check found, motion by motion.
    pub findings: Vec<PlanFinding>,
    /// Margins of stability along it.
    #[serde(default)]
    pub margins_along: PlanMargins,
}

impl PostureAdvice {
    /// The postures that can be gone to: the proposals; where the wish is not met, the best one.
    pub fn offered(&self) -> impl Iterator<Item = &PostureProposal> {
        self.proposals.iter().chain(self.best.iter().map(|best| &best.posture))
    }
}

/// `POST /rover/posture/{id}/plans`: keeps what was offered as a plan; one of the two.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PosturePlanRequest {
    /// Which of the proposals, from 0; where the wish was not met, 0 is the best posture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proposal: Option<usize>,
    /// The way back from an accident of the rehearsal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub way_back: Option<PostureAccident>,
}

/// Names an accident of the rehearsal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PostureAccident {
    /// The leg.
    pub leg: String,
    /// What happens to it.
    pub kind: PostureAccidentKind,
}

/// What is rehearsed of a leg.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PostureAccidentKind {
    /// It fails and bears nothing.
    Lost,
    /// The ground settles under it.
    Settled,
}

/// What a plan of a posture is for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PlanPosture {
    /// The leg that is to be lifted after it, or that an accident happened to.
    pub leg: String,
    /// What changes.
    pub change: PostureChange,
    /// Does it give the margins that were wished for; after an accident, those of the margin rule?
    pub wish_met: bool,
    /// With a way back from it: the accident.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accident: Option<PostureAccidentKind>,
}

/// What a change costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureCost {
    /// Way of the chassis (m).
    pub chassis_m: f64,
    /// Turn of the chassis (rad).
    pub turn_rad: f64,
    /// Way of the legs that move by themselves, in joint space (rad).
    pub legs_rad: f64,
    /// Time of all motions (s).
    pub duration_s: f64,
}

/// The best posture where the wish is not met.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureBest {
    /// The posture and the way there.
    pub posture: PostureProposal,
    /// How much is missing there (m); absent where no margin is possible.
    pub missing_m: Option<f64>,
    /// What stands in the way of more.
    pub barrier: PostureBarrier,
}

/// What one kind of change runs into.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureLimit {
    /// What was tried.
    pub change: PostureChange,
    /// With `replace`: the leg.
    pub replaced_leg: Option<String>,
    /// The margins it comes to; absent where it could not be begun.
    pub margins: Option<PostureMargins>,
    /// What stands in the way of more.
    pub barrier: PostureBarrier,
}

/// What stands in the way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureBarrier {
    /// `reach`, `joint_limits`, `singularity`, `clearance`, `torque`, `stability`, `closure`, `check`,
    /// `region` (these feet allow no more) or `search` (nothing better was found), or a constraint of a plan.
    pub name: String,
    /// How much is missing, in `unit`; absent where no figure says it.
    pub missing: Option<f64>,
    /// `m`, `rad` or `1` (a share).
    pub unit: String,
    /// In a sentence, with names.
    pub detail: String,
}

/// Margins over the feet that bear.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureMargins {
    /// The legs that bear.
    pub standing: Vec<String>,
    /// Regular margin (m); absent without a polygon.
    pub regular_m: Option<f64>,
    /// The most it could be over these feet, wherever the center of mass were (m).
    pub regular_most_m: Option<f64>,
    /// What the worst settlement of one foot by the robot's s leaves (m).
    pub settlement_m: Option<f64>,
    /// The conservative region: `area`, `point` or `empty`.
    pub conservative_region: String,
    /// Conservative margin (m); for a point minus the distance to it.
    pub conservative_m: Option<f64>,
    /// The most it could be over these feet (m).
    pub conservative_most_m: Option<f64>,
    /// Margin in the region that friction holds (m), where one was wished for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction_m: Option<f64>,
    /// The largest torque as a share of its limit; absent where a joint without a limit bears something.
    pub torque_ratio: Option<f64>,
    /// The joint that bears it.
    pub torque_joint: String,
}

/// The accidents of every standing leg.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureRehearsal {
    /// How far the ground settles (m).
    pub settlement_m: f64,
    /// By leg.
    pub legs: Vec<PostureAccidents>,
    /// Poses of the chassis looked at.
    pub poses_looked_at: u64,
}

/// One leg's accidents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureAccidents {
    /// The leg.
    pub leg: String,
    /// It fails and bears nothing.
    pub lost: PostureAftermath,
    /// The ground settles under it.
    pub settled: PostureAftermath,
}

/// What an accident leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureAftermath {
    /// Regular margin that is left (m), negative if the rover tips over; absent without a polygon.
    pub margin_m: Option<f64>,
    /// Does it tip over?
    pub tips_over: bool,
    /// Does it rock onto the foot that has settled?
    pub rocks: bool,
    /// The way back to a safe stance.
    pub way_back: PostureWayBack,
}

/// Whether there is a way back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PostureWayBack {
    /// How it ended.
    pub outcome: PostureWayOutcome,
    /// With `found`: the shift.
    pub motion: Option<PostureMotion>,
    /// With `found`: where it ends.
    pub end: Option<RoverState>,
    /// With `found`: margins there over the feet that bear.
    pub margins: Option<PostureMargins>,
    /// With `none`: what stands in the way.
    pub barrier: Option<PostureBarrier>,
}

/// How the search for a way back ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PostureWayOutcome {
    /// The stance is safe as it is.
    NotNeeded,
    /// A shift leads back.
    Found,
    /// None was found.
    None,
}
