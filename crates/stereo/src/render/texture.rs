//! Band-limited noise in the world: what a matcher finds on bare ground.

use nalgebra::Vector3;

use crate::StereoError;

/// Octaves of smooth noise on a lattice of the world. What a pixel cannot resolve is left out, so
/// images do not alias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Texture {
    /// Seed of the noise.
    pub seed: u64,
    /// Longest wavelength (m).
    pub longest: f64,
    /// Octaves, each half as long as the one before; 1 to 16.
    pub octaves: usize,
    /// Amplitude of an octave against the mean albedo, 0 to 1.
    pub contrast: f64,
}

impl Default for Texture {
    fn default() -> Texture {
        Texture { seed: 1, longest: 0.5, octaves: 9, contrast: 0.25 }
    }
}

impl Texture {
    pub(super) fn check(&self) -> Result<(), StereoError> {
        StereoError::check("longest", self.longest, [1e-4, 1e4], "a length of 1e-4 to 1e4 m")?;
        StereoError::check("octaves", self.octaves as f64, [1.0, 16.0], "1 to 16")?;
        StereoError::check("contrast", self.contrast, [0.0, 1.0], "0 to 1").map(|_| ())
    }

    /// Factor on the albedo at a place, seen by pixels of width `footprint` (m); 0.1 or more.
    pub(super) fn factor(&self, at: &Vector3<f64>, footprint: f64, salt: u64) -> f64 {
        let mut sum = 0.0;
        let mut length = self.longest;
        for octave in 0..self.octaves {
            // Fades out from four pixels a wave to two.
            let weight = (length / (2.0 * footprint) - 1.0).clamp(0.0, 1.0);
            if weight == 0.0 {
                break;
            }
            let seed = self.seed ^ (octave as u64) << 32 ^ salt << 40;
            // A lattice cell is half a wave.
            sum += weight * noise(&(at / (0.5 * length)), seed);
            length *= 0.5;
        }
        (1.0 + self.contrast * sum).max(0.1)
    }
}

/// Smooth noise of -1 to 1 with a value of its own at each whole place.
fn noise(p: &Vector3<f64>, seed: u64) -> f64 {
    let floor = p.map(f64::floor);
    let ease = (p - floor).map(|t| t * t * (3.0 - 2.0 * t));
    let cell = floor.map(|v| v as i64);
    let at = |dx: i64, dy: i64, dz: i64| {
        let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
        for v in [cell.x + dx, cell.y + dy, cell.z + dz] {
            h = (h ^ v as u64).wrapping_mul(0xff51_afd7_ed55_8ccd);
            h ^= h >> 32;
        }
        (h >> 11) as f64 * (2.0 / (1_u64 << 53) as f64) - 1.0
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let line = |dy, dz| mix(at(0, dy, dz), at(1, dy, dz), ease.x);
    let face = |dz| mix(line(0, dz), line(1, dz), ease.y);
    mix(face(0), face(1), ease.z)
}
