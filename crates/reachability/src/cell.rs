//! The answer for one cell: the first way to put the wheel down that passes every question, or what
//! the way that gets furthest lacks.
//!
//! A cell is reachable if any way is: any orientation of the wheel that is tried, seated on the
//! ground, with any joint angles within the limits. So its class does not depend on which way is looked
//! at first, and the one that worked next to it is.

use arrayvec::ArrayVec;
use collision::{
    Allowance, ContactZone, Footing, Footings, Hint, LegChecker, NoTouchdown, QuickChecker, Seat,
    Touch, Touchdown, Violation, no_touchdown, touchdown_cost,
};
use nalgebra::{Point2, Point3};
use rover::{LegAngles, LegFrames, MAX_SOLUTIONS};
use terrain::traversability::UNSAFE;

use crate::answer::{Cell, CellClass, Reason};
use crate::look::Look;

/// A way that worked: worth trying in the next cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Worked {
    pub orientation: usize,
    pub angles: LegAngles,
}

/// One way to put the wheel down.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    pub orientation: usize,
    pub seat: Seat,
    pub angles: LegAngles,
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
}

/// What was in the way last in an orientation: nearly always it is so in the next cell.
#[derive(Debug, Clone, Copy, Default)]
struct Hints {
    down: Hint,
    lifted: Hint,
}

impl<'a> Searcher<'a> {
    pub fn new(look: &'a Look<'a>, checker: &'a LegChecker<'a>) -> Searcher<'a> {
        let footings = Footings::new(look.scene, &look.posture, look.leg, look.options.heading);
        let hints = vec![Hints::default(); footings.n_orientations()];
        Searcher { look, footings, checker, quick: QuickChecker::new(checker), hints }
    }

    /// The answer at `p`; `worked` are ways that worked nearby.
    pub fn cell(&mut self, p: Point2<f64>, worked: &[Option<Worked>]) -> Found {
        let beyond = (p - self.look.hip.xy()).norm() - self.look.reach;
        if beyond > 0.0 {
            return Found::nothing(CellClass::Unreachable, Reason::OutOfReach, beyond);
        }
        let Some(footing) = self.footings.at(p) else {
            return Found::nothing(CellClass::Unknown, Reason::UnknownGround, f64::NAN);
        };
        // The footing borrows what it was made by, not what the checks change.
        let (look, checker) = (self.look, self.checker);
        let mut search = Search {
            look,
            checker,
            quick: &mut self.quick,
            hints: &mut self.hints,
            footing,
            n_orientations: self.footings.n_orientations(),
            best: None,
        };
        search.cell(p, worked)
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
    /// Joint angles at the waypoint above, once they have been asked for.
    above: Option<Solutions>,
}

struct Search<'s, 'a> {
    look: &'s Look<'a>,
    checker: &'s LegChecker<'a>,
    quick: &'s mut QuickChecker<'a>,
    hints: &'s mut [Hints],
    footing: Footing<'s>,
    n_orientations: usize,
    /// The way that got furthest; of equals the first.
    best: Option<(Rank, Way)>,
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
        let misses: ArrayVec<f64, 35> =
            (0..self.n_orientations).map(|o| self.footing.missed(o)).collect();
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
        let all = self.footing.angles(worked.orientation, &seat, 0.0).ok()?;
        let angles = nearest(&all, &worked.angles)?;
        let mut put = PutDown { orientation: worked.orientation, seat, above: None };
        let tried = self.way(&mut put, angles, Some(Rank::LiftCollides))?;
        (tried.rank == Rank::Reachable).then_some(tried.way)
    }

    /// The first way in an orientation that works; the best of the others is kept.
    fn orientation(&mut self, orientation: usize) -> Option<Way> {
        let seat = self.footing.seat(orientation).ok()?;
        let mut put = PutDown { orientation, seat, above: None };
        if self.to_beat() >= Some(Rank::NoLift) && self.above(&mut put).is_empty() {
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
            // What is likely to be in the way first: here, then at the waypoint above.
            let down = self.hints[put.orientation].down;
            if let Some(touch) = self.quick.touch_at(&frames, allowance, down) {
                return fails(Rank::Unstable, way, Some(touch));
            }
            way.raised = nearest(self.above(put), &angles);
            if way.raised.is_none() {
                return fails(Rank::Unstable, way, None);
            }
            if only_success && let Some(touch) = self.lifted(&way) {
                return fails(Rank::Unstable, way, Some(touch));
            }
        }
        let hint = &mut self.hints[put.orientation].down;
        if let Some(touch) = self.quick.touch(&frames, allowance, hint) {
            return fails(Rank::Collides, way, Some(touch));
        }
        if !self.look.can_lift_off {
            return fails(Rank::NoLift, way, None);
        }
        if !only_success {
            way.raised = nearest(self.above(put), &angles);
            if way.raised.is_none() {
                return fails(Rank::NoLift, way, None);
            }
            if let Some(touch) = self.lifted(&way) {
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
        Some(Way { orientation, seat, angles, com, contact, center, raised: None })
    }

    /// What is in the way of the leg at the waypoint above.
    fn lifted(&mut self, way: &Way) -> Option<Touch> {
        let frames = self.quick.chain().frames(&way.raised?);
        let hint = &mut self.hints[way.orientation].lifted;
        self.quick.touch(&frames, Allowance::default(), hint)
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

/// The joint angles nearest to others.
fn nearest(all: &Solutions, to: &LegAngles) -> Option<LegAngles> {
    let from = |q: &LegAngles| (q - to).amax();
    all.iter().copied().min_by(|a, b| from(a).total_cmp(&from(b)))
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
        let rules = self.robot.stance();
        ContactZone {
            contact: way.contact,
            center: way.center,
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
        checker.violation_at(&way.angles, Allowance { zone: Some(&zone), buffered: false })
    }

    /// What is in its way at the waypoint above.
    pub fn lift_collision(&self, checker: &LegChecker, way: &Way) -> Option<Violation> {
        checker.violation_at(&way.raised?, Allowance::default())
    }
}
