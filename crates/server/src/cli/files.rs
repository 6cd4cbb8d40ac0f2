//! Flight logs on the command line.

use std::path::PathBuf;

use bridge::catalog;
use bridge::reader::{self, Limits};
use clap::Subcommand;
use serde_json::{Value, json};
use wire::check::RequestError;
use wire::time::Timestamp;

use super::{Failure, Output, Verdict};
use crate::error::ApiError;

/// Flight logs.
#[derive(Debug, Subcommand)]
pub(super) enum LogCommand {
    /// What is in a flight log, and what is wrong with it; exit status 1 if anything is.
    Info {
        /// The MCAP file.
        file: PathBuf,
    },
}

pub(super) fn log(command: &LogCommand, output: Output) -> Result<Verdict, Failure> {
    let LogCommand::Info { file } = command;
    let content = reader::read_file(file, Limits::default()).map_err(|error| {
        let ApiError(info) = error.into();
        let code = if info.code == "log_too_large" { "log_too_large" } else { "log_damaged" };
        RequestError::new(code, format!("{}: {}", file.display(), info.message))
    })?;
    let mut channels: Vec<(String, u64)> = Vec::new();
    let (mut start, mut end) = (None::<Timestamp>, None::<Timestamp>);
    for message in &content.messages {
        start = Some(start.map_or(message.log_time, |t| t.min(message.log_time)));
        end = Some(end.map_or(message.log_time, |t| t.max(message.log_time)));
        match channels.iter_mut().find(|(name, _)| *name == *message.channel) {
            Some((_, count)) => *count += 1,
            None => channels.push((message.channel.to_string(), 1)),
        }
    }
    channels.sort();
    let duration_s = start.zip(end).map(|(start, end)| end.seconds_since(start));
    let damage: Vec<Value> = content
        .damage
        .iter()
        .map(|damage| json!({ "code": damage.code(), "message": damage.to_string() }))
        .collect();
    let name = file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    output.result(&json!({
        "file": file.display().to_string(),
        "id": name.filter(|name| catalog::is_log_id(name)),
        "messages": content.messages.len(),
        "start": start,
        "end": end,
        "duration_s": duration_s,
        "channels": channels.into_iter().collect::<std::collections::BTreeMap<_, _>>(),
        "damage": damage,
    }))?;
    Ok(if content.damage.is_empty() { Verdict::Done } else { Verdict::No })
}
