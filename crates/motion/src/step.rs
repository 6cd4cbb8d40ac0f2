//! One step of one leg: body shift, lift, transit, drop, preload (F75, F76), and the verdict on it.

use collision::{Keep, LegChecker, Scene, Survey, survey};
use nalgebra::{Point3, Translation3};
use rover::{Configuration, LegAngles, LegId, Posture};
use stability::loads::{compliant_share, leg_springs};
use stability::{StanceGuard, rule};

use crate::answer::{
    EdgeRule, Footfall, Outcome, Phase, Statistics, StepAnswer, StepRequest, Target, Waypoint,
};
use crate::check::{CheckContext, check_step, touch_text};
use crate::ends::{Arrival, Departure};
use crate::failure::{Failure, Teller};
use crate::footing::Footing;
use crate::leg_space::LegSpace;
use crate::line::wheel_line;
use crate::shift::{CertifiedBody, SampledBody, ShiftRequest, plan_shift};
use crate::space::Space;
use crate::timing::{TimingError, TimingLimits, time_body_path, time_leg_path};
use crate::transit::Transit;
use crate::watch::{Stage, Watch};

/// Searches for a transit that one request may start.
const MOST_SEARCHES: usize = 3;

/// Plans one step of `request.leg` with the rest of the robot standing as in `start`.
///
/// Where the margin rule asks for it, and the request allows it, the body is shifted first; else
/// the base does not move. Where there is no step the answer says what is in the way, how much is
/// missing, and the nearest ground found where the wheel could be put down. Deterministic for the same scene,
/// start and request, unless `watch` stops it.
pub fn plan_step(
    scene: &Scene,
    start: &Configuration,
    gravity: f64,
    request: &StepRequest,
    watch: &mut impl Watch,
) -> StepAnswer {
    let mut planning = Planning::new(scene, start, gravity, request);
    match planning.run(watch) {
        Ok(answer) => answer,
        Err(failure) => planning.failed(failure),
    }
}

/// What the step stands on: the feet that stay, and what was seen.
struct Stance {
    seen: Option<Survey>,
    /// All legs on the ground at the start, with their contacts.
    on_ground: Vec<(LegId, Point3<f64>)>,
    /// The legs that stand while this one steps, with their contacts.
    standing: Vec<(LegId, Point3<f64>)>,
}

pub(crate) struct Planning<'a> {
    pub scene: &'a Scene,
    /// Where the rover is.
    start: &'a Configuration,
    gravity: f64,
    pub request: &'a StepRequest,
    statistics: Statistics,
    /// Knots of the body shift, the start first; empty without one.
    shift: Vec<Configuration>,
    nearest: Option<Point3<f64>>,
}

