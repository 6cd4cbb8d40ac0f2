//! A stock reader that shares no code with ours opens our logs.

use std::process::Command;

use bridge::reader::{Limits, read_log};
use bridge::recorder::Recorder;
use bridge::recover::recover;
use testkit::note_skipped;

use crate::crash::scenario;
use crate::recorder::{messages, options};
use crate::sim_fs::{Fault, SimFs, Survives};
use crate::support::TempDir;

#[test]
fn the_python_reader_counts_the_same_messages() {
    let test = "bridge::the_python_reader_counts_the_same_messages";
    let Some(python) = std::env::var_os("FOOTFALL_PYTHON") else {
        return note_skipped(test, "FOOTFALL_PYTHON names no Python with the package mcap");
    };
    let dir = TempDir::new("stock");
    let mut recorder = Recorder::start(dir.path(), options()).unwrap();
    for message in messages(300) {
        recorder.record(message);
    }
    let id = recorder.finish().unwrap().log.id;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/stock_reader.py");
    let file = bridge::catalog::log_path(dir.path(), &id).unwrap();
    let output = Command::new(python).arg(script).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counts = String::from_utf8(output.stdout).unwrap();
    assert_eq!(counts, "command/event 100\nrover/state 200\n");
}

#[test]
fn the_python_reader_opens_every_recovered_log() {
    let test = "bridge::the_python_reader_opens_every_recovered_log";
    let Some(python) = std::env::var_os("FOOTFALL_PYTHON") else {
        return note_skipped(test, "FOOTFALL_PYTHON names no Python with the package mcap");
    };
    let dir = TempDir::new("recovered");
    let crashes = if std::env::var_os("FOOTFALL_FULL").is_some() { 1000 } else { 60 };
    let (mut files, mut expected) = (Vec::new(), Vec::new());
    for crash in 0..crashes {
        let fs = SimFs::default();
        fs.fail_at(5 + crash * 311 % 900, Fault::Crash);
        scenario(&fs, 60);
        let left = fs.after_crash(Survives::Torn(crash));
        recover(&left).unwrap();
        for (name, bytes) in left.files() {
            let path = dir.path().join(format!("{crash}-{}", name.replace('/', "-")));
            std::fs::write(&path, &bytes).unwrap();
            let content = read_log(&*bytes, Limits::default()).unwrap();
            expected.push(format!("{} messages", content.messages.len()));
            files.push(path);
        }
    }
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/stock_reader.py");
    let output = Command::new(python).arg(script).args(&files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counts = String::from_utf8(output.stdout).unwrap();
    assert!(counts.lines().eq(expected.iter().map(String::as_str)), "{counts}");
    eprintln!("{} files of {crashes} crashes, as the stock reader has them", files.len());
}

#[test]
fn the_reader_of_browsers_counts_the_same_messages() {
    let test = "bridge::the_reader_of_browsers_counts_the_same_messages";
    let web = testkit::project_dir().join("web");
    if !web.join("node_modules/@mcap/core").is_dir() {
        return note_skipped(test, "web/node_modules has no @mcap/core");
    }
    let dir = TempDir::new("stock-js");
    let mut recorder = Recorder::start(dir.path(), options()).unwrap();
    for message in messages(300) {
        recorder.record(message);
    }
    let id = recorder.finish().unwrap().log.id;
    let file = bridge::catalog::log_path(dir.path(), &id).unwrap();
    let mut node = Command::new("node");
    let output = node.arg(web.join("conformance/mcap.mjs")).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8(output.stdout).unwrap(), "command/event 100\nrover/state 200\n");
}
