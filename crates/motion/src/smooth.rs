//! Shortening a path: Dijkstra over its nodes and bisection of every segment, again and again while
//! it pays (F77-F79); then, over certified edges, shortcuts and a taut string.
//!
//! The published rounds stop early (F78) and keep to straight lines between nodes and middles of
//! the first path. What follows brings the path near the shortest of its kind: shortcuts between
//! any two points of the path, pulls of each node toward the line of its neighbors, all joints at
//! once or one by one, and nodes left out. A taut path grazes what it goes around; where edges are
//! sampled it would touch between the samples, so that smoothing there ends as published.
//!
//! Edges known to be free are never tested again, nor are pieces of them. Nothing ever makes the
//! path longer.

use std::collections::{BTreeMap, BTreeSet};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::LegAngles;

use crate::space::{Space, along, distance, path_length};
use crate::watch::{Stopped, Watch};

/// When to stop smoothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothOptions {
    /// Stop when two rounds in a row shorten the path by less than this share of its length.
    /// FootFall stopped at 0.25 (F78), which is a stop rule and no quality: a lower share gives
    /// shorter paths.
    pub stop_reduction: f64,
    /// Most rounds of Dijkstra and bisection.
    pub max_rounds: usize,
    /// Most edges tested: with `max_checked` the work budget.
    pub max_edges: usize,
    /// Most configurations checked; an edge that has been begun is finished.
    pub max_checked: u64,
    /// Most rounds of shortcuts and pulls over certified edges; 0 smooths as published.
    pub max_taut_rounds: usize,
}

impl Default for SmoothOptions {
    fn default() -> SmoothOptions {
        SmoothOptions {
            stop_reduction: 0.02,
            max_rounds: 4,
            max_edges: 2_000,
            max_checked: 1_300,
            max_taut_rounds: 12,
        }
    }
}

/// A shortened path and the work it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// The path, with the ends of the one given.
    pub path: Vec<LegAngles>,
    /// Edges tested.
    pub n_edges: u64,
    /// Configurations checked.
    pub n_checked: u64,
}

/// Shortens a path whose own segments must be free; they are not tested again. The result depends
/// on space, path and options alone. `Err` when stopped from outside.
pub fn smooth(
    space: &mut dyn Space,
    path: &[LegAngles],
    options: &SmoothOptions,
    watch: &mut dyn Watch,
) -> Result<Smoothed, Stopped> {
    let checked_before = space.n_checked();
    let blocked = BTreeSet::new();
    let mut smoother =
        Smoother { space, watch, options: *options, checked_before, n_edges: 0, blocked };
    let mut path = smoother.published(path)?;
    if smoother.space.epsilon().is_none() {
        path = smoother.taut(path)?;
    }
    let path = without_straight_nodes(path);
    let (n_edges, n_checked) = (smoother.n_edges as u64, smoother.n_checked());
    Ok(Smoothed { path, n_edges, n_checked })
}

/// Segments shorter than this (rad, largest joint) are not bisected.
const SHORTEST_BISECTED: f64 = 0.02;

/// Shortcuts tried for each round of pulls.
const SHORTCUTS: usize = 8;

/// Bisections of one pull.
const PULLS: u32 = 4;

/// A round that wins less than this share is a poor one.
const POOR_ROUND: f64 = 0.003;

struct Smoother<'a> {
    space: &'a mut dyn Space,
    watch: &'a mut dyn Watch,
    options: SmoothOptions,
    checked_before: u64,
    n_edges: usize,
    /// Edges that turned out blocked, by the bits of their ends: nodes that stay would have them
    /// tested in every round.
    blocked: BTreeSet<[u64; 12]>,
}

