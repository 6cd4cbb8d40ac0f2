//! Who may command.

use axum::Json;
use axum::extract::State;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::check::{At, RequestError};
use wire::live::AuthorityReport;
use wire::resources::{AuthorityRequest, ErrorBody, HandOverRequest};

use crate::app::AppState;
use crate::body::{Body, Operator, OptionalBody};
use crate::error::ApiError;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(authority))
        .routes(routes!(acquire))
        .routes(routes!(renew))
        .routes(routes!(release))
        .routes(routes!(request))
        .routes(routes!(hand_over))
}

/// Who may command, and until when.
#[utoipa::path(
    get, path = "/authority", tag = "commands", responses((status = 200, body = AuthorityReport))
)]
async fn authority(State(app): State<AppState>) -> Json<AuthorityReport> {
    let (ground, now) = app.live.locked();
    Json(ground.authority(now))
}

/// Takes the authority to command, or prolongs it; with `take_over` from whoever has it. What
/// another has armed is staged again.
#[utoipa::path(
    post, path = "/authority/acquire", tag = "commands", request_body = AuthorityRequest,
    responses((status = 200, body = AuthorityReport), (status = 409, body = ErrorBody))
)]
async fn acquire(
    State(app): State<AppState>,
    Operator(who): Operator,
    OptionalBody(request): OptionalBody<AuthorityRequest>,
) -> Result<Json<AuthorityReport>, ApiError> {
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.acquire_authority(now, &who, request.take_over)?))
}

/// Prolongs the authority to command; its lease runs out otherwise.
#[utoipa::path(
    post, path = "/authority/renew", tag = "commands",
    responses((status = 200, body = AuthorityReport), (status = 409, body = ErrorBody))
)]
async fn renew(
    State(app): State<AppState>,
    Operator(who): Operator,
) -> Result<Json<AuthorityReport>, ApiError> {
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.renew_authority(now, &who)?))
}

/// Gives the authority to command up.
#[utoipa::path(
    post, path = "/authority/release", tag = "commands",
    responses((status = 200, body = AuthorityReport), (status = 409, body = ErrorBody))
)]
async fn release(
    State(app): State<AppState>,
    Operator(who): Operator,
) -> Result<Json<AuthorityReport>, ApiError> {
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.release_authority(now, &who)?))
}

/// Asks whoever has the authority to command for it: every console shows who asks, for a minute. Where
/// nobody has it, it is taken.
#[utoipa::path(
    post, path = "/authority/request", tag = "commands",
    responses((status = 200, body = AuthorityReport), (status = 409, body = ErrorBody))
)]
async fn request(
    State(app): State<AppState>,
    Operator(who): Operator,
) -> Result<Json<AuthorityReport>, ApiError> {
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.ask_for_authority(now, &who)?))
}

/// Hands the authority to command over to another operator, at once and without a gap. What was armed
/// is staged again.
#[utoipa::path(
    post, path = "/authority/hand-over", tag = "commands", request_body = HandOverRequest,
    responses(
        (status = 200, body = AuthorityReport), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody)
    )
)]
async fn hand_over(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(HandOverRequest { to }): Body<HandOverRequest>,
) -> Result<Json<AuthorityReport>, ApiError> {
    let Some(to) = Operator::named(&to) else {
        let text =
            "takes 1 to 64 printable ASCII characters, as the operator's own requests have them";
        return Err(RequestError::at("out_of_range", &At::root("to"), text).into());
    };
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.hand_over_authority(now, &who, &to)?))
}
