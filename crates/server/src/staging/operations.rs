//! Operations by hand, checked as the rover would: on the ground's own map, from where the rover was
//! last reported.

use bridge::sim_adapter::motion_of;
use rover::Configuration;
use sim::{Operating, PreviewError, SimRover};
use wire::check::{self, At, RequestError};
use wire::live::{CommandBody, OperatingMode, RoverTelemetry, SequenceStep};

use super::preconditions;
use crate::app::AppState;
use crate::error::ApiError;
use crate::unknown_ground::covered;

/// Most joints, wheels or legs that one command may name.
const NAMES_MAX: usize = 100;

/// Title and duration (s) of a command that the rover would begin; else why it would not.
pub(super) fn checked(
    app: &AppState,
    at: &At<'_>,
    frame: &RoverTelemetry,
    now: &Configuration,
    body: &CommandBody,
) -> Result<(String, f64), ApiError> {
    let robot = app.live.robot();
    values(at, body)?;
    let at_steps = at.field("steps");
    if let CommandBody::Sequence { steps } = body {
        for (i, step) in steps.iter().enumerate() {
            check_step(&at_steps.index(i), step)?;
        }
    }
    if matches!(body, CommandBody::Hold {} | CommandBody::CancelRest {}) {
        return Ok((title(body), 0.0));
    }
    let refused = |at: &At<'_>, why: &str| RequestError::at("command_invalid", at, why);
    let motion = motion_of(robot, body, app.clock.now()).map_err(|why| refused(at, &why))?;
    let rover = rover_as(app, frame, now)?;
    let preview = rover.preview(&motion).map_err(|PreviewError { step, refusal }| {
        let why = format!("would be refused on board: {refusal}");
        match step {
            Some(step) => refused(&at_steps.index(step), &why),
            None => refused(at, &why),
        }
    })?;
    Ok((title(body), preview.duration_s))
}

/// The steps of a sequence as they are foreseen: how long each takes (s), up to the first that the rover
/// would not begin, and why.
pub(super) fn foreseen(
    app: &AppState,
    frame: &RoverTelemetry,
    now: &Configuration,
    steps: &[SequenceStep],
) -> Result<(Vec<f64>, Option<String>), ApiError> {
    let rover = rover_as(app, frame, now)?;
    let durations_of = |steps: &[SequenceStep]| {
        let body = CommandBody::Sequence { steps: steps.to_vec() };
        let motion =
            motion_of(app.live.robot(), &body, app.clock.now()).map_err(|why| (None, why))?;
        let preview = rover.preview(&motion);
        preview.map(|p| p.steps_s).map_err(|error| (error.step, error.refusal.to_string()))
    };
    Ok(match durations_of(steps) {
        Ok(steps_s) => (steps_s, None),
        // The steps before the one that is refused are foreseen by themselves.
        Err((step, why)) => match step.unwrap_or(0) {
            0 => (Vec::new(), Some(why)),
            n => (durations_of(&steps[..n]).unwrap_or_default(), Some(why)),
        },
    })
}

/// The rover as last reported, on the ground's map.
fn rover_as(
    app: &AppState,
    frame: &RoverTelemetry,
    now: &Configuration,
) -> Result<SimRover, ApiError> {
    let robot = app.live.robot();
    let version = app.store.current();
    let scene = collision::Scene::new(robot.clone(), version.map.clone(), &[])
        .map_err(|error| ApiError::new("internal", error.to_string()))?;
    let cover = version.cover(&app.config.unknown_ground.limits()).cloned();
    let scene = covered(scene, cover, now);
    let rover = SimRover::new(scene, now.clone(), app.live.gravity()).map_err(|error| {
        let message = format!(
            "the command cannot be checked: on the map in use, as last reported, {error}; \
             reconstruct the ground about the rover"
        );
        ApiError::new("command_invalid", message)
    })?;
    let Some(operation) = &frame.operation else { return Ok(rover) };
    let operating = match operation.mode {
        OperatingMode::Safe => Operating::Safe,
        OperatingMode::Ready => Operating::Ready,
        OperatingMode::Driving => Operating::Driving,
    };
    let wheel = |leg: &rover::Leg| {
        let brake = operation.wheels.get(&leg.name).is_none_or(|wheel| wheel.brake);
        (brake, frame.state.wheels_rad.get(&leg.name).copied().unwrap_or(0.0))
    };
    let wheels: Vec<(bool, f64)> = robot.legs().iter().map(wheel).collect();
    Ok(rover.with_wheels(operating, &wheels))
}

