//! One leg in configurations that follow each other closely, as those of neighboring footfalls do.
//!
//! What is found far from everything is not looked at again before it may have come near: a look tells
//! by how much more than must be kept the two are apart, and each moving part is held by a sphere of
//! its link whose way from one configuration to the next is bounded; two parts of the leg by the way of
//! the outer one as seen from the inner one. So an answer is that of
//! [`LegChecker::violation_at`](crate::LegChecker::violation_at), by proof or by the same look.

use arrayvec::ArrayVec;
use nalgebra::{Matrix3, Point3, Vector3};
use rover::{Frame, LegFrames};

use crate::checker::{Against, Allowance, ContactZone, Item, LegChecker, Moment, Scratch, Touch};
use crate::form::{Placed, apart_by};
use crate::ground::{clear_of_ground, is_known_below};
use crate::look::Look;
use crate::odometer::Odometer;
use crate::solid::Part;
use crate::yaws::Yaws;

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

/// A way that is never longer than what has been gone: a look is due.
const NOW: f64 = f64::NEG_INFINITY;

/// Answers for configurations that follow each other.
pub struct Follower<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
    batches: Vec<Batch>,
    odometer: Odometer,
    /// The wheel in its zone is known to sit on the ground.
    is_seated: bool,
    scale: f64,
}

/// Items whose distances only change as one part moves: through `world`, or as seen from another part of
/// the leg.
struct Batch {
    items: Vec<Item>,
    /// Index of the way that the part goes, of the odometer's; none if it never moves.
    moves: Option<usize>,
    /// A sphere in the frame that moves the part, which holds it.
    sphere: (Point3<f64>, f64),
    /// Where all items were looked at lately, the latest first.
    seen: ArrayVec<Seen, MOST_SEEN>,
    /// The way (m) up to which nothing needs a look but `always`.
    due: f64,
    always: Vec<Item>,
    /// For what the first joint alone moves.
    yaws: Option<Yaws>,
}

/// How long one item is clear.
#[derive(Clone, Copy)]
struct Room {
    /// From where it was seen with the others (m).
    way: f64,
    /// By the odometer, from a look that it has had since.
    due: f64,
    item: Item,
}

/// All items of a batch, looked at in one place.
struct Seen {
    at: Frame,
    /// The way (m) up to which each item, or each member of a group that is near, is clear from there; the
    /// least first.
    rooms: Vec<Room>,
    /// Those only known to be clear there, which have to be looked at each time.
    always: Vec<Item>,
    /// Looks taken since because a way was longer.
    n_looks: usize,
}

