//! Errors at the edge: one form, stable codes.

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bridge::commands::{AuthorityError, CommandError, EstopError};
use bridge::ground::RoverBusy;
use bridge::link::LinkError;
use bridge::reader::ReadError;
use bridge::replay::ReplayError;
use wire::check::RequestError;
use wire::resources::{ErrorBody, ErrorInfo};

/// Every code that an answer can carry: code, HTTP status, meaning. Codes never change their
/// meaning; new ones may come.
pub const CODES: &[(&str, u16, &str)] = &[
    // the request itself
    ("not_json", 400, "the body is not JSON, or cut off"),
    ("content_type", 415, "the body must be sent as application/json"),
    ("unknown_field", 422, "a field that this request does not have"),
    ("missing_field", 422, "a field that this request needs"),
    ("wrong_type", 422, "a value of another type or form than the field takes"),
    ("not_finite", 422, "a number that is NaN or infinite"),
    ("out_of_range", 422, "a number outside its range"),
    ("not_unit_quaternion", 422, "an orientation whose norm is off one by more than 0.001"),
    ("not_unit_vector", 422, "a normal or axis whose length is off one by more than 0.001"),
    ("too_many", 422, "a list, map or file larger than is taken"),
    ("empty", 422, "a list that must not be empty"),
    ("joint_count", 422, "a list of joint angles of the wrong length"),
    ("leg_missing", 422, "a state that does not give all legs"),
    ("leg_unknown", 422, "a leg that the robot does not have"),
    ("link_unknown", 422, "a link that the robot does not have"),
    ("robot_unknown", 422, "a robot whose folder is not there"),
    ("robot_invalid", 422, "a robot folder that cannot be used"),
    ("camera_unknown", 422, "a stereo pair that the robot does not have"),
    ("payload_invalid", 422, "a payload with a mass, place or size that cannot be"),
    ("obstacle_invalid", 422, "an obstacle that is no closed solid"),
    ("contacts_invalid", 422, "contacts of which no region can be computed"),
    ("stance_unusable", 422, "a stance about which no advice can be given; the message says why"),
    ("target_ambiguous", 422, "not exactly one of the ways to give a target"),
    ("terrain_ambiguous", 422, "not exactly one of the ways to give a ground"),
    ("recipe_unknown", 422, "a recipe of synthetic ground that is not there"),
    ("terrain_file_unknown", 404, "a terrain file that is not there"),
    ("terrain_file_invalid", 422, "a terrain file that cannot be used"),
    ("file_name_invalid", 422, "a file name that is not a plain name"),
    ("file_too_large", 413, "an upload larger than is taken"),
    ("request_unreadable", 422, "a request file that cannot be read (command line)"),
    ("config_invalid", 422, "a configuration that cannot be used (command line)"),
    ("output_unwritable", 422, "a file that cannot be written (command line)"),
    (
        "rover_address_invalid",
        422,
        "an address of a rover that is not tcp://host:port (command line)",
    ),
    ("rover_memory", 422, "a memory of the simulated rover that cannot be used (command line)"),
    ("bind_refused", 422, "an address other than loopback (command line)"),
    ("port_in_use", 422, "a port that another program listens on (command line)"),
    ("listen", 422, "an address that cannot be listened on (command line)"),
    ("query_invalid", 400, "a query or path that cannot be read"),
    ("subprotocol_unknown", 400, "a viewer that offers no WebSocket subprotocol of this route"),
    ("body_too_large", 413, "a body larger than is taken"),
    ("operator_invalid", 400, "an X-Operator header that is no plain name of up to 64 characters"),
    // who asks
    ("host_refused", 403, "a Host header that is not a loopback name"),
    ("admin_refused", 403, "only programs of this machine may manage the server"),
    ("origin_refused", 403, "a web page of another origin asks"),
    // what is asked for
    ("route_unknown", 404, "no such route"),
    ("method_not_allowed", 405, "the route does not take this method"),
    ("terrain_unknown", 404, "a version of the map that is not kept"),
    ("tile_unknown", 404, "no such tile or layer"),
    ("texture_none", 404, "a map over which no camera image lies"),
    ("overlay_unknown", 404, "no such overlay"),
    ("overlay_elsewhere", 422, "a raster that lies beside the map"),
    (
        "map_not_restored",
        409,
        "a map of an earlier session that its log does not make again as it was",
    ),
    ("job_unknown", 404, "no such job"),
    ("reconstruction_unknown", 404, "no such reconstruction, or not one that has ended"),
    ("picture_unknown", 404, "no such picture of a pair, or it is no longer kept"),
    ("capture_unknown", 404, "a capture of a pair that the map in use does not have"),
    ("not_current", 409, "only the map in use can be changed"),
    ("other_ground", 409, "a map of other ground than the rover stands on"),
    ("fit_refused", 409, "a pair that was not fitted to the map, so that nothing can be undone"),
    ("image_unknown", 404, "an image that is not here"),
    ("images_ended", 409, "images of which nothing is on the way"),
    ("images_missing", 409, "a reconstruction for which no pair has come whole"),
    ("job_ended", 409, "a job that has ended already"),
    ("plan_unknown", 404, "no such plan"),
    ("posture_unknown", 404, "no such answer of the posture adviser"),
    ("proposal_index", 422, "an answer of the posture adviser without a proposal of that index"),
    ("posture_ambiguous", 422, "not exactly one of the ways to say what is taken up"),
    ("way_back_unknown", 422, "an answer of the posture adviser without a rehearsal of that leg"),
    ("plan_not_sendable", 409, "a plan that was not found or failed its final check"),
    ("command_index", 422, "a plan without a command of that index"),
    ("command_invalid", 422, "a command that this rover cannot execute"),
    ("command_unknown", 404, "no such command"),
    ("log_unknown", 404, "no such log"),
    ("log_empty", 422, "a log, or a part of it, without messages"),
    ("bookmark_unknown", 404, "no such bookmark"),
    ("replay_unknown", 404, "no such replay"),
    ("rate_invalid", 422, "a speed of replay out of range"),
    ("channel_unknown", 422, "no such channel"),
    ("not_ready", 404, "something that is still being computed"),
    // what the state does not allow
    ("no_state", 409, "no telemetry has come yet"),
    ("basis_changed", 409, "the plan's basis (state, map or model) no longer holds; plan anew"),
    ("not_staged", 409, "only a staged command can be armed"),
    ("not_armed", 409, "only an armed command can be sent"),
    ("arm_expired", 409, "the time to send the armed command is over"),
    ("other_armed", 409, "another command is armed"),
    ("order", 409, "a plan's commands go in order, forward and back"),
    ("not_executed", 409, "a part of a way back that undoes what was not done"),
    ("backing_out", 409, "a plan that is being backed out goes back only"),
    ("plan_under_way", 409, "a command of the same plan is on its way or under way"),
    ("authority_held", 409, "another operator has the authority to command"),
    ("authority_needed", 409, "the authority to command must be acquired first"),
    ("authority_has_it", 409, "the operator named has the authority to command already"),
    ("authority_passed_on", 409, "the authority to command has passed on since"),
    ("approval_needed", 409, "a command that a second person must approve first"),
    ("approval_not_needed", 409, "a command that takes no approval"),
    ("self_approval", 409, "the author of a command cannot approve it"),
    ("approval_of_other", 409, "an approval of another content than the command has"),
    ("precondition_unknown", 409, "telemetry has no such field, or it does not compare so"),
    ("precondition_stale", 409, "the telemetry that a command waits for is too old"),
    ("precondition_failed", 409, "telemetry does not show what a command waits for"),
    ("not_overdue", 409, "only a command whose outcome is unknown is resolved by hand"),
    ("estop_in_force", 409, "an E-stop is in force"),
    ("already_terminal", 409, "the command has ended, or is beyond recall"),
    ("id_reused", 409, "the id belongs to another command"),
    ("id_invalid", 422, "the id is not a UUID"),
    ("duration_invalid", 422, "a duration that is none"),
    ("estop_not_in_force", 409, "no E-stop is in force"),
    ("token_unknown", 409, "not the token of the first step of the release"),
    ("token_expired", 409, "the token's time is over"),
    ("rover_busy", 409, "the rover is not idle"),
    (
        "rover_remote",
        409,
        "a rover that is a process of its own cannot be placed elsewhere from here",
    ),
    ("rover_unreachable", 503, "there is no connection to the rover's process"),
    ("rover_in_process", 409, "the rover is no process of its own, so there is no connection"),
    ("log_level_fixed", 409, "the program was started without messages whose level could be set"),
    ("nothing_seen", 409, "the stereo pairs see no ground"),
    ("no_place", 409, "the rover cannot be seated there"),
    // bounds and faults
    ("busy", 429, "too many analyses, jobs, replays or listeners at once; try again"),
    ("queue_full", 429, "too many commands at once"),
    ("cancelled", 409, "it was cancelled"),
    ("deadline", 504, "deadline_s passed before the answer was complete"),
    ("log_too_large", 422, "a log too large to be taken whole; take a clip of it"),
    ("log_io", 500, "the disk does not give the log"),
    ("log_damaged", 422, "a log of which nothing can be read"),
    ("log_unavailable", 503, "the flight log cannot be written, so no command is taken"),
    ("storage", 500, "the disk refuses"),
    ("internal", 500, "a fault of the program; the server's messages tell more"),
];

