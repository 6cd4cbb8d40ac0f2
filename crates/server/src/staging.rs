//! From a request to a command that may be staged: of a plan, or by hand.

use std::collections::BTreeMap;

use bridge::commands::StageCommand;
use nalgebra::{Isometry3, Point3, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use wire::analysis::PlanCommand;
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::live::{CommandBody, JointKnot, PlanCommandRef};
use wire::resources::StageRequest;

use crate::app::AppState;
use crate::error::ApiError;
use crate::live::hash_text;
use crate::plans::{BASIS_JOINT_RAD, Present, StoredPlan, When};

/// Most knots of a path by hand.
const KNOTS_MAX: usize = 10_000;

/// The command that a request asks for, checked as far as the ground can.
pub fn command(
    app: &AppState,
    who: &str,
    request: &StageRequest,
) -> Result<StageCommand, ApiError> {
    match (&request.plan, &request.body) {
        (Some(plan), None) => of_plan(app, who, request, plan),
        (None, Some(body)) => by_hand(app, who, request, body),
        _ => {
            let message = "the request takes exactly one of plan and body";
            Err(ApiError::new("target_ambiguous", message))
        }
    }
}

/// An error if the plan of a command no longer holds; commands by hand have none.
pub fn check_basis(app: &AppState, plan: &PlanCommandRef, when: When) -> Result<(), ApiError> {
    let stored = app.plans.get(&plan.plan_id)?;
    match stale(app, &stored, plan.index, when)? {
        None => Ok(()),
        Some(why) => {
            let message = format!("the plan no longer holds: {why}; plan the step anew");
            Err(ApiError::new("basis_changed", message))
        }
    }
}

fn stale(
    app: &AppState,
    plan: &StoredPlan,
    index: usize,
    when: When,
) -> Result<Option<String>, ApiError> {
    let latest = app.live.latest()?;
    let robot = app.live.robot();
    let version = app.store.current();
    let present = Present {
        robot,
        model_hash: &hash_text(robot.hash()),
        terrain_version: &version.info.version,
        frame: &latest.frame,
    };
    Ok(plan.stale(&present, index, when))
}

fn of_plan(
    app: &AppState,
    who: &str,
    request: &StageRequest,
    plan: &PlanCommandRef,
) -> Result<StageCommand, ApiError> {
    let stored = app.plans.get(&plan.plan_id)?;
    if stored.answer.outcome != "found" || stored.answer.commands.is_empty() {
        let message = format!(
            "the plan is not one to send: its outcome is {}; plan a step that is found",
            stored.answer.outcome
        );
        return Err(ApiError::new("plan_not_sendable", message));
    }
    let n_commands = stored.answer.commands.len();
    let Some(PlanCommand { title, body, duration_s, .. }) = stored.answer.commands.get(plan.index)
    else {
        let message = format!("plan.index is {}; the plan has {n_commands} commands", plan.index);
        return Err(ApiError::new("command_index", message));
    };
    check_basis(app, plan, When::Staging)?;
    let robot = app.live.robot();
    let before = stored.joints_before(robot, plan.index);
    Ok(StageCommand {
        id: request.id.clone(),
        operator: who.into(),
        title: title.clone(),
        body: body.clone(),
        plan: Some(plan.clone()),
        duration_s: *duration_s,
        basis_joints_rad: joints_of(robot, &before),
        basis_tolerance_rad: BASIS_JOINT_RAD,
    })
}

fn joints_of(robot: &Robot, configuration: &Configuration) -> BTreeMap<String, Vec<f64>> {
    convert::by_leg(robot, |leg| convert::by_joint(robot.leg(leg), &configuration.legs[leg.0]))
}

/// A command by hand: limits and reach are checked, collisions are left to the rover's own guard.
fn by_hand(
    app: &AppState,
    who: &str,
    request: &StageRequest,
    body: &CommandBody,
) -> Result<StageCommand, ApiError> {
    let robot = app.live.robot();
    let now = app.live.configuration()?;
    let at = At::root("body");
    let (title, duration_s) = match body {
        CommandBody::Stop {} => ("Stop".to_owned(), 0.0),
        CommandBody::JointPath { leg, knots } => {
            let id = convert::leg(&at.field("leg"), robot, leg)?;
            let path = joint_path(&at.field("knots"), robot, id, &now, knots)?;
            (format!("Move {leg} through {} knots", knots.len()), duration_s(robot, &path))
        }
        CommandBody::WheelLine { leg, position_m } => {
            let id = convert::leg(&at.field("leg"), robot, leg)?;
            let goal = check::position(&at.field("position_m"), *position_m)?;
            let path = wheel_line(&at.field("position_m"), robot, id, &now, goal.into())?;
            (format!("Move the wheel of {leg} straight"), duration_s(robot, &path))
        }
    };
    let is_stop = matches!(body, CommandBody::Stop {});
    Ok(StageCommand {
        id: request.id.clone(),
        operator: who.into(),
        title,
        body: body.clone(),
        plan: None,
        duration_s,
        basis_joints_rad: if is_stop { BTreeMap::new() } else { joints_of(robot, &now) },
        basis_tolerance_rad: BASIS_JOINT_RAD,
    })
}

fn joint_path(
    at: &At<'_>,
    robot: &Robot,
    leg: LegId,
    now: &Configuration,
    knots: &[JointKnot],
) -> Result<Vec<LegAngles>, RequestError> {
    check::at_most(at, knots.len(), KNOTS_MAX)?;
    if knots.len() < 2 {
        let text = "takes two knots or more, the first one where the leg is";
        return Err(RequestError::at("command_invalid", at, text));
    }
    let model = robot.leg(leg);
    let mut path = Vec::with_capacity(knots.len());
    let mut before_s = 0.0;
    for (i, knot) in knots.iter().enumerate() {
        let at = at.index(i);
        let (at_joints, at_time) = (at.field("joints_rad"), at.field("time_s"));
        let angles = convert::leg_angles(&at_joints, model, &knot.joints_rad)?;
        for (j, q) in angles.iter().enumerate().take(model.n_joints()) {
            let bounds = [model.lower[j] - 1e-9, model.upper[j] + 1e-9];
            check::within(&at_joints.index(j), *q, bounds, " rad, the joint's limits")?;
        }
        before_s = check::within(&at_time, knot.time_s, [before_s, 86_400.0], " s")?;
        path.push(angles);
    }
    if (path[0] - now.legs[leg.0]).amax() > BASIS_JOINT_RAD {
        let text = format_args!("[0] must be where {} is, as last reported", model.name);
        return Err(RequestError::at("command_invalid", at, text));
    }
    Ok(path)
}

fn wheel_line(
    at: &At<'_>,
    robot: &Robot,
    leg: LegId,
    now: &Configuration,
    goal: Point3<f64>,
) -> Result<Vec<LegAngles>, RequestError> {
    let posture = Posture::new(robot, now);
    let wheel = posture.wheel(robot, leg).world_from_wheel;
    let goal = Isometry3::from_parts(Vector3::from(goal.coords).into(), wheel.rotation);
    motion::line::wheel_line(robot, &posture, leg, &now.legs[leg.0], &goal).map_err(|error| {
        let motion::line::LineError::OutOfReach { share, distance } = error;
        let text = format_args!(
            "cannot be reached on a straight line: after {:.0} % of the way the leg is at its \
             limits or {distance:.3} m short",
            100.0 * share
        );
        RequestError::at("command_invalid", at, text)
    })
}

/// How long a path takes at the robot's joint speed (s).
fn duration_s(robot: &Robot, path: &[LegAngles]) -> f64 {
    path.windows(2).map(|pair| (pair[1] - pair[0]).amax()).sum::<f64>() / robot.motion().joint_speed
}
