//! Ground and a rover that is a process of its own, in virtual time: cut off, killed, restarted.

use std::collections::BTreeMap;
use std::sync::Arc;

use bridge::bus::{Bus, BusItem};
use bridge::carrier::host::RoverHost;
use bridge::carrier::journal::Journal;
use bridge::carrier::{Bounds, End, Identity, RemoteRover, Shared, Side};
use bridge::commands::is_outstanding;
use bridge::ground::Ground;
use bridge::recorder::Recorder;
use bridge::sim_adapter::SimAdapter;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sim::SimRover;
use wire::check::At;
use wire::convert;
use wire::live::{
    AckStage, CarrierState, CommandBody, CommandState, Downlink, JointKnot, LinkConfig, RoverMode,
    Uplink, channel,
};
use wire::time::Timestamp;

use crate::recorder::options;
use crate::support::{FakeRover, FaultyDisk, START, TempDir, after, motion, uuid};
use crate::virtual_wire::{Cut, VirtualWire};

const LIGHT_S: f64 = 1.3;
const STEP_S: f64 = 0.02;

/// S6: 20 cuts of 1 to 30 s, half of them noticed by silence alone.
#[test]
fn over_cuts_of_one_to_thirty_seconds_nothing_is_lost_doubled_or_late() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let folder = TempDir::new("partition");
    let (rover, received) = FakeRover::new();
    let journal = Journal::open(folder.path(), "r", START).unwrap();
    let bounds = Bounds::default();
    let mut host = RoverHost::new(START, Box::new(rover), journal, "r0".into(), "r".into(), bounds);
    let remote = RemoteRover::new(START, "virtual", "g0".into(), "r".into(), bounds);
    let (up, down) = (remote.shared(), host.shared());
    let recorder = Recorder::start_on(Box::new(FaultyDisk::default()), options()).unwrap();
    let bus = Bus::new(1_000_000);
    let mut listener = bus.subscribe().1;
    let link = LinkConfig::delays(LIGHT_S, LIGHT_S);
    let mut ground =
        Ground::new(START, Box::new(remote), link, recorder, bus, Box::new(|_| None)).unwrap();
    let mut wire = VirtualWire::default();
    let (mut number, mut refused, mut slowest_s, mut next_send) = (0, 0, 0.0_f64, 1.0);
    let mut tick = 0_u32;
    let mut now = START;
    let ending = std::cell::Cell::new(false);
    let mut until = |seconds: f64, ground: &mut Ground, wire: &mut VirtualWire, rng: &mut _| {
        let end = now.plus_seconds(seconds);
        while now < end {
            tick += 1;
            now = after(f64::from(tick) * STEP_S);
            host.step(now).unwrap();
            wire.step(now, &up, &down, rng);
            ground.step(now);
            let busy = ground
                .commands()
                .records()
                .any(|r| is_outstanding(r.state) && r.state != CommandState::Overdue);
            if now.seconds_since(START) < next_send || busy || ending.get() {
                continue;
            }
            next_send = now.seconds_since(START) + rng.random_range(0.3..3.0);
            number += 1;
            let staged = ground.stage(now, motion(&uuid(number), 1.0, None)).unwrap();
            staged.written_blocking().unwrap();
            ground.arm(now, &uuid(number), "ada").unwrap().written_blocking().unwrap();
            match ground.send(now, &uuid(number), "ada") {
                Ok(_) => ground.release_blocking(now),
                Err(error) => {
                    assert_eq!(error.code(), "rover_unreachable");
                    assert_ne!(ground.carrier().unwrap().state, CarrierState::Up);
                    let cancelled = ground.cancel(now, &uuid(number), "ada").unwrap();
                    cancelled.written_blocking().unwrap();
                    refused += 1;
                }
            }
        }
        now
    };
    until(5.0, &mut ground, &mut wire, &mut rng);
    for cut in 0..20 {
        let how = if cut % 2 == 0 { Cut::Closed } else { Cut::Silent };
        let length_s = rng.random_range(1.0..30.0);
        let at = until(rng.random_range(2.0..12.0), &mut ground, &mut wire, &mut rng);
        wire.cut(how, at.plus_seconds(length_s));
        let over = until(length_s, &mut ground, &mut wire, &mut rng);
        // Fresh telemetry is back within 5 s and one light time.
        let mut at = over;
        while ground.latest().unwrap().onboard_time <= over {
            at = until(STEP_S, &mut ground, &mut wire, &mut rng);
            assert!(at.seconds_since(over) < 5.0 + LIGHT_S, "cut {cut}: not back");
        }
        slowest_s = slowest_s.max(at.seconds_since(over));
    }
    ending.set(true);
    let end = until(40.0, &mut ground, &mut wire, &mut rng);
    assert_eq!(ground.carrier().unwrap().state, CarrierState::Up);

    // The rover got no command twice, and what each came to is the truth.
    let mut got = BTreeMap::new();
    for (_, uplink) in received.lock().unwrap().iter() {
        if let Uplink::Command { id, .. } = uplink {
            *got.entry(id.clone()).or_insert(0) += 1;
        }
    }
    assert!(got.values().all(|n| *n == 1), "twice: {got:?}");
    let mut counts = BTreeMap::new();
    for record in ground.commands().records() {
        let arrived = got.contains_key(&record.id);
        *counts.entry(format!("{:?}", record.state)).or_insert(0) += 1;
        match record.state {
            CommandState::Done => assert!(arrived, "{record:?}"),
            CommandState::Expired | CommandState::Cancelled => assert!(!arrived, "{record:?}"),
            other => panic!("{other:?} in the end: {record:?}"),
        }
    }
    // All frames, in order, each once.
    let mut frames = Vec::new();
    while let Some(item) = listener.try_next() {
        let BusItem::Message(message) = item else { panic!("a gap") };
        if &*message.channel == channel::ROVER_STATE {
            frames.push(message.onboard_time);
        }
    }
    let expected: Vec<Timestamp> = (0..frames.len())
        .scan(START, |next, _| {
            let at = *next;
            *next = next.plus_seconds(0.1);
            Some(at)
        })
        .collect();
    assert_eq!(frames, expected);
    assert!(end.seconds_since(*frames.last().unwrap()) < LIGHT_S + 0.5);
    let link = ground.link();
    for counters in [link.up, link.down] {
        assert_eq!(
            counters.sent + counters.duplicated,
            counters.delivered + counters.dropped + counters.in_flight
        );
    }
    eprintln!(
        "20 cuts: {} frames, {counts:?}, {refused} not sent; fresh telemetry at most {slowest_s:.2} s \
         after the end of a cut",
        frames.len()
    );
    assert!(counts["Done"] > 20);
}

