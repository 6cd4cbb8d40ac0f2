//! What the program tells of itself, changeable while it runs.

use std::sync::OnceLock;

use tracing_subscriber::{EnvFilter, Registry, reload};

/// Longest text of a filter (bytes).
pub const FILTER_MAX: usize = 400;

/// There is one subscriber in a process, and so one of these.
static HANDLE: OnceLock<reload::Handle<EnvFilter, Registry>> = OnceLock::new();

/// Why a filter was not set.
#[derive(Debug, thiserror::Error)]
pub enum FilterError {
    /// The text is none.
    #[error("{0}")]
    Text(String),
    /// Nothing to be set.
    #[error("the program was started without messages whose level could be set")]
    Fixed,
}

/// The filter as a layer that [`set`] changes.
pub fn changeable(filter: EnvFilter) -> reload::Layer<EnvFilter, Registry> {
    let (layer, handle) = reload::Layer::new(filter);
    // A second subscriber would not be installed either.
    let _ = HANDLE.set(handle);
    layer
}

/// The filter in force; none where it cannot be changed.
pub fn current() -> Option<String> {
    HANDLE.get()?.with_current(ToString::to_string).ok()
}

/// Sets another filter, as `info` or `info,bridge=debug`; gives the one in force then.
pub fn set(text: &str) -> Result<String, FilterError> {
    if text.trim().is_empty() || text.len() > FILTER_MAX {
        let why = format!("a filter has 1 to {FILTER_MAX} characters, as info,bridge=debug");
        return Err(FilterError::Text(why));
    }
    let filter = EnvFilter::try_new(text).map_err(|error| {
        FilterError::Text(format!("{error}; a filter is like info,bridge=debug"))
    })?;
    let handle = HANDLE.get().ok_or(FilterError::Fixed)?;
    handle.reload(filter).map_err(|_| FilterError::Fixed)?;
    current().ok_or(FilterError::Fixed)
}
