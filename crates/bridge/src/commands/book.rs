//! The commands in memory and the rules of their transitions.

mod approval;
mod deadlines;
mod restart;

use std::collections::{BTreeMap, HashMap};

use wire::live::{
    AckStage, Approval, CommandEvent, CommandRecord, CommandState, Executing, PlanCommandRef,
    Uplink, VerificationOutcome, VerificationStage,
};
use wire::time::Timestamp;

pub use deadlines::Silence;

use super::plans::PlanOrder;
use super::{
    ARM_WINDOW_S, CommandError, LightTimes, MAX_COMMANDS, MOTION_SLACK_S, MOTION_STRETCH,
    StageCommand, is_outstanding, is_terminal, new_id, stages,
};

/// Who is named where no operator asked.
const ROVER: &str = "rover";
const SERVER: &str = "server";
/// A reported progress is an event when it has grown by this much.
const PROGRESS_STEP: f64 = 0.05;
const MAX_DURATION_S: f64 = 86_400.0;

/// The life cycle of all commands of one rover.
#[derive(Debug, Default)]
pub struct CommandBook {
    /// By order of staging.
    entries: BTreeMap<u64, Entry>,
    order_of: HashMap<String, u64>,
    next_order: u64,
    plans: PlanOrder,
    events: Vec<CommandEvent>,
    /// See [`CommandBook::set_silences`].
    silences: Vec<Silence>,
}

#[derive(Debug)]
struct Entry {
    record: CommandRecord,
    /// See [`StageCommand::after`].
    after: usize,
    basis_joints_rad: BTreeMap<String, Vec<f64>>,
    basis_tolerance_rad: f64,
    model_hash: Option<String>,
    /// Who armed it last.
    armed_by: Option<String>,
    /// It is of an earlier session.
    restored: bool,
    /// When the first word can be here, were there no outages.
    word: Option<Timestamp>,
    /// When a word should be here, were there no outages. `record.overdue_after`, which counts them, is as
    /// of the last news; telemetry may have granted more since.
    deadline: Option<Timestamp>,
    /// The link has transmitted it: from then on a word is waited for.
    transmitted: bool,
}

impl CommandBook {
    /// Stages a command. The same id with the same content gives the command as it is now.
    pub fn stage(
        &mut self,
        now: Timestamp,
        command: StageCommand,
    ) -> Result<CommandRecord, CommandError> {
        let id = match &command.id {
            Some(given) => canonical_id(given)?,
            None => new_id(now),
        };
        if let Some(known) = self.get(&id) {
            let same = known.body == command.body
                && known.plan == command.plan
                && known.preconditions == command.preconditions;
            return if same { Ok(known.clone()) } else { Err(CommandError::IdReused { id }) };
        }
        let duration_s = command.duration_s;
        if !(0.0..=MAX_DURATION_S).contains(&duration_s) {
            return Err(CommandError::DurationInvalid { duration_s });
        }
        self.may_stage(&command)?;
        self.make_room()?;
        let needed = |content_hash| Approval { content_hash, by: None, until: None };
        let approval = command.two_persons.then(|| needed(approval::content_hash(&id, &command)));
        let record = CommandRecord {
            id: id.clone(),
            body: command.body,
            title: command.title,
            plan: command.plan,
            state: CommandState::Staged,
            operator: command.operator.clone(),
            staged: now,
            armed_until: None,
            sent: None,
            arrives: None,
            earliest_ack: None,
            overdue_after: None,
            duration_s,
            progress: 0.0,
            why: None,
            verification: Vec::new(),
            approval,
            epoch: None,
            preconditions: command.preconditions,
            step: None,
        };
        let entry = Entry {
            record: record.clone(),
            after: command.after,
            basis_joints_rad: command.basis_joints_rad,
            basis_tolerance_rad: command.basis_tolerance_rad,
            model_hash: command.model_hash,
            armed_by: None,
            restored: false,
            word: None,
            deadline: None,
            transmitted: false,
        };
        self.entries.insert(self.next_order, entry);
        self.order_of.insert(id, self.next_order);
        self.next_order += 1;
        self.events.push(event(now, &record, &command.operator, None));
        Ok(record)
    }

