//! The posture adviser: the cheapest change of posture that gives a wanted margin before a leg is lifted.
//!
//! What may change, cheapest first: the chassis over its planted feet; the lifted leg's fold, with the
//! chassis over the other feet; one other foot put down elsewhere first. A proposal is offered only
//! when every piece of its motions is certified, the final check passed them, and the full assessment
//! of its end meets the wish, with the joints within their torques and the margin rule kept all
//! along. Where there is none the answer is the best posture that can be gone to, and what stands in
//! the way of more. Forks pitch on the way only with [`AdviceOptions::drive_hold`]; the margins are
//! those without the leg.
//!
//! Deterministic for the same arguments unless the watch stops it. Frame `world`, meters, radians.

mod body;
mod fold;
mod fold_tree;
mod margins;
mod replace;

use collision::{Scene, survey};
use nalgebra::Point3;
use rover::{Configuration, LegId, Posture};
use stability::{Preference, StanceGuard};

use crate::answer::{Finding, Waypoint};
use crate::check::touch_text;
use crate::footing::Footing;
use crate::margins::Stretch;
use crate::shift::{Barrier, Freedom, Wanted};
use crate::watch::{Stage, Stopped, Watch};

pub use margins::{Margins, Region};

/// Largest wish (m): beyond, it is no margin of any rover.
pub const WISH_MAX: f64 = 1e3;

/// Margins nearer than this are as good as each other: the cheaper change is better (m at scale 1).
const TIE: f64 = 0.01;

/// What the margin over the feet that stay should be, beside the margin rule itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wish {
    /// The regular margin (m); m1 of the robot where that is more.
    pub regular: f64,
    /// The conservative margin (m), where full loss of any one more leg must be survived.
    pub conservative: Option<f64>,
    /// The margin in the region that friction holds (m), m1 of the robot where that is more; also all
    /// along the way m1 is then kept in it.
    pub friction: Option<f64>,
}

/// What may change, and how much work may be done.
#[derive(Debug, Clone, PartialEq)]
pub struct AdviceOptions {
    /// Which way the chassis may go.
    pub freedom: Freedom,
    /// May the leg be lifted and folded first?
    pub fold: bool,
    /// May one other foot be put down elsewhere first?
    pub replace: bool,
    /// Wheel drives hold the wheels while the forks pitch, instead of brakes.
    pub drive_hold: bool,
    /// Coefficient of friction under all feet, where a margin in its region is wished for.
    pub friction: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Poses of the chassis that may be looked at, by all searches together.
    pub budget: usize,
}

impl Default for AdviceOptions {
    fn default() -> AdviceOptions {
        AdviceOptions {
            freedom: Freedom::Whole,
            fold: true,
            replace: true,
            drive_hold: false,
            friction: 0.7,
            seed: 1,
            budget: 120_000,
        }
    }
}

/// Why no advice can be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum AdviceError {
    #[error("the robot has no leg {index} (counted from 0)")]
    UnknownLeg { index: usize },
    #[error("the configuration has {n_legs} legs where the robot has {expected}, or is not finite")]
    BadConfiguration { n_legs: usize, expected: usize },
    #[error("a wished margin of {value} m is not a number from 0 to {WISH_MAX}")]
    BadWish { value: f64 },
    #[error("gravity must be finite and above zero, got {value} m/s²")]
    BadGravity { value: f64 },
    #[error("a settlement of {value} m is not a number from 0 to 2 m, scaled")]
    BadSettlement { value: f64 },
    #[error("{n_staying} feet would bear where 3 are needed")]
    TooFewFeet { n_staying: usize },
    #[error("the feet that stay enclose no support polygon")]
    NoSupport,
    #[error("the rover starts in collision: {what}")]
    Colliding { what: String },
    #[error("{}", match .0 {
        Stopped::Deadline => "the deadline came before an answer",
        Stopped::Cancelled => "cancelled before an answer",
    })]
    Stopped(Stopped),
}

/// What a proposal changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// The chassis, with all feet where they are.
    Chassis,
    /// The leg is lifted and folded; then the chassis, if it has to.
    Fold,
    /// This leg's foot is put down elsewhere first.
    Replace(LegId),
}

