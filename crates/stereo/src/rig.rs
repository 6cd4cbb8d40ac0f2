//! The stereo pairs of a robot, from the `[[camera_pairs]]` tables of its `robot.toml`.
//!
//! ```toml
//! [[camera_pairs]]
//! name = "nav1"
//! link = "chassis"                # what carries it
//! position_m = [1.2, 0.7, -0.1]   # middle between the cameras, in the link's frame
//! azimuth_rad = 0.52              # where it looks, about the link's z from its x
//! elevation_rad = -0.35           # ... and above the link's x-y plane
//! baseline_m = 0.25
//! size_px = [1024, 768]
//! field_of_view_rad = 1.2         # across the image
//! range_m = [0.5, 10.0]           # depths that count
//! ```
//!
//! Lengths scale with the robot. The cameras are ideal and side by side; a calibration in the frame of
//! the link takes their place with [`CameraPair::with_cameras`].

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rover::{LinkId, Posture, Robot};
use serde::Deserialize;

use crate::StereoError;
use crate::camera::{Brown, Camera, Pinhole};
use crate::image::ImageSize;

/// Most pairs of a rig.
pub const PAIRS_MAX: usize = 64;

/// A stereo pair on a link.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraPair {
    /// Its name.
    pub name: String,
    /// The link that carries it; cameras are in this link's frame.
    pub link: LinkId,
    /// The left camera.
    pub left: Camera,
    /// The right camera.
    pub right: Camera,
    /// Depths that count (m).
    pub range: [f64; 2],
}

/// All stereo pairs of a robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rig {
    pairs: Vec<CameraPair>,
}

impl CameraPair {
    /// Both cameras in `world`.
    pub fn cameras(&self, posture: &Posture) -> [Camera; 2] {
        let pose = posture.link(self.link);
        [self.left.moved(pose), self.right.moved(pose)]
    }

    /// The same pair by a calibration of its own, in the frame of the link.
    pub fn with_cameras(self, left: Camera, right: Camera) -> CameraPair {
        CameraPair { left, right, ..self }
    }

    /// The same pair with images of another size.
    pub fn resized(&self, size: ImageSize) -> Result<CameraPair, StereoError> {
        let (left, right) = (self.left.resized(size)?, self.right.resized(size)?);
        Ok(CameraPair { left, right, ..self.clone() })
    }

    /// Bytes of both images, 8 bits a pixel, before any compression.
    pub fn raw_bytes(&self) -> usize {
        self.left.size().len() + self.right.size().len()
    }
}

impl Rig {
    /// The pairs that `robot.toml` names, at the scale of the robot; none is a rig without pairs.
    pub fn from_toml(robot_toml: &str, robot: &Robot) -> Result<Rig, StereoError> {
        let parsed: File = toml::from_str(robot_toml)
            .map_err(|e| StereoError::Toml { message: rover::toml_message(robot_toml, &e) })?;
        if parsed.camera_pairs.len() > PAIRS_MAX {
            let n = parsed.camera_pairs.len() as f64;
            StereoError::check("camera_pairs", n, [0.0, PAIRS_MAX as f64], "at most 64 pairs")?;
        }
        let mut pairs: Vec<CameraPair> = Vec::new();
        for table in &parsed.camera_pairs {
            let pair = table.pair(robot)?;
            if pairs.iter().any(|other| other.name == pair.name) {
                let what = "the name is taken twice: give each pair its own".to_owned();
                return Err(StereoError::Pair { pair: pair.name, what });
            }
            pairs.push(pair);
        }
        Ok(Rig { pairs })
    }

    /// A rig of these pairs.
    pub fn new(pairs: Vec<CameraPair>) -> Rig {
        Rig { pairs }
    }

    /// The pairs in the order of the file.
    pub fn pairs(&self) -> &[CameraPair] {
        &self.pairs
    }

    /// The pair of that name.
    pub fn pair(&self, name: &str) -> Option<&CameraPair> {
        self.pairs.iter().find(|pair| pair.name == name)
    }
}

#[derive(Deserialize)]
struct File {
    #[serde(default)]
    camera_pairs: Vec<PairToml>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PairToml {
    name: String,
    link: String,
    position_m: [f64; 3],
    azimuth_rad: f64,
    elevation_rad: f64,
    baseline_m: f64,
    size_px: [usize; 2],
    field_of_view_rad: f64,
    range_m: [f64; 2],
}

impl PairToml {
    fn pair(&self, robot: &Robot) -> Result<CameraPair, StereoError> {
        let named = |what: String| StereoError::Pair { pair: self.name.clone(), what };
        let link = robot.link_id(&self.link).ok_or_else(|| {
            named(format!("the robot has no link {:?}: name one of its URDF", self.link))
        })?;
        let check = |field: &str, value: f64, [low, high]: [f64; 2], expected: &str| {
            if value.is_finite() && (low..=high).contains(&value) {
                Ok(value)
            } else {
                Err(named(format!("{field} is {value}: give {expected}")))
            }
        };
        for value in self.position_m {
            check("position_m", value, [-1e3, 1e3], "meters, below 1000")?;
        }
        let turn = std::f64::consts::TAU;
        check("azimuth_rad", self.azimuth_rad, [-turn, turn], "an angle of one turn (rad)")?;
        let elevation =
            check("elevation_rad", self.elevation_rad, [-1.55, 1.55], "-1.55 to 1.55 rad")?;
        let baseline = check("baseline_m", self.baseline_m, [1e-3, 10.0], "0.001 to 10 m")?;
        let [near, far] = self.range_m;
        check("range_m[0]", near, [1e-3, 1e4], "0.001 m or more")?;
        check("range_m[1]", far, [near, 1e4], "a depth beyond the nearest")?;
        let view =
            check("field_of_view_rad", self.field_of_view_rad, [0.05, 2.8], "0.05 to 2.8 rad")?;
        let size =
            ImageSize::new(self.size_px[0], self.size_px[1]).map_err(|e| named(e.to_string()))?;
        let focal = 0.5 * size.width as f64 / (0.5 * view).tan();
        let principal = [0.5 * (size.width as f64 - 1.0), 0.5 * (size.height as f64 - 1.0)];
        let scale = robot.scale();
        let rotation = looking(self.azimuth_rad, elevation);
        let camera = |side: f64| {
            let aside = rotation * Vector3::x() * (0.5 * side * baseline);
            let place = (Vector3::from(self.position_m) + aside) * scale;
            let pose = Isometry3::from_parts(place.into(), rotation);
            Pinhole::new(size, [focal; 2], principal, Brown::default(), pose)
                .map(Camera::Pinhole)
                .map_err(|e| named(e.to_string()))
        };
        Ok(CameraPair {
            name: self.name.clone(),
            link,
            left: camera(-1.0)?,
            right: camera(1.0)?,
            range: [near * scale, far * scale],
        })
    }
}

/// The axes of a camera that looks at an azimuth about z from x and an elevation above the x-y plane,
/// its rows level.
fn looking(azimuth: f64, elevation: f64) -> UnitQuaternion<f64> {
    let (sa, ca) = azimuth.sin_cos();
    let (se, ce) = elevation.sin_cos();
    let z = Vector3::new(ca * ce, sa * ce, se);
    let x = Vector3::new(sa, -ca, 0.0);
    let matrix = Matrix3::from_columns(&[x, z.cross(&x), z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}