    /// Does the order of its plan allow a command to be staged? Commands by hand have none. See
    /// [`PlanCommandRef`].
    pub fn may_stage(&self, command: &StageCommand) -> Result<(), CommandError> {
        let Some(plan) = &command.plan else { return Ok(()) };
        let progress = self.plans.of(plan);
        if !plan.retreat {
            return if progress.backing_out { Err(CommandError::BackingOut) } else { Ok(()) };
        }
        let (undoes, done) = (command.after.saturating_sub(1), progress.done);
        if command.after == 0 || command.after > done {
            return Err(CommandError::NotExecuted { undoes, done });
        }
        self.plan_is_quiet(plan)
    }

    /// Could a command be armed now, were it staged? Its second person's word apart.
    pub fn may_arm(&self, command: &StageCommand) -> Result<(), CommandError> {
        let id = || command.id.clone().unwrap_or_else(|| "the command".into());
        if let Some(armed) = self.armed() {
            return Err(CommandError::OtherArmed { id: id(), armed: armed.id.clone() });
        }
        let Some(plan) = &command.plan else { return Ok(()) };
        let progress = self.plans.of(plan);
        if !plan.retreat && !progress.is_next(plan, command.after) {
            return Err(CommandError::Order { id: id(), index: plan.index, next: progress.done });
        }
        self.plan_is_quiet(plan)
    }

    /// Arms a staged command for [`ARM_WINDOW_S`]. One command at a time, and the next of its plan
    /// only.
    pub fn arm(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
    ) -> Result<CommandRecord, CommandError> {
        self.tick(now);
        let record = self.known(id)?;
        if record.state == CommandState::Armed {
            return Ok(record.clone());
        }
        if record.state != CommandState::Staged {
            return Err(CommandError::NotStaged { id: id.into(), state: record.state });
        }
        if let Some(plan) = &record.plan {
            self.is_next_of_plan(id, plan)?;
            self.plan_is_quiet(plan)?;
        }
        self.is_approved(now, record)?;
        if let Some(armed) = self.armed() {
            return Err(CommandError::OtherArmed { id: id.into(), armed: armed.id.clone() });
        }
        self.transition(now, id, who, None, |entry| {
            entry.record.state = CommandState::Armed;
            entry.armed_by = Some(who.into());
            entry.record.armed_until = Some(now.plus_seconds(ARM_WINDOW_S));
        })
    }

    /// Sends an armed command under no authority, see [`CommandBook::send_as`].
    pub fn send(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        light: LightTimes,
    ) -> Result<(CommandRecord, Uplink), CommandError> {
        self.send_as(now, id, who, light, None)
    }

    /// Sends an armed command under the authority of that epoch: gives what is to be handed to the
    /// link.
    pub fn send_as(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        light: LightTimes,
        epoch: Option<u64>,
    ) -> Result<(CommandRecord, Uplink), CommandError> {
        let record = self.known(id)?;
        if record.state != CommandState::Armed {
            return Err(CommandError::NotArmed { id: id.into(), state: record.state });
        }
        let until = record.armed_until.unwrap_or(now);
        if now > until {
            self.tick(now);
            return Err(CommandError::ArmExpired { id: id.into(), until });
        }
        self.is_approved(now, record)?;
        let record = self.transition(now, id, who, None, |entry| {
            entry.record.epoch = epoch;
            stages::begin(&mut entry.record, now);
            let arrives = now.plus_seconds(light.up_s);
            entry.record.state = CommandState::Sent;
            entry.record.armed_until = None;
            entry.record.sent = Some(now);
            entry.expect(arrives, light);
        })?;
        let entry = &self.entries[&self.order_of[id]];
        let uplink = Uplink::Command {
            id: id.into(),
            body: record.body.clone(),
            basis_joints_rad: entry.basis_joints_rad.clone(),
            basis_tolerance_rad: entry.basis_tolerance_rad,
            model_hash: entry.model_hash.clone(),
            epoch,
            preconditions: record.preconditions.clone(),
        };
        Ok((record, uplink))
    }

    /// The link has transmitted a sent command at `now`; it arrives at `arrives` at the earliest. What
    /// was promised when it was sent is corrected where the command had to wait.
    pub fn transmitted(&mut self, now: Timestamp, id: &str, arrives: Timestamp, light: LightTimes) {
        let Some(entry) = self.entry_mut(id) else { return };
        if entry.transmitted || entry.record.state != CommandState::Sent {
            return;
        }
        entry.transmitted = true;
        let _ = self.transition(now, id, SERVER, Some("transmitted"), |entry| {
            stages::pass(&mut entry.record, VerificationStage::Transmitted, now);
            entry.expect(arrives, light);
        });
    }

