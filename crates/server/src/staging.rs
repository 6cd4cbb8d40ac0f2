//! From a request to a command that may be staged: of a plan, or by hand.

mod dry_run;
mod operations;
mod preconditions;

use std::collections::BTreeMap;

use bridge::commands::StageCommand;
use nalgebra::{Isometry3, Point3, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use wire::analysis::PlanCommand;
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::live::{BodyKnot, CommandBody, JointKnot, PlanCommandRef};
use wire::resources::StageRequest;

use crate::app::AppState;
use crate::error::ApiError;
use crate::imaging;
use crate::live::hash_text;
use crate::plans::{BASIS_JOINT_RAD, Present, StoredPlan, When};
use crate::reconstruction::contact;

pub use dry_run::dry_run;

/// Most knots of a path by hand.
const KNOTS_MAX: usize = 10_000;
/// ... of a shift of the body, as the rover takes them.
const BODY_KNOTS_MAX: usize = 1000;
/// Latest time of a knot (s): a day.
const TIME_MAX_S: f64 = 86_400.0;

/// The command that a request asks for, checked as far as the ground can.
pub fn command(
    app: &AppState,
    who: &str,
    request: &StageRequest,
) -> Result<StageCommand, ApiError> {
    preconditions::check(&At::root("preconditions"), &request.preconditions, true)?;
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
    match stale(app, &stored, plan, when)? {
        None => Ok(()),
        Some(why) => {
            let message = format!("the plan no longer holds: {why}; plan the step anew");
            Err(ApiError::new("basis_changed", message))
        }
    }
}

/// Why a plan does not hold for a command of it; `None` if it does.
pub fn stale(
    app: &AppState,
    plan: &StoredPlan,
    of: &PlanCommandRef,
    when: When,
) -> Result<Option<String>, ApiError> {
    let latest = app.live.latest()?;
    let robot = app.live.robot();
    let version = app.store.current();
    // What only standing wheels were told to is as good a map for a plan as the one that it was made on.
    let of_plan = &plan.answer.basis.terrain_version;
    let in_use = &version.info.version;
    let terrain_version = if contact::holds_over(app, of_plan, in_use) { of_plan } else { in_use };
    let present = Present {
        robot,
        model_hash: &hash_text(robot.hash()),
        terrain_version,
        frame: &latest.frame,
    };
    Ok(plan.stale(&present, of, when))
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
    let Some(PlanCommand { title, body, duration_s, .. }) = stored.command(plan) else {
        let (n, of) = (stored.answer.commands.len(), if plan.retreat { " back" } else { "" });
        let message = format!("plan.index is {}; the plan has {n} commands{of}", plan.index);
        return Err(ApiError::new("command_index", message));
    };
    let robot = app.live.robot();
    let after = stored.done_before(plan);
    let before = stored.after(robot, after);
    let command = StageCommand {
        id: request.id.clone(),
        operator: who.into(),
        title: title.clone(),
        body: body.clone(),
        plan: Some(plan.clone()),
        after,
        duration_s: *duration_s,
        basis_joints_rad: joints_of(robot, &before),
        basis_tolerance_rad: BASIS_JOINT_RAD,
        model_hash: Some(hash_text(robot.hash())),
        two_persons: app.config.commands.takes_two(body),
        preconditions: request.preconditions.clone(),
    };
    // Out of order the basis cannot hold: the order says more.
    app.live.locked().0.commands().may_stage(&command)?;
    check_basis(app, plan, When::Staging)?;
    Ok(command)
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
    let latest = app.live.latest()?;
    let now = app.live.configuration()?;
    let at = At::root("body");
    if let CommandBody::Image(order) = body {
        return Ok(imaging::command(app, who, request.id.clone(), &at, order)?);
    }
    let (title, duration_s) = match body {
        // Images are not by way of the legs.
        CommandBody::Stop {} | CommandBody::Image(_) => (operations::title(body), 0.0),
        CommandBody::JointPath { leg, knots } => {
            let id = convert::leg(&at.field("leg"), robot, leg)?;
            let path = joint_path(&at.field("knots"), robot, id, &now, knots)?;
            let pieces = pieces(&path, knots.iter().map(|knot| knot.time_s));
            (operations::title(body), duration_s(robot, pieces))
        }
        CommandBody::BodyPath { knots, .. } => {
            let standing = latest.frame.contacts.iter().filter(|(_, stands)| **stands);
            let standing: Vec<&str> = standing.map(|(leg, _)| leg.as_str()).collect();
            let at = at.field("knots");
            let duration_s = body_path(&at, robot, &now, &standing, knots)?;
            (operations::title(body), duration_s)
        }
        CommandBody::WheelLine { leg, position_m } => {
            let id = convert::leg(&at.field("leg"), robot, leg)?;
            let goal = check::position(&at.field("position_m"), *position_m)?;
            let path = wheel_line(&at.field("position_m"), robot, id, &now, goal.into())?;
            let pieces = pieces(&path, path.iter().map(|_| 0.0));
            (operations::title(body), duration_s(robot, pieces))
        }
        other => operations::checked(app, &at, &latest.frame, &now, other)?,
    };
    let is_stop =
        matches!(body, CommandBody::Stop {} | CommandBody::Hold {} | CommandBody::CancelRest {});
    if is_stop && !request.preconditions.is_empty() {
        let text = "go with no command that stops; it is to be taken whatever telemetry shows";
        return Err(RequestError::at("command_invalid", &At::root("preconditions"), text).into());
    }
    Ok(StageCommand {
        id: request.id.clone(),
        operator: who.into(),
        title,
        body: body.clone(),
        plan: None,
        after: 0,
        duration_s,
        basis_joints_rad: if is_stop { BTreeMap::new() } else { joints_of(robot, &now) },
        basis_tolerance_rad: BASIS_JOINT_RAD,
        model_hash: Some(hash_text(robot.hash())),
        two_persons: app.config.commands.takes_two(body),
        preconditions: request.preconditions.clone(),
    })
}

fn joint_path(
    at: &At<'_>,
    robot: &Robot,
    leg: LegId,
    now: &Configuration,
    knots: &[JointKnot],
) -> Result<Vec<LegAngles>, RequestError> {
    knot_count(at, knots.len(), KNOTS_MAX)?;
    let mut path = Vec::with_capacity(knots.len());
    let mut before_s = 0.0;
    for (i, knot) in knots.iter().enumerate() {
        let at = at.index(i);
        path.push(leg_within_limits(&at.field("joints_rad"), robot, leg, &knot.joints_rad)?);
        before_s = check::within(&at.field("time_s"), knot.time_s, [before_s, TIME_MAX_S], " s")?;
    }
    begins_here(at, robot, leg, now, &path[0])?;
    Ok(path)
}

/// Checks a shift of the body; gives how long it takes (s). Whether the wheels stay and the rover
/// stands is left to the rover.
fn body_path(
    at: &At<'_>,
    robot: &Robot,
    now: &Configuration,
    standing: &[&str],
    knots: &[BodyKnot],
) -> Result<f64, RequestError> {
    knot_count(at, knots.len(), BODY_KNOTS_MAX)?;
    let first = &knots[0].joints_rad;
    if let Some(leg) = standing.iter().find(|leg| !first.contains_key(**leg)) {
        let text = format_args!("[0].joints_rad lacks {leg}, which stands; give all legs that do");
        return Err(RequestError::at("command_invalid", at, text));
    }
    let mut pieces_s: Vec<(f64, f64)> = Vec::with_capacity(knots.len());
    let mut before: Option<(f64, Vec<LegAngles>)> = None;
    for (i, knot) in knots.iter().enumerate() {
        let at_knot = at.index(i);
        let (at_joints, at_time) = (at_knot.field("joints_rad"), at_knot.field("time_s"));
        let mut stance = Vec::with_capacity(first.len());
        for (name, joints_rad) in &knot.joints_rad {
            let at_leg = at_joints.field(name);
            let leg = convert::leg(&at_leg, robot, name)?;
            let angles = leg_within_limits(&at_leg, robot, leg, joints_rad)?;
            if i == 0 {
                begins_here(at, robot, leg, now, &angles)?;
            }
            stance.push(angles);
        }
        if !knot.joints_rad.keys().eq(first.keys()) {
            let text = "moves other legs than the first knot; all knots move the same legs";
            return Err(RequestError::at("command_invalid", &at_joints, text));
        }
        let since_s = before.as_ref().map_or(0.0, |(time_s, _)| *time_s);
        let time_s = check::within(&at_time, knot.time_s, [since_s, TIME_MAX_S], " s")?;
        let way = before.iter().flat_map(|(_, from)| from.iter().zip(&stance));
        let way = way.map(|(from, to)| (to - from).amax()).fold(0.0, f64::max);
        pieces_s.push((time_s - since_s, way));
        before = Some((time_s, stance));
    }
    Ok(duration_s(robot, pieces_s.into_iter()))
}

fn knot_count(at: &At<'_>, n_knots: usize, most: usize) -> Result<(), RequestError> {
    check::at_most(at, n_knots, most)?;
    if n_knots < 2 {
        let text = "takes two knots or more, the first one where the leg is";
        return Err(RequestError::at("command_invalid", at, text));
    }
    Ok(())
}

fn leg_within_limits(
    at: &At<'_>,
    robot: &Robot,
    leg: LegId,
    joints_rad: &[f64],
) -> Result<LegAngles, RequestError> {
    let model = robot.leg(leg);
    let angles = convert::leg_angles(at, model, joints_rad)?;
    for (j, q) in angles.iter().enumerate().take(model.n_joints()) {
        let bounds = [model.lower[j] - 1e-9, model.upper[j] + 1e-9];
        check::within(&at.index(j), *q, bounds, " rad, the joint's limits")?;
    }
    Ok(angles)
}

/// Refuses a path of these knots that does not begin where the leg is.
fn begins_here(
    at: &At<'_>,
    robot: &Robot,
    leg: LegId,
    now: &Configuration,
    first: &LegAngles,
) -> Result<(), RequestError> {
    let off = (first - now.legs[leg.0]).amax();
    if off <= BASIS_JOINT_RAD {
        return Ok(());
    }
    let text = format_args!(
        "[0] must be where {} is, as last reported: it is {off:.4} rad away, and at most \
         {BASIS_JOINT_RAD} rad are taken",
        robot.leg(leg).name
    );
    Err(RequestError::at("command_invalid", at, text))
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

/// Of each piece of one leg's path the least time (s) and its length (rad).
fn pieces(
    path: &[LegAngles],
    times_s: impl Iterator<Item = f64> + Clone,
) -> impl Iterator<Item = (f64, f64)> {
    let since_s = std::iter::once(0.0).chain(times_s.clone());
    let least_s = times_s.zip(since_s).map(|(time_s, since_s)| time_s - since_s);
    let way = path.windows(2).map(|pair| (pair[1] - pair[0]).amax());
    least_s.zip(std::iter::once(0.0).chain(way))
}

/// How long pieces take at the robot's joint speed, each no less than its least time (s).
fn duration_s(robot: &Robot, pieces: impl Iterator<Item = (f64, f64)>) -> f64 {
    pieces.map(|(least_s, length)| least_s.max(length / robot.motion().joint_speed)).sum()
}
