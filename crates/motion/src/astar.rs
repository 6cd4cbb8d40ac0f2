//! A* of the wheel on a grid in task space (FootFall, AIAA SPACE 2008, sec. III; F80).
//!
//! The grid is one of cells of the wheel's center in `world`, with the start in the middle of a
//! cell. In each cell the wheel is turned as the start has it, as the goal has it, or between them
//! by progress; each branch of the leg that brings the wheel there is a node. A node has edges to
//! the 26 cells around it, to the branch that is nearest to its own angles (largest joint), and to
//! the other nodes of its own cell; near the goal also to the goal's own angles. Edges are tested
//! lazily: when a node is taken from the queue.
//!
//! Cost is Euclidean length in the joints (rad). The straight way in the joints to the goal's own
//! angles is a lower bound of what is left, and a sharper one than the wheel's distance over the
//! largest lever; a weight above 1 trades length for work. No random numbers.
//!
//! Failure is no proof that there is no path, not even with the whole grid searched: a path may
//! lead between its nodes.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rover::LegAngles;

use crate::answer::PathPlanner;
use crate::planner::{Meter, PathSearch, Query, Search, SearchOutcome};
use crate::space::{WheelSpace, distance};
use crate::watch::Watch;

/// The planner, with its only parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AStar {
    /// Factor on the estimate of what is left; 1 gives the shortest way on the grid.
    pub weight: f64,
}

impl Default for AStar {
    fn default() -> AStar {
        AStar { weight: 1.5 }
    }
}

/// Turns nearer than this to each other (rad) count as one.
const SAME_TURN: f64 = 1e-3;

/// The first two nodes.
const START: usize = 0;
const GOAL: usize = 1;

impl PathSearch for AStar {
    fn name(&self) -> PathPlanner {
        PathPlanner::AStar
    }

    fn search(&self, space: &mut dyn WheelSpace, query: &Query, watch: &mut dyn Watch) -> Search {
        let mut grid = Grid::new(space, query, self.weight);
        let outcome = match grid.run(space, watch) {
            Ok(path) => SearchOutcome::Found(path),
            Err(end) => end,
        };
        let n_nodes = grid.nodes.len();
        grid.meter.end(space, outcome, n_nodes)
    }
}

/// A cell by its place on the grid; the start is in the middle of (0, 0, 0).
type CellIndex = [i32; 3];

struct Node {
    angles: LegAngles,
    cell: CellIndex,
    /// Which way the wheel is turned in this cell.
    turn: usize,
    /// `None` until the angles are looked at.
    is_free: Option<bool>,
    /// The node before on the best way from the start; `None` until reached.
    parent: Option<usize>,
}

/// A way to reach a node, not tested yet.
struct Candidate {
    /// Length so far and estimate of the rest (rad).
    total: f64,
    length: f64,
    node: usize,
    parent: usize,
}

impl Ord for Candidate {
    /// The greatest candidate is the one with the smallest total; the older node at a tie.
    fn cmp(&self, other: &Candidate) -> Ordering {
        let by_total = other.total.total_cmp(&self.total);
        by_total.then(other.node.cmp(&self.node)).then(other.parent.cmp(&self.parent))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Candidate) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Candidate) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

struct Grid {
    start: Isometry3<f64>,
    goal: Isometry3<f64>,
    /// Side of a cell (m).
    side: f64,
    weight: f64,
    max_expanded: usize,
    nodes: Vec<Node>,
    nodes_in: BTreeMap<CellIndex, Vec<usize>>,
    queue: BinaryHeap<Candidate>,
    meter: Meter,
}

impl Grid {
    fn new(space: &dyn WheelSpace, query: &Query, weight: f64) -> Grid {
        let (start, goal) = (space.wheel(&query.start), space.wheel(&query.goal));
        let mut grid = Grid {
            start,
            goal,
            side: query.cell,
            weight,
            max_expanded: query.max_nodes,
            nodes: Vec::new(),
            nodes_in: BTreeMap::new(),
            queue: BinaryHeap::new(),
            meter: Meter::new(space, query),
        };
        let of_goal = (goal.translation.vector - start.translation.vector) / query.cell;
        let goal_cell = [of_goal.x, of_goal.y, of_goal.z].map(|x| x.round() as i32);
        for (angles, cell) in [(query.start, [0; 3]), (query.goal, goal_cell)] {
            let turn = usize::MAX;
            grid.nodes.push(Node { angles, cell, turn, is_free: None, parent: None });
        }
        grid
    }

