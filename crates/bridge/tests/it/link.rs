//! The promises of the link model over random histories: P1 to P9, each from its own oracle.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

use bridge::link::{Delivered, Direction, DropCause, Notice, Settings, check, preset};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{
    DirectionModel, Jitter, LightTime, LinkClass, LinkConfig, Loss, Outage, OutageTraffic,
    QueueRule, Queues, WhenFull,
};
use wire::time::Timestamp;

use crate::support::{START, after, cases};

const CLASSES: [LinkClass; 6] = LinkClass::ALL;

/// One thing that happens to a link.
#[derive(Debug, Clone)]
enum Act {
    Offer(LinkClass, u32),
    Model(f64, Box<DirectionModel>),
    Poll,
}

/// What a history may contain.
#[derive(Clone, Copy, Default)]
struct Kind {
    random: bool,
    overflow: bool,
    ttl: bool,
    outages: bool,
    unordered: bool,
    tables: bool,
    changes: bool,
    limited: bool,
}

const ALL: Kind = Kind {
    random: true,
    overflow: true,
    ttl: true,
    outages: true,
    unordered: true,
    tables: true,
    changes: true,
    limited: false,
};

#[derive(Debug, Clone)]
struct Scenario {
    capacity: usize,
    delay_s: f64,
    model: DirectionModel,
    acts: Vec<(Timestamp, Act)>,
}

fn model(rng: &mut ChaCha8Rng, kind: Kind) -> DirectionModel {
    let mut model = DirectionModel { seed: rng.random_range(0..1 << 40), ..Default::default() };
    if kind.limited || rng.random_bool(0.7) {
        model.rate_bps = Some(rng.random_range(200.0..20_000.0));
    }
    model.mtu_bytes = rng.random_range(16..400);
    if kind.tables && rng.random_bool(0.5) {
        let mut at = 0.0;
        for _ in 0..rng.random_range(1..5) {
            at += rng.random_range(0.1..8.0);
            let delay_s = rng.random_range(0.0..4.0);
            model.light_times.push(LightTime { time: after(at), delay_s });
        }
    }
    if kind.random {
        model.jitter = match rng.random_range(0..3) {
            0 => Jitter::None {},
            1 => Jitter::Uniform { most_s: rng.random_range(0.0..2.0) },
            _ => Jitter::TruncatedNormal { sigma_s: rng.random_range(0.0..1.0), most_s: 1.0 },
        };
        model.loss = match rng.random_range(0..3) {
            0 => Loss::None {},
            1 => Loss::Bernoulli { probability: rng.random_range(0.0..0.5) },
            _ => Loss::GilbertElliott { to_bad: 0.2, to_good: 0.3, loss_good: 0.0, loss_bad: 0.9 },
        };
        model.corruption = rng.random_range(0.0..0.2);
        model.duplication = rng.random_range(0.0..0.3);
    }
    model.in_order = !kind.unordered || rng.random_bool(0.5);
    let rule = |rng: &mut ChaCha8Rng| QueueRule {
        bytes: if kind.overflow { rng.random_range(1..3000) } else { 1 << 26 },
        when_full: [WhenFull::DropOldest, WhenFull::DropNewest, WhenFull::Reject]
            [rng.random_range(0..3)],
        ttl_s: (kind.ttl && rng.random_bool(0.5)).then(|| rng.random_range(0.001..4.0)),
    };
    model.queues = Queues {
        estop: QueueRule { ttl_s: None, bytes: 1 << 26, when_full: WhenFull::Reject },
        command: rule(rng),
        ack: rule(rng),
        housekeeping: rule(rng),
        telemetry: rule(rng),
        bulk: rule(rng),
    };
    if kind.outages {
        let mut at = 0.0;
        for _ in 0..rng.random_range(0..4) {
            let begin = at + rng.random_range(0.0..4.0);
            at = begin + rng.random_range(0.001..4.0);
            let traffic = [OutageTraffic::Hold, OutageTraffic::Lose][rng.random_range(0..2)];
            model.outages.push(Outage { begin: after(begin), end: after(at), traffic });
        }
    }
    model
}

