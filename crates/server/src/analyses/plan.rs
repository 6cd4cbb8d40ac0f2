//! One planned step.

use motion::{
    Buffers, EdgeRule, Finding, MarginSample, Outcome, Phase, Planner as Search, Stage, StepAnswer,
    StepRequest, Stopped, Stretch, Target, Watch, Waypoint, plan_step,
};
use nalgebra::Point3;
use rover::{Configuration, LegId, Robot};
use stability::Preference;
use tokio::time::Instant;
use wire::analysis::{
    PathPlanner, PlanAnswer, PlanBasis, PlanCommand, PlanConstraint, PlanFinding, PlanMargins,
    PlanPhase, PlanRequest, PlanShift, PlanStatistics, PlanWaypoint, Planner,
};
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::live::{BodyKnot, CommandBody, Footfall, JointKnot};

use super::reachability::{LIFT_M, LIFT_RANGE_M, preference};
use super::regions::names;
use crate::live::hash_text;
use crate::scene::{Context, Scene};
use crate::stop::{Cause, Stop};
use crate::terrain_store::version_name;

/// Told how far a plan is (0 to 1) and what it is doing.
pub type OnProgress<'a> = &'a dyn Fn(f64, &str);

/// A plan, and the state that it starts from.
pub struct Planned {
    /// The answer.
    pub answer: PlanAnswer,
    /// Where the rover was.
    pub start: Configuration,
}

/// Plans one step.
pub fn plan(
    context: &Context,
    request: &PlanRequest,
    stop: &Stop,
    progress: OnProgress<'_>,
) -> Result<Planned, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    let step = step_request(&scene, request)?;
    let mut clock = StageClock::new(stop, progress);
    let solid = &scene.solid;
    let found = plan_step(solid, &scene.configuration, scene.gravity, &step, &mut clock);
    let times_ms = clock.times_ms();
    let answer = answer(&scene, request, &found, times_ms);
    Ok(Planned { answer, start: scene.configuration })
}

/// Whether a step of a leg to a place, as the planner makes it with its defaults, is found: then its
/// final check has passed. `None` if it was stopped.
pub fn is_plannable(
    scene: &Scene,
    leg: LegId,
    place: Point3<f64>,
    preference: Preference,
    stop: &Stop,
) -> Option<bool> {
    let scale = scene.robot().scale();
    let request = StepRequest {
        preference,
        friction: scene.friction,
        ..StepRequest::new(leg, Target::Ground(place), scale)
    };
    let mut clock = StageClock::new(stop, &|_, _| {});
    let found = plan_step(&scene.solid, &scene.configuration, scene.gravity, &request, &mut clock);
    match found.outcome {
        Outcome::Deadline | Outcome::Cancelled => None,
        outcome => Some(outcome == Outcome::Found),
    }
}

