//! A stock reader that shares no code with ours opens our logs.

use std::process::Command;

use bridge::recorder::Recorder;
use testkit::note_skipped;

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

#[test]
fn the_reader_of_browsers_counts_the_same_messages() {
    let test = "bridge::the_reader_of_browsers_counts_the_same_messages";
    let web = testkit::project_dir().join("web");
    if !web.join("node_modules/@mcap/core").is_dir() {
        return note_skipped(
            test,
            "web/node_modules has no @mcap/core; `make console` installs it",
        );
    }
    let dir = TempDir::new("stock-js");
    let mut recorder = Recorder::start(dir.path(), options()).unwrap();
    for message in messages(300) {
        recorder.record(message);
    }
    let id = recorder.finish().unwrap().log.id;
    let file = dir.path().join(format!("{id}.mcap"));
    let mut node = Command::new("node");
    let output = node.arg(web.join("conformance/mcap.mjs")).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8(output.stdout).unwrap(), "command/event 100\nrover/state 200\n");
}
