//! The carrier in virtual time: what is said over it, whatever is cut off, damaged or restarted.
//!
//! `FOOTFALL_FULL=1`: ten times as many histories.

use std::collections::BTreeSet;
use std::sync::Arc;

use bridge::carrier::host::RoverEnd;
use bridge::carrier::{
    Body, Bounds, CarrierError, Decoder, End, Fate, GroundEnd, Hello, Identity, PROTOCOL, Said,
    Shared, Side, encode,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{AckStage, CarrierState, CommandBody, Downlink, RoverMode, Uplink};
use wire::time::Timestamp;

use crate::support::{START, after, cases, frame, uuid};
use crate::virtual_wire::{Cut, VirtualWire};

fn ground(now: Timestamp, run: &str) -> Arc<GroundEnd> {
    let identity = Identity { side: Side::Ground, run: run.into(), robot: "r".into() };
    Arc::new(Shared::new(End::new(now, identity, Bounds::default())))
}

fn rover(now: Timestamp, run: &str) -> Arc<RoverEnd> {
    let identity = Identity { side: Side::Rover, run: run.into(), robot: "r".into() };
    Arc::new(Shared::new(End::new(now, identity, Bounds::default())))
}

fn command(number: u64) -> Uplink {
    Uplink::Command {
        id: uuid(number),
        body: CommandBody::Stop {},
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        epoch: None,
        preconditions: Vec::new(),
    }
}

fn id(uplink: &Uplink) -> &str {
    match uplink {
        Uplink::Command { id, .. } | Uplink::Estop { id } | Uplink::EstopRelease { id } => id,
        _ => "",
    }
}

fn word(at: Timestamp, number: u64) -> Said {
    let (id, stage) = (uuid(number), AckStage::Completed);
    Said { at, message: Downlink::Ack { id, stage, detail: None } }
}

/// What was said and heard in a history.
#[derive(Default)]
struct Heard {
    commands: Vec<String>,
    handed: BTreeSet<String>,
    never: BTreeSet<String>,
    unknown: BTreeSet<String>,
    said: Vec<String>,
    words: Vec<String>,
}

impl Heard {
    fn collect(&mut self, ground: &GroundEnd, rover: &RoverEnd) {
        for message in rover.end().take_received() {
            self.commands.push(id(&message.unwrap()).to_owned());
        }
        for message in ground.end().take_received() {
            match message.unwrap().message {
                Downlink::Ack { id, .. } => self.words.push(id),
                Downlink::Telemetry(frame) => self.words.push(frame.fault.unwrap()),
                Downlink::Image(_) => unreachable!("nobody asked for images"),
            }
        }
        for (uplink, fate) in ground.end().take_lost() {
            let set = match fate {
                Fate::NeverArrived(_) => &mut self.never,
                Fate::Unknown => &mut self.unknown,
            };
            assert!(set.insert(id(&uplink).to_owned()), "told twice");
        }
    }
}

/// One history of cuts, damage and, with `restarts`, ends that are other processes than before.
fn history(seed: u64, restarts: bool) -> Heard {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut up, mut down) = (ground(START, "g0"), rover(START, "r0"));
    let mut wire = VirtualWire::default();
    wire.damage = 0.002;
    let mut heard = Heard::default();
    let (mut number, mut runs, mut time_s) = (0, 0, 0.0);
    let end_s = 60.0;
    while time_s < end_s + 30.0 {
        time_s += rng.random_range(0.005..0.15);
        let now = after(time_s);
        if time_s < end_s {
            if rng.random_bool(0.2) {
                number += 1;
                heard.handed.insert(uuid(number));
                up.end().push(now, command(number));
            }
            if rng.random_bool(0.5) {
                number += 1;
                heard.said.push(uuid(number));
                let mut telemetry = frame(RoverMode::Idle, None);
                telemetry.fault = Some(uuid(number));
                let said = Said { at: now, message: Downlink::Telemetry(telemetry) };
                let said = if rng.random_bool(0.5) { word(now, number) } else { said };
                down.end().push(now, said);
            }
            if rng.random_bool(0.01) {
                let how = if rng.random_bool(0.5) { Cut::Closed } else { Cut::Silent };
                wire.cut(how, now.plus_seconds(rng.random_range(0.1..20.0)));
            }
            if restarts && rng.random_bool(0.01) {
                runs += 1;
                heard.collect(&up, &down);
                let died = CarrierError::Connection("the process died".into());
                if rng.random_bool(0.5) {
                    up = ground(now, &format!("g{runs}"));
                    down.end().close(now, &died);
                } else {
                    down = rover(now, &format!("r{runs}"));
                    up.end().close(now, &died);
                }
                wire.reset();
            }
        }
        if time_s >= end_s {
            wire.damage = 0.0;
        }
        wire.step(now, &up, &down, &mut rng);
        // At times nobody takes what has come.
        if rng.random_bool(0.7) {
            heard.collect(&up, &down);
        }
    }
    heard.collect(&up, &down);
    assert_eq!(up.end().state().0, CarrierState::Up, "seed {seed}");
    if !restarts {
        for counters in [up.end().counters(), down.end().counters()] {
            assert_eq!(
                counters.sent,
                counters.confirmed + counters.withdrawn + counters.dropped,
                "seed {seed}: {counters:?}"
            );
            assert_eq!((counters.waiting, counters.unconfirmed), (0, 0), "seed {seed}");
        }
        assert!(up.end().counters().connections >= 1);
    }
    heard
}

