//! Ground and a scripted rover, end to end on a clock of their own.

mod outages;

use std::sync::{Arc, Mutex};

use bridge::adapter::RoverAdapter;
use bridge::bus::{Bus, BusItem, ChannelMessage, Subscription};
use bridge::clock::SystemClock;
use bridge::commands::{AuthorityRules, is_outstanding};
use bridge::ground::{Ground, Release, run};
use bridge::reader::{Limits, LogMessage, read_log};
use bridge::recorder::Recorder;
use wire::live::{
    CommandEvent, CommandRecord, CommandState, DirectionModel, EstopState, LinkConfig, LinkReport,
    Loss, Outage, OutageTraffic, RegionKind, RoverTelemetry, StabilityDerived, Uplink, channel,
};
use wire::time::Timestamp;

use crate::recorder::options;
use crate::support::{FakeRover, FaultyDisk, Received, START, after, motion, uuid};

const MOON: LinkConfig = LinkConfig::delays(1.3, 1.3);

struct Session {
    ground: Ground,
    disk: FaultyDisk,
    received: Received,
    listener: Subscription,
    now: Timestamp,
}

fn derive(frame: &RoverTelemetry) -> Option<StabilityDerived> {
    Some(StabilityDerived {
        com_m: frame.state.base.position_m,
        regular: None,
        conservative: None,
        conservative_kind: RegionKind::Empty,
        settlement_margin_m: None,
        settlement_leg: None,
        torque_ratio: 0.5,
        torque_joint: "leg1".into(),
        torque_ratios: Default::default(),
        forces: None,
    })
}

impl Session {
    fn new(link: LinkConfig) -> Session {
        Session::with(FakeRover::new(), link)
    }

    fn with((rover, received): (FakeRover, Received), link: LinkConfig) -> Session {
        let disk = FaultyDisk::default();
        let recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
        let bus = Bus::new(100_000);
        let listener = bus.subscribe().1;
        let adapter: Box<dyn RoverAdapter> = Box::new(rover);
        let ground = Ground::new(START, adapter, link, recorder, bus, Box::new(derive)).unwrap();
        Session { ground, disk, received, listener, now: START }
    }

    /// Goes on to `seconds` after the start, from event to event.
    fn go_to(&mut self, seconds: f64) {
        while self.now < after(seconds) {
            self.now = self.ground.next_step().max(Timestamp(self.now.0 + 1)).min(after(seconds));
            self.ground.step(self.now);
        }
    }

    fn arm(&mut self, id: &str) {
        let armed = self.ground.arm(self.now, id, "ada").unwrap();
        armed.written_blocking().unwrap();
    }

    /// Stages, arms and sends a motion.
    fn send(&mut self, number: u64, duration_s: f64) -> CommandRecord {
        let staged = self.ground.stage(self.now, motion(&uuid(number), duration_s, None)).unwrap();
        staged.written_blocking().unwrap();
        self.arm(&uuid(number));
        let mut release = self.ground.send(self.now, &uuid(number), "ada").unwrap();
        self.ground.release_blocking(self.now);
        release.poll().unwrap().unwrap()
    }

    fn state(&self, number: u64) -> CommandState {
        self.ground.commands().get(&uuid(number)).unwrap().state
    }

    fn heard(&mut self) -> Vec<Arc<ChannelMessage>> {
        let message = |item| match item {
            BusItem::Message(message) => message,
            BusItem::Gap(missed) => panic!("{missed} messages missed"),
        };
        std::iter::from_fn(|| self.listener.try_next()).map(message).collect()
    }

    /// Ends the session; gives everything that is in its logs.
    fn finish(mut self) -> Vec<LogMessage> {
        self.ground.finish(self.now).unwrap();
        let files = self.disk.files();
        let read = |bytes: &Vec<u8>| read_log(&**bytes, Limits::default()).unwrap();
        files
            .values()
            .map(read)
            .inspect(|c| assert_eq!(c.damage, []))
            .flat_map(|c| c.messages)
            .collect()
    }
}

fn of<'a>(messages: &'a [LogMessage], channel: &str) -> Vec<&'a LogMessage> {
    messages.iter().filter(|m| &*m.channel == channel).collect()
}

