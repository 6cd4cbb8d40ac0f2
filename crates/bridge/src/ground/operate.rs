//! What operators do: the methods behind the routes.

use tokio::sync::oneshot;
use wire::live::{
    AuthorityReport, CommandBody, CommandRecord, CommandState, DirectionModel, EstopState,
    EventLevel, LinkClass, LinkConfig, LinkReport, Uplink, channel,
};
use wire::resources::EstopAnswer;
use wire::time::Timestamp;

use super::{Ground, Logged, Pending, Release, RoverBusy, log_error, size};
use crate::adapter::RoverAdapter;
use crate::commands::{AuthorityError, CommandError, EstopError, StageCommand};
use crate::link::{self, LinkError, Settings};
use crate::recorder::Written;

/// What stands in the way of a command, by what was looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Rehearsed {
    /// Can the flight log be written?
    pub log: Result<(), CommandError>,
    /// Is there no E-stop?
    pub estop: Result<(), CommandError>,
    /// Is there a connection to the rover?
    pub connection: Result<(), CommandError>,
    /// Has who asks the authority, or could it be acquired?
    pub authority: Result<(), CommandError>,
    /// May it be staged by its place in its plan?
    pub order: Result<(), CommandError>,
}

impl Ground {
    /// Stages a command; see [`crate::commands::CommandBook::stage`].
    pub fn stage(
        &mut self,
        now: Timestamp,
        command: StageCommand,
    ) -> Result<Logged<CommandRecord>, CommandError> {
        let now = self.tick(now);
        self.log_must_be_well()?;
        let record = self.book.stage(now, command)?;
        Ok(self.logged(record))
    }

    /// All that stands in the way of staging, arming and sending a command now, changing nothing:
    /// everything but the release.
    pub fn rehearse(&self, now: Timestamp, command: &StageCommand, who: &str) -> Vec<CommandError> {
        let Rehearsed { log, estop, connection, authority, order } =
            self.look(now, Some(command), who);
        let waits_for = &command.preconditions;
        let observed = self.observe(now, waits_for).map(drop).map_err(CommandError::from);
        let checks =
            [log, order, estop, connection, authority, self.book.may_arm(command), observed];
        checks.into_iter().filter_map(Result::err).collect()
    }

    /// As [`Ground::rehearse`], check by check; without a command what holds for any. Preconditions
    /// are shown by [`Ground::show`].
    pub fn look(&self, now: Timestamp, command: Option<&StageCommand>, who: &str) -> Rehearsed {
        let now = self.now.max(now);
        Rehearsed {
            log: self.log_must_be_well(),
            estop: self.no_estop(),
            connection: self.rover_must_be_there(),
            authority: self.authority.may(now, who).map_err(CommandError::from),
            order: command.map_or(Ok(()), |command| self.book.may_stage(command)),
        }
    }

    /// May a command be armed now, were it staged: its place in its plan, and no other armed one?
    pub fn may_arm(&self, command: &StageCommand) -> Result<(), CommandError> {
        self.book.may_arm(command)
    }

    /// Arms a command; see [`crate::commands::CommandBook::arm`].
    pub fn arm(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
    ) -> Result<Logged<CommandRecord>, CommandError> {
        let now = self.tick(now);
        self.no_estop()?;
        self.log_must_be_well()?;
        self.exercise_authority(now, who)?;
        let outcome = self.book.arm(now, id, who);
        let logged = self.logged(());
        outcome.map(|record| Logged { value: record, written: logged.written })
    }

    /// Sends an armed command: to the log, and from there to the link. The record is `sent` at
    /// once; should the log fail or an E-stop come in between, it ends without having been sent.
    pub fn send(&mut self, now: Timestamp, id: &str, who: &str) -> Result<Release, CommandError> {
        let now = self.tick(now);
        self.no_estop()?;
        self.log_must_be_well()?;
        self.rover_must_be_there()?;
        let epoch = self.exercise_authority(now, who)?;
        let waits_for = self.book.get(id).map(|record| record.preconditions.clone());
        let observed = self.observe(now, waits_for.as_deref().unwrap_or_default())?;
        let light = self.command_times(now);
        let outcome = self.book.send_as(now, id, who, light, Some(epoch));
        let uplink = match outcome {
            Ok((_, mut uplink)) => {
                if let Uplink::Command { preconditions, .. } = &mut uplink {
                    *preconditions = observed;
                }
                uplink
            }
            Err(error) => {
                self.publish_events();
                return Err(error);
            }
        };
        // The log keeps the order: once the event is safe, so is the uplink message.
        let uplink_written = self.put_durable(channel::COMMAND_UPLINK, now, &uplink);
        let event_written = self.publish_events();
        match (uplink_written, event_written) {
            (Some(Ok(_)), Some(Ok(written))) => Ok(self.release_later(id, uplink, written)),
            (Some(Err(error)), _) | (_, Some(Err(error))) => {
                Err(self.not_sent(now, id, CommandState::Failed, log_error(error)))
            }
            _ => {
                let reason = "the command cannot be encoded".into();
                let error = CommandError::LogUnavailable { reason };
                Err(self.not_sent(now, id, CommandState::Failed, error))
            }
        }
    }

