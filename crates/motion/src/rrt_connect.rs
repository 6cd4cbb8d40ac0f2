//! RRT-Connect (Kuffner and LaValle, ICRA 2000): two trees that grow toward random angles and then
//! greedily toward each other.
//!
//! Distances are Euclidean in the joints (rad). Every edge is tested when it is made, by the rule
//! of the space. Failure within the work budget is no proof that there is no path.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::LegAngles;

use crate::answer::PathPlanner;
use crate::nearest::Points;
use crate::planner::{Meter, PathSearch, Query, Search, SearchOutcome};
use crate::space::{Space, WheelSpace, along, sample_between};
use crate::watch::Watch;

/// Share of the rounds that aim at the other tree's root.
const AIMED: f64 = 0.05;

/// The planner, with its only parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RrtConnect {
    /// Longest edge (rad, Euclidean).
    pub step: f64,
}

impl Default for RrtConnect {
    fn default() -> RrtConnect {
        RrtConnect { step: 0.6 }
    }
}

impl PathSearch for RrtConnect {
    fn name(&self) -> PathPlanner {
        PathPlanner::RrtConnect
    }

    fn search(&self, space: &mut dyn WheelSpace, query: &Query, watch: &mut dyn Watch) -> Search {
        plan(space, query, self.step, watch)
    }
}

/// Searches a path with edges of at most `step` (rad, Euclidean).
pub fn plan(space: &mut dyn Space, query: &Query, step: f64, watch: &mut dyn Watch) -> Search {
    let mut growth = Growth {
        trees: [Tree::new(&query.start), Tree::new(&query.goal)],
        meter: Meter::new(space, query),
        step,
        max_nodes: query.max_nodes,
    };
    let outcome = match growth.run(space, query, watch) {
        Ok(path) => SearchOutcome::Found(path),
        Err(end) => end,
    };
    let n_nodes = growth.n_nodes();
    growth.meter.end(space, outcome, n_nodes)
}

struct Tree {
    points: Points,
    nodes: Vec<LegAngles>,
    parents: Vec<usize>,
}

impl Tree {
    fn new(root: &LegAngles) -> Tree {
        let mut tree = Tree { points: Points::default(), nodes: Vec::new(), parents: Vec::new() };
        tree.add(root, 0);
        tree
    }

    fn add(&mut self, angles: &LegAngles, parent: usize) -> usize {
        self.points.push(angles);
        self.nodes.push(*angles);
        self.parents.push(parent);
        self.nodes.len() - 1
    }

    /// From a node to the root, both included.
    fn to_root(&self, node: usize) -> Vec<LegAngles> {
        let up = |i: &usize| (*i != 0).then(|| self.parents[*i]);
        std::iter::successors(Some(node), up).map(|i| self.nodes[i]).collect()
    }
}

/// What became of a step toward a target.
enum Grown {
    Blocked,
    /// The new node, still short of the target.
    Nearer(usize),
    /// The new node, at the target.
    Reached(usize),
}

struct Growth {
    trees: [Tree; 2],
    meter: Meter,
    step: f64,
    max_nodes: usize,
}

impl Growth {
    fn n_nodes(&self) -> usize {
        self.trees[0].nodes.len() + self.trees[1].nodes.len()
    }

    fn run(
        &mut self,
        space: &mut dyn Space,
        query: &Query,
        watch: &mut dyn Watch,
    ) -> Result<Vec<LegAngles>, SearchOutcome> {
        let mut rng = ChaCha8Rng::seed_from_u64(query.seed);
        let mut target = query.goal;
        let mut here = 0;
        loop {
            self.may_go_on(space, watch)?;
            let from = self.nearest(here, &target);
            if let Grown::Nearer(node) | Grown::Reached(node) =
                self.grow(space, here, from, &target)
                && let Some(other) = self.connect(space, here, node, watch)?
            {
                let (a, b) = if here == 0 { (node, other) } else { (other, node) };
                return Ok(self.path(a, b));
            }
            here = 1 - here;
            target = if rng.random_bool(AIMED) {
                self.trees[1 - here].nodes[0]
            } else {
                sample(space, query, &mut rng)
            };
        }
    }

    fn may_go_on(&self, space: &dyn Space, watch: &mut dyn Watch) -> Result<(), SearchOutcome> {
        if self.n_nodes() >= self.max_nodes {
            return Err(SearchOutcome::NotFound { exhausted: false });
        }
        self.meter.must_end(space, watch).map_or(Ok(()), Err)
    }

    fn nearest(&self, tree: usize, target: &LegAngles) -> usize {
        // A tree always has its root.
        self.trees[tree].points.nearest_by_norm(target).map_or(0, |(node, _)| node)
    }

    /// One step of a tree from a node toward a target.
    fn grow(
        &mut self,
        space: &mut dyn Space,
        tree: usize,
        from: usize,
        target: &LegAngles,
    ) -> Grown {
        let start = self.trees[tree].nodes[from];
        let length = (target - start).norm();
        let reaches = length <= self.step;
        let end = if reaches { *target } else { along(&start, target, self.step / length) };
        // One look at the end turns most blocked edges down.
        if !space.is_free(&end) || !self.meter.edge_is_free(space, &start, &end) {
            return Grown::Blocked;
        }
        let node = self.trees[tree].add(&end, from);
        if reaches { Grown::Reached(node) } else { Grown::Nearer(node) }
    }

    /// Grows the other tree toward a new node until it is reached or something is in the way.
    fn connect(
        &mut self,
        space: &mut dyn Space,
        here: usize,
        node: usize,
        watch: &mut dyn Watch,
    ) -> Result<Option<usize>, SearchOutcome> {
        let target = self.trees[here].nodes[node];
        let mut from = self.nearest(1 - here, &target);
        loop {
            self.may_go_on(space, watch)?;
            match self.grow(space, 1 - here, from, &target) {
                Grown::Blocked => return Ok(None),
                Grown::Nearer(nearer) => from = nearer,
                Grown::Reached(reached) => return Ok(Some(reached)),
            }
        }
    }

    /// From the start's root to `a`, and on from `b`, which is the same place, to the goal's root.
    fn path(&self, a: usize, b: usize) -> Vec<LegAngles> {
        let mut path = self.trees[0].to_root(a);
        path.reverse();
        path.extend(self.trees[1].to_root(b).into_iter().skip(1));
        path
    }
}

/// Random angles in a box about start and goal whose size is itself random, up to the limits: most
/// ways of a leg lie near its straight way.
fn sample(space: &dyn Space, query: &Query, rng: &mut impl Rng) -> LegAngles {
    let share = rng.random_range(0.0..=1.0_f64).powi(2);
    let (low, high) = (query.start.inf(&query.goal), query.start.sup(&query.goal));
    let lower = along(&low, space.lower(), share);
    let upper = along(&high, space.upper(), share);
    // Rounding must not lead out of the limits, least of all at a locked joint.
    sample_between(&lower, &upper, rng).sup(space.lower()).inf(space.upper())
}