fn uplink_ids(received: &Received) -> Vec<(Timestamp, String)> {
    let id = |message: &Uplink| match message {
        Uplink::Command { id, .. } | Uplink::Estop { id } | Uplink::EstopRelease { id } => {
            id.clone()
        }
        Uplink::Heartbeat {} => "heartbeat".into(),
        Uplink::Image(_) => "of images".into(),
    };
    received.lock().unwrap().iter().map(|(at, message)| (*at, id(message))).collect()
}

#[test]
fn a_command_and_its_answers_keep_the_light_times() {
    let mut session = Session::new(MOON);
    session.go_to(1.0);
    let sent = session.send(1, 10.0);
    assert_eq!((sent.state, sent.arrives), (CommandState::Sent, Some(after(2.3))));
    session.go_to(2.299);
    assert_eq!(uplink_ids(&session.received), []);
    session.go_to(3.599);
    assert_eq!(uplink_ids(&session.received), [(after(2.3), uuid(1))]);
    assert_eq!(session.state(1), CommandState::Sent, "the ground cannot know yet");
    session.go_to(3.601);
    assert_eq!(session.state(1), CommandState::Executing);
    session.go_to(13.7);
    assert_eq!(session.state(1), CommandState::Done, "1 + 1.3 + 10 + 1.3 s, told at 13.6 s");
    let events: Vec<CommandEvent> = session
        .heard()
        .iter()
        .filter(|m| &*m.channel == channel::COMMAND_EVENT)
        .map(|m| serde_json::from_slice(&m.json).unwrap())
        .collect();
    let done = events.last().unwrap();
    assert_eq!((done.state, done.time), (CommandState::Done, after(13.6)));
}

#[test]
fn telemetry_comes_one_light_time_late_with_what_is_derived_from_it() {
    let mut session = Session::new(LinkConfig::delays(0.0, 5.0));
    session.go_to(20.0);
    let heard = session.heard();
    let frames: Vec<_> = heard.iter().filter(|m| &*m.channel == channel::ROVER_STATE).collect();
    assert_eq!(frames.len(), 151, "10 Hz from 0 to 15 s on board");
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame.sequence, i as u64 + 1);
        assert_eq!(frame.onboard_time, frame.sent_time);
        assert_eq!(frame.received_time, frame.sent_time.plus_seconds(5.0), "to the nanosecond");
    }
    let derived = heard.iter().filter(|m| &*m.channel == channel::ROVER_STABILITY).count();
    assert_eq!(derived, frames.len());
    let latest = session.ground.latest().unwrap();
    assert_eq!((latest.onboard_time, latest.received_time), (after(15.0), after(20.0)));
    assert!(session.ground.stability().is_some());
}

#[test]
fn delays_change_while_running_and_the_link_reports_it() {
    let mut session = Session::new(MOON);
    session.go_to(1.0);
    session.send(1, 1.0);
    let report = session.ground.set_link(after(1.0), "ada", LinkConfig { up_delay_s: 5.0, ..MOON });
    assert_eq!(report.unwrap().config.up_delay_s, 5.0);
    session.go_to(20.0);
    assert_eq!(uplink_ids(&session.received), [(after(2.3), uuid(1))], "under way already");
    session.send(2, 1.0);
    session.go_to(26.0);
    assert_eq!(uplink_ids(&session.received)[1], (after(25.0), uuid(2)));
    let bad = LinkConfig { down_delay_s: 1801.0, ..MOON };
    let refused = session.ground.set_link(after(26.0), "ada", bad).unwrap_err();
    assert_eq!(refused.field, "down_delay_s");
    let heard = session.heard();
    let reports = heard.iter().filter(|m| &*m.channel == channel::LINK);
    let reports: Vec<LinkReport> =
        reports.map(|m| serde_json::from_slice(&m.json).unwrap()).collect();
    assert!(reports.len() >= 26, "once a second, and on change: {}", reports.len());
    for LinkReport { up, down, .. } in reports {
        for line in [up, down] {
            assert_eq!(line.sent, line.delivered + line.dropped + line.in_flight);
        }
    }
}

