//! How many bytes a message takes on the link: as a packed form would, 4 bytes a number.
//!
//! Logs and listeners get JSON; a link of some kbit/s would not.

use std::collections::BTreeMap;

use wire::live::{
    CommandBody, Downlink, ImageDown, ImageUp, Precondition, RoverTelemetry, SequenceStep, Uplink,
};

/// Sync, addresses, time, sequence, check sum.
const HEADER: usize = 32;
/// An identity.
const ID: usize = 16;
const NUMBER: usize = 4;

pub(super) fn of_uplink(uplink: &Uplink) -> u32 {
    bytes(match uplink {
        Uplink::Command { body, basis_joints_rad, preconditions, .. } => {
            ID + NUMBER
                + of_body(body)
                + of_lists(basis_joints_rad)
                + of_preconditions(preconditions)
        }
        Uplink::Heartbeat {} => 0,
        Uplink::Image(ImageUp::LetGo { .. }) => ID,
        Uplink::Image(ImageUp::Repeat { missing, .. }) => {
            ID + missing.iter().map(|parts| NUMBER + 2 * NUMBER * parts.pieces.len()).sum::<usize>()
        }
        Uplink::Estop { .. } | Uplink::EstopRelease { .. } => ID,
    })
}

pub(super) fn of_downlink(downlink: &Downlink) -> u32 {
    bytes(match downlink {
        Downlink::Telemetry(frame) => of_frame(frame),
        Downlink::Ack { detail, .. } => ID + 1 + detail.as_ref().map_or(0, String::len),
        Downlink::Image(part) => of_image(part),
    })
}

fn of_body(body: &CommandBody) -> usize {
    match body {
        CommandBody::JointPath { knots, .. } => {
            1 + knots.iter().map(|knot| NUMBER * (1 + knot.joints_rad.len())).sum::<usize>()
        }
        CommandBody::BodyPath { knots, .. } => {
            1 + knots.iter().map(|knot| NUMBER + of_lists(&knot.joints_rad)).sum::<usize>()
        }
        CommandBody::WheelLine { .. } => 1 + 3 * NUMBER,
        CommandBody::JointMove { joints_rad, .. } => 1 + NUMBER + joints_rad.len() * (2 + NUMBER),
        CommandBody::WheelMove { .. } => 2 + 7 * NUMBER,
        CommandBody::BodyMove { .. } => 1 + 7 * NUMBER,
        CommandBody::WheelBrake { legs, .. } => 2 + legs.len(),
        CommandBody::WheelRoll { .. } => 2 + 2 * NUMBER,
        CommandBody::WheelSteer { headings_rad } => 1 + headings_rad.len() * (1 + NUMBER),
        CommandBody::DriveArc { .. } => 1 + 4 * NUMBER,
        CommandBody::Sequence { steps } => {
            let of_step =
                |step: &SequenceStep| of_body(&step.body) + of_preconditions(&step.preconditions);
            1 + steps.iter().map(of_step).sum::<usize>()
        }
        CommandBody::Mode { .. } => 2,
        CommandBody::Hold {} | CommandBody::CancelRest {} | CommandBody::Stop {} => 1,
        CommandBody::Image(order) => {
            1 + 6 * NUMBER + NUMBER * (order.pairs.len() + 2 * order.scales.len())
        }
    }
}

/// An image is named by its capture and a number.
fn of_image(part: &ImageDown) -> usize {
    let name = ID + NUMBER;
    match part {
        ImageDown::Head(head) => {
            // Time, pose, size, bytes, hash.
            let state = &head.state;
            name + 14 * NUMBER + 32 + of_lists(&state.joints_rad) + NUMBER * state.wheels_rad.len()
        }
        ImageDown::Piece { data, .. } => name + NUMBER + data.0.len(),
        ImageDown::End { failed, .. } => {
            ID + failed.iter().map(|pair| NUMBER + pair.why.len()).sum::<usize>()
        }
        ImageDown::Gone { .. } => ID,
    }
}

/// Channel, field, comparison, value, age, time.
fn of_preconditions(preconditions: &[Precondition]) -> usize {
    preconditions.iter().map(|p| 2 + p.field.len() + 5 * NUMBER).sum()
}

/// Pose, joints, contacts, points, forces, torques, mode and progress.
fn of_frame(frame: &RoverTelemetry) -> usize {
    let points = frame.contact_points_m.len() + frame.wheel_forces_n.len();
    let fault = frame.fault.as_ref().map_or(0, String::len);
    7 * NUMBER
        + of_lists(&frame.state.joints_rad)
        + NUMBER * frame.state.wheels_rad.len()
        + 1
        + 3 * NUMBER * points
        + of_lists(&frame.joint_torques_nm)
        + 1
        + frame.executing.as_ref().map_or(0, |_| ID + NUMBER)
        + fault
        + frame.operation.as_ref().map_or(0, |o| 1 + o.wheels.len() * (1 + 2 * NUMBER))
}

fn of_lists(lists: &BTreeMap<String, Vec<f64>>) -> usize {
    lists.values().map(|list| 1 + NUMBER * list.len()).sum()
}

fn bytes(content: usize) -> u32 {
    u32::try_from(HEADER + content).unwrap_or(u32::MAX)
}
