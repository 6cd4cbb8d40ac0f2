//! C1, C4: random histories of ground, link and rover with loss, copies, other orders, and restarts
//! of either end. Commands are of every kind: paths, sequences, modes, arcs, orders of images, each with or
//! without preconditions. The checker reads both logs from beginning to end and knows nothing else but what
//! each command asks for.

use std::collections::{BTreeMap, BTreeSet};

use bridge::commands::{
    Authority, AuthorityRules, CommandBook, LightTimes, StageCommand, is_terminal,
};
use bridge::link::{Direction, Settings};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{
    AckStage, CommandBody, CommandEvent, CommandState, Comparison, DirectionModel, ImageOrder,
    Jitter, LinkClass, Loss, OperatingMode, Outage, OutageTraffic, Precondition, QueueRule,
    SequenceStep, Uplink, WhenFull,
};
use wire::time::Timestamp;

use crate::support::{START, after, cases, motion, uuid};

const N_COMMANDS: u64 = 6;
const PERSONS: [&str; 3] = ["ada", "bob", "eve"];

/// What the ground's disk holds.
#[derive(Debug, Clone)]
enum GroundLine {
    Event(Box<CommandEvent>),
    /// The uplink message of a release: written before it is offered to the link.
    Release {
        id: String,
        epoch: u64,
        at: Timestamp,
    },
}

/// What the rover's disk holds. Each line is written before the rover acts.
#[derive(Debug, Clone, PartialEq)]
enum RoverLine {
    /// Step `step` of a command begins; a command that is no sequence is one step.
    Begins {
        id: String,
        step: usize,
        epoch: u64,
        at: Timestamp,
    },
    /// It is in this mode from now on.
    Mode(OperatingMode),
    Refuses {
        id: String,
    },
}

/// A command that the rover is at.
struct Doing {
    id: String,
    epoch: u64,
    steps: Vec<SequenceStep>,
    at: usize,
    end: Timestamp,
}

/// A rover in a few lines: executes each identity once, one at a time, newer authority only, no step
/// whose precondition does not hold, and nothing after a step that was not begun.
struct Rover {
    log: Vec<RoverLine>,
    mode: OperatingMode,
    moving: Option<Doing>,
    says: Vec<(Timestamp, String, AckStage)>,
}

impl Rover {
    fn new() -> Rover {
        Rover { log: Vec::new(), mode: MODES[0], moving: None, says: Vec::new() }
    }

    fn hears(&mut self, now: Timestamp, uplink: &Uplink) {
        let Uplink::Command { id, epoch: Some(epoch), body, preconditions, .. } = uplink else {
            return;
        };
        self.says.push((now, id.clone(), AckStage::Received));
        let known = |line: &RoverLine| match line {
            RoverLine::Begins { id: other, .. } | RoverLine::Refuses { id: other } => other == id,
            RoverLine::Mode(_) => false,
        };
        if self.log.iter().any(known) {
            return;
        }
        let highest = self.log.iter().filter_map(|line| match line {
            RoverLine::Begins { epoch, .. } => Some(*epoch),
            _ => None,
        });
        let old = Some(*epoch) < highest.max();
        if self.moving.is_some() || old || !self.holds(preconditions) {
            self.log.push(RoverLine::Refuses { id: id.clone() });
            self.says.push((now, id.clone(), AckStage::Rejected));
            return;
        }
        let steps = steps_of(body);
        self.says.push((now, id.clone(), AckStage::Started));
        let doing = Doing { id: id.clone(), epoch: *epoch, steps, at: 0, end: now };
        self.begin(now, doing);
    }

    /// Does what is asked for hold? The one field that is asked for here is the mode.
    fn holds(&self, preconditions: &[Precondition]) -> bool {
        preconditions.iter().all(|p| p.value == name_of(self.mode))
    }

