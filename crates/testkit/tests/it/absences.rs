//! What is deliberately absent from the domain: clocks, files, environment, threads that outlive a
//! call, random numbers without a seed, and serde on public types.

use crate::source::{crates, manifest, packages, sources};

/// The crates below the line.
const DOMAIN: &[&str] = &[
    "geometry",
    "rover",
    "terrain",
    "collision",
    "stability",
    "stereo",
    "reachability",
    "motion",
    "gait",
    "sim",
];

/// Packages that bring in what is absent.
const PACKAGES: &[&str] = &[
    "tokio",
    "axum",
    "hyper",
    "tower",
    "mcap",
    "tracing",
    "log",
    "anyhow",
    "uuid",
    "reqwest",
    "serde_json",
    "clap",
    "wire",
    "bridge",
    "server",
];

/// The one exception: the JSON that tells what the values of a PNG of heights mean is read where the PNG
/// is, in a private type.
const ALLOWED: &[(&str, &str)] = &[("terrain", "serde_json")];

/// What does not stand in the code of the domain.
const WORDS: &[&str] = &[
    "std::fs",
    "std::env",
    "std::net",
    "std::process",
    "std::os",
    "std::time",
    "SystemTime",
    "Instant",
    "thread::spawn",
    "thread::sleep",
    "println!",
    "eprintln!",
    "dbg!",
    "thread_rng",
    "rand::rng()",
    "from_entropy",
    "from_os_rng",
    "from_rng(&mut rand::rng",
    "static mut",
];

#[test]
fn the_domain_has_no_clock_no_files_and_no_chance() {
    for (name, folder) in crates().into_iter().filter(|(name, _)| DOMAIN.contains(&name.as_str())) {
        for package in packages(&manifest(&folder), "dependencies") {
            let is_allowed = ALLOWED.contains(&(name.as_str(), package.as_str()));
            let is_absent = !PACKAGES.contains(&package.as_str());
            assert!(is_absent || is_allowed, "{name} imports {package}");
        }
        for source in sources(&folder.join("src")) {
            for (number, line) in &source.code {
                for word in WORDS {
                    assert!(!line.contains(word), "{}:{number}: {word}", source.path);
                }
            }
        }
    }
}

#[test]
fn serde_stays_in_private_types_of_the_domain() {
    for (name, folder) in crates().into_iter().filter(|(name, _)| DOMAIN.contains(&name.as_str())) {
        for source in sources(&folder.join("src")) {
            let mut derived = false;
            for (number, line) in &source.code {
                derived |= line.contains("derive(")
                    && (line.contains("Serialize") || line.contains("Deserialize"));
                let is_type = line.contains("struct ") || line.contains("enum ");
                if derived && is_type {
                    let public = line.trim_start().starts_with("pub ");
                    assert!(!public, "{}:{number}: {name} has serde on a public type", source.path);
                    derived = false;
                }
            }
        }
    }
}

#[test]
fn only_the_programs_own_command_line_prints() {
    for (_, folder) in crates() {
        for source in sources(&folder.join("src")) {
            let may = source.path.starts_with("testkit/");
            for (number, line) in &source.code {
                let prints =
                    ["println!", "print!(", "dbg!("].iter().any(|word| line.contains(word));
                assert!(may || !prints, "{}:{number} prints", source.path);
            }
        }
    }
}

#[test]
fn time_enters_through_one_place() {
    for (_, folder) in crates() {
        for source in sources(&folder.join("src")) {
            for (number, line) in &source.code {
                let reads = line.contains("SystemTime::now") || line.contains("std::time::Instant");
                let may = source.path == "bridge/src/clock.rs";
                assert!(may || !reads, "{}:{number} reads a clock", source.path);
            }
        }
    }
}
