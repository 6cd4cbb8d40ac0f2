//! One leg in configurations that follow each other closely, as those of neighboring footfalls do.
//!
//! What is found far from everything is not looked at again before it may have come near: a look tells
//! by how much more than must be kept the two are apart, and each moving part is held by a sphere of
//! its link whose way from one configuration to the next is bounded. So an answer is that of
//! [`LegChecker::violation_at`](crate::LegChecker::violation_at), by proof or by the same look.

use nalgebra::{Matrix3, Point3};
use rover::{Frame, LegFrames};

use crate::checker::{Against, Allowance, Item, LegChecker, Moment, Scratch, Touch};
use crate::form::{Placed, apart_by};
use crate::ground::clear_of_ground;
use crate::look::Look;
use crate::solid::Part;

/// Room beyond what must be kept over the highest ground about that is asked for first (m at scale 1).
const FAR: f64 = 0.4;

/// Room for which the quickest bound is good enough (m at scale 1).
const NEAR: f64 = 0.12;

/// Room that is not worth remembering (m at scale 1).
const LEAST_ROOM: f64 = 0.002;

/// Way of any link beyond which a configuration counts as another one, not as the next (m at scale 1).
const JUMP: f64 = 0.25;

/// Taken off each clearance, for what rounding and the kernels' convergence leave open (m).
const SLACK: f64 = 1e-6;

/// Places of a leg.
const PLACES: usize = 6;

/// Answers for configurations that follow each other.
pub struct Follower<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
    /// By place of the leg: a sphere in the link's frame that holds the parts it carries.
    spheres: [(Point3<f64>, f64); PLACES],
    /// Places that carry parts.
    n_places: usize,
    /// Where the links were last.
    last: Option<[Frame; PLACES]>,
    /// Bound on the way that any point of each place's parts has gone so far (m).
    gone: [f64; PLACES],
    /// For each item the sum of its places' ways up to which it is clear.
    clear_until: Vec<f64>,
    /// Places whose ways count for each item; the same one twice where one counts.
    places: Vec<[u8; 2]>,
    scale: f64,
}

