//! Long work: asked for, watched, cancelled.

use axum::Json;
use axum::extract::State;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::live::JobReport;
use wire::resources::ErrorBody;

use crate::app::AppState;
use crate::body::Path;
use crate::error::ApiError;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(jobs)).routes(routes!(job, cancel))
}

/// All jobs that are remembered, oldest first.
#[utoipa::path(get, path = "/jobs", tag = "jobs", responses((status = 200, body = Vec<JobReport>)))]
async fn jobs(State(app): State<AppState>) -> Json<Vec<JobReport>> {
    Json(app.jobs.list())
}

/// A job: its state, how far it is, what it is doing, where its result is.
#[utoipa::path(
    get, path = "/jobs/{id}", tag = "jobs",
    params(("id" = String, Path, description = "The job")),
    responses((status = 200, body = JobReport), (status = 404, body = ErrorBody))
)]
async fn job(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<JobReport>, ApiError> {
    app.jobs.get(&id).map(Json)
}

/// Asks a job to end; it does so within moments.
#[utoipa::path(
    delete, path = "/jobs/{id}", tag = "jobs", operation_id = "cancel_job",
    params(("id" = String, Path, description = "The job")),
    responses(
        (status = 200, body = JobReport),
        (status = 404, body = ErrorBody), (status = 409, body = ErrorBody)
    )
)]
async fn cancel(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<JobReport>, ApiError> {
    app.jobs.cancel(&id).map(Json)
}
