//! The grounds that requests name: files, recipes, the plane, versions of the server's own map.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Point2, Vector3};
use terrain::formats::{Crop, CropCenter, ReadOptions};
use terrain::synthetic::{self, Recipe};
use terrain::{ElevationMap, PLANE_HALF_EXTENT_M, PLANE_RESOLUTION_M, TerrainError};
use wire::check::{self, At, RequestError};
use wire::resources::ImportCrop;
use wire::scene::{Recipe as WireRecipe, Terrain};

use crate::terrain_files;
use crate::terrain_store::TerrainStore;

/// Largest terrain file that is read as a whole (bytes).
pub const FILE_BYTES_MAX: u64 = 256 << 20;
/// Most nodes of a file that the server reads; larger ones are to be cropped.
pub const SERVED_NODES_MAX: usize = 16_000_000;
/// Maps of files and recipes kept in memory for the next request.
const CACHE_MAPS: usize = 4;
/// Most nodes of the maps kept, so that a few large ones do not fill the memory.
const CACHE_NODES: usize = 32_000_000;
/// Coefficient of friction where nothing is said.
pub const FRICTION: f64 = 0.7;

/// Where `terrain.file` is looked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FileRoot {
    /// Over HTTP: a plain name in this folder.
    Folder(PathBuf),
    /// On the command line: a path, relative to this folder.
    Relative(PathBuf),
}

/// Finds the ground that a request names.
pub struct Terrains {
    root: FileRoot,
    store: Option<Arc<TerrainStore>>,
    /// Recently used maps, newest last.
    cache: Mutex<Vec<(String, ElevationMap)>>,
}

/// True for the names of terrain files over HTTP: `[A-Za-z0-9._-]`, 1 to 64 characters, not
/// beginning with a dot.
pub fn is_file_name(name: &str) -> bool {
    let plain = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-');
    (1..=64).contains(&name.len()) && name.bytes().all(plain) && !name.starts_with('.')
}

impl Terrains {
    /// Terrains with files from `root` and, over HTTP, the versions of `store`.
    pub fn new(root: FileRoot, store: Option<Arc<TerrainStore>>) -> Terrains {
        Terrains { root, store, cache: Mutex::default() }
    }

    /// The map that `terrain` names.
    pub fn resolve(&self, at: &At<'_>, terrain: &Terrain) -> Result<ElevationMap, RequestError> {
        if let Some(friction) = terrain.friction {
            check::within(&at.field("friction"), friction, [0.0, 10.0], "")?;
        }
        let Terrain { file, version, recipe, plane, .. } = terrain;
        let map = match (file, version, recipe, plane) {
            (Some(file), None, None, None) => self.file(&at.field("file"), file)?,
            (None, Some(version), None, None) => self.version(&at.field("version"), version)?,
            (None, None, Some(recipe), None) => {
                self.recipe(&at.field("recipe"), recipe, terrain.seed.unwrap_or(0))?
            }
            (None, None, None, Some(_)) => {
                ElevationMap::plane(PLANE_HALF_EXTENT_M, PLANE_RESOLUTION_M)
                    .map_err(|error| terrain_error(at, &error))?
            }
            _ => {
                let text = "takes exactly one of file, version, recipe and plane";
                return Err(RequestError::at("terrain_ambiguous", at, text));
            }
        };
        if terrain.seed.is_some() && recipe.is_none() {
            let text = "goes with a recipe only";
            return Err(RequestError::at("terrain_ambiguous", &at.field("seed"), text));
        }
        match terrain.offset_m {
            Some(offset) => {
                let offset = check::position(&at.field("offset_m"), offset)?;
                Ok(map.translated(Vector3::from(offset)))
            }
            None => Ok(map),
        }
    }

    /// A file's map, or the part that `crop` says. Of GeoTIFF and PDS3 only that part is read, however
    /// large the file.
    pub fn import(
        &self,
        at: &At<'_>,
        file: &str,
        crop: Option<&ImportCrop>,
        cell_m: Option<f64>,
    ) -> Result<ElevationMap, RequestError> {
        let crop = crop.map(|crop| Crop {
            center: match crop.center_m {
                Some([x, y]) => CropCenter::Meters(Point2::new(x, y)),
                None => CropCenter::Fraction(Point2::new(0.5, 0.5)),
            },
            width_m: crop.width_m,
        });
        let max_nodes = match self.root {
            FileRoot::Folder(_) => SERVED_NODES_MAX,
            FileRoot::Relative(_) => terrain::MAX_NODES,
        };
        let options = ReadOptions { crop, max_nodes, cell_m };
        let path = self.path(at, file)?;
        let beside = |name: &str| {
            // What a label points to is beside it, whatever it says.
            let folder = file.rsplit_once('/').map_or("", |(folder, _)| folder);
            let name = short_name(name);
            let name = if folder.is_empty() { name } else { format!("{folder}/{name}") };
            self.path(at, &name).ok()
        };
        terrain_files::read(at, &short_name(file), &path, beside, &options)
    }

    fn file(&self, at: &At<'_>, file: &str) -> Result<ElevationMap, RequestError> {
        let path = self.path(at, file)?;
        let stamp = std::fs::metadata(&path).ok().map(|m| (m.len(), m.modified().ok()));
        self.cached(&format!("{} {stamp:?}", path.display()), || self.import(at, file, None, None))
    }