    fn run(
        &mut self,
        space: &mut dyn WheelSpace,
        watch: &mut dyn Watch,
    ) -> Result<Vec<LegAngles>, SearchOutcome> {
        self.nodes[START].parent = Some(START);
        self.offer(START, 0.0, GOAL);
        self.expand(space, START, 0.0);
        let mut n_expanded = 1;
        while let Some(candidate) = self.queue.pop() {
            if self.nodes[candidate.node].parent.is_some() {
                continue;
            }
            self.meter.must_end(space, watch).map_or(Ok(()), Err)?;
            if !self.test(space, &candidate) {
                continue;
            }
            self.nodes[candidate.node].parent = Some(candidate.parent);
            if candidate.node == GOAL {
                return Ok(self.path());
            }
            if n_expanded >= self.max_expanded {
                return Err(SearchOutcome::NotFound { exhausted: false });
            }
            n_expanded += 1;
            self.expand(space, candidate.node, candidate.length);
        }
        Err(SearchOutcome::NotFound { exhausted: true })
    }

    /// Is the node free, and the edge to it?
    fn test(&mut self, space: &mut dyn WheelSpace, candidate: &Candidate) -> bool {
        let node = &mut self.nodes[candidate.node];
        let angles = node.angles;
        if !*node.is_free.get_or_insert_with(|| space.is_free(&angles)) {
            return false;
        }
        self.meter.edge_is_free(space, &self.nodes[candidate.parent].angles, &angles)
    }

    /// Offers all edges from a node that was reached over this length (rad).
    fn expand(&mut self, space: &dyn WheelSpace, from: usize, length: f64) {
        let cell = self.nodes[from].cell;
        for offset in offsets() {
            let there: CellIndex = std::array::from_fn(|i| cell[i] + offset[i]);
            self.solve(space, there);
            let is_here = offset == [0; 3];
            for to in self.neighbors(from, there, is_here) {
                self.offer(from, length, to);
            }
        }
        let gap = self.center_of(cell) - self.goal.translation.vector;
        if gap.amax() <= self.side {
            self.offer(from, length, GOAL);
        }
    }

    /// In its own cell all other nodes, in another the nearest branch for each turn.
    fn neighbors(&self, from: usize, there: CellIndex, is_here: bool) -> Vec<usize> {
        let all = &self.nodes_in[&there];
        if is_here {
            return all.iter().copied().filter(|to| *to != from).collect();
        }
        let angles = &self.nodes[from].angles;
        let change = |to: &usize| distance(&self.nodes[*to].angles, angles);
        let same_turn = |a: &usize, b: &usize| self.nodes[*a].turn == self.nodes[*b].turn;
        all.chunk_by(same_turn)
            .filter_map(|branches| {
                branches.iter().copied().min_by(|a, b| change(a).total_cmp(&change(b)))
            })
            .collect()
    }

    fn offer(&mut self, parent: usize, length: f64, node: usize) {
        if self.nodes[node].parent.is_some() || self.nodes[node].is_free == Some(false) {
            return;
        }
        let angles = &self.nodes[node].angles;
        let length = length + (angles - self.nodes[parent].angles).norm();
        let total = length + self.weight * (self.nodes[GOAL].angles - angles).norm();
        self.queue.push(Candidate { total, length, node, parent });
    }

    fn center_of(&self, cell: CellIndex) -> Vector3<f64> {
        self.start.translation.vector + Vector3::from(cell.map(f64::from)) * self.side
    }

    /// Makes the nodes of a cell, once: none where the wheel is out of reach.
    fn solve(&mut self, space: &dyn WheelSpace, cell: CellIndex) {
        if self.nodes_in.contains_key(&cell) {
            return;
        }
        let center = self.center_of(cell);
        let mut here = Vec::new();
        for (turn, rotation) in self.turns(&center).into_iter().enumerate() {
            let wheel = Isometry3::from_parts(Translation3::from(center), rotation);
            for angles in space.angles_at(&wheel) {
                here.push(self.nodes.len());
                self.nodes.push(Node { angles, cell, turn, is_free: None, parent: None });
            }
        }
        self.nodes_in.insert(cell, here);
    }

    /// Between start and goal by progress, as the start, as the goal; each once.
    fn turns(&self, center: &Vector3<f64>) -> Vec<UnitQuaternion<f64>> {
        let (start, goal) = (&self.start.rotation, &self.goal.rotation);
        let done = (center - self.start.translation.vector).norm();
        let left = (center - self.goal.translation.vector).norm();
        let progress = if done + left > 0.0 { done / (done + left) } else { 0.5 };
        let mut turns = Vec::from_iter(start.try_slerp(goal, progress, 1e-9));
        for turn in [start, goal] {
            if turns.iter().all(|t| t.angle_to(turn) > SAME_TURN) {
                turns.push(*turn);
            }
        }
        turns
    }

    fn path(&self) -> Vec<LegAngles> {
        let up = |i: &usize| (*i != START).then(|| self.nodes[*i].parent).flatten();
        let mut path: Vec<LegAngles> =
            std::iter::successors(Some(GOAL), up).map(|i| self.nodes[i].angles).collect();
        path.reverse();
        path
    }
}

/// A cell itself and the 26 around it.
fn offsets() -> impl Iterator<Item = CellIndex> {
    (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
}
