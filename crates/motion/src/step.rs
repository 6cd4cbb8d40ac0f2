//! One step of one leg: body shift, lift, transit, drop, preload (F75, F76), and the verdict on it.

use collision::{ContactZone, Keep, LegChecker, Scene, Survey, Touchdown, survey, touchdowns};
use nalgebra::{Isometry3, Point2, Point3, Translation3, Unit, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture};
use stability::{Preference, StanceGuard, rule, spring_share};

use crate::answer::{
    EdgeRule, Footfall, Outcome, Phase, Statistics, StepAnswer, StepRequest, Target, Waypoint,
};
use crate::check::{CheckContext, check_step, touch_text};
use crate::failure::{Failure, Teller, outcome_of};
use crate::leg_space::{Blocked, LegSpace, guard_over};
use crate::line::wheel_line;
use crate::shift::{SampledBody, ShiftRequest, plan_shift};
use crate::timing::{TimingError, TimingLimits, time_body_path, time_leg_path};
use crate::transit::Transit;
use crate::watch::{Stage, Watch};

/// Ways to put the wheel down that are looked at.
const MOST_TOUCHDOWNS: usize = 16;

/// Searches for a transit that one request may start.
const MOST_SEARCHES: usize = 3;

/// Clearance beyond what must be kept that a way to put the wheel down is preferred for (m at
/// scale 1).
const ROOM: f64 = 0.05;

/// Distances at which a place is sought for which there would be a step (m at scale 1), and
/// directions at each.
const RINGS: [f64; 6] = [0.05, 0.1, 0.2, 0.35, 0.6, 1.0];
const DIRECTIONS: usize = 8;

/// Plans one step of `request.leg` with the rest of the robot standing as in `start`.
///
/// Where the margin rule asks for it, and the request allows it, the body is shifted first; else
/// the base does not move. Where there is no step the answer says what is in the way, how much is
/// missing, and the nearest ground for which there would be one. Deterministic for the same scene,
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

/// The part of the way that all goals share.
struct Departure {
    /// Knots from the start to the lift waypoint.
    knots: Vec<LegAngles>,
    zone: Option<ContactZone>,
}

/// A way to end the step.
struct Arrival {
    /// Knots from the drop waypoint to the goal.
    knots: Vec<LegAngles>,
    zone: Option<ContactZone>,
    footfall: Option<Footfall>,
}

/// What the step stands on: the feet that stay, and what was seen.
struct Stance {
    seen: Option<Survey>,
    /// All legs on the ground at the start, with their contacts.
    on_ground: Vec<(LegId, Point3<f64>)>,
    /// The legs that stand while this one steps, with their contacts.
    standing: Vec<(LegId, Point3<f64>)>,
}

