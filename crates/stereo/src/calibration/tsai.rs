//! Pinhole models of the Ames Stereo Pipeline.

use nalgebra::{Isometry3, Vector3};

use super::{Entries, matrix};
use crate::StereoError;
use crate::camera::{Brown, Camera, Pinhole, rotation_from_matrix};
use crate::image::ImageSize;

const FORMAT: &str = "tsai";
const HINT: &str = "is this a pinhole model of the Ames Stereo Pipeline?";

/// Reads a `.tsai` model: fu fv cu cv, C, R (camera to world, by rows), and k1 k2 p1 p2, perhaps k3, in the
/// order of OpenCV. The file does not say the size of the image. From `VERSION_3` on lengths on the
/// sensor are in units of `pitch`.
pub fn read_tsai(text: &str, size: ImageSize) -> Result<Camera, StereoError> {
    let entries = Entries::parse(FORMAT, text)?;
    let first = entries.entries.first().map_or("", |entry| entry.name);
    if first.starts_with("VERSION_") && !["VERSION_3", "VERSION_4"].contains(&first) {
        let what = format!("version {:?}", super::shortened(first));
        let hint = "give VERSION_3, VERSION_4, or the model without a version";
        return Err(StereoError::Unsupported { format: FORMAT, what, hint });
    }
    // Names of models and of distortions stand alone on their lines.
    let words = || entries.entries.iter().filter(|e| e.value.is_empty()).map(|e| e.name);
    if let Some(other) = words()
        .find(|word| !word.starts_with("VERSION_") && !["PINHOLE", "TSAI", "NULL"].contains(word))
    {
        let what = format!("the line {:?}", super::shortened(other));
        let hint = "only PINHOLE with TSAI or NULL distortion is read";
        return Err(StereoError::Unsupported { format: FORMAT, what, hint });
    }
    for (name, axis) in [
        ("u_direction", Vector3::x()),
        ("v_direction", Vector3::y()),
        ("w_direction", Vector3::z()),
    ] {
        if entries.find(name).is_some() && entries.vector(name, HINT)? != axis {
            let what = format!("a {name} that is not along its axis");
            let hint = "turn the model so that u, v, w are 1 0 0, 0 1 0, 0 0 1";
            return Err(StereoError::Unsupported { format: FORMAT, what, hint });
        }
    }
    let pitch = match entries.find("pitch") {
        Some(_) => entries.number("pitch", HINT)?,
        None => 1.0,
    };
    StereoError::check("pitch", pitch, [1e-9, 1e3], "a size of a pixel over 0")?;
    let px = |name| entries.number(name, HINT).map(|value| value / pitch);
    let (focal, principal) = ([px("fu")?, px("fv")?], [px("cu")?, px("cv")?]);
    let center = entries.vector("C", HINT)?;
    let rows = entries.numbers("R", HINT, "nine numbers, by rows")?;
    let rotation = rotation_from_matrix("R", &matrix(rows))?;
    let null = words().any(|word| word == "NULL");
    let given = |name| entries.number(name, "give k1 k2 p1 p2, or NULL distortion");
    let distortion = if null {
        Brown::default()
    } else {
        let k3 = if entries.find("k3").is_some() { given("k3")? } else { 0.0 };
        Brown { k1: given("k1")?, k2: given("k2")?, p1: given("p1")?, p2: given("p2")?, k3 }
    };
    let pose = Isometry3::from_parts(center.into(), rotation);
    Pinhole::new(size, focal, principal, distortion, pose).map(Camera::Pinhole)
}
