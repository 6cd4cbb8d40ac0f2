//! The life of a command: staged, armed, sent; or taken back.

use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use bridge::commands::CommandError;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::check::{At, RequestError};
use wire::dry_run::DryRun;
use wire::live::{CommandRecord, CommandState};
use wire::resources::{ApproveRequest, CommandList, ErrorBody, ResolveRequest, StageRequest};

use crate::app::AppState;
use crate::body::{Body, Operator, Path};
use crate::error::ApiError;
use crate::plans::When;
use crate::staging;

/// Time between two frames of telemetry, and how many are waited for before a plan counts as stale.
const FRAME: Duration = Duration::from_millis(100);
const FRAMES_WAITED: usize = 4;
/// Longest reason (characters).
const WHY_MAX: usize = 500;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(commands, stage))
        .routes(routes!(checks))
        .routes(routes!(command))
        .routes(routes!(arm))
        .routes(routes!(send))
        .routes(routes!(cancel))
        .routes(routes!(approve))
        .routes(routes!(resolve))
}

/// The commands of this session, newest last.
#[utoipa::path(
    get, path = "/commands", tag = "commands", responses((status = 200, body = CommandList))
)]
async fn commands(State(app): State<AppState>) -> Json<CommandList> {
    let (ground, _) = app.live.locked();
    Json(CommandList { commands: ground.commands().records().cloned().collect() })
}

/// Stages a command of a plan, or one by hand; with `dry_run` only checks it. The same id again
/// with the same content gives the command as it is.
#[utoipa::path(
    post, path = "/commands", tag = "commands", request_body = StageRequest,
    responses(
        (status = 201, body = CommandRecord), (status = 200, body = CommandRecord),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody), (status = 503, body = ErrorBody)
    )
)]
async fn stage(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(request): Body<StageRequest>,
) -> Result<(StatusCode, Json<CommandRecord>), ApiError> {
    let command = staging::command(&app, &who, &request)?;
    if request.dry_run {
        let in_the_way = {
            let (ground, now) = app.live.locked();
            ground.rehearse(now, &command, &who)
        };
        // What follows in its plan cannot be armed yet, and is staged all the same.
        let waits =
            |e: &CommandError| matches!(e.code(), "order" | "plan_under_way" | "other_armed");
        if let Some(error) = in_the_way.into_iter().find(|error| !waits(error)) {
            return Err(error.into());
        }
        let record = CommandRecord {
            id: command.id.unwrap_or_else(|| uuid::Uuid::now_v7().to_string()),
            body: command.body,
            title: command.title,
            plan: command.plan,
            state: CommandState::Staged,
            operator: command.operator,
            staged: app.clock.now(),
            armed_until: None,
            sent: None,
            arrives: None,
            earliest_ack: None,
            overdue_after: None,
            duration_s: command.duration_s,
            progress: 0.0,
            why: Some("dry run: nothing was staged".into()),
            verification: Vec::new(),
            approval: None,
            epoch: None,
            preconditions: command.preconditions,
            step: None,
        };
        return Ok((StatusCode::OK, Json(record)));
    }
    let logged = {
        let (mut ground, now) = app.live.locked();
        ground.stage(now, command)?
    };
    Ok((StatusCode::CREATED, Json(logged.written().await?)))
}

/// A dry run, check by check: everything that staging, arming, sending and the rover's own beginning
/// would look at, whether it passes or not. Nothing is staged. Refused is only what is no request.
#[utoipa::path(
    post, path = "/commands/checks", tag = "commands", request_body = StageRequest,
    responses((status = 200, body = DryRun), (status = 409, body = ErrorBody))
)]
async fn checks(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(request): Body<StageRequest>,
) -> Result<Json<DryRun>, ApiError> {
    Ok(Json(staging::dry_run(&app, &who, &request)?))
}

