//! Terrain on the command line: generated, read and written.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::{Value, json};
use terrain::ElevationMap;
use terrain::synthetic::{self, Recipe};
use terrain::traversability::{Limits, traversability};
use wire::check::{At, RequestError};
use wire::resources::ImportCrop;

use super::{Failure, Output, Verdict};
use crate::terrain_store::{ExportFormat, export, source_text, version_name};
use crate::terrains::{FileRoot, Terrains, terrain_error};

/// Terrain files and synthetic ground.
#[derive(Debug, Subcommand)]
pub(super) enum TerrainCommand {
    /// Generate synthetic ground and write its heights as a GeoTIFF.
    Generate {
        /// Kind of ground: boulder_field, smooth_mare or rough_highlands.
        #[arg(long, default_value = "boulder_field")]
        recipe: String,
        /// Seed of all random numbers.
        #[arg(long, default_value_t = 7)]
        seed: u64,
        /// Side of the square generated (m); the recipe's own where absent.
        #[arg(long, value_name = "M")]
        width_m: Option<f64>,
        /// Distance between nodes (m); the recipe's own where absent.
        #[arg(long, value_name = "M")]
        resolution_m: Option<f64>,
        /// The GeoTIFF to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Read a terrain file as `serve` would, tell what is in it, and write its heights as a GeoTIFF if
    /// asked to.
    Import {
        #[command(flatten)]
        source: FileArgs,
        /// The GeoTIFF to write.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Write a terrain file in another format: .tif with the layers of traversability, or its surface as
    /// .obj or .ply.
    Export {
        #[command(flatten)]
        source: FileArgs,
        /// The file to write; the end of its name tells the format.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Simplify a mesh: it may be this far above or below the surface (m).
        #[arg(long, value_name = "M", default_value_t = 0.0)]
        error_m: f64,
        /// Width of the foot that the layers are for (m); only the heights where absent.
        #[arg(long, value_name = "M")]
        footprint_m: Option<f64>,
    },
}

/// A terrain file, or a part of it.
#[derive(Debug, Args)]
pub(super) struct FileArgs {
    /// The file: .tif, .img, .lbl, .off, .obj, .ply or .png.
    file: String,
    /// Take only a square of this side from its middle (m).
    #[arg(long, value_name = "M")]
    crop_m: Option<f64>,
    /// Middle of that square, from the file's lower left corner (m): X,Y.
    #[arg(long, value_name = "X,Y", value_parser = pair, requires = "crop_m")]
    center_m: Option<[f64; 2]>,
    /// Distance between nodes (m) where the file does not tell.
    #[arg(long, value_name = "M")]
    cell_m: Option<f64>,
}

/// Two numbers with a comma between them.
fn pair(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let parts = text.split_once(',').and_then(|(x, y)| number(x).zip(number(y)));
    parts.map(|(x, y)| [x, y]).ok_or_else(|| "give two numbers, as 10,20".to_owned())
}

impl FileArgs {
    fn read(&self) -> Result<ElevationMap, RequestError> {
        let center_m = self.center_m;
        let crop = self.crop_m.map(|width_m| ImportCrop { center_m, width_m });
        let terrains = Terrains::new(FileRoot::Relative(PathBuf::new()), None);
        terrains.import(&At::root("file"), &self.file, crop.as_ref(), self.cell_m)
    }
}

pub(super) fn terrain(command: &TerrainCommand, output: Output) -> Result<Verdict, Failure> {
    let heights = |map: &ElevationMap| export(map, None, ExportFormat::Tif, 0.0);
    let answer = match command {
        TerrainCommand::Generate { recipe, seed, width_m, resolution_m, out } => {
            let refuse = |e: terrain::TerrainError| terrain_error(&At::root("recipe"), &e);
            let mut recipe = Recipe::from_name(recipe).map_err(refuse)?;
            if let Some(width_m) = width_m {
                (recipe.width_m, recipe.height_m) = (*width_m, *width_m);
            }
            recipe.resolution_m = resolution_m.unwrap_or(recipe.resolution_m);
            let map = synthetic::generate(&recipe, *seed).map_err(refuse)?;
            write(out, &heights(&map)?)?;
            let mut answer = summary(&map);
            answer["file"] = json!(out.display().to_string());
            answer["recipe"] = json!(recipe.to_string());
            answer["seed"] = json!(seed);
            answer["layers"] = json!(["height_m"]);
            answer
        }
        TerrainCommand::Import { source, out } => {
            let map = source.read()?;
            let mut answer = summary(&map);
            if let Some(out) = out {
                write(out, &heights(&map)?)?;
                answer["file"] = json!(out.display().to_string());
            }
            answer
        }
        TerrainCommand::Export { source, out, error_m, footprint_m } => {
            let Some(format) = ExportFormat::of_name(&out.display().to_string()) else {
                let text = format_args!("ends in nothing known: use .tif, .obj or .ply");
                return Err(RequestError::at("file_name_invalid", &At::root("out"), text).into());
            };
            let at = At::root("error_m");
            wire::check::within(&at, *error_m, [0.0, 1000.0], " m")?;
            let map = source.read()?;
            let layers = footprint_m
                .map(|foot| traversability(&map, foot, &Limits::default()))
                .transpose()
                .map_err(|error| terrain_error(&At::root("footprint_m"), &error))?;
            let bytes = export(&map, layers.as_ref(), format, *error_m)?;
            write(out, &bytes)?;
            let mut answer = summary(&map);
            answer["file"] = json!(out.display().to_string());
            answer["bytes"] = json!(bytes.len());
            answer["error_m"] = json!(error_m);
            answer
        }
    };
    output.result(&answer)?;
    Ok(Verdict::Done)
}

/// What there is to tell of a map.
fn summary(map: &ElevationMap) -> Value {
    let grid = map.grid();
    let known = map.heights().values().iter().filter(|z| !z.is_nan());
    let n_known = known.clone().count();
    let range = known.fold(None, |range: Option<[f32; 2]>, z| {
        Some(range.map_or([*z; 2], |[low, high]| [low.min(*z), high.max(*z)]))
    });
    json!({
        "version": version_name(map),
        "source": source_text(map),
        "resolution_m": grid.resolution,
        "size": [grid.nx, grid.ny],
        "origin_m": [grid.origin.x, grid.origin.y],
        "frame_offset_m": <[f64; 3]>::from(map.frame_offset()),
        "reference_system": map.placement().system.as_ref().map(|system| system.name()),
        "z_range_m": range,
        "known_share": n_known as f64 / grid.len().max(1) as f64,
    })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), RequestError> {
    std::fs::write(path, bytes).map_err(|error| {
        let message = format!("the file {} cannot be written: {error}", path.display());
        RequestError::new("output_unwritable", message)
    })
}
