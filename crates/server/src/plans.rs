//! Plans of the live rover: kept so that their commands can be staged, and checked against what
//! they rest on before anything is armed or sent. Beside them the adviser's answers about it, whose
//! postures become plans when an operator takes one up.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use rover::{Configuration, LegId, Robot};
use wire::analysis::{
    PlanAnswer, PlanCommand, PlanPosture, PlanStatistics, PostureAccident, PostureAccidentKind,
    PostureAnswer, PostureChange, PostureMotion, PostureOutcome, PosturePlanRequest,
    PostureProposal,
};
use wire::check::{At, RequestError};
use wire::convert;
use wire::live::{CommandBody, PlanCommandRef, RoverTelemetry};

use crate::error::ApiError;

/// Plans kept.
const PLANS_MAX: usize = 200;
/// Answers of the adviser kept.
const POSTURES_MAX: usize = 20;
/// How far times may be apart that are the same (s).
const SAME_TIME_S: f64 = 1e-6;
/// How far a joint may be from where a plan took it to be (rad).
pub const BASIS_JOINT_RAD: f64 = 0.01;
/// How far the base may be from there (m).
const BASIS_BASE_M: f64 = 0.01;
/// How far the base may be turned from there (rad).
const BASIS_BASE_RAD: f64 = 0.01;

/// A plan with what it was made from.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPlan {
    /// The plan.
    pub answer: PlanAnswer,
    /// The state it starts from.
    pub start: Configuration,
}

/// The plans kept.
#[derive(Default)]
pub struct Plans(Mutex<BTreeMap<String, Arc<StoredPlan>>>);

impl Plans {
    /// Keeps a plan under its id; the oldest gives way.
    pub fn put(&self, id: &str, plan: StoredPlan) {
        let mut plans = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        while plans.len() >= PLANS_MAX {
            plans.pop_first();
        }
        plans.insert(id.into(), Arc::new(plan));
    }

    /// A plan by its id.
    pub fn get(&self, id: &str) -> Result<Arc<StoredPlan>, ApiError> {
        let plans = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        plans.get(id).cloned().ok_or_else(|| {
            ApiError::new("plan_unknown", "there is no such plan; only the newest ones are kept")
        })
    }
}

/// The adviser's answers kept.
#[derive(Default)]
pub struct Postures(Mutex<BTreeMap<String, Arc<PostureAnswer>>>);

impl Postures {
    /// Keeps an answer under its id; the oldest gives way.
    pub fn put(&self, id: &str, answer: PostureAnswer) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        while kept.len() >= POSTURES_MAX {
            kept.pop_first();
        }
        kept.insert(id.into(), Arc::new(answer));
    }

    /// An answer by its id.
    pub fn get(&self, id: &str) -> Result<Arc<PostureAnswer>, ApiError> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.get(id).cloned().ok_or_else(|| {
            let message = "there is no such answer of the adviser; only the newest ones are kept";
            ApiError::new("posture_unknown", message)
        })
    }
}

/// What is to be taken up of an answer of the adviser.
#[derive(Debug, Clone, PartialEq)]
pub enum Asked {
    /// A proposal by its index.
    Proposal(usize),
    /// The way back from an accident.
    WayBack(PostureAccident),
}

impl Asked {
    /// Exactly one must be named.
    pub fn new(request: PosturePlanRequest) -> Result<Asked, ApiError> {
        match (request.proposal, request.way_back) {
            (Some(proposal), None) => Ok(Asked::Proposal(proposal)),
            (None, Some(accident)) => Ok(Asked::WayBack(accident)),
            _ => {
                let text = "give one of proposal and way_back";
                let at = At::root("proposal");
                Err(RequestError::at("posture_ambiguous", &at, text).into())
            }
        }
    }
}

