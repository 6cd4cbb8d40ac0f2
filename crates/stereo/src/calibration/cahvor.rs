//! CAHV and CAHVOR models as text.

use super::Entries;
use crate::StereoError;
use crate::camera::{Cahvor, Camera};
use crate::image::ImageSize;

const FORMAT: &str = "CAHVOR";
const HINT: &str = "is this a CAHV or CAHVOR model, with lines such as \"C = x y z\"?";

/// Reads a CAHV or CAHVOR model: lines `C`, `A`, `H`, `V` and, with a lens, `O` and `R`, of three
/// numbers each. `Dimensions = width height`, where the file has it, must agree with `size`, where
/// that is given; one of them is needed.
pub fn read_cahvor(text: &str, size: Option<ImageSize>) -> Result<Camera, StereoError> {
    let entries = Entries::parse(FORMAT, text)?;
    if let Some(model) = entries.find("Model") {
        let name = model.value.split('=').next().unwrap_or_default().trim();
        if !["CAHV", "CAHVOR"].contains(&name) {
            let what = format!("the model {:?}", super::shortened(name));
            let hint = "give CAHV or CAHVOR; a CAHVORE model must be fitted anew";
            return Err(StereoError::Unsupported { format: FORMAT, what, hint });
        }
    }
    if entries.find("E").is_some() {
        let what = "the vector E of a CAHVORE model".to_owned();
        let hint = "give CAHV or CAHVOR; a CAHVORE model must be fitted anew";
        return Err(StereoError::Unsupported { format: FORMAT, what, hint });
    }
    let stated = match entries.find("Dimensions") {
        Some(entry) => {
            let [w, h] = entries.numbers("Dimensions", HINT, "width and height (px)")?;
            let whole = |v: f64| v.fract() == 0.0 && (1.0..=1e6).contains(&v);
            if !(whole(w) && whole(h)) {
                return Err(entries.unreadable(entry, "width and height (px)"));
            }
            Some(ImageSize::new(w as usize, h as usize)?)
        }
        None => None,
    };
    let size = match (stated, size) {
        (Some(calibration), Some(image)) if calibration != image => {
            return Err(StereoError::SizeMismatch { what: "image", image, calibration });
        }
        (stated, given) => stated.or(given).ok_or(StereoError::Missing {
            format: FORMAT,
            field: "Dimensions".into(),
            hint: "name the size of the image",
        })?,
    };
    let vector = |name| entries.vector(name, HINT);
    let cahv = [vector("C")?, vector("A")?, vector("H")?, vector("V")?];
    let camera = match (entries.find("O"), entries.find("R")) {
        (None, None) => Cahvor::cahv(size, cahv),
        _ => Cahvor::new(size, cahv, vector("O")?, vector("R")?.into()),
    };
    camera.map(Camera::Cahvor)
}
