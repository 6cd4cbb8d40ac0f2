//! How far a command is verified, who approved it, and who may command.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::time::Timestamp;

/// A stage that a released command passes.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum VerificationStage {
    /// It is in the log and was handed to the link.
    Released,
    /// It has left the ground.
    Transmitted,
    /// The rover has it.
    Received,
    /// The rover has accepted it and begun.
    Started,
    /// It has ended as commanded.
    Completed,
}

/// What is known of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum VerificationOutcome {
    /// Nothing yet, and there need not be.
    Pending,
    /// Passed.
    Ok,
    /// Not passed, by the rover's word.
    Failed,
    /// No word when there should have been one.
    Timeout,
    /// Whether it was passed nobody knows: an earlier stage had no word.
    Unknown,
    /// It will not come to that.
    NotReached,
}

/// A stage of a command with what is known of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Verification {
    /// The stage.
    pub stage: VerificationStage,
    /// What is known of it.
    pub outcome: VerificationOutcome,
    /// Since when, on the ground.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<Timestamp>,
    /// When a word on it should have come at the latest, light times considered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub due: Option<Timestamp>,
}

/// A second person's word on a command that needs one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Approval {
    /// Hash of what is approved: identity, body, plan and basis.
    pub content_hash: String,
    /// Who approved it; nobody yet where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Until when the approval holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Timestamp>,
}

/// Who may command.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AuthorityReport {
    /// The operator who holds the authority; nobody where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
    /// When it lapses unless it is renewed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Timestamp>,
    /// Number of the present or last authority. It grows with each change of holder; the rover refuses
    /// commands of an older one.
    pub epoch: u64,
    /// Must it be acquired before a command is armed? Else arming acquires it.
    pub explicit: bool,
    /// It lapses this long after the last word of its holder (s); zero where it is not told.
    #[serde(default)]
    pub lease_s: f64,
    /// Who asks its holder for it; nobody where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked_by: Option<String>,
    /// Until when that is asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked_until: Option<Timestamp>,
}
