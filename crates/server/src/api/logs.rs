//! Flight logs, and replays of them.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use bridge::catalog;
use bridge::reader::Limits;
use bridge::replay::{RATES, Replay, ReplayError};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::resources::{ErrorBody, LogInfo, LogList, ReplayChange, ReplayRequest, ReplayState};

use crate::app::AppState;
use crate::body::{Body, Path};
use crate::error::ApiError;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(logs))
        .routes(routes!(log))
        .routes(routes!(replays, start_replay))
        .routes(routes!(replay, change_replay, end_replay))
}

/// The flight logs, newest first.
#[utoipa::path(get, path = "/logs", tag = "logs", responses((status = 200, body = LogList)))]
async fn logs(State(app): State<AppState>) -> Result<Json<LogList>, ApiError> {
    let open = app.live.locked().0.recorder_status().log;
    let folder = app.config.server.logs_dir.clone();
    let list = tokio::task::spawn_blocking(move || catalog::list_logs(&folder, Some(&open)))
        .await
        .map_err(|error| ApiError::internal("listing the logs", error))?
        .map_err(|error| ApiError::internal("listing the logs", error))?;
    Ok(Json(LogList { logs: list }))
}

/// One flight log.
#[utoipa::path(
    get, path = "/logs/{id}", tag = "logs",
    params(("id" = String, Path, description = "The log")),
    responses((status = 200, body = LogInfo), (status = 404, body = ErrorBody))
)]
async fn log(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<LogInfo>, ApiError> {
    let open = app.live.locked().0.recorder_status().log;
    if open.id == id {
        return Ok(Json(open));
    }
    let folder = app.config.server.logs_dir.clone();
    let info = tokio::task::spawn_blocking(move || catalog::log_info(&folder, &id))
        .await
        .map_err(|error| ApiError::internal("reading the log", error))??;
    Ok(Json(info))
}

/// The replays held.
#[utoipa::path(
    get, path = "/replays", tag = "logs", responses((status = 200, body = Vec<ReplayState>))
)]
async fn replays(State(app): State<AppState>) -> Json<Vec<ReplayState>> {
    Json(app.replays.list())
}

/// Plays a log. Subscribe to the replay's id on the stream to hear it.
#[utoipa::path(
    post, path = "/replays", tag = "logs", request_body = ReplayRequest,
    responses(
        (status = 201, body = ReplayState),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn start_replay(
    State(app): State<AppState>,
    Body(request): Body<ReplayRequest>,
) -> Result<(StatusCode, Json<ReplayState>), ApiError> {
    app.replays.room()?;
    let ReplayRequest { log, from, rate } = request;
    // Known before a large log is read.
    if !RATES.contains(&rate) {
        return Err(ReplayError::BadRate { rate }.into());
    }
    let folder = app.config.server.logs_dir.clone();
    let name = log.clone();
    let read = move || catalog::open_log(&folder, &name, Limits::default());
    let content = tokio::task::spawn_blocking(read)
        .await
        .map_err(|error| ApiError::internal("reading the log", error))??;
    let id = uuid::Uuid::now_v7().to_string();
    let clock = app.clock.clone();
    let replay = Replay::open(clock.now(), &id, &log, content, from, rate)?;
    Ok((StatusCode::CREATED, Json(app.replays.start(&id, replay, clock)?)))
}

/// A replay.
#[utoipa::path(
    get, path = "/replays/{id}", tag = "logs",
    params(("id" = String, Path, description = "The replay")),
    responses((status = 200, body = ReplayState), (status = 404, body = ErrorBody))
)]
async fn replay(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<ReplayState>, ApiError> {
    Ok(Json(app.replays.get(&id)?.state()))
}

/// Goes to another place, changes the speed, holds or goes on. A change of place gives the state
/// there to all listeners.
#[utoipa::path(
    patch, path = "/replays/{id}", tag = "logs", request_body = ReplayChange,
    params(("id" = String, Path, description = "The replay")),
    responses(
        (status = 200, body = ReplayState),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn change_replay(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Body(change): Body<ReplayChange>,
) -> Result<Json<ReplayState>, ApiError> {
    Ok(Json(app.replays.get(&id)?.change(&change)?))
}

/// Ends a replay.
#[utoipa::path(
    delete, path = "/replays/{id}", tag = "logs",
    params(("id" = String, Path, description = "The replay")),
    responses((status = 204), (status = 404, body = ErrorBody))
)]
async fn end_replay(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<StatusCode, ApiError> {
    app.replays.end(&id).map(|()| StatusCode::NO_CONTENT)
}
