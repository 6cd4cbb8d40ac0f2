//! Where a foot can stand on a map.

use serde::{Deserialize, Serialize};
use terrain::traversability::Limits;
use utoipa::ToSchema;

use crate::scene::Terrain;

/// The layers of an answer, in the order of the bands of a GeoTIFF.
pub const TRAVERSABILITY_LAYERS: [&str; 6] =
    ["slope_rad", "roughness_m", "step_m", "goodness", "certainty", "class"];

/// `POST /analysis/traversability`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TraversabilityRequest {
    /// The ground; the live one where absent (level ground on the command line).
    #[serde(default)]
    pub terrain: Option<Terrain>,
    /// Width of the foot (m), 0.001 to 1000; it becomes the nearest odd number of cells.
    #[serde(default)]
    pub footprint_m: Option<f64>,
    /// Thresholds.
    #[serde(default)]
    pub limits: LimitsChange,
    /// Time allowed (s), 0.001 to 3600; 30 where absent.
    #[serde(default)]
    pub deadline_s: Option<f64>,
    /// Work budget: taken by every request, without effect where all of the work is done anyway.
    #[serde(default)]
    pub budget: Option<u64>,
}

/// Changes to the default thresholds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsChange {
    /// Slope that is fully good (rad).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slope_lo_rad: Option<f64>,
    /// Slope that is fully bad (rad).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slope_hi_rad: Option<f64>,
    /// Roughness that is fully good (m).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roughness_lo_m: Option<f64>,
    /// Roughness that is fully bad (m).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roughness_hi_m: Option<f64>,
    /// Step that is fully good (m).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_lo_m: Option<f64>,
    /// Step that is fully bad (m).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_hi_m: Option<f64>,
    /// Unknown below this known share of the window.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known_share_min: Option<f64>,
    /// Unknown below this known share of any quadrant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quadrant_known_min: Option<f64>,
    /// Unsafe below this goodness.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsafe_below: Option<f64>,
    /// Caution below this goodness.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub caution_below: Option<f64>,
    /// Caution below this certainty.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub certainty_caution_below: Option<f64>,
}

impl LimitsChange {
    /// These limits where given, `base` elsewhere; checked by `terrain`.
    pub fn over(&self, base: &Limits) -> Limits {
        let pick = |change: Option<f64>, base: f64| change.unwrap_or(base);
        Limits {
            slope_lo_rad: pick(self.slope_lo_rad, base.slope_lo_rad),
            slope_hi_rad: pick(self.slope_hi_rad, base.slope_hi_rad),
            roughness_lo_m: pick(self.roughness_lo_m, base.roughness_lo_m),
            roughness_hi_m: pick(self.roughness_hi_m, base.roughness_hi_m),
            step_lo_m: pick(self.step_lo_m, base.step_lo_m),
            step_hi_m: pick(self.step_hi_m, base.step_hi_m),
            known_share_min: pick(self.known_share_min, base.known_share_min),
            quadrant_known_min: pick(self.quadrant_known_min, base.quadrant_known_min),
            unsafe_below: pick(self.unsafe_below, base.unsafe_below),
            caution_below: pick(self.caution_below, base.caution_below),
            certainty_caution_below: pick(
                self.certainty_caution_below,
                base.certainty_caution_below,
            ),
        }
    }
}

/// Answer to [`TraversabilityRequest`]. Cells go row by row along x, from low to high y.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TraversabilityAnswer {
    /// Names of the layers, in the order of a GeoTIFF's bands.
    pub layers: Vec<String>,
    /// Center of cell (0, 0) (m).
    pub origin_m: [f64; 2],
    /// Distance between cells (m).
    pub resolution_m: f64,
    /// Cells along x and y.
    pub size: [usize; 2],
    /// Distance between the map's own cells (m): larger where they were too coarse for the foot.
    pub source_resolution_m: f64,
    /// Width of the window used (m).
    pub footprint_m: f64,
    /// The same in cells, odd.
    pub window: usize,
    /// Number of cells of each class: unknown, unsafe, caution, safe.
    pub class_cells: [usize; 4],
    /// Slope: base64 of little-endian f32, NaN where there is none. Here and below left out where
    /// the layers went to a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slope_rad: Option<String>,
    /// Roughness, as `slope_rad`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness_m: Option<String>,
    /// Step, as `slope_rad`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step_m: Option<String>,
    /// Goodness, 0 to 1, as `slope_rad`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goodness: Option<String>,
    /// Certainty, 0 to 1, as `slope_rad`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certainty: Option<String>,
    /// Class: base64 of u8: 0 unknown, 1 unsafe, 2 caution, 3 safe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// The file that the layers went to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
}