impl Smoother<'_> {
    fn n_checked(&self) -> u64 {
        self.space.n_checked() - self.checked_before
    }

    fn is_spent(&self) -> bool {
        self.n_edges >= self.options.max_edges || self.n_checked() >= self.options.max_checked
    }

    /// Is the edge free? When the budget is spent, edges count as blocked.
    fn is_free(&mut self, a: &LegAngles, b: &LegAngles) -> Result<bool, Stopped> {
        if let Some(stopped) = self.watch.stopped() {
            return Err(stopped);
        }
        if self.is_spent() {
            return Ok(false);
        }
        let key = std::array::from_fn(|i| if i < 6 { a[i] } else { b[i - 6] }.to_bits());
        if self.blocked.contains(&key) {
            return Ok(false);
        }
        self.n_edges += 1;
        let is_free = self.space.edge_is_free(a, b);
        if !is_free {
            self.blocked.insert(key);
        }
        Ok(is_free)
    }

    /// Dijkstra and bisection in rounds, until two in a row win too little (F77-F79).
    fn published(&mut self, path: &[LegAngles]) -> Result<Vec<LegAngles>, Stopped> {
        let mut best = path.to_vec();
        let mut nodes = best.clone();
        let mut poor_rounds = 0;
        for round in 0..self.options.max_rounds {
            let shorter = self.shortest(&nodes)?;
            let (before, after) = (path_length(&best), path_length(&shorter));
            let poor = before - after < self.options.stop_reduction * before;
            // The first round has no middles yet; after a poor one the same path is cut finer once.
            poor_rounds = if poor && round > 0 { poor_rounds + 1 } else { 0 };
            if poor_rounds > 1 || self.is_spent() {
                return Ok(shorter);
            }
            let cut = if poor_rounds == 1 && after >= before { &nodes } else { &shorter };
            nodes = bisected(cut);
            best = shorter;
        }
        Ok(best)
    }

    /// The shortest way over these nodes from the first to the last, along free edges.
    ///
    /// Dijkstra's result with each edge tested only when the shortest way would use it: an edge
    /// that turns out blocked is struck and the way sought anew. Edges between neighbors are known
    /// to be free.
    fn shortest(&mut self, nodes: &[LegAngles]) -> Result<Vec<LegAngles>, Stopped> {
        let mut tested: BTreeMap<(usize, usize), bool> = BTreeMap::new();
        loop {
            let is_spent = self.is_spent();
            let way =
                shortest_if(nodes, |a, b| b == a + 1 || *tested.get(&(a, b)).unwrap_or(&!is_spent));
            let edges = way.windows(2).map(|w| (w[0], w[1]));
            let untested = edges.into_iter().find(|e| e.1 > e.0 + 1 && !tested.contains_key(e));
            let Some((a, b)) = untested else {
                return Ok(way.into_iter().map(|i| nodes[i]).collect());
            };
            let is_free = self.is_free(&nodes[a], &nodes[b])?;
            tested.insert((a, b), is_free);
        }
    }

    /// Rounds of shortcuts, pulls and nodes left out, until two in a row win too little.
    fn taut(&mut self, mut path: Vec<LegAngles>) -> Result<Vec<LegAngles>, Stopped> {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut poor_rounds = 0;
        for _ in 0..self.options.max_taut_rounds {
            if path.len() < 3 || poor_rounds > 1 || self.is_spent() {
                break;
            }
            let before = path_length(&path);
            for _ in 0..SHORTCUTS {
                let along: [f64; 2] = std::array::from_fn(|_| rng.random_range(0.0..=1.0));
                path = self.with_shortcut(path, along[0].min(along[1]), along[0].max(along[1]))?;
            }
            for i in 1..path.len() - 1 {
                self.pull(&mut path, i)?;
            }
            path = self.shortest(&path)?;
            let poor = before - path_length(&path) < POOR_ROUND * before;
            poor_rounds = if poor { poor_rounds + 1 } else { 0 };
        }
        Ok(path)
    }

    /// The path with the straight edge between two of its points, given as shares of its length,
    /// if that edge is free.
    fn with_shortcut(
        &mut self,
        path: Vec<LegAngles>,
        first: f64,
        last: f64,
    ) -> Result<Vec<LegAngles>, Stopped> {
        let length = path_length(&path);
        let ((i, a), (j, b)) = (point_at(&path, first * length), point_at(&path, last * length));
        if i == j || !self.is_free(&a, &b)? {
            return Ok(path);
        }
        let mut shorter = path[..=i].to_vec();
        shorter.extend([a, b]);
        shorter.extend(&path[j + 1..]);
        shorter.dedup();
        Ok(without_straight_nodes(shorter))
    }

    /// Pulls a node toward the line of its neighbors: with all joints, then with each alone.
    fn pull(&mut self, path: &mut [LegAngles], i: usize) -> Result<(), Stopped> {
        for joint in std::iter::once(None).chain((0..6).map(Some)) {
            let (a, b, c) = (path[i - 1], path[i], path[i + 1]);
            let ((ab, bc), here) = (((b - a).norm(), (c - b).norm()), b);
            if ab + bc <= 0.0 || self.is_spent() {
                return Ok(());
            }
            let mut line = along(&a, &c, ab / (ab + bc));
            if let Some(joint) = joint {
                let value = line[joint];
                line = here;
                line[joint] = value;
            }
            let way = |q: &LegAngles| (q - a).norm() + (c - q).norm();
            let (mut free, mut tried) = (0.0, 1.0);
            for _ in 0..PULLS {
                let there = along(&here, &line, tried);
                if ab + bc - way(&there) < 1e-3 * (ab + bc) {
                    break;
                }
                if self.space.is_free(&there)
                    && self.is_free(&a, &there)?
                    && self.is_free(&there, &c)?
                {
                    (free, path[i]) = (tried, there);
                    if tried == 1.0 {
                        break;
                    }
                    tried += (1.0 - tried) / 2.0;
                } else {
                    tried = free + (tried - free) / 2.0;
                }
            }
        }
        Ok(())
    }
}