/// One motion that may be executed.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The leg that the waypoints are about.
    pub leg: LegId,
    /// Where the rover is at its beginning.
    pub start: Configuration,
    /// Knots with times.
    pub waypoints: Vec<Waypoint>,
    /// What the final check found.
    pub findings: Vec<Finding>,
    /// Feet that bear while the body shifts, with their contacts (m).
    pub on_ground: Vec<(LegId, Point3<f64>)>,
    /// Feet that bear while the leg moves.
    pub standing: Vec<(LegId, Point3<f64>)>,
}

impl Motion {
    /// What the margins along it are taken of.
    pub fn stretch(&self) -> Stretch<'_> {
        Stretch {
            leg: self.leg,
            start: &self.start,
            waypoints: &self.waypoints,
            on_ground: &self.on_ground,
            standing: &self.standing,
        }
    }
}

/// What a change costs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cost {
    /// Way of the chassis (m).
    pub chassis: f64,
    /// Turn of the chassis (rad).
    pub turn: f64,
    /// Way of the legs that move by themselves, in joint space (rad).
    pub legs: f64,
    /// Time that the motions take (s).
    pub duration: f64,
}

/// A posture that can be gone to.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// What changes.
    pub change: Change,
    /// How to get there; empty where nothing has to move.
    pub motions: Vec<Motion>,
    /// The posture.
    pub end: Configuration,
    /// Its margins without the leg.
    pub after: Margins,
    /// What it costs.
    pub cost: Cost,
}

/// Where the wish cannot be met: the best of one kind of change, and its barrier.
#[derive(Debug, Clone, PartialEq)]
pub struct Limit {
    /// What was tried.
    pub change: Change,
    /// The margins it would come to; none where it could not be begun.
    pub margins: Option<Margins>,
    /// What stands in the way of more.
    pub barrier: Barrier,
}

/// What is advised.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // made once a request
pub enum Answer {
    /// The wish is met where the rover is.
    AlreadyMet,
    /// Ways to meet it, cheapest first.
    Proposals(Vec<Proposal>),
    /// It could not be met.
    Best {
        /// The posture with most that can be gone to.
        posture: Proposal,
        /// How much is missing there (m).
        missing: f64,
        /// What stands in the way of more there.
        barrier: Barrier,
    },
}

/// The advice.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// The margins without the leg where the rover is.
    pub before: Margins,
    /// What is advised.
    pub answer: Answer,
    /// What each kind of change that was tried and does not meet the wish runs into.
    pub limits: Vec<Limit>,
    /// Poses of the chassis looked at.
    pub n_looked: usize,
}

/// The cheapest change of posture that gives `wish` before `leg` is lifted.
pub fn advise(
    scene: &Scene,
    start: &Configuration,
    gravity: f64,
    leg: LegId,
    wish: &Wish,
    options: &AdviceOptions,
    watch: &mut impl Watch,
) -> Result<Advice, AdviceError> {
    validate(scene, start, gravity, leg, wish)?;
    watch.entered(Stage::Shift);
    let case = Case { scene, gravity, leg, wish, options };
    let here = case.place(start)?;
    let before = here.margins.clone();
    if before.meet(wish, scene.robot().stance()) {
        return Ok(Advice { before, answer: Answer::AlreadyMet, limits: Vec::new(), n_looked: 0 });
    }
    let mut work = Work { watch, n_looked: 0 };
    let mut tally = Tally::new(&case, &here);
    let part = options.budget / 4;
    tally.take(Change::Chassis, case.chassis(&here, part, &mut work));
    if options.fold && work.watch.stopped().is_none() {
        tally.take(Change::Fold, case.folded(&here, part, &mut work));
    }
    if options.replace && tally.proposals.is_empty() && work.watch.stopped().is_none() {
        case.replaced(&here, options.budget - 2 * part, &mut tally, &mut work);
    }
    if let Some(stopped) = work.watch.stopped() {
        return Err(AdviceError::Stopped(stopped));
    }
    let n_looked = work.n_looked;
    Ok(tally.advice(before, n_looked))
}

