//! Plans of the live rover.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::analysis::{PlanAnswer, PlanRequest, PostureAnswer, PosturePlanRequest, PostureRequest};
use wire::live::{JobReport, PlanCommandRef, PlanRecord, channel};
use wire::resources::ErrorBody;

use crate::analyses::{self, OnProgress};
use crate::app::AppState;
use crate::body::{Body, Path};
use crate::error::ApiError;
use crate::plans::{self, Asked, StoredPlan, When};
use crate::reconstruction::contact;
use crate::scene::Context;
use crate::staging;
use crate::stop::Stop;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(start))
        .routes(routes!(plan))
        .routes(routes!(start_posture))
        .routes(routes!(kept_posture))
        .routes(routes!(plan_posture))
}

/// Plans a step of the live rover. The job's result is the path of the plan, whatever its outcome.
#[utoipa::path(
    post, path = "/plans", tag = "plans", operation_id = "start_plan",
    request_body = PlanRequest,
    responses(
        (status = 202, body = JobReport),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn start(
    State(app): State<AppState>,
    Body(request): Body<PlanRequest>,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    if request.scene.state.is_none() {
        app.live.configuration()?;
    }
    let deadline_s = request.deadline_s;
    let kept = app.clone();
    let work = move |context: &Context, stop: &Stop, progress: OnProgress<'_>| {
        let mut request = request;
        if request.scene.state.is_none() {
            request.scene.state = Some(kept.live.latest()?.frame.state);
        }
        let mut planned = analyses::plan(context, &request, stop, progress)?;
        let id = uuid::Uuid::now_v7().to_string();
        planned.answer.id = Some(id.clone());
        let (answer, start) = (planned.answer, planned.start);
        let cancelled = answer.outcome == "cancelled";
        if !cancelled {
            let record = PlanRecord { request: complete(&kept, request), answer: answer.clone() };
            let (mut ground, now) = kept.live.locked();
            ground.publish(now, channel::PLAN, &record);
        }
        kept.plans.put(&id, StoredPlan { answer, start });
        if cancelled {
            return Err(ApiError::new("cancelled", "the plan was cancelled"));
        }
        Ok(format!("/api/v1/plans/{id}"))
    };
    in_background(&app, "plan", deadline_s, work)
}

/// The request with what else it left to the live rover, but for the map, which the answer names: so
/// that the log's record of it says what was asked.
fn complete(app: &AppState, mut request: PlanRequest) -> PlanRequest {
    let (scene, live) = (&mut request.scene, &app.live);
    if scene.robot.is_none() && scene.scale.is_none() && scene.payloads.is_none() {
        scene.robot = Some(live.robot().name().into());
        scene.scale = Some(live.robot().scale());
        scene.payloads = Some(live.payloads().to_vec());
    }
    scene.gravity_m_s2 = scene.gravity_m_s2.or(Some(live.gravity()));
    request
}

/// Begins a job behind the gate; `work` gives the path of its result.
fn in_background(
    app: &AppState,
    kind: &str,
    deadline_s: Option<f64>,
    work: impl FnOnce(&Context, &Stop, OnProgress<'_>) -> Result<String, ApiError> + Send + 'static,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    let job = app.jobs.begin(kind, Stop::after(deadline_s)?)?;
    let report = app.jobs.get(job.id())?;
    let app = app.clone();
    tokio::spawn(async move {
        let permit = match app.gate.enter().await {
            Ok(permit) => permit,
            Err(error) => return job.end(Err(error)),
        };
        contact::settled(&app).await;
        // A job that ends by a fault says so by itself.
        let work = move || {
            let _place = permit;
            // The state is that of the moment in which the work begins.
            let (context, stop) = (app.context(), job.stop().clone());
            let outcome = work(&context, &stop, &|share, doing| job.progress(share, doing));
            job.end(outcome);
        };
        if let Err(error) = tokio::task::spawn_blocking(work).await {
            tracing::error!("a job ended by a fault: {error}");
        }
    });
    Ok((StatusCode::ACCEPTED, Json(report)))
}

/// A plan.
#[utoipa::path(
    get, path = "/plans/{id}", tag = "plans", operation_id = "kept_plan",
    params(("id" = String, Path, description = "The plan")),
    responses((status = 200, body = PlanAnswer), (status = 404, body = ErrorBody))
)]
async fn plan(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<PlanAnswer>, ApiError> {
    Ok(Json(app.plans.get(&id)?.answer.clone()))
}

/// Asks the posture adviser about the live rover, as `POST /analysis/posture`, and keeps the answer.
/// The job's result is its path.
#[utoipa::path(
    post, path = "/rover/posture", tag = "plans", operation_id = "start_posture",
    request_body = PostureRequest,
    responses(
        (status = 202, body = JobReport),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn start_posture(
    State(app): State<AppState>,
    Body(request): Body<PostureRequest>,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    if request.scene.state.is_none() {
        app.live.configuration()?;
    }
    let deadline_s = request.deadline_s;
    let kept = app.clone();
    let work = move |context: &Context, stop: &Stop, progress: OnProgress<'_>| {
        let mut answer = analyses::posture(context, &request, stop, progress)?;
        let id = uuid::Uuid::now_v7().to_string();
        answer.id = Some(id.clone());
        kept.postures.put(&id, answer);
        Ok(format!("/api/v1/rover/posture/{id}"))
    };
    in_background(&app, "posture", deadline_s, work)
}

/// An answer of the posture adviser.
#[utoipa::path(
    get, path = "/rover/posture/{id}", tag = "plans", operation_id = "kept_posture",
    params(("id" = String, Path, description = "The answer")),
    responses((status = 200, body = PostureAnswer), (status = 404, body = ErrorBody))
)]
async fn kept_posture(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<PostureAnswer>, ApiError> {
    Ok(Json(app.postures.get(&id)?.as_ref().clone()))
}

/// Takes up a posture that the adviser offered, or a way back that was rehearsed: it becomes a plan, to be looked at, staged, armed
/// and sent like any other. Refused where the rover, its model or the map is not what the answer
/// rests on.
#[utoipa::path(
    post, path = "/rover/posture/{id}/plans", tag = "plans", operation_id = "plan_posture",
    params(("id" = String, Path, description = "The answer")),
    request_body = PosturePlanRequest,
    responses(
        (status = 201, body = PlanAnswer), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn plan_posture(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Body(request): Body<PosturePlanRequest>,
) -> Result<(StatusCode, Json<PlanAnswer>), ApiError> {
    let asked = Asked::new(request)?;
    let answer = app.postures.get(&id)?;
    let plan_id = uuid::Uuid::now_v7().to_string();
    let plan = plans::of_posture(app.live.robot(), &plan_id, &answer, &asked)?;
    let first = PlanCommandRef { plan_id: plan_id.clone(), index: 0, retreat: false };
    if let Some(why) = staging::stale(&app, &plan, &first, When::Release)? {
        let message = format!("the posture no longer fits: {why}; ask the adviser anew");
        return Err(ApiError::new("basis_changed", message));
    }
    let shown = plan.answer.clone();
    app.plans.put(&plan_id, plan);
    Ok((StatusCode::CREATED, Json(shown)))
}
