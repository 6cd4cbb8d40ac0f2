//! Uploads of terrain files, and downloads of logs: long, and not held to the time of an answer.

use std::collections::BTreeMap;
use std::io::BufWriter;

use axum::Json;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use bridge::catalog;
use bridge::clip::ClipNote;
use bytes::Bytes;
use http_body_util::BodyExt;
use http_body_util::channel::{Channel, Sender};
use terrain::formats::EXTENSIONS;
use tokio::io::AsyncWriteExt;
use tower::ServiceExt;
use tower_http::services::ServeFile;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::resources::{ErrorBody, TerrainFile};

use crate::app::AppState;
use crate::body::Path;
use crate::error::ApiError;
use crate::terrains::FILE_BYTES_MAX;

/// Most files of the terrain folder.
const FILES_MAX: usize = 100;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(put_file)).routes(routes!(download))
}

/// Removes a file that was not finished.
struct Unfinished(Option<std::path::PathBuf>);

impl Drop for Unfinished {
    fn drop(&mut self) {
        if let Some(path) = self.0.take() {
            // What cannot be removed is a hidden file that nothing lists.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Puts a file into the terrain folder, in place of one of the same name. GeoTIFF (`.tif`,
/// `.tiff`), PDS3 (`.img`, `.lbl`), height-field meshes (`.off`, `.obj`), point clouds (`.ply`) and 16-bit
/// `.png` can be imported then; the `.json` of a PNG goes beside it.
#[utoipa::path(
    put, path = "/terrain/files/{name}", tag = "terrain",
    params(("name" = String, Path, description = "1 to 64 of A-Z a-z 0-9 . _ -, ending in tif, tiff, img, lbl, off, obj, ply, png or json")),
    request_body(content = Vec<u8>, content_type = "application/octet-stream"),
    responses(
        (status = 200, body = TerrainFile),
        (status = 413, body = ErrorBody), (status = 422, body = ErrorBody)
    )
)]
async fn put_file(
    State(app): State<AppState>,
    Path(name): Path<String>,
    body: Body,
) -> Result<Json<TerrainFile>, ApiError> {
    let path = app.terrain_file(&name)?;
    let ending = name.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
    let is_read = |ending: &str| ending == "json" || EXTENSIONS.contains(&ending);
    if !ending.as_deref().is_some_and(is_read) {
        let message = format!("a terrain file ends in one of {}, json", EXTENSIONS.join(", "));
        return Err(ApiError::new("file_name_invalid", message));
    }
    let storage = |error: std::io::Error| ApiError::internal("writing the file", error);
    let folder = &app.config.server.terrain_dir;
    tokio::fs::create_dir_all(folder).await.map_err(storage)?;
    let others = super::terrain::files(folder.clone()).await?;
    if others.len() >= FILES_MAX && others.iter().all(|file| file.name != name) {
        let message =
            format!("the terrain folder holds {FILES_MAX} files; remove some there first");
        return Err(ApiError::new("too_many", message));
    }
    let temporary = folder.join(format!(".upload-{}", uuid::Uuid::now_v7()));
    let mut file = tokio::fs::File::create_new(&temporary).await.map_err(storage)?;
    let mut unfinished = Unfinished(Some(temporary.clone()));
    let mut size = 0_u64;
    let mut body = body;
    while let Some(frame) = body.frame().await {
        let cut = |_| ApiError::new("query_invalid", "the upload ended before it was complete");
        let Ok(data) = frame.map_err(cut)?.into_data() else { continue };
        size += data.len() as u64;
        if size > FILE_BYTES_MAX {
            let message = format!("a terrain file has at most {FILE_BYTES_MAX} bytes; crop it");
            return Err(ApiError::new("file_too_large", message));
        }
        file.write_all(&data).await.map_err(storage)?;
    }
    file.sync_all().await.map_err(storage)?;
    drop(file);
    tokio::fs::rename(&temporary, &path).await.map_err(storage)?;
    unfinished.0 = None;
    Ok(Json(TerrainFile { name, size }))
}

/// Pieces of a download that wait for the network.
const PIECES_MAX: usize = 4;
/// Size of a piece (bytes).
const PIECE_BYTES: usize = 256 << 10;

/// The network as a place to write to, for a thread that may wait. Fails once nobody reads.
struct Pieces {
    sender: Sender<Bytes, std::io::Error>,
    runtime: tokio::runtime::Handle,
}

impl std::io::Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let piece = Bytes::copy_from_slice(&bytes[..bytes.len().min(PIECE_BYTES)]);
        let size = piece.len();
        let sent = self.runtime.block_on(self.sender.send_data(piece));
        sent.map_err(|_| std::io::Error::other("whoever asked for the log has gone away"))?;
        Ok(size)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A log of several segments, made one file on the way. Where that fails, the answer is cut off: the
/// file lacks its end, and says so to every reader.
fn merged(folder: std::path::PathBuf, id: String) -> Body {
    let (sender, body) = Channel::new(PIECES_MAX);
    let runtime = tokio::runtime::Handle::current();
    tokio::task::spawn_blocking(move || {
        let mut out = BufWriter::with_capacity(PIECE_BYTES, Pieces { sender, runtime });
        let note = ClipNote {
            texts: BTreeMap::from([("log".to_owned(), id.clone())]),
            bookmarks: super::log_notes::marks_within(&folder, &id, None, None).unwrap_or_default(),
        };
        let copied = catalog::copy_log(&folder, &id, &note, &mut out);
        let flushed = copied.and_then(|_| Ok(std::io::Write::flush(&mut out)?));
        let (Pieces { sender, .. }, _) = out.into_parts();
        if let Err(error) = flushed {
            tracing::warn!("the download of the log {id} was cut off: {error}");
            sender.abort(std::io::Error::other(error));
        }
    });
    Body::new(body)
}

/// A flight log as one MCAP file, with the bookmarks where it has several segments; the one being
/// written as far as it is safe on the disk.
#[utoipa::path(
    get, path = "/logs/{id}/download", tag = "logs",
    params(("id" = String, Path, description = "The log")),
    responses(
        (status = 200, body = Vec<u8>, content_type = "application/x-mcap"),
        (status = 404, body = ErrorBody)
    )
)]
async fn download(
    State(app): State<AppState>,
    Path(id): Path<String>,
    request: Request,
) -> Result<Response, ApiError> {
    let folder = &app.config.server.logs_dir;
    let mut response = match &catalog::log_files(folder, &id)?[..] {
        [path] => {
            let served = ServeFile::new(path).oneshot(request).await;
            served.map_err(|error| ApiError::internal("the log", error))?.into_response()
        }
        _ => merged(folder.clone(), id.clone()).into_response(),
    };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/x-mcap"));
    if let Ok(name) = HeaderValue::from_str(&format!("attachment; filename=\"{id}.mcap\"")) {
        headers.insert(header::CONTENT_DISPOSITION, name);
    }
    Ok(response)
}