impl<'a> Planning<'a> {
    fn new(
        scene: &'a Scene,
        start: &'a Configuration,
        gravity: f64,
        request: &'a StepRequest,
    ) -> Planning<'a> {
        let (statistics, shift, nearest) = (Statistics::default(), Vec::new(), None);
        Planning { scene, start, gravity, request, statistics, shift, nearest }
    }

    pub fn leg(&self) -> LegId {
        self.request.leg
    }

    pub fn teller(&self) -> Teller<'a> {
        Teller { scene: self.scene, leg: self.leg(), lift: self.request.lift }
    }

    /// Where the rover is when the leg begins to move.
    fn stepping_from(&self) -> &Configuration {
        self.shift.last().unwrap_or(self.start)
    }

    fn footing(&self) -> Footing<'a> {
        let StepRequest { preference, friction, .. } = *self.request;
        Footing { scene: self.scene, preference, friction }
    }

    pub fn angles(&self) -> LegAngles {
        self.stepping_from().legs[self.leg().0]
    }

    fn failed(self, failure: Failure) -> StepAnswer {
        StepAnswer {
            outcome: failure.outcome,
            reason: failure.reason,
            waypoints: Vec::new(),
            footfall: None,
            findings: Vec::new(),
            margins: Vec::new(),
            on_ground: Vec::new(),
            standing: Vec::new(),
            statistics: self.statistics,
            constraint: failure.constraint,
            nearest: self.nearest,
            preload: None,
        }
    }

    fn run(&mut self, watch: &mut impl Watch) -> Result<StepAnswer, Failure> {
        watch.entered(Stage::Footfall);
        let at_start = Posture::new(self.scene.robot(), self.start);
        let stance = self.stance(&at_start, watch)?;
        let posture = match self.shift.last() {
            Some(shifted) => Posture::new(self.scene.robot(), shifted),
            None => at_start,
        };
        let robot = self.scene.robot().clone();
        let guard = self.footing().guard(&stance.standing);
        let scene = self.scene;
        let contact = self.contact(&posture, stance.seen.as_ref());
        let keep = self.keep(&posture, contact.as_ref());
        let checker = LegChecker::keeping(scene, &posture, self.leg(), keep.clone());
        let rule = self.request.edges;
        let mut space = LegSpace::new(&checker, &robot, &posture, guard.as_ref(), rule);
        let departure = self.departure(&posture, contact, &mut space)?;
        let result = self.reach_some_arrival(&posture, &departure, &mut space, watch);
        if let Err(failure) = &result {
            self.nearest = self.nearest_place(&posture, failure, &mut space, watch);
        }
        self.statistics.n_checked = space.n_checked();
        let (arrival, transit) = result?;
        self.statistics.certified = matches!(rule, EdgeRule::Certified);
        let down = arrival.knots[arrival.knots.len() - 1];
        let pressed = arrival
            .footfall
            .as_ref()
            .filter(|_| self.request.preload)
            .and_then(|footfall| self.pressed(&posture, &down, footfall, &stance.standing));
        if let Some((knots, _)) = &pressed {
            space.zone = arrival.zone;
            if let Some(blocked) = space.blocked_along(knots) {
                let text = format!("pressed to its load, {}", self.teller().blocked_text(&blocked));
                return Err(Failure::new(8, Outcome::NoLift, text).by_blocked(&blocked));
            }
        }
        self.statistics.n_checked = space.n_checked();
        let mut parts = vec![(Phase::Lift, &departure.knots[..]), (Phase::Transit, &transit[..])];
        parts.push((Phase::Drop, &arrival.knots));
        parts.extend(pressed.iter().map(|(knots, _)| (Phase::Preload, &knots[..])));
        parts.retain(|(_, knots)| knots.len() > 1);
        if parts.is_empty() {
            parts.push((Phase::Transit, &departure.knots));
        }
        let waypoints =
            self.waypoints(&posture, guard.as_ref(), &stance.on_ground, &parts).map_err(|why| {
                Failure::new(8, Outcome::Unstable, format!("no way to time the step: {why}")).by(
                    "stability",
                    None,
                    "m",
                )
            })?;

        watch.entered(Stage::Check);
        let report = check_step(
            &CheckContext {
                scene: self.scene,
                start: self.start,
                stepping_from: self.stepping_from(),
                leg: self.leg(),
                standing: &stance.standing,
                gravity: self.gravity,
                preference: self.request.preference,
                friction: self.request.friction,
                keep,
                lift_zone: departure.zone,
                drop_zone: arrival.zone,
                transit_only: self.request.transit_only,
            },
            &waypoints,
        );
        let refusal = report.findings.iter().find(|finding| !finding.ok);
        let (outcome, reason) = match refusal {
            None => (Outcome::Found, self.success_text(&waypoints)),
            Some(f) => {
                let text = format!("the final check refuses the step: {} ({})", f.detail, f.place);
                (Outcome::Refused, text)
            }
        };
        Ok(StepAnswer {
            outcome,
            reason,
            waypoints,
            footfall: arrival.footfall,
            findings: report.findings,
            margins: report.margins,
            on_ground: stance.on_ground,
            standing: stance.standing,
            statistics: self.statistics,
            constraint: None,
            nearest: None,
            preload: pressed.map(|(_, load)| load),
        })
    }

    fn success_text(&self, waypoints: &[Waypoint]) -> String {
        let duration = waypoints.last().map_or(0.0, |w| w.time);
        let shift = if self.shift.len() > 1 { " after a shift of the body" } else { "" };
        format!("a step of {} in {duration:.0} s{shift}", self.teller().leg_name())
    }

    /// Clearances that the step keeps.
    fn keep(&self, posture: &Posture, contact: Option<&Point3<f64>>) -> Keep {
        let robot = self.scene.robot();
        let goal = match self.request.target {
            Target::Ground(ground) => ground.xy(),
            Target::Angles(angles) => {
                posture.with_leg(robot, self.leg(), &angles).wheel(robot, self.leg()).center().xy()
            }
        };
        let buffers = &self.request.buffers;
        Keep {
            // Below zero, or no number, counts as none: nothing takes a clearance away.
            environment: self.request.environment_tolerance.map(|kept| kept.max(0.0)),
            pairs: self.request.pair_tolerance.map(|kept| kept.max(0.0)),
            inflation: buffers.inflation.max(0.0),
            obstacle_buffer: buffers.obstacle.max(0.0),
            terrain_lift: buffers.terrain_lift.max(0.0),
            footfalls: contact.map(|p| p.xy()).into_iter().chain([goal]).collect(),
        }
    }

    /// What the step stands on, after a shift of the body if the margin rule asks for one.
    fn stance(&mut self, posture: &Posture, watch: &mut impl Watch) -> Result<Stance, Failure> {
        if self.request.transit_only {
            return Ok(Stance { seen: None, on_ground: Vec::new(), standing: Vec::new() });
        }
        let seen = survey(self.scene, posture);
        if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
            let text =
                format!("the rover starts in collision: {}", touch_text(self.scene, pair.touch));
            let failure = Failure::new(0, Outcome::Colliding, text);
            return Err(failure.by("clearance", Some(pair.tolerance - pair.distance), "m"));
        }
        let on_ground = seen.contacts(self.scene, posture);
        let mut standing = on_ground.clone();
        standing.retain(|(leg, _)| *leg != self.leg());
        let robot = self.scene.robot();
        let guard = self.footing().guard(&standing);
        if guard.is_some_and(|guard| guard.spare(&posture.center_of_mass(robot)) >= 0.0) {
            return Ok(Stance { seen: Some(seen), on_ground, standing });
        }
        let report = self.footing().assess(posture, &standing, self.gravity);
        let verdict = rule::verdict(&report, robot.stance(), self.request.preference);
        let missing = verdict.shortfall_m;
        let text =
            format!("{} cannot be lifted: {}", self.teller().leg_name(), verdict.explanation);
        let unstable = |why: String| {
            Failure::new(0, Outcome::Unstable, format!("{text}{why}")).by("stability", missing, "m")
        };
        if !self.request.may_shift {
            let best = verdict.best_m.map_or(String::new(), |best| {
                format!("; at best {best:.2} m by any shift of the body over these feet")
            });
            return Err(unstable(best));
        }
        self.shift = self.shifted(&on_ground, watch).map_err(|why| match watch.stopped() {
            Some(stopped) => stopped.into(),
            None => unstable(why),
        })?;
        let posture = Posture::new(robot, self.stepping_from());
        let seen = survey(self.scene, &posture);
        let mut standing = seen.contacts(self.scene, &posture);
        standing.retain(|(leg, _)| *leg != self.leg());
        Ok(Stance { seen: Some(seen), on_ground, standing })
    }

    /// Knots of the smallest shift after which the leg may be lifted, or why there is none.
    fn shifted(
        &self,
        on_ground: &[(LegId, Point3<f64>)],
        watch: &mut impl Watch,
    ) -> Result<Vec<Configuration>, String> {
        watch.entered(Stage::Shift);
        let request = ShiftRequest {
            preference: self.request.preference,
            friction: self.request.friction,
            drive_hold: self.request.drive_hold,
            seed: self.request.seed,
            ..ShiftRequest::new(self.scene, self.start, on_ground, self.leg())
        };
        let legs: Vec<LegId> = on_ground.iter().map(|(leg, _)| *leg).collect();
        let (scene, start) = (self.scene, self.start);
        let plan = match self.request.edges {
            EdgeRule::Certified => {
                plan_shift(&request, &mut CertifiedBody::new(scene, start, &legs), watch)
            }
            EdgeRule::Sampled(_) => {
                plan_shift(&request, &mut SampledBody::new(scene, start, &legs), watch)
            }
        };
        watch.entered(Stage::Footfall);
        plan.map(|plan| plan.configurations).map_err(|none| {
            let best = if none.best_spare.is_finite() {
                format!("the best shift found leaves {:.2} m to spare", none.best_spare)
            } else {
                "no shift of the body helps".into()
            };
            format!("; {best}: {}", none.why)
        })
    }

    /// Where the stepping leg's wheel stands, if it does.
    fn contact(&self, posture: &Posture, seen: Option<&Survey>) -> Option<Point3<f64>> {
        let contacts = seen?.contacts(self.scene, posture);
        contacts.into_iter().find(|(leg, _)| *leg == self.leg()).map(|(_, contact)| contact)
    }

    /// Tries the ways to end the step, best first, until one can be reached.
    fn reach_some_arrival(
        &mut self,
        posture: &Posture,
        departure: &Departure,
        space: &mut LegSpace,
        watch: &mut impl Watch,
    ) -> Result<(Arrival, Vec<LegAngles>), Failure> {
        let goals = self.goals(posture, space)?;
        self.statistics.n_touchdowns = goals.len();
        let mut worst = Failure::new(0, Outcome::NoPath, "nothing was tried");
        let mut budget = self.request.sbl.max_milestones;
        let mut searches = 0;
        let transit = Transit { request: self.request, teller: self.teller(), posture };
        for goal in &goals {
            if let Some(stopped) = watch.stopped() {
                return Err(stopped.into());
            }
            let arrival = match self.arrival(posture, goal, space) {
                Ok(arrival) => arrival,
                Err(failure) => {
                    worst = worst.or_later(failure);
                    continue;
                }
            };
            searches += 1;
            // Half of what is left, so that the next way down is not starved by this one.
            let share = if searches == MOST_SEARCHES { budget } else { budget.div_ceil(2) };
            let ends = [departure.knots[departure.knots.len() - 1], arrival.knots[0]];
            let before = self.statistics.n_milestones;
            space.buffered = true;
            let found = transit.find(ends, share, space, &mut self.statistics, watch);
            space.buffered = false;
            match found {
                Ok(path) => return Ok((arrival, path)),
                Err(failure) if failure.rank == u8::MAX => return Err(failure),
                Err(failure) => worst = worst.or_later(failure),
            }
            budget = budget.saturating_sub(self.statistics.n_milestones - before);
            if searches == MOST_SEARCHES || budget == 0 {
                break;
            }
        }
        Err(worst)
    }

    /// Knots that press the standing wheel down until it bears its predicted load, and that load (N):
    /// by load over stiffness, but no deeper than half of what a wheel may stand in the ground, for
    /// the rest is the map's error. None where the prediction says nothing.
    fn pressed(
        &self,
        posture: &Posture,
        angles: &LegAngles,
        footfall: &Footfall,
        standing: &[(LegId, Point3<f64>)],
    ) -> Option<(Vec<LegAngles>, f64)> {
        let robot = self.scene.robot();
        let rules = robot.stance();
        let down = posture.with_leg(robot, self.leg(), angles);
        let mut feet = standing.to_vec();
        feet.push((self.leg(), footfall.contact));
        let contacts: Vec<Point3<f64>> = feet.iter().map(|(_, p)| *p).collect();
        let (springs, weight) = (leg_springs(robot, &down, &feet), robot.mass() * self.gravity);
        let loads = compliant_share(&contacts, &down.center_of_mass(robot), weight, &springs)?;
        let (load, spring) = (*loads.last()?, springs.last()?);
        let depth = (load / spring.stiffness_n_m).min(0.5 * rules.ground_tolerance);
        let press = Translation3::from(footfall.normal.into_inner() * -depth);
        let goal = press * footfall.world_from_wheel;
        let knots = wheel_line(robot, posture, self.leg(), angles, &goal).ok()?;
        (depth > 0.0).then_some((knots, load))
    }

    /// All knots with phases and times.
    fn waypoints(
        &self,
        posture: &Posture,
        guard: Option<&StanceGuard>,
        on_ground: &[(LegId, Point3<f64>)],
        parts: &[(Phase, &[LegAngles])],
    ) -> Result<Vec<Waypoint>, TimingError> {
        let robot = self.scene.robot();
        let limits = TimingLimits::of(robot);
        let leg = self.leg();
        let may_hold = |guard: Option<&StanceGuard>, posture: &Posture| {
            guard.is_some_and(|guard| guard.spare(&posture.center_of_mass(robot)) >= 0.0)
        };
        let mut waypoints: Vec<Waypoint> = Vec::new();
        if self.shift.len() > 1 {
            let legs: Vec<LegId> = on_ground.iter().map(|(leg, _)| *leg).collect();
            let all = self.footing().on_all_feet().guard(on_ground);
            let timed =
                time_body_path(robot, &self.shift, &legs, all.as_ref(), self.gravity, &limits)?;
            waypoints.extend(self.shift.iter().zip(timed.times()).map(|(knot, time)| Waypoint {
                angles: knot.legs[leg.0],
                phase: Phase::Shift,
                time,
                hold: may_hold(all.as_ref(), &Posture::new(robot, knot)),
                stance: Some(knot.clone()),
            }));
        }
        for (phase, knots) in parts {
            let timed = time_leg_path(robot, posture, leg, knots, guard, self.gravity, &limits)?;
            let begin = waypoints.last().map_or(0.0, |w| w.time);
            let all = knots.iter().zip(timed.times());
            // Each part begins where the one before ends.
            for (angles, time) in all.skip(usize::from(!waypoints.is_empty())) {
                let (phase, time) = (*phase, begin + time);
                let hold = may_hold(guard, &posture.with_leg(robot, leg, angles));
                waypoints.push(Waypoint { angles: *angles, phase, time, stance: None, hold });
            }
        }
        Ok(waypoints)
    }
}