    /// Takes a command back that was not sent yet.
    pub fn cancel(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
    ) -> Result<CommandRecord, CommandError> {
        self.end_unsent(now, id, who, None, CommandState::Cancelled)
    }

    /// Ends a command that was not sent yet because its basis no longer holds.
    pub fn expire(
        &mut self,
        now: Timestamp,
        id: &str,
        why: &str,
    ) -> Result<CommandRecord, CommandError> {
        self.end_unsent(now, id, SERVER, Some(why), CommandState::Expired)
    }

    /// A command that was sent has certainly never reached the rover, whatever was thought of it: it has
    /// expired.
    pub fn never_arrived(&mut self, now: Timestamp, id: &str, why: &str) {
        let waits = |state| matches!(state, CommandState::Sent | CommandState::Overdue);
        if self.get(id).is_some_and(|record| waits(record.state)) {
            self.end(now, id, SERVER, CommandState::Expired, Some(why));
        }
    }

    /// Whether a command has reached the rover can no longer be known: its outcome is unknown.
    pub fn outcome_unknown(&mut self, now: Timestamp, id: &str, why: &str) {
        let waits = |state| is_outstanding(state) && state != CommandState::Overdue;
        if self.get(id).is_some_and(|record| waits(record.state)) {
            self.lose_track(now, id, why);
        }
    }

    /// Ends a sent command that never came to the link after all.
    pub fn withdraw(&mut self, now: Timestamp, id: &str, state: CommandState, why: &str) {
        if self.get(id).is_some_and(|r| r.state == CommandState::Sent) {
            self.end(now, id, SERVER, state, Some(why));
        }
    }

    /// The rover's word on a command. Words on unknown or ended commands change nothing; false then.
    pub fn acknowledge(
        &mut self,
        now: Timestamp,
        id: &str,
        stage: AckStage,
        detail: Option<&str>,
    ) -> bool {
        let Some(record) = self.get(id) else { return false };
        if !is_outstanding(record.state) {
            return false;
        }
        let state = record.state;
        match stage {
            AckStage::Received if matches!(state, CommandState::Sent | CommandState::Overdue) => {
                self.move_on(now, id, CommandState::Received, detail);
            }
            AckStage::Received => return false,
            AckStage::Started if state == CommandState::Executing => return false,
            AckStage::Started => self.move_on(now, id, CommandState::Executing, detail),
            AckStage::Completed => self.end(now, id, ROVER, CommandState::Done, detail),
            AckStage::Rejected | AckStage::Failed => {
                self.end(now, id, ROVER, CommandState::Failed, detail);
            }
            AckStage::Aborted => self.end(now, id, ROVER, CommandState::Aborted, detail),
        }
        true
    }

    /// Telemetry shows a command under way: a word, too.
    pub fn progress(&mut self, now: Timestamp, executing: &Executing) {
        let Some(entry) = self.entry_mut(&executing.command_id) else { return };
        let state = entry.record.state;
        if !is_outstanding(state) {
            return;
        }
        let granted = now.plus_seconds(MOTION_SLACK_S);
        entry.deadline = entry.deadline.max(Some(granted));
        let progress = executing.progress.clamp(0.0, 1.0);
        let grown = progress >= entry.record.progress + PROGRESS_STEP
            || executing.step != entry.record.step;
        if state == CommandState::Executing && !grown {
            return;
        }
        if state != CommandState::Executing {
            self.move_on(now, &executing.command_id, CommandState::Executing, None);
        }
        if grown {
            // The command is known: it was found above.
            let _ = self.transition(now, &executing.command_id, ROVER, None, |entry| {
                entry.record.progress = progress;
                entry.record.step = executing.step;
            });
        }
    }

    /// Takes every armed command back to staged.
    pub fn disarm_all(&mut self, now: Timestamp, who: &str, why: &str) {
        for id in self.ids(|e| e.record.state == CommandState::Armed) {
            self.disarm(now, &id, who, why);
        }
    }

    /// The armed commands that another than `who` has armed.
    pub fn armed_by_others(&self, who: &str) -> Vec<String> {
        self.ids(|e| e.record.state == CommandState::Armed && e.armed_by.as_deref() != Some(who))
    }