/// The request in the domain's terms, checked.
fn step_request(scene: &Scene, request: &PlanRequest) -> Result<StepRequest, RequestError> {
    let robot = scene.robot();
    let leg = convert::leg(&At::root("leg"), robot, &request.leg)?;
    let at = At::root("target");
    let target = match (request.target.position_m, &request.target.joints_rad) {
        (Some(p), None) => {
            Target::Ground(Point3::from(check::position(&at.field("position_m"), p)?))
        }
        (None, Some(joints)) => {
            Target::Angles(convert::leg_angles(&at.field("joints_rad"), robot.leg(leg), joints)?)
        }
        _ => {
            let text = "takes exactly one of position_m and joints_rad";
            return Err(RequestError::at("target_ambiguous", &at, text));
        }
    };
    let mut step = StepRequest::new(leg, target, robot.scale());
    step.planner = match request.planner {
        Planner::Auto => Search::Auto,
        Planner::Sbl => Search::Sbl,
        Planner::Line => Search::Line,
        Planner::Astar => Search::AStar,
        Planner::RrtConnect => Search::RrtConnect,
    };
    let lift_m = request.lift_m.unwrap_or(LIFT_M * robot.scale());
    step.lift = check::within(&At::root("lift_m"), lift_m, LIFT_RANGE_M, " m")?;
    step.preference = preference(request.stability);
    step.friction = scene.friction;
    let at = At::root("tolerances");
    let tolerance = |name: &str, value: Option<f64>| {
        value.map(|v| check::within(&at.field(name), v, [0.0, 1.0], " m")).transpose()
    };
    step.environment_tolerance = tolerance("environment_m", request.tolerances.environment_m)?;
    step.pair_tolerance = tolerance("pairs_m", request.tolerances.pairs_m)?;
    if request.transit_only && request.target.joints_rad.is_none() {
        let text = "goes from joint angles to joint angles: give target.joints_rad";
        return Err(RequestError::at("target_ambiguous", &At::root("transit_only"), text));
    }
    step.transit_only = request.transit_only;
    step.seed = request.seed;
    step.buffers = buffers(request)?;
    if let Some(cell_m) = request.cell_m {
        let scale = robot.scale();
        let range = [0.02 * scale, scale];
        step.cell = check::within(&At::root("cell_m"), cell_m, range, " m")?;
    }
    if let Some(epsilon) = request.epsilon_rad {
        let at = At::root("epsilon_rad");
        step.edges = EdgeRule::Sampled(check::within(&at, epsilon, [0.0005, 0.1], " rad")?);
    }
    step.may_shift = request.shift == PlanShift::Auto;
    step.preload = request.preload;
    step.drive_hold = request.drive_hold;
    if let Some(budget) = request.budget {
        let budget = check::within(&At::root("budget"), budget as f64, [2.0, 1e6], "")?;
        step.sbl.max_milestones = budget as usize;
    }
    let at = At::root("smoothing");
    let smoothing = &request.smoothing;
    if let Some(share) = smoothing.stop_reduction {
        step.smooth.stop_reduction =
            check::within(&at.field("stop_reduction"), share, [0.0, 1.0], "")?;
    }
    if let Some(rounds) = smoothing.max_rounds {
        let rounds = check::within(&at.field("max_rounds"), rounds.into(), [0.0, 1000.0], "")?;
        step.smooth.max_rounds = rounds as usize;
    }
    if let Some(edges) = smoothing.max_edges {
        let edges = check::within(&at.field("max_edges"), edges.into(), [0.0, 1e6], "")?;
        step.smooth.max_edges = edges as usize;
    }
    Ok(step)
}

fn buffers(request: &PlanRequest) -> Result<Buffers, RequestError> {
    let buffer = |at: At<'_>, name: &str, value: Option<f64>| {
        check::within(&at.field(name), value.unwrap_or(0.0), [0.0, 1.0], " m")
    };
    let asked = &request.buffers;
    let (at, tolerances) = (At::root("buffers"), At::root("tolerances"));
    Ok(Buffers {
        terrain_lift: buffer(at, "terrain_lift_m", asked.terrain_lift_m)?,
        obstacle: buffer(At::root("buffers"), "obstacle_m", asked.obstacle_m)?,
        inflation: buffer(tolerances, "inflation_m", request.tolerances.inflation_m)?,
    })
}

