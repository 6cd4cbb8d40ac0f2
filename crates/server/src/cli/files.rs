//! Terrain files on the command line.

use std::path::PathBuf;

use clap::Subcommand;
use serde_json::json;
use terrain::synthetic::{self, Recipe};
use wire::check::{At, RequestError};

use super::{Failure, Output, Verdict};
use crate::terrain_store::{source_text, version_name};
use crate::terrains::terrain_error;

/// Synthetic ground.
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
}

pub(super) fn terrain(command: &TerrainCommand, output: Output) -> Result<Verdict, Failure> {
    let TerrainCommand::Generate { recipe, seed, width_m, resolution_m, out } = command;
    let at = At::root("recipe");
    let refuse = |error: &terrain::TerrainError| terrain_error(&at, error);
    let mut recipe = Recipe::from_name(recipe).map_err(|e| refuse(&e))?;
    if let Some(width_m) = width_m {
        (recipe.width_m, recipe.height_m) = (*width_m, *width_m);
    }
    recipe.resolution_m = resolution_m.unwrap_or(recipe.resolution_m);
    let map = synthetic::generate(&recipe, *seed).map_err(|e| refuse(&e))?;
    let layers = [("height_m", map.heights())];
    let bytes =
        terrain::formats::geotiff::write_layers(map.grid(), &layers).map_err(|e| refuse(&e))?;
    std::fs::write(out, &bytes).map_err(|error| {
        let message = format!("the file {} cannot be written: {error}", out.display());
        RequestError::new("output_unwritable", message)
    })?;
    let grid = map.grid();
    output.result(&json!({
        "file": out.display().to_string(),
        "version": version_name(&map),
        "source": source_text(&map),
        "recipe": recipe.to_string(),
        "seed": seed,
        "resolution_m": grid.resolution,
        "size": [grid.nx, grid.ny],
        "layers": ["height_m"],
    }))?;
    Ok(Verdict::Done)
}
