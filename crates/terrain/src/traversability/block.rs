//! The layers of a map, block by block, at a cost that hardly grows with the window.

use std::ops::Range;

use geometry::Raster;

use super::judge::{Answers, Judge};
use super::step::{Patch, largest_ranges};
use super::sums::{Columns, Quadrants, Sums, Trusts};
use super::{Layers, Limits};

/// Cells a side of a block, at least.
const BLOCK: usize = 256;

/// A rectangle of cells, half open.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Columns.
    pub xs: Range<usize>,
    /// Rows.
    pub ys: Range<usize>,
}

impl Span {
    /// What both have; empty ranges where they do not meet.
    fn meet(&self, other: &Span) -> Span {
        let meet = |a: &Range<usize>, b: &Range<usize>| {
            let start = a.start.max(b.start);
            start..a.end.min(b.end).max(start)
        };
        Span { xs: meet(&self.xs, &other.xs), ys: meet(&self.ys, &other.ys) }
    }

    /// The smallest span that holds both.
    fn hull(&self, other: &Span) -> Span {
        let hull = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        Span { xs: hull(&self.xs, &other.xs), ys: hull(&self.ys, &other.ys) }
    }

    fn is_empty(&self) -> bool {
        self.xs.is_empty() || self.ys.is_empty()
    }

    /// With `border` more cells on each side, but none below 0.
    fn grown(&self, border: usize) -> Span {
        let grown = |r: &Range<usize>| r.start.saturating_sub(border)..r.end.saturating_add(border);
        Span { xs: grown(&self.xs), ys: grown(&self.ys) }
    }
}

/// What layers are made from.
pub(super) struct Ground<'a> {
    pub heights: &'a Raster<f32>,
    /// How far each known cell is to be trusted, 0 to 1; fully where there is none.
    pub trust: Option<&'a Raster<f32>>,
}

/// Fills `layers` from the ground on the same grid, with an odd window of `w` cells a side: all of
/// it, or only what the changed cells have to do with. Gives the number of cells that were judged.
///
/// The answer of a cell depends on the ground and the block it is in alone, so that both ways give
/// the same bits.
pub(super) fn fill(
    ground: &Ground,
    w: usize,
    limits: &Limits,
    layers: &mut Layers,
    changed: Option<&[Span]>,
) -> usize {
    let grid = *ground.heights.grid();
    let side = BLOCK.max(4 * w);
    let judge = Judge::new(w, grid.resolution, limits);
    let mut n_judged = 0;
    let corners =
        (0..grid.ny).step_by(side).flat_map(|y| (0..grid.nx).step_by(side).map(move |x| (x, y)));
    for (i, (x0, y0)) in corners.enumerate() {
        let all = Span { xs: x0..(x0 + side).min(grid.nx), ys: y0..(y0 + side).min(grid.ny) };
        let block = Block { all: all.clone(), half: w / 2 };
        let border = block.half + 1;
        let wanted = match changed {
            None => all,
            Some(changed) => {
                let near = changed.iter().filter(|span| !span.is_empty());
                let near = near.map(|span| span.grown(border).meet(&all));
                let near = near.filter(|span| !span.is_empty()).reduce(|a, b| a.hull(&b));
                let Some(near) = near else { continue };
                near
            }
        };
        let reference = block.reference(ground.heights);
        // Another reference changes the last digits of the whole block.
        let is_same =
            layers.references.get(i).is_some_and(|old| old.to_bits() == reference.to_bits());
        let wanted = if is_same { wanted } else { block.all.clone() };
        match layers.references.get_mut(i) {
            Some(old) => *old = reference,
            None => layers.references.push(reference),
        }
        n_judged += wanted.xs.len() * wanted.ys.len();
        block.fill(ground, f64::from(reference), &wanted, &judge, layers);
    }
    n_judged
}

/// A rectangle of cells whose sums begin anew.
struct Block {
    all: Span,
    /// Cells from the window's center to its edge.
    half: usize,
}

