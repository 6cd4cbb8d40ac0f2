//! How observations are blended, and how what is known is read.

use crate::TerrainError;

/// How observations are blended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSettings {
    /// Distance of the nodes (m).
    pub resolution_m: f64,
    /// Observations that differ by more standard deviations than this contradict each other.
    pub gate_sigmas: f64,
    /// Growth of variance with age, q_t (m²/s).
    pub growth_m2_s: f64,
    /// Share of the noise of a height that the same view repeats, 0 to 1: the same ground in the same
    /// light misleads the matcher the same way.
    pub repeated_share: f64,
    /// No cell is known better than this (m²): points of one pair share errors.
    pub variance_min_m2: f64,
    /// Most tiles of a map; an input that needs more is refused.
    pub tiles_max: usize,
}

impl Default for MapSettings {
    fn default() -> MapSettings {
        MapSettings {
            resolution_m: 0.05,
            gate_sigmas: 3.0,
            growth_m2_s: 1e-9,
            repeated_share: 0.7,
            variance_min_m2: 4e-6,
            tiles_max: 256,
        }
    }
}

impl MapSettings {
    /// Refuses values out of range, by name.
    pub fn check(&self) -> Result<(), TerrainError> {
        let check = TerrainError::check;
        check("resolution_m", self.resolution_m, [1e-3, 1e3], "a length from 0.001 to 1000 m")?;
        check("gate_sigmas", self.gate_sigmas, [0.5, 100.0], "a number from 0.5 to 100")?;
        check("growth_m2_s", self.growth_m2_s, [0.0, 1.0], "a growth from 0 to 1 m²/s")?;
        check("repeated_share", self.repeated_share, [0.0, 1.0], "a share from 0 to 1")?;
        let expected = "a variance from 1e-12 to 1 m²";
        check("variance_min_m2", self.variance_min_m2, [1e-12, 1.0], expected)?;
        check("tiles_max", self.tiles_max as f64, [1.0, 4096.0], "a number from 1 to 4096")?;
        Ok(())
    }
}

/// What planners are given of cells that are not plainly known. The default gives nothing of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReadPolicy {
    /// Give the ground last seen in cells that the robot hides now.
    pub use_masked: bool,
    /// Give the higher of two heights that contradict each other.
    pub use_conflicts: bool,
    /// Give cells that come from an imported map only.
    pub use_prior: bool,
}

impl ReadPolicy {
    /// What a plan for real ground may rest on, and the imported map where nothing was seen yet.
    pub fn with_prior() -> ReadPolicy {
        ReadPolicy { use_prior: true, ..ReadPolicy::default() }
    }
}
