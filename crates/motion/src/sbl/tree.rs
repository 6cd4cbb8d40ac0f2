//! The milestones of one tree of SBL, for picking against density and for the nearest one.

use std::collections::BTreeMap;

use rand::{Rng, RngExt};
use rover::LegAngles;

use crate::nearest::Points;

/// Side of the cells in which milestone density is counted (rad), over the first three joints.
const DENSITY_CELL: f64 = 0.2;

/// Milestones of one tree: by cell, so that crowded cells are not picked more often (F70), and in
/// flat arrays, so that the nearest one is found quickly.
#[derive(Default)]
pub(super) struct Tree {
    cells: Vec<Cell>,
    cell_of: BTreeMap<[i64; 3], usize>,
    points: Points,
    /// The milestone of each point.
    milestones: Vec<usize>,
}

struct Cell {
    key: [i64; 3],
    milestones: Vec<usize>,
}

impl Tree {
    fn key(angles: &LegAngles) -> [i64; 3] {
        [0, 1, 2].map(|i| (angles[i] / DENSITY_CELL).floor() as i64)
    }

    /// The place of the milestone in the flat arrays.
    pub fn insert(&mut self, milestone: usize, angles: &LegAngles) -> usize {
        let key = Tree::key(angles);
        let cell = *self.cell_of.entry(key).or_insert_with(|| {
            self.cells.push(Cell { key, milestones: Vec::new() });
            self.cells.len() - 1
        });
        self.cells[cell].milestones.push(milestone);
        self.points.push(angles);
        self.milestones.push(milestone);
        self.points.len() - 1
    }

    /// Takes a milestone out; the milestone that got its place in the flat arrays, if any.
    pub fn remove(&mut self, milestone: usize, angles: &LegAngles, slot: usize) -> Option<usize> {
        self.points.swap_remove(slot);
        self.milestones.swap_remove(slot);
        let key = Tree::key(angles);
        if let Some(&cell) = self.cell_of.get(&key) {
            self.cells[cell].milestones.retain(|m| *m != milestone);
            if self.cells[cell].milestones.is_empty() {
                self.cell_of.remove(&key);
                self.cells.swap_remove(cell);
                if let Some(moved) = self.cells.get(cell) {
                    self.cell_of.insert(moved.key, cell);
                }
            }
        }
        self.milestones.get(slot).copied()
    }

    /// A cell at random, then a milestone in it: probability against the local density. A tree
    /// always holds its root.
    pub fn pick(&self, rng: &mut impl Rng) -> usize {
        let cell = &self.cells[rng.random_range(0..self.cells.len())].milestones;
        cell[rng.random_range(0..cell.len())]
    }

    /// The nearest milestone and its distance (rad, largest joint).
    pub fn nearest(&self, angles: &LegAngles) -> Option<(usize, f64)> {
        let near = self.points.nearest_by_largest_joint(angles);
        near.map(|(slot, gap)| (self.milestones[slot], gap))
    }
}

#[cfg(test)]
impl Tree {
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Is the milestone at its place in the flat arrays, and in its cell?
    pub fn holds(&self, milestone: usize, angles: &LegAngles, slot: usize) -> bool {
        let cell = &self.cells[self.cell_of[&Tree::key(angles)]];
        self.milestones[slot] == milestone && cell.milestones.contains(&milestone)
    }
}
