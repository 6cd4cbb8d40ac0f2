//! The route for viewers that speak the Foxglove WebSocket protocol.

use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::resources::ErrorBody;

use crate::app::AppState;
use crate::body::Query;
use crate::error::ApiError;
use crate::foxglove::{self, Feed, PROTOCOLS};
use crate::stream;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(viewer))
}

/// What a viewer wants to see.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
struct Wanted {
    /// A replay, by its id; the live rover where it is absent.
    replay: Option<String>,
}

/// The logged channels of the live rover or of a replay, read-only, for viewers: a WebSocket with the
/// subprotocol `foxglove.sdk.v1` or `foxglove.websocket.v1`.
#[utoipa::path(
    get, path = "/foxglove", tag = "rover", params(Wanted),
    responses(
        (status = 101, description = "WebSocket"),
        (status = 400, body = ErrorBody), (status = 404, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn viewer(
    State(app): State<AppState>,
    Query(wanted): Query<Wanted>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, ApiError> {
    let upgrade = upgrade.map_err(|error| {
        ApiError::new("query_invalid", format!("this route is a WebSocket: {}", error.body_text()))
    })?;
    let upgrade = upgrade.protocols(PROTOCOLS);
    if upgrade.selected_protocol().is_none() {
        let message = format!("offer one of the subprotocols {}", PROTOCOLS.join(", "));
        return Err(ApiError::new("subprotocol_unknown", message));
    }
    let place = app.listeners.clone().try_acquire_owned().map_err(|_| {
        ApiError::new("busy", "as many listeners as are taken hear the stream already")
    })?;
    let feed = Feed::open(&app, wanted.replay.as_deref())?;
    Ok(upgrade
        .max_message_size(stream::REQUEST_BYTES_MAX)
        .max_frame_size(stream::REQUEST_BYTES_MAX)
        .on_upgrade(move |socket| async move {
            foxglove::serve(socket, app, feed).await;
            drop(place);
        }))
}
