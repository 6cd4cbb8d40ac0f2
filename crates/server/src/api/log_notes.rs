//! Clips of logs, and bookmarks in them.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use bridge::bookmarks::{self, BookmarkError};
use bridge::catalog;
use bridge::clip::{ClipNote, Selection};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::resources::{Bookmark, BookmarkList, BookmarkRequest, ClipRequest, ErrorBody, LogInfo};
use wire::time::Timestamp;

use crate::app::AppState;
use crate::body::{Body, Operator, Path};
use crate::error::ApiError;

/// Bookmarks are read, changed and written by one request at a time.
static ONE_AT_A_TIME: tokio::sync::Mutex<()> = tokio::sync::Mutex::const_new(());

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(make_clip))
        .routes(routes!(list_bookmarks, add_bookmark))
        .routes(routes!(remove_bookmark))
}

impl From<BookmarkError> for ApiError {
    fn from(error: BookmarkError) -> ApiError {
        let code = match error {
            BookmarkError::Log(error) => return error.into(),
            BookmarkError::Io(error) => return ApiError::internal("keeping the bookmarks", error),
            BookmarkError::TooMany => "too_many",
            BookmarkError::Text { .. } | BookmarkError::Order => "out_of_range",
            BookmarkError::Unknown => "bookmark_unknown",
        };
        let field = match error {
            BookmarkError::Text { .. } => Some("text"),
            BookmarkError::Order => Some("until"),
            _ => None,
        };
        let mut answer = ApiError::new(code, error.to_string());
        if let Some(field) = field {
            answer.0.details = serde_json::json!({ "field": field });
        }
        answer
    }
}

async fn blocking<T: Send + 'static>(
    what: &str,
    work: impl FnOnce() -> Result<T, ApiError> + Send + 'static,
) -> Result<T, ApiError> {
    tokio::task::spawn_blocking(work).await.map_err(|error| ApiError::internal(what, error))?
}

/// The bookmarks of a log that touch a stretch of it, as they are attached to what is made of that.
pub fn marks_within(
    folder: &std::path::Path,
    id: &str,
    from: Option<Timestamp>,
    to: Option<Timestamp>,
) -> Result<Option<Vec<u8>>, BookmarkError> {
    let mut marks = bookmarks::list(folder, id)?;
    marks.bookmarks.retain(|b: &Bookmark| {
        from.is_none_or(|from| from <= b.until.unwrap_or(b.at)) && to.is_none_or(|to| b.at <= to)
    });
    Ok(serde_json::to_vec(&marks).ok().filter(|_| !marks.bookmarks.is_empty()))
}

/// Makes a part of a log a log of its own, with the bookmarks of that part. It is listed, played and
/// downloaded as any other; its messages are those of the log, byte for byte.
#[utoipa::path(
    post, path = "/logs/{id}/clips", tag = "logs", request_body = ClipRequest,
    params(("id" = String, Path, description = "The log")),
    responses(
        (status = 201, body = LogInfo),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn make_clip(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Operator(who): Operator,
    Body(request): Body<ClipRequest>,
) -> Result<(StatusCode, Json<LogInfo>), ApiError> {
    let ClipRequest { from, to, channels } = request;
    let folder = app.config.server.logs_dir.clone();
    let made = app.clock.now();
    let clip = format!("clip-{}", uuid::Uuid::now_v7());
    let info = blocking("making the clip", move || {
        let marks = marks_within(&folder, &id, from, to)?;
        let text = |time: Option<Timestamp>| time.map(|t| t.to_rfc3339());
        let mut texts = BTreeMap::from([
            ("log".to_owned(), id.clone()),
            ("who".to_owned(), who),
            ("made".to_owned(), made.to_rfc3339()),
        ]);
        texts.extend(text(from).map(|text| ("from".to_owned(), text)));
        texts.extend(text(to).map(|text| ("to".to_owned(), text)));
        let note = ClipNote { texts, bookmarks: marks };
        let channels = channels.map(|names| names.into_iter().collect());
        let selection = Selection { from, to, channels };
        let clipped = catalog::clip_log(&folder, &id, &clip, &selection, &note)?;
        if clipped.contents.messages == 0 {
            // Nobody needs it.
            let _ = std::fs::remove_file(folder.join(format!("{clip}.mcap")));
            return Err(ApiError::new("log_empty", "no message of the log is in that clip"));
        }
        if let Some(attached) = &note.bookmarks {
            bookmarks::take_along(&folder, &clip, attached)?;
        }
        Ok(catalog::log_info(&folder, &clip)?)
    })
    .await?;
    Ok((StatusCode::CREATED, Json(info)))
}

/// The bookmarks of a log.
#[utoipa::path(
    get, path = "/logs/{id}/bookmarks", tag = "logs",
    params(("id" = String, Path, description = "The log")),
    responses((status = 200, body = BookmarkList), (status = 404, body = ErrorBody))
)]
async fn list_bookmarks(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<BookmarkList>, ApiError> {
    let folder = app.config.server.logs_dir.clone();
    blocking("reading the bookmarks", move || Ok(Json(bookmarks::list(&folder, &id)?))).await
}

/// Marks a place of a log, or a stretch of it.
#[utoipa::path(
    post, path = "/logs/{id}/bookmarks", tag = "logs", request_body = BookmarkRequest,
    params(("id" = String, Path, description = "The log")),
    responses(
        (status = 201, body = Bookmark),
        (status = 404, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn add_bookmark(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Operator(who): Operator,
    Body(request): Body<BookmarkRequest>,
) -> Result<(StatusCode, Json<Bookmark>), ApiError> {
    let _one = ONE_AT_A_TIME.lock().await;
    let BookmarkRequest { at, until, text } = request;
    let made = app.clock.now();
    let bookmark = Bookmark { id: uuid::Uuid::now_v7().to_string(), at, until, text, who, made };
    let folder = app.config.server.logs_dir.clone();
    let kept = bookmark.clone();
    blocking("keeping the bookmark", move || Ok(bookmarks::add(&folder, &id, kept)?)).await?;
    Ok((StatusCode::CREATED, Json(bookmark)))
}

/// Removes a bookmark.
#[utoipa::path(
    delete, path = "/logs/{id}/bookmarks/{bookmark}", tag = "logs",
    params(
        ("id" = String, Path, description = "The log"),
        ("bookmark" = String, Path, description = "The bookmark")
    ),
    responses((status = 204), (status = 404, body = ErrorBody))
)]
async fn remove_bookmark(
    State(app): State<AppState>,
    Path((id, bookmark)): Path<(String, String)>,
) -> Result<StatusCode, ApiError> {
    let _one = ONE_AT_A_TIME.lock().await;
    let folder = app.config.server.logs_dir.clone();
    let remove = move || Ok(bookmarks::remove(&folder, &id, &bookmark)?);
    blocking("removing the bookmark", remove).await?;
    Ok(StatusCode::NO_CONTENT)
}
