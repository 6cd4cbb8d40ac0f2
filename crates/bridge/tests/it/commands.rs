//! The life of commands: single rules, then all of them over random histories.

use std::collections::{BTreeMap, HashMap, HashSet};

use bridge::commands::{
    CommandBook, CommandError, LightTimes, MAX_COMMANDS, StageCommand, is_terminal,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{AckStage, CommandEvent, CommandRecord, CommandState, Executing, Uplink};
use wire::time::Timestamp;

use crate::support::{START, after, back, motion, uuid};

const MOON: LightTimes = LightTimes { up_s: 1.3, down_s: 1.3, spread_s: 0.0 };

/// A book with one command of 10 s that was sent at the start.
fn with_one_sent() -> CommandBook {
    let mut book = CommandBook::default();
    book.stage(START, motion(&uuid(1), 10.0, None)).unwrap();
    book.arm(START, &uuid(1), "ada").unwrap();
    book.send(START, &uuid(1), "ada", MOON).unwrap();
    book.transmitted(START, &uuid(1), after(1.3), MOON);
    book
}

fn state(book: &CommandBook, id: u64) -> CommandState {
    book.get(&uuid(id)).unwrap().state
}

#[test]
fn a_command_goes_from_staged_to_done_and_every_step_is_an_event() {
    let mut book = with_one_sent();
    let record = book.get(&uuid(1)).unwrap();
    assert_eq!((record.sent, record.arrives), (Some(START), Some(after(1.3))));
    assert_eq!(record.earliest_ack, Some(after(2.6)));
    assert_eq!(record.overdue_after, Some(after(4.6)), "2 s after the earliest possible word");
    book.acknowledge(after(2.6), &uuid(1), AckStage::Received, None);
    let record = book.get(&uuid(1)).unwrap();
    assert_eq!(record.overdue_after, Some(after(2.6 + 15.0 + 5.0)), "1.5 durations and 5 s");
    book.acknowledge(after(2.7), &uuid(1), AckStage::Started, None);
    let executing = Executing { command_id: uuid(1), progress: 0.5, step: None };
    book.progress(after(7.6), &executing);
    book.acknowledge(after(12.6), &uuid(1), AckStage::Completed, None);
    let record = book.get(&uuid(1)).unwrap();
    assert_eq!((record.state, record.progress), (CommandState::Done, 1.0));
    use CommandState::{Armed, Done, Executing as Moves, Received, Sent, Staged};
    let events = book.take_events();
    let states: Vec<_> = events.iter().map(|event| event.state).collect();
    assert_eq!(states, [Staged, Armed, Sent, Sent, Received, Moves, Moves, Done]);
    assert_eq!(events[3].why.as_deref(), Some("transmitted"));
    let who: Vec<_> = events.iter().map(|event| &*event.who).collect();
    assert_eq!(who, ["ada", "ada", "ada", "server", "rover", "rover", "rover", "rover"]);
}

#[test]
fn staging_twice_gives_the_same_answer_and_another_content_is_refused() {
    let mut book = CommandBook::default();
    let first = book.stage(START, motion(&uuid(1), 10.0, None)).unwrap();
    assert_eq!(book.stage(after(1.0), motion(&uuid(1), 10.0, None)).unwrap(), first);
    assert_eq!(book.take_events().len(), 1, "the repeat is no event");
    let other = book.stage(START, motion(&uuid(1), 11.0, None)).unwrap_err();
    assert_eq!(other.code(), "id_reused");
    let invalid = book.stage(START, motion("../../etc/passwd", 1.0, None)).unwrap_err();
    assert_eq!(invalid.code(), "id_invalid");
    let endless = book.stage(START, motion(&uuid(2), f64::NAN, None)).unwrap_err();
    assert_eq!(endless.code(), "duration_invalid");
    let given = StageCommand { id: None, ..motion("", 1.0, None) };
    let ids = [(); 2].map(|()| book.stage(START, given.clone()).unwrap().id);
    assert_ne!(ids[0], ids[1], "the server gives identities of its own");
}

#[test]
fn sending_takes_an_armed_command_within_its_window() {
    let mut book = CommandBook::default();
    book.stage(START, motion(&uuid(1), 10.0, None)).unwrap();
    let send = |book: &mut CommandBook, at| {
        book.send(at, &uuid(1), "ada", MOON).map(|(_, uplink)| uplink).map_err(|e| e.code())
    };
    assert_eq!(send(&mut book, START), Err("not_armed"));
    book.arm(START, &uuid(1), "ada").unwrap();
    assert_eq!(send(&mut book, after(30.1)), Err("arm_expired"));
    assert_eq!(state(&book, 1), CommandState::Staged);
    book.arm(after(40.0), &uuid(1), "ada").unwrap();
    let uplink = send(&mut book, after(70.0)).unwrap();
    let Uplink::Command { id, basis_joints_rad, .. } = uplink else { panic!("{uplink:?}") };
    assert_eq!((id, basis_joints_rad.len()), (uuid(1), 1));
    assert_eq!(send(&mut book, after(70.0)), Err("not_armed"), "nothing is sent twice");
    assert_eq!(book.cancel(after(71.0), &uuid(1), "ada").unwrap_err().code(), "already_terminal");
    assert_eq!(book.cancel(START, &uuid(9), "ada").unwrap_err().code(), "command_unknown");
}

#[test]
fn an_armed_command_lapses_to_staged() {
    let mut book = CommandBook::default();
    book.stage(START, motion(&uuid(1), 10.0, None)).unwrap();
    book.arm(START, &uuid(1), "ada").unwrap();
    assert_eq!(book.next_deadline(), Some(after(30.0)));
    book.tick(after(30.0));
    assert_eq!(state(&book, 1), CommandState::Armed);
    book.tick(after(30.001));
    assert_eq!(state(&book, 1), CommandState::Staged);
}

#[test]
fn the_commands_of_a_plan_go_in_order() {
    let mut book = CommandBook::default();
    for index in 0..3 {
        book.stage(START, motion(&uuid(index), 1.0, Some(("step", index as usize)))).unwrap();
    }
    book.stage(START, motion(&uuid(9), 1.0, None)).unwrap();
    let refused = book.arm(START, &uuid(1), "ada").unwrap_err();
    assert_eq!(refused, CommandError::Order { id: uuid(1), index: 1, next: 0 });
    book.arm(START, &uuid(0), "ada").unwrap();
    assert_eq!(book.arm(START, &uuid(9), "ada").unwrap_err().code(), "other_armed");
    book.send(START, &uuid(0), "ada", MOON).unwrap();
    assert_eq!(book.arm(START, &uuid(1), "ada").unwrap_err().code(), "order", "not done yet");
    book.acknowledge(after(4.0), &uuid(0), AckStage::Completed, None);
    book.arm(after(4.0), &uuid(1), "ada").unwrap();
    book.expire(after(5.0), &uuid(1), "the rover has moved").unwrap();
    assert_eq!(book.arm(after(5.0), &uuid(2), "ada").unwrap_err().code(), "order");
    book.stage(after(6.0), motion(&uuid(4), 1.0, Some(("step", 1)))).unwrap();
    book.arm(after(6.0), &uuid(4), "ada").unwrap();
}

#[test]
fn silence_makes_a_command_overdue_and_a_late_word_takes_it_further() {
    let mut book = with_one_sent();
    book.tick(after(4.6));
    assert_eq!(state(&book, 1), CommandState::Sent);
    book.tick(after(4.7));
    assert_eq!(state(&book, 1), CommandState::Overdue);
    assert!(book.get(&uuid(1)).unwrap().why.as_deref().unwrap().contains("outcome unknown"));
    book.tick(after(1e6));
    assert_eq!(book.take_events().len(), 5, "overdue is told once, and nothing is sent again");
    book.acknowledge(after(1e6), &uuid(1), AckStage::Completed, None);
    assert_eq!(state(&book, 1), CommandState::Done);
}

#[test]
fn telemetry_that_shows_the_motion_keeps_it_from_being_overdue() {
    let mut book = with_one_sent();
    for tenth in 26..600 {
        let at = after(f64::from(tenth) / 10.0);
        book.progress(at, &Executing { command_id: uuid(1), progress: 0.1, step: None });
        book.tick(at);
        assert_eq!(state(&book, 1), CommandState::Executing);
    }
    book.tick(after(66.0));
    assert_eq!(state(&book, 1), CommandState::Overdue, "5 s after the last frame that showed it");
}

#[test]
fn a_longer_delay_of_telemetry_moves_the_times_of_what_is_under_way() {
    let mut book = with_one_sent();
    book.allow_longer(after(1.0), "ada", 10.0);
    let record = book.get(&uuid(1)).unwrap();
    assert_eq!((record.earliest_ack, record.overdue_after), (Some(after(12.6)), Some(after(14.6))));
    book.allow_longer(after(2.0), "ada", 1.0);
    let record = book.get(&uuid(1)).unwrap();
    assert_eq!(record.earliest_ack, Some(after(12.6)), "its word was under way already");
    assert_eq!(record.overdue_after, Some(after(15.6)));
}

#[test]
fn memory_holds_1000_commands_and_lets_go_of_ended_ones_first() {
    let mut book = CommandBook::default();
    for number in 0..MAX_COMMANDS as u64 {
        book.stage(START, motion(&uuid(number), 1.0, None)).unwrap();
    }
    let full = book.stage(START, motion(&uuid(5000), 1.0, None)).unwrap_err();
    assert_eq!(full.code(), "queue_full");
    book.cancel(START, &uuid(500), "ada").unwrap();
    book.stage(START, motion(&uuid(5000), 1.0, None)).unwrap();
    assert!(book.get(&uuid(500)).is_none(), "the ended one has left");
    assert_eq!(book.records().count(), MAX_COMMANDS);
}

/// Arms, sends and completes a command.
#[track_caller]
fn complete(book: &mut CommandBook, id: &str) {
    book.arm(START, id, "ada").unwrap();
    book.send(START, id, "ada", MOON).unwrap();
    assert!(book.acknowledge(START, id, AckStage::Completed, None));
}

#[test]
fn a_plan_is_backed_out_in_order_and_then_goes_back_only() {
    let mut book = CommandBook::default();
    let nothing = book.stage(START, back(&uuid(9), "step", 0, 3)).unwrap_err();
    assert_eq!(nothing, CommandError::NotExecuted { undoes: 0, done: 0 });
    for index in 0..3 {
        book.stage(START, motion(&uuid(index), 1.0, Some(("step", index as usize)))).unwrap();
    }
    complete(&mut book, &uuid(0));
    complete(&mut book, &uuid(1));
    let not_yet = book.stage(START, back(&uuid(12), "step", 2, 3)).unwrap_err();
    assert_eq!(not_yet, CommandError::NotExecuted { undoes: 2, done: 2 });
    for undoes in 0..2 {
        book.stage(START, back(&uuid(10 + undoes), "step", undoes as usize, 3)).unwrap();
    }
    let order = book.arm(START, &uuid(10), "ada").unwrap_err();
    assert_eq!(order, CommandError::BackOrder { id: uuid(10), undoes: 0, done: 2 });
    assert!(book.is_next(&uuid(11)) && book.is_next(&uuid(2)), "there and back are both open");

    complete(&mut book, &uuid(11));
    let forward = book.get(&uuid(2)).unwrap();
    assert_eq!(forward.state, CommandState::Expired);
    assert_eq!(forward.why.as_deref(), Some("the plan is being backed out"));
    let forward = book.stage(START, motion(&uuid(3), 1.0, Some(("step", 1)))).unwrap_err();
    assert_eq!((&forward, forward.code()), (&CommandError::BackingOut, "backing_out"));
    let again = book.stage(START, back(&uuid(13), "step", 1, 3)).unwrap_err();
    assert_eq!(again, CommandError::NotExecuted { undoes: 1, done: 1 });
    complete(&mut book, &uuid(10));
    assert!(book.stage(START, motion(&uuid(4), 1.0, Some(("step", 0)))).is_err());
    book.stage(START, motion(&uuid(5), 1.0, Some(("other", 0)))).unwrap();
}

#[test]
fn nothing_is_undone_while_a_command_of_the_plan_is_under_way() {
    let mut book = CommandBook::default();
    for index in 0..2 {
        book.stage(START, motion(&uuid(index), 1.0, Some(("step", index as usize)))).unwrap();
    }
    complete(&mut book, &uuid(0));
    book.stage(START, back(&uuid(10), "step", 0, 2)).unwrap();
    book.arm(START, &uuid(1), "ada").unwrap();
    book.send(START, &uuid(1), "ada", MOON).unwrap();
    let under_way = CommandError::PlanUnderWay { other: uuid(1) };
    assert_eq!(book.stage(START, back(&uuid(11), "step", 0, 2)).unwrap_err(), under_way);
    assert_eq!(book.arm(START, &uuid(10), "ada").unwrap_err(), under_way);
    // Refused on board: nothing has moved, and both ways are open again.
    book.acknowledge(START, &uuid(1), AckStage::Rejected, Some("busy"));
    book.stage(START, motion(&uuid(2), 1.0, Some(("step", 1)))).unwrap();
    complete(&mut book, &uuid(2));
    let expired = book.get(&uuid(10)).unwrap();
    assert_eq!(expired.state, CommandState::Expired);
    assert_eq!(expired.why.as_deref(), Some("the plan has gone on since"));
}

/// One random history of the book. Errors are part of it; what counts are the invariants.
fn play(seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut book, mut events) = (CommandBook::default(), Vec::new());
    let mut now = START;
    for _ in 0..80 {
        now = now.plus_seconds(rng.random_range(0.0..8.0));
        let id = uuid(rng.random_range(0..8));
        let before = book.get(&id).map(|record| record.state);
        match rng.random_range(0..16) {
            0..3 => {
                let plan = [None, Some(("a", 0)), Some(("a", 1)), Some(("b", 0))];
                let command = match rng.random_range(0..plan.len() + 2) {
                    n if n < plan.len() => motion(&id, 3.0, plan[n]),
                    n => back(&id, "a", n - plan.len(), 2),
                };
                let _ = book.stage(now, command);
            }
            3..7 => {
                let _ = book.arm(now, &id, "ada");
            }
            7..10 => {
                let sent = book.send(now, &id, "ada", MOON);
                assert!(sent.is_err() || before == Some(CommandState::Armed), "seed {seed}");
                if rng.random_bool(0.8) {
                    let waited_s = rng.random_range(0..3);
                    let arrives = now.plus_seconds(f64::from(waited_s) + MOON.up_s);
                    book.transmitted(now.plus_seconds(f64::from(waited_s)), &id, arrives, MOON);
                }
            }
            10 => {
                let _ = book.cancel(now, &id, "ada");
            }
            11 => {
                let _ = book.expire(now, &id, "stale");
            }
            12..14 => {
                use AckStage::{Aborted, Completed, Failed, Received, Rejected, Started};
                let stages = [Received, Received, Started, Completed, Completed, Rejected];
                let rare = [Failed, Aborted];
                let stage = match rng.random_range(0..10) {
                    n @ 0..2 => rare[n],
                    _ => stages[rng.random_range(0..stages.len())],
                };
                book.acknowledge(now, &id, stage, None);
            }
            14 => {
                let progress = rng.random_range(-0.1..1.1);
                book.progress(now, &Executing { command_id: id, progress, step: None });
            }
            _ if rng.random_bool(0.3) => book.disarm_all(now, "ada", "E-stop"),
            _ => book.tick(now),
        }
        events.append(&mut book.take_events());
        let armed = book.records().filter(|record| record.state == CommandState::Armed).count();
        assert!(armed <= 1, "seed {seed}: {armed} commands armed");
    }
    check_history(seed, &events);
    let folded: BTreeMap<String, CommandRecord> =
        events.iter().map(|event| (event.command.id.clone(), event.command.clone())).collect();
    let held: BTreeMap<String, CommandRecord> =
        book.records().map(|record| (record.id.clone(), record.clone())).collect();
    assert_eq!(folded, held, "seed {seed}: the state is the fold of the events");
}

