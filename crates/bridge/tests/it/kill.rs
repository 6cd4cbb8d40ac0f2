//! The process dies by SIGKILL at any moment, on a real disk: nothing that was acknowledged is lost.
//!
//! `FOOTFALL_FULL=1`: 1000 times, else 20 times.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use bridge::doctor;
use bridge::recorder::{LogFolder, Recorder, RecorderOptions, Storage};
use bridge::recover::recover;
use bridge::seal::OWN;
use bridge::verify::verify;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::recorder::options;
use crate::support::{TempDir, after, record};

const FOLDER: &str = "FOOTFALL_KILL_FOLDER";

/// The process that is killed: logs commands and says each one that was acknowledged.
#[test]
#[ignore = "the child of the test below"]
fn victim() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    // Small segments, so that the end often comes while one is sealed.
    let options = RecorderOptions { segment_bytes: 20_000, ..options() };
    let recorder = Recorder::start(Path::new(&folder), options).unwrap();
    let log = recorder.status().log.id;
    let mut out = std::io::stdout().lock();
    for number in 0.. {
        let at = after(number as f64 * 0.1);
        recorder.record(record("rover/state", number, at, format!("{{\"frame\":{number}}}")));
        let event = record("command/event", number, at, format!("{{\"event\":{number}}}"));
        recorder.record_durable(event).unwrap().wait_blocking().unwrap();
        writeln!(out, "acknowledged {log} {number}").unwrap();
        out.flush().unwrap();
    }
}

/// Lets a victim acknowledge that many commands and kills it; its log, and the last number it said.
fn kill_one(folder: &Path, commands: u64) -> Option<(String, u64)> {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "kill::victim", "--ignored", "--nocapture", "--test-threads=1"])
        .env(FOLDER, folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let (mut last, mut told) = (None, 0);
    let said = lines.map_while(Result::ok).filter_map(|line| {
        let (log, number) = line.split_once("acknowledged ")?.1.split_once(' ')?;
        Some((log.to_owned(), number.parse().ok()?))
    });
    for acknowledged in said {
        last = Some(acknowledged);
        told += 1;
        if told == commands {
            child.kill().unwrap();
        }
    }
    child.wait().unwrap();
    last
}

#[test]
fn a_killed_process_leaves_every_acknowledged_command() {
    let runs = if std::env::var_os("FOOTFALL_FULL").is_some() { 1000 } else { 20 };
    let dir = TempDir::new("killed");
    let storage = LogFolder::new(dir.path());
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let (mut acknowledged, mut recovered) = (0, 0);
    for run in 0..runs {
        let (log, last) = kill_one(dir.path(), rng.random_range(1..400)).unwrap();
        recovered += recover(&storage).unwrap().segments.iter().filter(|s| s.is_lossless()).count();
        let (mut events, mut frames) = (BTreeSet::new(), BTreeSet::new());
        for file in bridge::catalog::log_files(dir.path(), &log).unwrap() {
            let examination = doctor::examine(std::fs::File::open(&file).unwrap(), OWN).unwrap();
            assert_eq!(examination.findings, [], "run {run}, {file:?}");
            for message in bridge::reader::read_file(&file, OWN).unwrap().messages {
                let numbers =
                    if *message.channel == *"rover/state" { &mut frames } else { &mut events };
                numbers.insert(u64::from(message.sequence));
            }
        }
        assert!((0..=last).all(|n| events.contains(&n) && frames.contains(&n)), "run {run}");
        acknowledged += last + 1;
        if run % 50 == 49 || run + 1 == runs {
            let verification = verify(&storage, None).unwrap();
            assert_eq!((verification.problems, verification.open), (vec![], vec![]), "run {run}");
            // The folder starts anew, or the check of the chain takes longer and longer.
            for log in storage.folders().unwrap() {
                std::fs::remove_dir_all(dir.path().join(log)).unwrap();
            }
        }
    }
    eprintln!("{runs} kills, {acknowledged} commands acknowledged, {recovered} segments recovered");
}