impl<'c> Follower<'c> {
    /// Prepares for following the leg of `checker`.
    pub fn new(checker: &'c LegChecker<'c>) -> Follower<'c> {
        let mut odometer = Odometer::new(checker);
        let mut batches: Vec<Batch> = Vec::new();
        for item in &checker.items {
            let place = |i: usize| checker.moving[i].place;
            let i = usize::from(item.moving);
            // Of two parts of the leg the outer one moves as seen from the inner one, by the joints between
            // the two alone.
            let (part, seen_from) = match item.against {
                Against::Own(j) if place(j.into()) > place(i) => (usize::from(j), Some(place(i))),
                Against::Own(j) => (i, Some(place(j.into()))),
                _ => (i, None),
            };
            let sphere = checker.moving[part].sphere_in_place();
            let moves = odometer.way_for(place(part), seen_from, &sphere);
            // What goes the same way is looked at together.
            match batches.iter_mut().find(|batch| batch.moves == moves) {
                Some(batch) => {
                    batch.sphere = about_both(batch.sphere, sphere);
                    batch.items.push(*item);
                }
                None => batches.push(Batch {
                    items: vec![*item],
                    moves,
                    sphere,
                    seen: ArrayVec::new(),
                    due: NOW,
                    always: Vec::new(),
                    yaws: None,
                }),
            }
        }
        for batch in batches.iter_mut().filter(|batch| batch.moves == Some(0)) {
            // What stands on the ground is allowed other things each time.
            let stands = |item: &Item| checker.moving[usize::from(item.moving)].part.is_wheel;
            if !batch.items.iter().any(stands) {
                let (center, radius) = batch.sphere;
                batch.yaws = Yaws::new(checker, center.coords.norm() + radius);
            }
        }
        let scratch = Scratch::new(checker);
        let scale = checker.scene.robot().scale();
        Follower { checker, scratch, batches, odometer, is_seated: false, scale }
    }

    /// Forgets what it has seen.
    pub fn begin(&mut self) {
        for batch in &mut self.batches {
            batch.seen.clear();
            batch.due = NOW;
        }
    }

    /// As [`touch`](Self::touch) for a wheel that stands in its zone. One that `is_seated` was shifted along z until
    /// it just touches, and so is clear of the ground all over where it is raised by what it may be in it.
    pub fn touch_standing(
        &mut self,
        frames: &LegFrames,
        zone: &ContactZone,
        is_seated: bool,
    ) -> Option<Touch> {
        self.is_seated = is_seated && zone.ground_tolerance > 0.0;
        let touch = self.touch(frames, Allowance { zone: Some(zone), buffered: false });
        self.is_seated = false;
        touch
    }

    /// Something nearer than it may be; `None` if all is free. `frames` are of the checker's
    /// [`chain`](LegChecker::chain).
    pub fn touch(&mut self, frames: &LegFrames, allowance: Allowance) -> Option<Touch> {
        self.scratch.clear();
        self.odometer.go_to(frames);
        let mut batches = std::mem::take(&mut self.batches);
        let touch = batches.iter_mut().find_map(|batch| {
            // Buffers ask for more than what was looked at.
            if allowance.buffered {
                return self.look_at_all(&batch.items, frames, allowance);
            }
            if self.odometer.gone(batch.moves) < batch.due {
                return self.look_at_all(&batch.always, frames, allowance);
            }
            if let Some(yaws) = &batch.yaws
                && yaws.is_clear(frames)
            {
                return None;
            }
            self.touch_of(batch, frames, allowance)
        });
        self.batches = batches;
        touch
    }

    /// Of items and of the members of groups that are near, those that are not known to be clear in a configuration
    /// other than the present one, and wherever their part is within a `way` (m) of there.
    fn open_about(&mut self, items: &[Item], there: &LegFrames, way: f64) -> Vec<Item> {
        let moment = Moment { extra: way, ..Moment::still(there, Allowance::default()) };
        self.scratch.clear();
        let mut open = Vec::new();
        for item in items {
            for item in self.single(*item, &moment) {
                let look = self.checker.look(&moment, &item, &mut self.scratch);
                if !matches!(look, Look::Clear) {
                    open.push(item);
                }
            }
        }
        self.scratch.clear();
        open
    }

    fn look_at_all(
        &mut self,
        items: &[Item],
        frames: &LegFrames,
        allowance: Allowance,
    ) -> Option<Touch> {
        items.iter().find_map(|item| self.look(frames, allowance, item).err())
    }

    /// As [`touch`](Self::touch) for the items of a batch whose way is as long as what it had room for.
    fn touch_of(
        &mut self,
        batch: &mut Batch,
        frames: &LegFrames,
        allowance: Allowance,
    ) -> Option<Touch> {
        let now = self.odometer.frame(batch.moves, frames);
        batch.due = NOW;
        let mut nearest: Option<(f64, &mut Seen)> = None;
        for seen in &mut batch.seen {
            let beyond = way_of(&seen.at, &now, &batch.sphere) + SLACK - seen.least();
            if nearest.as_ref().is_none_or(|(least, _)| beyond < *least) {
                nearest = Some((beyond, seen));
                if beyond < 0.0 {
                    break;
                }
            }
        }
        if let Some((beyond, seen)) = nearest {
            if let Some(touch) = self.look_at_all(&seen.always, frames, allowance) {
                return Some(touch);
            }
            let gone = self.odometer.gone(batch.moves);
            batch.always.clone_from(&seen.always);
            if beyond < 0.0 {
                batch.due = gone - beyond;
                return None;
            }
            if let Some(yaws) = &mut batch.yaws
                && let Some(piece) = yaws.piece(frames)
            {
                let (checker, items) = (self.checker, &batch.items);
                let about = |middle: &LegFrames, way| self.open_about(items, middle, way);
                let open = yaws.open(checker, piece, about);
                return self.look_at_all(open, frames, allowance);
            }
            let way = beyond + seen.least();
            let mut room_left = f64::INFINITY;
            for room in &mut seen.rooms {
                if way < room.way {
                    room_left = room_left.min(room.way - way);
                    break;
                }
                if gone < room.due {
                    room_left = room_left.min(room.due - gone);
                    continue;
                }
                seen.n_looks += 1;
                match self.look(frames, allowance, &room.item) {
                    Err(touch) => return Some(touch),
                    Ok(Some(left)) => {
                        room.due = gone + left - SLACK;
                        room_left = room_left.min(left - SLACK);
                    }
                    Ok(None) => batch.always.push(room.item),
                }
            }
            batch.due = gone + room_left;
            // Looks at single items pay as long as they are few.
            if 2 * seen.n_looks <= seen.rooms.len() {
                return None;
            }
        }
        let oldest = if batch.seen.is_full() { batch.seen.pop() } else { None };
        let (mut rooms, mut always) =
            oldest.map(|seen| (seen.rooms, seen.always)).unwrap_or_default();
        rooms.clear();
        always.clear();
        let mut seen = Seen { at: now, rooms, always, n_looks: 0 };
        for item in &batch.items {
            if let Err(touch) = self.see(frames, allowance, item, &mut seen) {
                return Some(touch);
            }
        }
        seen.rooms.sort_by(|a, b| a.way.total_cmp(&b.way));
        batch.due = self.odometer.gone(batch.moves) + seen.least() - SLACK;
        batch.always.clone_from(&seen.always);
        batch.seen.insert(0, seen);
        None
    }

    /// Looks at an item, or at the members of a group that is near, for what can be remembered of it.
    fn see(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        item: &Item,
        seen: &mut Seen,
    ) -> Result<(), Touch> {
        for item in self.single(*item, &Moment::still(frames, allowance)) {
            match self.look(frames, allowance, &item)? {
                Some(way) => seen.rooms.push(Room { way, due: NOW, item }),
                None => seen.always.push(item),
            }
        }
        Ok(())
    }

    /// An item itself, or the members of a group that is near.
    fn single(&mut self, item: Item, moment: &Moment) -> impl Iterator<Item = Item> + use<'c> {
        let (checker, index) = (self.checker, usize::from(item.moving));
        let mut near = None;
        if let Against::Group(group) = item.against {
            self.scratch.place(checker, moment, index);
            if self.room_about_group(index, group) <= NEAR * self.scale {
                near = Some(checker.groups[usize::from(group)].members.clone());
            }
        }
        let itself = near.is_none().then_some(item);
        let is_kept = move |k: &usize| checker.fixed[*k].required[index].is_some();
        let members = near.into_iter().flatten().filter(is_kept);
        itself
            .into_iter()
            .chain(members.map(move |k| Item { against: Against::Fixed(k as u16), ..item }))
    }

    /// By how much more than it must a part that has been placed is clear of a group at least, by spheres (m).
    fn room_about_group(&self, index: usize, group: u16) -> f64 {
        let (placed, group) =
            (&self.scratch.parts[index].placed, &self.checker.groups[usize::from(group)]);
        let between = (placed.center() - group.center).norm();
        between - placed.bound - group.radius - group.most_required
    }

    /// By how much more than it must an item is clear (m), none where that is not known; the touch where it
    /// is not clear.
    fn look(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        item: &Item,
    ) -> Result<Option<f64>, Touch> {
        let checker = self.checker;
        let moment = Moment::still(frames, allowance);
        let part = checker.moving[usize::from(item.moving)].part;
        // A zone goes along with the wheel, and what it allows says nothing of the next one.
        let stands = part.is_wheel && item.against == Against::Ground;
        if !((stands && allowance.zone.is_some()) || allowance.buffered) {
            self.scratch.place(checker, &moment, usize::from(item.moving));
            if let Against::Own(j) = item.against {
                self.scratch.place(checker, &moment, usize::from(j));
            }
            let room = self.room(item);
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
        match checker.look(&moment, item, &mut self.scratch) {
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
                let room = self.room_about_group(index, group);
                if room > near {
                    return room;
                }
                let members = checker.groups[usize::from(group)].members.clone();
                members.filter_map(from_fixed).fold(f64::INFINITY, f64::min)
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

impl Seen {
    /// The way (m) up to which all that is remembered is clear.
    fn least(&self) -> f64 {
        self.rooms.first().map_or(f64::INFINITY, |room| room.way)
    }
}

/// A sphere that holds two: their centers and radii.
fn about_both(a: (Point3<f64>, f64), b: (Point3<f64>, f64)) -> (Point3<f64>, f64) {
    let between = b.0 - a.0;
    let distance = between.norm();
    if distance + b.1 <= a.1 {
        return a;
    }
    if distance + a.1 <= b.1 {
        return b;
    }
    let radius = 0.5 * (distance + a.1 + b.1);
    // What rounding may leave out.
    (a.0 + between * ((radius - a.1) / distance), radius * (1.0 + 1e-12))
}

/// Most that any point of a sphere goes from one place of its frame to another (m).
pub(crate) fn way_of(from: &Frame, to: &Frame, (center, radius): &(Point3<f64>, f64)) -> f64 {
    let (shift, turned) = change(from, to);
    (shift + turned * center.coords).norm() + radius * norm_of_turn(&turned)
}

/// By how much a frame's origin and rotation differ from one place to another.
pub(crate) fn change(from: &Frame, to: &Frame) -> (Vector3<f64>, Matrix3<f64>) {
    (to.origin - from.origin, to.rotation - from.rotation)
}

/// The norm of a difference of two rotations: its Frobenius norm over the root of two.
pub(crate) fn norm_of_turn(turned: &Matrix3<f64>) -> f64 {
    (0.5 * turned.norm_squared()).sqrt()
}
