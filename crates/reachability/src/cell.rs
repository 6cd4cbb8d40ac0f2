//! The answer for one cell: the first way to put the wheel down that passes every question, or what
//! the way that gets furthest lacks.
//!
//! A cell is reachable if any way is: any orientation of the wheel that is tried, seated on the
//! ground, with any joint angles within the limits. So its class does not depend on which way is looked
//! at first, and the one that worked next to it is.

use arrayvec::ArrayVec;
use collision::{
    Allowance, ContactZone, Follower, Footing, Footings, Hint, LegChecker, NoTouchdown,
    QuickChecker, Seat, Touch, Touchdown, Violation, no_touchdown, touchdown_cost,
};
use nalgebra::{Point2, Point3};
use rover::{Branch, LegAngles, LegFrames, MAX_SOLUTIONS};
use terrain::traversability::UNSAFE;

use crate::answer::{Cell, CellClass, Reason};
use crate::look::Look;

/// A way that worked: worth trying in the next cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Worked {
    pub orientation: usize,
    pub angles: LegAngles,
    /// Which solution of the leg's kinematics, where that is known.
    pub branch: Option<Branch>,
}

/// One way to put the wheel down.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    pub orientation: usize,
    pub seat: Seat,
    pub angles: LegAngles,
    pub branch: Option<Branch>,
    pub com: Point3<f64>,
    pub contact: Point3<f64>,
    pub center: Point3<f64>,
    /// Joint angles at the waypoint above, once they are known.
    pub raised: Option<LegAngles>,
}

/// How far a way gets: the last question that it fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    Unstable,
    Collides,
    NoLift,
    LiftCollides,
    Reachable,
}

/// What became of a way.
struct Tried {
    rank: Rank,
    way: Way,
    /// What was touched, if that is why.
    touch: Option<Touch>,
}

/// The answer for a cell and the way that speaks for it.
pub(crate) struct Found {
    pub cell: Cell,
    pub way: Option<(Rank, Way)>,
}

impl Found {
    fn nothing(class: CellClass, reason: Reason, missing: f64) -> Found {
        Found { cell: Cell::new(class, reason, missing), way: None }
    }
}

/// Looks at cells, one after the other.
pub(crate) struct Searcher<'a> {
    look: &'a Look<'a>,
    footings: Footings<'a>,
    checker: &'a LegChecker<'a>,
    quick: QuickChecker<'a>,
    hints: Vec<Hints>,
    /// The leg from one reachable cell to the next: on the ground, and at the waypoint above.
    follows: [Follower<'a>; 2],
    /// The leg from one way to the next where none like the last one works.
    tries: Follower<'a>,
    /// The point of ground that the wheel was nearest to when it was seated last.
    nearest: Option<Point2<f64>>,
}

/// What was in the way last in an orientation: nearly always it is so in the next cell.
#[derive(Debug, Clone, Copy, Default)]
struct Hints {
    down: Hint,
    /// By solution at the waypoint above.
    lifted: [Hint; MAX_SOLUTIONS],
}

impl<'a> Searcher<'a> {
    pub fn new(look: &'a Look<'a>, checker: &'a LegChecker<'a>) -> Searcher<'a> {
        let footings = Footings::new(look.scene, &look.posture, look.leg, look.options.heading);
        let hints = vec![Hints::default(); footings.n_orientations()];
        let quick = QuickChecker::new(checker);
        let follows = [Follower::new(checker), Follower::new(checker)];
        let tries = Follower::new(checker);
        Searcher { look, footings, checker, quick, hints, follows, tries, nearest: None }
    }

    /// Begins another tile: nothing counts that was seen before and could be seen in the answer. What the
    /// followers have seen cannot: theirs are the same whatever it was.
    pub fn begin(&mut self) {
        self.hints.fill(Hints::default());
        self.nearest = None;
    }

    /// The answer at `p`; `worked` are ways that worked nearby.
    pub fn cell(&mut self, p: Point2<f64>, worked: &[Option<Worked>]) -> Found {
        let beyond = (p - self.look.hip.xy()).norm() - self.look.reach;
        if beyond > 0.0 {
            return Found::nothing(CellClass::Unreachable, Reason::OutOfReach, beyond);
        }
        let Some(mut footing) = self.footings.at(p) else {
            return Found::nothing(CellClass::Unknown, Reason::UnknownGround, f64::NAN);
        };
        footing.nearest = self.nearest;
        // The footing borrows what it was made by, not what the checks change.
        let (look, checker) = (self.look, self.checker);
        let mut search = Search {
            look,
            checker,
            quick: &mut self.quick,
            hints: &mut self.hints,
            follows: &mut self.follows,
            tries: &mut self.tries,
            footing,
            n_orientations: self.footings.n_orientations(),
            best: None,
            blocked_yaws: [0; 2],
        };
        let found = search.cell(p, worked);
        self.nearest = search.footing.nearest;
        found
    }

    /// The way as others know it.
    pub fn touchdown(&self, p: Point2<f64>, way: &Way) -> Option<Touchdown> {
        self.footings.at(p)?.touchdown(way.orientation, &way.seat, way.angles)
    }
}

