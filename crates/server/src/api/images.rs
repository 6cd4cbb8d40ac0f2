//! Images of the live rover that have come, and are on the way.

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::live::{ImageName, Side};
use wire::reconstruction::{CaptureAnswer, ImagesAnswer};
use wire::resources::ErrorBody;

use crate::app::AppState;
use crate::body::{Operator, Path};
use crate::error::ApiError;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(images))
        .routes(routes!(capture, let_images_go))
        .routes(routes!(image))
}

fn unknown() -> ApiError {
    let message = "there is no such image, or it is held no longer; the flight log has it";
    ApiError::new("image_unknown", message)
}

/// The captures of the live rover: what each `image` command has brought, pair by pair.
#[utoipa::path(
    get, path = "/rover/images", tag = "rover",
    responses((status = 200, body = ImagesAnswer))
)]
async fn images(State(app): State<AppState>) -> Json<ImagesAnswer> {
    Json(ImagesAnswer { captures: app.live.locked().0.images().answers() })
}

/// One capture.
#[utoipa::path(
    get, path = "/rover/images/{capture}", tag = "rover",
    params(("capture" = String, Path, description = "Identity of its command")),
    responses((status = 200, body = CaptureAnswer), (status = 404, body = ErrorBody))
)]
async fn capture(
    State(app): State<AppState>,
    Path(capture): Path<String>,
) -> Result<Json<CaptureAnswer>, ApiError> {
    app.live.locked().0.images().answer(&capture).map(Json).ok_or_else(unknown)
}

/// Gives up the images of a capture that have not come yet; the rover stops sending them.
#[utoipa::path(
    delete, path = "/rover/images/{capture}", tag = "rover",
    params(("capture" = String, Path, description = "Identity of its command")),
    responses(
        (status = 200, body = CaptureAnswer),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)
    )
)]
async fn let_images_go(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(capture): Path<String>,
) -> Result<Json<CaptureAnswer>, ApiError> {
    let (mut ground, now) = app.live.locked();
    let gone = ground.let_images_go(now, &who, &capture);
    let answer = ground.images().answer(&capture).ok_or_else(unknown)?;
    if gone {
        return Ok(Json(answer));
    }
    Err(ApiError::new("images_ended", "nothing of this capture is on the way"))
}

/// An image, as PNG of 8 bits of gray.
#[utoipa::path(
    get, path = "/rover/images/{capture}/{pair}/{file}", tag = "rover",
    params(
        ("capture" = String, Path, description = "Identity of its command"),
        ("pair" = String, Path, description = "The pair"),
        ("file" = String, Path, description = "`left.png` or `right.png`")
    ),
    responses(
        (status = 200, body = Vec<u8>, content_type = "image/png"),
        (status = 404, body = ErrorBody)
    )
)]
async fn image(
    State(app): State<AppState>,
    Path((capture, pair, file)): Path<(String, String, String)>,
) -> Result<impl IntoResponse, ApiError> {
    let side = match file.as_str() {
        "left.png" => Side::Left,
        "right.png" => Side::Right,
        _ => return Err(unknown()),
    };
    let name = ImageName { capture, pair, side };
    let found = app.live.locked().0.images().image(&name).ok_or_else(unknown)?;
    let headers =
        [(header::CONTENT_TYPE, "image/png"), (header::CACHE_CONTROL, "private, max-age=86400")];
    Ok((headers, found.png.clone()))
}
