//! Folds that a lifted leg can get to: a random tree (LaValle's) from where it is, every edge certified,
//! of which the node that wins most is taken. A fold that wins more but cannot be gone to is none.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::LegAngles;

use crate::leg_space::LegSpace;
use crate::space::Space;

/// Extensions that are tried.
const EXTENSIONS: usize = 2_500;

/// Longest edge (rad, largest joint).
const EDGE: f64 = 0.5;

/// Seeded angles that are looked at for those that win most, how many of them the tree grows toward, and
/// every how many-th extension does.
const SAMPLES: usize = 2_000;
const GOALS: usize = 4;
const GOAL_EVERY: usize = 4;

/// First and last step of polishing (rad).
const FIRST_STEP: f64 = 0.3;
const LAST_STEP: f64 = 0.02;

/// A tree of folds; the root is first.
pub(super) struct FoldTree {
    nodes: Vec<Node>,
}

struct Node {
    angles: LegAngles,
    parent: usize,
    wins: f64,
}

impl FoldTree {
    /// Grown from `root`; `win` is what the angles win (m).
    pub fn grown(
        root: LegAngles,
        seed: u64,
        win: &impl Fn(&LegSpace, &LegAngles) -> f64,
        space: &mut LegSpace,
    ) -> FoldTree {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let wins = win(space, &root);
        let mut tree = FoldTree { nodes: vec![Node { angles: root, parent: 0, wins }] };
        let goals = goals(wins, win, space, &mut rng);
        for i in 0..EXTENSIONS {
            let toward = match goals.get(i / GOAL_EVERY % GOALS) {
                Some(goal) if i % GOAL_EVERY == 0 => *goal,
                _ => any(space, &mut rng),
            };
            tree.extend(&toward, win, space);
        }
        tree
    }

    fn extend(
        &mut self,
        toward: &LegAngles,
        win: &impl Fn(&LegSpace, &LegAngles) -> f64,
        space: &mut LegSpace,
    ) {
        let (mut parent, mut nearest) = (0, f64::INFINITY);
        for (i, node) in self.nodes.iter().enumerate() {
            let distance = (node.angles - toward).amax();
            if distance < nearest {
                (parent, nearest) = (i, distance);
            }
        }
        let from = self.nodes[parent].angles;
        let angles = from.lerp(toward, (EDGE / nearest.max(EDGE)).min(1.0));
        if nearest > 1e-6 && space.edge_is_free(&from, &angles) {
            let wins = win(space, &angles);
            self.nodes.push(Node { angles, parent, wins });
        }
    }

    /// The way from the root to the node that wins most, then on in small steps of single joints while
    /// they win.
    pub fn way_to_best(
        &self,
        win: &impl Fn(&LegSpace, &LegAngles) -> f64,
        space: &mut LegSpace,
    ) -> Vec<LegAngles> {
        let mut best = 0;
        for (i, node) in self.nodes.iter().enumerate() {
            if node.wins > self.nodes[best].wins {
                best = i;
            }
        }
        let mut way = vec![self.nodes[best].angles];
        let mut at = best;
        while at != 0 {
            at = self.nodes[at].parent;
            way.push(self.nodes[at].angles);
        }
        way.reverse();
        let mut angles = self.nodes[best].angles;
        let mut value = self.nodes[best].wins;
        let mut step = FIRST_STEP;
        while step > LAST_STEP {
            let mut better = false;
            for joint in 0..angles.len() {
                for side in [step, -step] {
                    let mut next = angles;
                    next[joint] += side;
                    let wins = win(space, &next);
                    if wins > value + 1e-9 && space.edge_is_free(&angles, &next) {
                        (angles, value, better) = (next, wins, true);
                        way.push(next);
                    }
                }
            }
            if !better {
                step *= 0.5;
            }
        }
        way
    }
}

/// The free ones that win most among seeded angles.
fn goals(
    now: f64,
    win: &impl Fn(&LegSpace, &LegAngles) -> f64,
    space: &mut LegSpace,
    rng: &mut ChaCha8Rng,
) -> Vec<LegAngles> {
    let mut found: Vec<(f64, LegAngles)> = Vec::new();
    for _ in 0..SAMPLES {
        let angles = any(space, rng);
        let wins = win(space, &angles);
        // The worst of those kept is last; looking at what is free costs most.
        let enough = found.get(GOALS - 1).map_or(now, |(worst, _)| *worst);
        if wins > enough && space.is_free(&angles) {
            found.push((wins, angles));
            found.sort_by(|a, b| b.0.total_cmp(&a.0));
            found.truncate(GOALS);
        }
    }
    found.into_iter().map(|(_, angles)| angles).collect()
}

fn any(space: &LegSpace, rng: &mut ChaCha8Rng) -> LegAngles {
    let (lower, upper) = (space.lower(), space.upper());
    LegAngles::from_fn(|i, _| {
        if lower[i] < upper[i] { rng.random_range(lower[i]..upper[i]) } else { lower[i] }
    })
}
