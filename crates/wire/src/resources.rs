//! What the HTTP routes of the live rover take and give, and the frames of the stream.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::live::{
    CommandBody, CommandRecord, LinkReport, PlanCommandRef, Precondition, RoverTelemetry,
    StabilityDerived,
};
use crate::map_version::{VersionChanges, VersionPair};
use crate::scene::{Payload, Recipe};
use crate::time::Timestamp;

/// Every error answer of the API.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorBody {
    /// What went wrong.
    pub error: ErrorInfo,
}

/// What went wrong and how to mend it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorInfo {
    /// A stable word for programs.
    pub code: String,
    /// A sentence for people: what, and the way out.
    pub message: String,
    /// Values that belong to it.
    #[serde(default, skip_serializing_if = "serde_json::Value::is_null")]
    #[schema(value_type = Object)]
    pub details: serde_json::Value,
}

/// `GET /rover`: the live rover.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RoverAnswer {
    /// Its model.
    pub model: RoverModel,
    /// The last frame received; none before the first.
    pub latest: Option<LatestFrame>,
    /// Stability derived from it.
    pub stability: Option<StabilityDerived>,
    /// The map it stands on.
    pub terrain_version: String,
    /// The link.
    pub link: LinkReport,
    /// Server time.
    pub now: Timestamp,
    /// True for the simulated rover.
    pub simulated: bool,
    /// The flight log being written.
    pub log_id: String,
}

/// What a console must know of the robot model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RoverModel {
    /// Folder name.
    pub robot: String,
    /// Version stamp of the model (hash of folder, scale and payloads).
    pub model_hash: String,
    /// Factor on the folder's lengths.
    pub scale: f64,
    /// The legs in order.
    pub legs: Vec<LegModel>,
    /// Name of the base link.
    pub base_link: String,
    /// Payloads carried.
    pub payloads: Vec<Payload>,
    /// Gravity (m/s²).
    pub gravity_m_s2: f64,
    /// Total mass with payloads (kg).
    pub mass_kg: f64,
    /// Smallest regular margin that the margin rule asks for (m).
    pub margin_m: f64,
    /// Settlement of one foot that must be survived (m).
    pub settlement_m: f64,
    /// Joint speed (rad/s).
    pub joint_speed_rad_s: f64,
}

/// What a console must know of a leg.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LegModel {
    /// Name, as in every other message.
    pub name: String,
    /// URDF joints from the hip outward.
    pub joints: Vec<String>,
    /// Limits (rad; m for a prismatic joint), one `[lower, upper]` a joint.
    pub limits_rad: Vec<[f64; 2]>,
    /// Torque limits (N m; force limit in N for a prismatic joint).
    pub torque_limits_nm: Vec<f64>,
    /// URDF link of the wheel or of the ball foot.
    pub wheel_link: String,
    /// URDF joint of the wheel; empty for a ball foot.
    pub wheel_joint: String,
    /// Radius of the wheel or of the ball foot (m).
    pub wheel_radius_m: f64,
    /// Width of the wheel (m); the diameter of a ball foot.
    pub wheel_width_m: f64,
    /// Greatest distance of the wheel center from the first joint (m).
    pub reach_m: f64,
}

/// A telemetry frame with its times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LatestFrame {
    /// When it was true, on board.
    pub onboard_time: Timestamp,
    /// When it came to the ground.
    pub received_time: Timestamp,
    /// Its number.
    pub sequence: u64,
    /// The frame.
    pub frame: RoverTelemetry,
}

/// One version of the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TerrainVersion {
    /// Name: hash of the content.
    pub version: String,
    /// Where it came from, in words.
    pub source: String,
    /// True if foot-scale detail was added by the generator.
    pub synthetic_detail: bool,
    /// When it became the map.
    pub created: Timestamp,
    /// Position of node (0, 0) (m).
    pub origin_m: [f64; 2],
    /// Distance between nodes (m).
    pub resolution_m: f64,
    /// Nodes along x and y.
    pub size: [usize; 2],
    /// Lowest and highest known height (m).
    pub z_range_m: [f64; 2],
    /// Share of known nodes.
    pub known_share: f64,
    /// Source coordinates = local coordinates + this (m).
    pub frame_offset_m: [f64; 3],
    /// Name of the reference system of the source coordinates; none where the source names none: a local frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_system: Option<String>,
    /// Tiles along x and y, 256 cells each.
    pub tiles: [usize; 2],
    /// Zoom levels: at level z nodes are 2^z times as far apart; the last is a single tile.
    pub zooms: usize,
    /// Layers that can be asked for.
    pub layers: Vec<String>,
    /// What came of it against the version before; none of an imported map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changes: Option<VersionChanges>,
    /// The captures of stereo pairs in it, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<VersionPair>,
    /// What the values of `source` tiles stand for, from 1 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<String>,
    /// Newest capture in it, on board; none of an imported map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub captured: Option<Timestamp>,
}

