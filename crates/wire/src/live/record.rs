//! Commands as the ground knows them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Approval, CommandBody, Precondition, Verification, is_false};
use crate::time::Timestamp;

/// The state of a command, as shown to people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CommandState {
    /// Checked and waiting for the operator.
    Staged,
    /// May be sent until `armed_until`.
    Armed,
    /// Handed to the link.
    Sent,
    /// The rover has it.
    Received,
    /// The rover moves.
    Executing,
    /// Done as commanded.
    Done,
    /// Refused by the rover, or ended otherwise.
    Failed,
    /// Ended by a stop or E-stop.
    Aborted,
    /// The outcome is unknown: no word from the rover when there should have been one, or the ground
    /// was restarted in between. Never sent again by itself. A late word takes it further; else an
    /// operator resolves it from telemetry.
    Overdue,
    /// Taken back before it was sent.
    Cancelled,
    /// The plan's basis no longer held when it was to be armed or sent, or it waited for the link
    /// longer than a command may.
    Expired,
}

/// One transition of one command.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CommandEvent {
    /// The command.
    pub command: CommandRecord,
    /// When, on the ground.
    pub time: Timestamp,
    /// The new state.
    pub state: CommandState,
    /// Who asked for it, or `rover`, or `server`.
    pub who: String,
    /// Why, where there is something to say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// A command as the ground knows it: the fold of its events.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CommandRecord {
    /// Identity (UUID v7), given by the client or the server.
    pub id: String,
    /// What the rover is told.
    pub body: CommandBody,
    /// In words: `Lift leg 2`.
    pub title: String,
    /// The plan it belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanCommandRef>,
    /// Present state.
    pub state: CommandState,
    /// Who staged it.
    pub operator: String,
    /// When it was staged.
    pub staged: Timestamp,
    /// Until when it may be sent, once armed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub armed_until: Option<Timestamp>,
    /// When it was handed to the link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sent: Option<Timestamp>,
    /// When it reaches the rover at the earliest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arrives: Option<Timestamp>,
    /// When the ground can know of it at the earliest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub earliest_ack: Option<Timestamp>,
    /// After this time without word it is overdue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overdue_after: Option<Timestamp>,
    /// How long the motion takes as planned (s).
    pub duration_s: f64,
    /// Share done as last reported, 0 to 1.
    pub progress: f64,
    /// Why it failed or expired.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Its stages, once it was sent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub verification: Vec<Verification>,
    /// The second person's word; absent where none is needed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub approval: Option<Approval>,
    /// Number of the authority that it was sent under.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epoch: Option<u64>,
    /// What must hold when it is released, and when it begins on board.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub preconditions: Vec<Precondition>,
    /// Of a sequence: the step under way as last reported, from 1, and how many there are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<[u32; 2]>,
}

/// Which command of which plan: one of its `commands`, or one of its `retreat`.
///
/// A plan's commands go in order, each after the one before is done. Its way back goes likewise:
/// - `retreat` has a part for each command, in the opposite order: with n commands, part i undoes
///   command n - 1 - i.
/// - A part may be staged once the command that it undoes is done (else `not_executed`), while no
///   command of the plan is on its way or under way (else `plan_under_way`).
/// - It is armed when that command is the last one done and not undone (else `order`).
/// - Once a part is done the plan goes back only: what is staged of its commands expires, and others
///   are refused (`backing_out`). To go forward, plan anew.
/// - A command that ended elsewhere than at its end is not undone: the rover is then not where the
///   way back begins (`basis_changed`).
///
/// Basis, arming and sending are the same both ways.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanCommandRef {
    /// The plan.
    pub plan_id: String,
    /// Index into the plan's commands or, with `retreat`, into its way back.
    pub index: usize,
    /// A part of the way back; false where absent.
    #[serde(default, skip_serializing_if = "is_false")]
    pub retreat: bool,
}