#[test]
fn an_estop_overtakes_a_thousand_commands_that_wait() {
    let mut session = Session::new(MOON);
    session.go_to(1.0);
    // The log takes nothing, so every command waits on the ground.
    let stall = session.disk.stall();
    let mut releases: Vec<Release> = Vec::new();
    for number in 0..1000 {
        let staged = session.ground.stage(session.now, motion(&uuid(number), 1.0, None)).unwrap();
        let id = staged.unlogged().id;
        let _ = session.ground.arm(session.now, &id, "ada").unwrap().unlogged();
        releases.push(session.ground.send(session.now, &id, "ada").unwrap());
    }
    session.ground.step(session.now);
    assert_eq!(session.ground.link().up.sent, 0, "nothing goes up before the log has it");
    let answer = session.ground.estop(session.now, "eve");
    assert_eq!((answer.state, answer.takes_effect), (EstopState::Sent, after(2.3)));
    session.go_to(2.4);
    let received = session.received.lock().unwrap().clone();
    assert!(matches!(received[..], [(at, Uplink::Estop { .. })] if at == after(2.3)), "at once");
    drop(stall);
    session.go_to(6.0);
    assert_eq!(uplink_ids(&session.received).len(), 1, "and none of the commands follows");
    for (number, mut release) in releases.into_iter().enumerate() {
        assert_eq!(release.poll().unwrap().unwrap_err().code(), "estop_in_force");
        assert_eq!(session.state(number as u64), CommandState::Aborted);
    }
    assert_eq!(session.ground.link().estop, EstopState::Confirmed);
    let refused = session.ground.stage(session.now, motion(&uuid(7000), 1.0, None)).unwrap();
    let id = refused.written_blocking().unwrap().id;
    assert_eq!(session.ground.arm(session.now, &id, "ada").unwrap_err().code(), "estop_in_force");
}

#[test]
fn an_estop_passes_commands_that_arrive_at_the_same_instant() {
    let mut session = Session::new(MOON);
    session.go_to(1.0);
    for number in 0..20 {
        session.send(number, 1.0);
    }
    session.ground.estop(session.now, "eve");
    session.go_to(5.0);
    let first = session.received.lock().unwrap()[0].1.clone();
    assert!(matches!(first, Uplink::Estop { .. }), "{first:?}");
    for number in 0..20 {
        assert_eq!(session.state(number), CommandState::Failed, "rejected by the stopped rover");
    }
}

#[test]
fn an_estop_is_released_in_two_steps_and_a_new_one_wins_over_a_release_under_way() {
    let mut session = Session::new(MOON);
    session.send(1, 60.0);
    session.go_to(5.0);
    assert_eq!(session.state(1), CommandState::Executing);
    session.ground.estop(session.now, "eve");
    session.go_to(8.0);
    assert_eq!(session.state(1), CommandState::Aborted);
    let release = |session: &mut Session| {
        let asked = session.ground.estop_release(session.now, "ada", None).unwrap();
        let token = asked.token.unwrap();
        session.ground.estop_release(session.now, "ada", Some(&token)).unwrap()
    };
    assert_eq!(release(&mut session).state, EstopState::ReleaseSent);
    session.go_to(11.0);
    assert_eq!(session.ground.link().estop, EstopState::Clear);
    session.ground.estop(session.now, "eve");
    session.go_to(14.0);
    // A release is under way for long when a much faster E-stop overtakes it.
    let slow = LinkConfig { up_delay_s: 100.0, ..MOON };
    session.ground.set_link(session.now, "ada", slow).unwrap();
    release(&mut session);
    session.ground.set_link(session.now, "ada", MOON).unwrap();
    session.ground.estop(session.now, "eve");
    session.go_to(200.0);
    let received = session.received.lock().unwrap().clone();
    let last = &received[received.len() - 3..];
    assert!(matches!(last[0], (at, Uplink::Estop { .. }) if at == after(15.3)));
    assert!(matches!(last[1], (at, Uplink::EstopRelease { .. }) if at == after(114.0)));
    assert!(matches!(last[2], (at, Uplink::Estop { .. }) if at == after(114.0)), "stops again");
    assert_eq!(session.ground.link().estop, EstopState::Confirmed);
}

