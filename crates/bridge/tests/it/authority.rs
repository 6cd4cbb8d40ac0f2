//! C3: one commander at a time, over random histories with partitions, pauses and other orders; and
//! the rules one by one.

use bridge::commands::{Authority, AuthorityError, AuthorityRules, CommandBook, CommandError};
use bridge::link::{Direction, Settings};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{DirectionModel, Jitter, LinkClass};
use wire::time::Timestamp;

use crate::support::{START, after, cases, motion, uuid};

fn authority(explicit: bool) -> Authority {
    Authority::new(START, AuthorityRules { explicit, lease_s: 30.0 }, 0)
}

#[test]
fn it_is_acquired_renewed_released_and_lapses() {
    let mut a = authority(true);
    assert_eq!(a.exercise(START, "ada"), Err(AuthorityError::Needed));
    let first = a.acquire(START, "ada").unwrap();
    assert_eq!(a.acquire(after(10.0), "ada"), Ok(first), "its holder renews it");
    let held = AuthorityError::Held { holder: "ada".into(), until: after(40.0) };
    assert_eq!(a.acquire(after(40.0), "bob"), Err(held));
    let second = a.acquire(after(40.001), "bob").unwrap();
    assert!(second > first, "it has lapsed");
    assert!(a.renew(after(41.0), "ada").is_err() && a.release(after(41.0), "ada").is_err());
    let third = a.take_over(after(42.0), "ada");
    assert!(third > second && a.check(after(42.0), second).is_err());
    a.release(after(43.0), "ada").unwrap();
    assert_eq!(a.check(after(43.0), third), Err(AuthorityError::PassedOn));
    assert_eq!(a.report(after(43.0)).holder, None);
}

#[test]
fn it_is_asked_for_a_minute_and_handed_over_by_its_holder_alone() {
    let mut a = authority(true);
    assert_eq!(a.ask(START, "ada"), Ok(false), "nobody has it: it is taken");
    let first = a.report(START);
    assert_eq!(first.holder.as_deref(), Some("ada"));
    assert_eq!(a.ask(after(1.0), "ada"), Err(AuthorityError::HasIt { who: "ada".into() }));
    assert_eq!(a.ask(after(1.0), "bob"), Ok(true));
    assert_eq!(a.ask(after(2.0), "bob"), Ok(false), "no news");
    let asked = a.report(after(2.0));
    assert_eq!((asked.asked_by.as_deref(), asked.epoch), (Some("bob"), first.epoch));
    assert_eq!(a.ask(after(3.0), "eve"), Ok(true), "the last who asks is shown");
    // A refused request changes nothing, the lease neither.
    let not_his = AuthorityError::NotHolder { who: "bob".into() };
    assert_eq!(a.hand_over(after(10.0), "bob", "bob"), Err(not_his));
    let has_it = AuthorityError::HasIt { who: "ada".into() };
    assert_eq!(a.hand_over(after(10.0), "ada", "ada"), Err(has_it));
    assert_eq!(a.report(after(10.0)).until, Some(after(30.0)));
    a.renew(after(29.0), "ada").unwrap();
    a.renew(after(58.0), "ada").unwrap();
    assert_eq!(a.report(after(62.9)).asked_by.as_deref(), Some("eve"));
    assert_eq!(a.report(after(63.1)).asked_by, None, "a minute after it was asked");
    // Who is handed it need not have asked; the request is answered with it.
    a.ask(after(64.0), "eve").unwrap();
    let handed = a.hand_over(after(65.0), "ada", "bob").unwrap();
    assert!(handed > first.epoch && a.check(after(65.0), first.epoch).is_err());
    let report = a.report(after(65.0));
    assert_eq!((report.holder.as_deref(), report.asked_by), (Some("bob"), None));
    assert_eq!(report.until, Some(after(95.0)));
}

