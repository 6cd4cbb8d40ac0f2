//! What a version of a map that cameras made consists of, and what came of it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::time::Timestamp;

/// How a version came from the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum VersionStep {
    /// Pairs were added.
    Seen,
    /// A pair was taken out.
    Removed,
    /// A pair was put where it says it is, its fit to the map undone.
    FitUndone,
    /// A pair was fitted to the map again.
    FitRedone,
    /// Ground was set to where wheels stand.
    Contact,
}

/// What differs from the version before, of the ground that was seen: the map from before does not count.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VersionChanges {
    /// The version before.
    pub since: String,
    /// What was done.
    pub step: VersionStep,
    /// The same in words, as `added nav1, haz1`.
    pub what: String,
    /// Nodes whose content changed.
    pub changed_cells: usize,
    /// Their area (m²).
    pub changed_m2: f64,
    /// Nodes whose ground is known now and was not.
    pub new_cells: usize,
    /// Their area (m²).
    pub new_m2: f64,
    /// Nodes whose ground was known and is hidden, contradicted or taken out now.
    pub gone_cells: usize,
    /// Their area (m²).
    pub gone_m2: f64,
}

/// What one capture of a pair is in a version.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VersionPair {
    /// Its number among the sources of the map.
    pub source: u32,
    /// Name of the pair.
    pub name: String,
    /// When its images were taken, on board.
    pub capture_time: Timestamp,
    /// The reconstruction that brought it.
    pub reconstruction: String,
    /// Nodes of ground in its own map.
    pub cells: usize,
    /// Median distance of rows of matching corners (px).
    pub epipolar_px: Option<f64>,
    /// Share of the pixels both cameras could see that have a disparity.
    pub fill: f64,
    /// Distance of points from the plane that most lie near (m).
    pub plane_residual_m: Option<f64>,
    /// Shift that fits it to the map (m), as found.
    pub shift_m: [f64; 3],
    /// Turn that fits it to the map (rad), as found.
    pub yaw_rad: f64,
    /// False where the shift was undone, or none was found.
    pub fitted: bool,
    /// True if it could not be fitted.
    pub fit_refused: bool,
}

/// Asks for a pair to be fitted or not: `PUT /terrain/{version}/pairs/{source}/fit`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FitRequest {
    /// False puts the pair where it says it is; true, where it fitted the map.
    pub fitted: bool,
}

/// Ground that a part of the robot hides from the pairs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HiddenGround {
    /// The leg, or the link where it is no leg's.
    pub by: String,
    /// Its area (m²).
    pub area_m2: f64,
    /// A node of it, that nearest to its middle (m).
    pub place_m: [f64; 2],
}

/// A disc of ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MapRegion {
    /// Its middle in `world` (m).
    pub center_m: [f64; 2],
    /// Its radius (m), 0.5 to 100.
    pub radius_m: f64,
}
