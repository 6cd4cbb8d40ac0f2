//! The power goes at any call: what was acknowledged is there, and every log can be read.
//!
//! `FOOTFALL_FULL=1` takes every single call of the long scenario; without, every one of a short
//! scenario and a sample of the long one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use bridge::doctor;
use bridge::reader::{Limits, read_log};
use bridge::recorder::{COMMIT_MS, Recorder, RecorderError, RecorderOptions};
use bridge::recover::recover;
use bridge::seal::{OWN, read_seal};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::time::Instant;

use crate::recorder::options;
use crate::sim_fs::{Fault, SimFs, Survives};
use crate::support::{after, record};

fn small_segments() -> RecorderOptions {
    // Some ten segments in the long scenario; sealed between two batches, so that every call of the
    // sealing, too, has its number.
    RecorderOptions { segment_bytes: 40_000, seal_aside: false, ..options() }
}

/// What became of a scenario that may have ended early.
#[derive(Default)]
pub struct Told {
    /// The recorder has started.
    started: bool,
    /// Commands whose message was acknowledged.
    pub acknowledged: Vec<u32>,
    /// Telemetry that came before an acknowledged command, and so is safe with it.
    telemetry: u32,
    /// Where it ended with an error.
    failed: bool,
}

/// Events of a command: staged, armed, sent, received, completed.
const EVENTS: u32 = 5;

/// `commands` commands of five events each, every event awaited, a frame of telemetry before each.
pub fn scenario(fs: &SimFs, commands: u32) -> Told {
    let mut told = Told::default();
    let Ok(mut recorder) = Recorder::start_on(Box::new(fs.clone()), small_segments()) else {
        return Told { failed: true, ..told };
    };
    told.started = true;
    for number in 0..commands * EVENTS {
        let at = after(f64::from(number) * 0.1);
        let frame = format!("{{\"frame\":{number},\"height_m\":1.9{}}}", number % 97);
        recorder.record(record("rover/state", number.into(), at, frame));
        let event = format!("{{\"command\":{{\"id\":\"c{}\"}},\"n\":{number}}}", number / EVENTS);
        let written = recorder.record_durable(record("command/event", number.into(), at, event));
        match written.and_then(|written| written.wait_blocking()) {
            Ok(()) => {
                told.acknowledged.push(number);
                told.telemetry = number + 1;
            }
            Err(error) => {
                assert!(matches!(error, RecorderError::Write(_)), "{error}");
                told.failed = true;
                break;
            }
        }
    }
    let _ = recorder.finish();
    told
}

/// Everything that the logs of a disk hold, by channel.
fn found(fs: &SimFs) -> BTreeMap<String, Vec<u32>> {
    let mut found = BTreeMap::<String, Vec<u32>>::new();
    for bytes in fs.files().into_values() {
        for message in read_log(&*bytes, Limits::default()).unwrap().messages {
            found.entry(message.channel.to_string()).or_default().push(message.sequence);
        }
    }
    found
}

/// Recovers and checks a disk: R1, R2 and R3 of the promises.
fn check(fs: &SimFs, told: &Told, case: &str) {
    let recovery = recover(fs).unwrap();
    for recovered in &recovery.segments {
        assert!(recovered.outcome.is_ok(), "{case}: {}", recovered.text());
    }
    let files = fs.all_files();
    for (name, bytes) in fs.files() {
        assert!(!name.ends_with(".open.mcap"), "{case}: {name} is left open");
        let examination = doctor::examine(&*bytes, OWN).unwrap();
        assert_eq!(examination.findings, [], "{case}: {name}");
        let content = read_log(&*bytes, Limits::default()).unwrap();
        assert_eq!(content.damage, [], "{case}: {name}");
        let number: u32 = name.rsplit_once("seg-").unwrap().1[..6].parse().unwrap();
        let (seal, _) = read_seal(fs, name.split_once('/').unwrap().0, number).unwrap();
        assert_eq!(seal.blake3, blake3::hash(&bytes).to_hex().to_string(), "{case}: {name}");
    }
    let found = found(fs);
    let none = Vec::new();
    let events = found.get("command/event").unwrap_or(&none);
    let there: BTreeSet<u32> = events.iter().copied().collect();
    for number in &told.acknowledged {
        assert!(
            there.contains(number),
            "{case}: command event {number} was acknowledged and is lost"
        );
    }
    // Telemetry of a batch stands or falls with it, and nothing is there twice.
    let frames = found.get("rover/state").unwrap_or(&none);
    assert!(frames.iter().copied().take(told.telemetry as usize).eq(0..told.telemetry), "{case}");
    assert_eq!(there.len(), events.len(), "{case}: an event stands in the log twice");
    // The same again changes nothing.
    assert!(recover(fs).unwrap().segments.is_empty(), "{case}");
    assert_eq!(fs.all_files(), files, "{case}: a second recovery has changed something");
}

fn crash_at(call: u64, calls: u64, commands: u32) {
    let fs = SimFs::default();
    fs.fail_at(call, Fault::Crash);
    let told = scenario(&fs, commands);
    assert!(fs.crashed(), "call {call} of {calls} did not come");
    for survives in [Survives::Least, Survives::Most, Survives::Torn(call)] {
        check(&fs.after_crash(survives), &told, &format!("call {call}, {survives:?}"));
    }
}