    /// A command.
    pub fn get(&self, id: &str) -> Option<&CommandRecord> {
        Some(&self.entries.get(self.order_of.get(id)?)?.record)
    }

    /// All commands in memory in the order of staging.
    pub fn records(&self) -> impl Iterator<Item = &CommandRecord> {
        self.entries.values().map(|e| &e.record)
    }

    /// Are all commands done that come before this one in its plan, and none undone that it
    /// follows? True for a command without a plan.
    pub fn is_next(&self, id: &str) -> bool {
        let plan = self.get(id).and_then(|record| record.plan.as_ref());
        plan.is_none_or(|plan| self.is_next_of_plan(id, plan).is_ok())
    }

    /// Is a command of this session on its way or under way? Those of an earlier session are not
    /// waited for.
    pub fn is_busy(&self) -> bool {
        self.entries.values().any(|e| is_outstanding(e.record.state) && !e.restored)
    }

    /// The armed command.
    pub fn armed(&self) -> Option<&CommandRecord> {
        self.records().find(|r| r.state == CommandState::Armed)
    }

    /// The events since the last call, in order.
    pub fn take_events(&mut self) -> Vec<CommandEvent> {
        std::mem::take(&mut self.events)
    }

    fn known(&self, id: &str) -> Result<&CommandRecord, CommandError> {
        self.get(id).ok_or_else(|| CommandError::Unknown { id: id.chars().take(64).collect() })
    }

    fn is_next_of_plan(&self, id: &str, plan: &PlanCommandRef) -> Result<(), CommandError> {
        let after = self.entries[&self.order_of[id]].after;
        let progress = self.plans.of(plan);
        if progress.is_next(plan, after) {
            return Ok(());
        }
        let (id, done) = (id.to_owned(), progress.done);
        Err(if plan.retreat {
            CommandError::BackOrder { id, undoes: after.saturating_sub(1), done }
        } else if progress.backing_out {
            CommandError::BackingOut
        } else {
            CommandError::Order { id, index: plan.index, next: done }
        })
    }

    /// An error while a command of the same plan is on its way or under way.
    fn plan_is_quiet(&self, plan: &PlanCommandRef) -> Result<(), CommandError> {
        let of_plan = |r: &&CommandRecord| {
            r.plan.as_ref().is_some_and(|p| p.plan_id == plan.plan_id) && is_outstanding(r.state)
        };
        match self.records().find(of_plan) {
            None => Ok(()),
            Some(other) => Err(CommandError::PlanUnderWay { other: other.id.clone() }),
        }
    }

    fn lose_track(&mut self, now: Timestamp, id: &str, why: &str) {
        let _ = self.transition(now, id, SERVER, Some(why), |entry| {
            entry.record.state = CommandState::Overdue;
            entry.record.why = Some(why.into());
            stages::silent(&mut entry.record, now);
        });
    }

    fn entry_mut(&mut self, id: &str) -> Option<&mut Entry> {
        self.entries.get_mut(self.order_of.get(id)?)
    }

    fn ids(&self, which: impl Fn(&Entry) -> bool) -> Vec<String> {
        self.entries.values().filter(|e| which(e)).map(|e| e.record.id.clone()).collect()
    }

    /// The one place where a record changes: change and event are inseparable.
    fn transition(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        why: Option<&str>,
        change: impl FnOnce(&mut Entry),
    ) -> Result<CommandRecord, CommandError> {
        let unknown = || CommandError::Unknown { id: id.chars().take(64).collect() };
        let order = self.order_of.get(id).ok_or_else(unknown)?;
        let entry = self.entries.get_mut(order).ok_or_else(unknown)?;
        debug_assert!(!is_terminal(entry.record.state), "an ended command changes no more");
        change(entry);
        entry.tell_times(&self.silences);
        let record = entry.record.clone();
        self.events.push(event(now, &record, who, why));
        Ok(record)
    }

