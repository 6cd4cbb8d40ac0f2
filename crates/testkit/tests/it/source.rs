//! Reading the project's own sources.

use std::path::{Path, PathBuf};

/// A source file without its tests and without its comments.
pub struct Source {
    /// Path from the project's folder.
    pub path: String,
    /// The whole text.
    pub text: String,
    /// Lines of code with their numbers, comments and the tests at the end left out.
    pub code: Vec<(usize, String)>,
}

/// The crates' folders, by name.
pub fn crates() -> Vec<(String, PathBuf)> {
    let mut found: Vec<(String, PathBuf)> =
        std::fs::read_dir(testkit::project_dir().join("crates"))
            .unwrap()
            .map(|entry| entry.unwrap())
            .filter(|entry| entry.path().join("Cargo.toml").is_file())
            .map(|entry| (entry.file_name().into_string().unwrap(), entry.path()))
            .collect();
    found.sort();
    assert!(found.len() >= 10, "only {} crates found", found.len());
    found
}

/// The manifest of a crate.
pub fn manifest(folder: &Path) -> toml::Table {
    std::fs::read_to_string(folder.join("Cargo.toml")).unwrap().parse().unwrap()
}

/// Names of the packages in a section of a manifest.
pub fn packages(manifest: &toml::Table, section: &str) -> Vec<String> {
    let table = manifest.get(section).and_then(|value| value.as_table());
    table.into_iter().flat_map(|table| table.keys().cloned()).collect()
}

/// All Rust files below a folder of a crate.
pub fn sources(folder: &Path) -> Vec<Source> {
    let mut found = Vec::new();
    gather(folder, &mut found);
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

fn gather(folder: &Path, found: &mut Vec<Source>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            gather(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(read(&path));
        }
    }
}

fn read(path: &Path) -> Source {
    let text = std::fs::read_to_string(path).unwrap();
    let shown = path.to_string_lossy().into_owned();
    let shown = shown.rsplit_once("/crates/").map_or(shown.clone(), |(_, rest)| rest.to_owned());
    let code = text
        .lines()
        .enumerate()
        .take_while(|(_, line)| !line.starts_with("#[cfg(test)]"))
        .map(|(i, line)| (i + 1, line.split("//").next().unwrap_or_default().to_owned()))
        .filter(|(_, line)| !line.trim().is_empty())
        .collect();
    Source { path: shown, text, code }
}
