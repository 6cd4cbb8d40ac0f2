//! What every planner is asked and answers, so that planners can be exchanged (F60).

use rover::LegAngles;

use crate::answer::PathPlanner;
use crate::space::{Space, WheelSpace};
use crate::watch::{Stopped, Watch};

/// A path wanted, and what may be spent on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    /// Where the path begins (rad); must be free.
    pub start: LegAngles,
    /// Where it ends (rad); must be free.
    pub goal: LegAngles,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Most configurations checked; an edge that has been begun is finished.
    pub budget: u64,
    /// Most milestones of a tree planner, or grid nodes expanded by A*.
    pub max_nodes: usize,
    /// Side of the cells of a grid in task space (m).
    pub cell: f64,
}

/// How a search ended.
#[derive(Debug, Clone, PartialEq)]
pub enum SearchOutcome {
    /// A path from start to goal, both included, each edge free by the rule of the space.
    Found(Vec<LegAngles>),
    /// No path; there may be one all the same (F73, F74).
    NotFound {
        /// Nothing was left to search: a finer grid may still hold a path. Else the work budget
        /// was spent.
        exhausted: bool,
    },
    /// Stopped from outside.
    Stopped(Stopped),
}

/// The outcome and the work it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// How it ended.
    pub outcome: SearchOutcome,
    /// Milestones or grid nodes made, start and goal included.
    pub n_nodes: usize,
    /// Configurations checked.
    pub n_checked: u64,
    /// Edges whose test was begun.
    pub n_edges: u64,
}

/// A way to search a path for one leg. The result depends on the space and the query alone,
/// unless `watch` stops it.
pub trait PathSearch {
    /// The planner that this is.
    fn name(&self) -> PathPlanner;
    /// Searches a path from start to goal.
    fn search(&self, space: &mut dyn WheelSpace, query: &Query, watch: &mut dyn Watch) -> Search;
}

/// The straight line in joint space: one edge, free or not.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JointLine;

impl PathSearch for JointLine {
    fn name(&self) -> PathPlanner {
        PathPlanner::JointLine
    }

    fn search(&self, space: &mut dyn WheelSpace, query: &Query, watch: &mut dyn Watch) -> Search {
        let mut meter = Meter::new(space, query);
        let outcome = match meter.must_end(space, watch) {
            Some(end) => end,
            None if meter.edge_is_free(space, &query.start, &query.goal) => {
                SearchOutcome::Found(vec![query.start, query.goal])
            }
            None => SearchOutcome::NotFound { exhausted: true },
        };
        meter.end(space, outcome, 2)
    }
}

/// Counts the work of one search against its budget.
pub(crate) struct Meter {
    checked_before: u64,
    budget: u64,
    /// Edges whose test was begun.
    pub n_edges: u64,
}

impl Meter {
    pub fn new(space: &(impl Space + ?Sized), query: &Query) -> Meter {
        Meter { checked_before: space.n_checked(), budget: query.budget, n_edges: 0 }
    }

    /// The end of the search if it was stopped or its budget is spent.
    pub fn must_end(
        &self,
        space: &(impl Space + ?Sized),
        watch: &mut dyn Watch,
    ) -> Option<SearchOutcome> {
        if let Some(stopped) = watch.stopped() {
            return Some(SearchOutcome::Stopped(stopped));
        }
        self.is_spent(space).then_some(SearchOutcome::NotFound { exhausted: false })
    }

    pub fn is_spent(&self, space: &(impl Space + ?Sized)) -> bool {
        space.n_checked() - self.checked_before >= self.budget
    }

    pub fn edge_is_free(
        &mut self,
        space: &mut (impl Space + ?Sized),
        a: &LegAngles,
        b: &LegAngles,
    ) -> bool {
        self.n_edges += 1;
        space.edge_is_free(a, b)
    }

    pub fn end(
        self,
        space: &(impl Space + ?Sized),
        outcome: SearchOutcome,
        n_nodes: usize,
    ) -> Search {
        let n_checked = space.n_checked() - self.checked_before;
        Search { outcome, n_nodes, n_checked, n_edges: self.n_edges }
    }
}
