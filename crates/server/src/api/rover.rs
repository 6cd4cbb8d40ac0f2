//! The live rover, its link, its stream and its model.

use axum::Json;
use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::analysis::LiveReachRequest;
use wire::check::At;
use wire::live::{JobReport, LinkConfig, LinkReport, ReachSummary};
use wire::resources::{ErrorBody, EstopAnswer, EstopReleaseRequest, LinkPreset, RoverAnswer};

use crate::app::AppState;
use crate::body::{Body, Operator, OptionalBody, Path};
use crate::error::ApiError;
use crate::live_reach;
use crate::stream;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(rover))
        .routes(routes!(link, put_link))
        .routes(routes!(link_presets))
        .routes(routes!(estop))
        .routes(routes!(estop_release))
        .routes(routes!(urdf))
        .routes(routes!(reach_summary, prefer_reach))
        .routes(routes!(leg_reach))
        .routes(routes!(plan_to_cells))
}

pub fn stream_routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(stream))
}

/// The live rover: its model, its latest state with its age, its stability, its link.
#[utoipa::path(get, path = "/rover", tag = "rover", responses((status = 200, body = RoverAnswer)))]
async fn rover(State(app): State<AppState>) -> Json<RoverAnswer> {
    Json(app.live.answer(app.store.current().info.version.clone()))
}

/// The link: its model and counters.
#[utoipa::path(get, path = "/link", tag = "rover", responses((status = 200, body = LinkReport)))]
async fn link(State(app): State<AppState>) -> Json<LinkReport> {
    Json(app.live.locked().0.link())
}

/// Changes the link for what is transmitted from now on; what is under way keeps its arrival.
#[utoipa::path(
    put, path = "/link", tag = "rover", request_body = LinkConfig,
    responses((status = 200, body = LinkReport), (status = 422, body = ErrorBody))
)]
async fn put_link(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(link): Body<LinkConfig>,
) -> Result<Json<LinkReport>, ApiError> {
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.set_link(now, &who, link)?))
}

/// Links to begin with.
#[utoipa::path(
    get, path = "/link/presets", tag = "rover",
    responses((status = 200, body = Vec<LinkPreset>))
)]
async fn link_presets() -> Json<Vec<LinkPreset>> {
    let preset = |(name, title): (&str, &str)| {
        let config = bridge::link::preset(name)?;
        Some(LinkPreset { name: name.into(), title: title.into(), config })
    };
    Json(bridge::link::PRESETS.into_iter().filter_map(preset).collect())
}

/// Stops the rover. Always taken; passes everything that is under way to the rover.
#[utoipa::path(post, path = "/estop", tag = "rover", responses((status = 200, body = EstopAnswer)))]
async fn estop(
    State(app): State<AppState>,
    operator: Result<Operator, ApiError>,
) -> Json<EstopAnswer> {
    // A bad header must not stand between an operator and the E-stop.
    let who = operator.map_or_else(|_| "operator".into(), |operator| operator.0);
    let (mut ground, now) = app.live.locked();
    Json(ground.estop(now, &who))
}

/// Releases an E-stop in two steps: first without a token, then with the one of the answer.
#[utoipa::path(
    post, path = "/estop/release", tag = "rover", request_body = EstopReleaseRequest,
    responses((status = 200, body = EstopAnswer), (status = 409, body = ErrorBody))
)]
async fn estop_release(
    State(app): State<AppState>,
    Operator(who): Operator,
    OptionalBody(request): OptionalBody<EstopReleaseRequest>,
) -> Result<Json<EstopAnswer>, ApiError> {
    let (mut ground, now) = app.live.locked();
    Ok(Json(ground.estop_release(now, &who, request.token.as_deref())?))
}

/// Where the legs of the live rover can stand, in short: kept up to date in the background.
#[utoipa::path(
    get, path = "/rover/reachability", tag = "rover",
    responses((status = 200, body = ReachSummary))
)]
async fn reach_summary(State(app): State<AppState>) -> Json<ReachSummary> {
    Json(app.reach.summary())
}

