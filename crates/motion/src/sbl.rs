//! SBL: the single-query, bi-directional, lazy planner of Sánchez and Latombe, as published in
//! FootFall (AIAA SPACE 2008, sec. III; F68-F74).
//!
//! Two trees of milestones grow from the start and the goal. Only the milestones themselves are
//! checked when they are made; the segments between them are tested when a path through both
//! trees exists, worst first, and what was tested is kept as a score. A segment that turns out to
//! be blocked moves the milestones beyond it to the other tree.
//!
//! Where the space samples its edges, a segment is free when its tested pieces are no longer than
//! ε, as published. Where it certifies them, the points of the first scores serve to turn blocked
//! segments down cheaply; then the certificate decides, once and for good.
//!
//! The result depends on the space and the query alone. Failure within the work budget is no proof
//! that there is no path (F73, F74).

mod tree;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::LegAngles;

use crate::answer::PathPlanner;
use crate::planner::{Meter, PathSearch, Query, Search, SearchOutcome};
use crate::space::{Space, WheelSpace, distance, middles_are_free, sample_between};
use crate::watch::Watch;
use tree::Tree;

/// Parameters of SBL in a request (F68).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SblOptions {
    /// Most milestones before giving up, s.
    pub max_milestones: usize,
    /// Closeness threshold (rad, largest joint), ρ.
    pub closeness: f64,
}

impl Default for SblOptions {
    fn default() -> SblOptions {
        SblOptions { max_milestones: 10_000, closeness: 0.5 }
    }
}

/// The planner, with its closeness threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sbl {
    /// Closeness threshold (rad, largest joint), ρ.
    pub closeness: f64,
}

impl Default for Sbl {
    fn default() -> Sbl {
        Sbl { closeness: SblOptions::default().closeness }
    }
}

impl PathSearch for Sbl {
    fn name(&self) -> PathPlanner {
        PathPlanner::Sbl
    }

    fn search(&self, space: &mut dyn WheelSpace, query: &Query, watch: &mut dyn Watch) -> Search {
        plan(space, query, self.closeness, watch)
    }
}

/// Samples tried around one milestone before another is picked.
const SAMPLES_PER_PICK: u32 = 16;

/// Score of a segment whose certificate was given.
const CERTIFIED: u32 = u32::MAX;

/// Score from which on a certificate is tried: 2^2 + 1 points have been looked at.
const SCORE_TO_CERTIFY: u32 = 2;

/// Searches a path with SBL of closeness ρ (rad, largest joint).
pub fn plan(space: &mut dyn Space, query: &Query, closeness: f64, watch: &mut dyn Watch) -> Search {
    let mut growth = Growth {
        closeness,
        max_milestones: query.max_nodes,
        epsilon: space.epsilon(),
        milestones: Vec::new(),
        trees: [Tree::default(), Tree::default()],
        meter: Meter::new(space, query),
    };
    let outcome = match growth.run(space, query, watch) {
        Ok(path) => SearchOutcome::Found(path),
        Err(end) => end,
    };
    let n_milestones = growth.milestones.len();
    growth.meter.end(space, outcome, n_milestones)
}

struct Milestone {
    angles: LegAngles,
    tree: usize,
    /// Place in the flat arrays of the tree.
    slot: usize,
    parent: Option<usize>,
    children: Vec<usize>,
    /// Score κ of the segment to the parent: 2^κ + 1 of its points have been checked.
    score: u32,
}

struct Growth {
    closeness: f64,
    max_milestones: usize,
    epsilon: Option<f64>,
    milestones: Vec<Milestone>,
    trees: [Tree; 2],
    meter: Meter,
}

/// A piece of a path under test: two milestones, the score κ and the length (rad, largest joint).
struct Segment {
    from: usize,
    to: usize,
    score: u32,
    length: f64,
}

impl Segment {
    /// Length of the pieces between points looked at.
    fn untested(&self) -> f64 {
        if self.score == CERTIFIED { 0.0 } else { self.length / f64::powi(2.0, self.score as i32) }
    }
}

impl Growth {
    fn run(
        &mut self,
        space: &mut dyn Space,
        query: &Query,
        watch: &mut dyn Watch,
    ) -> Result<Vec<LegAngles>, SearchOutcome> {
        let mut rng = ChaCha8Rng::seed_from_u64(query.seed);
        self.add(query.start, 0, None);
        // The goal is the newest milestone: perhaps a bridge spans the whole way at once.
        let mut newest = self.add(query.goal, 1, None);
        loop {
            self.meter.must_end(space, watch).map_or(Ok(()), Err)?;
            if let Some(path) = self.connect(space, newest, watch)? {
                return Ok(path);
            }
            if self.milestones.len() >= self.max_milestones {
                return Err(SearchOutcome::NotFound { exhausted: false });
            }
            newest = self.expand(space, &mut rng, watch)?;
        }
    }