fn standing() -> SimRover {
    let map = terrain::ElevationMap::plane(20.0, 0.5).unwrap();
    let robot = Arc::new(crate::sim_adapter::athlete());
    let scene = collision::Scene::new(robot, map, &[]).unwrap();
    let middle = nalgebra::Point2::origin();
    let settled = sim::settle(&scene, middle, 0.0, "bent", &Default::default()).unwrap();
    SimRover::new(scene, settled.configuration, 1.62).unwrap()
}

fn hold(id: &str, leg: &str, joints: &[f64], seconds: f64, turn: f64) -> Uplink {
    let mut to = joints.to_vec();
    to[1] -= turn;
    let knots = vec![
        JointKnot { joints_rad: joints.to_vec(), time_s: 0.0 },
        JointKnot { joints_rad: to, time_s: seconds },
    ];
    Uplink::Command {
        id: id.into(),
        body: CommandBody::JointPath { leg: leg.into(), knots },
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        epoch: Some(3),
        preconditions: Vec::new(),
    }
}

/// The rover's process dies in the middle of a step, again and again, and with an E-stop in force.
#[test]
fn a_rover_that_is_killed_remembers_where_it_is_what_it_did_and_that_it_is_stopped() {
    let folder = TempDir::new("journal");
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let bounds = Bounds::default();
    let identity = Identity { side: Side::Ground, run: "g0".into(), robot: "r".into() };
    let up = Arc::new(Shared::new(End::new(START, identity, bounds)));
    let host = |now: Timestamp, run: u32| {
        let journal = Journal::open(folder.path(), "r", now).unwrap();
        let mut rover = standing();
        if let Some(place) = &journal.memory().place {
            let robot = rover.scene().robot().clone();
            let at = convert::configuration(&At::root("state"), &robot, &place.state).unwrap();
            rover = SimRover::new(rover.scene().clone(), at, 1.62).unwrap();
        }
        journal.memory().recall(&mut rover);
        let adapter = Box::new(SimAdapter::new(now, rover));
        RoverHost::new(now, adapter, journal, format!("r{run}"), "r".into(), bounds)
    };
    let mut heard: Vec<Downlink> = Vec::new();
    let mut wire = VirtualWire::default();
    let mut now = START;
    let run_for = |seconds: f64,
                   now: &mut Timestamp,
                   host: &mut RoverHost,
                   wire: &mut VirtualWire,
                   heard: &mut Vec<Downlink>,
                   rng: &mut ChaCha8Rng| {
        let end = now.plus_seconds(seconds);
        while *now < end {
            *now = now.plus_seconds(0.05);
            host.step(*now).unwrap();
            wire.step(*now, &up, &host.shared(), rng);
            heard.extend(up.end().take_received().into_iter().map(|said| said.unwrap().message));
        }
    };
    let last_frame = |heard: &[Downlink]| {
        let frames = heard.iter().rev().filter_map(|message| match message {
            Downlink::Telemetry(frame) => Some(frame.clone()),
            _ => None,
        });
        frames.into_iter().next().unwrap()
    };
    let words = |heard: &[Downlink], of: &str| -> Vec<AckStage> {
        let word = |message: &Downlink| match message {
            Downlink::Ack { id, stage, .. } if id == of => Some(*stage),
            _ => None,
        };
        heard.iter().filter_map(word).collect()
    };
    let die = |wire: &mut VirtualWire, now: Timestamp| {
        let why = bridge::carrier::CarrierError::Connection("killed".into());
        up.end().close(now, &why);
        wire.reset();
    };
    let mut rover = host(now, 0);
    run_for(1.0, &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
    let mut ids = Vec::new();
    for kill in 1..=6_u32 {
        let before = last_frame(&heard);
        assert_eq!(before.mode, RoverMode::Idle, "kill {kill}");
        let id = uuid(u64::from(kill));
        let joints = &before.state.joints_rad["leg1"];
        let turn = if kill % 2 == 1 { 0.12 } else { -0.05 };
        up.end().push(now, hold(&id, "leg1", joints, 4.0, turn));
        run_for(1.0 + 0.2 * f64::from(kill), &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
        assert!(
            words(&heard, &id).contains(&AckStage::Started),
            "kill {kill}: {:?}",
            words(&heard, &id)
        );
        let moving = last_frame(&heard);
        assert_eq!(moving.mode, RoverMode::Executing);
        die(&mut wire, now);
        drop(rover);
        rover = host(now, kill);
        heard.clear();
        run_for(2.0, &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
        let after_it = last_frame(&heard);
        assert_eq!(after_it.mode, RoverMode::Idle);
        for (leg, joints) in &after_it.state.joints_rad {
            for (a, b) in joints.iter().zip(&moving.state.joints_rad[leg]) {
                // One frame may have been written that was not heard any more.
                assert!((a - b).abs() < 0.01, "kill {kill}: {leg} jumped from {b} to {a}");
            }
        }
        assert_eq!(words(&heard, &id), [AckStage::Aborted], "kill {kill}: told by itself");
        // The same command again, as a copy of what was sent: it does not run.
        up.end().push(now, hold(&id, "leg1", &after_it.state.joints_rad["leg1"], 4.0, turn));
        run_for(1.0, &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
        assert!(!words(&heard, &id).contains(&AckStage::Started), "kill {kill}: ran twice");
        ids.push(id);
    }
    // An older authority stays refused, and a stop in force.
    let joints = last_frame(&heard).state.joints_rad["leg1"].clone();
    let mut old = hold(&uuid(50), "leg1", &joints, 1.0, 0.0);
    if let Uplink::Command { epoch, .. } = &mut old {
        *epoch = Some(2);
    }
    up.end().push(now, old);
    up.end().push(now, Uplink::Estop { id: uuid(60) });
    run_for(0.5, &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
    die(&mut wire, now);
    drop(rover);
    rover = host(now, 99);
    heard.clear();
    run_for(2.0, &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
    assert_eq!(last_frame(&heard).mode, RoverMode::Stopped);
    up.end().push(now, hold(&uuid(61), "leg1", &joints, 1.0, 0.0));
    up.end().push(now, Uplink::EstopRelease { id: uuid(62) });
    run_for(1.0, &mut now, &mut rover, &mut wire, &mut heard, &mut rng);
    assert_eq!(words(&heard, &uuid(61)), [AckStage::Received, AckStage::Rejected]);
    assert_eq!(last_frame(&heard).mode, RoverMode::Idle, "released");
}

#[test]
fn a_memory_that_was_torn_is_used_up_to_there_and_one_of_another_rover_is_refused() {
    let folder = TempDir::new("torn");
    let mut journal = Journal::open(folder.path(), "robot a", START).unwrap();
    for number in 0..50 {
        journal.begin(START, &hold(&uuid(number), "leg1", &[0.0; 6], 1.0, 0.0)).unwrap();
        let (id, stage) = (uuid(number), AckStage::Completed);
        journal.said(START, &Downlink::Ack { id, stage, detail: None }).unwrap();
    }
    let whole = journal.memory().clone();
    drop(journal);
    let path = folder.path().join("rover.journal");
    let bytes = std::fs::read(&path).unwrap();
    for cut in (0..bytes.len()).step_by(37) {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        let opened = Journal::open(folder.path(), "robot a", START).unwrap();
        let known = opened.memory().words.len();
        // Whole lines before the cut are all there: the last may have begun and not ended.
        let begun =
            bytes[..cut].split(|b| *b == b'\n').filter(|l| l.windows(5).any(|w| w == b"begin"));
        assert!(known == begun.clone().count() || known + 1 == begun.count(), "cut at {cut}");
        for (word, expected) in opened.memory().words.iter().zip(&whole.words) {
            assert_eq!(word.id, expected.id);
            assert!(matches!(word.stage, Some(AckStage::Completed | AckStage::Aborted)));
        }
    }
    std::fs::write(&path, &bytes).unwrap();
    let refused = Journal::open(folder.path(), "robot b", START).unwrap_err().to_string();
    assert!(refused.contains("robot a") && refused.contains("--state"), "{refused}");
    assert_eq!(Journal::open(folder.path(), "robot a", START).unwrap().memory(), &whole);
}