    fn begin(&mut self, now: Timestamp, doing: Doing) {
        let step = &doing.steps[doing.at];
        if !self.holds(&step.preconditions) {
            self.says.push((now, doing.id, AckStage::Failed));
            return;
        }
        let Doing { id, epoch, at, .. } = &doing;
        self.log.push(RoverLine::Begins { id: id.clone(), step: *at, epoch: *epoch, at: now });
        self.moving = Some(Doing { end: now.plus_seconds(STEP_S), ..doing });
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some(doing) = self.moving.take_if(|doing| doing.end <= now) {
            if let CommandBody::Mode { mode } = doing.steps[doing.at].body {
                self.log.push(RoverLine::Mode(mode));
                self.mode = mode;
            }
            let end = doing.end;
            if doing.at + 1 == doing.steps.len() {
                self.says.push((end, doing.id, AckStage::Completed));
            } else {
                self.begin(end, Doing { at: doing.at + 1, ..doing });
            }
        }
    }

    /// Power off and on: what it moves stops, what it had not said is lost, its disk stays.
    fn restart(&mut self) {
        self.moving = None;
        self.says.clear();
    }
}

const MODES: [OperatingMode; 3] =
    [OperatingMode::Ready, OperatingMode::Safe, OperatingMode::Driving];
/// Time that a step takes (s).
const STEP_S: f64 = 1.0;

fn name_of(mode: OperatingMode) -> serde_json::Value {
    serde_json::to_value(mode).unwrap()
}

fn steps_of(body: &CommandBody) -> Vec<SequenceStep> {
    match body {
        CommandBody::Sequence { steps } => steps.clone(),
        body => vec![SequenceStep { body: body.clone(), preconditions: Vec::new() }],
    }
}

/// The command with number `number` of a history: the same whenever it is asked for.
fn command(seed: u64, number: u64) -> StageCommand {
    let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_mul(64).wrapping_add(number));
    let base = motion(&uuid(number), 2.0, None);
    let waits = |rng: &mut ChaCha8Rng, share: f64| -> Vec<Precondition> {
        let wanted = Precondition {
            channel: "rover/state".into(),
            field: "operation.mode".into(),
            op: Comparison::Eq,
            value: name_of(MODES[rng.random_range(0..3)]),
            max_age_s: 60.0,
            observed: None,
        };
        Vec::from_iter(rng.random_bool(share).then_some(wanted))
    };
    let single = |rng: &mut ChaCha8Rng| match rng.random_range(0..4) {
        0 => base.body.clone(),
        1 => CommandBody::Mode { mode: MODES[rng.random_range(0..3)] },
        2 => CommandBody::DriveArc {
            distance_m: 0.5,
            turn_rad: 0.1,
            course_rad: 0.0,
            speed_m_s: None,
        },
        _ => CommandBody::Image(ImageOrder {
            pairs: vec!["nav1".into()],
            scale: 0.5,
            scales: BTreeMap::new(),
            depth_bits: 8,
            rate_bps: None,
            simulated: None,
        }),
    };
    let body = if rng.random_bool(0.4) {
        let step = |rng: &mut ChaCha8Rng| SequenceStep {
            body: single(rng),
            preconditions: waits(rng, 0.3),
        };
        CommandBody::Sequence {
            steps: (0..rng.random_range(1..4)).map(|_| step(&mut rng)).collect(),
        }
    } else {
        single(&mut rng)
    };
    let duration_s = STEP_S * steps_of(&body).len() as f64;
    StageCommand { body, duration_s, preconditions: waits(&mut rng, 0.3), ..base }
}

struct World {
    now: Timestamp,
    book: CommandBook,
    authority: Authority,
    disk: Vec<GroundLine>,
    /// Written to the log but not synced yet: gone in a crash. With what is to be released then.
    unsynced: Vec<(GroundLine, Option<Uplink>)>,
    up: Direction<Uplink>,
    down: Direction<(String, AckStage)>,
    rover: Rover,
    offered: Vec<Uplink>,
}

