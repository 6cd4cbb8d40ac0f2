//! One step of one leg: lift, transit, drop (F75, F76), and the verdict on it.

use collision::{ContactZone, LegChecker, Scene, Survey, Touchdown, survey, touchdowns};
use nalgebra::{Isometry3, Point3, Translation3};
use rover::{Configuration, LegAngles, LegId, Posture};
use stability::rule;

use crate::answer::{
    Footfall, Outcome, Phase, Planner, Statistics, StepAnswer, StepRequest, Target, Waypoint,
};
use crate::check::{CheckContext, check_step, touch_text};
use crate::failure::{Failure, Teller, outcome_of};
use crate::leg_space::{LegSpace, StanceGuard};
use crate::line::wheel_line;
use crate::planner::{PathSearch, Query, SearchOutcome};
use crate::sbl::Sbl;
use crate::smooth::smooth;
use crate::space::{Space, path_length};
use crate::watch::{Stage, Watch};

/// Ways to put the wheel down that are looked at.
const MOST_TOUCHDOWNS: usize = 16;

/// Searches for a transit that one request may start.
const MOST_SEARCHES: usize = 3;

/// Plans one step of `request.leg` with the rest of the robot standing as in `start`.
///
/// The base does not move; where the margin rule cannot be met the answer says what the best
/// margin would be. Deterministic for the same scene, start and request, unless `watch` stops it.
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

struct Planning<'a> {
    scene: &'a Scene,
    start: &'a Configuration,
    gravity: f64,
    request: &'a StepRequest,
    posture: Posture,
    statistics: Statistics,
}

