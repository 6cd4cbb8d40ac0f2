//! `footfall compare`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;
use wire::check::{self, At, RequestError};
use wire::scene::Scene as WireScene;

use super::{Common, Failure, Output, Verdict};
use crate::compare::{self, Options, Place};
use crate::scene::Context;

/// What to compare, and where to write it.
#[derive(Debug, Args)]
pub(super) struct CompareArgs {
    /// Scenes of each of the five kinds.
    #[arg(long, value_name = "N", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=10_000))]
    scenes: u64,
    /// Seed of the scenes.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Write the document here and its plots into `images/` beside it, instead of printing it.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Time (s) that the search for the best path gets in each scene.
    #[arg(long, value_name = "T", default_value_t = 2.0)]
    quality_seconds: f64,
    /// Robot, in its first pose; the configured one, with its payload, where absent.
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Date that the document names.
    #[arg(long, value_name = "DATE")]
    date: Option<String>,
    #[command(flatten)]
    common: Common,
}

pub(super) fn compare(args: &CompareArgs, output: Output) -> Result<Verdict, Failure> {
    let quality_seconds =
        check::within(&At::root("--quality-seconds"), args.quality_seconds, [0.0, 3600.0], " s")?;
    let context = super::analyze::context_in(&args.common, PathBuf::new())?;
    let rover = &context.config.rover;
    let name = args.robot.as_ref().unwrap_or(&rover.robot);
    // The configured payload belongs to the configured robot.
    let configured = *name == rover.robot;
    let scene = WireScene {
        robot: Some(name.clone()),
        scale: configured.then_some(rover.scale),
        payloads: configured.then(|| rover.payloads()),
        ..WireScene::default()
    };
    let robot = context.robot(&At::root("--robot"), &scene)?;
    let options = Options { n_scenes: args.scenes, seed: args.seed, quality_seconds };
    let progress = |kind: &str| output.say(&format!("{kind}: {} scenes", args.scenes));
    let compared = compare::run(&robot, gravity(&context), &options, &progress);
    let plots = compare::plots(&compared);
    let place = Place { date: args.date.clone(), ..here() };
    let text = compare::markdown(&compared, &place, &plots);
    let Some(path) = &args.out else {
        return output.text(&text).map(|()| Verdict::Done);
    };
    let folder = path.parent().unwrap_or(Path::new("")).join("images");
    write(path, &text)?;
    std::fs::create_dir_all(&folder).map_err(|error| unwritable(&folder, &error))?;
    let mut files = vec![path.display().to_string()];
    for plot in &plots {
        let file = folder.join(format!("compare-{}.svg", plot.name));
        write(&file, &plot.svg)?;
        files.push(file.display().to_string());
    }
    output.result(&json!({ "files": files }))?;
    Ok(Verdict::Done)
}

fn gravity(context: &Context) -> f64 {
    context.config.rover.gravity_m_s2
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|error| unwritable(path, &error))
}

fn unwritable(path: &Path, error: &std::io::Error) -> Failure {
    let message = format!("the file {} cannot be written: {error}", path.display());
    RequestError::new("output_unwritable", message).into()
}

/// The processor, as the system names it.
fn here() -> Place {
    let information = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let of_model =
        |line: &str| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim().to_owned());
    Place {
        processor: information.lines().find_map(of_model).unwrap_or_else(|| "unknown".into()),
        n_threads: std::thread::available_parallelism().map_or(1, |n| n.get()),
        date: None,
    }
}
