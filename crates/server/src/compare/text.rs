//! A comparison as a document.

use std::collections::BTreeMap;
use std::fmt::Write;

use motion::trial::Kind;

use super::measure::{REACH, Run};
use super::plots::Plot;
use super::{CLAIMS, Comparison, PLANNERS, Place, Spread};

/// Figures of the peers on the same robot model: name, first path (ms), whole with smoothing (ms),
/// length over the straight line.
const PEERS: [[&str; 4]; 3] = [
    ["Klampt 0.10, SBL", "23.8 / 48.5", "236 / 423", "1.38"],
    ["OMPL, RRT-Connect", "24.9", "161", ""],
    ["OMPL, SBL", "49.6", "257", ""],
];

/// The document; pictures are linked as `images/compare-NAME.svg`.
pub fn markdown(comparison: &Comparison, place: &Place, plots: &[Plot]) -> String {
    let mut text = String::from("# Planners compared\n\n");
    text += &introduction(comparison, place);
    text += "\n## Reading\n";
    text += &reading(comparison);
    text += "\n## Figures\n";
    text += &columns(comparison);
    text += &table(comparison, None);
    for plot in plots {
        let _ = writeln!(text, "\n![{}](images/compare-{}.svg)", plot.title, plot.name);
    }
    for kind in Kind::ALL {
        let _ = write!(text, "\n### {}\n", capitalized(kind.name()));
        text += &table(comparison, Some(kind));
    }
    text += "\n## What is called free, and touches\n";
    text += &claims(comparison);
    text += "\n## Beside published figures\n";
    text += &peers(comparison);
    text
}

fn introduction(comparison: &Comparison, place: &Place) -> String {
    let (options, robot) = (&comparison.options, &comparison.robot);
    let date = place.date.as_ref().map_or(String::new(), |date| format!(" on {date}"));
    let n = comparison.scenes.len();
    format!(
        "Written by `footfall compare --scenes {} --seed {} --quality-seconds {}` of version {}{date}, in {n} scenes\n\
         with the robot `{}` of {:.0} kg under {} m/s². Processor: {}, {} threads at once, of which one is used. Times are\n\
         wall-clock times, the median of three requests each; other work on the machine lengthens them. All else but what\n\
         the search for the best path finds in its time is the same on every machine.\n\n\
         The scenes are of five kinds: {}. The robot stands, one of its\n\
         legs is to step, and the place is drawn by seed. Scenes in which no planner could do anything, because the wheel\n\
         cannot be put down there, lifted off or brought in from above, are drawn again. Each request is one whole step: ways to put the wheel down, lift,\n\
         transit by the planner named, smoothing, drop, and the final check.\n",
        options.n_scenes,
        options.seed,
        options.quality_seconds,
        env!("CARGO_PKG_VERSION"),
        robot.name(),
        robot.mass(),
        comparison.gravity,
        place.processor,
        place.n_threads,
        Kind::ALL.map(Kind::name).join(", "),
    )
}

/// Two paragraphs: which planner to take when.
fn reading(comparison: &Comparison) -> String {
    let index = |name: &str| PLANNERS.iter().position(|(planner, _)| *planner == name).unwrap_or(0);
    let of = |name: &str| {
        let summary = comparison.summary_among_rocks(index(name));
        format!(
            "{:.0} % found, the whole request in {} ms, {} × the best",
            100.0 * summary.share_found(),
            pair(&summary.whole_ms(), 0),
            pair(&summary.over_best(), 2),
        )
    };
    let open = comparison.summary(index("auto"), Some(Kind::Open));
    format!(
        "\nFigures here are of the scenes with rocks; pairs are median / 95th percentile.\n\n\
         **Take `auto`** unless there is a reason not to: {}. It tries the straight way in the joints first, and\n\
         on open ground that is all there is to do ({} ms). Else it starts a few short searches by random trees and keeps\n\
         the shortest path; A* and SBL come in only where these fail. `rrt_connect` alone ({}) is one such search: for\n\
         when a path is wanted soon and its length matters less.\n\n\
         **The others have narrower uses.** `sbl` ({}) is the planner of the paper: to compare with published work, or\n\
         where its budget in milestones is the measure. `astar` ({}) uses no random numbers and moves the wheel on a grid\n\
         in task space, so that its path does not change with the seed; a finer `cell_m` passes narrower places and takes\n\
         longer. `line` ({}) moves the wheel straight, which is fragile: for ground that is known to be open, and for\n\
         motions that people foresee.\n",
        of("auto"),
        pair(&open.whole_ms(), 1),
        of("rrt_connect"),
        of("sbl"),
        of("astar"),
        of("line"),
    )
}

fn columns(comparison: &Comparison) -> String {
    format!(
        "\n- *found*: share of the requests that ended with a plan that passed the final check.\n\
         - *first path*: from the request to the first path of the transit, smoothing not begun; median / 95th percentile,\n  \
           of the steps found. With `auto` it is the path chosen among its short searches.\n\
         - *whole*: from the request to the answer, of all requests.\n\
         - *checked*: configurations looked at by search and smoothing, median of all requests.\n\
         - *× straight*, *× best*: Euclidean length of the transit in the joints over that of the straight line between its\n  \
           ends, and over the shortest that any planner or a long run ({} s a scene, other seeds, every budget raised)\n  \
           found; median / 95th percentile of the steps found. A planner that finds only easy steps looks short here.\n\
         - *clearance*: nearest distance (mm) of the leg to anything in the transit, up to {:.0}; median / least, from exact\n  \
           shapes every 0.001 rad. The robot's tolerances are what is kept at least.\n",
        comparison.options.quality_seconds,
        1e3 * REACH * comparison.robot.scale(),
    )
}

