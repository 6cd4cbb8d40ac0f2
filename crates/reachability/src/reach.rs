//! All cells of one leg or more, by several threads.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use collision::{LegChecker, Scene};
use geometry::Grid;
use rover::{Configuration, LegId};

use crate::answer::{Cell, CellClass, ReachGrid, ReachOptions, Reason};
use crate::cell::{Rank, Searcher, Worked};
use crate::look::{Look, seen};

/// Cells along a side of the tiles that the work is split into. Within a tile cells learn from each
/// other; tiles know nothing of each other, so that the answer does not depend on who does which.
pub(crate) const TILE: usize = 16;

/// Where `leg` can stand with the rest of the robot as in `configuration`, for all cells within a
/// circle of the leg's length around its hip (F43).
///
/// `stop` is asked once a tile of 16 x 16 cells; `None` if it said so, or if the resolution would need
/// more than a million cells or is not a positive number.
pub fn reach(
    scene: &Scene,
    configuration: &Configuration,
    gravity: f64,
    leg: LegId,
    options: &ReachOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<ReachGrid> {
    reach_legs(scene, configuration, gravity, &[leg], options, stop)?.pop()
}

/// As [`reach`] for several legs, in the order given: each with all the others where they are.
pub fn reach_legs(
    scene: &Scene,
    configuration: &Configuration,
    gravity: f64,
    legs: &[LegId],
    options: &ReachOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<ReachGrid>> {
    let seen = seen(scene, configuration);
    let looks: Vec<Look> = legs
        .iter()
        .map(|leg| Look::new(scene, configuration, &seen, gravity, *leg, options))
        .collect();
    let mut jobs = looks.iter().map(|look| Job::new(look, look.grid()?)).collect::<Option<_>>()?;
    run(&mut jobs, options.workers, stop)?;
    jobs.iter().map(|job| ReachGrid::of(job.grid, &job.cells)).collect()
}

/// The cells of one leg, and which of them are to be found.
pub(crate) struct Job<'a> {
    pub look: &'a Look<'a>,
    pub grid: Grid,
    pub cells: Vec<Cell>,
    pub tiles: Vec<Tile>,
}

/// Columns and rows of a tile.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tile {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

impl<'a> Job<'a> {
    /// All cells of a grid.
    pub fn new(look: &'a Look<'a>, grid: Grid) -> Option<Job<'a>> {
        let nothing = Cell::new(CellClass::Unknown, Reason::None, f64::NAN);
        Some(Job { look, grid, cells: vec![nothing; grid.len()], tiles: tiles(&grid) })
    }
}

impl Job<'_> {
    /// Takes the cells from an answer that has the same ones.
    pub fn take(&mut self, before: &ReachGrid) {
        let classes = before.class.values().iter().zip(before.reason.values());
        let numbers = before.missing.values().iter().zip(before.margin.values());
        for ((cell, (class, reason)), (missing, margin)) in
            self.cells.iter_mut().zip(classes).zip(numbers)
        {
            let (class, reason) = (CellClass::from_number(*class), Reason::from_number(*reason));
            *cell = Cell { class, reason, missing: *missing, margin: *margin };
        }
    }
}

/// The tiles of a grid.
pub(crate) fn tiles(grid: &Grid) -> Vec<Tile> {
    let cut = |n: usize| (0..n).step_by(TILE).map(move |from| from..(from + TILE).min(n));
    cut(grid.ny)
        .flat_map(|rows| cut(grid.nx).map(move |columns| Tile { columns, rows: rows.clone() }))
        .collect()
}

/// Finds all tiles of all jobs; `None` if `stop` said so.
pub(crate) fn run(
    jobs: &mut Vec<Job>,
    workers: usize,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<()> {
    let all: Vec<(usize, usize)> = jobs
        .iter()
        .enumerate()
        .flat_map(|(job, of)| (0..of.tiles.len()).map(move |tile| (job, tile)))
        .collect();
    let next = AtomicUsize::new(0);
    let work = || {
        let mut found = Vec::new();
        let mut at = next.fetch_add(1, Ordering::Relaxed);
        while let Some(&(job, _)) = all.get(at) {
            let of = &jobs[job];
            let (scene, posture) = (of.look.scene, &of.look.posture);
            let checker = LegChecker::new(scene, posture, of.look.leg, None, None);
            let mut searcher = Searcher::new(of.look, &checker);
            while let Some(&(_, tile)) = all.get(at).filter(|(other, _)| *other == job) {
                if stop() {
                    return None;
                }
                found.push((job, tile, of_tile(&mut searcher, &of.grid, &of.tiles[tile])));
                at = next.fetch_add(1, Ordering::Relaxed);
            }
        }
        Some(found)
    };
    let found = std::thread::scope(|threads| {
        let others: Vec<_> = (1..workers.clamp(1, 64)).map(|_| threads.spawn(work)).collect();
        let mut found = work()?;
        for other in others {
            found.extend(other.join().ok()??);
        }
        Some(found)
    })?;
    for (job, tile, cells) in found {
        let job = &mut jobs[job];
        let Tile { columns, rows } = &job.tiles[tile];
        for (iy, row) in rows.clone().zip(cells.chunks(columns.len())) {
            let start = job.grid.index(columns.start, iy);
            job.cells[start..start + row.len()].copy_from_slice(row);
        }
    }
    Some(())
}

fn of_tile(searcher: &mut Searcher, grid: &Grid, tile: &Tile) -> Vec<Cell> {
    searcher.begin();
    let width = tile.columns.len();
    let nothing = Cell::new(CellClass::Unknown, Reason::None, f64::NAN);
    let mut cells = vec![nothing; width * tile.rows.len()];
    let mut below: Vec<Option<Worked>> = vec![None; width];
    let mut before = None;
    // To and fro, so that each cell is next to the one before.
    for (row, iy) in tile.rows.clone().enumerate() {
        for step in 0..width {
            let column = if row % 2 == 0 { step } else { width - 1 - step };
            let p = grid.position(tile.columns.start + column, iy);
            let found = searcher.cell(p, &[before, below[column]]);
            cells[row * width + column] = found.cell;
            let worked = found.way.filter(|(rank, _)| *rank == Rank::Reachable);
            let worked = worked.map(|(_, way)| Worked {
                orientation: way.orientation,
                angles: way.angles,
                branch: way.branch,
            });
            (before, below[column]) = (worked.or(before), worked.or(below[column]));
        }
    }
    cells
}