/// What the adviser offered, or the way back from an accident that it rehearsed, as a plan: its motion
/// is certified and its findings are those of the final check, as of any plan.
pub fn of_posture(
    robot: &Robot,
    id: &str,
    answer: &PostureAnswer,
    asked: &Asked,
) -> Result<StoredPlan, ApiError> {
    let taken = match asked {
        Asked::Proposal(proposal) => Taken::proposal(answer, *proposal)?,
        Asked::WayBack(accident) => Taken::way_back(answer, accident)?,
    };
    let Taken { motion, reason, posture } = taken;
    let refused = |message: &str| ApiError::new("plan_not_sendable", message);
    let Some(start) = motion.waypoints.first().and_then(|knot| knot.stance.as_ref()) else {
        return Err(refused("nothing has to move for this posture: the rover has it already"));
    };
    if motion.commands.is_empty() || !motion.findings.iter().all(|finding| finding.ok) {
        return Err(refused("the posture did not pass the final check; ask the adviser anew"));
    }
    let start = convert::configuration(&At::root("start"), robot, start)?;
    let answer = PlanAnswer {
        id: Some(id.into()),
        outcome: "found".into(),
        reason: Some(reason),
        leg: motion.leg.clone(),
        target_m: None,
        waypoints: motion.waypoints.clone(),
        commands: motion.commands.clone(),
        findings: motion.findings.clone(),
        statistics: PlanStatistics { certified: true, ..PlanStatistics::default() },
        basis: answer.basis.clone(),
        footfall: None,
        margins: motion.margins_along.clone(),
        constraint: None,
        nearest_m: None,
        retreat: motion.retreat.clone(),
        preload_n: None,
        posture: Some(posture),
    };
    Ok(StoredPlan { answer, start })
}

/// What of the adviser's answer is taken up.
struct Taken<'a> {
    motion: &'a PostureMotion,
    reason: String,
    posture: PlanPosture,
}

impl<'a> Taken<'a> {
    fn proposal(answer: &'a PostureAnswer, proposal: usize) -> Result<Taken<'a>, ApiError> {
        let unknown = |n: usize| {
            let message =
                format!("proposal is {proposal}; {n} postures are offered, counted from 0");
            ApiError::new("proposal_index", message)
        };
        let advice = answer.advice.as_ref().ok_or_else(|| unknown(0))?;
        let offered = advice.offered().nth(proposal);
        let offered = offered.ok_or_else(|| unknown(advice.offered().count()))?;
        let wish_met = advice.outcome == PostureOutcome::Found;
        let leg = advice.leg.clone();
        Ok(Taken {
            motion: &offered.motion,
            reason: in_words(&leg, offered),
            posture: PlanPosture { leg, change: offered.change, wish_met, accident: None },
        })
    }

    fn way_back(
        answer: &'a PostureAnswer,
        accident: &PostureAccident,
    ) -> Result<Taken<'a>, ApiError> {
        let leg = accident.leg.chars().take(64).collect::<String>();
        let legs = answer.rehearsal.iter().flat_map(|rehearsal| &rehearsal.legs);
        let accidents =
            legs.into_iter().find(|accidents| accidents.leg == leg).ok_or_else(|| {
                let message = format!("way_back.leg is {leg:?}, of which nothing was rehearsed");
                ApiError::new("way_back_unknown", message)
            })?;
        let (aftermath, what) = match accident.kind {
            PostureAccidentKind::Lost => (&accidents.lost, format!("{leg} is lost")),
            PostureAccidentKind::Settled => {
                (&accidents.settled, format!("the ground settles under {leg}"))
            }
        };
        let motion = aftermath.way_back.motion.as_ref().ok_or_else(|| {
            let why = match &aftermath.way_back.barrier {
                Some(barrier) => format!("there is none: {}", barrier.detail),
                None => "none is needed: the stance is safe as it is".to_owned(),
            };
            ApiError::new("plan_not_sendable", format!("if {what}, of a way back {why}"))
        })?;
        Ok(Taken {
            motion,
            reason: format!("the way back to a safe stance if {what}"),
            posture: PlanPosture {
                leg,
                change: PostureChange::Chassis,
                wish_met: true,
                accident: Some(accident.kind),
            },
        })
    }
}

/// What moves, and what for.
fn in_words(leg: &str, offered: &PostureProposal) -> String {
    match (offered.change, &offered.replaced_leg) {
        (PostureChange::Chassis, _) => format!("the chassis moves before {leg} is lifted"),
        (PostureChange::Fold, _) => format!("{leg} is lifted and folded, then the chassis moves"),
        (PostureChange::Replace, Some(other)) => {
            format!("{other} is put down elsewhere before {leg} is lifted")
        }
        (PostureChange::Replace, None) => {
            format!("another foot is put down elsewhere before {leg} is lifted")
        }
    }
}

/// What a plan's basis is checked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// A command is staged: the ones before it in its plan may still be under way, so the moving
    /// leg may be anywhere, and after a shift of the body the base and all legs.
    Staging,
    /// It is armed or sent: all must be as planned.
    Release,
}