#[test]
fn an_estop_is_repeated_until_the_rover_confirms_it_and_commands_are_not() {
    let mut session = Session::new(MOON);
    let lossy = |probability| LinkConfig {
        up: Some(DirectionModel {
            loss: Loss::Bernoulli { probability },
            ..DirectionModel::default()
        }),
        ..MOON
    };
    session.ground.set_link(session.now, "ada", lossy(1.0)).unwrap();
    session.send(1, 1.0);
    session.ground.estop(session.now, "eve");
    session.go_to(30.0);
    assert_eq!(uplink_ids(&session.received), [], "everything is lost");
    assert_eq!(session.ground.link().estop, EstopState::Sent);
    // One every round trip and 2 s more: at 0, 4.6, 9.2, ... 27.6 s; and one command.
    assert_eq!(session.ground.link().up.dropped_by.loss, 7 + 1);
    session.ground.set_link(session.now, "ada", lossy(0.0)).unwrap();
    session.go_to(60.0);
    assert_eq!(session.ground.link().estop, EstopState::Confirmed);
    let received = session.received.lock().unwrap().clone();
    assert!(matches!(received[..], [(_, Uplink::Estop { .. })]), "{received:?}");
    assert_eq!(session.state(1), CommandState::Overdue);
}

#[test]
fn heartbeats_go_up_as_often_as_told() {
    let mut session = Session::new(MOON);
    session.ground.configure(AuthorityRules::default(), Some(5.0));
    session.go_to(31.0);
    let received = session.received.lock().unwrap().clone();
    assert!(received.iter().all(|(_, uplink)| *uplink == Uplink::Heartbeat {}));
    assert!((5..=6).contains(&received.len()), "{}", received.len());
}

#[test]
fn a_command_that_waits_too_long_for_the_link_expires_and_never_arrives() {
    let mut session = Session::new(MOON);
    let mut model = DirectionModel::default();
    let (begin, end) = (after(0.0), after(60.0));
    model.outages = vec![Outage { begin, end, traffic: OutageTraffic::Hold }];
    model.queues.command.ttl_s = Some(10.0);
    session.ground.set_link(START, "ada", LinkConfig { up: Some(model), ..MOON }).unwrap();
    session.send(1, 1.0);
    session.go_to(9.9);
    assert_eq!(session.state(1), CommandState::Sent, "it waits, and is not overdue");
    session.go_to(10.2);
    assert_eq!(session.state(1), CommandState::Expired);
    session.send(2, 1.0);
    session.ground.estop(session.now, "eve");
    session.go_to(70.0);
    let received = session.received.lock().unwrap().clone();
    assert!(matches!(received.first(), Some((at, Uplink::Estop { .. })) if *at == after(61.3)));
    assert!(!uplink_ids(&session.received).iter().any(|(_, id)| *id == uuid(1)));
}

#[test]
fn silence_of_the_rover_makes_its_command_overdue() {
    let mut session = Session::with(FakeRover::mute(), MOON);
    session.send(1, 10.0);
    session.go_to(4.5);
    assert_eq!(session.state(1), CommandState::Sent);
    session.go_to(5.0);
    assert_eq!(session.state(1), CommandState::Overdue);
    session.go_to(100.0);
    assert_eq!(uplink_ids(&session.received).len(), 1, "nothing is sent again");
}

#[test]
fn without_a_log_no_command_goes_but_the_estop_does() {
    let mut session = Session::new(MOON);
    session.go_to(1.0);
    session
        .ground
        .stage(session.now, motion(&uuid(1), 1.0, None))
        .unwrap()
        .written_blocking()
        .unwrap();
    session.arm(&uuid(1));
    session.disk.set_room(Some(0));
    let mut release = session.ground.send(session.now, &uuid(1), "ada").unwrap();
    session.ground.release_blocking(session.now);
    assert_eq!(release.poll().unwrap().unwrap_err().code(), "log_unavailable");
    assert_eq!(session.state(1), CommandState::Failed);
    let refused = session.ground.stage(session.now, motion(&uuid(2), 1.0, None)).unwrap_err();
    assert_eq!(refused.code(), "log_unavailable");
    session.ground.estop(session.now, "eve");
    session.go_to(2.5);
    assert!(matches!(session.received.lock().unwrap()[..], [(_, Uplink::Estop { .. })]));
    session.disk.set_room(None);
    // The event and notices that the disk refused are kept; the end of the session writes them.
    session.go_to(6.0);
    let logged = session.finish_with_torn();
    let uplinks: Vec<Uplink> = of(&logged, channel::COMMAND_UPLINK)
        .iter()
        .map(|m| serde_json::from_slice(&m.data).unwrap())
        .collect();
    assert!(matches!(uplinks.last(), Some(Uplink::Estop { .. })), "and the log knows of it");
}

