//! Versions of the map that cameras made: put in use again, made again without a pair or its fit, and the
//! pictures that they come from.

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::map_version::FitRequest;
use wire::resources::{ErrorBody, TerrainVersion};

use crate::app::AppState;
use crate::body::{Body, Operator, Path};
use crate::error::ApiError;
use crate::reconstruction::versions::{self, Change};

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(select))
        .routes(routes!(remove_pair))
        .routes(routes!(fit_pair))
        .routes(routes!(picture))
}

/// Puts a version that is kept in use again: plans go by it, and reconstructions go on from it.
#[utoipa::path(
    post, path = "/terrain/versions/{version}/select", tag = "terrain", operation_id = "select_version",
    params(("version" = String, Path, description = "Version of the map")),
    responses(
        (status = 200, body = TerrainVersion), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn select(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(version): Path<String>,
) -> Result<Json<TerrainVersion>, ApiError> {
    versions::select(&app, &who, &version).map(Json)
}

/// Makes the map in use again without a capture of a pair: a new version, as if it had never been in.
#[utoipa::path(
    delete, path = "/terrain/{version}/pairs/{source}", tag = "terrain",
    params(
        ("version" = String, Path, description = "The version in use"),
        ("source" = u32, Path, description = "Number of the capture among its sources"),
    ),
    responses(
        (status = 200, body = TerrainVersion), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn remove_pair(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path((version, source)): Path<(String, u32)>,
) -> Result<Json<TerrainVersion>, ApiError> {
    versions::change(app, who, version, Change::Remove(source)).await.map(Json)
}

/// Makes the map in use again with a capture where it says it is, or where it fitted the map.
#[utoipa::path(
    put, path = "/terrain/{version}/pairs/{source}/fit", tag = "terrain", request_body = FitRequest,
    params(
        ("version" = String, Path, description = "The version in use"),
        ("source" = u32, Path, description = "Number of the capture among its sources"),
    ),
    responses(
        (status = 200, body = TerrainVersion), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn fit_pair(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path((version, source)): Path<(String, u32)>,
    Body(request): Body<FitRequest>,
) -> Result<Json<TerrainVersion>, ApiError> {
    versions::change(app, who, version, Change::Fit(source, request.fitted)).await.map(Json)
}

/// A picture of a pair of one of the last reconstructions: `left`, `right`, `rectified_left`,
/// `rectified_right`, or `disparity` (near is bright, holes are transparent).
#[utoipa::path(
    get, path = "/terrain/reconstructions/{id}/pairs/{pair}/{picture}", tag = "terrain",
    params(
        ("id" = String, Path, description = "The reconstruction"),
        ("pair" = String, Path, description = "Name of the pair"),
        ("picture" = String, Path, description = "Its name with .png, as `left.png`"),
    ),
    responses(
        (status = 200, body = Vec<u8>, content_type = "image/png"),
        (status = 404, body = ErrorBody)
    )
)]
async fn picture(
    State(app): State<AppState>,
    Path((id, pair, picture)): Path<(String, String, String)>,
) -> Result<Response, ApiError> {
    let name = picture.strip_suffix(".png").unwrap_or_default();
    let bytes = app.reconstructions.picture(&id, &pair, name)?;
    let headers = [
        (header::CONTENT_TYPE, "image/png"),
        (header::CACHE_CONTROL, "private, max-age=86400, immutable"),
    ];
    Ok((headers, bytes).into_response())
}