/// What the world is now, for the check of a basis.
pub struct Present<'a> {
    /// The live robot.
    pub robot: &'a Robot,
    /// Version stamp of the live robot.
    pub model_hash: &'a str,
    /// The map in use, or the one that it differs from by contacts of wheels alone.
    pub terrain_version: &'a str,
    /// The last frame.
    pub frame: &'a RoverTelemetry,
}

impl StoredPlan {
    /// One of its commands, or of its way back.
    pub fn command(&self, of: &PlanCommandRef) -> Option<&PlanCommand> {
        if of.retreat { &self.answer.retreat } else { &self.answer.commands }.get(of.index)
    }

    /// How many of the plan's commands are done when this one begins. It must be there.
    pub fn done_before(&self, of: &PlanCommandRef) -> usize {
        if of.retreat { self.answer.commands.len().saturating_sub(of.index) } else { of.index }
    }

    /// Where base and legs are when so many of the plan's commands are done.
    pub fn after(&self, robot: &Robot, n_done: usize) -> Configuration {
        let mut configuration = self.start.clone();
        let commands = &self.answer.commands;
        let done = || commands.iter().take(n_done);
        for command in done() {
            apply(robot, &command.body, End::Last, &mut configuration);
        }
        // Commands follow each other without a pause, as the knots of the plan do.
        let until_s = done().map(|command| command.duration_s).sum::<f64>() + SAME_TIME_S;
        let knots = self.answer.waypoints.iter().rev();
        let stance = knots.filter(|knot| knot.time_s <= until_s).find_map(|k| k.stance.as_ref());
        let shifted = stance.filter(|_| done().any(is_shift));
        let at = At::root("stance");
        if let Some(base) = shifted.and_then(|state| convert::isometry(&at, &state.base).ok()) {
            configuration.world_from_base = base;
        }
        if let Some(command) = commands.get(n_done) {
            apply(robot, &command.body, End::First, &mut configuration);
        }
        configuration
    }

    /// May the shift of the body be what comes before this command?
    fn shifts_before(&self, of: &PlanCommandRef) -> bool {
        let mut before = self.answer.commands.iter().take(of.index);
        // What is undone is done: a shift is not under way any more.
        !of.retreat && before.any(is_shift)
    }

    /// Why the plan may not be used for this command of it now; `None` if it may.
    pub fn stale(&self, present: &Present<'_>, of: &PlanCommandRef, when: When) -> Option<String> {
        let basis = &self.answer.basis;
        if basis.model_hash != present.model_hash {
            return Some("the robot model or its payload has changed".into());
        }
        if basis.terrain_version != present.terrain_version {
            return Some("the map has a new version".into());
        }
        if when == When::Staging && self.shifts_before(of) {
            return None;
        }
        let at = At::root("state");
        let Ok(now) = convert::configuration(&at, present.robot, &present.frame.state) else {
            return Some("the rover's state cannot be read".into());
        };
        let expected = self.after(present.robot, self.done_before(of));

        let moved = expected.world_from_base.inverse() * now.world_from_base;
        if moved.translation.vector.norm() > BASIS_BASE_M || moved.rotation.angle() > BASIS_BASE_RAD
        {
            return Some("the rover's body has moved".into());
        }
        let legs = present.robot.legs().iter().zip(expected.legs.iter().zip(&now.legs));
        for (leg, (expected, now)) in legs {
            if when == When::Staging && leg.name == self.answer.leg {
                continue;
            }
            let off = (expected - now).amax();
            if off > BASIS_JOINT_RAD {
                return Some(format!(
                    "{} is {off:.3} rad from where the plan takes it to be",
                    leg.name
                ));
            }
        }
        None
    }
}

fn is_shift(command: &PlanCommand) -> bool {
    matches!(command.body, CommandBody::BodyPath { .. })
}

/// Which knot of a path.
#[derive(Clone, Copy)]
enum End {
    First,
    Last,
}

/// Puts the legs that a command moves where one of its knots has them.
fn apply(robot: &Robot, body: &CommandBody, end: End, configuration: &mut Configuration) {
    let mut put = |leg: &str, joints_rad: &[f64]| {
        if let Some(LegId(leg)) = robot.leg_id(leg)
            && joints_rad.len() == configuration.legs[leg].len()
        {
            configuration.legs[leg].copy_from_slice(joints_rad);
        }
    };
    match body {
        CommandBody::JointPath { leg, knots } => {
            if let Some(knot) = end.of(knots) {
                put(leg, &knot.joints_rad);
            }
        }
        CommandBody::BodyPath { knots, .. } => {
            for (leg, joints_rad) in end.of(knots).into_iter().flat_map(|knot| &knot.joints_rad) {
                put(leg, joints_rad);
            }
        }
        // Plans hold no others.
        _ => {}
    }
}

