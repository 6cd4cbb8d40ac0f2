//! Preconditions of a request, checked by name.

use serde_json::Value;
use wire::check::{self, At, RequestError};
use wire::live::{Precondition, channel};
use wire::precondition::{CHANNELS, FIELD_LENGTH_MAX, PRECONDITIONS_MAX};

/// Longest age that may be allowed (s): a day.
const AGE_MAX_S: f64 = 86_400.0;
/// Longest text to compare with (bytes).
const TEXT_MAX: usize = 200;

/// Refuses preconditions that are none. Those of a step (`at_release` false) are asked on board alone.
pub(super) fn check(
    at: &At<'_>,
    preconditions: &[Precondition],
    at_release: bool,
) -> Result<(), RequestError> {
    check::at_most(at, preconditions.len(), PRECONDITIONS_MAX)?;
    for (i, wanted) in preconditions.iter().enumerate() {
        let at = at.index(i);
        let allowed = if at_release { &CHANNELS[..] } else { &[channel::ROVER_STATE][..] };
        if !allowed.contains(&wanted.channel.as_str()) {
            let text = format_args!("takes one of {}", allowed.join(", "));
            return Err(RequestError::at("command_invalid", &at.field("channel"), text));
        }
        if wanted.field.is_empty() || wanted.field.len() > FIELD_LENGTH_MAX {
            let text = format_args!("takes 1 to {FIELD_LENGTH_MAX} bytes");
            return Err(RequestError::at("out_of_range", &at.field("field"), text));
        }
        let good = match &wanted.value {
            Value::Number(_) | Value::Bool(_) => true,
            Value::String(text) => text.len() <= TEXT_MAX,
            _ => false,
        };
        if !good {
            let text = "takes a number, true, false or a short text";
            return Err(RequestError::at("command_invalid", &at.field("value"), text));
        }
        check::within(&at.field("max_age_s"), wanted.max_age_s, [0.0, AGE_MAX_S], " s")?;
        if wanted.observed.is_some() {
            let text = "is set at release; leave it out";
            return Err(RequestError::at("command_invalid", &at.field("observed"), text));
        }
    }
    Ok(())
}