fn check_step(at: &At<'_>, step: &SequenceStep) -> Result<(), RequestError> {
    let body = at.field("body");
    if matches!(step.body, CommandBody::Sequence { .. }) {
        let text = "is a sequence, which is no step of a sequence";
        return Err(RequestError::at("command_invalid", &body, text));
    }
    preconditions::check(&at.field("preconditions"), &step.preconditions, false)?;
    values(&body, &step.body)
}

/// Refuses numbers that are none, and lists without end, by the field's name.
fn values(at: &At<'_>, body: &CommandBody) -> Result<(), RequestError> {
    let finite = |name: &str, value: f64| check::finite(&at.field(name), value).map(drop);
    let all = |name: &str, values: &[f64]| {
        let at = at.field(name);
        values.iter().enumerate().try_for_each(|(i, v)| check::finite(&at.index(i), *v).map(drop))
    };
    let named = |name: &str, n: usize| check::at_most(&at.field(name), n, NAMES_MAX);
    match body {
        CommandBody::JointMove { joints_rad, .. } => {
            named("joints_rad", joints_rad.len())?;
            let at = at.field("joints_rad");
            joints_rad
                .iter()
                .try_for_each(|(joint, q)| check::finite(&at.field(joint), *q).map(drop))
        }
        CommandBody::WheelMove { position_m, rotation_rad, .. } => {
            check::position(&at.field("position_m"), *position_m)?;
            all("rotation_rad", rotation_rad)
        }
        CommandBody::BodyMove { translation_m, rotation_rad, .. } => {
            check::position(&at.field("translation_m"), *translation_m)?;
            all("rotation_rad", rotation_rad)
        }
        CommandBody::WheelBrake { legs, .. } => named("legs", legs.len()),
        CommandBody::WheelSteer { headings_rad } => named("headings_rad", headings_rad.len()),
        CommandBody::WheelRoll { angle_rad, .. } => finite("angle_rad", *angle_rad),
        CommandBody::DriveArc { distance_m, turn_rad, course_rad, .. } => {
            finite("distance_m", *distance_m)?;
            finite("turn_rad", *turn_rad)?;
            finite("course_rad", *course_rad)
        }
        CommandBody::Sequence { steps } => {
            check::at_most(&at.field("steps"), steps.len(), sim::STEPS_MAX)
        }
        _ => Ok(()),
    }
}

/// A command in words.
pub(super) fn title(body: &CommandBody) -> String {
    let degrees = |angle: f64| format!("{:.0}°", angle.to_degrees());
    match body {
        CommandBody::JointMove { joints_rad, .. } => match joints_rad.iter().next() {
            Some((joint, goal)) if joints_rad.len() == 1 => {
                format!("Move {joint} to {}", degrees(*goal))
            }
            _ => format!("Move {} joints", joints_rad.len()),
        },
        CommandBody::WheelMove { leg, .. } => format!("Move the wheel of {leg}"),
        CommandBody::WheelLine { leg, .. } => format!("Move the wheel of {leg} straight"),
        CommandBody::JointPath { leg, knots } => {
            format!("Move {leg} through {} knots", knots.len())
        }
        CommandBody::BodyPath { knots, .. } => {
            format!("Shift the body through {} knots", knots.len())
        }
        CommandBody::Image(_) => "Take images".into(),
        CommandBody::Stop {} => "Stop".into(),
        CommandBody::BodyMove { .. } => "Move the body".into(),
        CommandBody::WheelBrake { legs, on } => {
            let of = if legs.is_empty() { "all wheels".into() } else { legs.join(", ") };
            format!("{} the brakes of {of}", if *on { "Put on" } else { "Release" })
        }
        CommandBody::WheelRoll { leg, angle_rad, .. } => {
            format!("Roll the wheel of {leg} by {}", degrees(*angle_rad))
        }
        CommandBody::WheelSteer { headings_rad } => {
            format!("Steer {} wheels", headings_rad.len())
        }
        CommandBody::DriveArc { distance_m, turn_rad, .. } => {
            format!("Drive {distance_m:.2} m, turning by {}", degrees(*turn_rad))
        }
        CommandBody::Hold {} => "Hold".into(),
        CommandBody::Mode { mode } => {
            let mode = match mode {
                OperatingMode::Safe => "safe",
                OperatingMode::Ready => "ready",
                OperatingMode::Driving => "driving",
            };
            format!("Take mode {mode}")
        }
        CommandBody::Sequence { steps } => format!("Sequence of {} steps", steps.len()),
        CommandBody::CancelRest {} => "Cancel the rest of the sequence".into(),
    }
}