fn scenario(seed: u64, kind: Kind) -> Scenario {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let capacity = if kind.overflow { rng.random_range(1..30) } else { 10_000 };
    let (delay_s, model_at_first) = (rng.random_range(0.0..3.0), model(&mut rng, kind));
    let (mut now, mut acts) = (START, Vec::new());
    for _ in 0..rng.random_range(5..50) {
        if rng.random_bool(0.6) {
            now = Timestamp(now.0 + rng.random_range(0..500_000_000_u64));
        }
        let act = match rng.random_range(0..20) {
            0..15 => Act::Offer(CLASSES[rng.random_range(0..6)], rng.random_range(0..1200)),
            15 if kind.changes => {
                Act::Model(rng.random_range(0.0..3.0), Box::new(model(&mut rng, kind)))
            }
            _ => Act::Poll,
        };
        acts.push((now, act));
    }
    Scenario { capacity, delay_s, model: model_at_first, acts }
}

#[derive(Debug, Clone, Copy)]
struct Offered {
    at: Timestamp,
    class: LinkClass,
    bytes: u32,
}

#[derive(Debug, Default)]
struct Trace {
    offered: Vec<Offered>,
    refused: Vec<u64>,
    /// Models with the time from which each was in force.
    models: Vec<(Timestamp, f64, DirectionModel)>,
    delivered: Vec<Delivered<u64>>,
    notices: Vec<Notice<u64>>,
    duplicated: u64,
}

impl Trace {
    /// The models in force at some moment between two; a change belongs to both its sides.
    fn in_force(
        &self,
        [from, to]: [Timestamp; 2],
    ) -> impl Iterator<Item = &(Timestamp, f64, DirectionModel)> {
        self.models.iter().enumerate().filter_map(move |(i, entry)| {
            let until = self.models.get(i + 1).map(|next| next.0);
            (entry.0 <= to && until.is_none_or(|until| until >= from)).then_some(entry)
        })
    }

    fn dropped(&self) -> Vec<(u64, Timestamp, DropCause)> {
        let dropped = self.notices.iter().filter_map(|notice| match notice {
            Notice::Dropped { sequence, at, cause, .. } => Some((*sequence, *at, *cause)),
            Notice::Transmitted { .. } => None,
        });
        dropped.collect()
    }

    /// Independent of when the caller asked.
    fn hash(&self) -> u64 {
        let mut lines: Vec<String> = self.delivered.iter().map(|d| format!("{d:?}")).collect();
        let mut notices: Vec<String> = self.notices.iter().map(|n| format!("{n:?}")).collect();
        notices.sort();
        lines.append(&mut notices);
        let mut hasher = DefaultHasher::new();
        lines.hash(&mut hasher);
        hasher.finish()
    }
}

/// Plays a history; P2 is checked after every call. `polls` are asked for in between.
fn play(scenario: &Scenario, polls: Option<u64>) -> Trace {
    let settings =
        |delay_s, model: &DirectionModel| Settings::new("up", delay_s, Some(model)).unwrap();
    let first = settings(scenario.delay_s, &scenario.model);
    let mut link = Direction::new(first, scenario.capacity);
    let mut trace = Trace::default();
    trace.models.push((Timestamp(0), scenario.delay_s, scenario.model.clone()));
    let mut rng = polls.map(ChaCha8Rng::seed_from_u64);
    let mut now = START;
    for (at, act) in &scenario.acts {
        while let Some(rng) = &mut rng
            && now < *at
            && rng.random_bool(0.7)
        {
            now = Timestamp(rng.random_range(now.0..=at.0));
            look(&mut link, now, &mut trace);
        }
        now = *at;
        match act {
            Act::Offer(class, bytes) => {
                let sequence = trace.offered.len() as u64;
                trace.offered.push(Offered { at: now, class: *class, bytes: (*bytes).max(1) });
                match link.offer(now, *class, *bytes, sequence) {
                    Ok(given) => assert_eq!(given, sequence),
                    Err(_) => trace.refused.push(sequence),
                }
            }
            Act::Model(delay_s, model) => {
                trace.models.push((now, *delay_s, (**model).clone()));
                link.set(now, settings(*delay_s, model));
            }
            Act::Poll => trace.delivered.extend(link.take_due(now)),
        }
        conserved(&mut link, &mut trace);
    }
    while let Some(next) = link.next_event() {
        look(&mut link, next, &mut trace);
    }
    assert_eq!(link.counters().in_flight, 0, "all that is under way ends");
    trace.duplicated = link.counters().duplicated;
    trace
}

fn look(link: &mut Direction<u64>, now: Timestamp, trace: &mut Trace) {
    trace.delivered.extend(link.take_due(now));
    assert!(link.next_event().is_none_or(|next| next > now), "nothing due stays");
    conserved(link, trace);
}

