//! What flows between ground and rover, and from the ground server to its listeners.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::analysis::{PlanAnswer, PlanRequest, StabilityPreference};
use crate::scene::{Pose, RoverState};
use crate::time::Timestamp;

mod command;
mod link;

pub use command::*;
pub use link::*;

/// Names of the channels. The same names serve stream, log and replay.
pub mod channel {
    /// [`super::RoverTelemetry`], 10 Hz.
    pub const ROVER_STATE: &str = "rover/state";
    /// [`super::StabilityDerived`], derived on the ground from each `rover/state`.
    pub const ROVER_STABILITY: &str = "rover/stability";
    /// [`super::Uplink`] as it was handed to the link.
    pub const COMMAND_UPLINK: &str = "command/uplink";
    /// [`super::CommandEvent`]: every transition of every command.
    pub const COMMAND_EVENT: &str = "command/event";
    /// [`super::LinkReport`], 1 Hz and on change.
    pub const LINK: &str = "link/report";
    /// [`super::TerrainNotice`]: a new version of the map.
    pub const TERRAIN: &str = "terrain/version";
    /// [`super::JobReport`]: progress of long work (not logged).
    pub const JOB: &str = "job/progress";
    /// [`super::EventNotice`]: what operators and the server did or met.
    pub const EVENT: &str = "event";
    /// [`super::ReachSummary`]: how far the live reachability of all legs is, on each change.
    pub const ROVER_REACH: &str = "rover/reachability";
    /// [`super::PlanRecord`]: every plan of the live rover, as asked for and answered.
    pub const PLAN: &str = "plan/record";
    /// [`super::LogGap`]: messages that the flight log lacks (in logs only).
    pub const LOG_GAP: &str = "log/gap";
    /// All channels, in a fixed order.
    pub const ALL: [&str; 11] = [
        ROVER_STATE,
        ROVER_STABILITY,
        COMMAND_UPLINK,
        COMMAND_EVENT,
        LINK,
        TERRAIN,
        JOB,
        EVENT,
        ROVER_REACH,
        PLAN,
        LOG_GAP,
    ];
}

/// A plan of the live rover. The request is complete but for the map, which the answer names
/// (`basis.terrain_version`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanRecord {
    /// What was asked, with the state, robot, payloads and gravity it was asked for.
    pub request: PlanRequest,
    /// What was answered.
    pub answer: PlanAnswer,
}

/// Messages of one channel that the flight log lacks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LogGap {
    /// The channel.
    pub channel: String,
    /// How many.
    pub dropped: u64,
    /// Number of the first of them.
    pub first_sequence: u64,
    /// Number of the last of them.
    pub last_sequence: u64,
    /// Log time of the first of them.
    pub from: Timestamp,
    /// Log time of the last of them.
    pub to: Timestamp,
    /// Why.
    pub reason: GapReason,
}

/// Why the flight log lacks messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GapReason {
    /// The disk was too slow for what came.
    TooSlow,
    /// The disk was full.
    DiskFull,
    /// The disk refused.
    DiskError,
    /// The recorder had ended.
    Ended,
    /// The message was larger than the log takes.
    TooLarge,
}

/// What the rover is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RoverMode {
    /// Stands still and takes commands.
    Idle,
    /// Executes a command.
    Executing,
    /// Stopped by an E-stop; refuses motion until released.
    Stopped,
    /// A fault stopped it; `fault` says which. A stop release clears it.
    Fault,
}

/// One telemetry frame of the rover.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RoverTelemetry {
    /// Pose and joint angles.
    pub state: RoverState,
    /// True for each leg whose wheel stands on the ground.
    pub contacts: BTreeMap<String, bool>,
    /// Point of each wheel nearest to the ground, in `world` (m).
    pub contact_points_m: BTreeMap<String, [f64; 3]>,
    /// Force of the ground on each wheel, in `world` (N).
    pub wheel_forces_n: BTreeMap<String, [f64; 3]>,
    /// Torques of the joints by leg (N m).
    pub joint_torques_nm: BTreeMap<String, Vec<f64>>,
    /// What the rover is doing.
    pub mode: RoverMode,
    /// The command being executed, and how far it is (0 to 1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub executing: Option<Executing>,
    /// Why the rover is in mode `fault`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
}

/// Progress of the command under way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Executing {
    /// The command.
    pub command_id: String,
    /// Share done, 0 to 1.
    pub progress: f64,
}

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

/// One knot of a joint path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JointKnot {
    /// Joint angles (rad), from the hip outward.
    pub joints_rad: Vec<f64>,
    /// Time after the start of the command (s), not before that of the knot before. The rover takes
    /// this long or, where its joint speed and acceleration ask for it, a little longer; knots of
    /// equal times are passed as fast as these allow.
    pub time_s: f64,
}

