//! Where a leg can stand, and why not elsewhere.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{base64_bytes, base64_f32};
use crate::scene::Scene;
use crate::tile::{Format, Header};

/// Names of the classes, by their number (F42-F46). The last two are those of reachable cells that a
/// step was really planned to.
pub const REACH_CLASSES: [&str; 8] = [
    "unknown",
    "unreachable",
    "unstable",
    "no_lift",
    "reachable",
    "colliding",
    "plannable",
    "not_plannable",
];

/// Number of the class of cells where a leg can stand.
pub const REACHABLE: u8 = 4;
/// ... of those that a step was really planned to.
pub const PLANNABLE: u8 = 6;
/// ... and of those that none was found to.
pub const NOT_PLANNABLE: u8 = 7;

/// Names of the reasons, by their number.
pub const REACH_REASONS: [&str; 15] = [
    "none",
    "out_of_reach",
    "joint_limit",
    "unknown_ground",
    "margin",
    "settlement",
    "environment_collision",
    "self_collision",
    "lift_out_of_reach",
    "lift_collision",
    "torque",
    "uneven_ground",
    "start_lift",
    "traversability",
    "no_plan",
];

/// Number of the reason of cells that no step was found to.
pub const NO_PLAN: u8 = 14;

/// `POST /analysis/reachability`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReachabilityRequest {
    /// Robot, ground, obstacles, state.
    #[serde(default)]
    pub scene: Scene,
    /// The legs; all where absent.
    #[serde(default)]
    pub legs: Option<Vec<String>>,
    /// Distance between cells (m), 0.001 to 10; 0.1 times the robot's scale where absent.
    #[serde(default)]
    pub resolution_m: Option<f64>,
    /// Height of the waypoints above start and footfall (m), 0 to 2; 0.2 times the robot's scale
    /// where absent.
    #[serde(default)]
    pub lift_m: Option<f64>,
    /// What must hold while the leg is up.
    #[serde(default)]
    pub stability: StabilityPreference,
    /// Take ground that is unsafe for a wheel too. Otherwise it is refused where that is known: on
    /// the server's own map.
    #[serde(default)]
    pub unsafe_ground: bool,
    /// Heading (rad, from x towards y) in which the wheel is to roll where it is put down; any where
    /// absent.
    #[serde(default)]
    pub wheel_heading_rad: Option<f64>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// Work budget: taken by every request, without effect where all of the work is done anyway.
    #[serde(default)]
    pub budget: Option<u64>,
}

/// Which loss of support a step must survive.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StabilityPreference {
    /// The robot's regular margin, and a settlement of any one foot.
    #[default]
    Regular,
    /// Beside these, the full loss of any one standing leg.
    Conservative,
    /// Beside the regular rule, the robot's regular margin also within the region that friction
    /// holds.
    Friction,
}

/// `POST /analysis/reachability/cell`: why a leg can not stand at a place, and what would help.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CellExplanationRequest {
    /// Robot, ground, obstacles, state.
    #[serde(default)]
    pub scene: Scene,
    /// The leg.
    pub leg: String,
    /// The place `[x, y]` in `world` (m).
    pub position_m: [f64; 2],
    /// Height of the waypoints above start and footfall (m), 0 to 2; 0.2 times the robot's scale
    /// where absent.
    #[serde(default)]
    pub lift_m: Option<f64>,
    /// What must hold while the leg is up.
    #[serde(default)]
    pub stability: StabilityPreference,
    /// Take ground that is unsafe for a wheel too.
    #[serde(default)]
    pub unsafe_ground: bool,
    /// Heading (rad) in which the wheel is to roll; any where absent.
    #[serde(default)]
    pub wheel_heading_rad: Option<f64>,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// Work budget: taken by every request, without effect where all of the work is done anyway.
    #[serde(default)]
    pub budget: Option<u64>,
}

/// Answer to [`CellExplanationRequest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellExplanation {
    /// Name of the class.
    pub class: String,
    /// Name of the reason.
    pub reason: String,
    /// What is missing, in the reason's measure (m, rad, or a share).
    pub missing: Option<f64>,
    /// Regular margin with the leg there (m).
    pub margin_m: Option<f64>,
    /// What stands in the way, by name: a joint, two bodies, or the rule of the stance.
    pub obstruction: Option<String>,
    /// Where two bodies are too near to each other (m).
    pub obstruction_at_m: Option<[f64; 3]>,
    /// What would help, each of it tried; nearest first.
    pub mends: Vec<CellMend>,
    /// All of it in one or two sentences.
    pub text: String,
}

/// Something that would help.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellMend {
    /// A shift of the body over its planted wheels, in `world` (m); upward is standing taller.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift_m: Option<[f64; 3]>,
    /// Another place `[x, y]` (m) that the leg can reach.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place_m: Option<[f64; 2]>,
}