type Solutions = ArrayVec<LegAngles, MAX_SOLUTIONS>;

/// A wheel put down in one orientation.
struct PutDown {
    orientation: usize,
    seat: Seat,
    /// Joint angles at the waypoint above, once they have been asked for, and what is in the way of
    /// each, once that has.
    above: Option<Solutions>,
    in_the_way: [Option<Option<Touch>>; MAX_SOLUTIONS],
}

impl PutDown {
    fn new(orientation: usize, seat: Seat) -> PutDown {
        PutDown { orientation, seat, above: None, in_the_way: [None; MAX_SOLUTIONS] }
    }
}

struct Search<'s, 'a> {
    look: &'s Look<'a>,
    checker: &'s LegChecker<'a>,
    quick: &'s mut QuickChecker<'a>,
    hints: &'s mut [Hints],
    follows: &'s mut [Follower<'a>; 2],
    tries: &'s mut Follower<'a>,
    footing: Footing<'s>,
    n_orientations: usize,
    /// The way that got furthest; of equals the first.
    best: Option<(Rank, Way)>,
    /// Yaws, by their bits, in which the wheel itself is known to collide: on the ground, and lifted.
    blocked_yaws: [u8; 2],
}

impl Search<'_, '_> {
    fn cell(&mut self, p: Point2<f64>, worked: &[Option<Worked>]) -> Found {
        let refused = self.unsafe_ground(p);
        if refused.is_none() {
            for worked in worked.iter().flatten() {
                if self.footing.missed(worked.orientation) <= 0.0
                    && let Some(way) = self.again(worked)
                {
                    return self.reachable(way);
                }
            }
        }
        let misses = self.footing.misses();
        let missed = misses.iter().copied().fold(f64::INFINITY, f64::min);
        if missed > 0.0 {
            return Found::nothing(CellClass::Unreachable, Reason::OutOfReach, missed);
        }
        if let Some(refused) = refused {
            return refused;
        }
        for orientation in (0..self.n_orientations).filter(|o| misses[*o] <= 0.0) {
            if let Some(way) = self.orientation(orientation) {
                return self.reachable(way);
            }
            let decided = match self.best {
                Some((Rank::Unstable, _)) => !self.look.stance.has_support(),
                Some((rank, _)) => rank == Rank::NoLift && !self.look.can_lift_off,
                None => false,
            };
            if decided {
                break;
            }
        }
        match self.best {
            Some((rank, way)) => Found { cell: self.refused(rank, &way), way: Some((rank, way)) },
            None => self.no_way(),
        }
    }

    fn unsafe_ground(&self, p: Point2<f64>) -> Option<Found> {
        let ground = self.look.options.ground?;
        if ground.layers.class.nearest(p) != Some(UNSAFE) {
            return None;
        }
        let goodness = ground.layers.goodness.nearest(p).map_or(f64::NAN, f64::from);
        let missing = ground.unsafe_below - goodness;
        Some(Found::nothing(CellClass::Unreachable, Reason::Traversability, missing))
    }

    fn reachable(&self, way: Way) -> Found {
        let cell = Cell::new(CellClass::Reachable, Reason::None, f64::NAN);
        let cell = Cell { margin: self.look.stance.margin(&way.com) as f32, ..cell };
        Found { cell, way: Some((Rank::Reachable, way)) }
    }

