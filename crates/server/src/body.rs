//! Reading requests: JSON bodies with errors that name the field, and the operator's name.

use axum::body::Bytes;
use axum::extract::rejection::{BytesRejection, PathRejection, QueryRejection};
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::header::CONTENT_TYPE;
use axum::http::request::Parts;
use serde::de::DeserializeOwned;
use wire::check::RequestError;

use crate::error::ApiError;

/// Reads a JSON object; errors name the field.
pub fn parse<T: DeserializeOwned>(text: &[u8]) -> Result<T, RequestError> {
    // Without this a list would be taken for an object's values in order.
    if text.trim_ascii_start().first() == Some(&b'[') {
        return Err(RequestError::new("wrong_type", "the request must be a JSON object"));
    }
    let mut json = serde_json::Deserializer::from_slice(text);
    let value = serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let path = error.path().to_string();
        json_error(text, &path, error.inner())
    })?;
    json.end().map_err(|error| json_error(text, ".", &error))?;
    Ok(value)
}

fn json_error(text: &[u8], path: &str, error: &serde_json::Error) -> RequestError {
    let field = if path == "." || path == "?" { String::new() } else { path.to_owned() };
    let place = if field.is_empty() { "the request".to_owned() } else { field.clone() };
    let said = error.to_string();
    let refuse = |code, message| RequestError { code, field: field.clone(), message };
    if is_not_a_number(text, error) || said.starts_with("number out of range") {
        return refuse("not_finite", format!("{place} is NaN or infinite; give a finite number"));
    }
    if said.starts_with("trailing characters") && !field.is_empty() {
        return refuse("wrong_type", format!("{place} has more elements than it takes"));
    }
    if !error.is_data() {
        return refuse("not_json", format!("{place} is not JSON: {said}"));
    }
    let code = if said.starts_with("unknown field") {
        "unknown_field"
    } else if said.starts_with("missing field") {
        "missing_field"
    } else {
        "wrong_type"
    };
    refuse(code, format!("{place}: {said}"))
}

/// True if the reader stopped at `NaN` or `Infinity`, which some programs write.
fn is_not_a_number(text: &[u8], error: &serde_json::Error) -> bool {
    let Some(line) = text.split(|b| *b == b'\n').nth(error.line().saturating_sub(1)) else {
        return false;
    };
    // The column counts from 1, and is that of the last byte read or of the one after it.
    (error.column().saturating_sub(2)..=error.column()).any(|at| {
        let near = line.get(at..).unwrap_or_default();
        [&b"NaN"[..], b"nan", b"Infinity", b"inf"].iter().any(|word| near.starts_with(word))
    })
}

/// A JSON body.
pub struct Body<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Body<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        let json = request
            .headers()
            .get(CONTENT_TYPE)
            .and_then(|value| value.to_str().ok())
            .and_then(|value| value.split(';').next())
            .is_some_and(|kind| {
                let kind = kind.trim().to_ascii_lowercase();
                kind == "application/json" || kind.ends_with("+json")
            });
        if !json {
            let message = "send the body with the header Content-Type: application/json";
            return Err(ApiError::new("content_type", message));
        }
        let bytes = Bytes::from_request(request, state).await.map_err(body_error)?;
        Ok(Body(parse(&bytes)?))
    }
}

/// A JSON body that may be left out.
pub struct OptionalBody<T>(pub T);

impl<T: DeserializeOwned + Default, S: Send + Sync> FromRequest<S> for OptionalBody<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        let bytes = Bytes::from_request(request, state).await.map_err(body_error)?;
        if bytes.trim_ascii().is_empty() {
            return Ok(OptionalBody(T::default()));
        }
        Ok(OptionalBody(parse(&bytes)?))
    }
}

/// The refusal of a body that is too large or was cut off.
pub fn body_error(error: BytesRejection) -> ApiError {
    if error.status() == axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        ApiError::new(
            "body_too_large",
            "the body is larger than this route takes; split the request",
        )
    } else {
        ApiError::new("not_json", "the body ended before it was complete")
    }
}

/// The query of a request.
pub struct Query<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let query: Result<_, QueryRejection> =
            axum::extract::Query::<T>::from_request_parts(parts, state).await;
        query.map(|query| Query(query.0)).map_err(|e| ApiError::new("query_invalid", e.body_text()))
    }
}

/// The names in the path of a request.
pub struct Path<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Path<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let path: Result<_, PathRejection> =
            axum::extract::Path::<T>::from_request_parts(parts, state).await;
        path.map(|path| Path(path.0)).map_err(|e| ApiError::new("query_invalid", e.body_text()))
    }
}

/// Who asks, as the header `X-Operator` says; `operator` without it.
pub struct Operator(pub String);

impl Operator {
    /// A name as requests carry it, without space around it; none that they could not carry.
    pub fn named(text: &str) -> Option<String> {
        let name = text.trim();
        let printable = name.bytes().all(|b| (b' '..=b'~').contains(&b));
        ((1..=64).contains(&name.len()) && printable).then(|| name.into())
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Operator {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let Some(value) = parts.headers.get("x-operator") else {
            return Ok(Operator("operator".into()));
        };
        if let Some(name) = value.to_str().ok().and_then(Operator::named) {
            return Ok(Operator(name));
        }
        let message = "X-Operator must be 1 to 64 printable ASCII characters";
        Err(ApiError::new("operator_invalid", message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::analysis::{KinematicsRequest, StabilityRequest};

    #[track_caller]
    fn check(text: &str, code: &str, field: &str) {
        let error = parse::<StabilityRequest>(text.as_bytes()).unwrap_err();
        assert_eq!((error.code, error.field.as_str()), (code, field), "{}", error.message);
    }

    #[test]
    fn errors_of_json_name_the_field() {
        check("", "not_json", "");
        check("{\"cases\": [", "not_json", "cases");
        check("{\"cases\": []} x", "not_json", "");
        check("{}", "missing_field", "");
        check("{\"cases\": [], \"more\": 1}", "unknown_field", "more");
        check("{\"cases\": 5}", "wrong_type", "cases");
        check(
            "{\"cases\": [{\"contacts\": [], \"com_m\": [0, 0]}]}",
            "wrong_type",
            "cases[0].com_m",
        );
        let not_finite = ["NaN", "Infinity", "-Infinity", "1e999", "-1e999", " NaN"];
        for number in not_finite {
            let text =
                format!("{{\"cases\": [{{\"contacts\": [], \"com_m\": [0, {number}, 0]}}]}}");
            check(&text, "not_finite", "cases[0].com_m[1]");
        }
    }

    #[test]
    fn deep_nesting_is_refused_not_followed() {
        let text = "[".repeat(100_000);
        assert!(parse::<KinematicsRequest>(text.as_bytes()).is_err());
        let text = format!("{{\"scene\": {}", "{\"obstacles\": [".repeat(100_000));
        assert!(parse::<KinematicsRequest>(text.as_bytes()).is_err());
    }
}
