//! Shortening a path: Dijkstra over its nodes, then bisection of every segment, again and again
//! while it pays (F77-F79).

use std::collections::BTreeMap;

use rover::LegAngles;

use crate::space::{Space, distance, edge_is_sampled_free, path_length};
use crate::watch::{Stopped, Watch};

/// When to stop smoothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothOptions {
    /// Stop when two rounds in a row shorten the path by less than this share of its length.
    /// FootFall stopped at 0.25 (F78), which is a stop rule and no quality: a lower share gives
    /// shorter paths.
    pub stop_reduction: f64,
    /// Most rounds.
    pub max_rounds: usize,
    /// Most edges tested over all rounds: the work budget.
    pub max_edges: usize,
    /// Resolution at which an edge counts as free (rad, largest joint).
    pub epsilon: f64,
}

impl Default for SmoothOptions {
    fn default() -> SmoothOptions {
        SmoothOptions { stop_reduction: 0.02, max_rounds: 12, max_edges: 400, epsilon: 0.01 }
    }
}

/// The shortened path, with the same ends. The input's own segments must be free; they are not
/// tested again. `Err` when stopped from outside.
pub fn smooth(
    space: &mut impl Space,
    path: &[LegAngles],
    options: &SmoothOptions,
    watch: &mut impl Watch,
) -> Result<Vec<LegAngles>, Stopped> {
    let mut best = path.to_vec();
    let mut edges_left = options.max_edges;
    let mut nodes = best.clone();
    let mut poor_rounds = 0;
    for round in 0..options.max_rounds {
        let shorter = shortest(space, &nodes, options, &mut edges_left, watch)?;
        let (before, after) = (path_length(&best), path_length(&shorter));
        let poor = before - after < options.stop_reduction * before;
        // The first round has no middles yet; after a poor one the same path is cut finer once.
        poor_rounds = if poor && round > 0 { poor_rounds + 1 } else { 0 };
        if poor_rounds > 1 || edges_left == 0 {
            best = shorter;
            break;
        }
        let cut = if poor_rounds == 1 && after >= before { &nodes } else { &shorter };
        nodes = bisected(cut, options.epsilon);
        best = shorter;
    }
    Ok(without_straight_nodes(best))
}

/// The middle of each segment that is longer than the resolution, between its ends.
fn bisected(path: &[LegAngles], epsilon: f64) -> Vec<LegAngles> {
    let mut nodes = vec![path[0]];
    for w in path.windows(2) {
        if distance(&w[0], &w[1]) > 2.0 * epsilon {
            nodes.push((w[0] + w[1]) * 0.5);
        }
        nodes.push(w[1]);
    }
    nodes
}

/// The shortest way over these nodes from the first to the last, along free edges.
///
/// Dijkstra's result with each edge tested only when the shortest way would use it: an edge that
/// turns out blocked is struck and the way sought anew. Edges between neighbors are known to be
/// free. When the budget is used up, untested edges count as blocked.
fn shortest(
    space: &mut impl Space,
    nodes: &[LegAngles],
    options: &SmoothOptions,
    edges_left: &mut usize,
    watch: &mut impl Watch,
) -> Result<Vec<LegAngles>, Stopped> {
    let mut free: BTreeMap<(usize, usize), bool> = BTreeMap::new();
    loop {
        let way = shortest_if(nodes, |a, b| {
            b == a + 1 || *free.get(&(a, b)).unwrap_or(&(*edges_left > 0))
        });
        let untested =
            way.windows(2).map(|w| (w[0], w[1])).find(|e| e.1 > e.0 + 1 && !free.contains_key(e));
        let Some((a, b)) = untested else {
            return Ok(way.into_iter().map(|i| nodes[i]).collect());
        };
        if let Some(stopped) = watch.stopped() {
            return Err(stopped);
        }
        *edges_left -= 1;
        free.insert((a, b), space.edge_is_free(&nodes[a], &nodes[b]));
    }
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
            let along = if ac.norm() > 0.0 { ab.dot(&ac) / ac.norm_squared() } else { 0.0 };
            if (ab - ac * along).amax() < 1e-12 {
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
            edge_is_sampled_free(self, a, b, 0.01)
        }
        fn epsilon(&self) -> Option<f64> {
            Some(0.01)
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
        let options = SmoothOptions { max_edges: 2_000, ..SmoothOptions::default() };
        let short = smooth(&mut space, &detour, &options, &mut Unwatched).unwrap();
        // Two tangents of length sqrt(1 - 0.25) and an arc of 60 degrees at radius 0.5.
        let taut = 2.0 * 0.75_f64.sqrt() + 0.5 * std::f64::consts::FRAC_PI_3;
        let length = path_length(&short);
        assert!(length >= taut - 1e-3, "{length} is shorter than the taut string {taut}");
        assert!(length < 1.10 * taut, "{length} against {taut}");
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
        assert_eq!(short, vec![path[0], path[2]]);
    }
}