/// `GET /terrain/versions`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TerrainVersions {
    /// The one in use.
    pub current: String,
    /// All that are kept, newest first.
    pub versions: Vec<TerrainVersion>,
}

/// `GET /terrain/files`: what can be imported.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TerrainFiles {
    /// The files of the terrain folder, by name.
    pub files: Vec<TerrainFile>,
}

/// A file of the terrain folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TerrainFile {
    /// Name.
    pub name: String,
    /// Size in bytes.
    pub size: u64,
}

/// `POST /terrain/imports`: a new map from a file or a recipe; the simulated rover is seated anew.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportRequest {
    /// A file of the terrain folder (see `PUT /terrain/files/{name}`).
    #[serde(default)]
    pub file: Option<String>,
    /// Or a synthetic terrain.
    #[serde(default)]
    pub recipe: Option<Recipe>,
    /// Seed of the recipe or of the added detail.
    #[serde(default)]
    pub seed: u64,
    /// Part of the file to take.
    #[serde(default)]
    pub crop: Option<ImportCrop>,
    /// Distance of the nodes (m) where the file does not tell: of a point cloud (0.05 where absent), and
    /// of a PDS3 image without a map scale.
    #[serde(default)]
    pub cell_m: Option<f64>,
    /// Add foot-scale detail of this resolution (m); the map is then marked as synthetic.
    #[serde(default)]
    pub detail_resolution_m: Option<f64>,
    /// Where the rover is to stand, `[x, y]` in the new map's local frame (m); its middle where
    /// absent.
    #[serde(default)]
    pub place_m: Option<[f64; 2]>,
    /// Heading there (rad), counter-clockwise from x.
    #[serde(default)]
    pub heading_rad: f64,
}

/// A square part of a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportCrop {
    /// Middle of the part, from the file's lower left corner (m); the file's middle where absent.
    #[serde(default)]
    pub center_m: Option<[f64; 2]>,
    /// Side of the square (m).
    pub width_m: f64,
}

/// `POST /commands`: stages a command of a plan, or one given by hand. Exactly one of `plan` and
/// `body`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StageRequest {
    /// Identity (UUID) chosen by the client, so that a repeat stages nothing twice.
    #[serde(default)]
    pub id: Option<String>,
    /// A command of a plan.
    #[serde(default)]
    pub plan: Option<PlanCommandRef>,
    /// A command by hand.
    #[serde(default)]
    pub body: Option<CommandBody>,
    /// What telemetry must show when it is released, and when it begins on board.
    #[serde(default)]
    pub preconditions: Vec<Precondition>,
    /// Everything but the release: checks what staging, arming and sending would, and stages nothing.
    #[serde(default)]
    pub dry_run: bool,
}

/// `POST /commands/{id}/approve`: the second person's word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ApproveRequest {
    /// Hash of the content that was looked at, as the command's `approval` has it.
    pub content_hash: String,
}

/// `POST /commands/{id}/resolve`: what telemetry shows of a command whose outcome was unknown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResolveRequest {
    /// Was it done as commanded?
    pub done: bool,
    /// What shows it, 1 to 500 characters.
    pub why: String,
}

/// `POST /authority/acquire`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AuthorityRequest {
    /// Take it from whoever has it.
    #[serde(default)]
    pub take_over: bool,
}

/// `POST /authority/hand-over`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct HandOverRequest {
    /// The operator who is to have it, by the name that goes with their requests.
    pub to: String,
}

/// `GET /link/presets`: a link to begin with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LinkPreset {
    /// Its name.
    pub name: String,
    /// What it is.
    pub title: String,
    /// For `PUT /link`.
    pub config: crate::live::LinkConfig,
}

/// `GET /commands`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CommandList {
    /// All of this session, newest last.
    pub commands: Vec<CommandRecord>,
}