/// P2, from what was handed in and out alone.
fn conserved(link: &mut Direction<u64>, trace: &mut Trace) {
    trace.notices.extend(link.take_notices());
    let c = link.counters();
    assert_eq!(c.sent + c.duplicated, c.delivered + c.dropped + c.in_flight);
    assert_eq!((c.sent, c.delivered), (trace.offered.len() as u64, trace.delivered.len() as u64));
    assert_eq!(c.bytes_sent, trace.offered.iter().map(|o| u64::from(o.bytes)).sum::<u64>());
    let mut by = [0; 5];
    for (_, _, cause) in trace.dropped() {
        by[cause as usize] += 1;
    }
    let d = c.dropped_by;
    assert_eq!([d.loss, d.corruption, d.outage, d.ttl, d.overflow], by);
    assert_eq!(c.dropped, by.iter().sum::<u64>());
    assert!(c.queued <= c.in_flight);
}

/// Light time at a moment, by the definition (s); the least of both sides of a change.
fn light_s(trace: &Trace, at: Timestamp) -> f64 {
    let of = |(_, delay_s, model): &(Timestamp, f64, DirectionModel)| {
        let table = &model.light_times;
        let Some(last) = table.last() else { return *delay_s };
        if at <= table[0].time {
            return table[0].delay_s;
        }
        let piece = table.windows(2).find(|pair| (pair[0].time..pair[1].time).contains(&at));
        piece.map_or(last.delay_s, |pair| {
            let share = at.seconds_since(pair[0].time) / pair[1].time.seconds_since(pair[0].time);
            pair[0].delay_s + share * (pair[1].delay_s - pair[0].delay_s)
        })
    };
    trace.in_force([at, at]).map(of).fold(f64::INFINITY, f64::min)
}

#[test]
fn p1_nothing_arrives_before_sent_and_light_time_and_size_over_rate() {
    for seed in 0..cases(10_000) {
        let trace = play(&scenario(seed, ALL), None);
        for d in &trace.delivered {
            let offered = trace.offered[d.sequence as usize];
            assert_eq!((d.item, d.sent, d.class), (d.sequence, offered.at, offered.class));
            assert!(d.sent <= d.begun && d.begun <= d.transmitted && d.transmitted <= d.arrived);
            let fastest = trace
                .in_force([d.begun, d.transmitted])
                .map(|(.., model)| model.rate_bps.unwrap_or(f64::INFINITY))
                .fold(0.0, f64::max);
            let least_s = f64::from(offered.bytes) * 8.0 / fastest;
            // The rate is kept to a millionth of a bit per second.
            let took_s = d.transmitted.seconds_since(d.begun);
            assert!(
                took_s >= least_s * (1.0 - 1e-8) - 1e-8,
                "seed {seed}: {took_s} of {least_s} s"
            );
            let light_s = light_s(&trace, d.transmitted);
            let way_s = d.arrived.seconds_since(d.transmitted);
            assert!(way_s >= light_s - 1e-8, "seed {seed}: {way_s} of {light_s} s");
        }
    }
}

#[test]
fn p2_sent_is_delivered_and_dropped_and_in_flight_at_every_instant() {
    for seed in 0..cases(10_000) {
        // The law is checked within; here that each message ends exactly once.
        let trace = play(&scenario(seed + 1_000_000, ALL), Some(seed));
        let mut ends = vec![0_u64; trace.offered.len()];
        trace.delivered.iter().for_each(|d| ends[d.sequence as usize] += 1);
        trace.dropped().iter().for_each(|(sequence, ..)| ends[*sequence as usize] += 1);
        assert!(ends.iter().all(|n| (1..=2).contains(n)), "seed {seed}: {ends:?}");
        let copies = ends.iter().filter(|n| **n == 2).count() as u64;
        assert_eq!(copies, trace.duplicated, "seed {seed}: only copies end a second time");
        for sequence in &trace.refused {
            assert_eq!(ends[*sequence as usize], 1, "seed {seed}: refused, and never delivered");
            assert!(trace.delivered.iter().all(|d| d.sequence != *sequence));
        }
    }
}

