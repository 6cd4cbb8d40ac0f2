//! The map: its versions, tiles and cells, and what can be imported.

use std::path::PathBuf;

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::check::{self, At, COORDINATE_MAX_M};
use wire::live::JobReport;
use wire::resources::{
    CellAnswer, ErrorBody, ImportRequest, TerrainFile, TerrainFiles, TerrainVersions,
};

use crate::app::AppState;
use crate::body::{Body, Operator, Path, Query};
use crate::error::ApiError;
use crate::stop::Stop;
use crate::terrain_store::ExportFormat;
use crate::{import, terrains};

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(versions))
        .routes(routes!(tile))
        .routes(routes!(cell))
        .routes(routes!(export))
        .routes(routes!(list))
        .routes(routes!(import_terrain))
}

/// The versions of the map that are kept, newest first.
#[utoipa::path(
    get, path = "/terrain/versions", tag = "terrain",
    responses((status = 200, body = TerrainVersions))
)]
async fn versions(State(app): State<AppState>) -> Json<TerrainVersions> {
    Json(app.store.list())
}

/// A tile of a layer: 256 cells a side and one node more, binary behind a 64-byte header. At zoom z
/// nodes are 2^z times as far apart: heights of the nodes that are left, the worst value elsewhere.
#[utoipa::path(
    get, path = "/terrain/{version}/tiles/{layer}/{z}/{x}/{y}", tag = "terrain",
    params(
        ("version" = String, Path, description = "Version of the map"),
        ("layer" = String, Path, description = "height, slope, roughness, step, goodness, certainty or class; of maps that cameras made also sigma, count, age, source and mask (1 seen, 2 hidden by the robot, 3 by the seam of its image, 4 contradictory, 5 from the map before, 6 a wheel stood there)"),
        ("z" = usize, Path, description = "Zoom, from 0 (the map's own nodes) to below `zooms`"),
        ("x" = usize, Path, description = "Column of the tile"),
        ("y" = usize, Path, description = "Row of the tile"),
    ),
    responses(
        (status = 200, body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "As the ETag says"),
        (status = 404, body = ErrorBody)
    )
)]
async fn tile(
    State(app): State<AppState>,
    Path((version, layer, z, x, y)): Path<(String, String, usize, usize, usize)>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let version = app.store.get(&At::root("version"), &version)?;
    let etag = format!("\"{}-{layer}-{z}-{x}-{y}\"", version.info.version);
    let unknown = || {
        ApiError::new(
            "tile_unknown",
            "there is no such tile; GET /terrain/versions tells which are",
        )
    };
    let cached = headers.get(header::IF_NONE_MATCH).and_then(|v| v.to_str().ok());
    let tag = HeaderValue::from_str(&etag).map_err(|_| unknown())?;
    let cache = HeaderValue::from_static("public, max-age=31536000, immutable");
    let headers = [(header::ETAG, tag), (header::CACHE_CONTROL, cache)];
    let is_same =
        |tags: &str| tags.split(',').any(|tag| tag.trim().trim_start_matches("W/") == etag);
    if cached.is_some_and(is_same) {
        return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
    }
    let bytes = tokio::task::spawn_blocking(move || version.tile(&layer, z, x, y))
        .await
        .map_err(|error| ApiError::internal("the tile", error))??
        .ok_or_else(unknown)?;
    Ok((headers, bytes).into_response())
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
struct Place {
    /// x in `world` (m).
    x_m: f64,
    /// y in `world` (m).
    y_m: f64,
}

/// Everything known of the cell at a place.
#[utoipa::path(
    get, path = "/terrain/{version}/cell", tag = "terrain",
    params(("version" = String, Path, description = "Version of the map"), Place),
    responses(
        (status = 200, body = CellAnswer),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn cell(
    State(app): State<AppState>,
    Path(version): Path<String>,
    Query(place): Query<Place>,
) -> Result<Json<CellAnswer>, ApiError> {
    let version = app.store.get(&At::root("version"), &version)?;
    for (name, value) in [("x_m", place.x_m), ("y_m", place.y_m)] {
        check::within(&At::root(name), value, [-COORDINATE_MAX_M, COORDINATE_MAX_M], " m")?;
    }
    Ok(Json(version.cell(place.x_m, place.y_m)))
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
struct ExportQuery {
    /// `tif` (heights and layers), `obj` or `ply` (the surface as triangles), `classes` (traversability as bytes)
    /// or `texture` (camera images).
    #[serde(default)]
    #[param(inline)]
    format: ExportFormat,
    /// A mesh may be this far above or below the surface (m); 0, the whole mesh, where absent.
    #[serde(default)]
    error_m: Option<f64>,
}

/// A version of the map as a file: GeoTIFF (heights and layers of traversability, float32, local
/// meters) or a mesh of its surface, whole or simplified within a stated error.
#[utoipa::path(
    get, path = "/terrain/{version}/export", tag = "terrain",
    params(("version" = String, Path, description = "Version of the map"), ExportQuery),
    responses(
        (status = 200, body = Vec<u8>, content_type = "image/tiff"),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn export(
    State(app): State<AppState>,
    Path(version): Path<String>,
    Query(query): Query<ExportQuery>,
) -> Result<Response, ApiError> {
    let version = app.store.get(&At::root("version"), &version)?;
    let error_m = query.error_m.unwrap_or(0.0);
    check::within(&At::root("error_m"), error_m, [0.0, 1000.0], " m")?;
    let (ending, media_type) = query.format.names();
    let name = format!("attachment; filename=\"terrain-{}.{ending}\"", version.info.version);
    let permit = app.gate.enter().await?;
    let stop = Stop::after(Some(super::drape::TEXTURE_DEADLINE_S))?;
    let (robot, rig) = (app.live.robot().clone(), app.live.rig().clone());
    let work = move || {
        let _place = permit;
        if query.format == ExportFormat::Texture {
            return Ok(version.texture(&robot, &rig, &stop)?.geotiff()?);
        }
        version.export(query.format, error_m).map_err(ApiError::from)
    };
    let bytes = tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| ApiError::internal("the export", error))??;
    let headers =
        [(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_DISPOSITION, name)];
    Ok((headers, bytes).into_response())
}

/// The files that can be imported.
#[utoipa::path(
    get, path = "/terrain/files", tag = "terrain", operation_id = "terrain_files",
    responses((status = 200, body = TerrainFiles))
)]
async fn list(State(app): State<AppState>) -> Result<Json<TerrainFiles>, ApiError> {
    let files = files(app.config.server.terrain_dir.clone()).await?;
    Ok(Json(TerrainFiles { files }))
}

/// The files of the terrain folder, by name.
pub(super) async fn files(folder: PathBuf) -> Result<Vec<TerrainFile>, ApiError> {
    let list = move || {
        let mut files: Vec<TerrainFile> = std::fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| {
                let size = entry.metadata().ok().filter(|m| m.is_file())?.len();
                let name = entry.file_name().into_string().ok()?;
                terrains::is_file_name(&name).then_some(TerrainFile { name, size })
            })
            .collect();
        files.sort_by(|a, b| a.name.cmp(&b.name));
        files
    };
    tokio::task::spawn_blocking(list)
        .await
        .map_err(|error| ApiError::internal("listing the files", error))
}

/// Makes a new map from a file or a recipe and seats the simulated rover on it: only while the
/// rover is idle.
#[utoipa::path(
    post, path = "/terrain/imports", tag = "terrain", request_body = ImportRequest,
    responses(
        (status = 202, body = JobReport),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn import_terrain(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(request): Body<ImportRequest>,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    let report = import::start(app, who, request)?;
    Ok((StatusCode::ACCEPTED, Json(report)))
}