    fn version(&self, at: &At<'_>, version: &str) -> Result<ElevationMap, RequestError> {
        let Some(store) = &self.store else {
            let text = "names a version of a server's map; over HTTP only";
            return Err(RequestError::at("terrain_unknown", at, text));
        };
        store.get(at, version).map(|version| version.map.clone())
    }

    fn recipe(
        &self,
        at: &At<'_>,
        recipe: &WireRecipe,
        seed: u64,
    ) -> Result<ElevationMap, RequestError> {
        let recipe = full_recipe(at, recipe)?;
        self.cached(&format!("{seed} {recipe}"), || {
            synthetic::generate(&recipe, seed).map_err(|error| terrain_error(at, &error))
        })
    }

    /// The path of a terrain file.
    fn path(&self, at: &At<'_>, file: &str) -> Result<PathBuf, RequestError> {
        let shown: String = file.chars().take(80).collect();
        let path = match &self.root {
            FileRoot::Folder(_) if !is_file_name(file) => {
                let text = format_args!(
                    "is {shown:?}; a file of the terrain folder has a name of 1 to 64 of \
                     A-Z a-z 0-9 . _ - and no folder"
                );
                return Err(RequestError::at("file_name_invalid", at, text));
            }
            FileRoot::Folder(folder) | FileRoot::Relative(folder) => folder.join(file),
        };
        let found = match &self.root {
            FileRoot::Folder(_) => std::fs::symlink_metadata(&path),
            FileRoot::Relative(_) => std::fs::metadata(&path),
        };
        if found.is_ok_and(|found| found.is_file()) {
            return Ok(path);
        }
        let text = format_args!("names the file {shown:?}, which is not there");
        Err(RequestError::at("terrain_file_unknown", at, text))
    }

    fn cached(
        &self,
        key: &str,
        make: impl FnOnce() -> Result<ElevationMap, RequestError>,
    ) -> Result<ElevationMap, RequestError> {
        let lock = || self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, map)) = lock().iter().find(|(k, _)| k == key) {
            return Ok(map.clone());
        }
        let map = make()?;
        let mut cache = lock();
        cache.push((key.into(), map.clone()));
        let nodes = |c: &[(String, ElevationMap)]| -> usize {
            c.iter().map(|(_, map)| map.grid().len()).sum()
        };
        while cache.len() > 1 && (cache.len() > CACHE_MAPS || nodes(&cache[..]) > CACHE_NODES) {
            cache.remove(0);
        }
        Ok(map)
    }
}

/// The recipe of a request: square, with the changes it asks for.
pub fn full_recipe(at: &At<'_>, recipe: &WireRecipe) -> Result<Recipe, RequestError> {
    let mut full = Recipe::from_name(&recipe.name).map_err(|error| terrain_error(at, &error))?;
    if let Some(width_m) = recipe.width_m {
        (full.width_m, full.height_m) = (width_m, width_m);
    }
    full.resolution_m = recipe.resolution_m.unwrap_or(full.resolution_m);
    full.check().map_err(|error| terrain_error(at, &error))?;
    Ok(full)
}

/// The refusal of a terrain operation, in a request's terms.
pub fn terrain_error(at: &At<'_>, error: &TerrainError) -> RequestError {
    let code = match error {
        TerrainError::OutOfRange { .. } => "out_of_range",
        TerrainError::TooManyNodes { .. } | TerrainError::TooManyFeatures { .. } => "too_many",
        TerrainError::CropTooSmall { .. } => "out_of_range",
        TerrainError::UnknownRecipe { .. } => "recipe_unknown",
        _ => "terrain_file_invalid",
    };
    RequestError::at(code, at, format_args!("was refused: {error}"))
}

/// The last part of a path: what a map is called after.
fn short_name(file: &str) -> String {
    Path::new(file).file_name().map_or_else(|| file.into(), |name| name.to_string_lossy().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn over_http_only_plain_names_name_a_file() {
        let names = ["a.tif", "DEM_1-x.off"];
        assert!(names.iter().all(|name| is_file_name(name)));
        let long = "x".repeat(65);
        let bad = [
            "",
            ".",
            "..",
            ".hidden",
            "a/b.tif",
            "..\\a.tif",
            "a\0.tif",
            "ä.tif",
            "a b.tif",
            "%2e%2e",
            &long,
        ];
        assert!(bad.iter().all(|name| !is_file_name(name)));
    }

    #[test]
    fn one_ground_is_named_or_the_request_is_refused() {
        let terrains = Terrains::new(FileRoot::Folder("nowhere".into()), None);
        let at = At::root("terrain");
        let code = |terrain: &Terrain| terrains.resolve(&at, terrain).unwrap_err().code;
        assert_eq!(code(&Terrain::default()), "terrain_ambiguous");
        let plane = Terrain { plane: Some(Default::default()), ..Terrain::default() };
        assert!(terrains.resolve(&at, &plane).is_ok());
        assert_eq!(
            code(&Terrain { file: Some("a.tif".into()), ..plane.clone() }),
            "terrain_ambiguous"
        );
        assert_eq!(code(&Terrain { seed: Some(1), ..plane.clone() }), "terrain_ambiguous");
        assert_eq!(code(&Terrain { friction: Some(-1.0), ..plane }), "out_of_range");
        let file = |name: &str| Terrain { file: Some(name.into()), ..Terrain::default() };
        assert_eq!(code(&file("../a.tif")), "file_name_invalid");
        assert_eq!(code(&file("a.tif")), "terrain_file_unknown");
    }
}
