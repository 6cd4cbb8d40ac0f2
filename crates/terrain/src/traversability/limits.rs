//! The thresholds of goodness and class.

use crate::TerrainError;

/// Why the default ramps of slope, roughness and step are as they are, in this order.
pub const RAMP_REASONS: [&str; 3] = [
    "a friction of 0.5 holds 26.6 degrees; this keeps a margin (own choice)",
    "fully bad at 0.05 m: the critical value of traversability_estimation (ANYbotics)",
    "fully bad at a quarter of the wheel's diameter: what a compliant tire rolls over (Sliding Gait, 2011)",
];

/// Ramps (goodness 1 at `lo` or below, 0 at `hi` or above) and class thresholds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Slope that is fully good (rad).
    pub slope_lo_rad: f64,
    /// Slope that is fully bad (rad).
    pub slope_hi_rad: f64,
    /// Roughness that is fully good (m).
    pub roughness_lo_m: f64,
    /// Roughness that is fully bad (m).
    pub roughness_hi_m: f64,
    /// Step that is fully good (m).
    pub step_lo_m: f64,
    /// Step that is fully bad (m); a quarter of the wheel's diameter by default.
    pub step_hi_m: f64,
    /// A cell is unknown if less than this share of its window is known.
    pub known_share_min: f64,
    /// A cell is unknown if less than this share of any quadrant of its window is known. The
    /// quadrants are what lies strictly to both sides of the window's center lines.
    pub quadrant_known_min: f64,
    /// Unsafe below this goodness.
    pub unsafe_below: f64,
    /// Caution below this goodness.
    pub caution_below: f64,
    /// Caution below this certainty.
    pub certainty_caution_below: f64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            slope_lo_rad: 5.0_f64.to_radians(),
            slope_hi_rad: 20.0_f64.to_radians(),
            roughness_lo_m: 0.01,
            roughness_hi_m: 0.05,
            step_lo_m: 0.04,
            step_hi_m: 0.13,
            known_share_min: 0.6,
            quadrant_known_min: 0.3,
            unsafe_below: 0.2,
            caution_below: 0.6,
            certainty_caution_below: 0.5,
        }
    }
}

impl Limits {
    /// Refuses ramps that do not rise and shares outside \[0, 1\].
    pub fn check(&self) -> Result<(), TerrainError> {
        let ramps = [
            ("slope_lo_rad", self.slope_lo_rad, "slope_hi_rad", self.slope_hi_rad),
            ("roughness_lo_m", self.roughness_lo_m, "roughness_hi_m", self.roughness_hi_m),
            ("step_lo_m", self.step_lo_m, "step_hi_m", self.step_hi_m),
        ];
        for (lo_field, lo, hi_field, hi) in ramps {
            TerrainError::check(lo_field, lo, [0.0, 1e6], "a finite value of 0 or more")?;
            let above = lo + f64::from(f32::EPSILON) * lo.max(1e-3);
            TerrainError::check(hi_field, hi, [above, 1e6], "a finite value above its lo")?;
        }
        let shares = [
            ("known_share_min", self.known_share_min),
            ("quadrant_known_min", self.quadrant_known_min),
            ("unsafe_below", self.unsafe_below),
            ("caution_below", self.caution_below),
            ("certainty_caution_below", self.certainty_caution_below),
        ];
        for (field, share) in shares {
            TerrainError::check(field, share, [0.0, 1.0], "a share from 0 to 1")?;
        }
        Ok(())
    }

    /// Goodness of slope (rad), roughness (m) and step (m), in this order.
    pub fn goodness(&self, slope_rad: f64, roughness_m: f64, step_m: f64) -> [f64; 3] {
        let ramp = |lo: f64, hi: f64, v: f64| ((hi - v) / (hi - lo)).clamp(0.0, 1.0);
        [
            ramp(self.slope_lo_rad, self.slope_hi_rad, slope_rad),
            ramp(self.roughness_lo_m, self.roughness_hi_m, roughness_m),
            ramp(self.step_lo_m, self.step_hi_m, step_m),
        ]
    }

    /// The class of a cell that is known well enough.
    pub fn class(&self, goodness: f32, certainty: f32) -> u8 {
        if goodness < self.unsafe_below as f32 {
            super::UNSAFE
        } else if goodness < self.caution_below as f32
            || certainty < self.certainty_caution_below as f32
        {
            super::CAUTION
        } else {
            super::SAFE
        }
    }
}