    /// The way most like one that worked nearby, if it works here too.
    fn again(&mut self, worked: &Worked) -> Option<Way> {
        let seat = self.footing.seat(worked.orientation).ok()?;
        let (orientation, lift) = (worked.orientation, self.look.options.lift);
        let (angles, branch) = (&worked.angles, worked.branch);
        let down = self.footing.nearest_angles(orientation, &seat, 0.0, angles, branch)?;
        let (angles, branch) = (down.angles, Some(down.branch));
        let frames = self.quick.chain().frames(&angles);
        let mut way = self.placed(&PutDown::new(orientation, seat), angles, &frames)?;
        way.branch = branch;
        let raised = self.footing.nearest_angles(orientation, &seat, lift, &angles, branch)?;
        way.raised = Some(raised.angles);
        if !(self.look.can_lift_off && self.look.holds(&way)) {
            return None;
        }
        let zone = self.look.zone(&way);
        let [down, lifted] = &mut *self.follows;
        if down.touch_standing(&frames, &zone, self.look.is_seated()).is_some() {
            return None;
        }
        let frames = self.quick.chain().frames(&way.raised?);
        lifted.touch(&frames, Allowance::default()).is_none().then_some(way)
    }

    /// The first way in an orientation that works; the best of the others is kept.
    fn orientation(&mut self, orientation: usize) -> Option<Way> {
        let seat = self.footing.seat(orientation).ok()?;
        let mut put = PutDown::new(orientation, seat);
        let to_beat = self.to_beat();
        // The quickest and likeliest first: the wheel, the joint angles, the leg.
        let only_success = to_beat == Some(Rank::LiftCollides);
        if (only_success && self.is_foot_blocked(&put, true))
            || (to_beat >= Some(Rank::Collides) && self.is_foot_blocked(&put, false))
            || (to_beat >= Some(Rank::NoLift) && self.above(&mut put).is_empty())
            || (only_success && !self.is_free_above(&mut put))
        {
            return None;
        }
        let mut all = self.footing.angles(orientation, &seat, 0.0).ok()?;
        let cost = |q: &LegAngles| touchdown_cost(q, &self.look.angles);
        all.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        for angles in all {
            // What gets no further than the best so far is of no use.
            let to_beat = self.to_beat();
            let Some(tried) = self.way(&mut put, angles, to_beat) else { continue };
            if tried.rank == Rank::Reachable {
                return Some(tried.way);
            }
            if to_beat.is_none_or(|rank| tried.rank > rank) {
                self.best = Some((tried.rank, tried.way));
            }
            if tried.touch.is_some_and(|touch| self.look.is_of_the_wheel(touch)) {
                break; // with other joint angles the wheel is where it was
            }
        }
        None
    }

    /// Is something in the way of the foot, on the ground or `lifted`, whatever the joint angles? `false`
    /// is no answer.
    fn is_foot_blocked(&mut self, put: &PutDown, lifted: bool) -> bool {
        if !self.look.robot.leg(self.look.leg).ik.fixes_orientation() {
            return false;
        }
        let yaw = 1 << self.footing.yaw_of(put.orientation);
        let blocked = &mut self.blocked_yaws[usize::from(lifted)];
        if *blocked & yaw != 0 {
            return true;
        }
        let lift = if lifted { self.look.options.lift } else { 0.0 };
        let wheel = self.footing.seated_frame(put.orientation, &put.seat, lift);
        let zone = self.look.zone_about(put.seat.contact, wheel.origin.into());
        let zone = Some(&zone).filter(|_| !lifted);
        let hints = &mut self.hints[put.orientation];
        let hint = if lifted { &mut hints.lifted[0] } else { &mut hints.down };
        let allowance = Allowance { zone, buffered: false };
        let touch = self.quick.foot_touch_at(&wheel, allowance, hint);
        // The wheel is the same solid whatever the pitch of its fork.
        if touch.is_some_and(|touch| touch.is_wheel) {
            *blocked |= yaw;
        }
        touch.is_some()
    }

    fn to_beat(&self) -> Option<Rank> {
        self.best.map(|(rank, _)| rank)
    }

