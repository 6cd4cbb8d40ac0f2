//! Every source file begins by saying what it holds.

use crate::source::{crates, sources};

#[test]
fn every_file_begins_with_what_it_is() {
    for (_, folder) in crates() {
        for part in ["src", "tests", "benches"] {
            for source in sources(&folder.join(part)) {
                let first = source.text.lines().next().unwrap_or_default();
                let says = first.strip_prefix("//! ").is_some_and(|said| said.len() > 10);
                assert!(says, "{} begins with {first:?}", source.path);
            }
        }
    }
}

#[test]
fn no_file_names_a_place_of_the_machine_it_was_written_on() {
    for (_, folder) in crates() {
        for part in ["src", "tests", "benches"] {
            for source in sources(&folder.join(part)) {
                for place in ["/home/", "/Users/", "/root/"] {
                    // This file names them to look for them.
                    let names = source.text.contains(place) && !source.path.ends_with("headers.rs");
                    assert!(!names, "{} names {place}", source.path);
                }
            }
        }
    }
}
