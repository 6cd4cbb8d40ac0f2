//! SBL: the single-query, bi-directional, lazy planner of Sánchez and Latombe, as published in
//! FootFall (AIAA SPACE 2008, sec. III; F68-F74).
//!
//! Two trees of milestones grow from the start and the goal. Only the milestones themselves are
//! checked when they are made; the segments between them are tested when a path through both
//! trees exists, worst first, and what was tested is kept as a score. A segment that turns out to
//! be blocked moves the milestones beyond it to the other tree.
//!
//! The result depends on the space, the parameters and the random numbers alone. Failure after
//! `max_milestones` is no proof that there is no path (F73, F74).

use std::collections::BTreeMap;

use rand::{Rng, RngExt};
use rover::LegAngles;

use crate::space::{Space, distance};
use crate::watch::{Stopped, Watch};

/// Parameters of SBL (F68).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SblOptions {
    /// Most milestones before giving up, s.
    pub max_milestones: usize,
    /// Closeness threshold (rad, largest joint), ρ.
    pub closeness: f64,
    /// Resolution at which a segment counts as tested (rad, largest joint), ε.
    pub epsilon: f64,
}

impl Default for SblOptions {
    fn default() -> SblOptions {
        SblOptions { max_milestones: 10_000, closeness: 0.5, epsilon: 0.01 }
    }
}

/// How a search ended.
#[derive(Debug, Clone, PartialEq)]
pub enum SblOutcome {
    /// A path from start to goal, both included, free at resolution ε.
    Found(Vec<LegAngles>),
    /// No path after the given number of milestones; there may be one.
    NotFound,
    /// Stopped from outside.
    Stopped(Stopped),
}

/// The outcome and the work it took.
#[derive(Debug, Clone, PartialEq)]
pub struct SblResult {
    /// How the search ended.
    pub outcome: SblOutcome,
    /// Milestones made, start and goal included.
    pub n_milestones: usize,
}

/// Side of the cells in which milestone density is counted (rad), over the first three joints.
const DENSITY_CELL: f64 = 0.2;

/// Samples tried around one milestone before another is picked.
const SAMPLES_PER_PICK: u32 = 16;

/// Searches a path from `start` to `goal`, both of which must be free.
pub fn plan(
    space: &mut impl Space,
    start: LegAngles,
    goal: LegAngles,
    options: &SblOptions,
    rng: &mut impl Rng,
    watch: &mut impl Watch,
) -> SblResult {
    let mut search = Search {
        options: *options,
        milestones: Vec::new(),
        trees: [Tree::default(), Tree::default()],
    };
    search.add(start, 0, None);
    search.add(goal, 1, None);
    // The goal is the newest milestone: perhaps a bridge spans the whole way at once.
    let mut newest = 1;
    loop {
        if let Some(stopped) = watch.stopped() {
            return search.end(SblOutcome::Stopped(stopped));
        }
        if let Some(path) = search.connect(space, newest) {
            return search.end(SblOutcome::Found(path));
        }
        if search.milestones.len() >= options.max_milestones {
            return search.end(SblOutcome::NotFound);
        }
        newest = match search.expand(space, rng, watch) {
            Ok(milestone) => milestone,
            Err(outcome) => return search.end(outcome),
        };
    }
}

struct Milestone {
    angles: LegAngles,
    tree: usize,
    parent: Option<usize>,
    children: Vec<usize>,
    /// Score κ of the segment to the parent: 2^κ + 1 of its points have been checked.
    score: u32,
}

/// Milestones of one tree by cell, so that crowded cells are not picked more often (F70).
#[derive(Default)]
struct Tree {
    cells: Vec<Vec<usize>>,
    cell_of: BTreeMap<[i64; 3], usize>,
}

struct Search {
    options: SblOptions,
    milestones: Vec<Milestone>,
    trees: [Tree; 2],
}

/// A piece of a path under test: two milestones, the score, and whether it is the bridge.
struct Segment {
    from: usize,
    to: usize,
    score: u32,
    length: f64,
}

impl Search {
    fn end(self, outcome: SblOutcome) -> SblResult {
        SblResult { outcome, n_milestones: self.milestones.len() }
    }

