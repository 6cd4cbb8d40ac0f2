//! Checks of requests: what is refused is named by its place in the request, with the way out.

use std::fmt;

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

use crate::resources::ErrorInfo;

/// How far the norm of a quaternion or a normal may be off one.
pub const UNIT_TOLERANCE: f64 = 1e-3;
/// Largest coordinate of a request (m).
pub const COORDINATE_MAX_M: f64 = 1e6;
/// Largest joint angle of a request (rad).
pub const ANGLE_MAX_RAD: f64 = 1e3;

/// Why a request was refused: nothing was done.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct RequestError {
    /// A stable word for programs.
    pub code: &'static str,
    /// The place in the request, as `scene.state.base.position_m[2]`; empty where none fits.
    pub field: String,
    /// What is wrong and how to mend it.
    pub message: String,
}

impl RequestError {
    /// An error about the field `at`; the message begins with its name.
    pub fn at(code: &'static str, at: &At<'_>, text: impl fmt::Display) -> RequestError {
        RequestError { code, field: at.to_string(), message: format!("{at} {text}") }
    }

    /// An error about no single field.
    pub fn new(code: &'static str, message: impl Into<String>) -> RequestError {
        RequestError { code, field: String::new(), message: message.into() }
    }

    /// As it stands in an answer.
    pub fn info(&self) -> ErrorInfo {
        let details = if self.field.is_empty() {
            serde_json::Value::Null
        } else {
            serde_json::json!({ "field": self.field })
        };
        ErrorInfo { code: self.code.into(), message: self.message.clone(), details }
    }
}

/// A place in a request. Costs nothing until it is printed.
#[derive(Debug, Clone, Copy)]
pub struct At<'a> {
    parent: Option<&'a At<'a>>,
    step: Step<'a>,
}

#[derive(Debug, Clone, Copy)]
enum Step<'a> {
    Field(&'a str),
    Index(usize),
}

impl<'a> At<'a> {
    /// A field of the request itself.
    pub const fn root(name: &'a str) -> At<'a> {
        At { parent: None, step: Step::Field(name) }
    }

    /// A field of this one.
    pub fn field(&'a self, name: &'a str) -> At<'a> {
        At { parent: Some(self), step: Step::Field(name) }
    }

    /// An element of this one.
    pub fn index(&'a self, index: usize) -> At<'a> {
        At { parent: Some(self), step: Step::Index(index) }
    }
}

impl fmt::Display for At<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(parent) = self.parent {
            parent.fmt(f)?;
        }
        match self.step {
            Step::Field(name) if self.parent.is_some() => write!(f, ".{name}"),
            Step::Field(name) => f.write_str(name),
            Step::Index(index) => write!(f, "[{index}]"),
        }
    }
}

/// A number that is neither NaN nor infinite.
pub fn finite(at: &At<'_>, value: f64) -> Result<f64, RequestError> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(RequestError::at("not_finite", at, format_args!("is {value}; give a finite number")))
}

/// A finite number within `[min, max]`; `unit` is what the message says behind the bounds.
pub fn within(
    at: &At<'_>,
    value: f64,
    [min, max]: [f64; 2],
    unit: &str,
) -> Result<f64, RequestError> {
    let value = finite(at, value)?;
    if (min..=max).contains(&value) {
        return Ok(value);
    }
    let text = format_args!("is {value}; it must lie between {min} and {max}{unit}");
    Err(RequestError::at("out_of_range", at, text))
}

/// A position or another vector of lengths (m), each within [`COORDINATE_MAX_M`].
pub fn position(at: &At<'_>, p: [f64; 3]) -> Result<[f64; 3], RequestError> {
    for (i, value) in p.into_iter().enumerate() {
        within(&at.index(i), value, [-COORDINATE_MAX_M, COORDINATE_MAX_M], " m")?;
    }
    Ok(p)
}

/// Edge lengths (m), each above zero.
pub fn edges(at: &At<'_>, sizes: [f64; 3]) -> Result<[f64; 3], RequestError> {
    for (i, value) in sizes.into_iter().enumerate() {
        within(&at.index(i), value, [1e-6, COORDINATE_MAX_M], " m")?;
    }
    Ok(sizes)
}

/// A unit quaternion `[x, y, z, w]`, normalized.
pub fn unit_quaternion(
    at: &At<'_>,
    [x, y, z, w]: [f64; 4],
) -> Result<UnitQuaternion<f64>, RequestError> {
    for (i, value) in [x, y, z, w].into_iter().enumerate() {
        finite(&at.index(i), value)?;
    }
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        let text = format_args!(
            "is no unit quaternion: its norm is {norm}; divide it by that (the order is x, y, z, w)"
        );
        return Err(RequestError::at("not_unit_quaternion", at, text));
    }
    Ok(UnitQuaternion::from_quaternion(quaternion))
}

/// A unit vector, normalized.
pub fn unit_vector(at: &At<'_>, v: [f64; 3]) -> Result<Unit<Vector3<f64>>, RequestError> {
    for (i, value) in v.into_iter().enumerate() {
        finite(&at.index(i), value)?;
    }
    let vector = Vector3::from(v);
    let norm = vector.norm();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        let text = format_args!("is no unit vector: its length is {norm}; divide it by that");
        return Err(RequestError::at("not_unit_vector", at, text));
    }
    Ok(Unit::new_normalize(vector))
}

/// A list of at most `most` elements.
pub fn at_most(at: &At<'_>, n: usize, most: usize) -> Result<(), RequestError> {
    if n <= most {
        return Ok(());
    }
    let text = format_args!("has {n} elements; at most {most} are taken, so split the request");
    Err(RequestError::at("too_many", at, text))
}

/// A list with something in it.
pub fn not_empty(at: &At<'_>, n: usize) -> Result<(), RequestError> {
    if n > 0 {
        return Ok(());
    }
    Err(RequestError::at("empty", at, "is empty; give one element or more"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_reads_like_a_path() {
        let (states, base) = (At::root("states"), "base");
        let (state, field) = (states.index(3), "position_m");
        let (base, z) = (state.field(base), 2);
        let position = base.field(field);
        assert_eq!(position.index(z).to_string(), "states[3].base.position_m[2]");
    }

    #[test]
    fn only_units_within_a_thousandth_pass_and_come_out_exact() {
        let at = At::root("q");
        assert!(unit_quaternion(&at, [0.0, 0.0, 0.0, 1.0009]).is_ok());
        let refused = unit_quaternion(&at, [0.0, 0.0, 0.0, 1.002]).unwrap_err();
        assert_eq!(refused.code, "not_unit_quaternion");
        let normal = unit_vector(&at, [0.0, 0.0, 0.9995]).unwrap();
        assert_eq!(normal.z, 1.0);
        assert_eq!(unit_vector(&at, [0.0, 0.0, 0.0]).unwrap_err().code, "not_unit_vector");
        assert_eq!(unit_vector(&at, [f64::NAN, 0.0, 1.0]).unwrap_err().field, "q[0]");
    }
}