pub(crate) fn validate(
    scene: &Scene,
    start: &Configuration,
    gravity: f64,
    leg: LegId,
    wish: &Wish,
) -> Result<(), AdviceError> {
    let expected = scene.robot().legs().len();
    let finite = start.legs.iter().all(|leg| leg.iter().all(|q| q.is_finite()))
        && start.world_from_base.to_homogeneous().iter().all(|v| v.is_finite());
    if start.legs.len() != expected || !finite {
        return Err(AdviceError::BadConfiguration { n_legs: start.legs.len(), expected });
    }
    if leg.0 >= expected {
        return Err(AdviceError::UnknownLeg { index: leg.0 });
    }
    for value in [Some(wish.regular), wish.conservative, wish.friction].into_iter().flatten() {
        if !(0.0..=WISH_MAX).contains(&value) {
            return Err(AdviceError::BadWish { value });
        }
    }
    if !(gravity.is_finite() && gravity > 0.0) {
        return Err(AdviceError::BadGravity { value: gravity });
    }
    Ok(())
}

/// Everything that an answer is about.
#[derive(Clone, Copy)]
pub(crate) struct Case<'a> {
    pub scene: &'a Scene,
    pub gravity: f64,
    pub leg: LegId,
    pub wish: &'a Wish,
    pub options: &'a AdviceOptions,
}

/// The rover somewhere, with what it stands on.
pub(crate) struct Place {
    pub configuration: Configuration,
    /// All legs on the ground, with their contacts (m).
    pub on_ground: Vec<(LegId, Point3<f64>)>,
    /// Those that stay.
    pub staying: Vec<(LegId, Point3<f64>)>,
    /// Those that bear while the chassis moves, and what must hold on them then.
    pub bearing: Vec<(LegId, Point3<f64>)>,
    pub on_the_way: StanceGuard,
    /// The wish over the feet that stay.
    pub wanted: Wanted,
    pub margins: Margins,
}

/// What is done, and who may stop it.
pub(crate) struct Work<'w, W> {
    pub watch: &'w mut W,
    pub n_looked: usize,
}

/// A posture that can be gone to, whether or not it meets the wish.
pub(crate) struct Attempt {
    pub motions: Vec<Motion>,
    pub end: Configuration,
    pub after: Margins,
    /// What stands in the way of more, where the search has not enough.
    pub barrier: Option<Barrier>,
}

impl<'a> Case<'a> {
    /// What the rover stands on there.
    pub fn place(&self, configuration: &Configuration) -> Result<Place, AdviceError> {
        let robot = self.scene.robot().as_ref();
        let posture = Posture::new(robot, configuration);
        let seen = survey(self.scene, &posture);
        if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
            return Err(AdviceError::Colliding { what: touch_text(self.scene, pair.touch) });
        }
        let on_ground = seen.contacts(self.scene, &posture);
        let mut staying = on_ground.clone();
        staying.retain(|(leg, _)| *leg != self.leg);
        if staying.len() < 3 {
            return Err(AdviceError::TooFewFeet { n_staying: staying.len() });
        }
        let contacts = self.footing().contacts(&staying);
        let wanted =
            Wanted::margins(&contacts, robot.stance(), self.wish).ok_or(AdviceError::NoSupport)?;
        let margins = Margins::of(&self.footing(), &posture, &staying, self.gravity);
        let on_the_way = self.guard(&on_ground).ok_or(AdviceError::NoSupport)?;
        Ok(Place {
            configuration: configuration.clone(),
            bearing: on_ground.clone(),
            on_ground,
            staying,
            on_the_way,
            wanted,
            margins,
        })
    }

    /// The rule that holds on the way: with friction where it is wished for.
    pub fn footing(&self) -> Footing<'a> {
        let preference = match self.wish.friction {
            Some(_) => Preference::Friction,
            None => Preference::Regular,
        };
        Footing { scene: self.scene, preference, friction: self.options.friction }
    }

    pub fn guard(&self, feet: &[(LegId, Point3<f64>)]) -> Option<StanceGuard> {
        self.footing().guard(feet)
    }

    fn proposal(&self, change: Change, attempt: Attempt) -> Proposal {
        let cost = cost_of(&attempt.motions);
        let Attempt { motions, end, after, .. } = attempt;
        Proposal { change, motions, end, after, cost }
    }
}