/// One knot of a body path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyKnot {
    /// Joint angles (rad), from the hip outward, by leg: in each knot the same legs, among them all
    /// that stand. Other legs go with the base as they are.
    pub joints_rad: BTreeMap<String, Vec<f64>>,
    /// Time after the start of the command (s), as in a [`JointKnot`].
    pub time_s: f64,
}

/// What a command tells the rover to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum CommandBody {
    /// Move one leg through joint angles, joint-linear between knots. The first knot must be where
    /// the leg is.
    JointPath {
        /// The leg.
        leg: String,
        /// Knots in order, at least two.
        knots: Vec<JointKnot>,
    },
    /// Shift the body over its feet: move all standing legs at once, joint-linear between knots. The
    /// base follows from the wheels, which stay where they stand; the rover refuses a path on which
    /// they would slip or it would tip. The first knot must be where the legs are.
    BodyPath {
        /// Knots in order, 2 to 1000.
        knots: Vec<BodyKnot>,
        /// The wheel drives hold the standing wheels in place instead of the brakes: forks may pitch
        /// about the axles.
        #[serde(default, skip_serializing_if = "is_false")]
        drive_hold: bool,
    },
    /// Move one leg's wheel center along a straight line, keeping the wheel's orientation.
    WheelLine {
        /// The leg.
        leg: String,
        /// Where the wheel center goes, in `world` (m).
        position_m: [f64; 3],
    },
    /// Stop where the rover is and stay in mode `idle`; what was under way is aborted.
    Stop {},
}

/// What goes up to the rover.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Uplink {
    /// A command.
    Command {
        /// Identity of the command (UUID).
        id: String,
        /// What to do.
        body: CommandBody,
        /// Where the legs were when the command was checked: leg to joint angles (rad). The rover
        /// refuses the command when a joint is further off than `basis_tolerance_rad`.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        basis_joints_rad: BTreeMap<String, Vec<f64>>,
        /// Largest deviation from the basis (rad).
        basis_tolerance_rad: f64,
        /// Version stamp of the robot model, with scale and payload, that the command was checked
        /// with. The rover refuses the command when it has another one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        model_hash: Option<String>,
        /// Number of the authority that it is sent under. The rover refuses one below the highest that
        /// it has seen.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        epoch: Option<u64>,
    },
    /// The ground is there. A rover that hears nothing for long makes itself safe.
    Heartbeat {},
    /// Emergency stop: stop at once and refuse motion until released.
    Estop {
        /// Identity of this E-stop (UUID).
        id: String,
    },
    /// Ends an E-stop.
    EstopRelease {
        /// Identity of this release (UUID).
        id: String,
    },
}

/// What comes down from the rover.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[allow(clippy::large_enum_variant)] // telemetry is nearly every message
pub enum Downlink {
    /// A telemetry frame.
    Telemetry(RoverTelemetry),
    /// What happened to an uplink on board.
    Ack {
        /// The uplink's identity.
        id: String,
        /// What happened.
        stage: AckStage,
        /// Why, or how far.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        detail: Option<String>,
    },
}

/// What the rover says of an uplink.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AckStage {
    /// Arrived and understood.
    Received,
    /// Refused; `detail` says why.
    Rejected,
    /// Motion has begun.
    Started,
    /// Ended as commanded.
    Completed,
    /// Ended otherwise; `detail` says why.
    Failed,
    /// Ended by a stop or E-stop.
    Aborted,
}

/// The state of a command, as shown to people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CommandState {
    /// Checked and waiting for the operator.
    Staged,
    /// May be sent until `armed_until`.
    Armed,
    /// Handed to the link.
    Sent,
    /// The rover has it.
    Received,
    /// The rover moves.
    Executing,
    /// Done as commanded.
    Done,
    /// Refused by the rover, or ended otherwise.
    Failed,
    /// Ended by a stop or E-stop.
    Aborted,
    /// The outcome is unknown: no word from the rover when there should have been one, or the ground
    /// was restarted in between. Never sent again by itself. A late word takes it further; else an
    /// operator resolves it from telemetry.
    Overdue,
    /// Taken back before it was sent.
    Cancelled,
    /// The plan's basis no longer held when it was to be armed or sent, or it waited for the link
    /// longer than a command may.
    Expired,
}