fn direction(rng: &mut ChaCha8Rng) -> DirectionModel {
    let mut model = DirectionModel {
        jitter: Jitter::Uniform { most_s: rng.random_range(0.0..3.0) },
        loss: Loss::Bernoulli { probability: rng.random_range(0.0..0.4) },
        corruption: rng.random_range(0.0..0.1),
        duplication: rng.random_range(0.0..0.5),
        in_order: rng.random_bool(0.3),
        seed: rng.random_range(0..1000),
        ..Default::default()
    };
    if rng.random_bool(0.5) {
        let begin = rng.random_range(0.0..30.0);
        let traffic = [OutageTraffic::Hold, OutageTraffic::Lose][rng.random_range(0..2)];
        let end = after(begin + rng.random_range(0.1..20.0));
        model.outages = vec![Outage { begin: after(begin), end, traffic }];
        let (bytes, when_full) = (1 << 20, WhenFull::Reject);
        let ttl_s = rng.random_bool(0.5).then_some(5.0);
        model.queues.command = QueueRule { bytes, when_full, ttl_s };
    }
    model
}

impl World {
    fn new(rng: &mut ChaCha8Rng) -> World {
        let settings = |rng: &mut ChaCha8Rng| {
            Settings::new("up", rng.random_range(0.0..3.0), Some(&direction(rng))).unwrap()
        };
        World {
            now: START,
            book: CommandBook::default(),
            authority: Authority::new(START, AuthorityRules::default(), 0),
            disk: Vec::new(),
            unsynced: Vec::new(),
            up: Direction::new(settings(rng), 1000),
            down: Direction::new(settings(rng), 1000),
            rover: Rover::new(),
            offered: Vec::new(),
        }
    }

    fn light(&self) -> LightTimes {
        let (up, down) = (self.up.settings(), self.down.settings());
        LightTimes {
            up_s: up.light_s(self.now),
            down_s: down.light_s(self.now),
            spread_s: up.jitter_max_s() + down.jitter_max_s(),
        }
    }

    fn write_events(&mut self) {
        let events = self.book.take_events();
        self.unsynced
            .extend(events.into_iter().map(|event| (GroundLine::Event(Box::new(event)), None)));
    }

    /// The disk has everything: what waited for it is released.
    fn sync(&mut self) {
        for (line, uplink) in std::mem::take(&mut self.unsynced) {
            self.disk.push(line);
            let Some(uplink) = uplink else { continue };
            let Uplink::Command { id, epoch: Some(epoch), .. } = &uplink else { panic!() };
            if self.authority.check(self.now, *epoch).is_err() {
                self.book.withdraw(self.now, id, CommandState::Failed, "not sent");
                continue;
            }
            self.offered.push(uplink.clone());
            self.up.offer(self.now, LinkClass::Command, 100, uplink).unwrap();
        }
        self.write_events();
    }

    fn send(&mut self, id: &str, who: &str) {
        let Ok(epoch) = self.authority.exercise(self.now, who) else { return };
        let sent = self.book.send_as(self.now, id, who, self.light(), Some(epoch));
        let Ok((_, uplink)) = sent else { return };
        let release = GroundLine::Release { id: id.into(), epoch, at: self.now };
        self.unsynced.push((release, Some(uplink)));
        self.write_events();
    }

    /// The ground dies and comes back with what its disk holds.
    fn restart_ground(&mut self) {
        self.unsynced.clear();
        let events = self.disk.iter().filter_map(|line| match line {
            GroundLine::Event(event) => Some((**event).clone()),
            GroundLine::Release { .. } => None,
        });
        self.book = CommandBook::restore(self.now, events);
        // The release is the line before its event: the event may be lost where the release is not,
        // but what was offered to the link had both.
        let last = self.book.records().filter_map(|record| record.epoch).max().unwrap_or(0);
        self.authority = Authority::new(self.now, AuthorityRules::default(), last);
        for record in self.book.records() {
            let settled = is_terminal(record.state) || record.state == CommandState::Overdue;
            assert!(settled, "C4: {} is {:?} after a restart", record.id, record.state);
        }
        self.write_events();
        self.sync();
    }

