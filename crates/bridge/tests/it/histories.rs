//! C1, C4: random histories of ground, link and rover with loss, copies, other orders, and restarts
//! of either end. The checker reads both logs from beginning to end and knows nothing else.

use std::collections::{BTreeMap, BTreeSet};

use bridge::commands::{Authority, AuthorityRules, CommandBook, LightTimes, is_terminal};
use bridge::link::{Direction, Settings};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{
    AckStage, CommandEvent, CommandState, DirectionModel, Jitter, LinkClass, Loss, Outage,
    OutageTraffic, QueueRule, Uplink, WhenFull,
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
    Executes { id: String, epoch: u64, at: Timestamp },
    Refuses { id: String },
}

/// A rover in a few lines: executes each identity once, one at a time, newer authority only.
#[derive(Default)]
struct Rover {
    log: Vec<RoverLine>,
    moving: Option<(String, Timestamp)>,
    says: Vec<(Timestamp, String, AckStage)>,
}

impl Rover {
    fn hears(&mut self, now: Timestamp, uplink: &Uplink) {
        let Uplink::Command { id, epoch: Some(epoch), .. } = uplink else { return };
        self.says.push((now, id.clone(), AckStage::Received));
        let known = |line: &RoverLine| match line {
            RoverLine::Executes { id: other, .. } | RoverLine::Refuses { id: other } => other == id,
        };
        if self.log.iter().any(known) {
            return;
        }
        let highest = self.log.iter().filter_map(|line| match line {
            RoverLine::Executes { epoch, .. } => Some(*epoch),
            RoverLine::Refuses { .. } => None,
        });
        if self.moving.is_some() || Some(*epoch) < highest.max() {
            self.log.push(RoverLine::Refuses { id: id.clone() });
            self.says.push((now, id.clone(), AckStage::Rejected));
            return;
        }
        self.log.push(RoverLine::Executes { id: id.clone(), epoch: *epoch, at: now });
        self.says.push((now, id.clone(), AckStage::Started));
        self.moving = Some((id.clone(), now.plus_seconds(2.0)));
    }

    fn advance(&mut self, now: Timestamp) {
        if let Some((id, end)) = self.moving.take_if(|(_, end)| *end <= now) {
            self.says.push((end, id, AckStage::Completed));
        }
    }

    /// Power off and on: what it moves stops, what it had not said is lost, its disk stays.
    fn restart(&mut self) {
        self.moving = None;
        self.says.clear();
    }
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
            rover: Rover::default(),
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
        let id = uuid(rng.random_range(0..N_COMMANDS));
        let who = PERSONS[rng.random_range(0..3)];
        let now = world.now;
        match rng.random_range(0..20) {
            0..4 => drop(world.book.stage(now, motion(&id, 2.0, None))),
            4..9 => {
                let _ = world.book.stage(now, motion(&id, 2.0, None));
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
    let mut executed = BTreeSet::new();
    let mut highest = 0;
    for line in rover {
        let RoverLine::Executes { id, epoch, at } = line else { continue };
        assert!(executed.insert(id.clone()), "seed {seed}: {id} executed twice");
        let (given, sent) = released[id];
        assert_eq!(given, *epoch, "seed {seed}");
        assert!(*at >= sent, "seed {seed}: executed before it was released");
        assert!(*epoch >= highest, "seed {seed}: an old authority commands");
        highest = *epoch;
    }
    let mut tally = Tally { executed: executed.len(), ..Tally::default() };
    for (id, state) in &last_state {
        let settled =
            is_terminal(*state) || matches!(state, CommandState::Staged | CommandState::Overdue);
        assert!(settled, "seed {seed}: {id} is stuck as {state:?}");
        let done = *state == CommandState::Done;
        assert!(!done || executed.contains(id), "seed {seed}: {id} done, never executed");
        let never = matches!(state, CommandState::Cancelled | CommandState::Expired);
        assert!(!never || !executed.contains(id), "seed {seed}: {id} {state:?}, yet executed");
        tally.done += usize::from(done);
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
}

#[test]
fn c1_c4_each_command_executes_at_most_once_and_none_is_stuck() {
    let n = cases(100_000);
    let mut all = Tally::default();
    for seed in 0..n {
        let world = play(seed);
        let Tally { executed, done, unknown } = check(seed, &world.disk, &world.rover.log);
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
    }
    // The histories are not empty ones.
    assert!(all.executed as u64 > n / 2 && all.done as u64 > n / 10, "{all:?}");
    assert!(all.unknown as u64 > n / 10, "{all:?}");
}