fn answer(
    scene: &Scene,
    request: &PlanRequest,
    found: &StepAnswer,
    [shift_ms, footfall_ms, search_ms, smoothing_ms, check_ms]: [f64; 5],
) -> PlanAnswer {
    let robot = scene.robot();
    let leg = robot.leg_id(&request.leg).unwrap_or(LegId(0));
    let map = scene.solid.map();
    // The height asked for does not count: the wheel stands on the ground.
    let target_m = request
        .target
        .position_m
        .map(|[x, y, z]| [x, y, map.height_at(nalgebra::Point2::new(x, y)).unwrap_or(z)]);
    let statistics = &found.statistics;
    let commands = match found.outcome {
        Outcome::Found if !request.transit_only => {
            let hold = request.drive_hold;
            commands(robot, leg, &scene.configuration, &found.waypoints, hold)
        }
        _ => Vec::new(),
    };
    let retreat = retreat(&request.leg, &commands);
    PlanAnswer {
        id: None,
        outcome: found.outcome.word().into(),
        reason: (!found.reason.is_empty()).then(|| found.reason.clone()),
        leg: request.leg.clone(),
        target_m,
        waypoints: found.waypoints.iter().map(|w| waypoint(robot, leg, w)).collect(),
        commands,
        findings: found.findings.iter().map(finding).collect(),
        statistics: PlanStatistics {
            search_ms: shift_ms + footfall_ms + search_ms,
            smoothing_ms,
            check_ms,
            configurations_checked: statistics.n_checked,
            milestones: statistics.n_milestones as u64,
            touchdowns: statistics.n_touchdowns as u64,
            first_path_rad: statistics.first_path,
            length_rad: statistics.length,
            straight_rad: statistics.straight,
            planner: statistics.planner.map(path_planner),
            edges: statistics.n_edges,
            certified: statistics.certified,
        },
        basis: PlanBasis {
            state_hash: state_hash(&scene.configuration),
            terrain_version: version_name(map),
            model_hash: hash_text(robot.hash()),
            seed: request.seed,
            version: env!("CARGO_PKG_VERSION").into(),
        },
        footfall: found.footfall.as_ref().map(|footfall| Footfall {
            ground_m: convert::point(&footfall.contact),
            normal: [footfall.normal.x, footfall.normal.y, footfall.normal.z],
            wheel: convert::pose(&footfall.world_from_wheel),
        }),
        margins: margins(scene, &[Stretch::of_step(&scene.configuration, leg, found)]),
        constraint: found.constraint.as_ref().map(|constraint| PlanConstraint {
            name: constraint.name.into(),
            missing: constraint.missing.filter(|missing| missing.is_finite()),
            unit: constraint.unit.into(),
            detail: found.reason.clone(),
        }),
        nearest_m: found.nearest.as_ref().map(convert::point),
        retreat,
        preload_n: found.preload,
        posture: None,
    }
}

/// All margins along motions that follow each other.
pub(super) fn margins(scene: &Scene, stretches: &[Stretch]) -> PlanMargins {
    let robot = scene.robot();
    let samples = motion::margins_along(&scene.solid, stretches, scene.friction);
    let weight = robot.mass() * scene.gravity;
    let of = |value: fn(&MarginSample) -> Option<f64>| samples.iter().map(value).collect();
    let name = |leg: usize| robot.legs()[leg].name.clone();
    let edge = |sample: &MarginSample| names(&sample.critical?.map(|leg| leg.0), name);
    PlanMargins {
        time_s: samples.iter().map(|sample| sample.time).collect(),
        regular_m: of(|sample| sample.regular),
        conservative_m: of(|sample| sample.conservative),
        friction_m: of(|sample| sample.friction),
        energy_j: samples.iter().map(|sample| sample.energy_height.map(|h| h * weight)).collect(),
        energy_m: of(|sample| sample.energy_height),
        critical: samples.iter().map(edge).collect(),
    }
}

fn path_planner(planner: motion::PathPlanner) -> PathPlanner {
    match planner {
        motion::PathPlanner::JointLine => PathPlanner::JointLine,
        motion::PathPlanner::AStar => PathPlanner::Astar,
        motion::PathPlanner::Sbl => PathPlanner::Sbl,
        motion::PathPlanner::RrtConnect => PathPlanner::RrtConnect,
        motion::PathPlanner::Line => PathPlanner::Line,
    }
}

pub(super) fn phase(phase: Phase) -> PlanPhase {
    match phase {
        Phase::Shift => PlanPhase::Shift,
        Phase::Lift => PlanPhase::Lift,
        Phase::Transit => PlanPhase::Transit,
        Phase::Drop => PlanPhase::Drop,
        Phase::Preload => PlanPhase::Preload,
    }
}

fn waypoint(robot: &Robot, leg: LegId, waypoint: &Waypoint) -> PlanWaypoint {
    PlanWaypoint {
        joints_rad: convert::by_joint(robot.leg(leg), &waypoint.angles),
        phase: phase(waypoint.phase),
        time_s: waypoint.time,
        stance: waypoint.stance.as_ref().map(|stance| convert::rover_state(robot, stance)),
        hold: waypoint.hold,
    }
}

