//! What a sensor makes of the light.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::StereoError;
use crate::image::ImageSize;

/// A sensor of 8 bits. Zero switches an effect off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Standard deviation of the point spread (px), 0 to 3.
    pub point_spread: f64,
    /// Light lost in the corners, 0 to 0.9; grows with the square of the distance from the middle.
    pub vignetting: f64,
    /// Electrons at gray value 255, for shot noise; 0 for none.
    pub full_well: f64,
    /// Standard deviation of the read noise (gray levels), 0 to 50.
    pub read_noise: f64,
}

impl Default for Sensor {
    fn default() -> Sensor {
        Sensor { point_spread: 0.5, vignetting: 0.3, full_well: 20_000.0, read_noise: 2.0 }
    }
}

impl Sensor {
    pub(super) fn check(&self) -> Result<(), StereoError> {
        StereoError::check("point_spread", self.point_spread, [0.0, 3.0], "0 to 3 px")?;
        StereoError::check("vignetting", self.vignetting, [0.0, 0.9], "0 to 0.9")?;
        StereoError::check("full_well", self.full_well, [0.0, 1e9], "0 to 1e9 electrons")?;
        StereoError::check("read_noise", self.read_noise, [0.0, 50.0], "0 to 50 gray levels")
            .map(|_| ())
    }

    /// The gray values of an exposure.
    pub(super) fn expose(&self, size: ImageSize, light: &[f32], seed: u64) -> Vec<u8> {
        let light = self.spread(size, light);
        let (cx, cy) = (0.5 * (size.width as f64 - 1.0), 0.5 * (size.height as f64 - 1.0));
        let corner = cx * cx + cy * cy;
        let mut out = Vec::with_capacity(light.len());
        for (y, row) in light.chunks_exact(size.width).enumerate() {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(y as u64);
            for (x, value) in row.iter().enumerate() {
                let (dx, dy) = (x as f64 - cx, y as f64 - cy);
                let kept = 1.0 - self.vignetting * (dx * dx + dy * dy) / corner;
                let gray = f64::from(*value) * kept;
                let mut variance = self.read_noise * self.read_noise;
                if self.full_well > 0.0 {
                    // Poisson noise of so many electrons is as good as normal.
                    variance += gray.max(0.0) * 255.0 / self.full_well;
                }
                let noisy = gray + variance.sqrt() * normal(&mut rng);
                out.push(noisy.round().clamp(0.0, 255.0) as u8);
            }
        }
        out
    }

    /// The light blurred by a Gaussian point spread; beyond the border it repeats.
    fn spread(&self, size: ImageSize, light: &[f32]) -> Vec<f32> {
        if self.point_spread == 0.0 {
            return light.to_vec();
        }
        let half = (3.0 * self.point_spread).ceil() as i64;
        let weight = |i: i64| (-0.5 * (i as f64 / self.point_spread).powi(2)).exp();
        let total: f64 = (-half..=half).map(weight).sum();
        let kernel: Vec<f32> = (-half..=half).map(|i| (weight(i) / total) as f32).collect();
        let (width, height) = (size.width as i64, size.height as i64);
        let blurred = |from: &[f32], dx: i64, dy: i64| -> Vec<f32> {
            let at = |i: i64| {
                let (x, y) = (i % width, i / width);
                let tap = |k: i64| {
                    let x = (x + dx * k).clamp(0, width - 1);
                    let y = (y + dy * k).clamp(0, height - 1);
                    from[(y * width + x) as usize]
                };
                (-half..=half).zip(&kernel).map(|(k, w)| w * tap(k)).sum()
            };
            (0..width * height).map(at).collect()
        };
        blurred(&blurred(light, 1, 0), 0, 1)
    }
}

/// A normal number (Box and Muller 1958).
pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}
