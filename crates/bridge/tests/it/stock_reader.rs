//! A stock reader that shares no code with ours opens our logs.

use std::fs::OpenOptions;
use std::io::Write;
use std::process::Command;

use bridge::recorder::Recorder;

use crate::recorder::{messages, options};
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
    let file = dir.path().join(format!("{id}.mcap"));
    let output = Command::new(python).arg(script).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counts = String::from_utf8(output.stdout).unwrap();
    assert_eq!(counts, "command/event 100\nrover/state 200\n");
}

/// Tells that a test was skipped, where `make test` collects it.
fn note_skipped(test: &str, why: &str) {
    let note = format!("SKIPPED {test}: {why}");
    eprintln!("{note}");
    let list = testkit::project_dir().join("target/skipped-tests.txt");
    if let Ok(mut file) = OpenOptions::new().create(true).append(true).open(list) {
        // The note on stderr already told; a list that cannot be written must not fail the test.
        let _ = writeln!(file, "{note}");
    }
}