impl<'c> Follower<'c> {
    /// Prepares for following the leg of `checker`.
    pub fn new(checker: &'c LegChecker<'c>) -> Follower<'c> {
        let mut spheres = [(Point3::origin(), 0.0_f64); PLACES];
        for (place, sphere) in spheres.iter_mut().enumerate() {
            let parts = || checker.moving.iter().filter(|m| m.place == place);
            let n = parts().count().max(1) as f64;
            let middles = parts().map(|m| m.place_from_part().origin);
            sphere.0 = Point3::from(middles.sum::<nalgebra::Vector3<f64>>() / n);
            let reach = |(center, bound): (Point3<f64>, f64)| (center - sphere.0).norm() + bound;
            sphere.1 = parts().map(|m| reach(m.sphere_in_place())).fold(0.0, f64::max);
        }
        let places = checker.items.iter().map(|item| {
            let place = |i: u16| checker.moving[usize::from(i)].place as u8;
            match item.against {
                Against::Own(j) => [place(item.moving), place(j)],
                _ => [place(item.moving), u8::MAX],
            }
        });
        Follower {
            checker,
            scratch: Scratch::new(checker),
            spheres,
            n_places: checker.moving.iter().map(|m| m.place + 1).max().unwrap_or(0),
            last: None,
            gone: [0.0; PLACES],
            clear_until: vec![f64::NEG_INFINITY; checker.items.len()],
            places: places.collect(),
            scale: checker.scene.robot().scale(),
        }
    }

    /// Forgets what it has seen.
    pub fn begin(&mut self) {
        self.last = None;
    }

    /// Something nearer than it may be; `None` if all is free.
    pub fn touch(&mut self, frames: &LegFrames, allowance: Allowance) -> Option<Touch> {
        self.step(frames);
        self.scratch.clear();
        let gone = self.gone;
        let way = |places: [u8; 2]| {
            let of = |place: u8| gone.get(usize::from(place)).copied().unwrap_or(0.0);
            of(places[0]) + of(places[1])
        };
        for index in 0..self.clear_until.len() {
            let gone = way(self.places[index]);
            // Buffers ask for more than what was looked at.
            if gone < self.clear_until[index] && !allowance.buffered {
                continue;
            }
            match self.look(frames, allowance, index) {
                Ok(room) => self.clear_until[index] = gone + room - SLACK,
                Err(touch) => {
                    self.clear_until[index] = f64::NEG_INFINITY;
                    return Some(touch);
                }
            }
        }
        None
    }

    /// Adds up how far the links may have gone.
    fn step(&mut self, frames: &LegFrames) {
        let mut far = 0.0_f64;
        if let Some(last) = &self.last {
            let links = last.iter().zip(&frames.links).zip(&self.spheres);
            for (gone, ((from, to), sphere)) in self.gone.iter_mut().zip(links.take(self.n_places))
            {
                let way = way_of(from, to, sphere);
                *gone += way;
                far = far.max(way);
            }
        }
        // The sums would lose digits in the end.
        if self.last.is_none() || far > JUMP * self.scale || self.gone.iter().any(|g| *g > 1e3) {
            self.gone = [0.0; PLACES];
            self.clear_until.fill(f64::NEG_INFINITY);
        }
        self.last = Some(frames.links);
    }

    /// By how much more than it must an item is clear (m), negative where that is not known; the touch
    /// where it is not clear.
    fn look(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        index: usize,
    ) -> Result<f64, Touch> {
        let (checker, item) = (self.checker, self.checker.items[index]);
        let moment = Moment::still(frames, allowance);
        let part = checker.moving[usize::from(item.moving)].part;
        // A zone goes along with the wheel, and what it allows says nothing of the next one.
        let stands = part.is_wheel && item.against == Against::Ground;
        if !((stands && allowance.zone.is_some()) || allowance.buffered) {
            self.scratch.place(checker, &moment, usize::from(item.moving));
            if let Against::Own(j) = item.against {
                self.scratch.place(checker, &moment, usize::from(j));
            }
            let room = self.room(&item);
            if room > LEAST_ROOM * self.scale {
                return Ok(room);
            }
        }
        match checker.look(&moment, &item, &mut self.scratch) {
            Look::Violated(violation) => Err(violation.touch),
            Look::Clear | Look::Open(_) => Ok(f64::NEG_INFINITY),
        }
    }

    /// A distance (m) by which an item is clear at least beyond what must be kept; what it is about has
    /// been placed.
    fn room(&self, item: &Item) -> f64 {
        let checker = self.checker;
        let index = usize::from(item.moving);
        let moving = &checker.moving[index];
        let placed = &self.scratch.parts[index].placed;
        let environment = checker.environment();
        let (far, near) = (FAR * self.scale, NEAR * self.scale);
        let from = |other: &Part, there: &Placed, required: f64| {
            let (a, b) = (&moving.part.form, &other.form);
            apart_by(placed, a, there, b, required + near) - required
        };
        let from_fixed = |k: usize| {
            let fixed = &checker.fixed[k];
            let required = fixed.required[index]?;
            Some(from(fixed.part, &fixed.placed, required))
        };
        match item.against {
            Against::Group(group) => {
                let group = &checker.groups[usize::from(group)];
                let between = (placed.center() - group.center).norm();
                let room = between - placed.bound - group.radius - group.most_required;
                if room > near {
                    return room;
                }
                let members = group.members.clone().filter_map(from_fixed);
                members.fold(f64::INFINITY, f64::min)
            }
            Against::Fixed(k) => from_fixed(usize::from(k)).unwrap_or(f64::INFINITY),
            Against::Own(j) => {
                let (j, other) = (usize::from(j), &checker.moving[usize::from(j)]);
                let there = &self.scratch.parts[j].placed;
                moving.required[j].map_or(f64::INFINITY, |r| from(other.part, there, r))
            }
            Against::Solids => {
                let solids = checker.near_solids.iter().map(|i| &checker.scene.solids[*i]);
                let form = &moving.part.form;
                let rooms = solids.map(|solid| {
                    let apart =
                        apart_by(placed, form, &solid.placed, &solid.form, environment + near);
                    apart - environment
                });
                rooms.fold(f64::INFINITY, f64::min)
            }
            Against::Ground => {
                let above = |roof: f64| placed.center().z - placed.bound - environment - roof;
                let over_roof = checker.roof.map_or(f64::NEG_INFINITY, above);
                if over_roof > near {
                    return over_roof;
                }
                let clear = |room: &f64| {
                    let need = environment + room;
                    clear_of_ground(checker.scene, moving.part, placed, need, false)
                };
                let rooms = [far, near, 0.25 * near];
                rooms.into_iter().find(clear).unwrap_or(f64::NEG_INFINITY)
            }
        }
    }
}

/// Most that any point of a sphere goes from one place of its frame to another (m).
fn way_of(from: &Frame, to: &Frame, (center, radius): &(Point3<f64>, f64)) -> f64 {
    let turned: Matrix3<f64> = to.rotation - from.rotation;
    let shifted = to.origin - from.origin + turned * center.coords;
    // The norm of a difference of two rotations is its Frobenius norm over the root of two.
    shifted.norm() + radius * (0.5 * turned.norm_squared()).sqrt()
}