fn crash_at_each_call(commands: u32, step: usize) -> usize {
    let sound = SimFs::default();
    let told = scenario(&sound, commands);
    assert!(!told.failed && told.acknowledged.len() == (commands * EVENTS) as usize);
    check(&sound, &told, "no crash");
    let calls = sound.calls();
    eprintln!("{commands} commands: {calls} calls");
    let points: Vec<_> = (1..=calls).step_by(step).collect();
    // Each scenario hands over between two threads all the time; two of them at once fill a machine.
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(&call) = points.get(next.fetch_add(1, Ordering::Relaxed)) {
                    crash_at(call, calls, commands);
                }
            });
        }
    });
    points.len()
}

fn full() -> bool {
    std::env::var_os("FOOTFALL_FULL").is_some()
}

#[test]
fn no_acknowledged_command_is_lost_whichever_call_is_the_last() {
    let short = crash_at_each_call(6, 1);
    let long = crash_at_each_call(500, if full() { 1 } else { 701 });
    eprintln!("power cuts: {short} of the short scenario, {long} of the one of 500 commands");
    assert!(!full() || long >= 5000, "{long} calls");
}

#[test]
fn a_recovery_that_is_cut_off_itself_comes_to_the_same_end() {
    let mut cuts = 0;
    for seed in 0..if full() { 40 } else { 8 } {
        let fs = SimFs::default();
        fs.fail_at(60 + seed * 7, Fault::Crash);
        let told = scenario(&fs, 30);
        let left = fs.after_crash(Survives::Torn(seed));
        let calls = {
            let whole = left.after_crash(Survives::Most);
            recover(&whole).unwrap();
            whole.calls()
        };
        for call in 1..=calls {
            let mut disk = left.after_crash(Survives::Most);
            disk.fail_at(call, Fault::Crash);
            let _ = recover(&disk);
            assert!(disk.crashed());
            // And a second time, at another call.
            disk = disk.after_crash(Survives::Torn(seed * 1000 + call));
            disk.fail_at(call / 2 + 1, Fault::Crash);
            let _ = recover(&disk);
            let survives = if call % 2 == 0 { Survives::Least } else { Survives::Most };
            check(
                &disk.after_crash(survives),
                &told,
                &format!("seed {seed}, recovery call {call}"),
            );
            cuts += 2;
        }
    }
    eprintln!("recoveries cut off: {cuts}");
    assert!(cuts >= 100, "{cuts}");
}

/// Frames come for a while, the power goes at any moment: what is lost is younger than a batch may
/// grow old. By the machine's clock, so the bound is asserted where the machine is ours.
#[test]
fn a_power_cut_costs_a_quarter_of_a_second_of_telemetry_at_most() {
    let runs = if full() { 100 } else { 5 };
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let mut worst_ms = 0;
    for run in 0..runs {
        let fs = SimFs::default();
        let recorder = Recorder::start_on(Box::new(fs.clone()), options()).unwrap();
        let (begun, cut_ms) = (Instant::now(), rng.random_range(300..900));
        let mut times_ms = Vec::new();
        while begun.elapsed().as_millis() < cut_ms {
            let number = times_ms.len() as u64;
            let at = begun.elapsed();
            recorder.record(record("rover/state", number, after(at.as_secs_f64()), "{}".into()));
            times_ms.push(at.as_millis());
            std::thread::sleep(Duration::from_millis(2));
        }
        let end_ms = begun.elapsed().as_millis();
        fs.cut();
        let left = fs.after_crash(Survives::Least);
        recover(&left).unwrap();
        let kept = found(&left).remove("rover/state").unwrap_or_default();
        assert!(kept.iter().copied().eq(0..kept.len() as u32), "run {run}: no hole");
        worst_ms = worst_ms.max(times_ms.get(kept.len()).map_or(0, |first| end_ms - first));
    }
    eprintln!("{runs} power cuts: at most {worst_ms} ms of telemetry lost");
    let allowed_ms = if full() { COMMIT_MS + 50 } else { 10 * COMMIT_MS };
    assert!(worst_ms <= u128::from(allowed_ms), "{worst_ms} ms");
}

#[test]
fn any_single_call_that_fails_costs_nothing_that_was_acknowledged() {
    let commands = if full() { 30 } else { 8 };
    let sound = SimFs::default();
    scenario(&sound, commands);
    for call in 1..=sound.calls() {
        for kind in [std::io::ErrorKind::Other, std::io::ErrorKind::StorageFull] {
            let fs = SimFs::default();
            fs.fail_at(call, Fault::Once(kind));
            let mut told = scenario(&fs, commands);
            if kind == std::io::ErrorKind::StorageFull {
                // Telemetry is given up on a full disk.
                told.telemetry = 0;
            }
            let case = format!("call {call} fails with {kind:?}");
            assert!(
                !told.started || !told.failed,
                "{case}: one error is survived by a new segment"
            );
            check(&fs.after_crash(Survives::Least), &told, &case);
            check(&fs.after_crash(Survives::Most), &told, &case);
        }
    }
}

#[test]
fn the_chain_of_seals_goes_through_segments_and_sessions() {
    let fs = SimFs::default();
    scenario(&fs, 40);
    scenario(&fs, 10);
    let (mut previous, mut seals) = (None, 0);
    for log in ["footfall-20010909T014640Z", "footfall-20010909T014640Z-2"] {
        for number in 1.. {
            let Some((seal, reference)) = read_seal(&fs, log, number) else { break };
            assert_eq!(seal.previous, previous, "{log} {number}");
            previous = Some(reference);
            seals += 1;
        }
    }
    assert!(seals > 2, "{seals}");
}