/// One transition of one command.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CommandEvent {
    /// The command.
    pub command: CommandRecord,
    /// When, on the ground.
    pub time: Timestamp,
    /// The new state.
    pub state: CommandState,
    /// Who asked for it, or `rover`, or `server`.
    pub who: String,
    /// Why, where there is something to say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// A command as the ground knows it: the fold of its events.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CommandRecord {
    /// Identity (UUID v7), given by the client or the server.
    pub id: String,
    /// What the rover is told.
    pub body: CommandBody,
    /// In words: `Lift leg 2`.
    pub title: String,
    /// The plan it belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanCommandRef>,
    /// Present state.
    pub state: CommandState,
    /// Who staged it.
    pub operator: String,
    /// When it was staged.
    pub staged: Timestamp,
    /// Until when it may be sent, once armed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub armed_until: Option<Timestamp>,
    /// When it was handed to the link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sent: Option<Timestamp>,
    /// When it reaches the rover at the earliest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arrives: Option<Timestamp>,
    /// When the ground can know of it at the earliest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub earliest_ack: Option<Timestamp>,
    /// After this time without word it is overdue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overdue_after: Option<Timestamp>,
    /// How long the motion takes as planned (s).
    pub duration_s: f64,
    /// Share done as last reported, 0 to 1.
    pub progress: f64,
    /// Why it failed or expired.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Its stages, once it was sent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub verification: Vec<Verification>,
    /// The second person's word; absent where none is needed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub approval: Option<Approval>,
    /// Number of the authority that it was sent under.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epoch: Option<u64>,
}

/// Which command of which plan: one of its `commands`, or one of its `retreat`.
///
/// A plan's commands go in order, each after the one before is done. Its way back goes likewise:
/// - `retreat` has a part for each command, in the opposite order: with n commands, part i undoes
///   command n - 1 - i.
/// - A part may be staged once the command that it undoes is done (else `not_executed`), while no
///   command of the plan is on its way or under way (else `plan_under_way`).
/// - It is armed when that command is the last one done and not undone (else `order`).
/// - Once a part is done the plan goes back only: what is staged of its commands expires, and others
///   are refused (`backing_out`). To go forward, plan anew.
/// - A command that ended elsewhere than at its end is not undone: the rover is then not where the
///   way back begins (`basis_changed`).
///
/// Basis, arming and sending are the same both ways.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanCommandRef {
    /// The plan.
    pub plan_id: String,
    /// Index into the plan's commands or, with `retreat`, into its way back.
    pub index: usize,
    /// A part of the way back; false where absent.
    #[serde(default, skip_serializing_if = "is_false")]
    pub retreat: bool,
}

fn is_false(value: &bool) -> bool {
    !value
}

/// The link as it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkReport {
    /// Its model.
    pub config: LinkConfig,
    /// Commands.
    pub up: LinkCounters,
    /// Telemetry.
    pub down: LinkCounters,
    /// Is an E-stop in force as far as the ground knows?
    pub estop: EstopState,
    /// Who may command.
    #[serde(default)]
    pub authority: AuthorityReport,
}

/// What the ground knows of the E-stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EstopState {
    /// Not in force.
    #[default]
    Clear,
    /// Sent, not yet confirmed by the rover.
    Sent,
    /// The rover has confirmed it.
    Confirmed,
    /// A release is on its way.
    ReleaseSent,
}

/// A new version of the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TerrainNotice {
    /// Name of the version.
    pub version: String,
    /// Where it came from, in words.
    pub source: String,
    /// True if foot-scale detail was added by the generator.
    pub synthetic_detail: bool,
}

/// State of long work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waits for a worker.
    Queued,
    /// Under way.
    Running,
    /// Ended with a result.
    Done,
    /// Ended with an error.
    Failed,
    /// Ended on request.
    Cancelled,
}

/// Long work and how far it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JobReport {
    /// Identity.
    pub id: String,
    /// What kind of work: `plan`, `import`, …
    pub kind: String,
    /// Its state.
    pub state: JobState,
    /// Share done, 0 to 1.
    pub progress: f64,
    /// What it is doing.
    pub doing: String,
    /// Where the result is, once done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub result: Option<String>,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<crate::resources::ErrorInfo>,
}

/// Something that happened, for the record and the operator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EventNotice {
    /// `info`, `caution`, `warning` or `critical`.
    pub level: EventLevel,
    /// What happened, in a sentence.
    pub text: String,
    /// Who did it, or `server`.
    pub who: String,
}

/// How grave an event is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventLevel {
    /// For the record.
    Info,
    /// Look at it.
    Caution,
    /// Act on it.
    Warning,
    /// Act now.
    Critical,
}

/// Where a wheel would stand: used by settle reports and plans.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Footfall {
    /// The point of ground under the wheel, in `world` (m).
    pub ground_m: [f64; 3],
    /// Unit normal of the ground there.
    pub normal: [f64; 3],
    /// Pose of the wheel.
    pub wheel: Pose,
}