/// `POST /estop/release`: asked twice, with the token of the first answer in the second request.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EstopReleaseRequest {
    /// The token of the first answer.
    #[serde(default)]
    pub token: Option<String>,
}

/// Answer of the E-stop routes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EstopAnswer {
    /// What the ground knows.
    pub state: crate::live::EstopState,
    /// When the rover gets it at the earliest.
    pub takes_effect: Timestamp,
    /// First step of a release: the token that the second step needs, valid for 10 s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
}

/// One flight log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LogInfo {
    /// Identity.
    pub id: String,
    /// Size in bytes.
    pub size: u64,
    /// Time of the first message.
    pub start: Option<Timestamp>,
    /// Time of the last message.
    pub end: Option<Timestamp>,
    /// Number of messages.
    pub messages: u64,
    /// True for the log being written.
    pub open: bool,
}

/// `GET /logs`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LogList {
    /// Newest first.
    pub logs: Vec<LogInfo>,
}

/// `POST /logs/{id}/clips`: a part of a log as a log of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ClipRequest {
    /// From this time on; from the beginning where absent.
    #[serde(default)]
    pub from: Option<Timestamp>,
    /// Up to and with this time; to the end where absent.
    #[serde(default)]
    pub to: Option<Timestamp>,
    /// Channels; all where absent.
    #[serde(default)]
    pub channels: Option<Vec<String>>,
}

/// A place of a log that somebody has marked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Bookmark {
    /// Identity.
    pub id: String,
    /// The place, by log time.
    pub at: Timestamp,
    /// Where it ends, if it is a stretch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Timestamp>,
    /// What is said of it.
    pub text: String,
    /// Who said it.
    pub who: String,
    /// When it was said.
    pub made: Timestamp,
}

/// `POST /logs/{id}/bookmarks`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BookmarkRequest {
    /// The place, by log time.
    pub at: Timestamp,
    /// Where it ends, if it is a stretch.
    #[serde(default)]
    pub until: Option<Timestamp>,
    /// What is said of it: 1 to 500 characters.
    pub text: String,
}

/// `GET /logs/{id}/bookmarks`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BookmarkList {
    /// By their places.
    pub bookmarks: Vec<Bookmark>,
}

/// `POST /replays`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReplayRequest {
    /// The log.
    pub log: String,
    /// Start here; its beginning where absent.
    #[serde(default)]
    pub from: Option<Timestamp>,
    /// Speed, 0.1 to 1000.
    #[serde(default = "one")]
    pub rate: f64,
}

/// `PATCH /replays/{id}`: what is absent stays.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReplayChange {
    /// Go there.
    #[serde(default)]
    pub at: Option<Timestamp>,
    /// Speed, 0.1 to 1000.
    #[serde(default)]
    pub rate: Option<f64>,
    /// Hold or go on.
    #[serde(default)]
    pub paused: Option<bool>,
    /// With `true`: hold, and give the next message, whenever it was.
    #[serde(default)]
    pub step: Option<bool>,
}

/// A replay as it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReplayState {
    /// Identity; subscribe to it on the stream.
    pub id: String,
    /// The log.
    pub log: String,
    /// Its first message.
    pub start: Timestamp,
    /// Its last message.
    pub end: Timestamp,
    /// Where the replay is.
    pub at: Timestamp,
    /// Speed.
    pub rate: f64,
    /// Holds.
    pub paused: bool,
    /// Has come to the end.
    pub ended: bool,
}

/// How the margins went before the place of a replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReplayMargins {
    /// Oldest first: the least of each half second on board, at most of the last five minutes.
    pub samples: Vec<MarginsThen>,
    /// False where the log has more of these five minutes than is read at once.
    pub complete: bool,
}

/// Margins at a time; each absent where there was no such region, or it was not known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MarginsThen {
    /// On board.
    pub at: Timestamp,
    /// In the regular support polygon (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regular_m: Option<f64>,
    /// In the conservative region (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conservative_m: Option<f64>,
    /// In the region that friction holds (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction_m: Option<f64>,
}

fn one() -> f64 {
    1.0
}