#[test]
fn p3_each_class_keeps_its_order() {
    let kind = Kind { unordered: false, ..ALL };
    for seed in 0..cases(10_000) {
        let trace = play(&scenario(seed + 2_000_000, kind), None);
        assert!(trace.delivered.is_sorted_by_key(|d| d.arrived), "in order of arrival");
        for class in &CLASSES[1..] {
            let of_class = trace.delivered.iter().filter(|d| d.class == *class);
            assert!(of_class.is_sorted_by_key(|d| d.sequence), "seed {seed}: {class:?}");
        }
    }
}

#[test]
fn p4_an_estop_begins_within_one_frame_whatever_the_load() {
    let kind = Kind { outages: false, changes: false, ..ALL };
    let mut n_estops = 0;
    for seed in 0..cases(10_000) {
        let mut scenario = scenario(seed + 3_000_000, kind);
        scenario.capacity = 10_000;
        let trace = play(&scenario, None);
        let rate = scenario.model.rate_bps.unwrap_or(f64::INFINITY);
        let frame_s = f64::from(scenario.model.mtu_bytes) * 8.0 / rate;
        let mut sent: BTreeMap<u64, (Timestamp, Timestamp)> = BTreeMap::new();
        for d in trace.delivered.iter().filter(|d| d.class == LinkClass::Estop) {
            sent.insert(d.sequence, (d.begun, d.transmitted));
        }
        for (sequence, (begun, _)) in &sent {
            let offered = trace.offered[*sequence as usize].at;
            // E-stops before it that are still under way, lost ones too, each with its own frames.
            let before = trace.offered[..*sequence as usize].iter().enumerate();
            let ahead_s: f64 = before
                .filter(|(_, o)| o.class == LinkClass::Estop)
                .filter(|(i, _)| sent.get(&(*i as u64)).is_none_or(|(_, end)| *end > offered))
                .map(|(_, o)| f64::from(o.bytes) * 8.0 / rate)
                .sum();
            let waited_s = begun.seconds_since(offered);
            assert!(waited_s <= frame_s + ahead_s + 1e-6, "seed {seed}: {waited_s} s");
            n_estops += 1;
        }
    }
    assert!(n_estops > cases(10_000), "{n_estops} E-stops looked at");
}

#[test]
fn p5_the_same_seed_gives_the_same_trace_however_often_it_is_asked() {
    for seed in 0..cases(10_000) {
        // Room is freed by taking what has arrived, so the number of messages must not bind.
        let scenario = Scenario { capacity: 10_000, ..scenario(seed + 4_000_000, ALL) };
        let once = play(&scenario, None);
        assert_eq!(once.hash(), play(&scenario, None).hash(), "seed {seed}");
        assert_eq!(once.hash(), play(&scenario, Some(seed)).hash(), "seed {seed}: with polls");
    }
}

/// L4: the traces of 100 scenarios, on so many threads.
fn traces(n_threads: usize) -> Vec<u64> {
    let seeds: Vec<u64> = (0..100).collect();
    let chunk = seeds.len().div_ceil(n_threads);
    std::thread::scope(|scope| {
        let hash = |seeds: &[u64]| -> Vec<u64> {
            seeds.iter().map(|seed| play(&scenario(*seed, ALL), None).hash()).collect()
        };
        let threads: Vec<_> =
            seeds.chunks(chunk).map(|part| scope.spawn(move || hash(part))).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    })
}

#[test]
fn l4_threads_and_processes_leave_the_trace_as_it_is() {
    let traces = [1, 2, 7].map(traces);
    assert!(traces.iter().all(|other| *other == traces[0]));
    let distinct: std::collections::BTreeSet<u64> = traces[0].iter().copied().collect();
    assert_eq!(distinct.len(), 100, "seeds differ");
    if std::env::var_os("FOOTFALL_LINK_TRACE").is_some() {
        eprintln!("trace {:?}", traces[0]);
        return;
    }
    let other = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "link::l4_threads_and_processes_leave_the_trace_as_it_is", "--nocapture"])
        .env("FOOTFALL_LINK_TRACE", "1")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&other.stderr);
    assert!(text.contains(&format!("trace {:?}", traces[0])), "another process differs");
}

#[test]
fn p6_without_loss_what_is_offered_is_what_arrives() {
    let kind = Kind { unordered: true, tables: true, limited: false, ..Kind::default() };
    for seed in 0..cases(10_000) {
        let mut scenario = scenario(seed + 5_000_000, kind);
        scenario.model.jitter = Jitter::Uniform { most_s: 1.0 };
        let trace = play(&scenario, None);
        let mut delivered: Vec<u64> = trace.delivered.iter().map(|d| d.item).collect();
        delivered.sort_unstable();
        assert!(delivered.into_iter().eq(0..trace.offered.len() as u64), "seed {seed}");
    }
}

