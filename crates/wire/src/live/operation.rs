//! Mode of operation and wheels as telemetry shows them, steps of sequences, and what they wait for.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::CommandBody;
use crate::time::Timestamp;

/// A mode of operation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OperatingMode {
    /// Brakes on; only modes, holds and stops are taken.
    Safe,
    /// Legs and body move over braked wheels.
    #[default]
    Ready,
    /// Wheels may be released, steered, rolled and driven.
    Driving,
}

/// Mode of operation and wheels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Operation {
    /// The mode.
    pub mode: OperatingMode,
    /// The wheels by leg. How far they have spun is in the state (`wheels_rad`).
    pub wheels: BTreeMap<String, WheelTelemetry>,
}

/// A wheel and its drive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelTelemetry {
    /// Is its brake on?
    pub brake: bool,
    /// Spin per second (rad/s), positive ahead along its heading.
    pub spin_rad_s: f64,
    /// Where it heads, counter-clockwise from base x (rad); none for a ball, and for a wheel that lies
    /// on its side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_rad: Option<f64>,
}

/// What the goal of a wheel is given in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GoalFrame {
    /// `world`.
    #[default]
    World,
    /// The base, as it is when the command begins.
    Base,
    /// From where the wheel's center is, along the axes of `world`.
    Offset,
}

/// A step of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SequenceStep {
    /// What to do: any command but a stop, a `cancel_rest` or a sequence.
    #[schema(no_recursion)]
    pub body: CommandBody,
    /// What must hold on board when the step begins: fields of `rover/state`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub preconditions: Vec<Precondition>,
}

/// What a field of telemetry must be before a command begins.
///
/// It is checked when the command is released, by the last message received, and again on board when
/// it begins: a field of `rover/state` by the rover's own state of that instant. What only the ground
/// knows (`rover/stability`) counts on board by the age of the message that it was found in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Precondition {
    /// `rover/state` or `rover/stability`.
    pub channel: String,
    /// Names and indices down to the field, with dots: `operation.wheels.leg1.brake`,
    /// `state.joints_rad.leg1.0`.
    pub field: String,
    /// How it compares.
    pub op: Comparison,
    /// With what: a number, a text, true or false.
    pub value: Value,
    /// Oldest message that it may be found in (s), by its time on board.
    pub max_age_s: f64,
    /// Time on board of the message that it was found in; set by the ground at release.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub observed: Option<Timestamp>,
}

/// How two values compare. Texts and truth values are equal or not; numbers have an order too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Comparison {
    /// Equal.
    Eq,
    /// Not equal.
    Ne,
    /// Less than.
    Lt,
    /// At most.
    Le,
    /// Greater than.
    Gt,
    /// At least.
    Ge,
}