impl Session {
    /// As `finish`, for disks that have failed: files without an end are expected.
    fn finish_with_torn(mut self) -> Vec<LogMessage> {
        let _ = self.ground.finish(self.now);
        let files = self.disk.files();
        let read = |bytes: &Vec<u8>| read_log(&**bytes, Limits::default()).unwrap();
        files.values().flat_map(|bytes| read(bytes).messages).collect()
    }
}

#[test]
fn everything_heard_is_in_the_log_byte_for_byte_and_uplinks_come_before_the_rover_has_them() {
    let mut session = Session::new(MOON);
    for number in 0..20 {
        session.go_to(number as f64 * 4.0);
        session.send(number, 2.0);
    }
    session.go_to(90.0);
    let (heard, received) = (session.heard(), uplink_ids(&session.received));
    let logged = session.finish();
    assert_eq!(heard.len(), logged.len());
    for (heard, logged) in heard.iter().zip(&logged) {
        assert_eq!((&heard.channel, &heard.json), (&logged.channel, &logged.data));
        assert_eq!(
            (heard.received_time, heard.onboard_time),
            (logged.log_time, logged.publish_time)
        );
    }
    assert!(logged.is_sorted_by_key(|m| m.log_time), "times never go back in the log");
    let uplinks = of(&logged, channel::COMMAND_UPLINK);
    assert_eq!(uplinks.len(), received.len());
    for (uplink, (at, _)) in uplinks.iter().zip(&received) {
        assert!(at.seconds_since(uplink.log_time) >= 1.3, "nothing arrives before its light time");
    }
}

#[test]
fn the_rover_is_exchanged_only_while_nothing_is_under_way() {
    let mut session = Session::new(MOON);
    session.send(1, 1.0);
    let busy = session.ground.replace_rover(START, "ada", Box::new(FakeRover::new().0));
    assert_eq!(busy.unwrap_err().code(), "rover_busy");
    session.go_to(5.0);
    session.ground.replace_rover(session.now, "ada", Box::new(FakeRover::new().0)).unwrap();
    session.go_to(10.0);
    assert!(session.ground.latest().unwrap().onboard_time > after(8.0));
}

#[test]
fn two_runs_of_one_script_leave_the_same_log() {
    let run = || {
        let mut session = Session::new(MOON);
        session.send(1, 3.0);
        session.go_to(4.0);
        session
            .ground
            .set_link(session.now, "ada", LinkConfig { down_delay_s: 2.0, ..MOON })
            .unwrap();
        session.go_to(20.0);
        session.finish()
    };
    assert_eq!(run(), run());
}

#[tokio::test(start_paused = true)]
async fn the_loop_drives_a_command_to_its_end_in_paused_time() {
    let (rover, _) = FakeRover::new();
    let disk = FaultyDisk::default();
    let recorder = Recorder::start_on(Box::new(disk), options()).unwrap();
    let (bus, derive) = (Bus::new(10_000), Box::new(derive));
    let (_, mut listener) = bus.subscribe();
    let ground = Ground::new(START, Box::new(rover), MOON, recorder, bus, derive).unwrap();
    let ground = Arc::new(Mutex::new(ground));
    let clock = Arc::new(SystemClock::starting_at(START));
    let driver = tokio::spawn(run(ground.clone(), clock));
    // The disk runs on real time, so paused time races ahead while the log is awaited: arm and send
    // without that wait here, which a route never does.
    let release = {
        let mut ground = ground.lock().unwrap();
        ground.stage(START, motion(&uuid(1), 2.0, None)).unwrap().unlogged();
        let _ = ground.arm(START, &uuid(1), "ada").unwrap().unlogged();
        ground.send(START, &uuid(1), "ada").unwrap()
    };
    assert!(is_outstanding(release.wait().await.unwrap().state));
    let state = || ground.lock().unwrap().commands().get(&uuid(1)).unwrap().state;
    while state() != CommandState::Done {
        listener.next().await.unwrap();
    }
    driver.abort();
}
