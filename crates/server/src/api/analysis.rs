//! The stateless analyses over HTTP. What is left out of a request is the live rover's.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::analysis::{
    CellExplanation, CellExplanationRequest, InverseKinematicsAnswer, InverseKinematicsRequest,
    KinematicsAnswer, KinematicsRequest, PlanAnswer, PlanRequest, PostureAnswer, PostureRequest,
    ReachabilityAnswer, ReachabilityRequest, StabilityAnswer, StabilityRequest,
    TraversabilityAnswer, TraversabilityRequest,
};
use wire::check::RequestError;
use wire::resources::ErrorBody;

use crate::analyses;
use crate::app::AppState;
use crate::body::Body;
use crate::error::ApiError;
use crate::reconstruction::contact;
use crate::scene::Context;
use crate::stop::Stop;

/// Threads of one reachability request: the gate lets as many analyses in as there is room for.
const REACH_WORKERS: usize = 2;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(kinematics))
        .routes(routes!(inverse_kinematics))
        .routes(routes!(stability))
        .routes(routes!(reachability))
        .routes(routes!(reachability_cell))
        .routes(routes!(traversability))
        .routes(routes!(plan))
        .routes(routes!(posture))
}

/// Computes behind the gate, with the live rover as context.
async fn compute<T: Send + 'static>(
    app: &AppState,
    deadline_s: Option<f64>,
    work: impl FnOnce(&Context, &Stop) -> Result<T, RequestError> + Send + 'static,
) -> Result<T, ApiError> {
    let stop = Stop::after(deadline_s)?;
    contact::settled(app).await;
    let context = app.context();
    let inner = stop.clone();
    Ok(app.gate.run(&stop, move || work(&context, &inner)).await??)
}

fn wants_binary(headers: &HeaderMap) -> bool {
    let accept = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok());
    accept.is_some_and(|accept| accept.contains("application/octet-stream"))
}

fn binary(bytes: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response()
}

/// Where everything is in each state: center of mass, wheels, links, what touches what, torques.
#[utoipa::path(
    post, path = "/analysis/kinematics", tag = "analysis", request_body = KinematicsRequest,
    responses((status = 200, body = KinematicsAnswer), (status = 422, body = ErrorBody))
)]
async fn kinematics(
    State(app): State<AppState>,
    Body(request): Body<KinematicsRequest>,
) -> Result<Json<KinematicsAnswer>, ApiError> {
    let deadline_s = request.deadline_s;
    let work = move |context: &Context, stop: &Stop| analyses::kinematics(context, &request, stop);
    compute(&app, deadline_s, work).await.map(Json)
}

/// All branches of a leg for each wheel pose, or why there is none.
#[utoipa::path(
    post, path = "/analysis/inverse-kinematics", tag = "analysis",
    request_body = InverseKinematicsRequest,
    responses((status = 200, body = InverseKinematicsAnswer), (status = 422, body = ErrorBody))
)]
async fn inverse_kinematics(
    State(app): State<AppState>,
    Body(request): Body<InverseKinematicsRequest>,
) -> Result<Json<InverseKinematicsAnswer>, ApiError> {
    let deadline_s = request.deadline_s;
    let work =
        move |context: &Context, stop: &Stop| analyses::inverse_kinematics(context, &request, stop);
    compute(&app, deadline_s, work).await.map(Json)
}

/// Support polygons, margins and loads of stances given by their contacts.
#[utoipa::path(
    post, path = "/analysis/stability", tag = "analysis", request_body = StabilityRequest,
    responses((status = 200, body = StabilityAnswer), (status = 422, body = ErrorBody))
)]
async fn stability(
    State(app): State<AppState>,
    Body(request): Body<StabilityRequest>,
) -> Result<Json<StabilityAnswer>, ApiError> {
    let deadline_s = request.deadline_s;
    let work = move |context: &Context, stop: &Stop| analyses::stability(context, &request, stop);
    compute(&app, deadline_s, work).await.map(Json)
}