/// The middle of each segment that is not too short, between its ends.
fn bisected(path: &[LegAngles]) -> Vec<LegAngles> {
    let mut nodes = vec![path[0]];
    for w in path.windows(2) {
        if distance(&w[0], &w[1]) > SHORTEST_BISECTED {
            nodes.push(along(&w[0], &w[1], 0.5));
        }
        nodes.push(w[1]);
    }
    nodes
}

/// The point after this length (rad) along the path, and the segment it lies on.
fn point_at(path: &[LegAngles], length: f64) -> (usize, LegAngles) {
    let mut left = length;
    for (i, w) in path.windows(2).enumerate() {
        let piece = (w[1] - w[0]).norm();
        if left < piece {
            return (i, along(&w[0], &w[1], left / piece));
        }
        left -= piece;
    }
    (path.len() - 2, path[path.len() - 1])
}

/// Shortest way from the first node to the last over forward edges that may be used. The nodes lie
/// along a path, so going back never pays and the nodes are already in order.
fn shortest_if(nodes: &[LegAngles], usable: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    let mut best = vec![(f64::INFINITY, 0); nodes.len()];
    best[0].0 = 0.0;
    for b in 1..nodes.len() {
        for a in 0..b {
            let length = best[a].0 + (nodes[b] - nodes[a]).norm();
            if length < best[b].0 && usable(a, b) {
                best[b] = (length, a);
            }
        }
    }
    let mut way = vec![nodes.len() - 1];
    while way[way.len() - 1] != 0 {
        way.push(best[way[way.len() - 1]].1);
    }
    way.reverse();
    way
}

/// Drops nodes on the straight line between their neighbors: they would be commands without use.
fn without_straight_nodes(path: Vec<LegAngles>) -> Vec<LegAngles> {
    let mut kept: Vec<LegAngles> = Vec::with_capacity(path.len());
    for (i, node) in path.iter().enumerate() {
        if let (Some(before), Some(after)) = (kept.last(), path.get(i + 1)) {
            let (ab, ac) = (node - before, after - before);
            let share = if ac.norm() > 0.0 { ab.dot(&ac) / ac.norm_squared() } else { 0.0 };
            if (ab - ac * share).amax() < 1e-12 {
                continue;
            }
        }
        kept.push(*node);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::watch::Unwatched;

    struct Disk {
        lower: LegAngles,
        upper: LegAngles,
    }

    impl Space for Disk {
        fn lower(&self) -> &LegAngles {
            &self.lower
        }
        fn upper(&self) -> &LegAngles {
            &self.upper
        }
        fn is_free(&mut self, q: &LegAngles) -> bool {
            q[0].hypot(q[1]) > 0.5
        }
        fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
            // Exact: the point of the edge that is nearest to the middle of the disk.
            let (way, to_middle) = ((b - a).xy(), -a.xy());
            let share = way.dot(&to_middle) / way.norm_squared().max(1e-300);
            self.is_free(&along(a, b, share.clamp(0.0, 1.0)))
        }
        fn epsilon(&self) -> Option<f64> {
            None
        }
        fn n_checked(&self) -> u64 {
            0
        }
    }

    fn at(x: f64, y: f64) -> LegAngles {
        LegAngles::new(x, y, 0.0, 0.0, 0.0, 0.0)
    }

    #[test]
    fn a_detour_around_a_disk_becomes_nearly_the_taut_string() {
        let mut space =
            Disk { lower: LegAngles::from_element(-3.0), upper: LegAngles::from_element(3.0) };
        let detour = [at(-1.0, 0.0), at(-1.5, 1.5), at(0.0, 2.0), at(1.5, 1.5), at(1.0, 0.0)];
        let options = SmoothOptions::default();
        let short = smooth(&mut space, &detour, &options, &mut Unwatched).unwrap().path;
        // Two tangents of length sqrt(1 - 0.25) and an arc of 60 degrees at radius 0.5.
        let taut = 2.0 * 0.75_f64.sqrt() + 0.5 * std::f64::consts::FRAC_PI_3;
        let length = path_length(&short);
        assert!(length >= taut - 1e-3, "{length} is shorter than the taut string {taut}");
        assert!(length < 1.02 * taut, "{length} against {taut}");
        for w in short.windows(2) {
            assert!(space.edge_is_free(&w[0], &w[1]));
        }
        assert_eq!((short[0], short[short.len() - 1]), (detour[0], detour[4]));
    }

    #[test]
    fn a_free_way_becomes_the_straight_line() {
        let mut space =
            Disk { lower: LegAngles::from_element(-3.0), upper: LegAngles::from_element(3.0) };
        let path = [at(1.0, 1.0), at(2.0, 2.5), at(2.0, 1.0)];
        let short = smooth(&mut space, &path, &SmoothOptions::default(), &mut Unwatched).unwrap();
        assert_eq!(short.path, vec![path[0], path[2]]);
    }
}
