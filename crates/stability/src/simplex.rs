//! A dense simplex for the small linear programs of statics: few balances, many unit forces.
//!
//! A program is `A x = b`, `x ≥ 0`, with two objectives; see [`Tableau`]. Two things are asked of
//! it: the maximum of one objective, and the outline of the *shadow* that the feasible set throws
//! on the plane of both (parametric simplex: the objective is turned once around, and each pivot
//! is a vertex of the outline). Numbers are expected to be of order one.
//!
//! Stances are full of ties: level feet, friction cones that share edges, feet that carry nothing.
//! So that no tie can make the search go in circles, every variable may be as low as a tiny amount
//! of its own below zero while it is decided which one leaves the basis. Values are read from a
//! second right side that is exact, so ties do not blur the result.

use std::f64::consts::TAU;

/// Reduced costs and infeasibilities below this are zero.
pub(crate) const ZERO: f64 = 1e-9;
/// A pivot must be larger than this.
const SMALLEST_PIVOT: f64 = 1e-9;
/// By how much variables may be below zero in decisions.
const SLACK: f64 = 1e-10;
/// Marks a row whose basic variable is artificial.
const ARTIFICIAL: usize = usize::MAX;

/// Why a program has no answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unsolved {
    /// No `x ≥ 0` meets the balances.
    Infeasible,
    /// The objective has no bound.
    Unbounded,
    /// More pivots than any well-posed program of this size needs.
    TooManyPivots,
}

/// A program and its basis. Rows are the balances; columns the variables, then the two right sides.
#[derive(Debug, Clone)]
pub(crate) struct Tableau {
    rows: usize,
    columns: usize,
    /// Columns that may enter the basis are those before this one.
    enterable: usize,
    /// Balances, then both objectives (reduced costs, and minus their values), row by row.
    cells: Vec<f64>,
    basis: Vec<usize>,
    pivots_left: usize,
}

/// A vertex of a shadow.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShadowVertex {
    /// Values of both objectives.
    pub at: [f64; 2],
    /// The basic variables there that are above zero.
    pub loaded: Vec<usize>,
}

impl Tableau {
    /// A program of `rows` balances over the given variables, each with its coefficients in the
    /// balances and in both objectives.
    pub fn new(right_side: &[f64], columns: &[(impl AsRef<[f64]>, [f64; 2])]) -> Tableau {
        let (rows, n) = (right_side.len(), columns.len());
        let width = n + 2;
        let mut cells = vec![0.0; (rows + 2) * width];
        for (j, (coefficients, objectives)) in columns.iter().enumerate() {
            // A share of its own for each variable, from the golden ratio's even scatter.
            let slack = SLACK * (1.0 + (j as f64 * 0.618_033_988_749_895).fract());
            for (i, a) in coefficients.as_ref().iter().chain(objectives).enumerate() {
                cells[i * width + j] = *a;
                if i < rows {
                    cells[i * width + n + 1] += slack * a;
                }
            }
        }
        for (i, b) in right_side.iter().enumerate() {
            cells[i * width + n] = *b;
            cells[i * width + n + 1] += b;
            if cells[i * width + n + 1] < 0.0 {
                for cell in &mut cells[i * width..(i + 1) * width] {
                    *cell = -*cell;
                }
            }
        }
        let basis = vec![ARTIFICIAL; rows];
        let mut new = Tableau { rows, columns: n, enterable: n, cells, basis, pivots_left: 0 };
        new.pivots_left = new.most_pivots();
        new
    }

    fn width(&self) -> usize {
        self.columns + 2
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.cells[i * self.width()..(i + 1) * self.width()]
    }

    fn cell(&self, i: usize, j: usize) -> f64 {
        self.cells[i * self.width() + j]
    }

    /// Variables from this one on stay zero; to be said before [`find_feasible`](Self::find_feasible).
    pub fn keep_out_from(&mut self, column: usize) {
        self.enterable = column;
    }

    /// Takes variables that may have any sign, and which come first, into the basis for good: their
    /// balances are used up. `false` if they do not determine as many balances.
    pub fn eliminate_free(&mut self, n_free: usize) -> bool {
        for j in 0..n_free {
            let largest = (0..self.rows)
                .max_by(|a, b| self.cell(*a, j).abs().total_cmp(&self.cell(*b, j).abs()));
            match largest {
                Some(row) if self.cell(row, j).abs() > SMALLEST_PIVOT => {
                    self.pivot(row, j);
                    self.drop_row(row);
                }
                // It changes nothing that is not used up already.
                _ if self.cell(self.rows, j).abs() < ZERO => {}
                _ => return false,
            }
        }
        let width = self.width();
        for i in 0..self.rows {
            let row = &mut self.cells[i * width..(i + 1) * width];
            row[..n_free].fill(0.0);
            if row[width - 1] < 0.0 {
                row.iter_mut().for_each(|cell| *cell = -*cell);
            }
        }
        for i in self.rows..self.rows + 2 {
            self.cells[i * width..i * width + n_free].fill(0.0);
        }
        true
    }

