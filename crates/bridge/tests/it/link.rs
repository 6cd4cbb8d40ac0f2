//! The promises of the delay line, over random histories.

use bridge::link::{DelayLine, Delivered, Priority, QueueFull};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::time::Timestamp;

use crate::support::{START, after};

const CASES: u64 = 10_000;

/// What the history of a message says about its arrival.
#[derive(Debug, Clone, Copy)]
struct Offered {
    sent: Timestamp,
    light_ns: u64,
    urgent: bool,
    /// The latest arrival of the messages in order before it.
    behind: Timestamp,
}

/// Plays one random history and checks every promise at every step; gives the trace.
fn play(seed: u64) -> Vec<Delivered<u64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let capacity = rng.random_range(1..12);
    let mut delay_s: f64 = rng.random_range(0.0..3.0);
    let mut line = DelayLine::new(delay_s, capacity).unwrap();
    let (mut now, mut history, mut trace) = (START, Vec::<Offered>::new(), Vec::new());
    let (mut behind, mut dropped) = (Timestamp(0), 0);
    for _ in 0..40 {
        now = Timestamp(now.0 + rng.random_range(0..500_000_000_u64));
        match rng.random_range(0..10) {
            0..6 => {
                let (urgent, priority) = match rng.random_range(0..5) {
                    0 => (true, Priority::Urgent),
                    1..3 => (false, Priority::Normal),
                    _ => (false, Priority::Expendable),
                };
                let light_ns = (delay_s * 1e9).round() as u64;
                let before = line.counters().dropped;
                let offered = line.offer(now, priority, history.len() as u64);
                dropped += u64::from(offered.is_err());
                if offered.is_ok() && line.counters().dropped > before {
                    assert_eq!(priority, Priority::Expendable, "only these displace others");
                    dropped += 1;
                }
                history.push(Offered { sent: now, light_ns, urgent, behind });
                if offered.is_ok() && !urgent {
                    behind = behind.max(Timestamp(now.0 + light_ns));
                }
            }
            6..9 => {
                let due = line.take_due(now);
                assert!(line.next_arrival().is_none_or(|next| next > now), "nothing due stays");
                trace.extend(due);
            }
            _ => {
                delay_s = rng.random_range(0.0..3.0);
                line.set_delay(now, delay_s).unwrap();
            }
        }
        let counters = line.counters();
        assert_eq!(counters.sent, counters.delivered + counters.dropped + counters.in_flight);
        assert_eq!(counters.sent, history.len() as u64);
        assert_eq!((counters.delivered, counters.dropped), (trace.len() as u64, dropped));
    }
    trace.extend(line.take_due(now.plus_seconds(10.0)));
    assert_eq!(line.counters().in_flight, 0, "all that is under way arrives");
    check_trace(&trace, &history);
    trace
}

fn check_trace(trace: &[Delivered<u64>], history: &[Offered]) {
    let mut last_in_order = None;
    for delivered in trace {
        assert_eq!(delivered.item, delivered.sequence);
        let offered = history[delivered.item as usize];
        let light = Timestamp(offered.sent.0 + offered.light_ns);
        assert_eq!(delivered.sent, offered.sent);
        if offered.urgent {
            assert_eq!(delivered.arrived, light, "an urgent one waits for its light time only");
        } else {
            assert!(delivered.arrived >= light, "nothing arrives before its light time");
            assert!(delivered.arrived <= light.max(offered.behind), "nor waits without a reason");
            assert!(last_in_order < Some(delivered.sequence), "in order");
            last_in_order = Some(delivered.sequence);
        }
    }
    assert!(trace.is_sorted_by_key(|delivered| delivered.arrived), "in order of arrival");
}

#[test]
fn light_time_order_and_conservation_hold_over_random_histories() {
    for seed in 0..CASES {
        play(seed);
    }
}

#[test]
fn the_same_seed_gives_the_same_trace() {
    for seed in 0..100 {
        assert_eq!(play(seed), play(seed), "seed {seed}");
    }
}

#[test]
fn a_shorter_delay_lets_no_message_overtake_but_urgent_ones() {
    let mut line = DelayLine::new(5.0, 8).unwrap();
    line.offer(START, Priority::Normal, "first").unwrap();
    line.set_delay(after(1.0), 1.0).unwrap();
    line.offer(after(1.0), Priority::Normal, "second").unwrap();
    line.offer(after(1.0), Priority::Urgent, "stop").unwrap();
    let due = line.take_due(after(10.0));
    let order: Vec<_> = due.iter().map(|d| (d.item, d.arrived)).collect();
    assert_eq!(order, [("stop", after(2.0)), ("first", after(5.0)), ("second", after(5.0))]);
}

#[test]
fn a_full_line_refuses_commands_gives_up_old_telemetry_and_takes_urgent_messages() {
    let mut line = DelayLine::new(1.0, 2).unwrap();
    line.offer(START, Priority::Normal, 0).unwrap();
    line.offer(START, Priority::Expendable, 1).unwrap();
    assert_eq!(line.offer(START, Priority::Normal, 2), Err(QueueFull { in_flight: 2 }));
    line.offer(START, Priority::Expendable, 3).unwrap();
    line.offer(START, Priority::Urgent, 4).unwrap();
    let arrived: Vec<_> = line.take_due(after(1.0)).iter().map(|d| d.item).collect();
    assert_eq!(arrived, [4, 0, 3]);
    assert_eq!(line.counters().dropped, 2);
}

#[test]
fn delays_out_of_range_are_refused() {
    let mut line = DelayLine::<()>::new(1.3, 1).unwrap();
    for bad in [-0.001, 1800.001, f64::NAN, f64::INFINITY] {
        assert!(line.set_delay(START, bad).is_err(), "{bad}");
    }
    assert!((line.delay_s() - 1.3).abs() < 1e-12, "the delay stays");
    line.set_delay(START, 1800.0).unwrap();
}
