//! The analyses on the command line: the same bodies as over HTTP, from a file or standard input.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;
use tokio::time::Instant;
use wire::analysis::{
    InverseKinematicsRequest, KinematicsRequest, PlanRequest, PostureOutcome, PostureRequest,
    REACHABLE, ReachabilityRequest, StabilityRequest, TraversabilityRequest,
};
use wire::check::RequestError;

use super::{Common, Failure, Output, Verdict};
use crate::analyses;
use crate::body;
use crate::config::Config;
use crate::robots::Robots;
use crate::scene::Context;
use crate::stop::Stop;
use crate::terrains::{FileRoot, Terrains};

/// Largest request that is read (bytes).
const REQUEST_BYTES_MAX: u64 = 256 << 20;

/// A request and how often to answer it.
#[derive(Debug, Args)]
pub(super) struct RequestArgs {
    /// The request: a JSON file, or - for standard input.
    #[arg(value_name = "REQUEST.json")]
    request: PathBuf,
    /// Answer it N times, warm, and print {"runs": [N answers]}, each with its statistics.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: Option<u32>,
    #[command(flatten)]
    common: Common,
}

/// A request for traversability.
#[derive(Debug, Args)]
pub(super) struct TraversabilityArgs {
    #[command(flatten)]
    request: RequestArgs,
    /// Write the layers as bands of this GeoTIFF instead of printing them.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Settings and robots of a command.
pub(super) fn config(common: &Common) -> Result<Config, Failure> {
    match &common.config {
        None => Ok(Config::demo()),
        Some(path) => Config::load(path)
            .map_err(|e| RequestError::new("config_invalid", e.to_string()).into()),
    }
}

/// What requests are resolved against; terrain files are relative to `folder`.
pub(super) fn context_in(common: &Common, folder: PathBuf) -> Result<Context, Failure> {
    let config = config(common)?;
    let mut dirs = common.robots.clone();
    if !config.server.robots_dir.as_os_str().is_empty() {
        dirs.push(config.server.robots_dir.clone());
    }
    Ok(Context {
        robots: Arc::new(Robots::new(dirs)),
        terrains: Arc::new(Terrains::new(FileRoot::Relative(folder), None)),
        config: Arc::new(config),
        live: None,
    })
}

fn context(args: &RequestArgs) -> Result<Context, Failure> {
    let folder = match args.request.parent() {
        Some(folder) if args.request != Path::new("-") => folder.to_owned(),
        _ => PathBuf::new(),
    };
    context_in(&args.common, folder)
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    let unreadable = |error: std::io::Error| {
        let message = format!("the request {} cannot be read: {error}", path.display());
        RequestError::new("request_unreadable", message)
    };
    let mut text = Vec::new();
    let source: Box<dyn Read> = if path == Path::new("-") {
        Box::new(std::io::stdin().lock())
    } else {
        Box::new(std::fs::File::open(path).map_err(unreadable)?)
    };
    source.take(REQUEST_BYTES_MAX + 1).read_to_end(&mut text).map_err(unreadable)?;
    if text.len() as u64 > REQUEST_BYTES_MAX {
        let message = format!("the request has more than {REQUEST_BYTES_MAX} bytes; split it");
        return Err(RequestError::new("too_many", message).into());
    }
    Ok(body::parse(&text)?)
}

/// Answers a request once, or as often as asked for.
fn answer<A: Serialize>(
    args: &RequestArgs,
    output: Output,
    mut compute: impl FnMut(&Context) -> Result<(A, Verdict), RequestError>,
) -> Result<Verdict, Failure> {
    let context = context(args)?;
    let encode = |answer: &A| {
        serde_json::to_value(answer)
            .map_err(|error| Failure::Fault(format!("the answer cannot be written: {error}")))
    };
    let Some(n) = args.repeat else {
        let (answer, verdict) = compute(&context)?;
        output.result(&encode(&answer)?)?;
        return Ok(verdict);
    };
    compute(&context)?; // warms up: files are read, robots loaded
    let (mut runs, mut last) = (Vec::new(), Verdict::Done);
    for _ in 0..n {
        let start = Instant::now();
        let (answer, verdict) = compute(&context)?;
        let total_ms = 1e3 * start.elapsed().as_secs_f64();
        let mut run = encode(&answer)?;
        if let Some(object) = run.as_object_mut() {
            let statistics = object.entry("statistics").or_insert_with(|| json!({}));
            if let Some(statistics) = statistics.as_object_mut() {
                statistics.insert("total_ms".into(), json!(total_ms));
            }
        }
        runs.push(run);
        last = verdict;
    }
    output.result(&json!({ "runs": runs }))?;
    Ok(last)
}

fn verdict(yes: bool) -> Verdict {
    if yes { Verdict::Done } else { Verdict::No }
}

pub(super) fn plan(args: &RequestArgs, output: Output) -> Result<Verdict, Failure> {
    let request: PlanRequest = read(&args.request)?;
    answer(args, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        let answer = analyses::plan(context, &request, &stop, &|_, _| {})?.answer;
        let verdict = verdict(answer.outcome == "found");
        Ok((answer, verdict))
    })
}

