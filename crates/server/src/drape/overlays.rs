//! Imported rasters over the ground of the map (F36): kept until removed, or until another ground is imported.
//!
//! They outlive the server: what there is stands in [`LIST_FILE`] of the folder of terrain files, beside the rasters
//! themselves, of which the part over the map is read again at the start of the next, over the same ground.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};
use terrain::formats::picture::{self, PICTURE_TEXELS_MAX, Picture};
use terrain::formats::{ReadOptions, geotiff};
use terrain::{ElevationMap, TerrainError};
use wire::check::{At, RequestError};
use wire::drape::{OverlayAnswer, OverlayList};

use super::{shape_of, tile};
use crate::error::ApiError;
use crate::terrains::{is_file_name, terrain_error};

/// Most overlays: with [`PICTURE_TEXELS_MAX`] texels of four bytes each, 128 MB.
pub const OVERLAYS_MAX: usize = 8;

/// The list of overlays, in the folder of terrain files.
const LIST_FILE: &str = ".overlays.json";
/// Longest list that is read (bytes).
const LIST_BYTES_MAX: u64 = 64 << 10;

/// The overlays there are.
pub struct Overlays {
    kept: Mutex<Vec<Arc<Overlay>>>,
    /// The ground that they are laid over, by the name of its map.
    ground: Mutex<String>,
    folder: PathBuf,
}

/// What is known of them without the server.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    ground: String,
    overlays: Vec<ListedOverlay>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedOverlay {
    id: String,
    file: String,
    /// Size of the file (bytes) and when it was changed last (ns since 1970): what tells it from another.
    stamp: [u64; 2],
}

/// One of them.
pub struct Overlay {
    answer: OverlayAnswer,
    picture: Picture,
    stamp: [u64; 2],
}

/// What tells a file from one that takes its place.
fn stamp(path: &Path) -> Option<[u64; 2]> {
    let of = std::fs::metadata(path).ok()?;
    let changed = of.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
    Some([of.len(), u64::try_from(changed.as_nanos()).ok()?])
}

impl Overlays {
    /// None yet, over the ground of a map; the list stands in `folder`.
    pub fn new(folder: PathBuf, ground: String) -> Overlays {
        Overlays { kept: Mutex::default(), ground: Mutex::new(ground), folder }
    }

    /// Reads those again that the server before had over the same ground; how many came back, and of the others why not.
    pub fn bring_back(&self, map: &ElevationMap) -> (usize, Vec<String>) {
        let listed = match self.listed() {
            Ok(Some(listed)) => listed,
            Ok(None) => return (0, Vec::new()),
            Err(why) => return (0, vec![format!("{LIST_FILE} cannot be used: {why}")]),
        };
        let n = listed.overlays.len();
        if listed.ground != *self.ground() {
            let why = format!("{n} were over other ground, the map {}", listed.ground);
            return (0, if n == 0 { Vec::new() } else { vec![why] });
        }
        let (mut n_back, mut failed) = (0, Vec::new());
        for ListedOverlay { id, file, stamp: of } in listed.overlays.into_iter().take(OVERLAYS_MAX)
        {
            let is_named = is_file_name(&file) && uuid::Uuid::parse_str(&id).is_ok();
            let path = self.folder.join(&file);
            let outcome = match stamp(&path) {
                _ if !is_named => Err("its name or identity is none".to_owned()),
                None => Err("its file is gone".to_owned()),
                Some(now) if now != of => Err("its file is another now".to_owned()),
                Some(_) => self.take(id, &file, &path, map).map_err(|ApiError(e)| e.message),
            };
            match outcome {
                Ok(_) => n_back += 1,
                Err(why) => {
                    failed.push(format!("{}: {why}", file.chars().take(64).collect::<String>()))
                }
            }
        }
        (n_back, failed)
    }

    fn listed(&self) -> Result<Option<Listed>, String> {
        let path = self.folder.join(LIST_FILE);
        let Ok(of) = std::fs::metadata(&path) else { return Ok(None) };
        if of.len() > LIST_BYTES_MAX {
            return Err(format!("it has {} bytes, and {LIST_BYTES_MAX} are the most", of.len()));
        }
        let text = std::fs::read(&path).map_err(|error| error.to_string())?;
        serde_json::from_slice(&text).map(Some).map_err(|error| error.to_string())
    }

    /// Writes the list; a server without it goes on, and the next has no overlays.
    fn write_list(&self) {
        let kept = self.locked();
        let listed = |overlay: &Arc<Overlay>| ListedOverlay {
            id: overlay.answer.id.clone(),
            file: overlay.answer.file.clone(),
            stamp: overlay.stamp,
        };
        let list =
            Listed { ground: self.ground().clone(), overlays: kept.iter().map(listed).collect() };
        // What is kept stays locked, so that of two changes the later is written last.
        let path = self.folder.join(LIST_FILE);
        let aside = self.folder.join(format!("{LIST_FILE}.new"));
        let write = || {
            if list.overlays.is_empty() {
                return match std::fs::remove_file(&path) {
                    Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
                    _ => Ok(()),
                };
            }
            let text = serde_json::to_vec_pretty(&list).map_err(std::io::Error::other)?;
            std::fs::create_dir_all(&self.folder)?;
            std::fs::write(&aside, text)?;
            std::fs::rename(&aside, &path)
        };
        let written = write();
        if let Err(error) = written {
            tracing::warn!("the list of overlays {} was not written: {error}", path.display());
        }
    }

    fn ground(&self) -> MutexGuard<'_, String> {
        self.ground.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads the part of a GeoTIFF that lies over a map, and keeps it.
    pub fn add(
        &self,
        id: String,
        file: &str,
        path: &Path,
        map: &ElevationMap,
    ) -> Result<OverlayAnswer, ApiError> {
        let answer = self.take(id, file, path, map)?;
        self.write_list();
        Ok(answer)
    }

    fn take(
        &self,
        id: String,
        file: &str,
        path: &Path,
        map: &ElevationMap,
    ) -> Result<OverlayAnswer, ApiError> {
        self.check_room()?;
        // Before it is read: a file that changes meanwhile is another at the next start.
        let stamp = stamp(path).unwrap_or_default();
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
        kept.push(Arc::new(Overlay { answer: answer.clone(), picture, stamp }));
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
        drop(kept);
        self.write_list();
        Ok(())
    }

    /// Removes all: the ground is another, by the name of its map.
    pub fn clear(&self, ground: &str) {
        self.locked().clear();
        ground.clone_into(&mut self.ground());
        self.write_list();
    }

    fn locked(&self) -> MutexGuard<'_, Vec<Arc<Overlay>>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
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
