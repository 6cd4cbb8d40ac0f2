//! From a command's body to a motion of the simulated rover.

use std::collections::BTreeMap;
use std::sync::Arc;

use rover::{LegAngles, Robot};
use sim::{
    BodyKnot, DriveArc, Frame, Gate, GoalFrame, JointKnot, Motion, Operating, Step, WheelHold,
};
use wire::live::{self, CommandBody, OperatingMode, Precondition, SequenceStep, channel};
use wire::precondition;
use wire::time::Timestamp;

use super::telemetry::of_frame;

/// Joint angles of a leg (rad; m where a joint slides), or why they are none. A leg that is unknown
/// is for the rover to refuse.
fn angles(robot: &Robot, leg: &str, joints: &[f64]) -> Result<LegAngles, String> {
    let wanted = robot.leg_id(leg).map_or(joints.len(), |leg| robot.leg(leg).n_joints());
    let angles = LegAngles::from_fn(|i, _| joints.get(i).copied().unwrap_or(0.0));
    if joints.len() == wanted && wanted <= angles.len() {
        return Ok(angles);
    }
    let (leg, n): (String, usize) = (leg.chars().take(80).collect(), joints.len());
    Err(format!("{leg} has {n} joint angles; as many as it has joints are wanted: {wanted}"))
}

pub(super) fn angles_by_leg(
    robot: &Robot,
    joints_rad: &BTreeMap<String, Vec<f64>>,
) -> Result<Vec<(String, LegAngles)>, String> {
    let of_leg =
        |(leg, joints): (&String, &Vec<f64>)| Ok((leg.clone(), angles(robot, leg, joints)?));
    joints_rad.iter().map(of_leg).collect()
}

/// The motion that a command's body asks for (`start` is when time on board was zero), or which knot has another number of angles than the
/// leg has joints.
pub fn of_body(robot: &Robot, body: &CommandBody, start: Timestamp) -> Result<Motion, String> {
    let at = |knot: usize| move |why: String| format!("knot {knot}: {why}");
    Ok(match body {
        CommandBody::JointPath { leg, knots } => {
            let knot = |(i, knot): (usize, &live::JointKnot)| {
                let angles = angles(robot, leg, &knot.joints_rad).map_err(at(i))?;
                Ok::<_, String>(JointKnot { angles, time_s: knot.time_s })
            };
            let knots = knots.iter().enumerate().map(knot).collect::<Result<_, _>>()?;
            Motion::JointPath { leg: leg.clone(), knots }
        }
        CommandBody::BodyPath { knots, drive_hold } => {
            let knot = |(i, knot): (usize, &live::BodyKnot)| {
                let legs = angles_by_leg(robot, &knot.joints_rad).map_err(at(i))?;
                Ok::<_, String>(BodyKnot { legs, time_s: knot.time_s })
            };
            let knots = knots.iter().enumerate().map(knot).collect::<Result<_, _>>()?;
            let hold = if *drive_hold { WheelHold::Drives } else { WheelHold::Brakes };
            Motion::BodyPath { knots, hold }
        }
        CommandBody::WheelLine { leg, position_m } => {
            Motion::WheelLine { leg: leg.clone(), center: (*position_m).into() }
        }
        CommandBody::JointMove { joints_rad, speed_rad_s } => Motion::JointMove {
            joints: joints_rad.iter().map(|(joint, goal)| (joint.clone(), *goal)).collect(),
            speed: *speed_rad_s,
        },
        CommandBody::WheelMove { leg, frame, position_m, rotation_rad, speed_m_s } => {
            Motion::WheelMove {
                leg: leg.clone(),
                frame: match frame {
                    live::GoalFrame::World => GoalFrame::World,
                    live::GoalFrame::Base => GoalFrame::Base,
                    live::GoalFrame::Offset => GoalFrame::Offset,
                },
                position: (*position_m).into(),
                rotation: (*rotation_rad).into(),
                speed: *speed_m_s,
            }
        }
        CommandBody::BodyMove { translation_m, rotation_rad, speed_m_s } => Motion::BodyMove {
            translation: (*translation_m).into(),
            rotation: (*rotation_rad).into(),
            speed: *speed_m_s,
        },
        CommandBody::WheelBrake { legs, on } => Motion::WheelBrake { legs: legs.clone(), on: *on },
        CommandBody::WheelRoll { leg, angle_rad, speed_rad_s } => {
            Motion::WheelRoll { leg: leg.clone(), angle: *angle_rad, speed: *speed_rad_s }
        }
        CommandBody::WheelSteer { headings_rad } => Motion::WheelSteer {
            headings: headings_rad.iter().map(|(leg, heading)| (leg.clone(), *heading)).collect(),
        },
        CommandBody::DriveArc { distance_m, turn_rad, course_rad, speed_m_s } => {
            Motion::DriveArc(DriveArc {
                distance: *distance_m,
                turn: *turn_rad,
                course: *course_rad,
                speed: *speed_m_s,
            })
        }
        CommandBody::Hold {} => Motion::Hold,
        CommandBody::Mode { mode } => Motion::Mode(match mode {
            OperatingMode::Safe => Operating::Safe,
            OperatingMode::Ready => Operating::Ready,
            OperatingMode::Driving => Operating::Driving,
        }),
        CommandBody::CancelRest {} => Motion::CancelRest,
        CommandBody::Sequence { steps } => Motion::Sequence(
            steps.iter().map(|step| of_step(robot, step, start)).collect::<Result<_, _>>()?,
        ),
        CommandBody::Stop {} => Motion::Stop,
        CommandBody::Image(_) => return Err("images are no motion".into()),
    })
}

