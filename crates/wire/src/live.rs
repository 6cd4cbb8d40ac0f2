//! What flows between ground and rover, and from the ground server to its listeners.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::analysis::{PlanAnswer, PlanRequest};
use crate::reconstruction::PairProgress;
use crate::scene::{Pose, RoverState};
use crate::time::Timestamp;

mod carrier;
mod command;
mod image;
mod link;
mod operation;
mod record;
mod stability;

pub use carrier::*;
pub use command::*;
pub use image::*;
pub use link::*;
pub use operation::*;
pub use record::*;
pub use stability::*;

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
    /// [`super::ImageReceived`]: an image of the rover has come whole.
    pub const IMAGE: &str = "image/received";
    /// [`crate::reconstruction::MapRecord`]: what a version of the map was made of.
    pub const MAP: &str = "terrain/map";
    /// [`super::PlanRecord`]: every plan of the live rover, as asked for and answered.
    pub const PLAN: &str = "plan/record";
    /// [`super::LogGap`]: messages that the flight log lacks (in logs only).
    pub const LOG_GAP: &str = "log/gap";
    /// All channels, in a fixed order.
    pub const ALL: [&str; 13] = [
        ROVER_STATE,
        ROVER_STABILITY,
        COMMAND_UPLINK,
        COMMAND_EVENT,
        LINK,
        TERRAIN,
        JOB,
        EVENT,
        ROVER_REACH,
        IMAGE,
        MAP,
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
    /// Mode of operation, brakes and drives; absent in logs of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operation: Option<Operation>,
}

/// Progress of the command under way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Executing {
    /// The command.
    pub command_id: String,
    /// Share done, 0 to 1.
    pub progress: f64,
    /// Of a sequence: the step under way, from 1, and how many there are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<[u32; 2]>,
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
    /// Move named joints of one leg to angles, joint-linear.
    JointMove {
        /// Goals (rad; m for a joint that slides) by the joints' names.
        joints_rad: BTreeMap<String, f64>,
        /// Speed of the joint that moves most (rad/s); the robot's joint speed where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed_rad_s: Option<f64>,
    },
    /// Move one leg's wheel along a straight line, turning it evenly.
    WheelMove {
        /// The leg.
        leg: String,
        /// What the goal is given in.
        #[serde(default)]
        frame: GoalFrame,
        /// Where the wheel's center goes, in `frame` (m).
        position_m: [f64; 3],
        /// By how much the wheel turns: axis times angle (rad), about axes of the base in frame `base`,
        /// else of `world`.
        #[serde(default)]
        rotation_rad: [f64; 3],
        /// Speed of its center (m/s); as fast as the joints allow where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed_m_s: Option<f64>,
    },
    /// Move the chassis over the wheels that stand, which stay.
    BodyMove {
        /// By how much, in the base's frame (m).
        translation_m: [f64; 3],
        /// Turn about axes of the base: axis times angle (rad).
        #[serde(default)]
        rotation_rad: [f64; 3],
        /// Speed of the base's origin (m/s); as fast as the joints allow where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed_m_s: Option<f64>,
    },
    /// Put wheel brakes on, or release them (mode `driving`).
    WheelBrake {
        /// The legs; all where empty.
        #[serde(default)]
        legs: Vec<String>,
        /// On or off.
        on: bool,
    },
    /// Roll a wheel that is off the ground (mode `driving`, its brake off).
    WheelRoll {
        /// The leg.
        leg: String,
        /// By how much (rad), positive ahead along its heading.
        angle_rad: f64,
        /// Spin (rad/s), 0.5 where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed_rad_s: Option<f64>,
    },
    /// Turn wheels about the vertical through their centers (mode `driving`, their brakes off).
    WheelSteer {
        /// Headings by leg, counter-clockwise from base x (rad). A wheel heads both ways: it turns by
        /// a quarter at most where its joints allow.
        headings_rad: BTreeMap<String, f64>,
    },
    /// Steer all wheels about the center of an arc and drive along it (mode `driving`, brakes off). Its
    /// center is `distance_m / turn_rad` to the left of the course.
    DriveArc {
        /// Length of the way of the base's origin in plan (m); negative is backward, zero turns on the
        /// spot.
        distance_m: f64,
        /// Change of heading (rad), counter-clockwise; zero drives straight.
        #[serde(default)]
        turn_rad: f64,
        /// Direction of travel at the beginning, counter-clockwise from base x (rad).
        #[serde(default)]
        course_rad: f64,
        /// Speed of the fastest wheel (m/s); 0.1 at scale 1 where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed_m_s: Option<f64>,
    },
    /// End what is under way as soon as the stance has its margin, and put all brakes on.
    Hold {},
    /// Take another mode of operation.
    Mode {
        /// Which.
        mode: OperatingMode,
    },
    /// Steps one after another on board; the first that fails ends it, and those after it are not
    /// begun.
    Sequence {
        /// 1 to 100 steps.
        steps: Vec<SequenceStep>,
    },
    /// Finish the step of the sequence under way; the rest of it is cancelled.
    CancelRest {},
    /// Stop where the rover is and stay in mode `idle`; what was under way is aborted.
    Stop {},
    /// Take images. Nothing moves; taken in every mode, also while something moves.
    Image(ImageOrder),
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
        /// What must hold when it begins. The rover refuses the command else.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        preconditions: Vec<Precondition>,
    },
    /// The ground is there. A rover that hears nothing for long makes itself safe.
    Heartbeat {},
    /// What is asked of images that were taken.
    Image(ImageUp),
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
    /// A part of an image.
    Image(ImageDown),
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
    /// Queues of commands in which something waits, highest class first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub up_queues: Vec<QueueFill>,
    /// ... of telemetry.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub down_queues: Vec<QueueFill>,
    /// Is an E-stop in force as far as the ground knows?
    pub estop: EstopState,
    /// Who may command.
    #[serde(default)]
    pub authority: AuthorityReport,
    /// The connection to the rover, where that is a process of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carrier: Option<CarrierReport>,
    /// The flight log; absent in logs that are older than this word.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight_log: Option<FlightLogReport>,
}

/// The flight log as it is.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightLogReport {
    /// Why the disk does not take everything at present: no command is staged, armed or sent then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Messages of this session that it lacks.
    pub dropped: u64,
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
    /// Pair by pair, how far a reconstruction is; empty for other work.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<PairProgress>,
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