impl End {
    fn of<T>(self, knots: &[T]) -> Option<&T> {
        match self {
            End::First => knots.first(),
            End::Last => knots.last(),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use wire::live::{BodyKnot, JointKnot};

    use super::*;
    use crate::robots::Robots;

    /// A plan of a shift by 0.1 m and 0.1 rad in all joints, and a lift of leg 2 by 0.2 rad more.
    fn plan(robot: &Robot) -> StoredPlan {
        let start = robot.pose("bent").unwrap();
        let mut shifted = start.clone();
        shifted.world_from_base.translation.vector.x += 0.1;
        shifted.legs.iter_mut().for_each(|leg| *leg = leg.add_scalar(0.1));
        let state = |at: &Configuration| convert::rover_state(robot, at);
        let knot = |at: &Configuration| BodyKnot { joints_rad: state(at).joints_rad, time_s: 0.0 };
        let lift = |by: f64| JointKnot {
            joints_rad: shifted.legs[1].add_scalar(by).iter().copied().collect(),
            time_s: 0.0,
        };
        let shift =
            CommandBody::BodyPath { knots: vec![knot(&start), knot(&shifted)], drive_hold: false };
        let path = |knots: Vec<JointKnot>| CommandBody::JointPath { leg: "leg2".into(), knots };
        let (lift, drop) = (path(vec![lift(0.0), lift(0.2)]), path(vec![lift(0.2), lift(0.0)]));
        let command = |phase: &str, body: &CommandBody| json!({ "title": "", "phase": phase, "body": body, "duration_s": 1.0 });
        let waypoint = json!({
            "joints_rad": [], "phase": "shift", "time_s": 1.0, "stance": state(&shifted), "hold": true
        });
        let statistics = wire::analysis::PlanStatistics::default();
        let answer = json!({
            "outcome": "found", "leg": "leg2", "waypoints": [waypoint], "findings": [],
            "commands": [command("shift", &shift), command("lift", &lift), command("drop", &drop)],
            "statistics": statistics, "retreat": [],
            "basis": { "state_hash": "", "terrain_version": "t", "model_hash": "m", "seed": 1,
                       "version": "" }
        });
        StoredPlan { answer: serde_json::from_value(answer).unwrap(), start }
    }

    #[test]
    fn a_command_after_a_shift_begins_with_the_base_shifted_and_all_legs_moved() {
        let robot = Robots::new(Vec::new()).load(&At::root("robot"), "athlete").unwrap();
        let plan = plan(&robot);
        let x = |index| plan.after(&robot, index).world_from_base.translation.vector.x;
        let yaw =
            |index, leg: usize| plan.after(&robot, index).legs[leg][0] - plan.start.legs[leg][0];
        let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-9, "{value}");
        for (index, [base, leg4]) in [(0, [0.0, 0.0]), (1, [0.1, 0.1]), (2, [0.1, 0.1])] {
            near(x(index), base);
            near(yaw(index, 3), leg4);
        }
        near(yaw(1, 1), 0.1);

        let mut frame: RoverTelemetry = serde_json::from_value(json!({
            "state": convert::rover_state(&robot, &plan.start), "contacts": {},
            "contact_points_m": {}, "wheel_forces_n": {}, "joint_torques_nm": {}, "mode": "idle"
        }))
        .unwrap();
        let of = |index, retreat| PlanCommandRef { plan_id: String::new(), index, retreat };
        let stale_of = |frame: &RoverTelemetry, of: PlanCommandRef, when| {
            let (model_hash, terrain_version) = ("m", "t");
            plan.stale(&Present { robot: &robot, model_hash, terrain_version, frame }, &of, when)
        };
        let stale = |frame: &RoverTelemetry, index, when| stale_of(frame, of(index, false), when);
        assert_eq!(stale(&frame, 0, When::Release), None);
        // What follows may be staged, not released, while the shift is under way.
        assert_eq!(stale(&frame, 1, When::Staging), None);
        let moved = stale(&frame, 1, When::Release).unwrap();
        assert_eq!(moved, "the rover's body has moved");
        frame.state = convert::rover_state(&robot, &plan.after(&robot, 1));
        assert_eq!(stale(&frame, 1, When::Release), None);
        assert_eq!(stale(&frame, 0, When::Staging).unwrap(), "the rover's body has moved");

        // The way back begins where the command that it undoes has ended.
        for when in [When::Staging, When::Release] {
            assert_eq!(stale_of(&frame, of(2, true), when), None);
        }
        let lifted = stale_of(&frame, of(1, true), When::Release).unwrap();
        assert_eq!(lifted, "leg2 is 0.200 rad from where the plan takes it to be");
        frame.state = convert::rover_state(&robot, &plan.start);
        let moved = stale_of(&frame, of(2, true), When::Staging).unwrap();
        assert_eq!(moved, "the rover's body has moved");
    }
    #[test]
    fn where_the_body_shifts_twice_each_shift_counts_when_it_is_done() {
        let robot = Robots::new(Vec::new()).load(&At::root("robot"), "athlete").unwrap();
        let mut plan = plan(&robot);
        let mut far = plan.start.clone();
        far.world_from_base.translation.vector.x += 0.3;
        let again = plan.answer.commands[0].clone();
        plan.answer.commands.push(again);
        let mut knot = plan.answer.waypoints[0].clone();
        (knot.time_s, knot.stance) = (4.0, Some(convert::rover_state(&robot, &far)));
        plan.answer.waypoints.push(knot);
        let begin = plan.start.world_from_base.translation.vector.x;
        for (n_done, moved) in [(0, 0.0), (1, 0.1), (2, 0.1), (3, 0.1), (4, 0.3)] {
            let x = plan.after(&robot, n_done).world_from_base.translation.vector.x;
            assert!((x - begin - moved).abs() < 1e-9, "{n_done} done: {x}");
        }
    }

    #[test]
    fn a_posture_that_moves_nothing_or_was_refused_is_no_plan() {
        let robot = Robots::new(Vec::new()).load(&At::root("robot"), "athlete").unwrap();
        let plan = plan(&robot).answer;
        let margins = json!({
            "standing": [], "regular_m": 0.2, "regular_most_m": 1.0, "settlement_m": 0.1,
            "conservative_region": "area", "conservative_m": 0.1, "conservative_most_m": 0.2,
            "torque_ratio": 0.1, "torque_joint": "leg1_knee_pitch"
        });
        let finding = json!({ "check": "clearance", "ok": true, "margin": 0.1, "where": null,
                              "detail": null });
        let proposal = json!({
            "change": "chassis", "replaced_leg": null, "leg": "leg2", "waypoints": plan.waypoints,
            "commands": plan.commands, "retreat": [], "margins": margins, "findings": [finding],
            "end": plan.waypoints[0].stance, "cost": wire::analysis::PostureCost::default()
        });
        let answer = |outcome: &str, proposal: serde_json::Value| -> PostureAnswer {
            let best = json!({
                "posture": proposal, "missing_m": 0.1,
                "barrier": { "name": "search", "missing": null, "unit": "m", "detail": "" }
            });
            let advice = json!({
                "leg": "leg2", "outcome": outcome, "before": margins, "limits": [],
                "proposals": if outcome == "found" { json!([proposal]) } else { json!([]) },
                "best": if outcome == "found" { json!(null) } else { best }, "poses_looked_at": 1
            });
            serde_json::from_value(json!({ "advice": advice, "basis": plan.basis })).unwrap()
        };
        let asked = Asked::Proposal;
        let made = of_posture(&robot, "p", &answer("found", proposal.clone()), &asked(0)).unwrap();
        assert_eq!((made.answer.outcome.as_str(), made.answer.commands.len()), ("found", 3));
        let code = |changed: serde_json::Value, index| {
            let mut proposal = proposal.clone();
            let fields = proposal.as_object_mut().unwrap();
            fields.extend(changed.as_object().unwrap().clone());
            let made = of_posture(&robot, "p", &answer("best", proposal), &asked(index));
            made.map_or_else(|error| error.0.code, |plan| plan.answer.outcome)
        };
        assert_eq!(code(json!({}), 0), "found");
        assert_eq!(code(json!({}), 1), "proposal_index");
        assert_eq!(code(json!({ "waypoints": [] }), 0), "plan_not_sendable");
        assert_eq!(code(json!({ "commands": [] }), 0), "plan_not_sendable");
        let mut failed = finding.clone();
        failed["ok"] = json!(false);
        assert_eq!(code(json!({ "findings": [failed] }), 0), "plan_not_sendable");
    }
}
