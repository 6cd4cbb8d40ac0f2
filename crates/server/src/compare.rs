//! All planners over the same seeded scenes (F82): how often, how fast, how short, how clear.
//!
//! Scenes come from [`motion::trial`]; all but the times, and what follows from the time given to
//! the search for the best path, is the same for the same options.

mod measure;
mod plots;
mod text;

use std::sync::Arc;

use motion::Planner;
use motion::trial::{self, Kind};
use rover::Robot;

use measure::{Edges, Method, Run, long_run, measure};
pub use plots::plots;
pub use text::markdown;

/// What to compare.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scenes of each kind.
    pub n_scenes: u64,
    /// Seed of the scenes.
    pub seed: u64,
    /// Time that the search for the best path gets for each scene (s).
    pub quality_seconds: f64,
}

/// Where it was measured, for the text.
#[derive(Debug, Clone, Default)]
pub struct Place {
    /// Name of the processor.
    pub processor: String,
    /// Threads that it runs at once.
    pub n_threads: usize,
    /// Date, if one was given.
    pub date: Option<String>,
}

/// The planners compared, in the order of tables and plots.
const PLANNERS: [(&str, Planner); 5] = [
    ("line", Planner::Line),
    ("astar", Planner::AStar),
    ("sbl", Planner::Sbl),
    ("rrt_connect", Planner::RrtConnect),
    ("auto", Planner::Auto),
];

/// Ways to call a path free, whose paths are looked at again afterward.
const CLAIMS: [(&str, Method); 5] = [
    (
        "SBL as published, no tolerances",
        Method { planner: Planner::Sbl, edges: Edges::Published, tolerances: false },
    ),
    (
        "SBL as published but smoothed to the end, no tolerances",
        Method { planner: Planner::Sbl, edges: Edges::SampledTaut, tolerances: false },
    ),
    (
        "SBL as published, the robot's tolerances",
        Method { planner: Planner::Sbl, edges: Edges::Published, tolerances: true },
    ),
    (
        "auto, certified, no tolerances",
        Method { planner: Planner::Auto, edges: Edges::Certified, tolerances: false },
    ),
    (
        "auto, certified, the robot's tolerances",
        Method { planner: Planner::Auto, edges: Edges::Certified, tolerances: true },
    ),
];

/// One scene: a run of each planner, and of each claim.
pub struct SceneRuns {
    kind: Kind,
    runs: Vec<Run>,
    claims: Vec<Run>,
    /// Length of the shortest transit that anything found (rad).
    best: f64,
}

/// All that was measured.
pub struct Comparison {
    options: Options,
    robot: Arc<Robot>,
    gravity: f64,
    scenes: Vec<SceneRuns>,
}

/// Runs all planners over the scenes that the options ask for. `progress` is told of each kind.
pub fn run(
    robot: &Arc<Robot>,
    gravity: f64,
    options: &Options,
    progress: &dyn Fn(&str),
) -> Comparison {
    let mut scenes = Vec::new();
    for kind in Kind::ALL {
        progress(kind.name());
        // Each seed has its scenes; neighboring seeds share none.
        let first = options.seed.wrapping_mul(1 << 20);
        for i in 0..options.n_scenes {
            let Some(trial) = trial::draw(robot, gravity, kind, first.wrapping_add(i)) else {
                continue;
            };
            let method = |planner| Method { planner, edges: Edges::Certified, tolerances: true };
            let runs: Vec<Run> =
                PLANNERS.iter().map(|(_, planner)| measure(&trial, &method(*planner))).collect();
            let claims = CLAIMS.iter().map(|(_, method)| measure(&trial, method)).collect();
            let shortest = runs.iter().filter_map(Run::length).fold(f64::INFINITY, f64::min);
            let best = shortest.min(long_run(&trial, options.quality_seconds));
            scenes.push(SceneRuns { kind, runs, claims, best });
        }
    }
    Comparison { options: options.clone(), robot: robot.clone(), gravity, scenes }
}

/// What the runs of one planner over some scenes say.
struct Summary<'a> {
    /// Each run with the length of the best path in its scene (rad).
    runs: Vec<(&'a Run, f64)>,
}

impl<'a> Summary<'a> {
    fn found(&self) -> impl Iterator<Item = &(&'a Run, f64)> {
        self.runs.iter().filter(|(run, _)| run.is_found())
    }

    fn over_found(&self, value: impl Fn(&Run, f64) -> f64) -> Spread {
        Spread::of(self.found().map(|(run, best)| value(run, *best)).collect())
    }

    fn share_found(&self) -> f64 {
        self.found().count() as f64 / self.runs.len().max(1) as f64
    }

    fn first_path_ms(&self) -> Spread {
        self.over_found(|run, _| 1e3 * run.first_path_s)
    }

    /// Of all requests, those without a plan too.
    fn whole_ms(&self) -> Spread {
        Spread::of(self.runs.iter().map(|(run, _)| 1e3 * run.whole_s).collect())
    }

    fn over_straight(&self) -> Spread {
        self.over_found(|run, _| run.length().unwrap_or(f64::NAN) / run.straight)
    }

    fn over_best(&self) -> Spread {
        self.over_found(|run, best| run.length().unwrap_or(f64::NAN) / best)
    }

    fn clearance_mm(&self) -> Spread {
        self.over_found(|run, _| 1e3 * run.transit_clearance)
    }
}

impl Comparison {
    fn of_kind(&self, kind: Option<Kind>) -> impl Iterator<Item = &SceneRuns> {
        self.scenes.iter().filter(move |scene| kind.is_none_or(|kind| scene.kind == kind))
    }

    /// One planner over the scenes with something in the way.
    fn summary_among_rocks(&self, planner: usize) -> Summary<'_> {
        let rocky = |scene: &&SceneRuns| !matches!(scene.kind, Kind::Open | Kind::Inward);
        let scenes = self.scenes.iter().filter(rocky);
        Summary { runs: scenes.map(|s| (&s.runs[planner], s.best)).collect() }
    }

    /// One planner over the scenes of a kind, or of all.
    fn summary(&self, planner: usize, kind: Option<Kind>) -> Summary<'_> {
        Summary { runs: self.of_kind(kind).map(|s| (&s.runs[planner], s.best)).collect() }
    }
}

/// Sorted values; asked for a share of them.
struct Spread(Vec<f64>);

impl Spread {
    fn of(mut values: Vec<f64>) -> Spread {
        values.retain(|value| !value.is_nan());
        values.sort_by(f64::total_cmp);
        Spread(values)
    }

    /// The smallest value that this share of all does not exceed.
    fn at(&self, share: f64) -> Option<f64> {
        let rank = (share * self.0.len() as f64).ceil() as usize;
        self.0.get(rank.saturating_sub(1)).copied()
    }

    fn median(&self) -> Option<f64> {
        self.at(0.5)
    }

    fn p95(&self) -> Option<f64> {
        self.at(0.95)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_has_the_values_of_its_ranks() {
        let spread = Spread::of((1..=20).rev().map(f64::from).chain([f64::NAN]).collect());
        assert_eq!((spread.median(), spread.p95()), (Some(10.0), Some(19.0)));
        assert_eq!((spread.at(0.0), spread.at(1.0)), (Some(1.0), Some(20.0)));
        assert_eq!(Spread::of(Vec::new()).median(), None);
    }
}
