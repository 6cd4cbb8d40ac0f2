//! Stereo pairs of the live rover: what there is, what they would see, and the map made of them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::live::{FailedPair, Side, SimulatedCameras};
use crate::map_version::{HiddenGround, MapRegion};
use crate::time::Timestamp;

/// Most pairs of one request: each has a bit in the mask of a coverage.
pub const CAMERAS_MAX: usize = 16;
/// Range of the distance of nodes (m).
pub const RESOLUTION_M: [f64; 2] = [0.02, 1.0];
/// Range of the size of images, as a share of the pair's own.
pub const SCALE: [f64; 2] = [0.25, 1.0];
/// Range of the radius of a region (m).
pub const REGION_RADIUS_M: [f64; 2] = [0.5, 100.0];

/// The stereo pairs of the live rover: `GET /rover/cameras`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CamerasAnswer {
    /// In the order of the robot's folder.
    pub cameras: Vec<CameraAnswer>,
    /// Rate of telemetry (bit/s); none where the link has no limit.
    pub downlink_bps: Option<f64>,
}

/// One stereo pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CameraAnswer {
    /// Its name.
    pub name: String,
    /// `navcam`, `hazcam` or `other`, as its name begins (`nav`, `haz`).
    pub kind: String,
    /// The link that carries it.
    pub link: String,
    /// Columns and rows of each of its two images (px).
    pub size_px: [usize; 2],
    /// Distance between the cameras (m).
    pub baseline_m: f64,
    /// Middle between the cameras in the link's frame (m).
    pub position_m: [f64; 3],
    /// Where it looks, about the link's z from its x (rad).
    pub azimuth_rad: f64,
    /// ... and above the link's x-y plane (rad).
    pub elevation_rad: f64,
    /// Across the image (rad).
    pub field_of_view_rad: f64,
    /// Depths that count (m).
    pub range_m: [f64; 2],
    /// Bytes of both images, 8 bits a pixel, before any compression.
    pub raw_bytes: usize,
    /// Time that they take over the link as it is (s); none where it has no rate.
    pub downlink_s: Option<f64>,
}

/// Asks what pairs would see of the map in use: `POST /rover/cameras/coverage`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CoverageRequest {
    /// Names of the pairs, 1 to 16.
    pub cameras: Vec<String>,
    /// Distance of the nodes (m), 0.02 to 1; 0.1 where absent.
    #[serde(default)]
    pub resolution_m: Option<f64>,
    /// Size of the images that `cost` is for, 0.25 to 1; 0.5 where absent.
    #[serde(default)]
    pub scale: Option<f64>,
    /// Bits of gray that `cost` is for, 4 to 8; 8 where absent.
    #[serde(default)]
    pub depth_bits: Option<u8>,
}

/// What images are likely to cost over the link as it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImageCost {
    /// Bytes on the link, compressed.
    pub bytes: usize,
    /// Time that they take of the link (s), beside telemetry; none where it has no rate.
    pub downlink_s: Option<f64>,
    /// Time from sending the command until the last image is here (s), without losses.
    pub total_s: f64,
}

/// What pairs would see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CoverageAnswer {
    /// The map that was looked at.
    pub terrain_version: String,
    /// First node in `world` (m).
    pub origin_m: [f64; 2],
    /// Distance of the nodes (m).
    pub resolution_m: f64,
    /// Nodes along x and y.
    pub size: [usize; 2],
    /// For each node, row by row along x from low to high y, a little-endian u16 in base64: bit i is
    /// set where pair i of `cameras` sees the ground.
    pub mask_base64: String,
    /// The pairs, in the order of their bits.
    pub cameras: Vec<CoverageOfPair>,
    /// What hides ground that no pair sees and one would see without the robot, largest area first.
    pub hidden: Vec<HiddenGround>,
    /// For each node, in the order of `mask_base64`, a byte in base64: 0, or i + 1 where the i-th of
    /// `hidden` hides the ground.
    pub hidden_base64: String,
    /// Share of the nodes that at least one pair sees.
    pub seen_share: f64,
    /// Bytes of all images before any compression.
    pub raw_bytes: usize,
    /// Time that they take over the link as it is (s); none where it has no rate.
    pub downlink_s: Option<f64>,
    /// What the images would cost at `scale` and `depth_bits` of the request.
    pub cost: ImageCost,
}

/// What one pair would see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CoverageOfPair {
    /// Its name.
    pub name: String,
    /// Its bit in the mask.
    pub bit: u8,
    /// Ground that it sees (m²).
    pub area_m2: f64,
    /// Share of the nodes that it sees.
    pub seen_share: f64,
    /// Bytes of its two images before any compression.
    pub raw_bytes: usize,
}

/// How far one pair of a reconstruction is: `pairs` of its [`JobReport`](crate::live::JobReport).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PairProgress {
    /// Name of the pair.
    pub pair: String,
    /// How far it is.
    pub stage: PairStage,
    /// Share of this stage that is done, 0 to 1: of `on_the_way` the bytes that have come.
    pub fraction: f64,
    /// What there is to say, as what is missing or why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

