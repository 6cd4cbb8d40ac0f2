//! What synthetic ground is made of.

use std::fmt;

use crate::TerrainError;

/// What synthetic ground is made of. Zero abundance (density) leaves rocks (craters) away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    /// Extent along x (m).
    pub width_m: f64,
    /// Extent along y (m).
    pub height_m: f64,
    /// Distance of the nodes (m).
    pub resolution_m: f64,
    /// Hurst exponent of the relief, 0.05 to 1.
    pub hurst: f64,
    /// Arc tangent of the RMS height difference of points 1 m apart, relief only (rad).
    pub slope_rms_at_1m_rad: f64,
    /// Share of the ground that rocks cover, k; 0 to 0.4.
    pub rock_abundance: f64,
    /// Smallest rock (m).
    pub rock_diameter_min_m: f64,
    /// Largest rock (m).
    pub rock_diameter_max_m: f64,
    /// Factor on the mean lunar density of small craters, 0 to 5.
    pub crater_density: f64,
    /// Smallest crater (m).
    pub crater_diameter_min_m: f64,
    /// Largest crater (m).
    pub crater_diameter_max_m: f64,
    /// Radius around the center that no rock or crater touches, for a rover to stand
    /// (m); its relief stays.
    pub flat_center_m: f64,
}

impl Recipe {
    /// The demo: mare-like ground with rocks up to 0.8 m and some craters, 24 m x 24 m, with a clear
    /// place of 3.5 m radius in the middle.
    pub fn boulder_field() -> Recipe {
        Recipe {
            width_m: 24.0,
            height_m: 24.0,
            resolution_m: 0.05,
            hurst: 0.7,
            slope_rms_at_1m_rad: 3.0_f64.to_radians(),
            rock_abundance: 0.06,
            rock_diameter_min_m: 0.1,
            rock_diameter_max_m: 0.8,
            crater_density: 0.25,
            crater_diameter_min_m: 0.8,
            crater_diameter_max_m: 6.0,
            flat_center_m: 3.5,
        }
    }

    /// Open mare: gentle relief, few rocks.
    pub fn smooth_mare() -> Recipe {
        Recipe { rock_abundance: 0.01, rock_diameter_max_m: 0.5, ..Recipe::boulder_field() }
    }

    /// Highlands: steep relief, many rocks up to 2 m and craters up to 10 m.
    pub fn rough_highlands() -> Recipe {
        Recipe {
            slope_rms_at_1m_rad: 10.0_f64.to_radians(),
            rock_abundance: 0.1,
            rock_diameter_max_m: 2.0,
            crater_density: 0.5,
            crater_diameter_max_m: 10.0,
            ..Recipe::boulder_field()
        }
    }

    /// The names that [`Recipe::from_name`] knows.
    pub const NAMES: [&str; 3] = ["boulder_field", "smooth_mare", "rough_highlands"];

    /// The preset of that name.
    pub fn from_name(name: &str) -> Result<Recipe, TerrainError> {
        match name {
            "boulder_field" => Ok(Recipe::boulder_field()),
            "smooth_mare" => Ok(Recipe::smooth_mare()),
            "rough_highlands" => Ok(Recipe::rough_highlands()),
            _ => Err(TerrainError::UnknownRecipe { name: name.chars().take(80).collect() }),
        }
    }

    /// Refuses values that are not finite or out of range, by name.
    pub fn check(&self) -> Result<(), TerrainError> {
        let check = TerrainError::check;
        check("width_m", self.width_m, [1e-3, 1e5], "a length up to 1e5 m")?;
        check("height_m", self.height_m, [1e-3, 1e5], "a length up to 1e5 m")?;
        check("resolution_m", self.resolution_m, [1e-3, 1e3], "a length from 0.001 to 1000 m")?;
        check("hurst", self.hurst, [0.05, 1.0], "an exponent from 0.05 to 1")?;
        let expected = "an angle from 0 to 0.8 rad";
        check("slope_rms_at_1m_rad", self.slope_rms_at_1m_rad, [0.0, 0.8], expected)?;
        check("rock_abundance", self.rock_abundance, [0.0, 0.4], "a share from 0 to 0.4")?;
        check("crater_density", self.crater_density, [0.0, 5.0], "a factor from 0 to 5")?;
        check("flat_center_m", self.flat_center_m, [0.0, 1e5], "a radius of 0 m or more")?;
        let rocks = (self.rock_diameter_min_m, self.rock_diameter_max_m);
        check("rock_diameter_min_m", rocks.0, [0.01, 20.0], "a diameter from 0.01 to 20 m")?;
        let expected = "a diameter from rock_diameter_min_m to 20 m";
        check("rock_diameter_max_m", rocks.1, [rocks.0, 20.0], expected)?;
        let craters = (self.crater_diameter_min_m, self.crater_diameter_max_m);
        check("crater_diameter_min_m", craters.0, [0.1, 1e3], "a diameter from 0.1 to 1000 m")?;
        let expected = "a diameter from crater_diameter_min_m to 1000 m";
        check("crater_diameter_max_m", craters.1, [craters.0, 1e3], expected)?;
        Ok(())
    }
}

/// All values, and the version of the generator: enough to make the ground again.
impl fmt::Display for Recipe {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(
            f,
            "generator={} width_m={} height_m={} resolution_m={} hurst={} \
             slope_rms_at_1m_rad={} rock_abundance={} rock_diameter_min_m={} \
             rock_diameter_max_m={} crater_density={} crater_diameter_min_m={} \
             crater_diameter_max_m={} flat_center_m={}",
            super::GENERATOR_VERSION,
            self.width_m,
            self.height_m,
            self.resolution_m,
            self.hurst,
            self.slope_rms_at_1m_rad,
            self.rock_abundance,
            self.rock_diameter_min_m,
            self.rock_diameter_max_m,
            self.crater_density,
            self.crater_diameter_min_m,
            self.crater_diameter_max_m,
            self.flat_center_m,
        )
    }
}
