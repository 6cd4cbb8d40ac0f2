//! Managing the server while it runs: adapter, queues, messages (F17). For programs of this machine only.

use axum::Json;
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::admin::{
    AdapterKind, AdapterReport, AdminReport, LogFilter, QueueReport, RecorderReport,
};
use wire::check::{At, RequestError};
use wire::live::{CarrierReport, EventLevel, JobState};
use wire::resources::ErrorBody;

use crate::app::AppState;
use crate::body::{Body, Operator};
use crate::error::ApiError;
use crate::log_level::{self, FilterError};
use crate::serve::connections::Peer;

/// Headers that tell of a way through another program, which may have come from anywhere.
const FORWARDED: [&str; 4] = ["forwarded", "x-forwarded-for", "x-real-ip", "via"];

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(report))
        .routes(routes!(log_level))
        .routes(routes!(reconnect))
        .layer(axum::middleware::from_fn(guard))
}

/// Refuses whoever is not on this machine, also where the server listens to others one day.
async fn guard(request: Request, next: Next) -> Response {
    let refused = |why: String| ApiError::new("admin_refused", why).into_response();
    match request.extensions().get::<Peer>() {
        Some(Peer(peer)) if peer.ip().to_canonical().is_loopback() => {}
        Some(Peer(peer)) => {
            let ip = peer.ip();
            return refused(format!("{ip} is not this machine; log in there and ask from there"));
        }
        None => return refused("it is not known where the request comes from".into()),
    }
    if let Some(name) = FORWARDED.iter().find(|name| request.headers().contains_key(**name)) {
        return refused(format!(
            "the request came through another program ({name}); ask the server itself, from its machine"
        ));
    }
    next.run(request).await
}

/// The adapter, all queues and counters, and which messages the server tells.
#[utoipa::path(
    get, path = "/admin", tag = "admin",
    responses((status = 200, body = AdminReport), (status = 403, body = ErrorBody))
)]
async fn report(State(app): State<AppState>) -> Json<AdminReport> {
    let (link, status, queues) = {
        let (ground, _) = app.live.locked();
        (ground.link(), ground.recorder_status(), ground.queues())
    };
    let queue = |name: &str, waiting: u64, most: Option<u64>| {
        let name = name.into();
        QueueReport { name, waiting, most }
    };
    let listeners_max = app.config.server.listeners_max;
    let listeners = listeners_max.saturating_sub(app.listeners.available_permits());
    let active = |state: JobState| matches!(state, JobState::Queued | JobState::Running);
    let jobs = app.jobs.list().into_iter().filter(|job| active(job.state)).count();
    let mut all = vec![
        queue("commands staged", queues.staged as u64, Some(bridge::commands::MAX_COMMANDS as u64)),
        queue("commands waiting for the log", queues.log_pending as u64, None),
        queue("commands under way", queues.under_way as u64, None),
        queue("link up", link.up.in_flight, Some(bridge::ground::UPLINK_MAX as u64)),
        queue("link down", link.down.in_flight, Some(bridge::ground::DOWNLINK_MAX as u64)),
        queue("listeners", listeners as u64, Some(listeners_max as u64)),
        queue("jobs", jobs as u64, Some(app.config.server.jobs_max as u64)),
        queue(
            "replays",
            app.replays.list().len() as u64,
            Some(app.config.server.replays_max as u64),
        ),
    ];
    if let Some(carrier) = &link.carrier {
        let bounds = bridge::carrier::Bounds::default();
        let counters = carrier.counters;
        all.push(queue("carrier, to be written", counters.waiting, Some(bounds.waiting as u64)));
        all.push(queue("carrier, unconfirmed", counters.unconfirmed, Some(bounds.window as u64)));
    }
    let kind = if link.carrier.is_some() { AdapterKind::Remote } else { AdapterKind::Simulated };
    Json(AdminReport {
        adapter: AdapterReport { kind, carrier: link.carrier },
        queues: all,
        link_up: link.up,
        link_down: link.down,
        recorder: RecorderReport {
            log_id: status.log.id,
            commits: status.commits,
            messages: status.messages,
            dropped: status.dropped,
            segments: status.segments,
            error: status.error,
        },
        log_filter: log_level::current(),
    })
}

/// Sets which messages the server tells, until it ends.
#[utoipa::path(
    put, path = "/admin/log-level", tag = "admin", request_body = LogFilter,
    responses(
        (status = 200, body = LogFilter), (status = 403, body = ErrorBody),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn log_level(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(wanted): Body<LogFilter>,
) -> Result<Json<LogFilter>, ApiError> {
    let filter = log_level::set(&wanted.filter).map_err(|error| match error {
        FilterError::Text(why) => ApiError::from(RequestError::at(
            "out_of_range",
            &At::root("filter"),
            format_args!("is no filter: {why}"),
        )),
        FilterError::Fixed => ApiError::new("log_level_fixed", error.to_string()),
    })?;
    app.live.notice(
        EventLevel::Info,
        &who,
        &format!("set which messages the server tells to {filter}"),
    );
    Ok(Json(LogFilter { filter }))
}

/// Makes the connection to the rover's process anew. Nothing is lost by it, and nothing said twice.
#[utoipa::path(
    post, path = "/admin/reconnect", tag = "admin",
    responses(
        (status = 200, body = CarrierReport), (status = 403, body = ErrorBody),
        (status = 409, body = ErrorBody)
    )
)]
async fn reconnect(
    State(app): State<AppState>,
    Operator(who): Operator,
) -> Result<Json<CarrierReport>, ApiError> {
    let (mut ground, now) = app.live.locked();
    ground.reconnect(now, &who);
    ground.carrier().map(Json).ok_or_else(|| {
        let message =
            "the rover is simulated within the server, so there is no connection to make anew";
        ApiError::new("rover_in_process", message)
    })
}
