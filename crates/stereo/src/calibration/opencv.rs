//! YAML as OpenCV's `FileStorage` and ROS write it.

use nalgebra::{Isometry3, Vector3};

use super::{check_size, matrix, shortened, unreadable};
use crate::StereoError;
use crate::camera::{Brown, Camera, Pinhole, rotation_from_matrix};
use crate::image::ImageSize;

const FORMAT: &str = "OpenCV";

/// Names that programs give to the same thing.
const CAMERA_MATRIX: &[&str] = &["camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "mtx"];
const DISTORTION: &[&str] = &[
    "distortion_coefficients",
    "distCoeffs",
    "Distortion_Coefficients",
    "dist_coeffs",
    "D",
    "dist",
];
const WIDTH: &[&str] = &["image_width", "image_Width"];
const HEIGHT: &[&str] = &["image_height", "image_Height"];

/// Reads one camera: a camera matrix, distortion coefficients (k1 k2 p1 p2 and perhaps k3) and, where the file
/// has it, the size of the image, which must agree with `size`, where that is given. The frame is the
/// camera's own.
pub fn read_opencv(text: &str, size: Option<ImageSize>) -> Result<Camera, StereoError> {
    let file = Yaml::parse(text)?;
    let size = file.size(size)?;
    file.camera(CAMERA_MATRIX, DISTORTION, size, Isometry3::identity()).map(Camera::Pinhole)
}

/// Reads a pair as OpenCV's `stereo_calib` writes it: M1, D1, M2, D2 in `intrinsics`; R, T in
/// `extrinsics` (a point of the left camera is at R p + T in the right one). `unit_m` is the length of
/// one unit of T in meters, which the file does not say. Left and right camera in the frame of the
/// left one.
pub fn read_opencv_pair(
    intrinsics: &str,
    extrinsics: &str,
    size: Option<ImageSize>,
    unit_m: f64,
) -> Result<[Camera; 2], StereoError> {
    StereoError::check("unit_m", unit_m, [1e-6, 1e3], "the length of a unit of T (m)")?;
    let (inner, outer) = (Yaml::parse(intrinsics)?, Yaml::parse(extrinsics)?);
    let size = inner.size(size)?;
    let rotation = rotation_from_matrix("R", &matrix(outer.matrix(&["R"], "nine numbers")?))?;
    let shift = Vector3::from(outer.matrix::<3>(&["T"], "three numbers")?) * unit_m;
    let left_from_right = Isometry3::from_parts(shift.into(), rotation).inverse();
    let left = inner.camera(&["M1", "K1"], &["D1"], size, Isometry3::identity())?;
    let right = inner.camera(&["M2", "K2"], &["D2"], size, left_from_right)?;
    Ok([Camera::Pinhole(left), Camera::Pinhole(right)])
}

/// Scalars and lists of numbers of a YAML text, by the name of their top-level entry.
struct Yaml {
    values: Vec<(String, usize, String)>,
}

impl Yaml {
    fn parse(text: &str) -> Result<Yaml, StereoError> {
        check_size(text)?;
        let start = text.trim_start();
        if start.starts_with('{') || start.starts_with('<') {
            return Err(StereoError::Unsupported {
                format: FORMAT,
                what: "the form of JSON or XML".to_owned(),
                hint: "write the FileStorage as .yml",
            });
        }
        let mut values: Vec<(String, usize, String)> = Vec::new();
        let mut open = false;
        for (i, line) in text.lines().enumerate() {
            let content = line.split('#').next().unwrap_or_default();
            let part = content.trim();
            if part.is_empty() || part.starts_with('%') || part == "---" {
                continue;
            }
            if open {
                // The rest of a list that runs over several lines.
                open = !part.contains(']');
                if let Some((_, _, value)) = values.last_mut() {
                    value.push(' ');
                    value.push_str(part);
                }
            } else if let Some((name, value)) = part.split_once(':') {
                let value = value.trim();
                let is_top = !content.starts_with([' ', '\t']);
                if is_top {
                    let tagged = value.starts_with("!!");
                    let value = if tagged { "" } else { value };
                    values.push((name.trim().to_owned(), i + 1, value.to_owned()));
                } else if name.trim() == "data"
                    && let Some((_, at, whole)) = values.last_mut()
                {
                    *at = i + 1;
                    *whole = value.to_owned();
                }
                open = value.contains('[') && !value.contains(']');
            }
        }
        Ok(Yaml { values })
    }

    fn find(&self, names: &[&str]) -> Option<&(String, usize, String)> {
        self.values.iter().find(|(name, _, _)| names.contains(&name.as_str()))
    }

    fn get(&self, names: &[&str]) -> Result<&(String, usize, String), StereoError> {
        self.find(names).ok_or_else(|| StereoError::Missing {
            format: FORMAT,
            field: names.first().copied().unwrap_or_default().to_owned(),
            hint: "is this the YAML of a calibration?",
        })
    }

    fn matrix<const N: usize>(
        &self,
        names: &[&str],
        expected: &'static str,
    ) -> Result<[f64; N], StereoError> {
        let (name, line, value) = self.get(names)?;
        super::numbers(value).ok_or_else(|| unreadable(FORMAT, *line, name, value, expected))
    }

    fn size(&self, given: Option<ImageSize>) -> Result<ImageSize, StereoError> {
        let side = |names| {
            let Some((name, line, value)) = self.find(names) else { return Ok(None) };
            let parsed = value.parse::<usize>();
            parsed
                .map(Some)
                .map_err(|_| unreadable(FORMAT, *line, name, value, "a number of pixels"))
        };
        let stated = match (side(WIDTH)?, side(HEIGHT)?) {
            (Some(width), Some(height)) => Some(ImageSize::new(width, height)?),
            _ => None,
        };
        match (stated, given) {
            (Some(calibration), Some(image)) if calibration != image => {
                Err(StereoError::SizeMismatch { what: "image", image, calibration })
            }
            (stated, given) => stated.or(given).ok_or(StereoError::Missing {
                format: FORMAT,
                field: "image_width and image_height".into(),
                hint: "name the size of the image",
            }),
        }
    }

    fn camera(
        &self,
        camera_matrix: &[&str],
        distortion: &[&str],
        size: ImageSize,
        pose: Isometry3<f64>,
    ) -> Result<Pinhole, StereoError> {
        let m: [f64; 9] = self.matrix(camera_matrix, "nine numbers: fx 0 cx, 0 fy cy, 0 0 1")?;
        if [m[1], m[3], m[6], m[7]] != [0.0; 4] || m[8] != 1.0 {
            let (name, line, value) = self.get(camera_matrix)?;
            let expected = "fx 0 cx, 0 fy cy, 0 0 1 without skew";
            return Err(unreadable(FORMAT, *line, name, value, expected));
        }
        Pinhole::new(size, [m[0], m[4]], [m[2], m[5]], self.brown(distortion)?, pose)
    }

    fn brown(&self, names: &[&str]) -> Result<Brown, StereoError> {
        let (name, line, value) = self.get(names)?;
        let expected = "k1 k2 p1 p2 and perhaps k3";
        if let Some([k1, k2, p1, p2]) = super::numbers(value) {
            return Ok(Brown { k1, k2, p1, p2, k3: 0.0 });
        }
        if let Some([k1, k2, p1, p2, k3]) = super::numbers(value) {
            return Ok(Brown { k1, k2, p1, p2, k3 });
        }
        let further = [
            super::numbers::<8>(value).map(|v| v.to_vec()),
            super::numbers::<12>(value).map(|v| v.to_vec()),
            super::numbers::<14>(value).map(|v| v.to_vec()),
        ];
        match further.into_iter().flatten().next() {
            Some(v) if v[5..].iter().all(|c| *c == 0.0) => {
                Ok(Brown { k1: v[0], k2: v[1], p1: v[2], p2: v[3], k3: v[4] })
            }
            Some(v) => Err(StereoError::Unsupported {
                format: FORMAT,
                what: format!("{} distortion coefficients in {:?}", v.len(), shortened(name)),
                hint: "calibrate with five: k1 k2 p1 p2 k3",
            }),
            None => Err(unreadable(FORMAT, *line, name, value, expected)),
        }
    }
}