    /// Takes a command back that was not sent.
    pub fn cancel(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
    ) -> Result<Logged<CommandRecord>, CommandError> {
        let now = self.tick(now);
        let record = self.book.cancel(now, id, who)?;
        Ok(self.logged(record))
    }

    /// Ends a command that was not sent because its basis no longer holds.
    pub fn expire(
        &mut self,
        now: Timestamp,
        id: &str,
        why: &str,
    ) -> Result<Logged<CommandRecord>, CommandError> {
        let now = self.tick(now);
        let record = self.book.expire(now, id, why)?;
        Ok(self.logged(record))
    }

    /// Approves a command that takes two persons; see [`crate::commands::CommandBook::approve`].
    pub fn approve(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        content_hash: &str,
    ) -> Result<Logged<CommandRecord>, CommandError> {
        let now = self.tick(now);
        let record = self.book.approve(now, id, who, content_hash)?;
        Ok(self.logged(record))
    }

    /// Ends a command whose outcome was unknown; see [`crate::commands::CommandBook::resolve`].
    pub fn resolve(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        done: bool,
        why: &str,
    ) -> Result<Logged<CommandRecord>, CommandError> {
        let now = self.tick(now);
        let record = self.book.resolve(now, id, who, done, why)?;
        Ok(self.logged(record))
    }

    /// Who may command.
    pub fn authority(&self, now: Timestamp) -> AuthorityReport {
        self.authority.report(self.now.max(now))
    }

    /// Takes the authority to command, or prolongs it; with `take_over` from whoever has it.
    pub fn acquire_authority(
        &mut self,
        now: Timestamp,
        who: &str,
        take_over: bool,
    ) -> Result<AuthorityReport, AuthorityError> {
        let now = self.tick(now);
        let before = self.authority.report(now);
        if take_over {
            self.authority.take_over(now, who);
        }
        self.authority.acquire(now, who)?;
        self.authority_changed(now, &before, who);
        Ok(self.authority.report(now))
    }

    /// Prolongs the lease of the authority.
    pub fn renew_authority(
        &mut self,
        now: Timestamp,
        who: &str,
    ) -> Result<AuthorityReport, AuthorityError> {
        let now = self.tick(now);
        self.authority.renew(now, who)?;
        Ok(self.authority.report(now))
    }

    /// Gives the authority up.
    pub fn release_authority(
        &mut self,
        now: Timestamp,
        who: &str,
    ) -> Result<AuthorityReport, AuthorityError> {
        let now = self.tick(now);
        self.authority.release(now, who)?;
        self.book.disarm_all(now, who, "the authority to command was given up");
        self.publish_events();
        self.notice(now, EventLevel::Info, who, "gave up the authority to command");
        self.report_link();
        Ok(self.authority.report(now))
    }

    /// Asks whoever has the authority for it; takes it where nobody has it.
    pub fn ask_for_authority(
        &mut self,
        now: Timestamp,
        who: &str,
    ) -> Result<AuthorityReport, AuthorityError> {
        let now = self.tick(now);
        let before = self.authority.report(now);
        let news = self.authority.ask(now, who)?;
        self.authority_changed(now, &before, who);
        if news {
            let holder = before.holder.as_deref().unwrap_or("its holder");
            let text = format!("asks {holder} for the authority to command");
            self.notice(now, EventLevel::Info, who, &text);
            self.report_link();
        }
        Ok(self.authority.report(now))
    }

    /// Hands the authority over to another operator.
    pub fn hand_over_authority(
        &mut self,
        now: Timestamp,
        who: &str,
        to: &str,
    ) -> Result<AuthorityReport, AuthorityError> {
        let now = self.tick(now);
        self.authority.hand_over(now, who, to)?;
        self.book.disarm_all(now, who, "the authority to command was handed over");
        self.publish_events();
        let text = format!("handed the authority to command over to {to}");
        self.notice(now, EventLevel::Info, who, &text);
        self.report_link();
        Ok(self.authority.report(now))
    }

    fn exercise_authority(&mut self, now: Timestamp, who: &str) -> Result<u64, AuthorityError> {
        let before = self.authority.report(now);
        let epoch = self.authority.exercise(now, who)?;
        self.authority_changed(now, &before, who);
        Ok(epoch)
    }