    /// Joint angles at the waypoint above.
    fn above<'p>(&self, put: &'p mut PutDown) -> &'p Solutions {
        put.above.get_or_insert_with(|| {
            let lift = self.look.options.lift;
            self.footing.angles(put.orientation, &put.seat, lift).unwrap_or_default()
        })
    }

    /// Are any of the joint angles at the waypoint above free?
    fn is_free_above(&mut self, put: &mut PutDown) -> bool {
        for solution in 0..self.above(put).len() {
            match self.lifted(put, solution) {
                None => return true,
                // With other joint angles the wheel is where it was.
                Some(touch) if self.look.is_of_the_wheel(touch) => return false,
                Some(_) => {}
            }
        }
        false
    }

    /// What is in the way of the leg at the waypoint above.
    fn lifted(&mut self, put: &mut PutDown, solution: usize) -> Option<Touch> {
        if let Some(known) = put.in_the_way[solution] {
            return known;
        }
        let frames = self.quick.chain().frames(&self.above(put)[solution]);
        let hint = &mut self.hints[put.orientation].lifted[solution];
        let touch = self.quick.touch(&frames, Allowance::default(), hint);
        put.in_the_way[solution] = Some(touch);
        touch
    }

    /// What one way is worth; none if the wheel would not stand. A way that gets no further than
    /// `to_beat` may be called worse than it is.
    fn way(
        &mut self,
        put: &mut PutDown,
        angles: LegAngles,
        to_beat: Option<Rank>,
    ) -> Option<Tried> {
        let frames = self.quick.chain().frames(&angles);
        let mut way = self.placed(put, angles, &frames)?;
        let fails = |rank, way, touch| Some(Tried { rank, way, touch });
        if !self.look.holds(&way) {
            return fails(Rank::Unstable, way, None);
        }
        let zone = self.look.zone(&way);
        let allowance = Allowance { zone: Some(&zone), buffered: false };
        let only_success = to_beat == Some(Rank::LiftCollides);
        if to_beat >= Some(Rank::NoLift) {
            // What is likely to be in the way first: at the waypoint above, then here.
            let Some(above) = nearest(self.above(put), &angles) else {
                return fails(Rank::Unstable, way, None);
            };
            way.raised = Some(put.above.as_ref()?[above]);
            if only_success && let Some(touch) = self.lifted(put, above) {
                return fails(Rank::Unstable, way, Some(touch));
            }
            let down = &mut self.hints[put.orientation].down;
            if let Some(touch) = self.quick.touch_at(&frames, allowance, down) {
                return fails(Rank::Unstable, way, Some(touch));
            }
        }
        let hint = &mut self.hints[put.orientation].down;
        let mut touch = self.quick.touch_lately(&frames, allowance, hint);
        // Mostly free then: the first ways of a cell are much like those of the one before.
        if touch.is_none()
            && self.tries.touch_standing(&frames, &zone, self.look.is_seated()).is_some()
        {
            touch = self.quick.touch(&frames, allowance, hint);
        }
        if let Some(touch) = touch {
            return fails(Rank::Collides, way, Some(touch));
        }
        if !self.look.can_lift_off {
            return fails(Rank::NoLift, way, None);
        }
        if !only_success {
            let Some(above) = nearest(self.above(put), &angles) else {
                return fails(Rank::NoLift, way, None);
            };
            way.raised = Some(put.above.as_ref()?[above]);
            if let Some(touch) = self.lifted(put, above) {
                return fails(Rank::LiftCollides, way, Some(touch));
            }
        }
        fails(Rank::Reachable, way, None)
    }

    fn placed(&self, put: &PutDown, angles: LegAngles, frames: &LegFrames) -> Option<Way> {
        let PutDown { orientation, seat, .. } = *put;
        let com = self.quick.chain().center_of_mass(frames);
        let mut contact = seat.contact;
        if !self.look.robot.leg(self.look.leg).ik.fixes_orientation() {
            contact = self.footing.touchdown(orientation, &seat, angles)?.contact;
        }
        let center = self.look.wheel_center(frames);
        Some(Way { orientation, seat, angles, branch: None, com, contact, center, raised: None })
    }

    /// What the way that got furthest lacks.
    fn refused(&self, rank: Rank, way: &Way) -> Cell {
        let cell = match rank {
            Rank::Reachable => Cell::new(CellClass::Reachable, Reason::None, f64::NAN),
            Rank::Unstable => {
                let refusal = self.look.refusal(way);
                let (reason, missing) =
                    refusal.map_or((Reason::Margin, f64::NAN), |r| (r.reason, r.missing));
                Cell::new(CellClass::Unstable, reason, missing)
            }
            Rank::Collides => {
                let violation = self.look.collision(self.checker, way);
                let (reason, missing) = violation.map_or((Reason::None, f64::NAN), |v| {
                    (collision_reason(&v), v.required - v.distance)
                });
                Cell::new(CellClass::Colliding, reason, missing)
            }
            Rank::NoLift if !self.look.can_lift_off => {
                Cell::new(CellClass::NoLift, Reason::StartLift, f64::NAN)
            }
            Rank::NoLift => {
                let above = self.footing.angles(way.orientation, &way.seat, self.look.options.lift);
                let missing = above.err().map_or(0.0, |missed| missed.distance);
                Cell::new(CellClass::NoLift, Reason::LiftOutOfReach, missing)
            }
            Rank::LiftCollides => {
                let violation = self.look.lift_collision(self.checker, way);
                let missing = violation.map_or(f64::NAN, |v| v.required - v.distance);
                Cell::new(CellClass::NoLift, Reason::LiftCollides, missing)
            }
        };
        Cell { margin: self.look.stance.margin(&way.com) as f32, ..cell }
    }

    /// Why the wheel cannot be put down in any orientation.
    fn no_way(&mut self) -> Found {
        let look = self.look;
        let why = no_touchdown(look.scene, &look.posture, look.leg, &mut self.footing);
        let (class, reason, missing) = match why {
            Some(NoTouchdown::UnknownGround) => {
                (CellClass::Unknown, Reason::UnknownGround, f64::NAN)
            }
            Some(NoTouchdown::Uneven { shift }) => (CellClass::Unreachable, Reason::Uneven, shift),
            Some(NoTouchdown::OutOfReach { distance }) => {
                (CellClass::Unreachable, Reason::OutOfReach, distance)
            }
            Some(NoTouchdown::JointLimits { overrun }) => {
                (CellClass::Unreachable, Reason::JointLimit, overrun)
            }
            None => (CellClass::Unreachable, Reason::None, f64::NAN),
        };
        Found::nothing(class, reason, missing)
    }
}

