//! What stands in the way of a command: every check of staging, arming and sending, and no release.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::live::Precondition;

/// Answer of `POST /commands/checks`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DryRun {
    /// Could it be staged, armed and sent now, and would the rover begin it?
    pub ready: bool,
    /// The command in words; absent where its content is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// How long it would take (s); absent where its content is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<f64>,
    /// The checks, in the order in which they are made.
    pub checks: Vec<DryRunCheck>,
    /// Of a sequence its steps, as the ground foresees them: each from where the one before ends.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<DryRunStep>,
    /// What the command and its steps wait for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub conditions: Vec<DryRunCondition>,
}

/// A check and what came of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DryRunCheck {
    /// What was looked at.
    pub check: DryRunName,
    /// What came of it.
    pub outcome: DryRunOutcome,
    /// The code that staging, arming or sending would answer with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// Why, and the way out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

/// What a check looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DryRunName {
    /// Values, limits, the plan's basis, and what the rover would refuse at once.
    Content,
    /// Can the flight log be written?
    Log,
    /// Is there no E-stop?
    Estop,
    /// Is there a connection to the rover?
    Connection,
    /// Is the rover idle, so that it would begin?
    Rover,
    /// Has the operator the authority, or could it be acquired by arming?
    Authority,
    /// Its place in its plan, and no other armed command.
    Order,
    /// The second person's word.
    Approval,
    /// What the command waits for, by the last telemetry.
    Preconditions,
}

/// What came of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DryRunOutcome {
    /// Nothing in the way.
    Passed,
    /// It can be staged, and has to wait for something before it is armed, sent or begun.
    Waits,
    /// Refused.
    Failed,
    /// Not looked at: something before it failed.
    NotReached,
}

/// A step of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DryRunStep {
    /// In words.
    pub title: String,
    /// Would the rover begin it?
    pub outcome: DryRunOutcome,
    /// How long it takes (s), where it would be begun.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<f64>,
    /// Why not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

/// A precondition with what telemetry shows now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DryRunCondition {
    /// The step that waits for it, from 0; the command itself where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<usize>,
    /// What is waited for.
    pub wanted: Precondition,
    /// The field's value in the last message received; absent where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub found: Option<Value>,
    /// Age of that message by its time on board (s).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_s: Option<f64>,
    /// Does it hold? Those of later steps wait: they are asked on board when the step begins.
    pub outcome: DryRunOutcome,
    /// Why not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}