#[test]
fn p7_no_window_carries_more_than_its_rate() {
    let kind = Kind { limited: true, overflow: true, ttl: true, outages: true, ..Kind::default() };
    for seed in 0..cases(10_000) {
        let scenario = scenario(seed + 6_000_000, kind);
        let trace = play(&scenario, None);
        let rate = scenario.model.rate_bps.unwrap() / 8.0;
        // What began and ended within a window fits into it, without any slack.
        let sent = &trace.delivered;
        for first in sent {
            let from = first.begun;
            let mut within: Vec<_> = sent.iter().filter(|d| d.begun >= from).collect();
            within.sort_by_key(|d| d.transmitted);
            let mut bytes = 0.0;
            for last in within {
                bytes += f64::from(trace.offered[last.sequence as usize].bytes);
                let window_s = last.transmitted.seconds_since(from);
                assert!(bytes <= rate * window_s + 1e-4, "seed {seed}: {bytes} B in {window_s} s");
            }
        }
        // At a fixed light time arrivals are as far apart as ends of transmission. What a window takes
        // beyond its rate was transmitted before it: the first one, and a part of one in each class.
        for (i, first) in sent.iter().enumerate() {
            let mut bytes = 0.0;
            for last in sent[i..].iter().filter(|d| d.class != LinkClass::Estop) {
                let size = f64::from(trace.offered[last.sequence as usize].bytes);
                let window_s = last.arrived.seconds_since(first.arrived);
                bytes += size;
                let largest = sent[i..].iter().map(|d| trace.offered[d.sequence as usize].bytes);
                let largest = f64::from(largest.max().unwrap_or(0));
                let at_once = 6.0 * largest;
                assert!(bytes <= rate * window_s + at_once + 1e-4, "seed {seed}");
            }
        }
    }
}

#[test]
fn p8_losses_have_their_probability_and_bursts_their_length() {
    let n = cases(1_000_000) as usize;
    for (number, p) in [0.001, 0.1, 0.5].into_iter().enumerate() {
        let loss = Loss::Bernoulli { probability: p };
        let lost = losses(loss, n, number as u64).iter().filter(|lost| **lost).count() as f64;
        let sigma = (n as f64 * p * (1.0 - p)).sqrt();
        assert!((lost - n as f64 * p).abs() <= 4.0 * sigma, "p = {p}: {lost} of {n}");
    }
    // Of a two-state chain: share of the bad state a / (a + b), bursts of mean length 1 / b.
    let (to_bad, to_good) = (0.02, 0.25);
    let loss = Loss::GilbertElliott { to_bad, to_good, loss_good: 0.0, loss_bad: 1.0 };
    let lost = losses(loss, n, 9);
    let share = to_bad / (to_bad + to_good);
    // The variance of the mean of a chain with eigenvalue l is (1 + l) / (1 - l) times the plain one.
    let eigenvalue: f64 = 1.0 - to_bad - to_good;
    let n = n as f64;
    let sigma = (share * (1.0 - share) / n * (1.0 + eigenvalue) / (1.0 - eigenvalue)).sqrt();
    let found = lost.iter().filter(|lost| **lost).count() as f64 / n;
    assert!((found - share).abs() <= 4.0 * sigma, "{found} of {share}");
    let bursts = lost.split(|lost| !lost).filter(|burst| !burst.is_empty());
    let lengths: Vec<f64> = bursts.map(|burst| burst.len() as f64).collect();
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    let sigma = ((1.0 - to_good) / (to_good * to_good) / lengths.len() as f64).sqrt();
    assert!((mean - 1.0 / to_good).abs() <= 4.0 * sigma, "bursts of {mean}");
}

/// Which of n messages are lost.
fn losses(loss: Loss, n: usize, seed: u64) -> Vec<bool> {
    let model = DirectionModel { loss, seed, ..Default::default() };
    let mut link = Direction::new(Settings::new("up", 0.0, Some(&model)).unwrap(), 10);
    let mut lost = vec![true; n];
    for i in 0..n {
        link.offer(START, LinkClass::Telemetry, 100, i).unwrap();
        link.take_due(START).iter().for_each(|d| lost[d.item] = false);
        drop(link.take_notices());
    }
    lost
}