#[test]
fn without_a_rule_arming_acquires_it_where_nobody_has_it() {
    let mut a = authority(false);
    let first = a.exercise(START, "ada").unwrap();
    assert!(matches!(a.exercise(after(1.0), "bob"), Err(AuthorityError::Held { .. })));
    assert_eq!(a.may(after(1.0), "ada"), Ok(()));
    assert_eq!(a.exercise(after(29.0), "ada"), Ok(first));
    assert!(a.exercise(after(59.1), "bob").unwrap() > first);
}

#[test]
fn epochs_grow_over_restarts_also_when_the_clock_went_back() {
    let mut before = authority(false);
    let epoch = before.exercise(START, "ada").unwrap();
    let mut later = Authority::new(after(1.0), AuthorityRules::default(), 0);
    assert!(later.exercise(after(1.0), "ada").unwrap() > epoch);
    let mut back = Authority::new(Timestamp(0), AuthorityRules::default(), epoch);
    assert!(back.exercise(Timestamp(0), "ada").unwrap() > epoch);
}

#[test]
fn c3_no_two_epochs_are_accepted_out_of_order_and_one_commands_at_a_time() {
    let persons = ["ada", "bob", "eve", "kim"];
    let mut accepted_in_all = 0;
    for seed in 0..cases(100_000) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut a = authority(rng.random_bool(0.5));
        let jitter = Jitter::Uniform { most_s: 40.0 };
        let model = DirectionModel {
            jitter,
            in_order: false,
            duplication: 0.3,
            seed,
            ..DirectionModel::default()
        };
        let mut up = Direction::new(Settings::new("up", 1.3, Some(&model)).unwrap(), 1000);
        // A console thinks that it holds the authority until it is told otherwise: partitions and
        // pauses are consoles that act on what they knew.
        let mut thinks: [Option<u64>; 4] = [None; 4];
        let mut holder: Option<(usize, u64, Timestamp)> = None;
        let (mut now, mut highest, mut rover) = (START, 0, None);
        for _ in 0..40 {
            // Pauses; a clock that is set back counts as one that stands.
            let forward = rng.random_range(0.0..20.0);
            let pause = if rng.random_bool(0.1) { 100.0 } else { forward };
            now = now.plus_seconds(if rng.random_bool(0.3) { 0.0 } else { pause });
            let person = rng.random_range(0..4);
            let alive = holder.filter(|(.., until)| *until >= now);
            match rng.random_range(0..12) {
                0..3 => {
                    let given = a.acquire(now, persons[person]);
                    let free = alive.is_none_or(|(other, ..)| other == person);
                    assert_eq!(given.is_ok(), free, "seed {seed}: {alive:?}");
                    if let Ok(epoch) = given {
                        let renewed = alive.is_some_and(|(_, same, _)| same == epoch);
                        assert!(renewed || epoch > highest, "seed {seed}: a new number");
                        highest = highest.max(epoch);
                        thinks[person] = Some(epoch);
                        holder = Some((person, epoch, now.plus_seconds(30.0)));
                    }
                }
                3 => {
                    let epoch = a.take_over(now, persons[person]);
                    if alive.is_none_or(|(other, ..)| other != person) {
                        assert!(epoch > highest, "seed {seed}");
                        holder = Some((person, epoch, now.plus_seconds(30.0)));
                    }
                    highest = highest.max(epoch);
                    thinks[person] = Some(epoch);
                }
                4 => {
                    let released = a.release(now, persons[person]);
                    let held = alive.is_some_and(|(other, ..)| other == person);
                    assert_eq!(released.is_ok(), held, "seed {seed}");
                    if held {
                        holder = None;
                    }
                }
                5 => {
                    let asked = a.ask(now, persons[person]);
                    let has_it = alive.is_some_and(|(other, ..)| other == person);
                    assert_eq!(asked.is_err(), has_it, "seed {seed}");
                    if alive.is_none() {
                        let epoch = a.report(now).epoch;
                        assert!(epoch > highest, "seed {seed}: free, so it was taken");
                        (highest, thinks[person]) = (epoch, Some(epoch));
                        holder = Some((person, epoch, now.plus_seconds(30.0)));
                    }
                }
                6 => {
                    let to = rng.random_range(0..4);
                    let given = a.hand_over(now, persons[person], persons[to]);
                    let held = alive.is_some_and(|(other, ..)| other == person);
                    assert_eq!(given.is_ok(), held && to != person, "seed {seed}");
                    if let Ok(epoch) = given {
                        assert!(epoch > highest, "seed {seed}: handed over");
                        (highest, thinks[to]) = (epoch, Some(epoch));
                        holder = Some((to, epoch, now.plus_seconds(30.0)));
                    }
                }
                // Sends what it thinks it may: the release path decides.
                _ => {
                    let Some(epoch) = thinks[person] else { continue };
                    let may = a.check(now, epoch).is_ok();
                    let right = alive.is_some_and(|(_, current, _)| current == epoch);
                    assert_eq!(may, right, "seed {seed}");
                    if may {
                        up.offer(now, LinkClass::Command, 10, epoch).unwrap();
                    }
                }
            }
            for arrived in up.take_due(now) {
                // The rule on board, as `sim` has it.
                if Some(arrived.item) >= rover {
                    rover = Some(arrived.item);
                    accepted_in_all += 1;
                }
            }
        }
    }
    assert!(accepted_in_all > cases(100_000), "{accepted_in_all}");
}

