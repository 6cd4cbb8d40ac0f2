//! Arrows only go down, and each crate imports what it may and no more.

use crate::source::{crates, manifest, packages};

/// All that a crate may import of the house, as docs/ARCHITECTURE.md says.
const MAY_IMPORT: &[(&str, &[&str])] = &[
    ("geometry", &[]),
    ("rover", &["geometry"]),
    ("terrain", &["geometry"]),
    ("collision", &["geometry", "rover", "terrain"]),
    ("stability", &["geometry", "rover"]),
    ("stereo", &["geometry", "rover", "terrain", "collision"]),
    ("reachability", &["geometry", "rover", "terrain", "collision", "stability"]),
    ("motion", &["geometry", "rover", "terrain", "collision", "stability"]),
    (
        "gait",
        &[
            "geometry",
            "rover",
            "terrain",
            "collision",
            "stability",
            "stereo",
            "reachability",
            "motion",
        ],
    ),
    ("sim", &["geometry", "rover", "terrain", "collision", "stability", "stereo"]),
    (
        "wire",
        &[
            "geometry",
            "rover",
            "terrain",
            "collision",
            "stability",
            "stereo",
            "reachability",
            "motion",
            "gait",
        ],
    ),
    (
        "bridge",
        &[
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
            "wire",
        ],
    ),
    (
        "server",
        &[
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
            "wire",
            "bridge",
        ],
    ),
    ("testkit", &[]),
];

fn may_import(name: &str) -> Option<&'static [&'static str]> {
    MAY_IMPORT.iter().find(|(crate_name, _)| *crate_name == name).map(|(_, allowed)| *allowed)
}

#[test]
fn crates_import_only_what_lies_below_them() {
    let house: Vec<String> = crates().into_iter().map(|(name, _)| name).collect();
    for (name, folder) in crates() {
        let allowed = may_import(&name)
            .unwrap_or_else(|| panic!("the crate {name} has no place in the house yet"));
        for package in packages(&manifest(&folder), "dependencies") {
            assert!(
                !house.contains(&package) || allowed.contains(&package.as_str()),
                "{name} imports {package}, which it may not"
            );
        }
    }
}

#[test]
fn the_rules_themselves_go_down_only() {
    for (i, (name, allowed)) in MAY_IMPORT.iter().enumerate() {
        for below in *allowed {
            let at = MAY_IMPORT.iter().position(|(other, _)| other == below);
            assert!(at.is_some_and(|at| at < i), "{name} stands below {below}");
        }
    }
}

#[test]
fn the_testkit_is_for_tests_and_only_collision_knows_parry() {
    for (name, folder) in crates() {
        let manifest = manifest(&folder);
        let all = ["dependencies", "dev-dependencies", "build-dependencies"];
        let packages = |sections: &[&str]| -> Vec<String> {
            sections.iter().flat_map(|section| packages(&manifest, section)).collect()
        };
        assert!(!packages(&["dependencies"]).contains(&"testkit".to_owned()), "{name}");
        let parry = packages(&all).iter().any(|package| package.starts_with("parry"));
        assert_eq!(parry, name == "collision", "{name}");
    }
}

#[test]
fn every_crate_is_one_noun_under_the_lints_of_the_house() {
    for (name, folder) in crates() {
        let manifest = manifest(&folder);
        assert_eq!(manifest["package"]["name"].as_str(), Some(name.as_str()));
        let lints = manifest.get("lints").and_then(|lints| lints.get("workspace"));
        assert_eq!(lints.and_then(toml::Value::as_bool), Some(true), "{name} has its own lints");
        assert!(manifest["package"].get("description").is_some(), "{name} says nothing of itself");
    }
}