#[test]
fn p9_nothing_begins_in_an_outage() {
    let kind = Kind { outages: true, limited: true, ttl: true, overflow: true, ..Kind::default() };
    let mut held = 0;
    for seed in 0..cases(10_000) {
        let scenario = scenario(seed + 7_000_000, kind);
        let trace = play(&scenario, None);
        let outages = &scenario.model.outages;
        let at = |t: Timestamp| outages.iter().find(|o| o.begin <= t && t < o.end);
        for d in &trace.delivered {
            assert_eq!(at(d.begun), None, "seed {seed}");
            let in_hold = at(d.sent).is_some_and(|o| o.traffic == OutageTraffic::Hold);
            held += u64::from(in_hold && at(d.arrived).is_none());
        }
        for (_, dropped, cause) in trace.dropped() {
            let loses = at(dropped).is_some_and(|o| o.traffic == OutageTraffic::Lose);
            assert!(cause != DropCause::Outage || loses, "seed {seed}");
        }
    }
    assert!(held > cases(10_000) / 10, "{held} messages waited for the end of an outage");
}

/// A link by the millisecond: one byte each, all else by its definition.
struct Slow {
    model: DirectionModel,
    delay_ms: u64,
    queues: Vec<Vec<SlowMessage>>,
    sending: Option<(usize, u64, u32)>,
    delivered: Vec<(u64, u64, u64, u64)>,
    dropped: Vec<(u64, DropCause)>,
}

#[derive(Clone)]
struct SlowMessage {
    sequence: u64,
    left: u32,
    begun: Option<u64>,
    expires: Option<u64>,
}

impl Slow {
    fn tick(&mut self, t: u64) {
        for queue in &mut self.queues {
            queue.retain(|m| {
                let late = m.begun.is_none() && m.expires.is_some_and(|e| e < t);
                if late {
                    self.dropped.push((m.sequence, DropCause::Ttl));
                }
                !late
            });
        }
        if let Some((class, end, bytes)) = self.sending
            && end == t
        {
            self.sending = None;
            let message = &mut self.queues[class][0];
            message.left -= bytes;
            if message.left == 0 {
                let m = self.queues[class].remove(0);
                self.delivered.push((m.sequence, m.begun.unwrap(), t, t + self.delay_ms));
            }
        }
        self.begin(t);
    }

    fn begin(&mut self, t: u64) {
        while self.sending.is_none() {
            let Some(class) = self.queues.iter().position(|queue| !queue.is_empty()) else {
                return;
            };
            let at = after(t as f64 / 1e3);
            let outage = self.model.outages.iter().find(|o| o.begin <= at && at < o.end);
            match outage.map(|o| o.traffic) {
                Some(OutageTraffic::Hold) => return,
                Some(OutageTraffic::Lose) => {
                    let lost = self.queues[class].remove(0);
                    self.dropped.push((lost.sequence, DropCause::Outage));
                }
                None => {
                    let message = &mut self.queues[class][0];
                    message.begun.get_or_insert(t);
                    let bytes = message.left.min(self.model.mtu_bytes);
                    self.sending = Some((class, t + u64::from(bytes), bytes));
                }
            }
        }
    }

    fn offer(&mut self, t: u64, class: LinkClass, bytes: u32, sequence: u64) {
        let rule = *self.model.queues.of(class);
        let queue = &mut self.queues[class as usize];
        let waiting = |queue: &[SlowMessage]| queue.iter().map(|m| u64::from(m.left)).sum::<u64>();
        while waiting(queue) + u64::from(bytes) > rule.bytes {
            let oldest = queue.iter().position(|m| m.begun.is_none());
            let fits = u64::from(bytes) <= rule.bytes;
            match oldest.filter(|_| fits && rule.when_full == WhenFull::DropOldest) {
                Some(oldest) => {
                    let gone = queue.remove(oldest);
                    self.dropped.push((gone.sequence, DropCause::Overflow));
                }
                None => {
                    self.dropped.push((sequence, DropCause::Overflow));
                    return;
                }
            }
        }
        let expires = rule.ttl_s.map(|ttl_s| t + (ttl_s * 1e3).round() as u64);
        queue.push(SlowMessage { sequence, left: bytes, begun: None, expires });
        self.begin(t);
    }
}