pub(super) fn finding(finding: &Finding) -> PlanFinding {
    let text = |text: &str| (!text.is_empty()).then(|| text.to_owned());
    PlanFinding {
        check: finding.check.into(),
        ok: finding.ok,
        assumed: finding.is_assumption(),
        margin: finding.margin.filter(|margin| margin.is_finite()),
        r#where: text(&finding.place),
        detail: text(&finding.detail),
    }
}

/// One command for each phase, each beginning where the one before ends. `start` is the whole robot
/// at the first waypoint. No commands at all where a shift lacks its stances: what follows it would
/// begin elsewhere.
pub(super) fn commands(
    robot: &Robot,
    leg: LegId,
    start: &Configuration,
    waypoints: &[Waypoint],
    drive_hold: bool,
) -> Vec<PlanCommand> {
    let name = &robot.leg(leg).name;
    let parts = [Phase::Shift, Phase::Lift, Phase::Transit, Phase::Drop, Phase::Preload];
    let of_part = |part: Phase| {
        let first = waypoints.iter().skip(1).position(|w| w.phase == part)? + 1;
        let last = waypoints.iter().rposition(|w| w.phase == part)?;
        Some((part, &waypoints[first - 1..=last]))
    };
    parts
        .into_iter()
        .filter_map(of_part)
        .map(|(part, knots)| {
            let (start_s, end_s) = (knots[0].time, knots[knots.len() - 1].time);
            let body = match part {
                Phase::Shift => body_path(robot, start, knots, drive_hold)?,
                _ => {
                    let knot = |w: &Waypoint| JointKnot {
                        joints_rad: convert::by_joint(robot.leg(leg), &w.angles),
                        time_s: w.time - start_s,
                    };
                    let knots = knots.iter().map(knot).collect();
                    CommandBody::JointPath { leg: name.clone(), knots }
                }
            };
            let title = match part {
                Phase::Shift => "Shift the body".into(),
                Phase::Lift => format!("Lift {name}"),
                Phase::Transit => format!("Move {name} over the footfall"),
                Phase::Drop => format!("Put {name} down"),
                Phase::Preload => format!("Press {name} down"),
            };
            let duration_s = end_s - start_s;
            Some(PlanCommand { title, phase: phase(part), body, duration_s })
        })
        .collect::<Option<_>>()
        .unwrap_or_default()
}

/// The shift along these waypoints, which all carry the whole robot but perhaps the first, where it
/// is as in `start`; `None` if another one does not.
fn body_path(
    robot: &Robot,
    start: &Configuration,
    waypoints: &[Waypoint],
    drive_hold: bool,
) -> Option<CommandBody> {
    let start_s = waypoints[0].time;
    let knots = waypoints.iter().enumerate().map(|(i, w)| {
        let stance = w.stance.as_ref().or((i == 0).then_some(start))?;
        let joints_rad = convert::rover_state(robot, stance).joints_rad;
        Some(BodyKnot { joints_rad, time_s: w.time - start_s })
    });
    Some(CommandBody::BodyPath { knots: knots.collect::<Option<_>>()?, drive_hold })
}

/// The way back: what undoes each command, the last one's first, each with its knots and times
/// mirrored. The phase is that of the command that it undoes.
pub(super) fn retreat(leg: &str, commands: &[PlanCommand]) -> Vec<PlanCommand> {
    let back = |command: &PlanCommand| {
        let title = match command.phase {
            PlanPhase::Shift => "Shift the body back".into(),
            PlanPhase::Lift => format!("Put {leg} back"),
            PlanPhase::Transit => format!("Move {leg} back"),
            PlanPhase::Drop => format!("Lift {leg} again"),
            PlanPhase::Preload => format!("Relieve {leg}"),
        };
        let (phase, duration_s) = (command.phase, command.duration_s);
        PlanCommand { title, phase, body: mirrored(&command.body, duration_s), duration_s }
    };
    commands.iter().rev().map(back).collect()
}