/// For which preference it is kept up to date, for everybody.
#[utoipa::path(
    put, path = "/rover/reachability", tag = "rover", request_body = LiveReachRequest,
    responses((status = 200, body = ReachSummary), (status = 422, body = ErrorBody))
)]
async fn prefer_reach(
    State(app): State<AppState>,
    Body(request): Body<LiveReachRequest>,
) -> Result<Json<ReachSummary>, ApiError> {
    app.reach.prefer(request.stability);
    Ok(Json(app.reach.summary()))
}

/// The cells of one leg in binary, as of `POST /analysis/reachability`; the ETag names stance, map
/// and preference. 404 while they are computed.
#[utoipa::path(
    get, path = "/rover/reachability/{leg}", tag = "rover",
    params(("leg" = String, Path, description = "Name of the leg")),
    responses(
        (status = 200, body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 404, body = ErrorBody)
    )
)]
async fn leg_reach(
    State(app): State<AppState>,
    Path(leg): Path<String>,
) -> Result<Response, ApiError> {
    let Some((basis, cells)) = app.reach.cells(&leg) else {
        return Err(live_reach::not_ready(&leg));
    };
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::ETAG, format!("\"{basis}\"")),
        (header::CACHE_CONTROL, "no-cache".to_owned()),
    ];
    Ok((headers, cells.to_binary()).into_response())
}

/// Plans a step to one reachable cell of each 10 cm square (at scale 1) of a leg, as a job: these cells become
/// `plannable` or `not_plannable` one by one and speak for their square; the others stay `reachable`. A
/// change of stance, map or preference cancels it.
#[utoipa::path(
    post, path = "/rover/reachability/{leg}/plans", tag = "rover",
    params(("leg" = String, Path, description = "Name of the leg")),
    responses(
        (status = 202, body = JobReport),
        (status = 404, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn plan_to_cells(
    State(app): State<AppState>,
    Path(leg): Path<String>,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    Ok((StatusCode::ACCEPTED, Json(live_reach::plan_to_cells(&app, &leg)?)))
}

/// The URDF of a robot, at the scale of its folder.
#[utoipa::path(
    get, path = "/robots/{name}/urdf", tag = "rover",
    params(("name" = String, Path, description = "Name of the robot's folder")),
    responses(
        (status = 200, body = String, content_type = "application/xml"),
        (status = 422, body = ErrorBody)
    )
)]
async fn urdf(
    State(app): State<AppState>,
    Path(name): Path<String>,
) -> Result<impl IntoResponse, ApiError> {
    let robots = app.robots.clone();
    let urdf = tokio::task::spawn_blocking(move || robots.urdf(&At::root("name"), &name))
        .await
        .map_err(|error| ApiError::internal("reading the robot", error))??;
    Ok(([(header::CONTENT_TYPE, "application/xml; charset=utf-8")], urdf))
}

/// The channels of the live rover and of replays, as a WebSocket: it takes `StreamRequest` and
/// gives `StreamFrame`.
#[utoipa::path(
    get, path = "/stream", tag = "rover",
    responses(
        (status = 101, description = "WebSocket"),
        (status = 429, body = ErrorBody)
    )
)]
async fn stream(
    State(app): State<AppState>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, ApiError> {
    let upgrade = upgrade.map_err(|error| {
        ApiError::new("query_invalid", format!("this route is a WebSocket: {}", error.body_text()))
    })?;
    let place = app.listeners.clone().try_acquire_owned().map_err(|_| {
        ApiError::new("busy", "as many listeners as are taken hear the stream already")
    })?;
    Ok(upgrade
        .max_message_size(stream::REQUEST_BYTES_MAX)
        .max_frame_size(stream::REQUEST_BYTES_MAX)
        .on_upgrade(move |socket| async move {
            stream::serve(socket, app).await;
            drop(place);
        }))
}
