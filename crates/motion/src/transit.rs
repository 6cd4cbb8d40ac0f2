//! From waypoint to waypoint: the planners in their order, then smoothing.

use rover::LegAngles;

use crate::answer::{Outcome, PathPlanner, Planner, Statistics, StepRequest};
use crate::astar::AStar;
use crate::failure::{Failure, Teller};
use crate::leg_space::LegSpace;
use crate::line::wheel_line;
use crate::planner::{JointLine, PathSearch, Query, SearchOutcome};
use crate::rrt_connect::RrtConnect;
use crate::sbl::Sbl;
use crate::smooth::{SmoothOptions, smooth};
use crate::space::{WheelSpace, path_length};
use crate::watch::{Stage, Watch};

/// Configurations checked for each milestone of the work budget.
const CHECKED_PER_MILESTONE: u64 = 50;

/// Configurations that the coarse A* may check before SBL takes over (F81).
const COARSE_BUDGET: u64 = 4_000;

/// Searches by random trees that the automatic choice starts, the configurations that each may
/// check, and those for a first smoothing of each.
const STARTS: u64 = 2;
const START_BUDGET: u64 = 3_000;
const ROUGH_BUDGET: u64 = 250;

/// Finds transits for one request.
pub(crate) struct Transit<'a> {
    pub request: &'a StepRequest,
    pub teller: Teller<'a>,
    pub posture: &'a rover::Posture,
}

