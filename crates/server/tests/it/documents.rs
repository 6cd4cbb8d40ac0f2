//! What is published about the program is what it does.

use std::path::Path;

use serde_json::Value;

#[test]
fn the_committed_openapi_document_is_that_of_the_code() {
    let path = testkit::project_dir().join("web/openapi.json");
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        committed == server::api::document_text(),
        "web/openapi.json is stale: write it anew with `cargo run -p server -- openapi > web/openapi.json`"
    );
}

#[test]
fn the_document_is_openapi_and_names_every_operation_once() {
    let document: Value = serde_json::from_str(&server::api::document_text()).unwrap();
    assert_eq!(document["openapi"], "3.1.0");
    let mut seen = std::collections::BTreeSet::new();
    let paths = document["paths"].as_object().unwrap();
    for (path, item) in paths {
        let stands_apart = ["/health", "/ready", "/foxglove"].contains(&path.as_str());
        assert!(path.starts_with("/api/v1/") || stands_apart, "{path}");
        for (method, operation) in item.as_object().unwrap() {
            let said = operation["summary"].as_str().unwrap_or_default();
            assert!(!said.is_empty(), "{method} {path} says nothing of itself");
            let id = operation["operationId"].as_str().unwrap_or_default().to_owned();
            assert!(!id.is_empty(), "{method} {path} has no operationId");
            assert!(seen.insert(id.clone()), "{method} {path}: {id} names another operation too");
        }
    }
    assert!(paths.len() > 30, "{} paths", paths.len());
    let schemas = document["components"]["schemas"].as_object().unwrap();
    for name in ["StreamRequest", "StreamFrame", "PlanAnswer", "ErrorBody", "RoverTelemetry"] {
        assert!(schemas.contains_key(name), "{name}");
    }
}

#[test]
fn logs_carry_schemas_that_stand_by_themselves() {
    for schema in server::serve::schemas() {
        let parsed: Value = serde_json::from_str(&schema.schema_json).unwrap();
        assert!(!schema.schema_json.contains("$ref"), "{}", schema.channel);
        assert_eq!(parsed["type"], "object", "{}", schema.channel);
    }
}

/// Markdown files of the project, those of packages and of built files apart.
fn documents(folder: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        let skipped = ["target", "node_modules", "dist", "logs", ".git", ".venv"];
        if path.is_dir() && !skipped.iter().any(|s| name == *s) {
            documents(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "md") {
            found.push(path);
        }
    }
}

#[test]
fn commands_that_the_documents_show_are_commands() {
    let mut found = Vec::new();
    documents(&testkit::project_dir(), &mut found);
    let mut n = 0;
    for path in found {
        let text = std::fs::read_to_string(&path).unwrap();
        let mut fenced = false;
        for line in text.lines() {
            if line.trim_start().starts_with("```") {
                fenced = !fenced;
            }
            let command = line.trim_start().trim_start_matches("$ ");
            if !fenced || !command.starts_with("footfall ") {
                continue;
            }
            let command = command.split(" #").next().unwrap_or_default();
            let command = command.split(['>', '<', ';', '&']).next().unwrap_or_default();
            let command = command.split(" | ").next().unwrap_or_default();
            let words: Vec<&str> = command.split_whitespace().collect();
            // `footfall a|b FILE` stands for `footfall a FILE` and `footfall b FILE`.
            for subcommand in words.get(1).unwrap_or(&"").split('|') {
                let mut words = words.clone();
                words[1] = subcommand;
                let answer = server::cli::understands(&words);
                assert!(answer.is_ok(), "{}: {line}\n{}", path.display(), answer.unwrap_err());
                n += 1;
            }
        }
    }
    eprintln!("{n} commands checked");
}