/// What a listener sends on `WS /stream`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
pub enum StreamRequest {
    /// Messages of these channels, please. The latest message of each comes at once.
    Subscribe {
        /// Names of channels; all where absent.
        #[serde(default)]
        channels: Option<Vec<String>>,
        /// The live rover where absent, else the id of a replay.
        #[serde(default)]
        replay: Option<String>,
    },
    /// No more of that source.
    Unsubscribe {
        /// The live rover where absent, else the id of a replay.
        #[serde(default)]
        replay: Option<String>,
    },
    /// Answered with `pong` and the same number: measures the way to the server.
    Ping {
        /// Any number.
        nonce: u32,
    },
}

/// What the server sends on `WS /stream`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "op", rename_all = "snake_case")]
pub enum StreamFrame {
    /// First of all.
    Hello {
        /// Server time.
        now: Timestamp,
        /// Name of this connection.
        connection: String,
    },
    /// A message of a channel.
    Message {
        /// None for the live rover, else the replay.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        replay: Option<String>,
        /// Its channel.
        channel: String,
        /// Its number on that channel.
        sequence: u64,
        /// When it was true: on board for what the rover sent, on the ground for all else.
        onboard_time: Timestamp,
        /// When it was handed to the link, or written.
        sent_time: Timestamp,
        /// When it came to the ground.
        received_time: Timestamp,
        /// The message itself, as the channel says.
        #[schema(value_type = Object)]
        message: serde_json::Value,
    },
    /// Messages that this listener was too slow for.
    Gap {
        /// None for the live rover.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        replay: Option<String>,
        /// How many.
        missed: u64,
    },
    /// Where a replay is now; on change and once a second.
    Replay {
        /// The replay.
        state: ReplayState,
    },
    /// Answer to `ping`.
    Pong {
        /// The same number.
        nonce: u32,
        /// Server time.
        now: Timestamp,
    },
    /// A request that could not be met.
    Error {
        /// Why.
        error: ErrorInfo,
    },
}

/// How the height of a node is known, on maps that were made of what cameras see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellSeen {
    /// The stereo pair that saw it last; none where it comes from the map from before.
    pub camera: Option<String>,
    /// When that was, on board.
    pub capture_time: Timestamp,
    /// Standard deviation of the height at that time (m).
    pub sigma_m: f64,
    /// Observations that went into the height.
    pub observations: u16,
    /// True if no pair saw it yet: it is as in the map from before.
    pub prior: bool,
    /// True if the robot hides it now: the height is the last one known.
    pub hidden: bool,
}

/// Everything known of a cell: `GET /terrain/{version}/cell`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellAnswer {
    /// The place asked for (m).
    pub position_m: [f64; 2],
    /// Height (m).
    pub height_m: Option<f64>,
    /// Unit normal of the wheel-sized patch.
    pub normal: Option<[f64; 3]>,
    /// Slope (rad).
    pub slope_rad: Option<f64>,
    /// Roughness (m).
    pub roughness_m: Option<f64>,
    /// Step (m).
    pub step_m: Option<f64>,
    /// Goodness, 0 to 1.
    pub goodness: Option<f64>,
    /// Certainty, 0 to 1.
    pub certainty: Option<f64>,
    /// 0 unknown, 1 unsafe, 2 caution, 3 safe.
    pub class: u8,
    /// Known share of the window, 0 to 1.
    pub known_share: Option<f64>,
    /// Slope, roughness and step with the thresholds they were held against; the least goodness
    /// decides.
    pub components: Vec<CellComponent>,
    /// What doubt of the heights makes of it, which is in `class`; none where the class is unknown, and on maps that no
    /// camera made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubt: Option<CellDoubt>,
    /// Which pair saw it, and when; none on maps that no camera made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<CellSeen>,
}

/// What a cell may be, so far as its heights are not sure. Where that is not safe, neither is its class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellDoubt {
    /// Standard deviations of the height that count.
    pub sigmas: f64,
    /// Standard deviation of its height (m); none where it has no height, and nothing is safe.
    pub sigma_m: Option<f64>,
    /// Step that may be there (m).
    pub step_m: Option<f64>,
    /// Slope that may be there (rad).
    pub slope_rad: Option<f64>,
    /// The class as it looks, without doubt.
    pub class_as_seen: u8,
}

/// One of the values that goodness is the least ramp of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellComponent {
    /// `slope_rad`, `roughness_m` or `step_m`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Fully good at this value and below.
    pub lo: f64,
    /// Fully bad at this value and above.
    pub hi: f64,
    /// Goodness in between, 0 to 1.
    pub goodness: f64,
    /// Where the default thresholds come from.
    pub reason: String,
}