impl Transit<'_> {
    /// From waypoint to waypoint, smoothed; `budget` is the most milestones.
    pub fn find(
        &self,
        [from, to]: [LegAngles; 2],
        budget: usize,
        space: &mut LegSpace,
        statistics: &mut Statistics,
        watch: &mut impl Watch,
    ) -> Result<Vec<LegAngles>, Failure> {
        watch.entered(Stage::Search);
        space.last = None;
        statistics.straight = (to - from).norm();
        statistics.first_path = 0.0;
        let (first, planner) = match self.request.planner {
            Planner::Line => (self.line(&from, &to, space)?, PathPlanner::Line),
            Planner::Auto => {
                let best = self.best_of_starts([from, to], budget, space, statistics, watch)?;
                match best {
                    Some(best) => best,
                    None => {
                        let fallback: [&dyn PathSearch; 2] = [&AStar::default(), &self.sbl()];
                        self.search(&fallback, [from, to], budget, space, statistics, watch)?
                    }
                }
            }
            Planner::AStar => {
                let astar: [&dyn PathSearch; 1] = [&AStar::default()];
                self.search(&astar, [from, to], budget, space, statistics, watch)?
            }
            Planner::Sbl => {
                let sbl: [&dyn PathSearch; 1] = [&self.sbl()];
                self.search(&sbl, [from, to], budget, space, statistics, watch)?
            }
            Planner::RrtConnect => {
                let rrt: [&dyn PathSearch; 1] = [&RrtConnect::default()];
                self.search(&rrt, [from, to], budget, space, statistics, watch)?
            }
        };
        statistics.planner = Some(planner);
        if statistics.first_path == 0.0 {
            statistics.first_path = path_length(&first);
        }
        watch.entered(Stage::Smoothing);
        let smoothed = smooth(space, &first, &self.request.smooth, watch)?;
        statistics.n_edges += smoothed.n_edges;
        statistics.length = path_length(&smoothed.path);
        Ok(smoothed.path)
    }

    /// The straight way in joint space, else the best of a few short searches that differ in their
    /// seeds: random trees find a way around in a fraction of a millisecond, but not always the
    /// shortest one.
    fn best_of_starts(
        &self,
        [start, goal]: [LegAngles; 2],
        max_nodes: usize,
        space: &mut LegSpace,
        statistics: &mut Statistics,
        watch: &mut impl Watch,
    ) -> Result<Option<(Vec<LegAngles>, PathPlanner)>, Failure> {
        let request = self.request;
        let mut query = Query {
            start,
            goal,
            seed: request.seed,
            budget: START_BUDGET,
            max_nodes,
            cell: request.cell,
        };
        let mut best: Option<Vec<LegAngles>> = None;
        for run in 0..=STARTS {
            watch.entered(Stage::Search);
            let planner: &dyn PathSearch =
                if run == 0 { &JointLine } else { &RrtConnect::default() };
            query.seed = request.seed.wrapping_mul(STARTS + 1).wrapping_add(run);
            let result = planner.search(space, &query, watch);
            statistics.n_milestones += result.n_nodes;
            statistics.n_edges += result.n_edges;
            match result.outcome {
                SearchOutcome::Found(path) if run == 0 => {
                    return Ok(Some((path, PathPlanner::JointLine)));
                }
                SearchOutcome::Found(path) => {
                    if best.is_none() {
                        statistics.first_path = path_length(&path);
                    }
                    watch.entered(Stage::Smoothing);
                    let rough = SmoothOptions { max_checked: ROUGH_BUDGET, ..request.smooth };
                    let rough = smooth(space, &path, &rough, watch)?;
                    statistics.n_edges += rough.n_edges;
                    let shorter = best
                        .as_ref()
                        .is_none_or(|best| path_length(&rough.path) < path_length(best));
                    if shorter {
                        best = Some(rough.path);
                    }
                }
                SearchOutcome::Stopped(stopped) => return Err(stopped.into()),
                SearchOutcome::NotFound { .. } => {}
            }
        }
        Ok(best.map(|path| (path, PathPlanner::RrtConnect)))
    }

    fn sbl(&self) -> Sbl {
        Sbl { closeness: self.request.sbl.closeness }
    }

    /// One planner after the other, until one finds a path.
    fn search(
        &self,
        planners: &[&dyn PathSearch],
        [start, goal]: [LegAngles; 2],
        max_nodes: usize,
        space: &mut LegSpace,
        statistics: &mut Statistics,
        watch: &mut impl Watch,
    ) -> Result<(Vec<LegAngles>, PathPlanner), Failure> {
        let mut n_nodes = 0;
        for planner in planners {
            let all = max_nodes as u64 * CHECKED_PER_MILESTONE;
            let coarse = planners.len() > 1 && planner.name() == PathPlanner::AStar;
            let budget = if coarse { all.min(COARSE_BUDGET) } else { all };
            let seed = self.request.seed;
            let query = Query { start, goal, seed, budget, max_nodes, cell: self.request.cell };
            let result = planner.search(space, &query, watch);
            n_nodes += result.n_nodes;
            statistics.n_milestones += result.n_nodes;
            statistics.n_edges += result.n_edges;
            match result.outcome {
                SearchOutcome::Found(path) => return Ok((path, planner.name())),
                SearchOutcome::Stopped(stopped) => return Err(stopped.into()),
                SearchOutcome::NotFound { .. } => {}
            }
        }
        let met = space.last.map_or(String::new(), |blocked| {
            format!("; last in the way: {}", self.teller.blocked_text(&blocked))
        });
        let text = format!(
            "no path within {n_nodes} milestones, which is no proof that there is none{met}"
        );
        Err(Failure::new(7, Outcome::NoPath, text).by("search", None, "m"))
    }

    /// The wheel along a straight line (F59).
    fn line(
        &self,
        from: &LegAngles,
        to: &LegAngles,
        space: &mut LegSpace,
    ) -> Result<Vec<LegAngles>, Failure> {
        let robot = self.teller.scene.robot();
        let goal = space.wheel(to);
        let no_path = |text: String| Failure::new(7, Outcome::NoPath, text);
        let mut knots = wheel_line(robot, self.posture, self.teller.leg, from, &goal)
            .map_err(|_| no_path("the straight line of the wheel leaves its reach".into()))?;
        let end = knots.len() - 1;
        if (knots[end] - to).amax() > 1e-3 {
            return Err(no_path("the straight line ends on another branch of the leg".into()));
        }
        knots[end] = *to;
        match space.blocked_along(&knots) {
            None => Ok(knots),
            Some(blocked) => {
                let text = format!("on the straight line {}", self.teller.blocked_text(&blocked));
                Err(no_path(text).by_blocked(&blocked))
            }
        }
    }
}
