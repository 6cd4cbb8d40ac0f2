//! `calib.txt` of the Middlebury 2014 pairs.

use nalgebra::Isometry3;

use super::Entries;
use crate::StereoError;
use crate::camera::{Brown, Camera, Pinhole};
use crate::image::ImageSize;

const FORMAT: &str = "Middlebury";
const HINT: &str = "is this the calib.txt of a Middlebury 2014 pair?";

/// Reads `calib.txt`: `cam0`, `cam1` (3 x 3, px), `baseline` (mm), `width`, `height`; left and right
/// camera, already rectified, in the frame of the left one. `doffs`, where given, must agree.
pub fn read_middlebury(text: &str) -> Result<[Camera; 2], StereoError> {
    let entries = Entries::parse(FORMAT, text)?;
    let side = |name| {
        let entry = entries.get(name, HINT)?;
        let value: usize =
            entry.value.parse().map_err(|_| entries.unreadable(entry, "a number of pixels"))?;
        Ok::<usize, StereoError>(value)
    };
    let size = ImageSize::new(side("width")?, side("height")?)?;
    let baseline_mm = entries.number("baseline", HINT)?;
    StereoError::check("baseline", baseline_mm, [1e-3, 1e7], "millimeters over 0")?;
    let camera = |name, x: f64| {
        let m: [f64; 9] = entries.numbers(name, HINT, "nine numbers: [f 0 cx; 0 f cy; 0 0 1]")?;
        if [m[1], m[3], m[6], m[7]] != [0.0; 4] || m[8] != 1.0 {
            let entry = entries.get(name, HINT)?;
            return Err(entries.unreadable(entry, "nine numbers: [f 0 cx; 0 f cy; 0 0 1]"));
        }
        let pose = Isometry3::translation(x, 0.0, 0.0);
        Pinhole::new(size, [m[0], m[4]], [m[2], m[5]], Brown::default(), pose)
    };
    let (left, right) = (camera("cam0", 0.0)?, camera("cam1", 1e-3 * baseline_mm)?);
    if let Some(entry) = entries.find("doffs") {
        let stated = entries.number("doffs", HINT)?;
        if (right.principal()[0] - left.principal()[0] - stated).abs() > 0.01 {
            return Err(entries.unreadable(entry, "cx of cam1 less cx of cam0"));
        }
    }
    Ok([Camera::Pinhole(left), Camera::Pinhole(right)])
}
