//! The second person's word on commands that take two.

use wire::live::{CommandRecord, CommandState};
use wire::time::Timestamp;

use super::super::{APPROVAL_S, CommandError, StageCommand};
use super::CommandBook;

impl CommandBook {
    /// Approves a command that takes two persons, for [`APPROVAL_S`]: by another than its author, who
    /// names the content that was looked at.
    pub fn approve(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        content_hash: &str,
    ) -> Result<CommandRecord, CommandError> {
        let record = self.known(id)?;
        let id = record.id.clone();
        if record.state != CommandState::Staged {
            return Err(CommandError::NotStaged { id, state: record.state });
        }
        let Some(approval) = &record.approval else {
            return Err(CommandError::ApprovalNotNeeded { id });
        };
        if record.operator == who {
            return Err(CommandError::SelfApproval { id, who: who.into() });
        }
        if approval.content_hash != content_hash {
            let content_hash = approval.content_hash.clone();
            return Err(CommandError::ApprovalOfOther { id, content_hash });
        }
        self.transition(now, &id, who, Some("approved"), |entry| {
            if let Some(approval) = &mut entry.record.approval {
                approval.by = Some(who.into());
                approval.until = Some(now.plus_seconds(APPROVAL_S));
            }
        })
    }

    /// A second person's word, where it is needed, is there and holds.
    pub(super) fn is_approved(
        &self,
        now: Timestamp,
        record: &CommandRecord,
    ) -> Result<(), CommandError> {
        let Some(approval) = &record.approval else { return Ok(()) };
        if approval.until.is_some_and(|until| until >= now) {
            return Ok(());
        }
        let lapsed = approval.until.is_some();
        Err(CommandError::ApprovalNeeded { id: record.id.clone(), lapsed })
    }
}

/// What an approval is of.
pub(super) fn content_hash(id: &str, command: &StageCommand) -> String {
    let StageCommand { body, plan, basis_joints_rad, basis_tolerance_rad, model_hash, .. } =
        command;
    let waits_for = &command.preconditions;
    let content = (id, body, plan, basis_joints_rad, basis_tolerance_rad, model_hash, waits_for);
    let text = serde_json::to_vec(&content).unwrap_or_default();
    blake3::hash(&text).to_hex()[..32].to_owned()
}