pub(super) fn posture(args: &RequestArgs, output: Output) -> Result<Verdict, Failure> {
    let request: PostureRequest = read(&args.request)?;
    answer(args, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        let answer = analyses::posture(context, &request, &stop, &|_, _| {})?;
        let advice = answer.advice.as_ref();
        let yes = advice.is_none_or(|advice| advice.outcome != PostureOutcome::Best);
        Ok((answer, verdict(yes)))
    })
}

pub(super) fn stability(args: &RequestArgs, output: Output) -> Result<Verdict, Failure> {
    let request: StabilityRequest = read(&args.request)?;
    answer(args, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        let answer = analyses::stability(context, &request, &stop)?;
        let yes = answer.cases.is_empty() || answer.cases.iter().any(|case| case.stable);
        Ok((answer, verdict(yes)))
    })
}

pub(super) fn kinematics(args: &RequestArgs, output: Output) -> Result<Verdict, Failure> {
    let request: KinematicsRequest = read(&args.request)?;
    answer(args, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        Ok((analyses::kinematics(context, &request, &stop)?, Verdict::Done))
    })
}

pub(super) fn inverse_kinematics(args: &RequestArgs, output: Output) -> Result<Verdict, Failure> {
    let request: InverseKinematicsRequest = read(&args.request)?;
    answer(args, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        let answer = analyses::inverse_kinematics(context, &request, &stop)?;
        let targets = &answer.targets;
        let yes = targets.is_empty() || targets.iter().any(|t| !t.solutions.is_empty());
        Ok((answer, verdict(yes)))
    })
}

pub(super) fn reachability(args: &RequestArgs, output: Output) -> Result<Verdict, Failure> {
    let request: ReachabilityRequest = read(&args.request)?;
    let workers = std::thread::available_parallelism().map_or(1, |n| n.get());
    answer(args, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        let reached = analyses::reachability(context, &request, workers, &stop)?;
        let yes = reached.iter().any(|(_, cells)| cells.class.contains(&REACHABLE));
        Ok((analyses::reachability_answer(&reached), verdict(yes)))
    })
}

pub(super) fn traversability(
    args: &TraversabilityArgs,
    output: Output,
) -> Result<Verdict, Failure> {
    let request: TraversabilityRequest = read(&args.request.request)?;
    answer(&args.request, output, |context| {
        let stop = Stop::after(request.deadline_s)?;
        let judged = analyses::traversability(context, &request, &stop)?;
        let Some(path) = &args.out else { return Ok((judged.to_answer()?, Verdict::Done)) };
        std::fs::write(path, judged.to_geotiff()?).map_err(|error| {
            let message = format!("the file {} cannot be written: {error}", path.display());
            RequestError::new("output_unwritable", message)
        })?;
        let mut summary = judged.summary();
        summary.file = Some(path.display().to_string());
        Ok((summary, Verdict::Done))
    })
}