/// What was found so far.
pub(crate) struct Tally<'c> {
    case: &'c Case<'c>,
    proposals: Vec<Proposal>,
    limits: Vec<Limit>,
    /// The posture with least missing, and what stands in the way of more.
    best: (Proposal, Barrier),
}

impl<'c> Tally<'c> {
    fn new(case: &'c Case<'c>, here: &Place) -> Tally<'c> {
        let stays = Attempt {
            motions: Vec::new(),
            end: here.configuration.clone(),
            after: here.margins.clone(),
            barrier: None,
        };
        let barrier = Barrier::new("search", "nothing was tried");
        let best = (case.proposal(Change::Chassis, stays), barrier);
        Tally { case, proposals: Vec::new(), limits: Vec::new(), best }
    }

    /// Has a way to meet the wish been found?
    pub fn is_met(&self) -> bool {
        !self.proposals.is_empty()
    }

    /// Takes what a kind of change came to.
    pub fn take(&mut self, change: Change, result: Result<Attempt, Barrier>) {
        let (wish, rules) = (self.case.wish, self.case.scene.robot().stance());
        let attempt = match result {
            Ok(attempt) => attempt,
            Err(barrier) => {
                // Where nothing else was tried, this stands in the way.
                if self.limits.is_empty() {
                    self.best.1 = barrier.clone();
                }
                self.limit(Limit { change, margins: None, barrier });
                return;
            }
        };
        if attempt.after.meet(wish, rules) {
            self.proposals.push(self.case.proposal(change, attempt));
            return;
        }
        let barrier = match &attempt.barrier {
            Some(barrier) if !attempt.after.torque.is_overloaded() => barrier.clone(),
            _ => attempt.after.barrier(self.case.scene.robot()),
        };
        let margins = Some(attempt.after.clone());
        let first = self.limits.is_empty();
        self.limit(Limit { change, margins, barrier: barrier.clone() });
        let more = attempt.after.spare(wish, rules) - self.best.0.after.spare(wish, rules);
        // What costs more must win more than a little.
        let tie = if first { 0.0 } else { TIE * self.case.scene.robot().scale() };
        let less = more > tie;
        if less {
            self.best = (self.case.proposal(change, attempt), barrier);
        } else if first {
            self.best.1 = barrier;
        }
    }

    /// Keeps the better of two limits of one change.
    fn limit(&mut self, limit: Limit) {
        let (wish, rules) = (self.case.wish, self.case.scene.robot().stance());
        let spare = |limit: &Limit| {
            limit.margins.as_ref().map_or(f64::NEG_INFINITY, |margins| margins.spare(wish, rules))
        };
        match self.limits.iter_mut().find(|other| other.change == limit.change) {
            Some(other) if spare(&limit) > spare(other) => *other = limit,
            Some(_) => {}
            None => self.limits.push(limit),
        }
    }

    fn advice(self, before: Margins, n_looked: usize) -> Advice {
        let rules = self.case.scene.robot().stance();
        let answer = if self.proposals.is_empty() {
            let (posture, barrier) = self.best;
            let missing = (-posture.after.spare(self.case.wish, rules)).max(0.0);
            Answer::Best { posture, missing, barrier }
        } else {
            Answer::Proposals(self.proposals)
        };
        Advice { before, answer, limits: self.limits, n_looked }
    }
}

fn cost_of(motions: &[Motion]) -> Cost {
    let mut cost = Cost::default();
    for motion in motions {
        let knots = &motion.waypoints;
        cost.duration += knots.last().map_or(0.0, |w| w.time);
        for w in knots.windows(2) {
            match (&w[0].stance, &w[1].stance) {
                (Some(a), Some(b)) => {
                    let (a, b) = (&a.world_from_base, &b.world_from_base);
                    cost.chassis += (b.translation.vector - a.translation.vector).norm();
                    cost.turn += a.rotation.angle_to(&b.rotation);
                }
                _ => cost.legs += (w[1].angles - w[0].angles).norm(),
            }
        }
    }
    cost
}
