//! Flight logs, and replays of them.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use bridge::catalog;
use bridge::replay::{RATES, ReplayError};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::live::JobReport;
use wire::resources::{
    ErrorBody, LogInfo, LogList, ReplayChange, ReplayMargins, ReplayRequest, ReplayState,
};

use crate::app::AppState;
use crate::body::{Body, Path};
use crate::error::ApiError;
use crate::replays::Opening;
use crate::stop::Stop;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(logs))
        .routes(routes!(log))
        .routes(routes!(replays, start_replay))
        .routes(routes!(replay, change_replay, end_replay))
        .routes(routes!(replay_margins))
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

/// Longest time for reading a log (s).
const OPEN_DEADLINE_S: f64 = 600.0;

/// Plays a log. Subscribe to the replay's id on the stream to hear it. A log is read whole first:
/// with `Prefer: respond-async` (RFC 7240) that is a job, whose result is the path of the replay.
#[utoipa::path(
    post, path = "/replays", tag = "logs", request_body = ReplayRequest,
    params(("Prefer" = Option<String>, Header, description = "`respond-async`: answer with a job")),
    responses(
        (status = 201, body = ReplayState), (status = 202, body = JobReport),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn start_replay(
    State(app): State<AppState>,
    headers: HeaderMap,
    Body(request): Body<ReplayRequest>,
) -> Result<Response, ApiError> {
    app.replays.room()?;
    // Known before a large log is read.
    if !RATES.contains(&request.rate) {
        return Err(ReplayError::BadRate { rate: request.rate }.into());
    }
    let folder = app.config.server.logs_dir.clone();
    catalog::log_files(&folder, &request.log)?;
    let id = uuid::Uuid::now_v7().to_string();
    let opening = Opening { folder, request, id };
    let stop = Stop::after(Some(OPEN_DEADLINE_S))?;
    if responds_async(&headers) {
        let job = app.jobs.begin("replay", stop)?;
        let report = app.jobs.get(job.id())?;
        let app = app.clone();
        tokio::task::spawn_blocking(move || {
            let stop = job.stop().clone();
            let told = |share: f64, doing: &str| job.progress(share, doing);
            told(0.0, "reads the log");
            let opened = opening.open(&*app.clock, &stop, &told).and_then(|replay| {
                app.replays.start(&opening.id, replay, app.clock.clone())?;
                Ok(format!("/api/v1/replays/{}", opening.id))
            });
            job.end(opened);
        });
        return Ok((StatusCode::ACCEPTED, Json(report)).into_response());
    }
    // Whoever goes away ends the reading.
    let guard = stop.guard();
    let clock = app.clock.clone();
    let read = move || {
        let replay = opening.open(&*clock, &stop, &|_, _| {});
        (opening.id, replay)
    };
    let (id, replay) = tokio::task::spawn_blocking(read)
        .await
        .map_err(|error| ApiError::internal("reading the log", error))?;
    drop(guard);
    let state = app.replays.start(&id, replay?, app.clock.clone())?;
    Ok((StatusCode::CREATED, Json(state)).into_response())
}

fn responds_async(headers: &HeaderMap) -> bool {
    let all = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
    let mut wishes = all.flat_map(|text| text.split(','));
    wishes.any(|wish| wish.trim().eq_ignore_ascii_case("respond-async"))
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

/// How the margins went before the place of a replay: the least of each half second of the last five minutes.
#[utoipa::path(
    get, path = "/replays/{id}/margins", tag = "logs",
    params(("id" = String, Path, description = "The replay")),
    responses((status = 200, body = ReplayMargins), (status = 404, body = ErrorBody))
)]
async fn replay_margins(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<ReplayMargins>, ApiError> {
    let player = app.replays.get(&id)?;
    let stop = Stop::after(Some(OPEN_DEADLINE_S))?;
    // Whoever goes away ends the reading.
    let guard = stop.guard();
    let answer = tokio::task::spawn_blocking(move || player.margins(&stop))
        .await
        .map_err(|error| ApiError::internal("reading the log", error))??;
    drop(guard);
    Ok(Json(answer))
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