    fn drop_row(&mut self, row: usize) {
        let width = self.width();
        self.cells.drain(row * width..(row + 1) * width);
        self.basis.remove(row);
        self.rows -= 1;
    }

    /// Brings variable `column` into the basis in place of that of `row`.
    fn pivot(&mut self, row: usize, column: usize) {
        let width = self.width();
        let factor = 1.0 / self.cell(row, column);
        let (before, rest) = self.cells.split_at_mut(row * width);
        let (pivot_row, after) = rest.split_at_mut(width);
        pivot_row.iter_mut().for_each(|cell| *cell *= factor);
        pivot_row[column] = 1.0;
        for other in before.chunks_exact_mut(width).chain(after.chunks_exact_mut(width)) {
            let share = other[column];
            if share != 0.0 {
                for (cell, from) in other.iter_mut().zip(pivot_row.iter()) {
                    *cell -= share * from;
                }
                other[column] = 0.0;
            }
        }
        self.basis[row] = column;
        self.pivots_left = self.pivots_left.saturating_sub(1);
    }

    /// The row whose variable is the first to reach its bound when `column` grows.
    fn leaving(&self, column: usize) -> Option<usize> {
        let width = self.width();
        let mut first: Option<(f64, usize)> = None;
        for i in 0..self.rows {
            let a = self.cells[i * width + column];
            if a > SMALLEST_PIVOT {
                let growth = self.cells[i * width + width - 1].max(0.0) / a;
                if first.is_none_or(|(least, _)| growth < least) {
                    first = Some((growth, i));
                }
            }
        }
        first.map(|(_, row)| row)
    }