    fn add(&mut self, angles: LegAngles, tree: usize, parent: Option<usize>) -> usize {
        let index = self.milestones.len();
        let slot = self.trees[tree].insert(index, &angles);
        let children = Vec::new();
        self.milestones.push(Milestone { angles, tree, slot, parent, children, score: 0 });
        if let Some(parent) = parent {
            self.milestones[parent].children.push(index);
        }
        index
    }

    /// EXPAND-TREE: a new milestone near one picked against the local density.
    fn expand(
        &mut self,
        space: &mut dyn Space,
        rng: &mut impl Rng,
        watch: &mut dyn Watch,
    ) -> Result<usize, SearchOutcome> {
        // Bounded: where nothing near any milestone is free, the search must end too.
        for _ in 0..self.max_milestones {
            let tree = usize::from(rng.random_bool(0.5));
            let picked = self.trees[tree].pick(rng);
            let center = self.milestones[picked].angles;
            for i in 1..=SAMPLES_PER_PICK {
                self.meter.must_end(space, watch).map_or(Ok(()), Err)?;
                let radius = self.closeness / f64::from(i);
                let lower = center.add_scalar(-radius).sup(space.lower());
                let upper = center.add_scalar(radius).inf(space.upper());
                let sample = sample_between(&lower, &upper, rng);
                if space.is_free(&sample) {
                    return Ok(self.add(sample, tree, Some(picked)));
                }
            }
        }
        Err(SearchOutcome::NotFound { exhausted: false })
    }

    /// CONNECT-TREES: a bridge from the newest milestone to the nearest of the other tree, and the
    /// test of the path it makes.
    fn connect(
        &mut self,
        space: &mut dyn Space,
        newest: usize,
        watch: &mut dyn Watch,
    ) -> Result<Option<Vec<LegAngles>>, SearchOutcome> {
        let here = &self.milestones[newest];
        let other = &self.trees[1 - here.tree];
        let near = other.nearest(&here.angles);
        let Some((near, _)) = near.filter(|(_, gap)| *gap <= self.closeness) else {
            return Ok(None);
        };
        let (a, b) = if here.tree == 0 { (newest, near) } else { (near, newest) };
        self.test_path(space, a, b, watch)
    }

    /// TEST-PATH over the path through the bridge from `a` (start's tree) to `b` (goal's tree).
    fn test_path(
        &mut self,
        space: &mut dyn Space,
        a: usize,
        b: usize,
        watch: &mut dyn Watch,
    ) -> Result<Option<Vec<LegAngles>>, SearchOutcome> {
        let mut path: Vec<usize> = self.to_root(a);
        path.reverse();
        let bridge = path.len() - 1;
        path.extend(self.to_root(b));
        let mut segments = self.segments(&path, bridge);
        while let Some(worst) = self.worst(&segments) {
            if let Some(end) = self.meter.must_end(space, watch) {
                return Err(end);
            }
            match self.test_segment(space, &segments[worst]) {
                Some(score) => segments[worst].score = score,
                None => {
                    self.keep_scores(&segments, bridge);
                    self.remove(&path, worst, bridge, segments[bridge].score);
                    return Ok(None);
                }
            }
        }
        Ok(Some(path.iter().map(|i| self.milestones[*i].angles).collect()))
    }

    fn segments(&self, path: &[usize], bridge: usize) -> Vec<Segment> {
        let segment = |(i, w): (usize, &[usize])| {
            let (from, to) = (&self.milestones[w[0]], &self.milestones[w[1]]);
            let score = match i.cmp(&bridge) {
                std::cmp::Ordering::Less => to.score,
                std::cmp::Ordering::Equal => 0,
                std::cmp::Ordering::Greater => from.score,
            };
            let length = distance(&from.angles, &to.angles);
            Segment { from: w[0], to: w[1], score, length }
        };
        path.windows(2).enumerate().map(segment).collect()
    }

    /// The segment to test next: the one whose untested pieces are longest is the likeliest to be
    /// blocked. Certificates come after all cheap tests. `None` when all are done.
    fn worst(&self, segments: &[Segment]) -> Option<usize> {
        let is_open = |s: &Segment| match self.epsilon {
            Some(epsilon) => s.untested() > epsilon,
            None => s.score != CERTIFIED,
        };
        let is_cheap = |s: &Segment| self.epsilon.is_some() || s.score < SCORE_TO_CERTIFY;
        let open = segments.iter().enumerate().filter(|(_, s)| is_open(s));
        open.max_by(|(i, x), (j, y)| {
            let by_cost = is_cheap(x).cmp(&is_cheap(y));
            by_cost.then(x.untested().total_cmp(&y.untested())).then(j.cmp(i))
        })
        .map(|(i, _)| i)
    }

    /// TEST-SEGMENT: the middles of the 2^κ pieces tested so far, or the certificate. The new
    /// score, or `None` if the segment is blocked.
    fn test_segment(&mut self, space: &mut dyn Space, segment: &Segment) -> Option<u32> {
        let (a, b) = (&self.milestones[segment.from].angles, &self.milestones[segment.to].angles);
        self.meter.n_edges += u64::from(segment.score == 0);
        if self.epsilon.is_none() && segment.score >= SCORE_TO_CERTIFY {
            return space.edge_is_free(a, b).then_some(CERTIFIED);
        }
        middles_are_free(space, a, b, segment.score).then_some(segment.score + 1)
    }