/// Which joint angles are nearest to others.
fn nearest(all: &Solutions, to: &LegAngles) -> Option<usize> {
    let from = |i: &usize| (all[*i] - to).amax();
    (0..all.len()).min_by(|a, b| from(a).total_cmp(&from(b)))
}

/// The reason that a violation is.
pub(crate) fn collision_reason(violation: &Violation) -> Reason {
    match violation.touch {
        Touch::Links(..) => Reason::SelfCollision,
        Touch::Ground(_) | Touch::Obstacle(..) => Reason::EnvironmentCollision,
        Touch::UnknownGround(_) => Reason::UnknownGround,
    }
}

impl Look<'_> {
    /// The zone where the wheel of a way may touch.
    pub fn zone(&self, way: &Way) -> ContactZone {
        self.zone_about(way.contact, way.center)
    }

    /// The zone where a wheel may touch that stands there.
    fn zone_about(&self, contact: Point3<f64>, center: Point3<f64>) -> ContactZone {
        let rules = self.robot.stance();
        ContactZone {
            contact,
            center,
            radius: rules.contact_radius,
            height: rules.contact_height,
            ground_tolerance: rules.ground_tolerance,
        }
    }

    fn holds(&self, way: &Way) -> bool {
        self.stance.holds(&way.com, || self.posture.with_leg(self.robot, self.leg, &way.angles))
    }

    fn refusal(&self, way: &Way) -> Option<crate::stance::Refusal> {
        let posture = self.posture.with_leg(self.robot, self.leg, &way.angles);
        self.stance.refusal(&way.com, &posture)
    }

    /// What is in a way's way where it stands.
    pub fn collision(&self, checker: &LegChecker, way: &Way) -> Option<Violation> {
        let zone = self.zone(way);
        let allowance = Allowance { zone: Some(&zone), buffered: false };
        checker.measured_violation_at(&way.angles, allowance)
    }

    /// What is in its way at the waypoint above.
    pub fn lift_collision(&self, checker: &LegChecker, way: &Way) -> Option<Violation> {
        checker.measured_violation_at(&way.raised?, Allowance::default())
    }
}
