//! Every code that the program can answer with is in the table of codes.

use std::path::Path;

use server::error::CODES;

fn sources(folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            // Tests may invent codes.
            found.push(text.split("#[cfg(test)]").next().unwrap_or_default().to_owned());
        }
    }
}

/// The first string literal after each occurrence of `call`.
fn first_arguments<'a>(text: &'a str, call: &str) -> Vec<&'a str> {
    text.match_indices(call)
        .filter_map(|(at, _)| {
            let rest = text[at + call.len()..].trim_start().strip_prefix('"')?;
            rest.split('"').next()
        })
        .collect()
}

#[test]
fn the_table_of_codes_is_whole() {
    let crates = testkit::project_dir().join("crates");
    let mut texts = Vec::new();
    for name in ["server/src", "wire/src"] {
        sources(&crates.join(name), &mut texts);
    }
    let known = |code: &str| CODES.iter().any(|(known, ..)| *known == code);
    let mut n = 0;
    for text in &texts {
        for call in ["RequestError::at(", "RequestError::new(", "ApiError::new(", "error_frame("] {
            for code in first_arguments(text, call) {
                assert!(known(code), "the code {code:?} is not in the table");
                n += 1;
            }
        }
    }
    assert!(n > 60, "only {n} uses of codes found: the search is broken");
    // The bridge's errors bring their codes in `fn code`.
    for file in
        ["commands.rs", "commands/authority.rs", "commands/estop.rs", "ground.rs", "replay.rs"]
    {
        let text = std::fs::read_to_string(crates.join("bridge/src").join(file)).unwrap();
        for body in text.split("fn code(").skip(1) {
            let body = body.split("\n    }\n").next().unwrap_or_default();
            for code in body.split('"').skip(1).step_by(2) {
                assert!(known(code), "the bridge's code {code:?} is not in the table");
            }
        }
    }
}

#[test]
fn codes_are_unique_words_with_a_fitting_status() {
    for (i, (code, status, meaning)) in CODES.iter().enumerate() {
        assert!(code.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{code}");
        assert!((400..600).contains(status) && !meaning.is_empty(), "{code}");
        assert!(CODES[i + 1..].iter().all(|(other, ..)| other != code), "{code} stands twice");
    }
}