/// An error answer.
#[derive(Debug, Clone, PartialEq)]
pub struct ApiError(pub ErrorInfo);

impl ApiError {
    /// An error with a code of [`CODES`].
    pub fn new(code: &str, message: impl Into<String>) -> ApiError {
        let details = serde_json::Value::Null;
        ApiError(ErrorInfo { code: code.into(), message: message.into(), details })
    }

    /// A fault: told to the log, not to the client.
    pub fn internal(what: &str, error: impl std::fmt::Display) -> ApiError {
        tracing::error!("{what}: {error}");
        ApiError::new("internal", format!("{what} failed; see the server's messages"))
    }

    /// Its HTTP status.
    pub fn status(&self) -> StatusCode {
        let known = CODES.iter().find(|(code, ..)| *code == self.0.code);
        known
            .and_then(|(_, status, _)| StatusCode::from_u16(*status).ok())
            .unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let status = self.status();
        let mut response = (status, Json(ErrorBody { error: self.0 })).into_response();
        if status == StatusCode::TOO_MANY_REQUESTS {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
        }
        response
    }
}

impl From<RequestError> for ApiError {
    fn from(error: RequestError) -> ApiError {
        ApiError(error.info())
    }
}

/// Errors that bring their own code.
macro_rules! coded {
    ($($error:ty),*) => {$(
        impl From<$error> for ApiError {
            fn from(error: $error) -> ApiError {
                ApiError::new(error.code(), error.to_string())
            }
        }
    )*};
}
coded!(AuthorityError, CommandError, EstopError, RoverBusy);

impl From<ReplayError> for ApiError {
    fn from(error: ReplayError) -> ApiError {
        match error {
            ReplayError::Read(error) => error.into(),
            other => ApiError::new(other.code(), other.to_string()),
        }
    }
}

impl From<ReadError> for ApiError {
    fn from(error: ReadError) -> ApiError {
        let code = match &error {
            ReadError::Damaged(_) => "log_damaged",
            other => other.code(),
        };
        ApiError::new(code, error.to_string())
    }
}

impl From<LinkError> for ApiError {
    fn from(error: LinkError) -> ApiError {
        let mut answer = ApiError::new("out_of_range", error.to_string());
        answer.0.details = serde_json::json!({ "field": &error.field });
        answer
    }
}

/// The table of codes as Markdown, for the OpenAPI document.
pub fn codes_markdown() -> String {
    let mut text = String::from("| code | status | meaning |\n|---|---|---|\n");
    for (code, status, meaning) in CODES {
        text += &format!("| `{code}` | {status} | {meaning} |\n");
    }
    text
}
