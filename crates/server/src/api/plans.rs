//! Plans of the live rover.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::analysis::{PlanAnswer, PlanRequest};
use wire::live::JobReport;
use wire::resources::ErrorBody;

use crate::analyses;
use crate::app::AppState;
use crate::body::{Body, Path};
use crate::error::ApiError;
use crate::plans::StoredPlan;
use crate::stop::Stop;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(start)).routes(routes!(plan))
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
    let job = app.jobs.begin("plan", Stop::after(request.deadline_s)?)?;
    let report = app.jobs.get(job.id())?;
    let stop = job.stop().clone();
    let plan_id = uuid::Uuid::now_v7().to_string();
    let work_app = app.clone();
    tokio::spawn(async move {
        let permit = match work_app.gate.enter().await {
            Ok(permit) => permit,
            Err(error) => return job.end(Err(error)),
        };
        // The state is that of the moment in which planning begins.
        let context = work_app.context();
        let job = Arc::new(job);
        let told = job.clone();
        let planned = tokio::task::spawn_blocking(move || {
            let _place = permit;
            analyses::plan(&context, &request, &stop, &|share, doing| told.progress(share, doing))
        })
        .await;
        let outcome = match planned {
            Ok(Ok(mut planned)) => {
                planned.answer.id = Some(plan_id.clone());
                let (answer, start) = (planned.answer, planned.start);
                let cancelled = answer.outcome == "cancelled";
                work_app.plans.put(&plan_id, StoredPlan { answer, start });
                if cancelled {
                    Err(ApiError::new("cancelled", "the plan was cancelled"))
                } else {
                    Ok(format!("/api/v1/plans/{plan_id}"))
                }
            }
            Ok(Err(error)) => Err(error.into()),
            Err(error) => Err(ApiError::internal("planning", error)),
        };
        if let Ok(job) = Arc::try_unwrap(job) {
            job.end(outcome);
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