/// `PUT /rover/reachability`: for which preference it is kept up to date.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LiveReachRequest {
    /// What must hold while a leg is up.
    pub stability: StabilityPreference,
}

/// Answer to [`ReachabilityRequest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReachabilityAnswer {
    /// A grid for each leg.
    pub legs: BTreeMap<String, ReachabilityGrid>,
    /// What the numbers mean.
    pub legend: ReachabilityLegend,
}

/// Meaning of the numbers in a grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReachabilityLegend {
    /// Names of the classes, by their number.
    pub class: Vec<String>,
    /// Names of the reasons, by their number.
    pub reason: Vec<String>,
}

/// One leg's answer per cell. Cells go row by row along x, from low to high y.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReachabilityGrid {
    /// Center of cell (0, 0), in `world` (m).
    pub origin_m: [f64; 2],
    /// Distance between cells (m).
    pub resolution_m: f64,
    /// Cells along x and y.
    pub size: [usize; 2],
    /// Class of each cell: base64 of u8.
    pub class: String,
    /// Reason of each cell: base64 of u8.
    pub reason: String,
    /// What is missing in the reason's measure (m, N m or rad), NaN where nothing is: base64 of
    /// little-endian f32.
    pub missing: String,
    /// Margin of stability with the leg up (m), NaN where there is none: base64 of little-endian
    /// f32.
    pub margin_m: String,
}

/// The values of one grid, before they are encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct ReachabilityCells {
    /// Center of cell (0, 0), in `world` (m).
    pub origin_m: [f64; 2],
    /// Distance between cells (m).
    pub resolution_m: f64,
    /// Cells along x and y.
    pub size: [usize; 2],
    /// Classes, numbers of [`REACH_CLASSES`].
    pub class: Vec<u8>,
    /// Reasons, numbers of [`REACH_REASONS`].
    pub reason: Vec<u8>,
    /// What is missing.
    pub missing: Vec<f32>,
    /// Margins (m).
    pub margin: Vec<f32>,
}

impl ReachabilityCells {
    /// As JSON has it.
    pub fn to_grid(&self) -> ReachabilityGrid {
        ReachabilityGrid {
            origin_m: self.origin_m,
            resolution_m: self.resolution_m,
            size: self.size,
            class: base64_bytes(&self.class),
            reason: base64_bytes(&self.reason),
            missing: base64_f32(&self.missing),
            margin_m: base64_f32(&self.margin),
        }
    }

    /// As [`crate::tile`] describes it.
    pub fn to_binary(&self) -> Vec<u8> {
        let header = Header {
            format: Format::U8,
            planes: 4,
            size: self.size.map(|n| n as u32),
            origin_m: self.origin_m,
            resolution_m: self.resolution_m,
            z_min_m: 0.0,
            z_scale_m: 0.0,
            time_ns: 0,
        };
        let mut out = header.encode().to_vec();
        out.extend_from_slice(&self.class);
        out.extend_from_slice(&self.reason);
        out.resize(out.len().next_multiple_of(4), 0);
        for value in self.missing.iter().chain(&self.margin) {
            out.extend_from_slice(&value.to_le_bytes());
        }
        out
    }
}

impl ReachabilityLegend {
    /// The one there is.
    pub fn new() -> ReachabilityLegend {
        ReachabilityLegend {
            class: REACH_CLASSES.map(String::from).into(),
            reason: REACH_REASONS.map(String::from).into(),
        }
    }
}

impl Default for ReachabilityLegend {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tile::HEADER_LEN;

    #[test]
    fn the_numbers_are_those_of_the_names() {
        let class = |number: u8| REACH_CLASSES[usize::from(number)];
        let named = [REACHABLE, PLANNABLE, NOT_PLANNABLE].map(class);
        assert_eq!(named, ["reachable", "plannable", "not_plannable"]);
        assert_eq!(REACH_REASONS[usize::from(NO_PLAN)], "no_plan");
    }

    #[test]
    fn floats_of_a_binary_grid_begin_at_a_multiple_of_four() {
        let cells = ReachabilityCells {
            origin_m: [0.0, 0.0],
            resolution_m: 0.1,
            size: [3, 1],
            class: vec![4, 4, 1],
            reason: vec![0, 0, 1],
            missing: vec![f32::NAN, f32::NAN, 0.5],
            margin: vec![0.25, 0.5, 0.75],
        };
        let bytes = cells.to_binary();
        let floats_at = HEADER_LEN + 8; // six bytes of classes and reasons, two of padding
        assert_eq!(bytes.len(), floats_at + 24);
        assert_eq!(bytes[floats_at + 8..floats_at + 12], 0.5_f32.to_le_bytes());
        assert_eq!(bytes[floats_at + 12..floats_at + 16], 0.25_f32.to_le_bytes());
    }
}