impl<'a> Planning<'a> {
    fn new(
        scene: &'a Scene,
        start: &'a Configuration,
        gravity: f64,
        request: &'a StepRequest,
    ) -> Planning<'a> {
        let posture = Posture::new(scene.robot(), start);
        Planning { scene, start, gravity, request, posture, statistics: Statistics::default() }
    }

    fn leg(&self) -> LegId {
        self.request.leg
    }

    fn teller(&self) -> Teller<'_> {
        Teller { scene: self.scene, leg: self.leg(), lift: self.request.lift }
    }

    fn angles(&self) -> LegAngles {
        self.start.legs[self.leg().0]
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
            constraint: None,
            nearest: None,
            preload: None,
        }
    }

    fn run(&mut self, watch: &mut impl Watch) -> Result<StepAnswer, Failure> {
        watch.entered(Stage::Footfall);
        let seen = (!self.request.transit_only).then(|| survey(self.scene, &self.posture));
        let standing = seen.as_ref().map_or(Ok(Vec::new()), |seen| self.stance(seen))?;
        let robot = self.scene.robot().clone();
        let guard = StanceGuard::new(&robot, &standing, self.request.preference);
        let scene = self.scene;
        let checker = LegChecker::new(
            scene,
            &self.posture,
            self.leg(),
            self.request.environment_tolerance,
            self.request.pair_tolerance,
        );
        let mut space = LegSpace::new(&checker, &robot, &self.posture, guard.as_ref());
        let departure = self.departure(seen.as_ref(), &mut space)?;
        let result = self.reach_some_arrival(&departure, &mut space, watch);
        self.statistics.n_checked = space.n_checked;
        let (arrival, transit) = result?;
        let waypoints = self.waypoints(&departure, &transit, &arrival);

        watch.entered(Stage::Check);
        let report = check_step(
            &CheckContext {
                scene: self.scene,
                start: self.start,
                leg: self.leg(),
                standing: &standing,
                gravity: self.gravity,
                preference: self.request.preference,
                environment_tolerance: self.request.environment_tolerance,
                pair_tolerance: self.request.pair_tolerance,
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
            preload: None,
        })
    }

    fn success_text(&self, waypoints: &[Waypoint]) -> String {
        let duration = waypoints.last().map_or(0.0, |w| w.time);
        format!("a step of {} in {duration:.0} s", self.teller().leg_name())
    }

    /// The legs that stand while this one steps, if that is allowed at all.
    fn stance(&self, seen: &Survey) -> Result<Vec<(LegId, Point3<f64>)>, Failure> {
        if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
            let text =
                format!("the rover starts in collision: {}", touch_text(self.scene, pair.touch));
            return Err(Failure::new(0, Outcome::Colliding, text));
        }
        let mut standing = seen.contacts(self.scene, &self.posture);
        standing.retain(|(leg, _)| *leg != self.leg());
        let robot = self.scene.robot();
        let report = rule::assess(robot, &self.posture, &standing, self.gravity);
        let verdict = rule::verdict(&report, robot.stance(), self.request.preference);
        if verdict.ok {
            return Ok(standing);
        }
        let best = verdict.best_m.map_or(String::new(), |best| {
            format!("; at best {best:.2} m by any shift of the body over these feet")
        });
        let text =
            format!("{} cannot be lifted: {}{best}", self.teller().leg_name(), verdict.explanation);
        Err(Failure::new(0, Outcome::Unstable, text))
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

    fn above(&self, wheel: &Isometry3<f64>) -> Isometry3<f64> {
        Translation3::new(0.0, 0.0, self.request.lift) * wheel
    }

    /// From the start up to the lift waypoint; a leg that is in the air already stays there.
    fn departure(&self, seen: Option<&Survey>, space: &mut LegSpace) -> Result<Departure, Failure> {
        let contact = seen.and_then(|seen| {
            let contacts = seen.contacts(self.scene, &self.posture);
            contacts.into_iter().find(|(leg, _)| *leg == self.leg()).map(|(_, contact)| contact)
        });
        let Some(contact) = contact else {
            return match space.blocked(&self.angles()) {
                None => Ok(Departure { knots: vec![self.angles()], zone: None }),
                Some(blocked) => {
                    let text = format!("at the start {}", self.teller().blocked_text(&blocked));
                    Err(Failure::new(1, Outcome::Colliding, text))
                }
            };
        };
        let wheel = self.posture.wheel(self.scene.robot(), self.leg()).world_from_wheel;
        let zone = Some(self.zone(contact, &wheel));
        let robot = self.scene.robot();
        let goal = self.above(&wheel);
        let knots = wheel_line(robot, &self.posture, self.leg(), &self.angles(), &goal)
            .map_err(|e| self.teller().line_failure(2, "lifted", e))?;
        space.zone = zone;
        let blocked = space.blocked_along(&knots, self.request.sbl.epsilon);
        space.zone = None;
        match blocked.or_else(|| space.blocked(&knots[knots.len() - 1])) {
            None => Ok(Departure { knots, zone }),
            Some(blocked) => {
                let outcome = outcome_of(&blocked, Outcome::NoLift);
                let text = format!("while it is lifted, {}", self.teller().blocked_text(&blocked));
                Err(Failure::new(2, outcome, text))
            }
        }
    }

    /// Tries the ways to end the step, best first, until one can be reached.
    fn reach_some_arrival(
        &mut self,
        departure: &Departure,
        space: &mut LegSpace,
        watch: &mut impl Watch,
    ) -> Result<(Arrival, Vec<LegAngles>), Failure> {
        let goals = self.goals()?;
        self.statistics.n_touchdowns = goals.len();
        let mut worst = Failure::new(0, Outcome::NoPath, "nothing was tried");
        let mut budget = self.request.sbl.max_milestones;
        let mut searches = 0;
        for goal in &goals {
            if let Some(stopped) = watch.stopped() {
                return Err(stopped.into());
            }
            let arrival = match self.arrival(goal, space) {
                Ok(arrival) => arrival,
                Err(failure) => {
                    worst = worst.or_later(failure);
                    continue;
                }
            };
            searches += 1;
            // Half of what is left, so that the next way down is not starved by this one.
            let share = if searches == MOST_SEARCHES { budget } else { budget.div_ceil(2) };
            let from = departure.knots[departure.knots.len() - 1];
            let before = self.statistics.n_milestones;
            match self.transit(from, arrival.knots[0], share, space, watch) {
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

    /// Joint angles to end with: as given, or the ways to put the wheel down at the target.
    fn goals(&self) -> Result<Vec<Goal>, Failure> {
        match self.request.target {
            Target::Angles(angles) => Ok(vec![Goal::Angles(angles)]),
            Target::Ground(ground) => {
                let near = self.angles();
                let robot_leg = self.leg();
                touchdowns(
                    self.scene,
                    &self.posture,
                    robot_leg,
                    ground.xy(),
                    &near,
                    MOST_TOUCHDOWNS,
                )
                .map(|all| all.into_iter().map(Goal::Touchdown).collect())
                .map_err(|none| self.teller().no_touchdown(none))
            }
        }
    }

    /// The way down to a goal, checked.
    fn arrival(&self, goal: &Goal, space: &mut LegSpace) -> Result<Arrival, Failure> {
        if let (Goal::Angles(angles), true) = (goal, self.request.transit_only) {
            return match space.blocked(angles) {
                None => Ok(Arrival { knots: vec![*angles], zone: None, footfall: None }),
                Some(blocked) => {
                    let text = format!("at the goal {}", self.teller().blocked_text(&blocked));
                    Err(Failure::new(4, Outcome::Colliding, text))
                }
            };
        }
        let (angles, footfall) = match goal {
            Goal::Touchdown(t) => (t.angles, footfall_of(t)),
            Goal::Angles(angles) => (*angles, self.footfall_at(angles)?),
        };
        let zone = self.zone(footfall.contact, &footfall.world_from_wheel);
        space.zone = Some(zone);
        let blocked = space.blocked(&angles);
        space.zone = None;
        if let Some(blocked) = blocked {
            let text = format!("with the wheel there {}", self.teller().blocked_text(&blocked));
            return Err(Failure::new(4, outcome_of(&blocked, Outcome::Colliding), text));
        }
        let robot = self.scene.robot();
        let above = self.above(&footfall.world_from_wheel);
        let mut knots = wheel_line(robot, &self.posture, self.leg(), &angles, &above)
            .map_err(|e| self.teller().line_failure(5, "raised above the goal", e))?;
        knots.reverse();
        space.zone = Some(zone);
        let blocked = space.blocked_along(&knots, self.request.sbl.epsilon);
        space.zone = None;
        match blocked.or_else(|| space.blocked(&knots[0])) {
            None => Ok(Arrival { knots, zone: Some(zone), footfall: Some(footfall) }),
            Some(blocked) => {
                let outcome = outcome_of(&blocked, Outcome::NoLift);
                let text = format!("on the way down {}", self.teller().blocked_text(&blocked));
                Err(Failure::new(6, outcome, text))
            }
        }
    }

    /// Where the wheel stands with these angles; it must stand.
    fn footfall_at(&self, angles: &LegAngles) -> Result<Footfall, Failure> {
        let robot = self.scene.robot();
        let posture = self.posture.with_leg(robot, self.leg(), angles);
        let wheel = posture.wheel(robot, self.leg());
        let below = collision::wheel_ground(&wheel, self.scene.map(), |_| true);
        let Some(gap) = below.nearest.filter(|_| !below.unknown) else {
            let text = "the ground below the goal is unknown";
            return Err(Failure::new(3, Outcome::UnknownGround, text));
        };
        if gap.gap.abs() > robot.stance().ground_tolerance {
            let (far, side) = (gap.gap.abs(), if gap.gap > 0.0 { "above" } else { "in" });
            let text = format!("with these angles the wheel is {far:.3} m {side} the ground");
            return Err(Failure::new(3, Outcome::Unreachable, text));
        }
        let contact = collision::contact_center(&wheel, self.scene.map(), &gap);
        let place = collision::footfall_place(self.scene, self.leg(), contact.xy());
        let normal = place.map_or(nalgebra::Vector3::z_axis(), |place| place.normal);
        Ok(Footfall { contact, normal, world_from_wheel: wheel.world_from_wheel })
    }

    /// From waypoint to waypoint, smoothed.
    fn transit(
        &mut self,
        from: LegAngles,
        to: LegAngles,
        budget: usize,
        space: &mut LegSpace,
        watch: &mut impl Watch,
    ) -> Result<Vec<LegAngles>, Failure> {
        watch.entered(Stage::Search);
        space.last = None;
        self.statistics.straight = (to - from).norm();
        let first = match self.request.planner {
            Planner::Line => self.line_transit(&from, &to, space)?,
            Planner::Auto if space.edge_is_free(&from, &to) => {
                vec![from, to]
            }
            Planner::Auto | Planner::AStar | Planner::RrtConnect | Planner::Sbl => {
                self.search(from, to, budget, space, watch)?
            }
        };
        self.statistics.first_path = path_length(&first);
        watch.entered(Stage::Smoothing);
        let smoothed = smooth(space, &first, &self.request.smooth, watch)?;
        self.statistics.n_edges += smoothed.n_edges;
        self.statistics.length = path_length(&smoothed.path);
        Ok(smoothed.path)
    }

    fn search(
        &mut self,
        from: LegAngles,
        to: LegAngles,
        budget: usize,
        space: &mut LegSpace,
        watch: &mut impl Watch,
    ) -> Result<Vec<LegAngles>, Failure> {
        let query = Query {
            start: from,
            goal: to,
            seed: self.request.seed,
            budget: u64::MAX,
            max_nodes: budget,
            cell: self.request.cell,
        };
        let sbl = Sbl { closeness: self.request.sbl.closeness };
        let result = sbl.search(space, &query, watch);
        self.statistics.n_milestones += result.n_nodes;
        self.statistics.n_edges += result.n_edges;
        match result.outcome {
            SearchOutcome::Found(path) => Ok(path),
            SearchOutcome::Stopped(stopped) => Err(stopped.into()),
            SearchOutcome::NotFound { .. } => {
                let met = space.last.map_or(String::new(), |blocked| {
                    format!("; last in the way: {}", self.teller().blocked_text(&blocked))
                });
                let text = format!(
                    "no path within {} milestones, which is no proof that there is none{met}",
                    result.n_nodes
                );
                Err(Failure::new(7, Outcome::NoPath, text))
            }
        }
    }

    fn line_transit(
        &self,
        from: &LegAngles,
        to: &LegAngles,
        space: &mut LegSpace,
    ) -> Result<Vec<LegAngles>, Failure> {
        let robot = self.scene.robot();
        let goal = self.posture.with_leg(robot, self.leg(), to).wheel(robot, self.leg());
        let no_path = |text: String| Failure::new(7, Outcome::NoPath, text);
        let mut knots = wheel_line(robot, &self.posture, self.leg(), from, &goal.world_from_wheel)
            .map_err(|_| no_path("the straight line of the wheel leaves its reach".into()))?;
        let end = knots.len() - 1;
        if (knots[end] - to).amax() > 1e-3 {
            return Err(no_path("the straight line ends on another branch of the leg".into()));
        }
        knots[end] = *to;
        match space.blocked_along(&knots, self.request.sbl.epsilon) {
            None => Ok(knots),
            Some(blocked) => {
                let text = format!("on the straight line {}", self.teller().blocked_text(&blocked));
                Err(no_path(text))
            }
        }
    }

    /// All knots with phases and times.
    fn waypoints(
        &self,
        departure: &Departure,
        transit: &[LegAngles],
        arrival: &Arrival,
    ) -> Vec<Waypoint> {
        let first_phase = if departure.knots.len() > 1 { Phase::Lift } else { Phase::Transit };
        let mut waypoints = vec![Waypoint {
            angles: departure.knots[0],
            phase: first_phase,
            time: 0.0,
            stance: None,
            hold: true,
        }];
        let speed = self.scene.robot().motion().joint_speed;
        let parts = [
            (Phase::Lift, &departure.knots[1..]),
            (Phase::Transit, transit.get(1..).unwrap_or(&[])),
            (Phase::Drop, &arrival.knots[1..]),
        ];
        for (phase, knots) in parts {
            for angles in knots {
                let before = &waypoints[waypoints.len() - 1];
                let time = before.time + (angles - before.angles).amax() / speed;
                waypoints.push(Waypoint { angles: *angles, phase, time, stance: None, hold: true });
            }
        }
        waypoints
    }
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
