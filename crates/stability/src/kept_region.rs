//! A region of friction that is kept, so that moving one contact costs less than the region anew.
//!
//! A vertex of the outline is the best basis of the stance's linear program for a range of directions
//! ([`crate::force_region`]). Where no unit force of the moved contact is in a basis, the basis is as
//! feasible as before, and its vertex stays where it is; with the basis' multipliers y, kept, the
//! moved contact's unit forces a have the reduced costs c - y a, and the basis stays the best wherever
//! these are not above zero: a part of its range. Only the ranges that are then left open are
//! walked anew, each from the basis before it. What other contacts' unit forces had to say within a
//! vertex' range was said when it was found.
//!
//! Frame `g` (z up), meters.

use std::f64::consts::TAU;

use nalgebra::{Point2, Point3, Vector2};

use crate::contact::{self, ContactError};
use crate::force_region::{ForceRegion, ForceSet, check, outlined, region_of, unit_force};
use crate::simplex::{Tableau, Unsolved, ZERO, turn};

/// Balances of a stance of friction cones: three forces, the twist, the cap.
const BALANCES: usize = 5;

/// Directions nearer than this (rad) are one.
const SAME: f64 = 1e-12;

/// A contact that goes farther than this from the others, in sizes of the stance as it was, makes
/// all new: numbers are to stay of order one.
const FARTHEST: f64 = 4.0;

type Column = ([f64; BALANCES], [f64; 2]);

/// A region of friction cones and what it was found with.
#[derive(Debug, Clone)]
pub struct KeptRegion {
    sets: Vec<ForceSet>,
    region: ForceRegion,
    center: Point3<f64>,
    size: f64,
    /// Unit forces of all sets, what is left of the cap, then one unit variable a balance.
    columns: Vec<Column>,
    /// The contact of each unit force.
    owner: Vec<usize>,
    /// Counter-clockwise; none where every move makes all anew.
    vertices: Vec<Vertex>,
}

/// A basis, and the directions for which it is the best.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    at: [f64; 2],
    basis: [usize; BALANCES],
    /// The variables of the basis that are above zero, first, and how many they are.
    loaded: [usize; BALANCES],
    n_loaded: usize,
    /// By balance, for both objectives.
    multipliers: [[f64; 2]; BALANCES],
    from: [f64; 2],
    to: [f64; 2],
}

impl KeptRegion {
    /// The region of friction cones: sets of rays. Sets with corners, as joint torques and ropes make
    /// them, are taken, but every move then makes all anew.
    pub fn new(sets: Vec<ForceSet>) -> Result<KeptRegion, ContactError> {
        check(&sets, 1.0)?;
        let region = ForceRegion::empty(crate::force_region::Emptiness::Slides);
        let mut kept = KeptRegion {
            sets,
            region,
            center: Point3::origin(),
            size: 1.0,
            columns: Vec::new(),
            owner: Vec::new(),
            vertices: Vec::new(),
        };
        kept.make();
        Ok(kept)
    }

    /// The region.
    pub fn region(&self) -> &ForceRegion {
        &self.region
    }

    /// What each contact can give.
    pub fn sets(&self) -> &[ForceSet] {
        &self.sets
    }

    /// The region with another set in the place of one: a foot that was put down elsewhere.
    ///
    /// Errors: a contact that is not there, or cannot be worked with; then nothing changes.
    pub fn moved(&mut self, contact: usize, set: ForceSet) -> Result<&ForceRegion, ContactError> {
        if contact >= self.sets.len() {
            return Err(ContactError::NoContact { contact, n_contacts: self.sets.len() });
        }
        check(std::slice::from_ref(&set), 1.0).map_err(|error| match error {
            ContactError::NotFinite { .. } => ContactError::NotFinite { contact },
            other => other,
        })?;
        let alike = set.corners.is_empty() && set.rays.len() == self.sets[contact].rays.len();
        let near = (set.position - self.center).norm() < FARTHEST * self.size;
        self.sets[contact] = set;
        if !(alike && near && self.walk_open(contact).is_some()) {
            self.make();
        }
        Ok(&self.region)
    }

    /// All anew.
    fn make(&mut self) {
        self.vertices.clear();
        if self.sets.iter().any(|set| !set.corners.is_empty()) || self.make_kept().is_none() {
            self.vertices.clear();
            self.region = region_of(&self.sets.iter().collect::<Vec<_>>(), 1.0);
        }
    }

    fn make_kept(&mut self) -> Option<()> {
        self.center = contact::center(self.sets.iter().map(|set| set.position));
        let away = |set: &ForceSet| (set.position - self.center).norm();
        self.size = self.sets.iter().map(away).fold(0.0, f64::max);
        if self.size <= 1e-9 {
            return None;
        }
        let units = |set: &ForceSet| set.rays.iter().map(|r| self.unit(set, r)).collect::<Vec<_>>();
        self.columns = self.sets.iter().flat_map(units).collect();
        self.owner.clear();
        for (i, set) in self.sets.iter().enumerate() {
            self.owner.extend(set.rays.iter().map(|_| i));
        }
        // What is left of the cap is the unit variable of its balance.
        let unit = |i: usize| {
            let mut balance = [0.0; BALANCES];
            balance[i] = 1.0;
            (balance, [0.0, 0.0])
        };
        self.columns.push(unit(BALANCES - 1));
        self.columns.extend((0..BALANCES).map(unit));
        let mut program = self.program();
        program.find_feasible().ok()?;
        // A balance that follows from the others need not do so once a contact has moved.
        if program.basis().len() < BALANCES {
            return None;
        }
        let u = [1.0, 0.0];
        program.maximize(u).ok()?;
        let mut found = vec![self.vertex(&program, u)];
        program.walk(u, TAU, |here, from| found.push(self.vertex(here, from))).ok()?;
        close(&mut found, u);
        self.keep(found);
        Some(())
    }

