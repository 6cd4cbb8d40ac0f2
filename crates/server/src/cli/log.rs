//! Flight logs on the command line.
//!
//! Exit status: 0 nothing is lost or wrong; 1 the answer is no (not as written, nothing recovered, an
//! empty clip); 2 unusable input; 3 done, but something was lost on the way, or a fault.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bridge::catalog;
use bridge::clip::{self, ClipNote, Selection};
use bridge::doctor::{self, Severity};
use bridge::reader::{Damage, IndexedLog, Limits, ReadError};
use bridge::recorder::LogFolder;
use bridge::rewrite::Contents;
use bridge::verify;
use clap::Subcommand;
use serde_json::{Value, json};
use wire::check::{At, RequestError};
use wire::time::Timestamp;

use super::{Failure, Output, Verdict};
use crate::config::Config;
use crate::error::ApiError;
use crate::imaging;
use crate::reconstruction::rebuild::{self, Basis, Outcome, Rebuilt};
use crate::robots::Robots;
use crate::serve::{self, Mission};
use crate::stop::Stop;

/// Flight logs.
#[derive(Debug, Subcommand)]
pub(super) enum LogCommand {
    /// What is in flight logs, and what is wrong with them; exit status 1 if anything is.
    Info {
        /// MCAP files, or folders of a log's segments.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Whether logs are as they were written: MCAP files by the rules of the format, folders of logs
    /// by their seals, too; exit status 1 if not.
    Verify {
        /// MCAP files, or folders of logs (for one log, the folder of all with --log).
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// Verify this log of the folder only.
        #[arg(long, value_name = "ID")]
        log: Option<String>,
    },
    /// Make every version of the map that cameras made again, from the images in the log, and tell whether
    /// each is the same, byte for byte; exit status 1 if one is not.
    Rebuild {
        /// MCAP files of one log, in order, or the folder of its segments.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// The configuration that the session was begun with: robot, and the map from before.
        #[arg(long, value_name = "FILE")]
        config: Option<PathBuf>,
    },
    /// Write what can be read of a damaged log to a new, complete file; exit status 3 if something
    /// is lost, 1 if nothing can be read.
    Recover {
        /// MCAP files of one log, in order, or the folder of its segments.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// The file to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Write a part of a log to a new file; exit status 1 if nothing is in it, 3 if the log is damaged.
    Clip {
        /// MCAP files of one log, in order, or the folder of its segments.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// From this time on (RFC 3339, by the time of receipt).
        #[arg(long, value_name = "TIME")]
        from: Option<String>,
        /// Up to and with this time.
        #[arg(long, value_name = "TIME")]
        to: Option<String>,
        /// A channel; may be given several times. All where absent.
        #[arg(long = "channel", value_name = "NAME")]
        channels: Vec<String>,
        /// The file to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

pub(super) fn log(command: &LogCommand, output: Output) -> Result<Verdict, Failure> {
    match command {
        LogCommand::Info { files } => info(files, output),
        LogCommand::Verify { files, log } => verify(files, log.as_deref(), output),
        LogCommand::Rebuild { files, config } => rebuild(files, config.as_deref(), output),
        LogCommand::Recover { files, out } => {
            write(files, &Selection::default(), "recovered_from", out, output)
        }
        LogCommand::Clip { files, from, to, channels, out } => {
            let time = |name: &str, text: &Option<String>| -> Result<_, Failure> {
                let parse = |text: &String| {
                    Timestamp::from_rfc3339(text).map_err(|error| {
                        Failure::from(RequestError::new("wrong_type", format!("{name}: {error}")))
                    })
                };
                text.as_ref().map(parse).transpose()
            };
            let (from, to) = (time("--from", from)?, time("--to", to)?);
            let channels = (!channels.is_empty()).then(|| channels.iter().cloned().collect());
            write(files, &Selection { from, to, channels }, "clip_of", out, output)
        }
    }
}

fn unreadable(path: &Path, error: ReadError) -> Failure {
    let ApiError(info) = error.into();
    let code = if info.code == "log_too_large" { "log_too_large" } else { "log_damaged" };
    RequestError::new(code, format!("{}: {}", path.display(), info.message)).into()
}

/// The files that are meant: a folder stands for the segments in it.
fn expand(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let absolute = path.canonicalize().map_err(|e| unreadable(path, e.into()))?;
        let log = absolute.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let folder = absolute.parent().unwrap_or(&absolute);
        files.extend(catalog::log_files(folder, log).map_err(|e| unreadable(path, e))?);
    }
    Ok(files)
}

/// What is wrong, without the end of a file that is cut clean where it is still being written.
fn told(damage: &[Damage]) -> Vec<Value> {
    damage.iter().map(|d| json!({ "code": d.code(), "message": d.to_string() })).collect()
}

fn contents(contents: &Contents) -> Value {
    let channels: BTreeMap<&String, u64> =
        contents.channels.iter().map(|(name, count)| (name, count.messages)).collect();
    json!({
        "messages": contents.messages,
        "start": contents.start,
        "end": contents.end,
        "duration_s": contents.start.zip(contents.end).map(|(a, b)| b.seconds_since(a)),
        "channels": channels,
    })
}

fn merge(value: &mut Value, more: Value) {
    if let (Some(map), Value::Object(more)) = (value.as_object_mut(), more) {
        map.extend(more);
    }
}

/// One answer for one file, a list for more.
fn answer(mut list: Vec<Value>, name: &str) -> Value {
    if list.len() == 1 { list.remove(0) } else { json!({ name: list }) }
}

fn info(paths: &[PathBuf], output: Output) -> Result<Verdict, Failure> {
    let (mut list, mut sound) = (Vec::new(), true);
    for path in paths {
        let (mut counted, mut damage) = (Contents::default(), Vec::new());
        for file in expand(std::slice::from_ref(path))? {
            let source = std::fs::File::open(&file).map_err(|e| unreadable(&file, e.into()))?;
            let limits = Limits { total_bytes: usize::MAX, ..Limits::default() };
            let met = bridge::reader::scan(std::io::BufReader::new(source), limits, |message| {
                counted.count(&message);
                true
            });
            damage.extend(met.map_err(|error| unreadable(&file, error))?);
        }
        let hard = damage.iter().find(|d| !matches!(d, Damage::Torn { .. }));
        if let (0, Some(first)) = (counted.messages, hard) {
            return Err(unreadable(path, first.clone().into()));
        }
        sound &= damage.is_empty();
        let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let mut value = json!({
            "file": path.display().to_string(),
            "id": name.filter(|name| catalog::is_log_id(name)),
            "damage": told(&damage),
        });
        merge(&mut value, contents(&counted));
        list.push(value);
    }
    output.result(&answer(list, "logs"))?;
    Ok(if sound { Verdict::Done } else { Verdict::No })
}

fn verify(paths: &[PathBuf], log: Option<&str>, output: Output) -> Result<Verdict, Failure> {
    let (mut list, mut sound) = (Vec::new(), true);
    for path in paths {
        let failed = |error: std::io::Error| unreadable(path, error.into());
        if path.is_dir() {
            let found = verify::verify(&LogFolder::new(path), log).map_err(failed)?;
            sound &= found.problems.is_empty();
            let problem = |p: &verify::Problem| json!({ "log": p.log, "segment": p.segment, "message": p.text });
            let head = found.head.as_ref().map(
                |head| json!({ "log": head.log, "segment": head.segment, "blake3": head.blake3 }),
            );
            list.push(json!({
                "folder": path.display().to_string(),
                "sound": found.sound,
                "open": found.open.iter().map(|(log, n)| json!({ "log": log, "segment": n })).collect::<Vec<_>>(),
                "problems": found.problems.iter().map(problem).collect::<Vec<_>>(),
                "lost_before_sealing": found.lost.iter().map(problem).collect::<Vec<_>>(),
                "head": head,
            }));
            continue;
        }
        let limits = Limits { ratio: u64::MAX, ..Limits::default() };
        let file = std::fs::File::open(path).map_err(failed)?;
        let examined = doctor::examine(std::io::BufReader::new(file), limits).map_err(failed)?;
        sound &= examined.findings.is_empty();
        let finding = |f: &doctor::Finding| {
            let warning = f.severity == Severity::Warning;
            json!({ "severity": if warning { "warning" } else { "error" }, "at": f.at, "message": f.text })
        };
        list.push(json!({
            "file": path.display().to_string(),
            "bytes": examined.bytes,
            "messages": examined.messages,
            "blake3": examined.blake3,
            "findings": examined.findings.iter().map(finding).collect::<Vec<_>>(),
        }));
    }
    output.result(&answer(list, "files"))?;
    Ok(if sound { Verdict::Done } else { Verdict::No })
}

fn rebuild(paths: &[PathBuf], config: Option<&Path>, output: Output) -> Result<Verdict, Failure> {
    let config = match config {
        None => Config::demo(),
        Some(path) => Config::load(path)
            .map_err(|error| RequestError::new("config_invalid", error.to_string()))?,
    };
    let Mission { config, root, .. } = Mission::of(config);
    let config = Arc::new(config);
    let dirs = Some(config.server.robots_dir.clone()).filter(|dir| !dir.as_os_str().is_empty());
    let robots = Arc::new(Robots::new(dirs.into_iter().collect()));
    let robot = serve::robot(&config, &robots)?;
    let rig = imaging::rig(&At::root("rover"), &robots, &config.rover.robot, &robot)?;
    let ground = serve::first_map(&config, root)?;
    let files = expand(paths)?;
    let first = files.first().cloned().unwrap_or_default();
    let mut log =
        IndexedLog::open(&files, Limits::default()).map_err(|error| unreadable(&first, error))?;
    // Other logs are where the folder of this one is.
    let logs_dir = paths.first().filter(|path| path.is_dir()).and_then(|path| path.parent());
    let logs_dir = logs_dir.map(Path::to_owned);
    let basis = Basis { robot: &robot, rig: &rig, ground: &ground, logs_dir };
    let failed = |ApiError(info): ApiError| RequestError::new("log_damaged", info.message);
    let versions = rebuild::rebuild(&mut log, &basis, &Stop::within(f64::MAX)).map_err(failed)?;
    let told = |rebuilt: &Rebuilt| match &rebuilt.outcome {
        Outcome::Same => json!({ "version": rebuilt.version, "same": true }),
        Outcome::Differs { version, blended } => json!({
            "version": rebuilt.version, "same": false, "rebuilt": version, "blended": blended
        }),
        Outcome::Lacks { why } => {
            json!({ "version": rebuilt.version, "same": false, "message": why })
        }
    };
    let list: Vec<Value> = versions.iter().map(told).collect();
    output.result(&json!({ "versions": list, "damage": self::told(log.damage()) }))?;
    let all_same = versions.iter().all(|rebuilt| rebuilt.outcome == Outcome::Same);
    Ok(if all_same { Verdict::Done } else { Verdict::No })
}

fn write(
    paths: &[PathBuf],
    selection: &Selection,
    key: &str,
    out: &Path,
    output: Output,
) -> Result<Verdict, Failure> {
    let files = expand(paths)?;
    for file in &files {
        std::fs::File::open(file).map_err(|error| unreadable(file, error.into()))?;
    }
    if out.exists() {
        let message = format!("{} is there already; name another file", out.display());
        return Err(RequestError::new("output_unwritable", message).into());
    }
    let names: Vec<_> = files.iter().map(|file| file.display().to_string()).collect();
    let mut texts = BTreeMap::from([(key.to_owned(), names.join(" "))]);
    let text = |time: Option<Timestamp>| time.map(Timestamp::to_rfc3339);
    texts.extend(text(selection.from).map(|text| ("from".to_owned(), text)));
    texts.extend(text(selection.to).map(|text| ("to".to_owned(), text)));
    let note = ClipNote { texts, bookmarks: None };
    // Any file of any size: nothing but the chunk at hand is in memory.
    let limits = Limits { ratio: u64::MAX, ..Limits::default() };
    let clipped = clip::copy_to(&files, selection, &note, out, limits).map_err(|error| {
        let message = format!("{}: {error}", out.display());
        RequestError::new("output_unwritable", message)
    })?;
    let mut value = json!({ "file": out.display().to_string(), "damage": told(&clipped.damage) });
    merge(&mut value, contents(&clipped.contents));
    output.result(&value)?;
    Ok(match (clipped.contents.messages, clipped.damage.is_empty()) {
        (0, _) => Verdict::No,
        (_, false) => Verdict::Lossy,
        (_, true) => Verdict::Done,
    })
}