    fn add(&mut self, angles: LegAngles, tree: usize, parent: Option<usize>) -> usize {
        let index = self.milestones.len();
        self.milestones.push(Milestone { angles, tree, parent, children: Vec::new(), score: 0 });
        if let Some(parent) = parent {
            self.milestones[parent].children.push(index);
        }
        self.trees[tree].insert(index, &angles);
        index
    }

    /// EXPAND-TREE: a new milestone near one picked against the local density.
    fn expand(
        &mut self,
        space: &mut impl Space,
        rng: &mut impl Rng,
        watch: &mut impl Watch,
    ) -> Result<usize, SblOutcome> {
        // Bounded: where nothing near any milestone is free, the search must end too.
        for _ in 0..self.options.max_milestones {
            if let Some(stopped) = watch.stopped() {
                return Err(SblOutcome::Stopped(stopped));
            }
            let tree = usize::from(rng.random_bool(0.5));
            let picked = self.trees[tree].pick(rng);
            let center = self.milestones[picked].angles;
            for i in 1..=SAMPLES_PER_PICK {
                let radius = self.options.closeness / f64::from(i);
                let sample = center.map(|q| q + rng.random_range(-radius..=radius));
                let inside = sample >= *space.lower() && sample <= *space.upper();
                if inside && space.is_free(&sample) {
                    return Ok(self.add(sample, tree, Some(picked)));
                }
            }
        }
        Err(SblOutcome::NotFound)
    }

    /// CONNECT-TREES: a bridge from the newest milestone to the nearest of the other tree, and the
    /// test of the path it makes.
    fn connect(&mut self, space: &mut impl Space, newest: usize) -> Option<Vec<LegAngles>> {
        let here = &self.milestones[newest];
        let (near, gap) = self
            .milestones
            .iter()
            .enumerate()
            .filter(|(_, other)| other.tree != here.tree)
            .map(|(i, other)| (i, distance(&here.angles, &other.angles)))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        if gap > self.options.closeness {
            return None;
        }
        let (a, b) = if here.tree == 0 { (newest, near) } else { (near, newest) };
        self.test_path(space, a, b)
    }

    /// TEST-PATH over the path through the bridge from `a` (start's tree) to `b` (goal's tree).
    fn test_path(&mut self, space: &mut impl Space, a: usize, b: usize) -> Option<Vec<LegAngles>> {
        let mut path: Vec<usize> = self.to_root(a);
        path.reverse();
        let bridge = path.len() - 1;
        path.extend(self.to_root(b));
        let mut segments: Vec<Segment> = path
            .windows(2)
            .enumerate()
            .map(|(i, w)| Segment {
                from: w[0],
                to: w[1],
                score: match i.cmp(&bridge) {
                    std::cmp::Ordering::Less => self.milestones[w[1]].score,
                    std::cmp::Ordering::Equal => 0,
                    std::cmp::Ordering::Greater => self.milestones[w[0]].score,
                },
                length: distance(&self.milestones[w[0]].angles, &self.milestones[w[1]].angles),
            })
            .collect();
        loop {
            // The segment whose untested pieces are longest is the likeliest to be blocked.
            let untested = |s: &Segment| s.length / f64::powi(2.0, s.score as i32);
            let (worst, gap) = segments
                .iter()
                .enumerate()
                .map(|(i, s)| (i, untested(s)))
                .max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)))?;
            if gap <= self.options.epsilon {
                self.keep_scores(&segments, bridge);
                return Some(path.iter().map(|i| self.milestones[*i].angles).collect());
            }
            if !self.test_segment(space, &segments[worst]) {
                self.keep_scores(&segments, bridge);
                self.remove(&path, worst, bridge, segments[bridge].score);
                return None;
            }
            segments[worst].score += 1;
        }
    }

    /// TEST-SEGMENT: the middles of the 2^κ pieces tested so far.
    fn test_segment(&self, space: &mut impl Space, segment: &Segment) -> bool {
        let (a, b) = (&self.milestones[segment.from].angles, &self.milestones[segment.to].angles);
        let pieces = f64::powi(2.0, segment.score as i32);
        (0..1_u64 << segment.score).all(|i| {
            let t = (i as f64 + 0.5) / pieces;
            space.is_free(&(a * (1.0 - t) + b * t))
        })
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
            let angles = self.milestones[i].angles;
            self.trees[1 - tree].remove(i, &angles);
            self.trees[tree].insert(i, &angles);
            self.milestones[i].tree = tree;
            moved.extend(&self.milestones[i].children);
        }
    }
}