    /// What another has armed is no longer to be sent.
    fn authority_changed(&mut self, now: Timestamp, before: &AuthorityReport, who: &str) {
        if self.authority.report(now).epoch == before.epoch {
            return;
        }
        let others: Vec<String> = self.book.armed_by_others(who);
        for id in others {
            self.book.disarm(now, &id, who, "the authority to command has passed on");
        }
        self.publish_events();
        let text = match &before.holder {
            Some(holder) => format!("took the authority to command over from {holder}"),
            None => "has the authority to command".into(),
        };
        let taken = before.holder.is_some();
        let level = if taken { EventLevel::Caution } else { EventLevel::Info };
        self.notice(now, level, who, &text);
        self.report_link();
    }

    /// Stops the rover. Always taken, in every state of link and log; first it goes to the link,
    /// then everything else happens.
    pub fn estop(&mut self, now: Timestamp, who: &str) -> EstopAnswer {
        let now = self.tick(now);
        let takes_effect = self.estop_arrives(now);
        let release_under_way = self.estop.state() == EstopState::ReleaseSent;
        let uplink = Uplink::Estop { id: self.estop.stop(now, takes_effect) };
        if let Err(full) = self.offer_up(now, LinkClass::Estop, uplink.clone()) {
            tracing::warn!("an E-stop more was not sent: {full}, all of them E-stops");
        }
        if release_under_way {
            // It may overtake the release; then this second one, behind the release, stops again.
            let behind = self.offer_up(now, LinkClass::Command, uplink.clone());
            tracing::debug!("second E-stop behind the release: {behind:?}");
        }
        self.wake.notify_one();
        let light = self.light_times(now);
        self.estop.expect_word(now, light.up_s + light.down_s + light.spread_s);
        for pending in std::mem::take(&mut self.pending) {
            let why = "an E-stop came before it was handed to the link";
            self.book.withdraw(now, &pending.id, CommandState::Aborted, why);
            // Who no longer waits needs no answer.
            let _ = pending.done.send(Err(CommandError::EstopInForce));
        }
        self.book.disarm_all(now, who, "E-stop");
        self.publish_events();
        self.put_durable(channel::COMMAND_UPLINK, now, &uplink);
        self.notice(now, EventLevel::Critical, who, "E-stop sent");
        self.report_link();
        EstopAnswer { state: self.estop.state(), takes_effect, token: None }
    }

    /// Releases an E-stop in two steps: without a token it answers with one, valid for 10 s; with
    /// that token it sends the release.
    pub fn estop_release(
        &mut self,
        now: Timestamp,
        who: &str,
        token: Option<&str>,
    ) -> Result<EstopAnswer, EstopError> {
        let now = self.tick(now);
        let takes_effect = self.estop_arrives(now);
        let Some(token) = token else {
            let token = Some(self.estop.ask_release(now)?);
            return Ok(EstopAnswer { state: self.estop.state(), takes_effect, token });
        };
        let uplink = Uplink::EstopRelease { id: self.estop.release(now, token, takes_effect)? };
        if self.offer_up(now, LinkClass::Command, uplink.clone()).is_err() {
            self.estop.take_back_release();
            return Err(EstopError::QueueFull);
        }
        self.wake.notify_one();
        self.put_durable(channel::COMMAND_UPLINK, now, &uplink);
        self.notice(now, EventLevel::Caution, who, "E-stop release sent");
        self.report_link();
        Ok(EstopAnswer { state: self.estop.state(), takes_effect, token: None })
    }

    /// Changes the link for what is transmitted from now on. A direction that `link` leaves out stays
    /// as it is, apart from its light time.
    pub fn set_link(
        &mut self,
        now: Timestamp,
        who: &str,
        link: LinkConfig,
    ) -> Result<LinkReport, LinkError> {
        let kept = |model: Option<DirectionModel>, present: &Settings| {
            let fixed = || DirectionModel { light_times: Vec::new(), ..present.model().clone() };
            Some(model.unwrap_or_else(fixed))
        };
        let link = LinkConfig {
            up: kept(link.up, self.up.settings()),
            down: kept(link.down, self.down.settings()),
            ..link
        };
        let [up, down] = link::check(&link)?;
        let now = self.tick(now);
        let before = self.light_times(now);
        self.up.set(now, up);
        self.down.set(now, down);
        let after = self.light_times(now);
        let grown_s = after.down_s + after.spread_s - before.down_s - before.spread_s;
        if grown_s > 0.0 {
            self.book.allow_longer(now, who, grown_s);
        }
        self.tell_silences(now, who);
        let times = self.command_times(now);
        self.book.reconsider(now, who, times);
        self.publish_events();
        let mut text = format!("link delay set to {} s up, {} s down", after.up_s, after.down_s);
        for (name, direction) in [("up", self.up.settings()), ("down", self.down.settings())] {
            if direction.beyond_delay().is_some() {
                text += &format!("; a model beyond delay {name}");
            }
        }
        self.notice(now, EventLevel::Info, who, &text);
        self.report_link();
        self.wake.notify_one();
        Ok(self.link())
    }

