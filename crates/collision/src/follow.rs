//! One leg in configurations that follow each other closely, as those of neighboring footfalls do.
//!
//! What is found far from everything is not looked at again before it may have come near: a look tells
//! by how much more than must be kept the two are apart, and each moving part is held by a sphere of
//! its link whose way from one configuration to the next is bounded; two parts of the leg by the way of
//! the outer one as seen from the inner one. So an answer is that of
//! [`LegChecker::violation_at`](crate::LegChecker::violation_at), by proof or by the same look.

use arrayvec::ArrayVec;
use nalgebra::{Matrix3, Point3};
use rover::{Frame, LegFrames};

use crate::checker::{Against, Allowance, ContactZone, Item, LegChecker, Moment, Scratch, Touch};
use crate::form::{Placed, apart_by};
use crate::ground::{clear_of_ground, is_known_below};
use crate::look::Look;
use crate::solid::Part;

/// Room beyond what must be kept over the highest ground about that is asked for first (m at scale 1).
const FAR: f64 = 0.4;

/// Room for which the quickest bound is good enough (m at scale 1).
const NEAR: f64 = 0.12;

/// Room that is not worth remembering (m at scale 1).
const LEAST_ROOM: f64 = 0.002;

/// Places that a batch remembers.
const MOST_SEEN: usize = 4;

/// Taken off each clearance, for what rounding and the kernels' convergence leave open (m).
pub(crate) const SLACK: f64 = 1e-6;

/// Places of a leg.
const PLACES: usize = 6;

/// Answers for configurations that follow each other.
pub struct Follower<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
    batches: Vec<Batch>,
    /// Places whose relative motion counts: the outer one as seen from the inner one.
    pairs: Vec<(usize, usize)>,
    /// The wheel in its zone is known to sit on the ground.
    is_seated: bool,
    scale: f64,
}

/// Items whose distances only change as one part moves: through `world`, or as seen from another part of
/// the leg.
struct Batch {
    items: Vec<usize>,
    /// Index of the frame that moves the part, of the links' and then the pairs'; none if nothing
    /// does.
    moves: Option<usize>,
    /// A sphere in that frame that holds the part.
    sphere: (Point3<f64>, f64),
    /// Where all items were looked at lately, the latest first.
    seen: ArrayVec<Seen, MOST_SEEN>,
}

/// All items of a batch, looked at in one place.
struct Seen {
    at: Frame,
    /// The way (m) up to which each item is clear from there, and the least of them. Where one is only
    /// known to be clear there it has to be looked at each time.
    rooms: Vec<Option<f64>>,
    least: f64,
    /// The items to be looked at each time.
    always: Vec<usize>,
    /// Looks taken since because a way was longer.
    n_looks: usize,
}