fn increasing(ids: &[String]) -> bool {
    ids.windows(2).all(|pair| pair[0] < pair[1])
}

#[test]
fn over_cuts_and_damage_every_message_arrives_once_and_in_order_or_is_told_as_taken_back() {
    let (mut messages, mut taken_back) = (0, 0);
    for seed in 0..cases(1000) {
        let heard = history(seed, false);
        assert_eq!(heard.words, heard.said, "seed {seed}: down, nothing lost, in order");
        assert!(increasing(&heard.commands), "seed {seed}: up, once and in order");
        let arrived: BTreeSet<String> = heard.commands.iter().cloned().collect();
        assert!(arrived.is_disjoint(&heard.never), "seed {seed}");
        assert_eq!(&arrived | &heard.never, heard.handed, "seed {seed}");
        assert!(heard.unknown.is_empty(), "seed {seed}");
        messages += heard.words.len() + heard.commands.len();
        taken_back += heard.never.len();
    }
    eprintln!("{messages} messages arrived once and in order, {taken_back} commands taken back");
    assert!(taken_back > 0);
}

#[test]
fn over_restarts_of_either_end_no_command_arrives_twice_or_is_wrongly_called_lost() {
    let (mut commands, mut unknown) = (0, 0);
    for seed in 0..cases(1000) {
        let heard = history(10_000 + seed, true);
        let arrived: BTreeSet<String> = heard.commands.iter().cloned().collect();
        assert_eq!(arrived.len(), heard.commands.len(), "seed {seed}: twice");
        assert!(arrived.is_disjoint(&heard.never), "seed {seed}");
        assert!(heard.never.is_disjoint(&heard.unknown), "seed {seed}");
        commands += arrived.len();
        unknown += heard.unknown.len();
    }
    eprintln!("{commands} commands, none twice; of {unknown} the outcome is unknown");
    assert!(unknown > 0);
}

/// The ground has heard the rover's greeting and writes; its own greeting and all behind it are lost. The
/// rover, which has greeted nobody then, tells by that that it has seen nothing.
#[test]
fn what_is_written_behind_a_lost_greeting_is_written_again_and_has_no_unknown_outcome() {
    let (up, down) = (ground(START, "g0"), rover(START, "r0"));
    up.end().open(START);
    down.end().open(START);
    let greeting = down.end().output(START);
    up.end().receive(START, &greeting).unwrap();
    up.end().push(START, command(1));
    assert!(!up.end().output(START).is_empty(), "lost");
    let cut = CarrierError::Connection("cut".into());
    up.end().close(START, &cut);
    down.end().close(START, &cut);
    let (mut wire, mut rng) = (VirtualWire::default(), ChaCha8Rng::seed_from_u64(8));
    let mut heard = Heard::default();
    for tick in 1..100 {
        wire.step(after(f64::from(tick) * 0.05), &up, &down, &mut rng);
        heard.collect(&up, &down);
    }
    assert_eq!(heard.commands, [uuid(1)]);
    assert!(heard.never.is_empty() && heard.unknown.is_empty());
}