/// How far a pair is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PairStage {
    /// The rover was asked for its images.
    Requested,
    /// Parts of them have come.
    OnTheWay,
    /// Both images are here.
    Received,
    /// They were matched: there are points.
    Matched,
    /// Its ground is part of the map.
    Fused,
    /// It is not part of the map; `message` says why.
    Failed,
}

/// Asks for a map of what pairs see now: `POST /terrain/reconstructions`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReconstructionRequest {
    /// Names of the pairs that the rover is asked to take images with, at most 16. That is an `image`
    /// command as any other: staged, armed and sent in the name of who asks.
    #[serde(default)]
    pub cameras: Vec<String>,
    /// Images that have been received already, as `capture/pair` (`GET /rover/images` lists them); with
    /// `cameras` 1 to 16 pairs in all.
    #[serde(default)]
    pub images: Vec<String>,
    /// Distance of the nodes (m), 0.02 to 1; 0.05 where absent. All reconstructions that are blended
    /// have the same.
    #[serde(default)]
    pub resolution_m: Option<f64>,
    /// Size of the images as a share of the pair's own, 0.25 to 1; 0.5 where absent.
    #[serde(default)]
    pub scale: Option<f64>,
    /// Bits of gray that the images keep, 4 to 8; 8 where absent.
    #[serde(default)]
    pub depth_bits: Option<u8>,
    /// Seed of the simulated sensors' noise; a new one each time where absent.
    #[serde(default)]
    pub seed: Option<u64>,
    /// What simulated cameras do beside; its `seed` counts where `seed` is absent.
    #[serde(default)]
    pub simulated: Option<SimulatedCameras>,
    /// Keep the map that was there before where no pair sees ground; true where absent.
    #[serde(default)]
    pub keep_prior: Option<bool>,
    /// Begin anew, without what earlier reconstructions saw.
    #[serde(default)]
    pub anew: bool,
    /// Ground outside of this disc is left out; all is taken where absent.
    #[serde(default)]
    pub region: Option<MapRegion>,
    /// Size of the images of single pairs, by name, where other than `scale`: fine near, coarse far.
    #[serde(default)]
    pub scales: BTreeMap<String, f64>,
}

/// A map that was made: `GET /terrain/reconstructions/{id}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructionAnswer {
    /// Its identity, that of the job.
    pub id: String,
    /// The version of the map that it became.
    pub terrain_version: String,
    /// When the images were taken, on board.
    pub capture_time: Timestamp,
    /// Distance of the nodes (m).
    pub resolution_m: f64,
    /// Size of the images as a share of the pair's own.
    pub scale: f64,
    /// Seed of the simulated sensors' noise.
    pub seed: u64,
    /// Was the map from before kept where no pair saw ground?
    pub keep_prior: bool,
    /// Pair by pair.
    pub pairs: Vec<ReconstructedPair>,
    /// Pairs of which not all images came.
    #[serde(default)]
    pub failed: Vec<FailedPair>,
    /// By how much hips are turned beyond what was reported, by what was seen of their legs (rad); legs that hang
    /// as reported, or were not seen, are left out.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub hip_turns_rad: BTreeMap<String, f64>,
    /// Nodes whose content changed, and their area (m²).
    pub changed_cells: usize,
    /// Area of the nodes whose content changed (m²).
    pub changed_m2: f64,
    /// Nodes whose ground was seen for the first time, and their area (m²).
    pub new_cells: usize,
    /// Area of the nodes whose ground was seen for the first time (m²).
    pub new_m2: f64,
    /// Nodes whose ground is hidden or contradicted now.
    pub lost_cells: usize,
}

/// What one pair gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructedPair {
    /// Its name.
    pub name: String,
    /// The capture that its images are of.
    #[serde(default)]
    pub capture: String,
    /// Number of its map among the sources of the blended map; none where it saw nothing.
    pub source: Option<u32>,
    /// Columns and rows of each image (px).
    pub size_px: [usize; 2],
    /// Median distance of rows of matching corners (px); below 0.5 is good.
    pub epipolar_px: Option<f64>,
    /// Share of the pixels both cameras could see that have a disparity.
    pub fill: f64,
    /// Distance of points from the plane that most lie near (m).
    pub plane_residual_m: Option<f64>,
    /// Points of the ground.
    pub terrain_points: usize,
    /// Points of the robot itself, which stay out.
    pub robot_points: usize,
    /// Points that may be of either, which stay out.
    pub shadow_band_points: usize,
    /// Nodes of ground in its map.
    pub cells: usize,
    /// Shift by which it was fitted to the map (m).
    pub shift_m: [f64; 3],
    /// Turn by which it was fitted to the map (rad).
    pub yaw_rad: f64,
    /// True if it could not be fitted and was left where it says it is.
    pub fit_refused: bool,
}