    fn go_to(&mut self, now: Timestamp) {
        self.now = now;
        for arrived in self.up.take_due(now) {
            self.rover.advance(arrived.arrived);
            self.rover.hears(arrived.arrived, &arrived.item);
        }
        for notice in self.up.take_notices() {
            use bridge::link::{DropCause, Notice};
            match notice {
                Notice::Transmitted { item: Uplink::Command { id, .. }, at, arrives, .. } => {
                    self.book.transmitted(at, &id, arrives, self.light());
                }
                Notice::Dropped {
                    item: Uplink::Command { id, .. },
                    at,
                    cause: DropCause::Ttl,
                    ..
                } => self.book.withdraw(at, &id, CommandState::Expired, "waited too long"),
                _ => {}
            }
        }
        self.rover.advance(now);
        for (at, id, stage) in std::mem::take(&mut self.rover.says) {
            let _ = self.down.offer(at, LinkClass::Ack, 50, (id, stage));
        }
        for arrived in self.down.take_due(now) {
            let (id, stage) = arrived.item;
            self.book.acknowledge(arrived.arrived, &id, stage, None);
        }
        self.book.tick(now);
        self.write_events();
    }
}

fn play(seed: u64) -> World {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut world = World::new(&mut rng);
    for _ in 0..rng.random_range(20..60) {
        let next = world.now.plus_seconds(rng.random_range(0.0..2.0));
        world.go_to(next);
        let number = rng.random_range(0..N_COMMANDS);
        let id = uuid(number);
        let who = PERSONS[rng.random_range(0..3)];
        let now = world.now;
        match rng.random_range(0..20) {
            0..4 => drop(world.book.stage(now, command(seed, number))),
            4..9 => {
                let _ = world.book.stage(now, command(seed, number));
                if world.authority.exercise(now, who).is_ok()
                    && world.book.arm(now, &id, who).is_ok()
                {
                    world.write_events();
                    world.send(&id, who);
                }
            }
            9..11 => world.send(&id, who),
            11..16 => world.sync(),
            16 => drop(world.authority.take_over(now, who)),
            17 if rng.random_bool(0.4) => world.restart_ground(),
            18 if rng.random_bool(0.4) => world.rover.restart(),
            _ => drop(world.book.cancel(now, &id, who)),
        }
        world.write_events();
    }
    // An end: everything synced, nothing under way, all timeouts over.
    world.sync();
    for seconds in [30.0, 60.0, 90.0, 3600.0] {
        let next = world.now.plus_seconds(seconds);
        world.go_to(next);
        world.sync();
    }
    world
}

