//! The routes, and the document that describes them.

mod admin;
mod analysis;
mod authority;
mod commands;
mod drape;
mod foxglove;
mod images;
mod jobs;
mod log_notes;
mod logs;
mod map_versions;
mod plans;
mod reconstruction;
mod rover;
mod terrain;
mod uploads;

use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::DefaultBodyLimit;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{NotForContentType, Predicate, SizeAbove};
use tower_http::map_request_body::MapRequestBodyLayer;
use tower_http::timeout::{RequestBodyTimeoutLayer, TimeoutLayer};
use tower_http::trace::TraceLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::app::AppState;
use crate::error::{ApiError, codes_markdown};
use crate::{assets, security};

/// Largest JSON body (bytes), analyses apart.
const BODY_BYTES_MAX: usize = 1 << 20;
/// Largest body of an analysis (bytes): ten thousand states, or an obstacle of many triangles.
const ANALYSIS_BYTES_MAX: usize = 32 << 20;
/// Time to answer anything that is no analysis, no upload and no download.
const ANSWER_TIME: Duration = Duration::from_secs(30);

/// Longest pause within the body of an analysis or an upload.
const BODY_PAUSE: Duration = Duration::from_secs(20);

#[derive(OpenApi)]
#[openapi(
    info(
        title = "FootFall",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0")
    ),
    components(schemas(
        wire::resources::StreamRequest,
        wire::resources::StreamFrame,
        wire::live::RoverTelemetry,
        wire::live::StabilityDerived,
        wire::live::Uplink,
        wire::live::CommandEvent,
        wire::live::LinkReport,
        wire::live::TerrainNotice,
        wire::live::JobReport,
        wire::live::EventNotice,
        wire::live::ReachSummary,
        wire::live::LogGap,
        wire::live::Downlink,
        wire::live::ImageReceived,
        wire::reconstruction::MapRecord,
        wire::live::PlanRecord,
        wire::live::GapReason,
    ))
)]
struct Document;

/// All routes below `/api/v1`, and the document that describes them.
fn described() -> OpenApiRouter<AppState> {
    let short = OpenApiRouter::new()
        .merge(rover::routes())
        .merge(terrain::routes())
        .merge(reconstruction::routes())
        .merge(images::routes())
        .merge(map_versions::routes())
        .merge(drape::routes())
        .merge(plans::routes())
        .merge(commands::routes())
        .merge(authority::routes())
        .merge(logs::routes())
        .merge(log_notes::routes())
        .merge(jobs::routes())
        .merge(admin::routes())
        .routes(routes!(openapi_json))
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .layer(TimeoutLayer::with_status_code(StatusCode::SERVICE_UNAVAILABLE, ANSWER_TIME));
    let long = analysis::routes()
        .layer(DefaultBodyLimit::max(ANALYSIS_BYTES_MAX))
        .merge(uploads::routes())
        .layer(MapRequestBodyLayer::new(Body::new))
        .layer(RequestBodyTimeoutLayer::new(BODY_PAUSE));
    let api = short.merge(long).merge(rover::stream_routes());
    OpenApiRouter::with_openapi(Document::openapi())
        .nest("/api/v1", api)
        .routes(routes!(health))
        .routes(routes!(ready))
        .merge(foxglove::routes())
}

/// The document that describes all routes.
pub fn document() -> utoipa::openapi::OpenApi {
    let mut document = described().into_openapi();
    document.info.version = env!("CARGO_PKG_VERSION").into();
    document.info.description = Some(format!(
        "Ground operations for six-legged wheel-on-leg rovers. SI units and radians, the unit in \
         each field's name; quaternions are [x, y, z, w]; times are RFC 3339 UTC. Who asks is told \
         by the header `X-Operator`. An error is {{\"error\": {{code, message, details}}}} with one \
         of these codes:\n\n{}",
        codes_markdown()
    ));
    document
}

/// The document as text, as it is published.
pub fn document_text() -> String {
    let mut text = document().to_pretty_json().unwrap_or_default();
    text.push('\n');
    text
}

/// The whole server, ready to be served.
pub fn router(app: AppState) -> Router {
    let (routes, _) = described().split_for_parts();
    let compressible = SizeAbove::new(512)
        .and(NotForContentType::const_new("application/x-mcap"))
        .and(NotForContentType::const_new("font/"))
        .and(NotForContentType::IMAGES);
    routes
        .method_not_allowed_fallback(method_not_allowed)
        .fallback(assets::serve)
        .with_state(app)
        .layer(CatchPanicLayer::custom(|_: Box<dyn std::any::Any + Send>| panicked()))
        .layer(CompressionLayer::new().gzip(true).compress_when(compressible))
        .layer(axum::middleware::from_fn(security::guard))
        .layer(TraceLayer::new_for_http())
}

async fn method_not_allowed() -> ApiError {
    ApiError::new("method_not_allowed", "the route does not take this method; see the document")
}

/// A request whose handler panicked.
fn panicked() -> Response {
    ApiError::internal("the request", "its handler panicked").into_response()
}

/// The process runs.
#[utoipa::path(get, path = "/health", tag = "server", responses((status = 200, body = String)))]
async fn health() -> &'static str {
    "ok\n"
}

/// The server takes requests, and telemetry has come.
#[utoipa::path(
    get, path = "/ready", tag = "server",
    responses((status = 200, body = String), (status = 409, body = wire::resources::ErrorBody))
)]
async fn ready(
    axum::extract::State(app): axum::extract::State<AppState>,
) -> Result<&'static str, ApiError> {
    app.live.latest().map(|_| "ready\n")
}

/// This document.
#[utoipa::path(
    get, path = "/openapi.json", tag = "server",
    responses((status = 200, body = Object, content_type = "application/json"))
)]
async fn openapi_json() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], document_text())
}