#[test]
fn two_persons_approve_the_content_they_saw_for_ten_minutes() {
    let mut book = CommandBook::default();
    let mut hazardous = motion(&uuid(1), 10.0, None);
    hazardous.two_persons = true;
    let record = book.stage(START, hazardous).unwrap();
    let hash = record.approval.unwrap().content_hash;
    let code = |error: CommandError| error.code();
    assert_eq!(book.arm(START, &uuid(1), "ada").map_err(code), Err("approval_needed"));
    let approve = |book: &mut CommandBook, who: &str, hash: &str| {
        book.approve(START, &uuid(1), who, hash).map(|_| ()).map_err(code)
    };
    assert_eq!(approve(&mut book, "ada", &hash), Err("self_approval"));
    assert_eq!(approve(&mut book, "bob", "0123"), Err("approval_of_other"));
    assert_eq!(approve(&mut book, "bob", &hash), Ok(()));
    assert_eq!(book.arm(after(600.001), &uuid(1), "ada").map_err(code), Err("approval_needed"));
    book.arm(after(590.0), &uuid(1), "ada").unwrap();
    let light = bridge::commands::LightTimes { up_s: 1.3, down_s: 1.3, spread_s: 0.0 };
    let late = book.send(after(601.0), &uuid(1), "ada", light).map(|_| ()).map_err(code);
    assert_eq!(late, Err("approval_needed"), "it must hold when the command is sent");
    let plain = book.stage(START, motion(&uuid(2), 1.0, None)).unwrap();
    assert_eq!(plain.approval, None);
    let not = book.approve(START, &uuid(2), "bob", "").map(|_| ()).map_err(code);
    assert_eq!(not, Err("approval_not_needed"));
}

#[test]
fn another_content_has_another_hash() {
    let mut seen = std::collections::BTreeSet::new();
    let changes: [fn(&mut bridge::commands::StageCommand); 6] = [
        |_| {},
        |c| c.id = Some(uuid(2)),
        |c| c.body = wire::live::CommandBody::Stop {},
        |c| c.basis_tolerance_rad = 0.03,
        |c| drop(c.basis_joints_rad.insert("leg2".into(), vec![0.0; 6])),
        |c| c.model_hash = Some("other".into()),
    ];
    for change in changes {
        let mut command = motion(&uuid(1), 1.0, None);
        command.two_persons = true;
        change(&mut command);
        let record = CommandBook::default().stage(START, command).unwrap();
        assert!(seen.insert(record.approval.unwrap().content_hash));
    }
}
