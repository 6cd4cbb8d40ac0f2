//! Who may ask: programs of this machine, and web pages of this server.
//!
//! The server listens on loopback only. A page of another site that the operator has open could
//! still ask it, so the `Host` must be a loopback name (against rebinding of names), and whatever
//! changes something, or opens the stream, must come from a loopback page or from no page at all.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::error::ApiError;

/// What browsers are told of every answer.
const HEADERS: [(HeaderName, &str); 6] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; \
         object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Lets only those in who may ask, and sets the headers.
pub async fn guard(request: Request, next: Next) -> Response {
    let mut response = match refusal(request.method(), request.headers()) {
        Some(error) => error.into_response(),
        None => next.run(request).await,
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

fn refusal(method: &Method, headers: &HeaderMap) -> Option<ApiError> {
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    if let Some(host) = text(header::HOST)
        && !is_loopback_host(host)
    {
        let message = "the server answers on loopback names only: 127.0.0.1, localhost or [::1]";
        return Some(ApiError::new("host_refused", message));
    }
    let changes = !matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS);
    if !(changes || headers.contains_key(header::UPGRADE)) {
        return None;
    }
    match text(header::ORIGIN) {
        None => None,
        Some(origin) if is_loopback_origin(origin) => None,
        Some(_) => {
            let message = "only pages of this machine may do this; open the console from its own \
                           address";
            Some(ApiError::new("origin_refused", message))
        }
    }
}

fn is_loopback_origin(origin: &str) -> bool {
    origin.strip_prefix("http://").is_some_and(is_loopback_host)
}

/// True for `localhost`, `127.x.y.z` and `[::1]`, with or without a port.
fn is_loopback_host(host: &str) -> bool {
    let is_port = |port: &str| {
        port.is_empty() || port.strip_prefix(':').is_some_and(|p| p.parse::<u16>().is_ok())
    };
    if let Some(port) = host.strip_prefix("[::1]") {
        return is_port(port);
    }
    let end = host.find(':').unwrap_or(host.len());
    let (name, port) = host.split_at(end);
    let loopback = name == "localhost"
        || name.parse::<std::net::Ipv4Addr>().is_ok_and(|address| address.is_loopback());
    loopback && is_port(port)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(method: Method, pairs: &[(HeaderName, &str)]) -> Option<String> {
        let pairs = pairs.iter().map(|(n, v)| (n.clone(), HeaderValue::from_str(v).unwrap()));
        refusal(&method, &pairs.collect()).map(|error| error.0.code)
    }

    #[test]
    fn pages_of_this_machine_and_programs_may_change_things() {
        let host = (header::HOST, "127.0.0.1:8080");
        assert_eq!(code(Method::POST, std::slice::from_ref(&host)), None);
        for origin in
            ["http://127.0.0.1:8080", "http://localhost:5173", "http://[::1]:1", "http://localhost"]
        {
            assert_eq!(
                code(Method::POST, &[host.clone(), (header::ORIGIN, origin)]),
                None,
                "{origin}"
            );
        }
    }

    #[test]
    fn other_pages_may_not() {
        let host = (header::HOST, "localhost:8080");
        for origin in [
            "null",
            "",
            "https://evil.example",
            "http://evil.example",
            "http://localhost.evil.example",
            "http://127.0.0.1.evil.example",
            "http://localhost:8080.evil.example",
            "http://localhost@evil",
            "http://LOCALHOST.",
            "http://127.0.0.1:99999",
            "http://128.0.0.1",
            "file://",
            "http://[::2]",
            "ftp://localhost",
            "http://localhost:8080/",
            "http://0.0.0.0:8080",
        ] {
            let refused = code(Method::POST, &[host.clone(), (header::ORIGIN, origin)]);
            assert_eq!(refused.as_deref(), Some("origin_refused"), "{origin}");
            let upgrade = (header::UPGRADE, "websocket");
            let refused = code(Method::GET, &[host.clone(), upgrade, (header::ORIGIN, origin)]);
            assert_eq!(refused.as_deref(), Some("origin_refused"), "{origin}");
            assert_eq!(code(Method::GET, &[host.clone(), (header::ORIGIN, origin)]), None);
        }
    }

    #[test]
    fn a_name_that_was_bound_to_this_machine_is_no_loopback_name() {
        for name in
            ["evil.example", "evil.example:8080", "localhost.evil.example", "1.2.3.4", "[::2]:1"]
        {
            let refused = code(Method::GET, &[(header::HOST, name)]);
            assert_eq!(refused.as_deref(), Some("host_refused"), "{name}");
        }
    }
}