/// The same path backward in the same time (s).
fn mirrored(body: &CommandBody, duration_s: f64) -> CommandBody {
    // Rounding must not make the first time negative.
    let mirrored = |time_s: f64| (duration_s - time_s).max(0.0);
    match body {
        CommandBody::JointPath { leg, knots } => {
            let back = |knot: &JointKnot| JointKnot {
                joints_rad: knot.joints_rad.clone(),
                time_s: mirrored(knot.time_s),
            };
            let knots = knots.iter().rev().map(back).collect();
            CommandBody::JointPath { leg: leg.clone(), knots }
        }
        CommandBody::BodyPath { knots, drive_hold } => {
            let back = |knot: &BodyKnot| BodyKnot {
                joints_rad: knot.joints_rad.clone(),
                time_s: mirrored(knot.time_s),
            };
            let knots = knots.iter().rev().map(back).collect();
            CommandBody::BodyPath { knots, drive_hold: *drive_hold }
        }
        // Plans hold no others.
        other => other.clone(),
    }
}

/// Hash of a state: FNV-1a over the bits of its numbers.
pub fn state_hash(configuration: &Configuration) -> String {
    let base = configuration.world_from_base;
    let numbers = base.translation.vector.iter().chain(base.rotation.coords.iter());
    let numbers = numbers.chain(configuration.legs.iter().flat_map(|leg| leg.iter()));
    let hash = numbers.fold(0xcbf2_9ce4_8422_2325_u64, |hash, number| {
        (hash ^ (number + 0.0).to_bits()).wrapping_mul(0x0000_0100_0000_01b3)
    });
    hash_text(hash)
}

/// Stops the planner, tells what it does, and takes the time of each stage.
struct StageClock<'a> {
    stop: &'a Stop,
    progress: OnProgress<'a>,
    stage: Stage,
    since: Instant,
    spent_ms: [f64; 5],
}

impl<'a> StageClock<'a> {
    fn new(stop: &'a Stop, progress: OnProgress<'a>) -> StageClock<'a> {
        let stage = Stage::Footfall;
        StageClock { stop, progress, stage, since: Instant::now(), spent_ms: [0.0; 5] }
    }

    fn times_ms(mut self) -> [f64; 5] {
        self.close();
        self.spent_ms
    }

    fn close(&mut self) {
        self.spent_ms[self.stage as usize] += 1e3 * self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
    }
}