fn check_history(seed: u64, events: &[CommandEvent]) {
    let mut last = HashMap::<&str, (CommandState, Timestamp)>::new();
    let mut done = HashMap::<&str, usize>::new();
    let mut backing_out = HashSet::<&str>::new();
    for event in events {
        let id = &*event.command.id;
        let before = last.insert(id, (event.state, event.time));
        assert_eq!(event.state, event.command.state);
        if let Some((state, _)) = before {
            assert!(!is_terminal(state), "seed {seed}: {id} was {state:?} and changed");
        }
        match event.state {
            CommandState::Sent => {
                let (state, armed) = before.unwrap();
                if state == CommandState::Sent {
                    // It waited for the link: a correction of its times, not another sending.
                    assert_eq!(event.why.as_deref(), Some("transmitted"), "seed {seed}");
                    assert!(event.command.sent <= Some(event.time), "seed {seed}");
                    continue;
                }
                assert_eq!(state, CommandState::Armed, "seed {seed}: no send without arm");
                assert!(event.time.seconds_since(armed) <= 30.0, "seed {seed}: within 30 s");
            }
            CommandState::Armed => {
                if let Some(plan) = &event.command.plan {
                    let done = done.get(&*plan.plan_id).copied().unwrap_or(0);
                    let after = if plan.retreat { 2 - plan.index } else { plan.index };
                    assert_eq!(after, done, "seed {seed}: a plan goes in order");
                    let turned = backing_out.contains(&*plan.plan_id);
                    assert!(plan.retreat || !turned, "seed {seed}: and once back, back only");
                }
            }
            CommandState::Done => {
                if let Some(plan) = &event.command.plan {
                    let done = done.entry(&plan.plan_id).or_default();
                    if plan.retreat {
                        *done -= 1;
                        backing_out.insert(&plan.plan_id);
                    } else {
                        *done += 1;
                    }
                }
            }
            _ => {}
        }
    }
}

#[test]
fn no_history_breaks_the_rules() {
    for seed in 0..4_000 {
        play(seed);
    }
}
