//! Terrain files and flight logs on the command line.

use std::path::PathBuf;

use bridge::catalog;
use bridge::reader::{self, Limits};
use clap::Subcommand;
use serde_json::{Value, json};
use terrain::synthetic::{self, Recipe};
use wire::check::{At, RequestError};
use wire::time::Timestamp;

use super::{Failure, Output, Verdict};
use crate::error::ApiError;
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

/// Flight logs.
#[derive(Debug, Subcommand)]
pub(super) enum LogCommand {
    /// What is in a flight log, and what is wrong with it; exit status 1 if anything is.
    Info {
        /// The MCAP file.
        file: PathBuf,
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

pub(super) fn log(command: &LogCommand, output: Output) -> Result<Verdict, Failure> {
    let LogCommand::Info { file } = command;
    let content = reader::read_file(file, Limits::default()).map_err(|error| {
        let ApiError(info) = error.into();
        let code = if info.code == "log_too_large" { "log_too_large" } else { "log_damaged" };
        RequestError::new(code, format!("{}: {}", file.display(), info.message))
    })?;
    let mut channels: Vec<(String, u64)> = Vec::new();
    let (mut start, mut end) = (None::<Timestamp>, None::<Timestamp>);
    for message in &content.messages {
        start = Some(start.map_or(message.log_time, |t| t.min(message.log_time)));
        end = Some(end.map_or(message.log_time, |t| t.max(message.log_time)));
        match channels.iter_mut().find(|(name, _)| *name == *message.channel) {
            Some((_, count)) => *count += 1,
            None => channels.push((message.channel.to_string(), 1)),
        }
    }
    channels.sort();
    let duration_s = start.zip(end).map(|(start, end)| end.seconds_since(start));
    let damage: Vec<Value> = content
        .damage
        .iter()
        .map(|damage| json!({ "code": damage.code(), "message": damage.to_string() }))
        .collect();
    let name = file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    output.result(&json!({
        "file": file.display().to_string(),
        "id": name.filter(|name| catalog::is_log_id(name)),
        "messages": content.messages.len(),
        "start": start,
        "end": end,
        "duration_s": duration_s,
        "channels": channels.into_iter().collect::<std::collections::BTreeMap<_, _>>(),
        "damage": damage,
    }))?;
    Ok(if content.damage.is_empty() { Verdict::Done } else { Verdict::No })
}