impl Watch for StageClock<'_> {
    fn stopped(&mut self) -> Option<Stopped> {
        self.stop.cause().map(|cause| match cause {
            Cause::Deadline => Stopped::Deadline,
            Cause::Cancelled => Stopped::Cancelled,
        })
    }

    fn entered(&mut self, stage: Stage) {
        self.close();
        self.stage = stage;
        let (share, doing) = match stage {
            Stage::Shift => (0.02, "looks for a shift of the body"),
            Stage::Footfall => (0.05, "looks for ways to put the wheel down"),
            Stage::Search => (0.1, "searches a path"),
            Stage::Smoothing => (0.6, "shortens the path"),
            Stage::Check => (0.8, "checks the whole step again"),
        };
        (self.progress)(share, doing);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};
    use rover::LegAngles;

    use super::*;
    use crate::robots::Robots;

    fn robot() -> Robot {
        let robots = Robots::new(Vec::new());
        robots.load(&At::root("robot"), "athlete").unwrap().as_ref().clone()
    }

    /// A step with every phase: (phase, time in s, is the whole robot given).
    fn step(robot: &Robot) -> (Configuration, Vec<Waypoint>) {
        let start = robot.pose("bent").unwrap();
        let parts = [
            (Phase::Shift, 0.0, false),
            (Phase::Shift, 2.0, true),
            (Phase::Shift, 5.0, true),
            (Phase::Lift, 6.0, false),
            (Phase::Transit, 7.0, false),
            (Phase::Transit, 9.0, false),
            (Phase::Drop, 10.0, false),
            (Phase::Preload, 10.5, false),
        ];
        let waypoint = |(i, (phase, time, whole)): (usize, (Phase, f64, bool))| {
            let mut stance = start.clone();
            stance.world_from_base = Isometry3::translation(0.01 * i as f64, 0.0, 2.0);
            for leg in &mut stance.legs {
                *leg += LegAngles::repeat(0.01 * i as f64);
            }
            let angles = stance.legs[1];
            Waypoint { angles, phase, time, stance: whole.then_some(stance), hold: true }
        };
        let waypoints = parts.into_iter().enumerate().map(waypoint).collect();
        (start, waypoints)
    }

    fn times(body: &CommandBody) -> Vec<f64> {
        match body {
            CommandBody::JointPath { knots, .. } => knots.iter().map(|k| k.time_s).collect(),
            CommandBody::BodyPath { knots, .. } => knots.iter().map(|k| k.time_s).collect(),
            _ => Vec::new(),
        }
    }

    #[test]
    fn a_step_becomes_a_command_for_each_phase_and_the_way_back_mirrors_them() {
        let robot = robot();
        let (start, waypoints) = step(&robot);
        let commands = commands(&robot, LegId(1), &start, &waypoints, false);
        let of = |commands: &[PlanCommand]| -> Vec<(String, Vec<f64>)> {
            commands.iter().map(|c| (c.title.clone(), times(&c.body))).collect()
        };
        let expected = [
            ("Shift the body", vec![0.0, 2.0, 5.0]),
            ("Lift leg2", vec![0.0, 1.0]),
            ("Move leg2 over the footfall", vec![0.0, 1.0, 3.0]),
            ("Put leg2 down", vec![0.0, 1.0]),
            ("Press leg2 down", vec![0.0, 0.5]),
        ];
        assert_eq!(of(&commands), expected.map(|(title, times)| (title.to_owned(), times)));
        let CommandBody::BodyPath { knots, .. } = &commands[0].body else { panic!("no shift") };
        assert_eq!(knots[0].joints_rad, convert::rover_state(&robot, &start).joints_rad);
        assert!(knots.iter().all(|knot| knot.joints_rad.len() == 6));
        // Each begins where the one before ends.
        let CommandBody::JointPath { knots: lift, .. } = &commands[1].body else { panic!() };
        assert_eq!(lift[0].joints_rad, knots[2].joints_rad["leg2"]);

        let back = retreat("leg2", &commands);
        let expected = [
            ("Relieve leg2", vec![0.0, 0.5]),
            ("Lift leg2 again", vec![0.0, 1.0]),
            ("Move leg2 back", vec![0.0, 2.0, 3.0]),
            ("Put leg2 back", vec![0.0, 1.0]),
            ("Shift the body back", vec![0.0, 3.0, 5.0]),
        ];
        assert_eq!(of(&back), expected.map(|(title, times)| (title.to_owned(), times)));
        let CommandBody::BodyPath { knots: shift, .. } = &back[4].body else { panic!("no shift") };
        assert_eq!(shift[0].joints_rad, knots[2].joints_rad);
        assert_eq!(shift[2].joints_rad, knots[0].joints_rad);
        // Back and back again is the way itself.
        for (command, back) in commands.iter().zip(back.iter().rev()) {
            assert_eq!(mirrored(&back.body, back.duration_s), command.body);
            assert_eq!(command.phase, back.phase);
        }
    }

    #[test]
    fn a_step_whose_shift_lacks_its_stances_becomes_no_commands() {
        let robot = robot();
        let (start, mut waypoints) = step(&robot);
        waypoints[1].stance = None;
        assert_eq!(commands(&robot, LegId(1), &start, &waypoints, false), []);
    }

    #[test]
    fn a_waypoint_carries_the_whole_rover_where_it_shifts() {
        let robot = robot();
        let (_, waypoints) = step(&robot);
        let shown = waypoint(&robot, LegId(1), &waypoints[2]);
        let base = shown.stance.unwrap().base;
        assert!((Vector3::from(base.position_m) - Vector3::new(0.02, 0.0, 2.0)).norm() < 1e-12);
        assert_eq!(waypoint(&robot, LegId(1), &waypoints[4]).stance, None);
    }
}