    fn move_on(&mut self, now: Timestamp, id: &str, state: CommandState, detail: Option<&str>) {
        let _ = self.transition(now, id, ROVER, detail, |entry| {
            entry.record.state = state;
            entry.transmitted = true;
            entry.record.why = None;
            let stage = match state {
                CommandState::Received => VerificationStage::Received,
                _ => VerificationStage::Started,
            };
            stages::pass(&mut entry.record, stage, now);
            let motion_s = entry.record.duration_s * MOTION_STRETCH + MOTION_SLACK_S;
            let from = entry.record.earliest_ack.map_or(now, |ack| ack.max(now));
            let by = from.plus_seconds(motion_s);
            entry.deadline = entry.deadline.max(Some(by));
        });
    }

    fn end(&mut self, now: Timestamp, id: &str, who: &str, state: CommandState, why: Option<&str>) {
        let ended = self.transition(now, id, who, why, |entry| {
            entry.record.state = state;
            entry.record.armed_until = None;
            entry.record.why =
                if state == CommandState::Done { None } else { why.map(String::from) };
            if state == CommandState::Done {
                entry.record.progress = 1.0;
                stages::pass(&mut entry.record, VerificationStage::Completed, now);
            } else if !entry.record.verification.is_empty() {
                // The rover's word came from the stage it had reached, whatever was heard of it.
                if who == ROVER {
                    stages::pass(&mut entry.record, VerificationStage::Received, now);
                }
                let stage = stages::reached(&entry.record);
                let outcome = match who {
                    ROVER => VerificationOutcome::Failed,
                    _ => VerificationOutcome::NotReached,
                };
                stages::end(&mut entry.record, stage, outcome, now);
            }
        });
        if let (CommandState::Done, Ok(CommandRecord { plan: Some(plan), .. })) = (state, ended) {
            self.plan_went_on(now, id, &plan);
        }
    }

    /// A command of a plan is done: what is staged of the plan for the other way has no basis left.
    fn plan_went_on(&mut self, now: Timestamp, id: &str, plan: &PlanCommandRef) {
        if !self.plans.done(plan, self.entries[&self.order_of[id]].after) {
            return;
        }
        let turned = self.ids(|e| {
            let other_way =
                |p: &PlanCommandRef| p.plan_id == plan.plan_id && p.retreat != plan.retreat;
            let open = matches!(e.record.state, CommandState::Staged | CommandState::Armed);
            open && e.record.plan.as_ref().is_some_and(other_way)
        });
        let why = if plan.retreat {
            "the plan is being backed out"
        } else {
            "the plan has gone on since"
        };
        for id in turned {
            self.end(now, &id, SERVER, CommandState::Expired, Some(why));
        }
    }

    fn end_unsent(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        why: Option<&str>,
        state: CommandState,
    ) -> Result<CommandRecord, CommandError> {
        let record = self.known(id)?;
        match record.state {
            CommandState::Staged | CommandState::Armed => {
                self.end(now, id, who, state, why);
                self.known(id).cloned()
            }
            same if same == state => Ok(record.clone()),
            state => Err(CommandError::AlreadyTerminal { id: id.into(), state }),
        }
    }

    /// Takes an armed command back to staged.
    pub fn disarm(&mut self, now: Timestamp, id: &str, who: &str, why: &str) {
        let _ = self.transition(now, id, who, Some(why), |entry| {
            entry.record.state = CommandState::Staged;
            entry.record.armed_until = None;
        });
    }

    fn make_room(&mut self) -> Result<(), CommandError> {
        if self.entries.len() < MAX_COMMANDS {
            return Ok(());
        }
        let oldest = |which: fn(CommandState) -> bool| {
            self.entries.iter().find(|(_, e)| which(e.record.state)).map(|(&order, _)| order)
        };
        let evicted = oldest(is_terminal)
            .or_else(|| oldest(|s| s == CommandState::Overdue))
            .ok_or(CommandError::QueueFull { what: "the list of commands is" })?;
        if let Some(entry) = self.entries.remove(&evicted) {
            self.order_of.remove(&entry.record.id);
        }
        Ok(())
    }
}

fn event(now: Timestamp, record: &CommandRecord, who: &str, why: Option<&str>) -> CommandEvent {
    CommandEvent {
        command: record.clone(),
        time: now,
        state: record.state,
        who: who.into(),
        why: why.map(String::from),
    }
}

fn canonical_id(given: &str) -> Result<String, CommandError> {
    match uuid::Uuid::try_parse(given) {
        Ok(id) => Ok(id.to_string()),
        Err(_) => Err(CommandError::IdInvalid { id: given.chars().take(64).collect() }),
    }
}
