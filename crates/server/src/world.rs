//! The ground to stand on, and the simulated rover seated on it.

use std::sync::Arc;

use nalgebra::Point2;
use rover::Robot;
use sim::{SettleError, SettleOptions, Settled, SimRover, settle};
use terrain::ElevationMap;
use terrain::synthetic::{self, Recipe};
use wire::check::{self, At, COORDINATE_MAX_M, RequestError};
use wire::resources::ImportRequest;

use crate::config::{Config, TerrainConfig};
use crate::terrains::{Terrains, full_recipe, terrain_error};

/// Recipe of the detail added to a file where the request names none.
const DETAIL: &str = "boulder_field";

/// The request that the configuration stands for.
pub fn first_import(config: &Config) -> ImportRequest {
    let TerrainConfig { file, crop_x_m, crop_y_m, crop_width_m, detail_resolution_m, .. } =
        &config.terrain;
    let from_file = !file.is_empty();
    ImportRequest {
        file: from_file.then(|| file.clone()),
        recipe: None,
        seed: config.terrain.seed,
        crop: (from_file && *crop_width_m > 0.0).then(|| wire::resources::ImportCrop {
            center_m: (*crop_x_m >= 0.0 && *crop_y_m >= 0.0).then_some([*crop_x_m, *crop_y_m]),
            width_m: *crop_width_m,
        }),
        cell_m: None,
        detail_resolution_m: (from_file && *detail_resolution_m > 0.0)
            .then_some(*detail_resolution_m),
        place_m: None,
        heading_rad: config.rover.heading_rad,
    }
}

/// The synthetic ground of the configuration.
pub fn configured_recipe(config: &TerrainConfig) -> Result<Recipe, RequestError> {
    let at = At::root("terrain");
    let mut recipe = Recipe::from_name(&config.recipe).map_err(|e| terrain_error(&at, &e))?;
    (recipe.width_m, recipe.height_m) = (config.width_m, config.width_m);
    recipe.resolution_m = config.resolution_m;
    recipe.flat_center_m = config.flat_center_m;
    recipe.check().map_err(|error| terrain_error(&at, &error))?;
    Ok(recipe)
}

/// Refuses what cannot be imported, before any work is done.
pub fn check_import(request: &ImportRequest) -> Result<(), RequestError> {
    let refuse = |field: &str, text: &str| {
        Err(RequestError::at("terrain_ambiguous", &At::root(field), text))
    };
    match (&request.file, &request.recipe) {
        (None, None) => return refuse("file", "or recipe must be given"),
        (Some(_), Some(recipe)) if request.detail_resolution_m.is_none() => {
            let text = format!(
                "{:?} goes with a file only as its detail: give \
                                detail_resolution_m, or leave one of the two out",
                recipe.name
            );
            return refuse("recipe", &text);
        }
        (None, Some(_)) if request.crop.is_some() => {
            return refuse("crop", "goes with a file only");
        }
        (None, Some(_)) if request.detail_resolution_m.is_some() => {
            return refuse("detail_resolution_m", "goes with a file only");
        }
        _ => {}
    }
    if let Some(crop) = &request.crop {
        let at = At::root("crop");
        check::within(&at.field("width_m"), crop.width_m, [1e-3, 1e7], " m")?;
        for (i, value) in crop.center_m.iter().flatten().enumerate() {
            let at = at.field("center_m");
            check::within(&at.index(i), *value, [0.0, 1e8], " m")?;
        }
    }
    if let Some(cell) = request.cell_m {
        if request.file.is_none() {
            return refuse("cell_m", "goes with a file only");
        }
        check::within(&At::root("cell_m"), cell, [0.005, 1e4], " m")?;
    }
    if let Some(resolution) = request.detail_resolution_m {
        check::within(&At::root("detail_resolution_m"), resolution, [0.005, 10.0], " m")?;
    }
    for (i, value) in request.place_m.iter().flatten().enumerate() {
        let at = At::root("place_m");
        check::within(&at.index(i), *value, [-COORDINATE_MAX_M, COORDINATE_MAX_M], " m")?;
    }
    check::within(&At::root("heading_rad"), request.heading_rad, [-100.0, 100.0], " rad")?;
    Ok(())
}

/// The map of an import.
pub fn import_map(
    terrains: &Terrains,
    request: &ImportRequest,
) -> Result<ElevationMap, RequestError> {
    let at = At::root("recipe");
    let recipe = match &request.recipe {
        Some(recipe) => full_recipe(&at, recipe)?,
        None => Recipe::from_name(DETAIL).map_err(|error| terrain_error(&at, &error))?,
    };
    let Some(file) = &request.file else {
        return synthetic::generate(&recipe, request.seed).map_err(|e| terrain_error(&at, &e));
    };
    let map = terrains.import(&At::root("file"), file, request.crop.as_ref(), request.cell_m)?;
    match request.detail_resolution_m {
        Some(resolution) => synthetic::add_detail(&map, &recipe, request.seed, resolution)
            .map_err(|error| terrain_error(&At::root("detail_resolution_m"), &error)),
        None => Ok(map),
    }
}

/// The simulated rover, seated near `place` (the map's middle where there is none).
pub fn seat(
    robot: &Arc<Robot>,
    map: &ElevationMap,
    gravity: f64,
    place_m: Option<[f64; 2]>,
    heading_rad: f64,
    pose: &str,
) -> Result<(SimRover, Settled), RequestError> {
    let scene = collision::Scene::new(robot.clone(), map.clone(), &[])
        .map_err(|error| RequestError::new("internal", error.to_string()))?;
    let grid = map.grid();
    let middle = nalgebra::center(&grid.origin, &grid.far_corner());
    let place = place_m.map_or(middle, Point2::from);
    let scale = robot.scale();
    let default = SettleOptions::default();
    let options = SettleOptions { radius_m: default.radius_m * scale, ..default };
    let settled = settle(&scene, place, heading_rad, pose, &options).map_err(|error| {
        let (code, field) = match &error {
            SettleError::NoPlace { .. } => ("no_place", "place_m"),
            SettleError::UnknownPose { .. } => ("out_of_range", "pose"),
            SettleError::Value { .. } => ("out_of_range", "place_m"),
        };
        RequestError::at(code, &At::root(field), format_args!("was refused: {error}"))
    })?;
    let rover = SimRover::new(scene, settled.configuration.clone(), gravity).map_err(|error| {
        RequestError::at("no_place", &At::root("place_m"), format_args!("was refused: {error}"))
    })?;
    Ok((rover, settled))
}