impl<'c> Follower<'c> {
    /// Prepares for following the leg of `checker`.
    pub fn new(checker: &'c LegChecker<'c>) -> Follower<'c> {
        let mut pairs = Vec::new();
        let mut batches: Vec<Batch> = Vec::new();
        let mut keys: Vec<(usize, Option<usize>)> = Vec::new();
        for (index, item) in checker.items.iter().enumerate() {
            let place = |i: usize| checker.moving[i].place;
            let i = usize::from(item.moving);
            // Of two parts of the leg the outer one moves as seen from the inner one, by the joints between
            // the two alone.
            let (part, seen_from) = match item.against {
                Against::Own(j) if place(j.into()) > place(i) => (usize::from(j), Some(place(i))),
                Against::Own(j) => (i, Some(place(j.into()))),
                _ => (i, None),
            };
            let key = (part, seen_from);
            let batch = keys.iter().position(|known| *known == key).unwrap_or_else(|| {
                let moves = match seen_from {
                    None => Some(place(part)),
                    Some(inner) if inner == place(part) => None,
                    Some(inner) => Some(PLACES + place_in(&mut pairs, (place(part), inner))),
                };
                keys.push(key);
                let sphere = checker.moving[part].sphere_in_place();
                batches.push(Batch { items: Vec::new(), moves, sphere, seen: ArrayVec::new() });
                batches.len() - 1
            });
            batches[batch].items.push(index);
        }
        let scratch = Scratch::new(checker);
        let scale = checker.scene.robot().scale();
        Follower { checker, scratch, batches, pairs, is_seated: false, scale }
    }

    /// Forgets what it has seen.
    pub fn begin(&mut self) {
        self.batches.iter_mut().for_each(|batch| batch.seen.clear());
    }

    /// As [`touch`](Self::touch) for a wheel that sits on the ground: shifted along z until it just touches, and so
    /// clear of it all over where it is raised by what it may be in the ground.
    pub fn touch_seated(&mut self, frames: &LegFrames, zone: &ContactZone) -> Option<Touch> {
        self.is_seated = zone.ground_tolerance > 0.0;
        let touch = self.touch(frames, Allowance { zone: Some(zone), buffered: false });
        self.is_seated = false;
        touch
    }

    /// Something nearer than it may be; `None` if all is free.
    pub fn touch(&mut self, frames: &LegFrames, allowance: Allowance) -> Option<Touch> {
        self.scratch.clear();
        let seen_from = |(outer, inner): &(usize, usize)| {
            frames.links[*inner].inverse().after(&frames.links[*outer])
        };
        let relative: ArrayVec<Frame, { PLACES * PLACES }> =
            self.pairs.iter().map(seen_from).collect();
        let mut batches = std::mem::take(&mut self.batches);
        let still = Frame::identity();
        let touch = batches.iter_mut().find_map(|batch| {
            let now = match batch.moves {
                None => &still,
                Some(place) if place < PLACES => &frames.links[place],
                Some(pair) => &relative[pair - PLACES],
            };
            self.touch_of(batch, now, frames, allowance)
        });
        self.batches = batches;
        touch
    }

    /// As [`touch`](Self::touch) for the items of a batch whose part is moved by the frame `now`.
    fn touch_of(
        &mut self,
        batch: &mut Batch,
        now: &Frame,
        frames: &LegFrames,
        allowance: Allowance,
    ) -> Option<Touch> {
        // Buffers ask for more than what was looked at.
        if allowance.buffered {
            return batch.items.iter().find_map(|item| self.look(frames, allowance, *item).err());
        }
        let mut nearest: Option<(f64, &mut Seen)> = None;
        for seen in &mut batch.seen {
            let beyond = way_of(&seen.at, now, &batch.sphere) + SLACK - seen.least;
            if nearest.as_ref().is_none_or(|(least, _)| beyond < *least) {
                nearest = Some((beyond, seen));
                if beyond < 0.0 {
                    break;
                }
            }
        }
        if let Some((beyond, seen)) = nearest {
            for item in &seen.always {
                if let Err(touch) = self.look(frames, allowance, *item) {
                    return Some(touch);
                }
            }
            if beyond < 0.0 {
                return None;
            }
            let way = beyond + seen.least;
            for (item, room) in batch.items.iter().zip(&seen.rooms) {
                if room.is_some_and(|room| way >= room) {
                    seen.n_looks += 1;
                    if let Err(touch) = self.look(frames, allowance, *item) {
                        return Some(touch);
                    }
                }
            }
            // Looks at single items pay as long as they are few.
            if 2 * seen.n_looks <= batch.items.len() {
                return None;
            }
        }
        let mut seen = Seen {
            at: *now,
            rooms: Vec::with_capacity(batch.items.len()),
            least: f64::INFINITY,
            always: Vec::new(),
            n_looks: 0,
        };
        for item in &batch.items {
            let room = match self.look(frames, allowance, *item) {
                Ok(room) => room,
                Err(touch) => return Some(touch),
            };
            match room {
                Some(room) => seen.least = seen.least.min(room),
                None => seen.always.push(*item),
            }
            seen.rooms.push(room);
        }
        if batch.seen.is_full() {
            batch.seen.pop();
        }
        batch.seen.insert(0, seen);
        None
    }

    /// By how much more than it must an item is clear (m), none where that is not known; the touch where it
    /// is not clear.
    fn look(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        index: usize,
    ) -> Result<Option<f64>, Touch> {
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
                return Ok(Some(room));
            }
        } else if stands && self.is_seated {
            self.scratch.place(checker, &moment, usize::from(item.moving));
            let placed = &self.scratch.parts[usize::from(item.moving)].placed;
            if is_known_below(checker.scene, part, placed) {
                return Ok(None);
            }
        }
        match checker.look(&moment, &item, &mut self.scratch) {
            Look::Violated(violation) => Err(violation.touch),
            Look::Clear | Look::Open(_) => Ok(None),
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

/// The place of a value in a list, to which it is added if it is not there yet.
fn place_in<T: PartialEq>(list: &mut Vec<T>, value: T) -> usize {
    list.iter().position(|known| *known == value).unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}

/// Most that any point of a sphere goes from one place of its frame to another (m).
pub(crate) fn way_of(from: &Frame, to: &Frame, (center, radius): &(Point3<f64>, f64)) -> f64 {
    let turned: Matrix3<f64> = to.rotation - from.rotation;
    let shifted = to.origin - from.origin + turned * center.coords;
    // The norm of a difference of two rotations is its Frobenius norm over the root of two.
    shifted.norm() + radius * (0.5 * turned.norm_squared()).sqrt()
}
