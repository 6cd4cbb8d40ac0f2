//! A frame of the simulated rover as telemetry.

use rover::Robot;
use sim::{Frame, Mode, Operating};
use wire::convert;
use wire::live::{Executing, OperatingMode, Operation, RoverMode, RoverTelemetry, WheelTelemetry};

pub(super) fn of_frame(robot: &Robot, frame: Frame) -> RoverTelemetry {
    let mode = match frame.mode {
        Mode::Idle => RoverMode::Idle,
        Mode::Executing => RoverMode::Executing,
        Mode::Stopped => RoverMode::Stopped,
        Mode::Fault => RoverMode::Fault,
    };
    let operating = match frame.operating {
        Operating::Safe => OperatingMode::Safe,
        Operating::Ready => OperatingMode::Ready,
        Operating::Driving => OperatingMode::Driving,
    };
    let mut state = convert::rover_state(robot, &frame.configuration);
    if frame.wheels.iter().any(|wheel| wheel.spin != 0.0) {
        state.wheels_rad = convert::by_leg(robot, |leg| frame.wheels[leg.0].spin);
    }
    let wheel = |leg: rover::LegId| {
        let wheel = &frame.wheels[leg.0];
        WheelTelemetry {
            brake: wheel.brake,
            spin_rad_s: wheel.spin_rate,
            heading_rad: wheel.heading,
        }
    };
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    RoverTelemetry {
        state,
        contacts: convert::by_leg(robot, |leg| frame.contacts[leg.0]),
        contact_points_m: convert::by_leg(robot, |leg| {
            convert::point(&frame.contact_points[leg.0])
        }),
        wheel_forces_n: convert::by_leg(robot, |leg| frame.wheel_forces[leg.0].into()),
        joint_torques_nm: convert::by_leg(robot, |leg| {
            convert::by_joint(robot.leg(leg), &frame.joint_torques[leg.0])
        }),
        mode,
        executing: frame.executing.map(|e| Executing {
            command_id: e.id,
            progress: e.progress,
            step: e.step.map(|step| step.map(count)),
        }),
        fault: frame.fault,
        operation: Some(Operation { mode: operating, wheels: convert::by_leg(robot, wheel) }),
    }
}