    fn keep_scores(&mut self, segments: &[Segment], bridge: usize) {
        for (i, segment) in segments.iter().enumerate() {
            match i.cmp(&bridge) {
                std::cmp::Ordering::Less => self.milestones[segment.to].score = segment.score,
                std::cmp::Ordering::Equal => {}
                std::cmp::Ordering::Greater => self.milestones[segment.from].score = segment.score,
            }
        }
    }

    fn to_root(&self, from: usize) -> Vec<usize> {
        std::iter::successors(Some(from), |i| self.milestones[*i].parent).collect()
    }

    /// Takes the blocked segment out: what lay beyond it hangs on the other tree from now on, by
    /// way of the bridge.
    fn remove(&mut self, path: &[usize], blocked: usize, bridge: usize, bridge_score: u32) {
        if blocked == bridge {
            return;
        }
        // The milestones from the blocked segment to the bridge, and the other end of the bridge.
        let (chain, anchor): (Vec<usize>, usize) = if blocked < bridge {
            (path[blocked + 1..=bridge].to_vec(), path[bridge + 1])
        } else {
            (path[bridge + 1..=blocked].iter().rev().copied().collect(), path[bridge])
        };
        let cut = chain[0];
        if let Some(parent) = self.milestones[cut].parent.take() {
            self.milestones[parent].children.retain(|child| *child != cut);
        }
        // Reverse the chain: each hangs on the next, the last on the anchor across the bridge.
        let scores: Vec<u32> = chain.iter().map(|i| self.milestones[*i].score).collect();
        for (k, &here) in chain.iter().enumerate() {
            let (parent, score) = match chain.get(k + 1) {
                Some(&next) => (next, scores[k + 1]),
                None => (anchor, bridge_score),
            };
            self.milestones[here].children.retain(|child| *child != parent);
            self.milestones[here].parent = Some(parent);
            self.milestones[here].score = score;
            self.milestones[parent].children.push(here);
        }
        let tree = self.milestones[anchor].tree;
        let mut moved = vec![chain[chain.len() - 1]];
        while let Some(i) = moved.pop() {
            self.move_to(tree, i);
            moved.extend(&self.milestones[i].children);
        }
    }

    fn move_to(&mut self, tree: usize, milestone: usize) {
        let (angles, slot) = (self.milestones[milestone].angles, self.milestones[milestone].slot);
        if let Some(last) = self.trees[1 - tree].remove(milestone, &angles, slot) {
            self.milestones[last].slot = slot;
        }
        self.milestones[milestone].slot = self.trees[tree].insert(milestone, &angles);
        self.milestones[milestone].tree = tree;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::edge_is_sampled_free;
    use crate::watch::Unwatched;

    /// A closed wall at joint 1 = 0, thinner than most segments are long.
    struct Wall {
        lower: LegAngles,
        upper: LegAngles,
        n_checked: u64,
    }

    impl Space for Wall {
        fn lower(&self) -> &LegAngles {
            &self.lower
        }
        fn upper(&self) -> &LegAngles {
            &self.upper
        }
        fn is_free(&mut self, q: &LegAngles) -> bool {
            self.n_checked += 1;
            q[0].abs() > 0.05
        }
        fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
            edge_is_sampled_free(self, a, b, 0.01)
        }
        fn epsilon(&self) -> Option<f64> {
            Some(0.01)
        }
        fn n_checked(&self) -> u64 {
            self.n_checked
        }
    }

    #[test]
    fn milestones_that_change_trees_keep_all_records_in_step() {
        let lower = LegAngles::from_element(-1.0);
        let mut space = Wall { lower, upper: -lower, n_checked: 0 };
        let (mut start, mut goal) = (LegAngles::zeros(), LegAngles::zeros());
        (start[0], goal[0]) = (-0.5, 0.5);
        let (seed, budget, max_nodes) = (1, u64::MAX, 2_000);
        let query = Query { start, goal, seed, budget, max_nodes, cell: 0.2 };
        let mut growth = Growth {
            closeness: 0.5,
            max_milestones: max_nodes,
            epsilon: space.epsilon(),
            milestones: Vec::new(),
            trees: [Tree::default(), Tree::default()],
            meter: Meter::new(&space, &query),
        };
        assert!(growth.run(&mut space, &query, &mut Unwatched).is_err());
        for (i, milestone) in growth.milestones.iter().enumerate() {
            let tree = &growth.trees[milestone.tree];
            assert!(tree.holds(i, &milestone.angles, milestone.slot));
            for child in &milestone.children {
                assert_eq!(growth.milestones[*child].parent, Some(i));
                assert_eq!(growth.milestones[*child].tree, milestone.tree);
            }
            assert_eq!(growth.to_root(i).last(), Some(&milestone.tree), "each hangs on its root");
        }
        assert_eq!(growth.trees[0].len() + growth.trees[1].len(), 2_000);
    }
}