/// Reads both logs once, in order.
fn check(seed: u64, ground: &[GroundLine], rover: &[RoverLine]) -> Tally {
    let mut released = BTreeMap::new();
    let mut last_state = BTreeMap::new();
    let mut highest = 0;
    for line in ground {
        match line {
            GroundLine::Release { id, epoch, at } => {
                let before = released.insert(id.clone(), (*epoch, *at));
                assert_eq!(before, None, "seed {seed}: {id} released twice");
                assert!(*epoch >= highest, "seed {seed}: released under an old authority");
                highest = *epoch;
            }
            GroundLine::Event(event) => {
                let id = &event.command.id;
                let before = last_state.insert(id.clone(), event.state);
                let ended = before.is_some_and(is_terminal);
                assert!(!ended, "seed {seed}: {id} was {before:?} and changed");
            }
        }
    }
    // How many steps of each command began, and the mode, as the rover's lines tell.
    let mut begun: BTreeMap<String, usize> = BTreeMap::new();
    let (mut highest, mut mode) = (0, MODES[0]);
    let asked: BTreeMap<String, StageCommand> =
        (0..N_COMMANDS).map(|number| (uuid(number), command(seed, number))).collect();
    for line in rover {
        let (id, step, epoch, at) = match line {
            RoverLine::Begins { id, step, epoch, at } => (id, *step, *epoch, *at),
            RoverLine::Mode(now) => {
                mode = *now;
                continue;
            }
            RoverLine::Refuses { .. } => continue,
        };
        let before = begun.insert(id.clone(), step + 1).unwrap_or(0);
        assert_eq!(before, step, "seed {seed}: step {step} of {id} begins after {before} of them");
        let (given, sent) = released[id];
        assert_eq!(given, epoch, "seed {seed}");
        assert!(at >= sent, "seed {seed}: executed before it was released");
        assert!(epoch >= highest, "seed {seed}: an old authority commands");
        highest = epoch;
        let steps = steps_of(&asked[id].body);
        let first = asked[id].preconditions.iter().filter(|_| step == 0);
        for wanted in first.chain(&steps[step].preconditions) {
            assert_eq!(
                wanted.value,
                name_of(mode),
                "seed {seed}: step {step} of {id} must not begin"
            );
        }
    }
    let executed: BTreeSet<String> = begun.keys().cloned().collect();
    let mut tally = Tally { executed: executed.len(), ..Tally::default() };
    for (id, state) in &last_state {
        let settled =
            is_terminal(*state) || matches!(state, CommandState::Staged | CommandState::Overdue);
        assert!(settled, "seed {seed}: {id} is stuck as {state:?}");
        let done = *state == CommandState::Done;
        let steps = steps_of(&asked[id].body).len();
        let all = begun.get(id) == Some(&steps);
        assert!(!done || all, "seed {seed}: {id} done, but of {steps} steps {:?}", begun.get(id));
        let never = matches!(state, CommandState::Cancelled | CommandState::Expired);
        assert!(!never || !executed.contains(id), "seed {seed}: {id} {state:?}, yet executed");
        tally.done += usize::from(done);
        tally.cut_short += usize::from(begun.get(id).is_some_and(|n| *n < steps));
        tally.sequences += usize::from(begun.get(id).is_some_and(|n| *n > 1));
        tally.unknown += usize::from(*state == CommandState::Overdue);
    }
    for id in &executed {
        assert!(last_state.contains_key(id), "seed {seed}: {id} is not in the log");
    }
    tally
}

#[derive(Debug, Default)]
struct Tally {
    executed: usize,
    done: usize,
    unknown: usize,
    /// Sequences that did not come to their end, and those that got beyond their first step.
    cut_short: usize,
    sequences: usize,
}

#[test]
fn c1_c4_each_command_executes_at_most_once_and_none_is_stuck() {
    let n = cases(100_000);
    let mut all = Tally::default();
    for seed in 0..n {
        let world = play(seed);
        let Tally { executed, done, unknown, cut_short, sequences } =
            check(seed, &world.disk, &world.rover.log);
        let offered: Vec<&str> = world
            .offered
            .iter()
            .map(|uplink| match uplink {
                Uplink::Command { id, .. } => id.as_str(),
                other => panic!("{other:?}"),
            })
            .collect();
        let distinct: BTreeSet<&str> = offered.iter().copied().collect();
        assert_eq!(distinct.len(), offered.len(), "seed {seed}: offered to the link twice");
        all.executed += executed;
        all.done += done;
        all.unknown += unknown;
        all.cut_short += cut_short;
        all.sequences += sequences;
    }
    // The histories are not empty ones.
    assert!(all.executed as u64 > n / 2 && all.done as u64 > n / 10, "{all:?}");
    assert!(all.unknown as u64 > n / 10, "{all:?}");
    assert!(all.cut_short as u64 > n / 100 && all.sequences as u64 > n / 10, "{all:?}");
    eprintln!("{n} histories: {all:?}");
}