#[test]
fn what_the_rover_says_without_a_ground_waits_for_the_next_one() {
    let (first, down) = (ground(START, "g0"), rover(START, "r0"));
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut wire = VirtualWire::default();
    let step = |wire: &mut VirtualWire, up: &Arc<GroundEnd>, rng: &mut ChaCha8Rng, from, to| {
        for tick in from..to {
            wire.step(after(f64::from(tick) * 0.05), up, &down, rng);
        }
    };
    step(&mut wire, &first, &mut rng, 0, 20);
    assert!(down.end().take_fresh() && !down.end().take_fresh());
    down.end().close(after(1.0), &CarrierError::Connection("the ground died".into()));
    wire.reset();
    (1..=3000).for_each(|number| down.end().push(after(2.0), word(after(2.0), number)));
    let second = ground(after(3.0), "g1");
    step(&mut wire, &second, &mut rng, 60, 200);
    assert!(down.end().take_fresh(), "another ground");
    let mut words = Vec::new();
    for tick in 200..600 {
        wire.step(after(f64::from(tick) * 0.05), &second, &down, &mut rng);
        words.extend(second.end().take_received().into_iter().map(|said| said.unwrap()));
    }
    assert_eq!(words, (1..=3000).map(|n| word(after(2.0), n)).collect::<Vec<_>>());
}

#[test]
fn telemetry_gives_way_when_too_much_waits_and_is_counted() {
    let down = rover(START, "r0");
    let waiting = Bounds::default().waiting as u64;
    down.end().push(START, word(START, 1));
    for _ in 0..waiting + 500 {
        let message = Downlink::Telemetry(frame(RoverMode::Idle, None));
        down.end().push(START, Said { at: START, message });
    }
    let counters = down.end().counters();
    assert_eq!((counters.waiting, counters.dropped), (waiting, 501));
    assert_eq!(counters.sent, counters.waiting + counters.dropped);
}

#[test]
fn an_estop_passes_what_waits_and_ends_the_commands_among_it() {
    let (up, down) = (ground(START, "g0"), rover(START, "r0"));
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut wire = VirtualWire::default();
    wire.step(START, &up, &down, &mut rng);
    // More than the window takes, so that the rest waits.
    let many = Bounds::default().window as u64 + 300;
    (1..=many).for_each(|number| up.end().push(START, command(number)));
    let written = up.end().output(START);
    assert!(!written.is_empty());
    up.end().push(START, Uplink::EstopRelease { id: uuid(9000) });
    for _ in 0..3 {
        up.end().push(START, Uplink::Estop { id: uuid(9001) });
    }
    let lost = up.end().take_lost();
    assert!(lost.iter().any(|(uplink, _)| id(uplink) == uuid(9000)), "a release before it, too");
    assert!(lost.len() >= 300 && lost.iter().all(|(_, f)| matches!(f, Fate::NeverArrived(_))));
    up.end().close(START, &CarrierError::Connection("cut".into()));
    down.end().close(START, &CarrierError::Connection("cut".into()));
    wire.reset();
    let mut got = Vec::new();
    for tick in 1..200 {
        wire.step(after(f64::from(tick) * 0.1), &up, &down, &mut rng);
        got.extend(down.end().take_received().into_iter().map(|m| id(&m.unwrap()).to_owned()));
    }
    assert_eq!(got.iter().filter(|got| **got == uuid(9001)).count(), 1, "once, however often");
    assert_eq!(got.last(), Some(&uuid(9001)), "nothing comes behind it");
    assert_eq!(got.len() - 1 + lost.len() - 1, many as usize);
}

/// L3, over the carrier: however much waits, an E-stop is written behind at most one piece.
#[test]
fn an_estop_is_written_behind_one_piece_at_most_whatever_waits() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut most = 0;
    let n = if cases(10) == 10 { 10_000 } else { 200 };
    for case in 0..n {
        let (up, down) = (ground(START, "g0"), rover(START, "r0"));
        up.end().open(START);
        down.end().open(START);
        let (hello, answer) = (up.end().output(START), down.end().output(START));
        up.end().receive(START, &answer).unwrap();
        down.end().receive(START, &hello).unwrap();
        for number in 0..rng.random_range(0..40) {
            let mut load = command(number);
            if let Uplink::Command { basis_joints_rad, .. } = &mut load {
                let joints = vec![0.1; rng.random_range(0..1000)];
                basis_joints_rad.insert("leg1".into(), joints);
            }
            up.end().push(START, load);
        }
        for _ in 0..rng.random_range(0..4) {
            up.end().output(START);
        }
        up.end().push(START, Uplink::Estop { id: uuid(9001) });
        let written = up.end().output(START);
        let mut decoder = Decoder::default();
        decoder.push(&written);
        let (mut before, mut found) = (0, false);
        while let Some(body) = decoder.next(16 << 20).unwrap() {
            let Body::Message { json: Some(json), .. } = body else { continue };
            if String::from_utf8_lossy(&json).contains(&uuid(9001)) {
                found = true;
                break;
            }
            before += json.len();
        }
        assert!(found, "case {case}: it is in what is written next");
        most = most.max(before);
    }
    assert_eq!(most, 0, "and nothing of what waited goes before it");
}

