//! Whether a field of telemetry is what a command waits for.

use serde_json::Value;

use crate::live::{Comparison, Precondition, channel};
use crate::time::Timestamp;

/// Channels whose fields a command may wait for.
pub const CHANNELS: [&str; 2] = [channel::ROVER_STATE, channel::ROVER_STABILITY];
/// Most preconditions of one command or step.
pub const PRECONDITIONS_MAX: usize = 20;
/// Longest name of a field (bytes).
pub const FIELD_LENGTH_MAX: usize = 200;

/// Why a precondition does not hold. Unknown is not so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unmet {
    /// No message has come, or it has no such field.
    #[error("{channel} {field} is not known")]
    Unknown {
        /// The channel.
        channel: String,
        /// The field.
        field: String,
    },
    /// The message is too old.
    #[error("{channel} {field} is stale: it is {age_s:.1} s old, and {max_age_s} s are allowed")]
    Stale {
        /// The channel.
        channel: String,
        /// The field.
        field: String,
        /// Age (s).
        age_s: f64,
        /// Bound (s).
        max_age_s: f64,
    },
    /// Values of these kinds have no such order.
    #[error("{channel} {field} is {found}, which does not compare with {wanted} by {op}")]
    Incomparable {
        /// The channel.
        channel: String,
        /// The field.
        field: String,
        /// The field's value.
        found: String,
        /// How it is compared.
        op: &'static str,
        /// With what.
        wanted: String,
    },
    /// It is otherwise.
    #[error("{channel} {field} is {found}, not {op} {wanted}")]
    Otherwise {
        /// The channel.
        channel: String,
        /// The field.
        field: String,
        /// The field's value.
        found: String,
        /// How it is compared.
        op: &'static str,
        /// With what.
        wanted: String,
    },
}

impl Unmet {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Unmet::Unknown { .. } | Unmet::Incomparable { .. } => "precondition_unknown",
            Unmet::Stale { .. } => "precondition_stale",
            Unmet::Otherwise { .. } => "precondition_failed",
        }
    }
}

/// Does a precondition hold by this message of its channel, of `onboard` and looked at `now`?
pub fn met(
    wanted: &Precondition,
    message: Option<&Value>,
    onboard: Timestamp,
    now: Timestamp,
) -> Result<(), Unmet> {
    let (channel, field) = (wanted.channel.clone(), wanted.field.clone());
    let Some(found) = message.and_then(|message| find(message, &wanted.field)) else {
        return Err(Unmet::Unknown { channel, field });
    };
    fresh(wanted, onboard, now)?;
    let (op, shown) = (word(wanted.op), short(found));
    let other = short(&wanted.value);
    match compare(found, wanted.op, &wanted.value) {
        Some(true) => Ok(()),
        Some(false) => Err(Unmet::Otherwise { channel, field, found: shown, op, wanted: other }),
        None => Err(Unmet::Incomparable { channel, field, found: shown, op, wanted: other }),
    }
}

/// Is a message of `onboard` young enough `now`?
pub fn fresh(wanted: &Precondition, onboard: Timestamp, now: Timestamp) -> Result<(), Unmet> {
    let age_s = now.seconds_since(onboard);
    if age_s <= wanted.max_age_s {
        return Ok(());
    }
    let (channel, field) = (wanted.channel.clone(), wanted.field.clone());
    Err(Unmet::Stale { channel, field, age_s, max_age_s: wanted.max_age_s })
}

/// The value at a path of names and indices; a field that is null is none.
pub fn find<'a>(message: &'a Value, field: &str) -> Option<&'a Value> {
    let down = |value: &'a Value, name: &str| match value {
        Value::Array(items) => items.get(name.parse::<usize>().ok()?),
        _ => value.get(name),
    };
    field.split('.').try_fold(message, down).filter(|value| !value.is_null())
}

fn compare(found: &Value, op: Comparison, wanted: &Value) -> Option<bool> {
    if let (Some(a), Some(b)) = (found.as_f64(), wanted.as_f64()) {
        return Some(match op {
            Comparison::Eq => a == b,
            Comparison::Ne => a != b,
            Comparison::Lt => a < b,
            Comparison::Le => a <= b,
            Comparison::Gt => a > b,
            Comparison::Ge => a >= b,
        });
    }
    let same_kind =
        (found.is_string() && wanted.is_string()) || (found.is_boolean() && wanted.is_boolean());
    match op {
        Comparison::Eq if same_kind => Some(found == wanted),
        Comparison::Ne if same_kind => Some(found != wanted),
        _ => None,
    }
}

/// How it compares, for people.
fn word(op: Comparison) -> &'static str {
    match op {
        Comparison::Eq => "equal to",
        Comparison::Ne => "other than",
        Comparison::Lt => "less than",
        Comparison::Le => "at most",
        Comparison::Gt => "greater than",
        Comparison::Ge => "at least",
    }
}

/// The beginning of a value.
fn short(value: &Value) -> String {
    value.to_string().chars().take(60).collect()
}
