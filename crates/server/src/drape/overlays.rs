//! Imported rasters over the ground of the map (F36): kept until removed, or until another ground is imported.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use nalgebra::{Point2, Vector2};
use terrain::formats::picture::{self, PICTURE_TEXELS_MAX, Picture};
use terrain::formats::{ReadOptions, geotiff};
use terrain::{ElevationMap, TerrainError};
use wire::check::{At, RequestError};
use wire::drape::{OverlayAnswer, OverlayList};

use super::{shape_of, tile};
use crate::error::ApiError;
use crate::terrains::terrain_error;

/// Most overlays: with [`PICTURE_TEXELS_MAX`] texels of four bytes each, 128 MB.
pub const OVERLAYS_MAX: usize = 8;

/// The overlays there are.
#[derive(Default)]
pub struct Overlays(Mutex<Vec<Arc<Overlay>>>);

/// One of them.
pub struct Overlay {
    answer: OverlayAnswer,
    picture: Picture,
}

impl Overlays {
    /// Reads the part of a GeoTIFF that lies over a map, and keeps it.
    pub fn add(
        &self,
        id: String,
        file: &str,
        path: &Path,
        map: &ElevationMap,
    ) -> Result<OverlayAnswer, ApiError> {
        self.check_room()?;
        let picture = read(path, map).map_err(|error| match error {
            TerrainError::PictureElsewhere { .. } | TerrainError::PictureOtherSystem { .. } => {
                RequestError::at("overlay_elsewhere", &At::root("file"), error)
            }
            error => terrain_error(&At::root("file"), &error),
        })?;
        let known = picture.rgba.iter().filter(|texel| texel[3] > 0).count();
        let answer = OverlayAnswer {
            id,
            file: file.to_owned(),
            shape: shape_of(&picture.grid),
            gray: picture.is_gray,
            stretch: picture.stretch,
            known_share: known as f64 / picture.rgba.len().max(1) as f64,
        };
        let mut kept = self.locked();
        if kept.len() >= OVERLAYS_MAX {
            drop(kept);
            self.check_room()?;
            return Err(ApiError::new("too_many", "too many overlays"));
        }
        kept.push(Arc::new(Overlay { answer: answer.clone(), picture }));
        Ok(answer)
    }

    fn check_room(&self) -> Result<(), ApiError> {
        if self.locked().len() < OVERLAYS_MAX {
            return Ok(());
        }
        let message = format!("there are {OVERLAYS_MAX} overlays already; remove one first");
        Err(ApiError::new("too_many", message))
    }

    /// All of them, oldest first.
    pub fn list(&self) -> OverlayList {
        OverlayList { overlays: self.locked().iter().map(|o| o.answer.clone()).collect() }
    }

    /// One of them.
    pub fn get(&self, id: &str) -> Result<Arc<Overlay>, ApiError> {
        self.locked().iter().find(|o| o.answer.id == id).cloned().ok_or_else(unknown)
    }

    /// Removes one.
    pub fn remove(&self, id: &str) -> Result<(), ApiError> {
        let mut kept = self.locked();
        let at = kept.iter().position(|o| o.answer.id == id).ok_or_else(unknown)?;
        kept.remove(at);
        Ok(())
    }

    /// Removes all: the ground is another.
    pub fn clear(&self) {
        self.locked().clear();
    }

    fn locked(&self) -> MutexGuard<'_, Vec<Arc<Overlay>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn unknown() -> ApiError {
    ApiError::new("overlay_unknown", "there is no such overlay; GET /terrain/overlays lists them")
}

impl Overlay {
    /// A tile as PNG of color and alpha.
    pub fn tile(&self, at: [usize; 2]) -> Option<Result<Bytes, png::EncodingError>> {
        tile(&self.picture.grid, at, png::ColorType::Rgba, |i| self.picture.rgba[i])
    }
}

/// The part of a file over a map, its grid in `world`.
fn read(path: &Path, map: &ElevationMap) -> Result<Picture, TerrainError> {
    let options = ReadOptions { max_nodes: PICTURE_TEXELS_MAX, ..ReadOptions::default() };
    let file = geotiff::GeoTiffFile::open_with_options(path, geotiff::limits(&options))?;
    picture::check_system(&file, map)?;
    let offset: Vector2<f64> = map.frame_offset().xy();
    let (low, high): (Point2<f64>, Point2<f64>) = (map.grid().origin, map.grid().far_corner());
    let mut picture = picture::read(&file, low + offset, high + offset, PICTURE_TEXELS_MAX)?;
    picture.grid.origin -= offset;
    Ok(picture)
}