#[test]
fn every_time_and_drop_is_that_of_a_link_by_the_millisecond() {
    for seed in 0..cases(10_000) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let kind = Kind { overflow: true, ttl: true, outages: true, ..Kind::default() };
        let mut model = model(&mut rng, kind);
        // A byte a millisecond; everything else in whole milliseconds.
        model.rate_bps = Some(8000.0);
        let whole = |s: f64| (s * 1e3).round() / 1e3;
        let queues = &mut model.queues;
        for rule in [
            &mut queues.command,
            &mut queues.ack,
            &mut queues.housekeeping,
            &mut queues.telemetry,
            &mut queues.bulk,
        ] {
            rule.ttl_s = rule.ttl_s.map(|ttl_s| whole(ttl_s).max(0.001));
        }
        for outage in &mut model.outages {
            outage.begin = after(whole(outage.begin.seconds_since(START)));
            outage.end = after(whole(outage.end.seconds_since(START)) + 0.001);
        }
        model.outages.dedup_by(|later, earlier| later.begin < earlier.end);
        let delay_ms = rng.random_range(0..3000);
        let mut slow = Slow {
            model: model.clone(),
            delay_ms,
            queues: vec![Vec::new(); 6],
            sending: None,
            delivered: Vec::new(),
            dropped: Vec::new(),
        };
        let settings = Settings::new("up", delay_ms as f64 / 1e3, Some(&model)).unwrap();
        let mut link = Direction::new(settings, 10_000);
        let mut sequence = 0;
        for t in 0..4000 {
            slow.tick(t);
            while rng.random_bool(0.012) {
                let class = CLASSES[rng.random_range(0..6)];
                let bytes = rng.random_range(1..300);
                let _ = link.offer(after(t as f64 / 1e3), class, bytes, sequence);
                slow.offer(t, class, bytes, sequence);
                sequence += 1;
            }
        }
        (4000..60_000)
            .take_while(|t| {
                slow.tick(*t);
                slow.queues.iter().any(|queue| !queue.is_empty())
            })
            .count();
        let ms = |t: Timestamp| (t.0 - START.0) as f64 / 1e6;
        let mut found: Vec<_> = link
            .take_due(after(1e4))
            .iter()
            .map(|d| (d.sequence, ms(d.begun), ms(d.transmitted), ms(d.arrived)))
            .collect();
        found.sort_by_key(|d| d.0);
        slow.delivered.sort_unstable();
        let whole = |d: &(u64, u64, u64, u64)| (d.0, d.1 as f64, d.2 as f64, d.3 as f64);
        let expected: Vec<_> = slow.delivered.iter().map(whole).collect();
        assert_eq!(found, expected, "seed {seed}");
        let mut dropped: Vec<(u64, DropCause)> = Vec::new();
        for notice in link.take_notices() {
            if let Notice::Dropped { sequence, cause, .. } = notice {
                dropped.push((sequence, cause));
            }
        }
        dropped.sort_by_key(|d| d.0);
        slow.dropped.sort_by_key(|d| d.0);
        assert_eq!(dropped, slow.dropped, "seed {seed}");
    }
}

fn plain(delay_s: f64, capacity: usize) -> Direction<&'static str> {
    Direction::new(Settings::new("up", delay_s, None).unwrap(), capacity)
}

#[test]
fn a_shorter_delay_lets_no_message_overtake_but_estops() {
    let mut link = plain(5.0, 8);
    link.offer(START, LinkClass::Command, 100, "first").unwrap();
    link.set(after(1.0), Settings::new("up", 1.0, None).unwrap());
    link.offer(after(1.0), LinkClass::Command, 100, "second").unwrap();
    link.offer(after(1.0), LinkClass::Estop, 100, "stop").unwrap();
    let due = link.take_due(after(10.0));
    let order: Vec<_> = due.iter().map(|d| (d.item, d.arrived)).collect();
    assert_eq!(order, [("stop", after(2.0)), ("first", after(5.0)), ("second", after(5.0))]);
}

#[test]
fn a_full_link_refuses_commands_and_takes_estops() {
    let mut link = plain(1.0, 2);
    link.offer(START, LinkClass::Command, 10, "a").unwrap();
    link.offer(START, LinkClass::Telemetry, 10, "b").unwrap();
    let full = link.offer(START, LinkClass::Command, 10, "c").unwrap_err();
    assert!(full.to_string().contains("takes no more of this class"), "{full}");
    link.offer(START, LinkClass::Estop, 10, "stop").unwrap();
    let arrived: Vec<_> = link.take_due(after(1.0)).iter().map(|d| d.item).collect();
    assert_eq!(arrived, ["stop", "a", "b"]);
    assert_eq!((link.counters().dropped, link.counters().dropped_by.overflow), (1, 1));
}

