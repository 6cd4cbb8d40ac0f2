//! All readers of files, each with good files of every kind that it takes.

mod calibrations;
mod maps;
mod robots;

use crate::run::{Answer, Reader};

/// Every reader of files but that of flight logs, whose tests are in `bridge`.
pub fn all() -> Vec<Reader> {
    let mut readers = maps::readers();
    readers.extend(calibrations::readers());
    readers.extend(robots::readers());
    readers
}

/// What the reader of a name reads.
pub fn title(name: &'static str) -> &'static str {
    match name {
        "geotiff" => "GeoTIFF and COG heights",
        "overlay" => "GeoTIFF pictures (overlays)",
        "off" => "OFF",
        "obj" => "OBJ",
        "ply" => "PLY",
        "pds3" => "PDS3, label attached and apart",
        "png heights" => "PNG heights and their JSON",
        "tsai" => "`.tsai`",
        "cahvor" => "CAHV, CAHVOR",
        "middlebury" => "Middlebury `calib.txt`",
        "opencv" => "OpenCV and ROS YAML",
        "camera image" => "camera image (PNG)",
        "robot.toml" => "`robot.toml` with its rig",
        "urdf" => "URDF",
        "robot mesh" => "robot mesh (STL, OBJ)",
        other => other,
    }
}

/// Longest message of an error (characters).
const MESSAGE_MAX: usize = 2000;

/// Whether something was read, or why the refusal is of no use to its reader.
fn answered<T, E: std::fmt::Display>(result: &Result<T, E>) -> Answer {
    let Err(error) = result else { return Ok(true) };
    let n = error.to_string().chars().count();
    if n == 0 || n > MESSAGE_MAX {
        return Err(format!("it refused with a message of {n} characters"));
    }
    Ok(false)
}