/// Where legs can stand, and why not elsewhere. With `Accept: application/octet-stream` the grids
/// in binary, one after the other in the order of the legs.
#[utoipa::path(
    post, path = "/analysis/reachability", tag = "analysis", request_body = ReachabilityRequest,
    responses(
        (status = 200, content(
            (ReachabilityAnswer = "application/json"), (Vec<u8> = "application/octet-stream"),
        )),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody),
        (status = 504, body = ErrorBody)
    )
)]
async fn reachability(
    State(app): State<AppState>,
    headers: HeaderMap,
    Body(request): Body<ReachabilityRequest>,
) -> Result<Response, ApiError> {
    let deadline_s = request.deadline_s;
    let work = move |context: &Context, stop: &Stop| {
        analyses::reachability(context, &request, REACH_WORKERS, stop)
    };
    let reached = compute(&app, deadline_s, work).await?;
    if wants_binary(&headers) {
        return Ok(binary(reached.iter().flat_map(|(_, cells)| cells.to_binary()).collect()));
    }
    Ok(Json(analyses::reachability_answer(&reached)).into_response())
}

/// Why a leg can not stand at a place, and what would help: each mend has been tried.
#[utoipa::path(
    post, path = "/analysis/reachability/cell", tag = "analysis",
    request_body = CellExplanationRequest,
    responses((status = 200, body = CellExplanation), (status = 422, body = ErrorBody))
)]
async fn reachability_cell(
    State(app): State<AppState>,
    Body(request): Body<CellExplanationRequest>,
) -> Result<Json<CellExplanation>, ApiError> {
    let deadline_s = request.deadline_s;
    let work = move |context: &Context, _: &Stop| analyses::explain_cell(context, &request);
    compute(&app, deadline_s, work).await.map(Json)
}

/// Where a foot can stand on a ground. With `Accept: application/octet-stream` six planes of f32.
#[utoipa::path(
    post, path = "/analysis/traversability", tag = "analysis",
    request_body = TraversabilityRequest,
    responses(
        (status = 200, content(
            (TraversabilityAnswer = "application/json"), (Vec<u8> = "application/octet-stream"),
        )),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn traversability(
    State(app): State<AppState>,
    headers: HeaderMap,
    Body(request): Body<TraversabilityRequest>,
) -> Result<Response, ApiError> {
    let (deadline_s, in_binary) = (request.deadline_s, wants_binary(&headers));
    let work = move |context: &Context, stop: &Stop| {
        let judged = analyses::traversability(context, &request, stop)?;
        Ok(if in_binary { Err(judged.to_binary()?) } else { Ok(judged.to_answer()?) })
    };
    Ok(match compute(&app, deadline_s, work).await? {
        Ok(answer) => Json(answer).into_response(),
        Err(bytes) => binary(bytes),
    })
}

/// One planned step, answered at once; `POST /plans` keeps it for sending.
#[utoipa::path(
    post, path = "/analysis/plan", tag = "analysis", request_body = PlanRequest,
    responses(
        (status = 200, body = PlanAnswer),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn plan(
    State(app): State<AppState>,
    Body(request): Body<PlanRequest>,
) -> Result<Json<PlanAnswer>, ApiError> {
    let deadline_s = request.deadline_s;
    let work = move |context: &Context, stop: &Stop| {
        analyses::plan(context, &request, stop, &|_, _| {}).map(|planned| planned.answer)
    };
    compute(&app, deadline_s, work).await.map(Json)
}

/// The cheapest change of posture that gives a wanted margin before a leg is lifted, and what is left if a
/// leg fails or a foot settles now, with the way back.
#[utoipa::path(
    post, path = "/analysis/posture", tag = "analysis", request_body = PostureRequest,
    responses(
        (status = 200, body = PostureAnswer),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody),
        (status = 504, body = ErrorBody)
    )
)]
async fn posture(
    State(app): State<AppState>,
    Body(request): Body<PostureRequest>,
) -> Result<Json<PostureAnswer>, ApiError> {
    let deadline_s = request.deadline_s;
    let work = move |context: &Context, stop: &Stop| {
        analyses::posture(context, &request, stop, &|_, _| {})
    };
    compute(&app, deadline_s, work).await.map(Json)
}
