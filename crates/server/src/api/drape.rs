//! What is laid over the ground: the texture of camera images, and imported rasters.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::check::At;
use wire::drape::{OverlayAnswer, OverlayList, OverlayRequest, TextureAnswer};
use wire::resources::ErrorBody;

use crate::app::AppState;
use crate::body::{Body, Path};
use crate::error::ApiError;
use crate::stop::Stop;

/// Time allowed for a texture (s): less than for any answer.
pub(super) const TEXTURE_DEADLINE_S: f64 = 25.0;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(texture))
        .routes(routes!(texture_tile))
        .routes(routes!(overlays, add_overlay))
        .routes(routes!(remove_overlay))
        .routes(routes!(overlay_tile))
}

/// Camera images laid over a version of the map that cameras made: for each place the best view, by distance and
/// angle, never the robot, balanced among images. Made when it is first asked for.
#[utoipa::path(
    get, path = "/terrain/{version}/texture", tag = "terrain",
    params(("version" = String, Path, description = "Version of the map")),
    responses(
        (status = 200, body = TextureAnswer), (status = 404, body = ErrorBody),
        (status = 429, body = ErrorBody), (status = 504, body = ErrorBody)
    )
)]
async fn texture(
    State(app): State<AppState>,
    Path(version): Path<String>,
) -> Result<Json<TextureAnswer>, ApiError> {
    let version = app.store.get(&At::root("version"), &version)?;
    let stop = Stop::after(Some(TEXTURE_DEADLINE_S))?;
    let asked = stop.clone();
    let (robot, rig) = (app.live.robot().clone(), app.live.rig().clone());
    let answer = move || {
        let texture = version.texture(&robot, &rig, &asked)?;
        Ok::<_, ApiError>(texture.answer(&version.info.version))
    };
    app.gate.run(&stop, answer).await?.map(Json)
}

/// A tile of a texture: PNG of gray and alpha, 256 texels a side at most, the greatest y first. `GET …/texture`
/// tells where they lie.
#[utoipa::path(
    get, path = "/terrain/{version}/texture/{x}/{y}", tag = "terrain",
    params(
        ("version" = String, Path, description = "Version of the map"),
        ("x" = usize, Path, description = "Column of the tile"),
        ("y" = usize, Path, description = "Row of the tile, from the least y on"),
    ),
    responses(
        (status = 200, body = Vec<u8>, content_type = "image/png"),
        (status = 404, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn texture_tile(
    State(app): State<AppState>,
    Path((version, x, y)): Path<(String, usize, usize)>,
) -> Result<Response, ApiError> {
    let version = app.store.get(&At::root("version"), &version)?;
    let stop = Stop::after(Some(TEXTURE_DEADLINE_S))?;
    let asked = stop.clone();
    let (robot, rig) = (app.live.robot().clone(), app.live.rig().clone());
    let tile = move || Ok::<_, ApiError>(version.texture(&robot, &rig, &asked)?.tile([x, y]));
    png_answer(app.gate.run(&stop, tile).await??)
}

/// A tile as an answer that stays as it is.
fn png_answer(tile: Option<Result<Bytes, png::EncodingError>>) -> Result<Response, ApiError> {
    let unknown = || ApiError::new("tile_unknown", "there is no such tile");
    let bytes = tile.ok_or_else(unknown)?.map_err(|error| ApiError::internal("a tile", error))?;
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("image/png"));
    let cache = HeaderValue::from_static("public, max-age=31536000, immutable");
    headers.insert(header::CACHE_CONTROL, cache);
    Ok((headers, bytes).into_response())
}

/// The rasters that can be laid over the ground, oldest first.
#[utoipa::path(
    get, path = "/terrain/overlays", tag = "terrain",
    responses((status = 200, body = OverlayList))
)]
async fn overlays(State(app): State<AppState>) -> Json<OverlayList> {
    Json(app.overlays.list())
}

/// Takes the part of a GeoTIFF that lies over the map in use: bytes, 16-bit or float samples, gray or color, with or
/// without alpha. It has to be in the coordinates of the file that the map was made from. It stays until it is
/// removed, or another ground is imported.
#[utoipa::path(
    post, path = "/terrain/overlays", tag = "terrain", request_body = OverlayRequest,
    responses(
        (status = 201, body = OverlayAnswer), (status = 404, body = ErrorBody),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn add_overlay(
    State(app): State<AppState>,
    Body(request): Body<OverlayRequest>,
) -> Result<(StatusCode, Json<OverlayAnswer>), ApiError> {
    let file = request.file;
    let path = app.terrain_file(&file)?;
    let ending = file.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
    if !matches!(ending.as_deref(), Some("tif" | "tiff")) {
        let message = "an overlay is a GeoTIFF: its name ends in tif or tiff";
        return Err(ApiError::new("file_name_invalid", message));
    }
    if !path.is_file() {
        let message = format!("there is no file {file}; PUT /terrain/files/{file} puts it there");
        return Err(ApiError::new("terrain_file_unknown", message));
    }
    let version = app.store.current();
    let permit = app.gate.enter().await?;
    let id = uuid::Uuid::now_v7().to_string();
    let work = move || {
        let _place = permit;
        app.overlays.add(id, &file, &path, &version.map)
    };
    let added = tokio::task::spawn_blocking(work).await;
    let answer = added.map_err(|error| ApiError::internal("the overlay", error))??;
    Ok((StatusCode::CREATED, Json(answer)))
}

/// Removes a raster from what can be laid over the ground; its file stays.
#[utoipa::path(
    delete, path = "/terrain/overlays/{id}", tag = "terrain",
    params(("id" = String, Path, description = "Identity of the overlay")),
    responses((status = 204), (status = 404, body = ErrorBody))
)]
async fn remove_overlay(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<StatusCode, ApiError> {
    app.overlays.remove(&id).map(|()| StatusCode::NO_CONTENT)
}

/// A tile of an overlay: PNG of color and alpha, 256 texels a side at most, the greatest y first.
#[utoipa::path(
    get, path = "/terrain/overlays/{id}/{x}/{y}", tag = "terrain",
    params(
        ("id" = String, Path, description = "Identity of the overlay"),
        ("x" = usize, Path, description = "Column of the tile"),
        ("y" = usize, Path, description = "Row of the tile, from the least y on"),
    ),
    responses(
        (status = 200, body = Vec<u8>, content_type = "image/png"),
        (status = 404, body = ErrorBody)
    )
)]
async fn overlay_tile(
    State(app): State<AppState>,
    Path((id, x, y)): Path<(String, usize, usize)>,
) -> Result<Response, ApiError> {
    let overlay = app.overlays.get(&id)?;
    let made = tokio::task::spawn_blocking(move || overlay.tile([x, y])).await;
    png_answer(made.map_err(|error| ApiError::internal("a tile", error))?)
}