    /// Exchanges the rover, as when the simulated one is seated on another terrain. What the old
    /// one has said still arrives.
    pub fn replace_rover(
        &mut self,
        now: Timestamp,
        who: &str,
        adapter: Box<dyn RoverAdapter>,
    ) -> Result<(), RoverBusy> {
        let now = self.tick(now);
        if self.estop.in_force() || self.book.is_busy() {
            return Err(RoverBusy);
        }
        self.listen(now);
        self.adapter = adapter;
        self.notice(now, EventLevel::Info, who, "the rover was placed anew");
        Ok(())
    }

    /// Waits for the disk, then hands to the link what waited for it. Blocks; for tools and tests,
    /// [`super::run`] does it without.
    pub fn release_blocking(&mut self, now: Timestamp) {
        let now = self.tick(now);
        while let Some(pending) = self.pending.pop_front() {
            let Pending { id, uplink, written, done } = pending;
            let outcome = written.wait_blocking().map_err(log_error);
            // Who no longer waits needs no answer.
            let _ = done.send(self.release(now, &id, uplink, outcome));
        }
    }

    /// Hands to the link, in order, what the log has.
    pub(super) fn release_written(&mut self, now: Timestamp) {
        while let Some(mut pending) = self.pending.pop_front() {
            let Some(outcome) = pending.written.poll() else {
                self.pending.push_front(pending);
                return;
            };
            let Pending { id, uplink, done, .. } = pending;
            // Who no longer waits needs no answer.
            let _ = done.send(self.release(now, &id, uplink, outcome.map_err(log_error)));
        }
    }

    fn release(
        &mut self,
        now: Timestamp,
        id: &str,
        uplink: Uplink,
        logged: Result<(), CommandError>,
    ) -> Result<CommandRecord, CommandError> {
        if let Err(error) = logged {
            return Err(self.not_sent(now, id, CommandState::Failed, error));
        }
        // The one place that all commands pass: whoever sent it must still have the authority.
        if let Uplink::Command { epoch: Some(epoch), .. } = &uplink
            && let Err(error) = self.authority.check(now, *epoch)
        {
            return Err(self.not_sent(now, id, CommandState::Failed, error.into()));
        }
        let order = match &uplink {
            Uplink::Command { body: CommandBody::Image(order), .. } => Some(order.clone()),
            _ => None,
        };
        if self.offer_up(now, LinkClass::Command, uplink).is_err() {
            let error = CommandError::QueueFull { what: "the link is" };
            return Err(self.not_sent(now, id, CommandState::Failed, error));
        }
        if let Some(order) = order {
            self.images.expect(now, id, &order);
        }
        let unknown = || CommandError::Unknown { id: id.into() };
        self.book.get(id).cloned().ok_or_else(unknown)
    }

    /// The one way to the transmitter.
    pub(super) fn offer_up(
        &mut self,
        now: Timestamp,
        class: LinkClass,
        uplink: Uplink,
    ) -> Result<(), link::QueueFull> {
        let bytes = size::of_uplink(&uplink);
        self.up.offer(now, class, bytes, uplink)?;
        self.hear_of_uplinks();
        Ok(())
    }

    fn release_later(&mut self, id: &str, uplink: Uplink, written: Written) -> Release {
        let (done, receiver) = oneshot::channel();
        self.pending.push_back(Pending { id: id.into(), uplink, written, done });
        Release(receiver)
    }

    fn not_sent(
        &mut self,
        now: Timestamp,
        id: &str,
        state: CommandState,
        error: CommandError,
    ) -> CommandError {
        self.book.withdraw(now, id, state, &format!("not sent: {error}"));
        self.publish_events();
        error
    }

    fn logged<T>(&mut self, value: T) -> Logged<T> {
        Logged { value, written: self.publish_events() }
    }

    fn no_estop(&self) -> Result<(), CommandError> {
        if self.estop.in_force() { Err(CommandError::EstopInForce) } else { Ok(()) }
    }

    fn log_must_be_well(&self) -> Result<(), CommandError> {
        match self.recorder.status().error {
            Some(reason) => Err(CommandError::LogUnavailable { reason }),
            None => Ok(()),
        }
    }
}
