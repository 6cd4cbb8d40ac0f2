//! Everything but the release, check by check.

use bridge::commands::CommandError;
use bridge::ground::Shown;
use wire::dry_run::{DryRun, DryRunCheck, DryRunCondition, DryRunName, DryRunOutcome, DryRunStep};
use wire::live::{CommandBody, Precondition, RoverMode, RoverTelemetry, SequenceStep};
use wire::precondition::PRECONDITIONS_MAX;
use wire::resources::StageRequest;

use super::operations;
use crate::app::AppState;
use crate::error::ApiError;
use DryRunOutcome::{Failed, NotReached, Passed, Waits};

/// What would come of a request to stage, arm and send a command now, and of its beginning on board.
pub fn dry_run(app: &AppState, who: &str, request: &StageRequest) -> Result<DryRun, ApiError> {
    let latest = app.live.latest()?;
    let command = super::command(app, who, request);
    let content = check(
        DryRunName::Content,
        command.as_ref().map(drop).map_err(|error| {
            let wire::resources::ErrorInfo { code, message, .. } = &error.0;
            (code.clone(), message.clone())
        }),
    );
    let command = command.ok();
    let steps = match &request.body {
        Some(CommandBody::Sequence { steps }) => &steps[..steps.len().min(sim::STEPS_MAX)],
        _ => &[],
    };
    // Steps are foreseen where their values are some: what the rover would refuse is `command_invalid`.
    let usable = content.code.as_deref().is_none_or(|code| code == "command_invalid");
    let foreseen = if usable { foreseen_steps(app, &latest.frame, steps) } else { Vec::new() };
    let (places, wanted) = waited_for(request, steps);
    let (looked, may_arm, shown) = {
        let (ground, now) = app.live.locked();
        let may_arm = command.as_ref().map_or(Ok(()), |command| ground.may_arm(command));
        (ground.look(now, command.as_ref(), who), may_arm, ground.show(now, &wanted))
    };
    let conditions: Vec<DryRunCondition> =
        places.into_iter().zip(wanted).zip(shown).map(condition).collect();
    let known = |name: DryRunName, result: Result<(), CommandError>| {
        check(name, result.map_err(|error| (error.code().into(), error.to_string())))
    };
    let mut checks = vec![
        content,
        known(DryRunName::Log, looked.log),
        known(DryRunName::Estop, looked.estop),
        known(DryRunName::Connection, looked.connection),
        idle(&latest.frame),
        known(DryRunName::Authority, looked.authority),
    ];
    if command.is_some() {
        // What follows in its plan can be staged, and armed later.
        let order = known(DryRunName::Order, looked.order);
        checks.push(match order.outcome {
            Passed => waiting(known(DryRunName::Order, may_arm)),
            _ => order,
        });
    } else {
        checks.push(unreached(DryRunName::Order));
    }
    checks.push(match &command {
        None => unreached(DryRunName::Approval),
        Some(command) if command.two_persons => waiting(check(
            DryRunName::Approval,
            Err(("approval_needed".into(), "a second person approves it once it is staged".into())),
        )),
        Some(_) => check(DryRunName::Approval, Ok(())),
    });
    checks.push(of_conditions(&conditions));
    let ready = checks.iter().all(|check| check.outcome == Passed);
    let title = command.as_ref().map(|command| command.title.clone());
    let duration_s = command.as_ref().map(|command| command.duration_s);
    Ok(DryRun { ready, title, duration_s, checks, steps: foreseen, conditions })
}

/// What a command and its steps wait for, with the step; as many as are taken.
fn waited_for(
    request: &StageRequest,
    steps: &[SequenceStep],
) -> (Vec<Option<usize>>, Vec<Precondition>) {
    let own = request.preconditions.iter().take(PRECONDITIONS_MAX).map(|wanted| (None, wanted));
    let of_steps = steps.iter().enumerate().flat_map(|(i, step)| {
        step.preconditions.iter().take(PRECONDITIONS_MAX).map(move |wanted| (Some(i), wanted))
    });
    own.chain(of_steps).map(|(step, wanted)| (step, wanted.clone())).unzip()
}

fn check(name: DryRunName, result: Result<(), (String, String)>) -> DryRunCheck {
    match result {
        Ok(()) => DryRunCheck { check: name, outcome: Passed, code: None, message: None },
        Err((code, message)) => {
            DryRunCheck { check: name, outcome: Failed, code: Some(code), message: Some(message) }
        }
    }
}

fn unreached(name: DryRunName) -> DryRunCheck {
    DryRunCheck { check: name, outcome: NotReached, code: None, message: None }
}

/// What is only a matter of time.
fn waiting(check: DryRunCheck) -> DryRunCheck {
    let outcome = if check.outcome == Failed { Waits } else { check.outcome };
    DryRunCheck { outcome, ..check }
}

/// Would the rover begin a command, by the last frame?
fn idle(frame: &RoverTelemetry) -> DryRunCheck {
    let refused =
        |message: &str| check(DryRunName::Rover, Err(("rover_busy".into(), message.into())));
    match frame.mode {
        RoverMode::Idle => check(DryRunName::Rover, Ok(())),
        RoverMode::Executing => waiting(refused(
            "the rover executes a command as last reported, and refuses another; wait for its end",
        )),
        RoverMode::Stopped => refused("the rover is stopped; release the E-stop first"),
        RoverMode::Fault => refused("the rover stopped for a fault; a stop release clears it"),
    }
}

fn of_conditions(conditions: &[DryRunCondition]) -> DryRunCheck {
    let first = |outcome| conditions.iter().find(move |c| c.outcome == outcome);
    let mut result = check(DryRunName::Preconditions, Ok(()));
    if let Some(condition) = first(Failed) {
        (result.outcome, result.message) = (Failed, condition.message.clone());
    }
    result
}

fn condition(((step, wanted), shown): ((Option<usize>, Precondition), Shown)) -> DryRunCondition {
    let Shown { found, age_s, holds } = shown;
    let (outcome, message) = match holds {
        // Steps after the first find another rover.
        _ if step.is_some_and(|step| step > 0) => {
            (Waits, Some("asked on board when the step begins".into()))
        }
        Ok(()) => (Passed, None),
        Err(unmet) => (Failed, Some(unmet.to_string())),
    };
    DryRunCondition { step, wanted, found, age_s, outcome, message }
}

/// The steps of a sequence from where the rover was last reported.
fn foreseen_steps(
    app: &AppState,
    frame: &RoverTelemetry,
    steps: &[SequenceStep],
) -> Vec<DryRunStep> {
    if steps.is_empty() {
        return Vec::new();
    }
    let foreseen =
        app.live.configuration().and_then(|now| operations::foreseen(app, frame, &now, steps));
    let (steps_s, why) = foreseen.unwrap_or_else(|error| (Vec::new(), Some(error.0.message)));
    let of_step = |(i, step): (usize, &SequenceStep)| {
        let title = operations::title(&step.body);
        let duration_s = steps_s.get(i).copied();
        let (outcome, message) = match duration_s {
            Some(_) => (Passed, None),
            None if i == steps_s.len() => (Failed, why.clone()),
            None => (NotReached, None),
        };
        DryRunStep { title, outcome, duration_s, message }
    };
    steps.iter().enumerate().map(of_step).collect()
}
