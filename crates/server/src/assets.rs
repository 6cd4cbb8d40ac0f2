//! The console: its built files from the binary, or from `web/dist` in a debug build.

use axum::body::Body;
use axum::http::{HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::RustEmbed;

use crate::error::ApiError;

#[derive(RustEmbed)]
#[folder = "../../web/dist/"]
struct Console;

/// What is shown when the console was not built with the program.
const NOT_BUILT: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
<title>FootFall</title><body><h1>The console is not built</h1>\
<p>The ground server runs, but this program was built without its console. \
Stop it and start it with <code>make run</code>, which builds both.</p>\
<p>The interface for programs is described at \
<a href=\"/api/v1/openapi.json\">/api/v1/openapi.json</a>.</p></body></html>\n";

/// Answers whatever is no route: a file of the console, or its page.
pub async fn serve(method: Method, uri: Uri) -> Response {
    let path = uri.path().trim_start_matches('/');
    if path.starts_with("api/") || !matches!(method, Method::GET | Method::HEAD) {
        let message = "there is no such route; /api/v1/openapi.json lists them all";
        return ApiError::new("route_unknown", message).into_response();
    }
    if let Some(response) = file(path) {
        return response;
    }
    // A file that is missing is missing; any other path is a place in the console.
    let is_file = path.rsplit('/').next().is_some_and(|last| last.contains('.'));
    if is_file && path != "index.html" {
        return ApiError::new("route_unknown", "there is no such file").into_response();
    }
    file("index.html").unwrap_or_else(|| {
        let html = HeaderValue::from_static("text/html; charset=utf-8");
        (StatusCode::OK, [(header::CONTENT_TYPE, html)], NOT_BUILT).into_response()
    })
}

fn file(path: &str) -> Option<Response> {
    if path.is_empty() || path.split('/').any(|part| matches!(part, "" | "." | "..")) {
        return None;
    }
    let file = Console::get(path)?;
    let kind = HeaderValue::from_str(file.metadata.mimetype()).ok()?;
    // Built files are named after their content; the page names them and must be asked for anew.
    let cache = if path.starts_with("assets/") {
        HeaderValue::from_static("public, max-age=31536000, immutable")
    } else {
        HeaderValue::from_static("no-cache")
    };
    let headers = [(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, cache)];
    Some((headers, Body::from(file.data.into_owned())).into_response())
}