/// A command.
#[utoipa::path(
    get, path = "/commands/{id}", tag = "commands",
    params(("id" = String, Path, description = "The command")),
    responses((status = 200, body = CommandRecord), (status = 404, body = ErrorBody))
)]
async fn command(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<CommandRecord>, ApiError> {
    find(&app, &id).map(Json)
}

fn find(app: &AppState, id: &str) -> Result<CommandRecord, ApiError> {
    let (ground, _) = app.live.locked();
    ground.commands().get(id).cloned().ok_or_else(|| {
        ApiError::new("command_unknown", "there is no such command; GET /commands lists them")
    })
}

/// Ends a command whose plan no longer holds, and says so.
async fn check_basis(app: &AppState, id: &str) -> Result<(), ApiError> {
    let record = find(app, id)?;
    let Some(plan) = &record.plan else { return Ok(()) };
    if !matches!(record.state, CommandState::Staged | CommandState::Armed) {
        // The command book knows better what to say.
        return Ok(());
    }
    let mut outcome = staging::check_basis(app, plan, When::Release);
    // The word that the command before is done may come a frame earlier than the state it left.
    for _ in 0..FRAMES_WAITED {
        if outcome.is_ok() {
            return Ok(());
        }
        tokio::time::sleep(FRAME).await;
        outcome = staging::check_basis(app, plan, When::Release);
    }
    let Err(error) = outcome else { return Ok(()) };
    // A later command of a plan waits for the one before it: that is no reason to end it.
    if error.0.code != "basis_changed" || !is_next(app, id) {
        return if error.0.code == "basis_changed" { Ok(()) } else { Err(error) };
    }
    let expired = {
        let (mut ground, now) = app.live.locked();
        ground.expire(now, id, &error.0.message)
    };
    if let Ok(logged) = expired {
        logged.written().await?;
    }
    Err(error)
}

fn is_next(app: &AppState, id: &str) -> bool {
    let (ground, _) = app.live.locked();
    ground.commands().is_next(id)
}

/// Arms a staged command: it may be sent for a limited time. Its plan must still hold.
#[utoipa::path(
    post, path = "/commands/{id}/arm", tag = "commands",
    params(("id" = String, Path, description = "The command")),
    responses(
        (status = 200, body = CommandRecord),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)
    )
)]
async fn arm(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(id): Path<String>,
) -> Result<Json<CommandRecord>, ApiError> {
    check_basis(&app, &id).await?;
    let logged = {
        let (mut ground, now) = app.live.locked();
        ground.arm(now, &id, &who)?
    };
    Ok(Json(logged.written().await?))
}

/// Sends an armed command to the rover. It is in the flight log before it is on the link.
#[utoipa::path(
    post, path = "/commands/{id}/send", tag = "commands",
    params(("id" = String, Path, description = "The command")),
    responses(
        (status = 200, body = CommandRecord),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody),
        (status = 503, body = ErrorBody)
    )
)]
async fn send(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(id): Path<String>,
) -> Result<Json<CommandRecord>, ApiError> {
    check_basis(&app, &id).await?;
    let release = {
        let (mut ground, now) = app.live.locked();
        ground.send(now, &id, &who)?
    };
    Ok(Json(release.wait().await?))
}

/// Takes back a command that was not sent.
#[utoipa::path(
    post, path = "/commands/{id}/cancel", tag = "commands",
    params(("id" = String, Path, description = "The command")),
    responses(
        (status = 200, body = CommandRecord),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)
    )
)]
async fn cancel(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(id): Path<String>,
) -> Result<Json<CommandRecord>, ApiError> {
    let logged = {
        let (mut ground, now) = app.live.locked();
        ground.cancel(now, &id, &who)?
    };
    Ok(Json(logged.written().await?))
}

/// Approves a staged command that takes two persons: by another than its author, for ten minutes.
#[utoipa::path(
    post, path = "/commands/{id}/approve", tag = "commands", request_body = ApproveRequest,
    params(("id" = String, Path, description = "The command")),
    responses(
        (status = 200, body = CommandRecord),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)
    )
)]
async fn approve(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(id): Path<String>,
    Body(request): Body<ApproveRequest>,
) -> Result<Json<CommandRecord>, ApiError> {
    check_basis(&app, &id).await?;
    let logged = {
        let (mut ground, now) = app.live.locked();
        ground.approve(now, &id, &who, &request.content_hash)?
    };
    Ok(Json(logged.written().await?))
}

/// Ends a command whose outcome is unknown, by what telemetry shows. It is never sent again.
#[utoipa::path(
    post, path = "/commands/{id}/resolve", tag = "commands", request_body = ResolveRequest,
    params(("id" = String, Path, description = "The command")),
    responses(
        (status = 200, body = CommandRecord),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody)
    )
)]
async fn resolve(
    State(app): State<AppState>,
    Operator(who): Operator,
    Path(id): Path<String>,
    Body(request): Body<ResolveRequest>,
) -> Result<Json<CommandRecord>, ApiError> {
    let n = request.why.chars().count();
    if !(1..=WHY_MAX).contains(&n) {
        let text = format!("has {n} characters; say in 1 to {WHY_MAX} what shows the outcome");
        return Err(RequestError::at("out_of_range", &At::root("why"), text).into());
    }
    let logged = {
        let (mut ground, now) = app.live.locked();
        ground.resolve(now, &id, &who, request.done, &request.why)?
    };
    Ok(Json(logged.written().await?))
}