    /// Finds a basis that meets the balances. Balances that follow from others are dropped.
    pub fn find_feasible(&mut self) -> Result<(), Unsolved> {
        loop {
            let missing = |j: usize| -> f64 {
                (0..self.rows)
                    .filter(|i| self.basis[*i] == ARTIFICIAL)
                    .map(|i| self.cell(i, j))
                    .sum()
            };
            let open = missing(self.width() - 1);
            let gain =
                (0..self.enterable).map(|j| (missing(j), j)).max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, column)) = gain.filter(|(gain, _)| *gain > ZERO && open > 0.0) else {
                if open > ZERO {
                    return Err(Unsolved::Infeasible);
                }
                break;
            };
            let Some(row) = self.leaving(column) else { return Err(Unsolved::Infeasible) };
            self.pivot(row, column);
            if self.pivots_left == 0 {
                return Err(Unsolved::TooManyPivots);
            }
        }
        let mut row = 0;
        while row < self.rows {
            if self.basis[row] != ARTIFICIAL {
                row += 1;
                continue;
            }
            let column = (0..self.enterable)
                .max_by(|a, b| self.cell(row, *a).abs().total_cmp(&self.cell(row, *b).abs()));
            match column.filter(|j| self.cell(row, *j).abs() > 1e-7) {
                Some(column) => {
                    self.pivot(row, column);
                    row += 1;
                }
                None => self.drop_row(row),
            }
        }
        Ok(())
    }

    /// Maximizes the mix `u` of both objectives, from a feasible basis.
    pub fn maximize(&mut self, u: [f64; 2]) -> Result<(), Unsolved> {
        loop {
            let (first, second) = (self.row(self.rows), self.row(self.rows + 1));
            let mut best = (ZERO, None);
            for j in 0..self.enterable {
                let gain = u[0] * first[j] + u[1] * second[j];
                if gain > best.0 {
                    best = (gain, Some(j));
                }
            }
            let Some(column) = best.1 else { return Ok(()) };
            let Some(row) = self.leaving(column) else { return Err(Unsolved::Unbounded) };
            self.pivot(row, column);
            if self.pivots_left == 0 {
                return Err(Unsolved::TooManyPivots);
            }
        }
    }

    /// Values of both objectives.
    pub fn values(&self) -> [f64; 2] {
        [0, 1].map(|k| -self.cell(self.rows + k, self.columns))
    }

    /// Minus the reduced costs of the first objective of the variables from `column` on: where these
    /// were unit variables without cost, the multipliers of the balances.
    pub fn multipliers_from(&self, column: usize) -> impl Iterator<Item = f64> + '_ {
        self.row(self.rows)[column..self.columns].iter().map(|cost| -cost)
    }

    /// The vertex of the shadow that lies farthest towards `u`, from a feasible basis.
    pub fn vertex_towards(&mut self, u: [f64; 2]) -> Result<ShadowVertex, Unsolved> {
        self.pivots_left = self.most_pivots();
        self.maximize(u)?;
        Ok(self.vertex())
    }

    fn most_pivots(&self) -> usize {
        200 + 20 * (self.rows + self.columns)
    }

    fn vertex(&self) -> ShadowVertex {
        let loaded = (0..self.rows).filter(|i| self.is_loaded(*i)).map(|i| self.basis[i]).collect();
        ShadowVertex { at: self.values(), loaded }
    }

    /// The vertices of the shadow, counter-clockwise, from a feasible basis. Vertices in one place
    /// may follow each other.
    pub fn shadow(&mut self) -> Result<Vec<ShadowVertex>, Unsolved> {
        let u = [1.0, 0.0];
        self.maximize(u)?;
        let mut vertices = vec![self.vertex()];
        self.walk(u, TAU, |here, _| vertices.push(here.vertex()))?;
        Ok(vertices)
    }

    /// Turns the objective counter-clockwise by `most` (rad), from `u` for which the basis is the best,
    /// and visits each further basis with the objective from which on it is.
    pub fn walk(
        &mut self,
        mut u: [f64; 2],
        most: f64,
        mut visit: impl FnMut(&Tableau, [f64; 2]),
    ) -> Result<(), Unsolved> {
        let mut turned = 0.0;
        while let Some((column, next)) = self.next_turn(u) {
            turned += turn(u, next);
            if turned > most {
                break;
            }
            u = next;
            let Some(row) = self.leaving(column) else { return Err(Unsolved::Unbounded) };
            self.pivot(row, column);
            if self.pivots_left == 0 {
                return Err(Unsolved::TooManyPivots);
            }
            visit(self, u);
        }
        Ok(())
    }

    /// Takes these variables into the basis, one for each balance; `false` if they do not determine it.
    pub fn take_basis(&mut self, variables: &[usize]) -> bool {
        variables.len() == self.rows
            && variables.iter().all(|column| {
                let open = (0..self.rows).filter(|i| self.basis[*i] == ARTIFICIAL);
                let largest = |a: &usize, b: &usize| {
                    self.cell(*a, *column).abs().total_cmp(&self.cell(*b, *column).abs())
                };
                match open.max_by(largest) {
                    Some(row) if self.cell(row, *column).abs() > SMALLEST_PIVOT => {
                        self.pivot(row, *column);
                        true
                    }
                    _ => false,
                }
            })
    }

    /// The variables of the basis, one for each balance that is left.
    pub fn basis(&self) -> &[usize] {
        &self.basis
    }

    /// Is this basic variable above zero?
    pub fn is_loaded(&self, place: usize) -> bool {
        self.cell(place, self.columns) > ZERO
    }

    /// The multipliers of balance `i` for both objectives, where the variables from `units` on are the
    /// balances' unit variables without cost.
    pub fn multipliers(&self, units: usize, i: usize) -> [f64; 2] {
        [0, 1].map(|k| -self.cell(self.rows + k, units + i))
    }

    /// The first variable that is worth growing when the objective `u` is turned counter-clockwise,
    /// and the objective at which it begins to be.
    fn next_turn(&self, u: [f64; 2]) -> Option<(usize, [f64; 2])> {
        let (first, second) = (self.row(self.rows), self.row(self.rows + 1));
        let mut best: Option<(f64, usize)> = None;
        for j in 0..self.enterable {
            let (x, y) = (first[j], second[j]);
            let loss = -(u[0] * x + u[1] * y);
            let rise = u[0] * y - u[1] * x;
            // Columns of the basis have neither loss nor rise. Those whose gain only falls until
            // half a turn on come later than all others.
            if x.abs() + y.abs() <= ZERO || (rise <= 0.0 && loss <= ZERO) {
                continue;
            }
            // The cotangent of the angle to turn by.
            let sooner = rise / loss.max(1e-14);
            if best.is_none_or(|(most, _)| sooner > most) {
                best = Some((sooner, j));
            }
        }
        let (_, j) = best?;
        // The objective at right angles to the variable's costs, which are before it.
        let (x, y) = (first[j], second[j]);
        let length = x.hypot(y);
        let next = [y / length, -x / length];
        // Rounding may put it a hair before `u`.
        let turn = u[0] * next[1] - u[1] * next[0];
        let ahead = u[0] * next[0] + u[1] * next[1];
        Some((j, if turn < 0.0 && ahead > 0.0 { u } else { next }))
    }
}

/// The angle from one direction to another (rad), from -π to π, counter-clockwise.
pub(crate) fn turn(from: [f64; 2], to: [f64; 2]) -> f64 {
    (from[0] * to[1] - from[1] * to[0]).atan2(from[0] * to[0] + from[1] * to[1])
}