    fn unit(&self, set: &ForceSet, ray: &nalgebra::Vector3<f64>) -> Column {
        unit_force(&((set.position - self.center) / self.size), &ray.normalize())
    }

    fn program(&self) -> Tableau {
        let mut program = Tableau::new(&[0.0, 0.0, 1.0, 0.0, 1.0], &self.columns);
        program.keep_out_from(self.units());
        program
    }

    /// Where the unit variables of the balances begin.
    fn units(&self) -> usize {
        self.owner.len() + 1
    }

    fn vertex(&self, here: &Tableau, from: [f64; 2]) -> Vertex {
        let mut basis = [0; BALANCES];
        basis.copy_from_slice(here.basis());
        let (mut loaded, mut n_loaded) = ([0; BALANCES], 0);
        for (place, variable) in basis.iter().enumerate() {
            if here.is_loaded(place) {
                loaded[n_loaded] = *variable;
                n_loaded += 1;
            }
        }
        let multipliers = std::array::from_fn(|i| here.multipliers(self.units(), i));
        Vertex { at: here.values(), basis, loaded, n_loaded, multipliers, from, to: from }
    }

    /// The region after `contact` moved, from what is left of the outline; `None` where nothing is, or
    /// numbers do not do.
    fn walk_open(&mut self, contact: usize) -> Option<()> {
        let first = self.owner.iter().position(|owner| *owner == contact)?;
        let mine = first..first + self.sets[contact].rays.len();
        for (j, ray) in mine.clone().zip(&self.sets[contact].rays) {
            let column = self.unit(&self.sets[contact], ray);
            self.columns[j] = column;
        }
        let moved = &self.columns[mine.clone()];
        let stays = |vertex: &Vertex| {
            let is_in = vertex.basis.iter().any(|variable| mine.contains(variable));
            (!is_in).then(|| vertex.narrowed(moved)).flatten()
        };
        let left: Vec<Vertex> = self.vertices.iter().filter_map(stays).collect();
        let mut found: Vec<Vertex> = Vec::with_capacity(self.vertices.len() + 8);
        for (i, vertex) in left.iter().enumerate() {
            let next = left[(i + 1) % left.len()].from;
            match found.last_mut() {
                Some(before) if before.is_same(vertex) => before.to = vertex.to,
                _ => found.push(*vertex),
            }
            let mut open = turn(vertex.to, next);
            if open < -SAME || left.len() == 1 {
                open += TAU;
            }
            if open <= SAME {
                continue;
            }
            let mut program = self.program();
            if !program.take_basis(&vertex.basis) {
                return None;
            }
            let at = found.len();
            let visit = |here: &Tableau, from: [f64; 2]| found.push(self.vertex(here, from));
            program.walk(vertex.to, open, visit).map_err(|_: Unsolved| ()).ok()?;
            // The last before the open range goes on into it.
            close(&mut found[at - 1..], next);
        }
        let (first, last) = (*found.first()?, *found.last()?);
        if found.len() > 1 && first.is_same(&last) {
            found[0].from = last.from;
            found.pop();
        }
        self.keep(found);
        Some(())
    }

    fn keep(&mut self, found: Vec<Vertex>) {
        self.vertices = found;
        let place = |at: [f64; 2]| -> Point2<f64> {
            self.center.xy() + Vector2::new(at[0], at[1]) * self.size
        };
        let outline = self.vertices.iter().map(|v| (place(v.at), &v.loaded[..v.n_loaded]));
        self.region = outlined(outline, &self.owner);
        // Vertices of an area are the best for less than half a turn; less can be told of others.
        if self.region.region.area().is_none() {
            self.vertices.clear();
        }
    }
}

/// Each vertex ends where the next begins, the last at `to`.
fn close(vertices: &mut [Vertex], to: [f64; 2]) {
    for i in 0..vertices.len() {
        vertices[i].to = vertices.get(i + 1).map_or(to, |next| next.from);
    }
}

impl Vertex {
    fn is_same(&self, other: &Vertex) -> bool {
        self.basis.iter().all(|variable| other.basis.contains(variable))
    }

    /// The same where it stays the best beside these unit forces.
    fn narrowed(&self, moved: &[Column]) -> Option<Vertex> {
        let mut left = *self;
        for (balance, place) in moved {
            let mut cost = *place;
            for (a, y) in balance.iter().zip(&self.multipliers) {
                cost[0] -= a * y[0];
                cost[1] -= a * y[1];
            }
            let gain = |u: [f64; 2]| u[0] * cost[0] + u[1] * cost[1];
            // Where the cost is at right angles; before it coming from `from`, after it going to `to`.
            let length = cost[0].hypot(cost[1]);
            match (gain(left.from) <= ZERO, gain(left.to) <= ZERO) {
                (true, true) => {}
                (false, false) => return None,
                (false, true) => left.from = [-cost[1] / length, cost[0] / length],
                (true, false) => left.to = [cost[1] / length, -cost[0] / length],
            }
        }
        (turn(left.from, left.to) >= 0.0).then_some(left)
    }
}
