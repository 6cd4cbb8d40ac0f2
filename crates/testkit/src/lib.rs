//! What the tests of every crate share. Never a dependency of shipped code.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

/// The top folder of the project.
pub fn project_dir() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The text of a file in `fixtures/`; panics where it is missing, for fixtures always ship.
pub fn fixture_text(path: &str) -> String {
    let full = project_dir().join("fixtures").join(path);
    std::fs::read_to_string(&full).unwrap_or_else(|e| panic!("{}: {e}", full.display()))
}

/// The bytes of a file of the shared test data, or `None` with a note that `test` was skipped.
///
/// The data is not part of the project: it is looked for in `$FOOTFALL_SHARED_DATA`, else in
/// `../shared/data` beside the project. Each skip is printed and kept in
/// `target/skipped-tests.txt`, which `make test` shows at its end.
pub fn shared_data(test: &str, path: &str) -> Option<Vec<u8>> {
    std::fs::read(shared_data_path(test, path)?).ok()
}

/// The path of a file of the shared test data; as [`shared_data`].
pub fn shared_data_path(test: &str, path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("FOOTFALL_SHARED_DATA")
        .map_or_else(|| project_dir().join("../shared/data"), PathBuf::from);
    let full = root.join(path);
    if full.is_file() {
        return Some(full);
    }
    note_skipped(test, &format!("shared data {path} is absent"));
    None
}

/// True if a program that serves as an oracle is installed, or false with a note that `test` was
/// skipped.
pub fn is_installed(test: &str, program: &str) -> bool {
    let found = std::process::Command::new(program).arg("--version").output().is_ok();
    if !found {
        note_skipped(test, &format!("{program} is not installed"));
    }
    found
}

/// Tells that `test` was skipped, and why, where `make test` collects it.
pub fn note_skipped(test: &str, why: &str) {
    let note = format!("SKIPPED {test}: {why}");
    eprintln!("{note}");
    let list = project_dir().join("target/skipped-tests.txt");
    if let Ok(mut file) = OpenOptions::new().create(true).append(true).open(list) {
        // The note on stderr already told; a list that cannot be written must not fail the test.
        let _ = writeln!(file, "{note}");
    }
}