struct Planning<'a> {
    scene: &'a Scene,
    /// Where the rover is.
    start: &'a Configuration,
    gravity: f64,
    request: &'a StepRequest,
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

    fn leg(&self) -> LegId {
        self.request.leg
    }

    fn teller(&self) -> Teller<'a> {
        Teller { scene: self.scene, leg: self.leg(), lift: self.request.lift }
    }

    /// Where the rover is when the leg begins to move.
    fn stepping_from(&self) -> &Configuration {
        self.shift.last().unwrap_or(self.start)
    }

    fn angles(&self) -> LegAngles {
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
        let guard = guard_over(&robot, &stance.standing, self.request.preference);
        let scene = self.scene;
        let contact = self.contact(&posture, stance.seen.as_ref());
        let checker = LegChecker::keeping(scene, &posture, self.leg(), self.keep(contact.as_ref()));
        let rule = self.request.edges;
        let mut space = LegSpace::new(&checker, &robot, &posture, guard.as_ref(), rule);
        let departure = self.departure(&posture, contact, &mut space)?;
        let result = self.reach_some_arrival(&posture, &departure, &mut space, watch);
        if let Err(failure) = &result {
            self.nearest = self.nearest_place(&posture, failure, &mut space, watch);
        }
        self.statistics.n_checked = crate::space::Space::n_checked(&space);
        let (arrival, transit) = result?;
        self.statistics.certified = matches!(rule, EdgeRule::Certified);
        let down = arrival.knots[arrival.knots.len() - 1];
        let pressed = (self.request.preload && !self.request.transit_only)
            .then_some(arrival.footfall.as_ref())
            .flatten()
            .and_then(|footfall| self.pressed(&posture, &down, footfall, &stance.standing));
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
                keep: self.keep(departure.zone.map(|zone| zone.contact).as_ref()),
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
    fn keep(&self, contact: Option<&Point3<f64>>) -> Keep {
        let goal = match self.request.target {
            Target::Ground(ground) => Some(ground.xy()),
            Target::Angles(_) => None,
        };
        let buffers = &self.request.buffers;
        Keep {
            environment: self.request.environment_tolerance,
            pairs: self.request.pair_tolerance,
            // A buffer never takes a clearance away.
            inflation: buffers.inflation.max(0.0),
            obstacle_buffer: buffers.obstacle.max(0.0),
            terrain_lift: buffers.terrain_lift.max(0.0),
            footfalls: contact.map(|p| p.xy()).into_iter().chain(goal).collect(),
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
        let guard = guard_over(robot, &standing, self.request.preference);
        if guard.is_some_and(|guard| guard.spare(&posture.center_of_mass(robot)) >= 0.0) {
            return Ok(Stance { seen: Some(seen), on_ground, standing });
        }
        let report = rule::assess(robot, posture, &standing, self.gravity);
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
        self.shift = self.shifted(&on_ground, watch).map_err(unstable)?;
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
            drive_hold: self.request.drive_hold,
            seed: self.request.seed,
            ..ShiftRequest::new(self.scene, self.start, on_ground, self.leg())
        };
        let legs: Vec<LegId> = on_ground.iter().map(|(leg, _)| *leg).collect();
        let mut body = SampledBody::new(self.scene, self.start, &legs);
        let plan = plan_shift(&request, &mut body, watch);
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

    fn zone(&self, contact: Point3<f64>, wheel: &Isometry3<f64>) -> ContactZone {
        let rules = self.scene.robot().stance();
        ContactZone {
            contact,
            center: wheel.translation.vector.into(),
            radius: rules.contact_radius,
            height: rules.contact_height,
            ground_tolerance: rules.ground_tolerance,
        }
    }

    /// The waypoint above a standing wheel, along the ground's normal.
    fn above(&self, wheel: &Isometry3<f64>, normal: &Unit<Vector3<f64>>) -> Isometry3<f64> {
        Translation3::from(normal.into_inner() * self.request.lift) * wheel
    }

    /// From the start up to the lift waypoint; a leg that is in the air already stays there.
    fn departure(
        &self,
        posture: &Posture,
        contact: Option<Point3<f64>>,
        space: &mut LegSpace,
    ) -> Result<Departure, Failure> {
        let Some(contact) = contact else {
            return match space.blocked(&self.angles()) {
                None => Ok(Departure { knots: vec![self.angles()], zone: None }),
                Some(blocked) => {
                    let text = format!("at the start {}", self.teller().blocked_text(&blocked));
                    Err(Failure::new(1, Outcome::Colliding, text).by_blocked(&blocked))
                }
            };
        };
        let wheel = posture.wheel(self.scene.robot(), self.leg()).world_from_wheel;
        let zone = self.zone(contact, &wheel);
        let normal = collision::footfall_place(self.scene, self.leg(), contact.xy())
            .map_or(Vector3::z_axis(), |place| place.normal);
        self.away_from_ground(posture, &self.angles(), &wheel, &zone, &normal, space)
            .map(|knots| Departure { knots, zone: Some(zone) })
            .map_err(|away| match away {
                Away::Line(e) => self.teller().line_failure(2, "lifted", e),
                Away::Blocked(blocked) => {
                    let outcome = outcome_of(&blocked, Outcome::NoLift);
                    let text =
                        format!("while it is lifted, {}", self.teller().blocked_text(&blocked));
                    Failure::new(2, outcome, text).by_blocked(&blocked)
                }
            })
    }

    /// Knots from a standing wheel to the waypoint above it: along the ground's normal, or straight
    /// up where that fails.
    fn away_from_ground(
        &self,
        posture: &Posture,
        angles: &LegAngles,
        wheel: &Isometry3<f64>,
        zone: &ContactZone,
        normal: &Unit<Vector3<f64>>,
        space: &mut LegSpace,
    ) -> Result<Vec<LegAngles>, Away> {
        let robot = self.scene.robot();
        let mut along = |normal: &Unit<Vector3<f64>>| {
            let above = self.above(wheel, normal);
            let knots =
                wheel_line(robot, posture, self.leg(), angles, &above).map_err(Away::Line)?;
            space.zone = Some(*zone);
            let blocked = space.blocked_along(&knots);
            space.zone = None;
            // The waypoint belongs to the transit: there the wheel may touch nothing.
            space.buffered = true;
            let blocked = blocked.or_else(|| space.blocked(&knots[knots.len() - 1]));
            space.buffered = false;
            blocked.map_or(Ok(knots), |blocked| Err(Away::Blocked(blocked)))
        };
        let first = along(normal);
        let tilted = normal.dot(&Vector3::z()) < 1.0 - 1e-9;
        match first {
            Err(failed) if tilted => along(&Vector3::z_axis()).map_err(|_| failed),
            first => first,
        }
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

    /// Joint angles to end with: as given, or the ways to put the wheel down at the target, those
    /// with room about the leg first.
    fn goals(&self, posture: &Posture, space: &mut LegSpace) -> Result<Vec<Goal>, Failure> {
        match self.request.target {
            Target::Angles(angles) => Ok(vec![Goal::Angles(angles)]),
            Target::Ground(ground) => {
                let mut goals = self.touchdowns_at(posture, ground.xy())?;
                goals.sort_by_cached_key(|goal| {
                    space.zone = Some(self.zone(goal.contact, &goal.wheel.world_from_wheel));
                    !space.is_roomy(&goal.angles, ROOM * self.scene.robot().scale())
                });
                space.zone = None;
                Ok(goals.into_iter().map(Goal::Touchdown).collect())
            }
        }
    }

    fn touchdowns_at(&self, posture: &Posture, p: Point2<f64>) -> Result<Vec<Touchdown>, Failure> {
        let near = self.angles();
        touchdowns(self.scene, posture, self.leg(), p, &near, MOST_TOUCHDOWNS)
            .map_err(|none| self.teller().no_touchdown(none))
    }

    /// The way down to a goal, checked.
    fn arrival(
        &self,
        posture: &Posture,
        goal: &Goal,
        space: &mut LegSpace,
    ) -> Result<Arrival, Failure> {
        if let (Goal::Angles(angles), true) = (goal, self.request.transit_only) {
            return match space.blocked(angles) {
                None => Ok(Arrival { knots: vec![*angles], zone: None, footfall: None }),
                Some(blocked) => {
                    let text = format!("at the goal {}", self.teller().blocked_text(&blocked));
                    Err(Failure::new(4, Outcome::Colliding, text).by_blocked(&blocked))
                }
            };
        }
        let (angles, footfall) = match goal {
            Goal::Touchdown(t) => (t.angles, footfall_of(t)),
            Goal::Angles(angles) => (*angles, self.footfall_at(posture, angles)?),
        };
        let wheel = &footfall.world_from_wheel;
        let zone = self.zone(footfall.contact, wheel);
        space.zone = Some(zone);
        let blocked = space.blocked(&angles);
        space.zone = None;
        if let Some(blocked) = blocked {
            let text = format!("with the wheel there {}", self.teller().blocked_text(&blocked));
            let outcome = outcome_of(&blocked, Outcome::Colliding);
            return Err(Failure::new(4, outcome, text).by_blocked(&blocked));
        }
        let away = self.away_from_ground(posture, &angles, wheel, &zone, &footfall.normal, space);
        let mut knots = away.map_err(|away| match away {
            Away::Line(e) => self.teller().line_failure(5, "raised above the goal", e),
            Away::Blocked(blocked) => {
                let outcome = outcome_of(&blocked, Outcome::NoLift);
                let text = format!("on the way down {}", self.teller().blocked_text(&blocked));
                Failure::new(6, outcome, text).by_blocked(&blocked)
            }
        })?;
        knots.reverse();
        Ok(Arrival { knots, zone: Some(zone), footfall: Some(footfall) })
    }

    /// Where the wheel stands with these angles; it must stand.
    fn footfall_at(&self, posture: &Posture, angles: &LegAngles) -> Result<Footfall, Failure> {
        let robot = self.scene.robot();
        let posture = posture.with_leg(robot, self.leg(), angles);
        let wheel = posture.wheel(robot, self.leg());
        let below = collision::wheel_ground(&wheel, self.scene.map(), |_| true);
        let Some(gap) = below.nearest.filter(|_| !below.unknown) else {
            let text = "the ground below the goal is unknown";
            let failure = Failure::new(3, Outcome::UnknownGround, text);
            return Err(failure.by("unknown_ground", None, "m"));
        };
        if gap.gap.abs() > robot.stance().ground_tolerance {
            let (far, side) = (gap.gap.abs(), if gap.gap > 0.0 { "above" } else { "in" });
            let text = format!("with these angles the wheel is {far:.3} m {side} the ground");
            let failure = Failure::new(3, Outcome::Unreachable, text);
            return Err(failure.by("ground", Some(far), "m"));
        }
        let contact = collision::contact_center(&wheel, self.scene.map(), &gap);
        let place = collision::footfall_place(self.scene, self.leg(), contact.xy());
        let normal = place.map_or(nalgebra::Vector3::z_axis(), |place| place.normal);
        Ok(Footfall { contact, normal, world_from_wheel: wheel.world_from_wheel })
    }

    /// The nearest ground where the wheel could be put down and lifted again, if it is the place
    /// that is in the way.
    fn nearest_place(
        &self,
        posture: &Posture,
        failure: &Failure,
        space: &mut LegSpace,
        watch: &mut impl Watch,
    ) -> Option<Point3<f64>> {
        let Target::Ground(ground) = self.request.target else { return None };
        let of_place = [
            Outcome::Unreachable,
            Outcome::Colliding,
            Outcome::NoLift,
            Outcome::UnknownGround,
            Outcome::Unstable,
        ];
        if !of_place.contains(&failure.outcome) {
            return None;
        }
        let scale = self.scene.robot().scale();
        // First toward where the wheel is now: most places that fail are too far out.
        let wheel = posture.wheel(self.scene.robot(), self.leg()).center();
        let home = wheel.xy() - ground.xy();
        let heading = home.y.atan2(home.x);
        for ring in RINGS {
            for k in 0..DIRECTIONS {
                if watch.stopped().is_some() {
                    return None;
                }
                let side = if k % 2 == 0 { 1.0 } else { -1.0 };
                let turn = k.div_ceil(2) as f64 * side / DIRECTIONS as f64;
                let angle = heading + std::f64::consts::TAU * turn;
                let reach = (ring * scale).min(if k == 0 { home.norm() } else { f64::INFINITY });
                let p = ground.xy() + nalgebra::Vector2::new(angle.cos(), angle.sin()) * reach;
                let Ok(ways) = self.touchdowns_at(posture, p) else { continue };
                let works = ways
                    .into_iter()
                    .take(2)
                    .any(|way| self.arrival(posture, &Goal::Touchdown(way), space).is_ok());
                if works {
                    return self.scene.map().height_at(p).map(|z| Point3::new(p.x, p.y, z));
                }
            }
        }
        None
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
        let mut contacts: Vec<Point3<f64>> = standing.iter().map(|(_, p)| *p).collect();
        contacts.push(footfall.contact);
        let weight = robot.mass() * self.gravity;
        let load = *spring_share(&contacts, &down.center_of_mass(robot), weight)?.last()?;
        let depth = (load / rules.leg_stiffness).min(0.5 * rules.ground_tolerance);
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
        let mut waypoints: Vec<Waypoint> = Vec::new();
        if self.shift.len() > 1 {
            let legs: Vec<LegId> = on_ground.iter().map(|(leg, _)| *leg).collect();
            let all = guard_over(robot, on_ground, Preference::Regular);
            let timed =
                time_body_path(robot, &self.shift, &legs, all.as_ref(), self.gravity, &limits)?;
            waypoints.extend(self.shift.iter().zip(timed.times()).map(|(knot, time)| Waypoint {
                angles: knot.legs[leg.0],
                phase: Phase::Shift,
                time,
                stance: Some(knot.clone()),
                hold: true,
            }));
        }
        for (phase, knots) in parts {
            let timed = time_leg_path(robot, posture, leg, knots, guard, self.gravity, &limits)?;
            let begin = waypoints.last().map_or(0.0, |w| w.time);
            let all = knots.iter().zip(timed.times());
            // Each part begins where the one before ends.
            for (angles, time) in all.skip(usize::from(!waypoints.is_empty())) {
                let (phase, time) = (*phase, begin + time);
                waypoints.push(Waypoint { angles: *angles, phase, time, stance: None, hold: true });
            }
        }
        Ok(waypoints)
    }
}

/// Why a wheel cannot be moved away from where it stands.
enum Away {
    Line(crate::line::LineError),
    Blocked(Blocked),
}

enum Goal {
    Touchdown(Touchdown),
    Angles(LegAngles),
}

fn footfall_of(touchdown: &Touchdown) -> Footfall {
    Footfall {
        contact: touchdown.contact,
        normal: touchdown.place.normal,
        world_from_wheel: touchdown.wheel.world_from_wheel,
    }
}