impl Tree {
    fn key(angles: &LegAngles) -> [i64; 3] {
        [0, 1, 2].map(|i| (angles[i] / DENSITY_CELL).floor() as i64)
    }

    fn insert(&mut self, milestone: usize, angles: &LegAngles) {
        let cell = *self.cell_of.entry(Tree::key(angles)).or_insert_with(|| {
            self.cells.push(Vec::new());
            self.cells.len() - 1
        });
        self.cells[cell].push(milestone);
    }

    fn remove(&mut self, milestone: usize, angles: &LegAngles) {
        let key = Tree::key(angles);
        let Some(&cell) = self.cell_of.get(&key) else { return };
        self.cells[cell].retain(|m| *m != milestone);
        if !self.cells[cell].is_empty() {
            return;
        }
        self.cell_of.remove(&key);
        self.cells.swap_remove(cell);
        let last = self.cells.len();
        if let Some(moved) = self.cell_of.values_mut().find(|c| **c == last) {
            *moved = cell;
        }
    }

    /// A cell at random, then a milestone in it: probability against the local density. A tree
    /// always holds its root.
    fn pick(&self, rng: &mut impl Rng) -> usize {
        let cell = &self.cells[rng.random_range(0..self.cells.len())];
        cell[rng.random_range(0..cell.len())]
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::watch::Unwatched;

    /// A wall at joint 1 = 0 with a gap where joint 2 is above 0.8.
    struct Wall {
        lower: LegAngles,
        upper: LegAngles,
        open: bool,
    }

    impl Space for Wall {
        fn lower(&self) -> &LegAngles {
            &self.lower
        }
        fn upper(&self) -> &LegAngles {
            &self.upper
        }
        fn is_free(&mut self, q: &LegAngles) -> bool {
            q[0].abs() > 0.05 || (self.open && q[1] > 0.8)
        }
    }

    fn search(open: bool, seed: u64) -> SblResult {
        let mut space = Wall {
            lower: LegAngles::from_element(-1.0),
            upper: LegAngles::from_element(1.0),
            open,
        };
        let (mut start, mut goal) = (LegAngles::zeros(), LegAngles::zeros());
        (start[0], goal[0]) = (-0.5, 0.5);
        let options = SblOptions { max_milestones: 3_000, ..SblOptions::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        plan(&mut space, start, goal, &options, &mut rng, &mut Unwatched)
    }

    #[test]
    fn the_way_through_a_gap_is_found_for_every_seed_and_is_free() {
        for seed in 0..40 {
            let SblOutcome::Found(path) = search(true, seed).outcome else {
                panic!("seed {seed} found nothing");
            };
            for w in path.windows(2) {
                let n = (distance(&w[0], &w[1]) / 0.01).ceil().max(1.0) as usize;
                let crossing = (0..=n).map(|i| w[0] + (w[1] - w[0]) * (i as f64 / n as f64));
                // Between two points checked 0.01 apart a crossing may cut a corner by that much.
                for q in crossing {
                    assert!(q[0].abs() > 0.04 || q[1] > 0.79, "seed {seed}: {q}");
                }
            }
        }
    }

    #[test]
    fn a_closed_wall_ends_with_the_work_budget() {
        let result = search(false, 1);
        assert_eq!(result.outcome, SblOutcome::NotFound);
        assert_eq!(result.n_milestones, 3_000);
    }

    #[test]
    fn the_same_seed_gives_the_same_path() {
        assert_eq!(search(true, 5), search(true, 5));
        assert_ne!(search(true, 5), search(true, 6));
    }

    #[test]
    fn a_stop_ends_the_search_and_says_why() {
        struct AtOnce;
        impl Watch for AtOnce {
            fn stopped(&mut self) -> Option<Stopped> {
                Some(Stopped::Deadline)
            }
        }
        let mut space = Wall {
            lower: LegAngles::from_element(-1.0),
            upper: LegAngles::from_element(1.0),
            open: true,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (start, goal) = (LegAngles::from_element(-0.5), LegAngles::from_element(0.5));
        let result = plan(&mut space, start, goal, &SblOptions::default(), &mut rng, &mut AtOnce);
        assert_eq!(result.outcome, SblOutcome::Stopped(Stopped::Deadline));
    }
}