/// A version of the map that cameras made, and all that it takes to make it again from a flight log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MapRecord {
    /// The version, named by its content.
    pub terrain_version: String,
    /// Name of the blended map beneath it, with variances, times and sources, by its content; none where
    /// the map from before is in use again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blended: Option<String>,
    /// The version that it goes on from; none where it begins anew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// What was done.
    pub step: MapStep,
}

/// How a version of the map came from the one before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum MapStep {
    /// Pairs were blended in.
    Seen(SeenStep),
    /// A pair was taken out.
    Removed {
        /// Number of its map.
        source: u32,
    },
    /// A pair was put where it says it is, or where it fitted.
    Fit {
        /// Number of its map.
        source: u32,
        /// Where it fitted.
        fitted: bool,
    },
    /// An older version was put in use again.
    Selected {},
    /// Ground was set to where wheels stand.
    Contact(ContactStep),
    /// It was made again from the log of an earlier session.
    Restored {
        /// That log.
        log: String,
    },
}

/// Makes the map that cameras had made in an earlier session again: `POST /terrain/restore`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RestoreRequest {
    /// The log of that session (`GET /logs` lists them).
    pub log: String,
}

/// Wheels that were put down since the map was last told of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ContactStep {
    /// Where they stand.
    pub wheels: Vec<StoodWheel>,
    /// Radius of the wheels, of which a share is how far about a contact the ground is set (m).
    pub wheel_radius_m: f64,
    /// When, on board.
    pub time: Timestamp,
}

/// A wheel that stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StoodWheel {
    /// Its leg.
    pub leg: String,
    /// Where it touches the ground (m).
    pub contact_m: [f64; 3],
    /// The room that it takes, in which there is no ground; logs from before that was told have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solid: Option<WheelSolid>,
}

/// The room that a standing wheel takes: a cylinder, or a ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelSolid {
    /// Its center (m).
    pub center_m: [f64; 3],
    /// Direction of its axle, of length 1.
    pub axle: [f64; 3],
    /// Its radius (m).
    pub radius_m: f64,
    /// Its width along the axle (m).
    pub width_m: f64,
    /// Is it a ball?
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub ball: bool,
    /// Ground that was told higher than it can be by more than this is left (m).
    pub correction_max_m: f64,
}

/// What was expected before it was logged.
fn pair_shift_before() -> f64 {
    0.01
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Pairs that were blended in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SeenStep {
    /// The reconstruction.
    pub id: String,
    /// The map that was laid beneath in this step; none where there was one already, or none is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<String>,
    /// Was the map from before kept where no pair saw ground?
    pub keep_prior: bool,
    /// Distance of the nodes (m).
    pub resolution_m: f64,
    /// Ground outside of this was left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<MapRegion>,
    /// Share of the relief about a cell that its height may be off by; none in logs from before that counted.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub relief_share: f64,
    /// How far pairs of one stand are expected to be off each other (m).
    #[serde(default = "pair_shift_before")]
    pub pair_shift_sigma_m: f64,
    /// Where wheels stood (m).
    pub wheels_m: Vec<[f64; 3]>,
    /// The room that they took, in which there is no ground; logs from before that was told have none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub solids: Vec<WheelSolid>,
    /// The time that they, and the map from before, count from.
    pub time: Timestamp,
    /// The pairs in the order that they were blended in.
    pub pairs: Vec<RecordedPair>,
}

/// The images of a pair that a map was made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedPair {
    /// The capture.
    pub capture: String,
    /// The pair.
    pub pair: String,
    /// BLAKE3 of the left and the right image.
    pub hashes: [String; 2],
}

/// The images that were received: `GET /rover/images`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImagesAnswer {
    /// Newest last.
    pub captures: Vec<CaptureAnswer>,
}

/// What has come of one capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CaptureAnswer {
    /// The capture: identity of its command.
    pub capture: String,
    /// `on_the_way`, `complete`, `incomplete`, `let_go` or `refused`.
    pub state: String,
    /// Why, where it is not complete.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Pair by pair.
    pub pairs: Vec<CapturedPair>,
}

/// What has come of the images of a pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CapturedPair {
    /// `capture/pair`, by which a reconstruction takes it.
    pub id: String,
    /// Its name.
    pub pair: String,
    /// Are both images here?
    pub received: bool,
    /// Share of the two images that has come, 0 to 1.
    pub fraction: f64,
    /// Bytes that have come.
    pub bytes: u64,
    /// Bytes of both images, as far as is known.
    pub bytes_total: Option<u64>,
    /// When they were taken, on board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<Timestamp>,
    /// Why they will not come.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
    /// Left and right, once they are here.
    pub images: Vec<CapturedImage>,
}

/// An image that is here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CapturedImage {
    /// The camera.
    pub side: Side,
    /// Where its PNG is.
    pub url: String,
    /// Columns and rows (px).
    pub size_px: [u32; 2],
    /// Bytes of the PNG.
    pub bytes: u32,
    /// BLAKE3 of the PNG.
    pub hash: String,
}