#[test]
fn a_frame_under_way_ends_as_it_would_have_when_the_rate_changes() {
    let model = |rate_bps| DirectionModel { rate_bps: Some(rate_bps), ..Default::default() };
    let settings = |rate| Settings::new("up", 1.0, Some(&model(rate))).unwrap();
    let mut link = Direction::new(settings(800.0), 10);
    link.offer(START, LinkClass::Command, 100, "a").unwrap();
    link.offer(START, LinkClass::Command, 100, "b").unwrap();
    link.set(after(0.5), settings(8000.0));
    let ends: Vec<_> = link.take_due(after(9.0)).iter().map(|d| d.transmitted).collect();
    assert_eq!(ends, [after(1.0), after(1.1)]);
}

#[test]
fn what_is_out_of_range_is_refused_by_name() {
    let link = |change: &dyn Fn(&mut DirectionModel)| {
        let mut model = DirectionModel::default();
        change(&mut model);
        let config = LinkConfig { down: Some(model), ..LinkConfig::delays(1.0, 1.0) };
        check(&config).unwrap_err()
    };
    let outage =
        |begin, end| Outage { begin: after(begin), end: after(end), traffic: OutageTraffic::Hold };
    let entry = |at, delay_s| LightTime { time: after(at), delay_s };
    type Change<'a> = &'a dyn Fn(&mut DirectionModel);
    let bad: [(Change<'_>, &str); 17] = [
        (&|m| m.jitter = Jitter::Uniform { most_s: f64::NAN }, "down.jitter.most_s"),
        (&|m| m.jitter = Jitter::Uniform { most_s: -1.0 }, "down.jitter.most_s"),
        (
            &|m| m.jitter = Jitter::TruncatedNormal { sigma_s: 61.0, most_s: 1.0 },
            "down.jitter.sigma_s",
        ),
        (&|m| m.rate_bps = Some(0.0), "down.rate_bps"),
        (&|m| m.rate_bps = Some(f64::INFINITY), "down.rate_bps"),
        (&|m| m.mtu_bytes = 0, "down.mtu_bytes"),
        (&|m| m.queues.bulk.bytes = 0, "down.queues.bulk.bytes"),
        (&|m| m.queues.estop.ttl_s = Some(1.0), "down.queues.estop.ttl_s"),
        (&|m| m.queues.ack.ttl_s = Some(0.0), "down.queues.ack.ttl_s"),
        (&|m| m.loss = Loss::Bernoulli { probability: 1.01 }, "down.loss.probability"),
        (&|m| m.corruption = -0.1, "down.corruption"),
        (&|m| m.duplication = f64::NAN, "down.duplication"),
        (&|m| m.outages = vec![outage(2.0, 2.0)], "down.outages[0].end"),
        (&|m| m.outages = vec![outage(1.0, 3.0), outage(2.0, 4.0)], "down.outages[1].begin"),
        (&|m| m.light_times = vec![entry(1.0, 1.0), entry(1.0, 2.0)], "down.light_times[1].time"),
        (&|m| m.light_times = vec![entry(1.0, 1801.0)], "down.light_times[0].delay_s"),
        (&|m| m.seed = u64::MAX, "down.seed"),
    ];
    for (change, field) in bad {
        assert_eq!(link(change).field, field);
    }
    for delay_s in [-0.001, 1800.001, f64::NAN, f64::INFINITY] {
        assert_eq!(check(&LinkConfig::delays(1.0, delay_s)).unwrap_err().field, "down_delay_s");
    }
    let many = link(&|m| m.outages = vec![outage(1.0, 2.0); 1001]);
    assert_eq!(many.to_string(), "down.outages has 1001 entries; at most 1000 are taken");
}

#[test]
fn presets_are_usable_and_as_far_away_as_they_say() {
    for (name, _) in bridge::link::PRESETS {
        check(&preset(name).unwrap()).unwrap();
    }
    assert!(preset("venus").is_none());
    let light = 299_792.458;
    let moon = preset("moon").unwrap().up_delay_s;
    assert!((356_500.0 / light..406_700.0 / light).contains(&moon), "perigee to apogee");
    let mars = preset("mars").unwrap().up_delay_s;
    assert!((55e6 / light..401e6 / light).contains(&mars));
}
