//! The verification stages of a sent command.

use wire::live::{CommandRecord, Verification, VerificationOutcome, VerificationStage};
use wire::time::Timestamp;

use VerificationOutcome::{NotReached, Ok, Pending, Timeout, Unknown};
use VerificationStage::{Completed, Received, Released, Started, Transmitted};

/// All stages, with the release passed.
pub(super) fn begin(record: &mut CommandRecord, now: Timestamp) {
    let stage = |stage| Verification { stage, outcome: Pending, at: None, due: None };
    record.verification = [Released, Transmitted, Received, Started, Completed].map(stage).into();
    pass(record, Released, now);
}

/// Sets when a word on a stage, and on those after it, is due at the latest.
pub(super) fn due(record: &mut CommandRecord, from: VerificationStage, due: Timestamp) {
    let open = |v: &&mut Verification| v.stage >= from && v.outcome == Pending;
    record.verification.iter_mut().filter(open).for_each(|v| v.due = Some(due));
}

/// A stage is passed, and so are all before it.
pub(super) fn pass(record: &mut CommandRecord, stage: VerificationStage, at: Timestamp) {
    let before = |v: &&mut Verification| v.stage <= stage && v.outcome != Ok;
    for passed in record.verification.iter_mut().filter(before) {
        (passed.outcome, passed.at) = (Ok, Some(at));
    }
    // What was unknown for want of this word is only open again.
    for later in record.verification.iter_mut().filter(|v| v.stage > stage) {
        if matches!(later.outcome, Timeout | Unknown) {
            (later.outcome, later.at) = (Pending, None);
        }
    }
}

/// It ends at a stage, otherwise than by passing it.
pub(super) fn end(
    record: &mut CommandRecord,
    stage: VerificationStage,
    outcome: VerificationOutcome,
    at: Timestamp,
) {
    for open in record.verification.iter_mut().filter(|v| v.outcome != Ok) {
        let reached = open.stage == stage;
        (open.outcome, open.at) = (if reached { outcome } else { NotReached }, Some(at));
    }
}

/// Nothing is heard of it: the first open stage is out of time, and nobody knows of those after.
pub(super) fn silent(record: &mut CommandRecord, at: Timestamp) {
    let mut open = record.verification.iter_mut().filter(|v| v.outcome == Pending);
    if let Some(first) = open.next() {
        (first.outcome, first.at) = (Timeout, Some(at));
    }
    open.for_each(|v| (v.outcome, v.at) = (Unknown, Some(at)));
}

/// The first stage that is not passed.
pub(super) fn reached(record: &CommandRecord) -> VerificationStage {
    let open = record.verification.iter().find(|v| v.outcome != Ok);
    open.map_or(Completed, |v| v.stage)
}
