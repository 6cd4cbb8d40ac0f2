//! One other foot put down elsewhere first.

use collision::touchdowns;
use nalgebra::{Point2, Point3, Vector2};
use rover::{Configuration, LegId, Posture};

use super::{Attempt, Case, Change, Motion, Place, Tally, Work};
use crate::answer::{Outcome, StepRequest, Target};
use crate::shift::{Barrier, Wanted};
use crate::step::plan_step;
use crate::watch::{Stopped, Watch};

/// Distances from where a foot stands at which it might be put down (m at scale 1), and directions.
const RINGS: [f64; 3] = [0.25, 0.5, 0.75];
const DIRECTIONS: usize = 12;

/// Steps that are planned, those that promise most first.
const MOST_STEPS: usize = 4;

/// Milestones of the search for one step.
const MILESTONES: usize = 2_000;

/// A place for another foot, and what it promises.
struct Promise {
    leg: LegId,
    place: Point3<f64>,
    /// What would be to spare with the chassis where it is (m).
    spare: f64,
    /// What the feet would allow at most, beyond the wish (m).
    most: f64,
}

impl Case<'_> {
    /// Tries the most promising steps of other legs, each with the chassis and the fold after it, until
    /// the wish is met.
    pub fn replaced<W: Watch>(
        &self,
        place: &Place,
        budget: usize,
        tally: &mut Tally<'_>,
        work: &mut Work<'_, W>,
    ) {
        let mut promises = self.promises(place);
        // Where no feet allow the wish one step tells how much more there would be.
        if promises.iter().any(|promise| promise.most >= 0.0) {
            promises.retain(|promise| promise.most >= 0.0);
        } else {
            promises.truncate(1);
        }
        let part = budget / (2 * MOST_STEPS);
        for promise in promises.iter().take(MOST_STEPS) {
            if tally.is_met() || work.watch.stopped().is_some() {
                return;
            }
            let change = Change::Replace(promise.leg);
            match self.stepped(place, promise, work) {
                Err(barrier) => tally.take(change, Err(barrier)),
                Ok((motion, there)) => {
                    let after = |attempt: Attempt| {
                        let motions = std::iter::once(motion.clone()).chain(attempt.motions);
                        Attempt { motions: motions.collect(), ..attempt }
                    };
                    let chassis = self.chassis(&there, part, work).map(after);
                    let (wish, rules) = (self.wish, self.scene.robot().stance());
                    let met = chassis.as_ref().is_ok_and(|a| a.after.meet(wish, rules));
                    if met || !self.options.fold {
                        tally.take(change, chassis);
                        continue;
                    }
                    let after = |attempt: Attempt| {
                        let motions = std::iter::once(motion.clone()).chain(attempt.motions);
                        Attempt { motions: motions.collect(), ..attempt }
                    };
                    let folded = self.folded(&there, part, work).map(after);
                    let spare = |a: &Result<Attempt, Barrier>| {
                        a.as_ref().map_or(f64::NEG_INFINITY, |a| a.after.spare(wish, rules))
                    };
                    tally.take(
                        change,
                        if spare(&folded) > spare(&chassis) { folded } else { chassis },
                    );
                }
            }
        }
    }

    /// Places about the other feet by what they promise, best first.
    fn promises(&self, place: &Place) -> Vec<Promise> {
        let robot = self.scene.robot();
        let posture = Posture::new(robot, &place.configuration);
        let com = posture.center_of_mass(robot);
        let now = place.wanted.spare(&com);
        let mut promises: Vec<Promise> = Vec::new();
        for (leg, contact) in &place.staying {
            for ring in RINGS {
                for k in 0..DIRECTIONS {
                    let angle = std::f64::consts::TAU * k as f64 / DIRECTIONS as f64;
                    let way = Vector2::new(angle.cos(), angle.sin()) * (ring * robot.scale());
                    let promise = self.promise(place, &posture, *leg, contact.xy() + way);
                    promises.extend(promise.filter(|promise| promise.spare > now));
                }
            }
        }
        // Equal promises stay in the order of legs and directions.
        promises.sort_by(|a, b| b.spare.total_cmp(&a.spare));
        promises
    }

    fn promise(
        &self,
        place: &Place,
        posture: &Posture,
        leg: LegId,
        p: Point2<f64>,
    ) -> Option<Promise> {
        let robot = self.scene.robot();
        let near = place.configuration.legs[leg.0];
        let down = touchdowns(self.scene, posture, leg, p, &near, 1).ok()?;
        let down = down.first()?;
        let mut feet = place.staying.clone();
        feet.iter_mut().filter(|(other, _)| *other == leg).for_each(|foot| foot.1 = down.contact);
        let contacts = self.footing().contacts(&feet);
        let wanted = Wanted::margins(&contacts, robot.stance(), self.wish)?;
        let com = posture.with_leg(robot, leg, &down.angles).center_of_mass(robot);
        let spare = wanted.spare(&com);
        let (_, most) = wanted.best()?;
        spare.is_finite().then_some(Promise { leg, place: down.place.ground, spare, most })
    }

    /// The step, and the rover after it.
    fn stepped<W: Watch>(
        &self,
        place: &Place,
        promise: &Promise,
        work: &mut Work<'_, W>,
    ) -> Result<(Motion, Place), Barrier> {
        let robot = self.scene.robot();
        let target = Target::Ground(promise.place);
        let mut request = StepRequest::new(promise.leg, target, robot.scale());
        request.preference = self.footing().preference;
        request.friction = self.options.friction;
        request.seed = self.options.seed;
        request.drive_hold = self.options.drive_hold;
        request.sbl.max_milestones = MILESTONES;
        let start = &place.configuration;
        let answer = plan_step(self.scene, start, self.gravity, &request, &mut Quiet(work.watch));
        let name = &robot.leg(promise.leg).name;
        if answer.outcome != Outcome::Found {
            let text = format!("{name} cannot be put down elsewhere first: {}", answer.reason);
            let constraint = answer.constraint;
            let barrier = Barrier::new("search", text);
            return Err(match constraint {
                Some(constraint) => Barrier { constraint, ..barrier },
                None => barrier,
            });
        }
        let end = end_of(start, promise.leg, &answer.waypoints);
        let there = self.place(&end).map_err(|e| Barrier::new("check", e.to_string()))?;
        let motion = Motion {
            leg: promise.leg,
            start: start.clone(),
            waypoints: answer.waypoints,
            findings: answer.findings,
            on_ground: answer.on_ground,
            standing: answer.standing,
        };
        Ok((motion, there))
    }
}

/// Where the rover is after a step.
fn end_of(
    start: &Configuration,
    leg: LegId,
    waypoints: &[crate::answer::Waypoint],
) -> Configuration {
    let shifted = waypoints.iter().rev().find_map(|w| w.stance.clone());
    let base = shifted.unwrap_or_else(|| start.clone());
    match waypoints.last() {
        Some(last) => base.with_leg(leg, last.angles),
        None => base,
    }
}

/// Asks whether to stop, but keeps the stages of the steps within to itself.
struct Quiet<'w, W>(&'w mut W);

impl<W: Watch> Watch for Quiet<'_, W> {
    fn stopped(&mut self) -> Option<Stopped> {
        self.0.stopped()
    }
}