impl Block {
    /// The first known height of the block, or else of its border (m); NaN if there is none. What
    /// changes beside the block should not change its reference.
    fn reference(&self, heights: &Raster<f32>) -> f32 {
        let grid = heights.grid();
        let first_known = |span: &Span| {
            let xs = span.xs.start..span.xs.end.min(grid.nx);
            let rows = (span.ys.start..span.ys.end.min(grid.ny)).map(|iy| grid.index(0, iy));
            let mut z = rows.flat_map(|row| &heights.values()[row + xs.start..row + xs.end]);
            z.find(|z| !z.is_nan()).copied()
        };
        let border = || first_known(&self.all.grown(self.half + 1));
        first_known(&self.all).or_else(border).unwrap_or(f32::NAN)
    }

    /// Judges the wanted cells of the block. Sums run from the block's lower left corner whatever is
    /// wanted.
    fn fill(
        &self,
        ground: &Ground,
        reference: f64,
        wanted: &Span,
        judge: &Judge,
        layers: &mut Layers,
    ) {
        if reference.is_nan() {
            return layers.forget(wanted);
        }
        let (half, w) = (self.half, 2 * self.half + 1);
        let (nx, first) = (wanted.xs.end - self.all.xs.start, wanted.xs.start - self.all.xs.start);
        let (n_rows, first_row) =
            (wanted.ys.end - self.all.ys.start, wanted.ys.start - self.all.ys.start);
        let patch = self.patch(ground.heights, nx, n_rows, f32::NAN);
        let ranges = largest_ranges(&patch.part(first, first_row), w);
        let is_whole = patch.z.iter().all(|z| !z.is_nan());
        let trust = ground.trust.map(|trust| self.patch(trust, nx, n_rows, 0.0));
        let row = |iy: usize| patch.row(iy, nx + w - 1);
        let mut columns = Columns::new(nx + w - 1, half);
        for iy in 0..w - 1 {
            columns.enter(row(iy), reference);
        }
        let mut sums = Sums::new(nx);
        let mut least = vec![f64::INFINITY; nx];
        let mut quadrants = Quadrants::new(nx + w - 1, half);
        if !is_whole {
            (0..w - 1).for_each(|iy| quadrants.enter(row(iy), iy));
        }
        let mut trusts = trust.map(|trust| Trusts::new(&patch, &trust, nx + w - 1, w));
        for iy in 0..n_rows {
            columns.enter(row(iy + w - 1), reference);
            if !is_whole {
                quadrants.slide(iy, &row);
            }
            if let Some(trusts) = &mut trusts {
                trusts.slide(iy);
            }
            if iy >= first_row {
                columns.window_sums(&mut sums, first);
                if !is_whole {
                    quadrants.sum();
                    least.iter_mut().enumerate().for_each(|(ix, n)| *n = quadrants.least(ix));
                }
                let certainty = trusts.as_mut().map(Trusts::certainty);
                let start = layers.class.grid().index(wanted.xs.start, self.all.ys.start + iy);
                let mut answers = Answers::of(layers, start..start + wanted.xs.len());
                let ranges = &ranges[(iy - first_row) * (nx - first)..][..nx - first];
                let certainty = certainty.map(|row| &row[first..nx]);
                judge.row(&sums, first, ranges, &least[first..], certainty, &mut answers);
            }
            columns.leave(row(iy), reference);
        }
    }

    /// The lower left `nx` x `ny` cells with a border of half a window and one cell.
    fn patch(&self, values: &Raster<f32>, nx: usize, ny: usize, outside: f32) -> Patch {
        let grid = values.grid();
        let border = self.half + 1;
        let (x0, y0) = (self.all.xs.start, self.all.ys.start);
        let (width, height) = (nx + 2 * border, ny + 2 * border);
        let mut z = vec![outside; width * height];
        let xs = x0.saturating_sub(border)..(x0 + nx + border).min(grid.nx);
        let ys = y0.saturating_sub(border)..(y0 + ny + border).min(grid.ny);
        for iy in ys {
            let to = (iy + border - y0) * width + xs.start + border - x0;
            let from = grid.index(xs.start, iy);
            z[to..to + xs.len()].copy_from_slice(&values.values()[from..from + xs.len()]);
        }
        Patch { width, height, z }
    }
}