#[test]
fn ends_that_do_not_belong_together_refuse_each_other_in_words() {
    let hello = |change: &dyn Fn(&mut Hello)| {
        let mut hello = Hello {
            protocol: PROTOCOL,
            side: Side::Rover,
            run: "r0".into(),
            robot: "r".into(),
            peer_run: None,
            received: 0,
            time_ns: 0,
        };
        change(&mut hello);
        let mut bytes = Vec::new();
        encode(&mut bytes, &Body::Hello(hello));
        let up = ground(START, "g0");
        up.end().open(START);
        let outcome = up.end().receive(START, &bytes);
        if let Err(why) = &outcome {
            up.end().close(START, why);
        }
        let state = up.end().state().0;
        (outcome, state)
    };
    assert_eq!(hello(&|_| {}), (Ok(()), CarrierState::Up));
    type Change<'a> = &'a dyn Fn(&mut Hello);
    let refusals: [(Change<'_>, &str); 3] = [
        (&|hello| hello.protocol = 2, "version 2"),
        (&|hello| hello.side = Side::Ground, "same side"),
        (&|hello| hello.robot = "other".into(), "robot model other"),
    ];
    for (change, expected) in refusals {
        let (outcome, state) = hello(change);
        let why = outcome.unwrap_err();
        assert!(matches!(&why, CarrierError::Refused(text) if text.contains(expected)), "{why}");
        assert_eq!(state, CarrierState::Refused);
    }
}

#[test]
fn what_comes_is_bounded_checked_and_never_taken_for_something_else() {
    let mut bytes = Vec::new();
    let sent: Vec<Body> = (1..40)
        .map(|number| Body::Message {
            number,
            taken: 3,
            json: Some(vec![b'x'; number as usize * 7]),
        })
        .collect();
    sent.iter().for_each(|body| encode(&mut bytes, body));
    let read = |bytes: &[u8], pieces: &mut dyn FnMut() -> usize| {
        let mut decoder = Decoder::default();
        let (mut rest, mut got) = (bytes, Vec::new());
        while !rest.is_empty() {
            let (piece, after) = rest.split_at(pieces().min(rest.len()));
            rest = after;
            decoder.push(piece);
            loop {
                match decoder.next(4096) {
                    Ok(Some(body)) => got.push(body),
                    Ok(None) => break,
                    Err(error) => return (got, Some(error)),
                }
            }
        }
        (got, None)
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..200 {
        let (got, error) = read(&bytes, &mut || rng.random_range(1..100));
        assert_eq!((got, error), (sent.clone(), None));
    }
    // One bit anywhere: what comes before is as sent, what is hit is not taken.
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        let (got, _) = read(&damaged, &mut || 4096);
        assert!(got.len() < sent.len() && sent.starts_with(&got), "bit of byte {at}");
    }
    let announced = [&u32::MAX.to_le_bytes()[..], &[0; 4]].concat();
    let mut decoder = Decoder::default();
    decoder.push(&announced);
    assert!(matches!(decoder.next(4096), Err(CarrierError::TooLong { .. })));
    // Before the greeting not even a message is taken, and no long one is waited for.
    let up = ground(START, "g0");
    up.end().open(START);
    assert!(matches!(up.end().receive(START, &bytes), Err(CarrierError::NotUnderstood(_))));
    let mut random = vec![0; 300];
    for _ in 0..5000 {
        rand::Rng::fill_bytes(&mut rng, &mut random);
        let up = ground(START, "g0");
        up.end().open(START);
        // Nothing is expected of it but that it ends.
        let _ = up.end().receive(START, &random);
        assert!(up.end().take_received().is_empty() && !up.end().is_up());
    }
}