fn table(comparison: &Comparison, kind: Option<Kind>) -> String {
    let mut text = String::from(
        "\n| planner | found | first path (ms) | whole (ms) | checked | × straight | × best | clearance (mm) | outcomes |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for (i, (name, _)) in PLANNERS.iter().enumerate() {
        let summary = comparison.summary(i, kind);
        let checked = Spread::of(summary.runs.iter().map(|(r, _)| r.n_checked as f64).collect());
        let clearance = summary.clearance_mm();
        let _ = writeln!(
            text,
            "| `{name}` | {:.0} % | {} | {} | {} | {} | {} | {} | {} |",
            100.0 * summary.share_found(),
            pair(&summary.first_path_ms(), 2),
            pair(&summary.whole_ms(), 1),
            figure(checked.median(), 0),
            pair(&summary.over_straight(), 2),
            pair(&summary.over_best(), 2),
            both(clearance.median(), clearance.at(0.0), 0),
            outcomes(summary.runs.iter().map(|(run, _)| *run)),
        );
    }
    text
}

fn claims(comparison: &Comparison) -> String {
    let mut text = String::from(
        "\nPublished planners look at an edge every 0.01 rad; what is thinner than the way of the leg between two looks is\n\
         missed. Here SBL with such edges, and smoothing that ends when a round wins less than 25 %, runs in the same scenes,\n\
         and the whole finished path of the leg is then looked at every 0.001 rad by exact distances, outside the search.\n\
         *Too near* is nearer than the robot's tolerances, for those who claim to keep them; *refused* are paths that our\n\
         final check would not offer. Rocks here are solid boxes, not surfaces of thin triangles, so that fewer things are\n\
         thin enough to be missed than in the scenes of the peers below; the tauter a path, the more it grazes.\n\n\
         | who calls it free | paths | touch something | too near | refused |\n|---|---|---|---|---|\n",
    );
    let line = |name: &str, runs: &[&Run], tolerances: bool| {
        let paths: Vec<&&Run> = runs.iter().filter(|run| run.has_path).collect();
        let share =
            |n: usize| format!("{n} ({:.1} %)", 100.0 * n as f64 / paths.len().max(1) as f64);
        let count = |test: &dyn Fn(&Run) -> bool| paths.iter().filter(|run| test(run)).count();
        let near = if tolerances { share(count(&|run| run.too_near)) } else { String::new() };
        format!(
            "| {name} | {} | {} | {near} | {} |\n",
            paths.len(),
            share(count(&|run| run.touches)),
            share(count(&|run| run.outcome == motion::Outcome::Refused)),
        )
    };
    for (i, (name, method)) in CLAIMS.iter().enumerate() {
        let runs: Vec<&Run> = comparison.scenes.iter().map(|s| &s.claims[i]).collect();
        text += &line(name, &runs, method.tolerances);
    }
    let all: Vec<&Run> = comparison.scenes.iter().flat_map(|s| &s.runs).collect();
    text += &line("all five planners above, certified", &all, true);
    text
}

fn peers(comparison: &Comparison) -> String {
    let auto = PLANNERS.iter().position(|(name, _)| *name == "auto").unwrap_or(0);
    let sbl = PLANNERS.iter().position(|(name, _)| *name == "sbl").unwrap_or(0);
    let mut text = String::from(
        "\nThe peers' figures were measured on the same robot model: 26 scenes of one leg stepping around a rock on fractal\n\
         ground of 32 768 triangles, meshes, one thread of a busy machine with two cores, CPU time; edges were looked at\n\
         every 0.01 rad, and 10 to 12 % of the final paths touched something when looked at every 0.001 rad. They plan the\n\
         transit alone. Ours are the scenes with a rock between, the whole step with its final check, in wall-clock time.\n\n\
         | planner | first path (ms) | smoothed (ms) | × straight | touch at 0.001 rad |\n|---|---|---|---|---|\n",
    );
    for [name, first, whole, length] in PEERS {
        let _ = writeln!(text, "| {name} | {first} | {whole} | {length} | 10-12 % |");
    }
    for (name, i) in [("`sbl`", sbl), ("`auto`", auto)] {
        let summary = comparison.summary(i, Some(Kind::Rock));
        let touches = summary.runs.iter().filter(|(run, _)| run.touches).count();
        let _ = writeln!(
            text,
            "| {name}, this program | {} | {} | {} | {touches} of {} |",
            pair(&summary.first_path_ms(), 2),
            pair(&summary.whole_ms(), 1),
            figure(summary.over_straight().median(), 2),
            summary.found().count(),
        );
    }
    text
}

/// Median / 95th percentile.
fn pair(spread: &Spread, digits: usize) -> String {
    both(spread.median(), spread.p95(), digits)
}

fn both(a: Option<f64>, b: Option<f64>, digits: usize) -> String {
    if a.is_none() {
        return String::new();
    }
    format!("{} / {}", figure(a, digits), figure(b, digits))
}

fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or(String::new(), |value| format!("{value:.digits$}"))
}

/// How requests ended, by count.
fn outcomes<'a>(runs: impl Iterator<Item = &'a Run>) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for run in runs {
        *counts.entry(run.outcome.word()).or_default() += 1;
    }
    let parts: Vec<String> = counts.iter().map(|(word, n)| format!("{n} {word}")).collect();
    parts.join(", ")
}

fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
