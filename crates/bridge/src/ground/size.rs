//! How many bytes a message takes on the link: as a packed form would, 4 bytes a number.
//!
//! Logs and listeners get JSON; a link of some kbit/s would not.

use std::collections::BTreeMap;

use wire::live::{CommandBody, Downlink, ImageDown, ImageUp, RoverTelemetry, Uplink};

/// Sync, addresses, time, sequence, check sum.
const HEADER: usize = 32;
/// An identity.
const ID: usize = 16;
const NUMBER: usize = 4;

pub(super) fn of_uplink(uplink: &Uplink) -> u32 {
    bytes(match uplink {
        Uplink::Command { body, basis_joints_rad, .. } => {
            ID + NUMBER + of_body(body) + of_lists(basis_joints_rad)
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
        CommandBody::Stop {} => 1,
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
}

fn of_lists(lists: &BTreeMap<String, Vec<f64>>) -> usize {
    lists.values().map(|list| 1 + NUMBER * list.len()).sum()
}

fn bytes(content: usize) -> u32 {
    u32::try_from(HEADER + content).unwrap_or(u32::MAX)
}