fn of_step(robot: &Robot, step: &SequenceStep, start: Timestamp) -> Result<Step, String> {
    if matches!(step.body, CommandBody::Sequence { .. }) {
        return Err("a sequence is no step of a sequence".into());
    }
    Ok(Step {
        motion: of_body(robot, &step.body, start)?,
        gate: gate(robot, &step.preconditions, start),
    })
}

/// The motion, not to be begun unless these hold: asked when the rover has taken note of the command,
/// so that a copy of what was refused is not carried out later. `start` is when time on board was zero.
pub(super) fn waiting(
    robot: &Robot,
    motion: Motion,
    preconditions: &[Precondition],
    start: Timestamp,
) -> Result<Motion, String> {
    let Some(gate) = gate(robot, preconditions, start) else { return Ok(motion) };
    let mut steps = match motion {
        Motion::Sequence(steps) => steps,
        Motion::Stop | Motion::Hold | Motion::CancelRest => {
            return Err("a command that stops takes no preconditions".into());
        }
        motion => vec![Step { motion, gate: None }],
    };
    if let Some(first) = steps.first_mut() {
        first.gate = Some(match first.gate.take() {
            None => gate,
            Some(own) => Gate(Arc::new(move |frame: &Frame| {
                gate.0(frame)?;
                own.0(frame)
            })),
        });
    }
    Ok(Motion::Sequence(steps))
}

/// Asks the rover's own state of an instant; of what only the ground knows, its age.
pub(super) fn gate(
    robot: &Robot,
    preconditions: &[Precondition],
    start: Timestamp,
) -> Option<Gate> {
    if preconditions.is_empty() {
        return None;
    }
    let (robot, wanted) = (robot.clone(), preconditions.to_vec());
    Some(Gate(Arc::new(move |frame: &Frame| {
        let now = start.plus_seconds(frame.time_s);
        let state = serde_json::to_value(of_frame(&robot, frame.clone())).ok();
        for wanted in &wanted {
            if wanted.channel == channel::ROVER_STATE {
                precondition::met(wanted, state.as_ref(), now, now)
            } else {
                precondition::fresh(wanted, wanted.observed.unwrap_or(Timestamp(0)), now)
            }
            .map_err(|unmet| unmet.to_string())?;
        }
        Ok(())
    })))
}
