//! Files of every combination of the format's features: our readers, and two that share no code with
//! ours, have the same messages, attachments and metadata of them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use bridge::doctor;
use bridge::reader::{IndexedLog, Item, Limits, LogMessage, scan_items};
use bridge::seal::OWN;
use mcap::records::op;
use serde_json::{Value, json};
use testkit::note_skipped;
use wire::time::Timestamp;

use crate::support::TempDir;
use crate::variants::{CONTENTS, Content, Features, data, log_time, variants, write};

/// What the writer was told to write.
fn expected(content: &Content) -> Value {
    let message = |n: u32| {
        let text = String::from_utf8(data(n)).unwrap();
        json!(["example", n, log_time(n), log_time(n) + 1, text])
    };
    let attachment = json!(["myFile", 2, 1, "application/octet-stream", "010203"]);
    let metadata = json!(["myMetadata", { "foo": "bar" }]);
    json!({
        "messages": (0..content.messages).map(message).collect::<Vec<_>>(),
        "attachments": Vec::from_iter(content.attachment.then_some(attachment)),
        "metadata": Vec::from_iter(content.metadata.then_some(metadata)),
    })
}

fn line(m: &LogMessage) -> Value {
    let text = std::str::from_utf8(&m.data).unwrap();
    json!([&*m.channel, m.sequence, m.log_time.0, m.publish_time.0, text])
}

/// What our reader has of a file.
fn ours(bytes: &[u8], case: &str) -> Value {
    let (mut messages, mut attachments, mut metadata) = (Vec::new(), Vec::new(), Vec::new());
    let damage = scan_items(bytes, Limits::default(), |item| {
        match item {
            Item::Message(_, m) => messages.push(line(&m)),
            Item::Attachment { log_time, create_time, name, media_type, data } => {
                let hex: String = data.iter().map(|byte| format!("{byte:02x}")).collect();
                attachments.push(json!([name, log_time.0, create_time.0, media_type, hex]));
            }
            Item::Metadata(name, texts) => metadata.push(json!([name, texts])),
            Item::Channel(_) => {}
        }
        true
    });
    assert_eq!(damage.unwrap(), [], "{case}");
    json!({ "messages": messages, "attachments": attachments, "metadata": metadata })
}

fn content_of(name: &str) -> &'static Content {
    let of = name.split(['-', '.']).next().unwrap();
    CONTENTS.iter().find(|content| content.name == of).unwrap()
}

/// All files, in a folder: what each is to say, by its name.
fn all_files(dir: &Path) -> BTreeMap<String, (Value, Features)> {
    let mut files = BTreeMap::new();
    for content in &CONTENTS {
        for (name, features) in variants(content) {
            let name = format!("{name}.mcap");
            std::fs::write(dir.join(&name), write(content, features)).unwrap();
            files.insert(name, (expected(content), features));
        }
    }
    files
}

#[test]
fn every_variant_of_the_format_is_read_as_it_was_written() {
    let dir = TempDir::new("variants");
    let files = all_files(dir.path());
    let padded = files.values().filter(|(_, features)| features.padding).count();
    assert_eq!((files.len() - padded, padded), (208, 208));
    for (name, (expected, f)) in &files {
        let path = dir.path().join(name);
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(ours(&bytes, name), *expected, "{name}");
        let mut indexed = IndexedLog::open(&[path], Limits::default()).unwrap();
        let mut messages = Vec::new();
        for piece in 0..indexed.pieces().len() {
            messages.extend(indexed.read(piece).unwrap().iter().map(line));
        }
        assert_eq!(
            (json!(messages), indexed.damage()),
            (expected["messages"].clone(), &[][..]),
            "{name}"
        );
        // The list has them, too, where a chunk has an index.
        if !f.chunks || f.message_index || f.statistics {
            let info =
                bridge::catalog::log_info(dir.path(), name.trim_end_matches(".mcap")).unwrap();
            let times = (content_of(name).messages > 0).then(|| Timestamp(log_time(0)));
            assert_eq!(
                (info.messages, info.start),
                (content_of(name).messages.into(), times),
                "{name}"
            );
        }
        // What has everything has no finding; the others lack what a sealed file of ours has.
        let whole = f.statistics
            && (!f.chunks || (f.message_index && f.chunk_index))
            && (!name.starts_with("OneAttachment") || f.attachment_index)
            && (!name.starts_with("OneMetadata") || f.metadata_index);
        let examined = doctor::examine(&*bytes, OWN).unwrap();
        assert_eq!(examined.findings.is_empty(), whole, "{name}: {:?}", examined.findings);
    }
}

/// What a reader of others prints of the folder, against what is to be there.
fn assert_same(mut reader: Command, dir: &Path, files: &BTreeMap<String, (Value, Features)>) {
    let output = reader.arg(dir).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let said: BTreeMap<String, Value> = text
        .lines()
        .map(|line| {
            let mut value: Value = serde_json::from_str(line).unwrap();
            let name = value.as_object_mut().unwrap().remove("name").unwrap();
            (name.as_str().unwrap().into(), value)
        })
        .collect();
    assert_eq!(said.len(), files.len());
    for (name, (expected, _)) in files {
        assert_eq!(said[name], *expected, "{name}");
    }
}

#[test]
fn the_reader_of_browsers_has_the_same_of_every_variant() {
    let test = "bridge::the_reader_of_browsers_has_the_same_of_every_variant";
    let web = testkit::project_dir().join("web");
    if !web.join("node_modules/@mcap/core").is_dir() {
        return note_skipped(test, "web/node_modules has no @mcap/core");
    }
    let dir = TempDir::new("variants-js");
    let files = all_files(dir.path());
    let mut node = Command::new("node");
    node.arg(web.join("conformance/variants.mjs"));
    assert_same(node, dir.path(), &files);
}

#[test]
fn the_python_reader_has_the_same_of_every_variant() {
    let test = "bridge::the_python_reader_has_the_same_of_every_variant";
    let Some(python) = std::env::var_os("FOOTFALL_PYTHON") else {
        return note_skipped(test, "FOOTFALL_PYTHON names no Python with the package mcap");
    };
    let dir = TempDir::new("variants-py");
    let mut files = all_files(dir.path());
    // It (1.6.0) does not pass over what is added to a record within a chunk, and reads none of it.
    files.retain(|name, (_, features)| {
        let readable = !(features.chunks && features.padding);
        if !readable {
            std::fs::remove_file(dir.path().join(name)).unwrap();
        }
        readable
    });
    let mut python = Command::new(python);
    python.arg(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/variants.py"));
    assert_same(python, dir.path(), &files);
}

/// A file with everything, and where its first record of a kind begins.
fn whole() -> (Vec<u8>, impl Fn(u8) -> usize) {
    let all = Features {
        chunks: true,
        message_index: true,
        statistics: true,
        repeated_schemas: true,
        repeated_channels: true,
        chunk_index: true,
        summary_offsets: true,
        ..Features::default()
    };
    let bytes = write(&CONTENTS[5], all);
    let copy = bytes.clone();
    let find = move |kind: u8| {
        let mut at = mcap::MAGIC.len();
        loop {
            let length = u64::from_le_bytes(copy[at + 1..at + 9].try_into().unwrap()) as usize;
            if copy[at] == kind {
                return at;
            }
            at += 9 + length;
        }
    };
    (bytes, find)
}

/// Sets the checksum of the summary anew, so that only the defect itself is wrong.
fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let footer = bytes.len() - 37;
    let begin = u64::from_le_bytes(bytes[footer + 9..footer + 17].try_into().unwrap()) as usize;
    let crc = crc32fast::hash(&bytes[begin..footer + 25]);
    bytes[footer + 25..footer + 29].copy_from_slice(&crc.to_le_bytes());
    bytes
}

#[test]
fn every_rule_of_the_doctor_has_a_file_that_breaks_it() {
    let (sound, find) = whole();
    assert_eq!(doctor::examine(&*sound, OWN).unwrap().findings, []);
    // What is put where (in the first record of a kind, from its body on), and what is told then.
    let cases: [(&str, u8, usize, &[u8], &str); 16] = [
        ("opcode of the header", op::HEADER, 0, &[0x0E], "first record is not a header"),
        ("length of the library", op::HEADER, 9 + 4, &[0xFF], "the header is shorter"),
        ("CRC of the chunk", op::CHUNK, 9 + 24, &[1, 2, 3, 4], "chunk CRC failed"),
        ("size of the chunk", op::CHUNK, 9 + 16, &[0xFF], "another number of bytes"),
        ("begin of the chunk", op::CHUNK, 9, &[0xFF], "other times than its messages"),
        ("end of the chunk", op::CHUNK, 9 + 8, &[0xFF, 0xFF], "other times than its messages"),
        ("channel of the index", op::MESSAGE_INDEX, 9, &[9], "names other places"),
        ("place in the index", op::MESSAGE_INDEX, 9 + 14, &[0xFF], "names other places"),
        ("CRC of the data", op::DATA_END, 9, &[1, 2, 3, 4], "checksum of the data does not agree"),
        ("count of messages", op::STATISTICS, 9, &[9], "statistics do not agree"),
        ("count of chunks", op::STATISTICS, 9 + 22, &[9], "statistics do not agree"),
        ("offset of the chunk", op::CHUNK_INDEX, 9 + 16, &[9], "chunk indexes do not agree"),
        ("length of the chunk", op::CHUNK_INDEX, 9 + 24, &[9], "chunk indexes do not agree"),
        ("kind of an offset", op::SUMMARY_OFFSET, 9, &[0x0A], "summary offset of kind"),
        ("begin of an offset", op::SUMMARY_OFFSET, 9 + 1, &[9], "summary offset of kind"),
        ("begin of the summary", op::FOOTER, 9, &[9], "another begin of the summary"),
    ];
    for (what, kind, at, put, told) in cases {
        let mut bytes = sound.clone();
        let place = find(kind) + at;
        bytes[place..place + put.len()].copy_from_slice(put);
        if ![op::FOOTER, op::DATA_END].contains(&kind) && place > find(op::DATA_END) {
            bytes = resealed(bytes);
        }
        let findings = doctor::examine(&*bytes, OWN).unwrap().findings;
        assert!(findings.iter().any(|f| f.text.contains(told)), "{what}: {findings:?}");
    }
    // What is left out, and what is there twice.
    let without = |kind: u8| {
        let at = find(kind);
        let length = u64::from_le_bytes(sound[at + 1..at + 9].try_into().unwrap()) as usize;
        [&sound[..at], &sound[at + 9 + length..]].concat()
    };
    let twice = |kind: u8| {
        let at = find(kind);
        let length = u64::from_le_bytes(sound[at + 1..at + 9].try_into().unwrap()) as usize;
        [&sound[..at + 9 + length], &sound[at..]].concat()
    };
    let cases = [
        ("no end of the data", without(op::DATA_END), "no end of the data"),
        ("no index", without(op::MESSAGE_INDEX), "messages without a message index"),
        ("no statistics", without(op::STATISTICS), "0 records of statistics"),
        ("two statistics", twice(op::STATISTICS), "2 records of statistics"),
        ("no header", without(op::HEADER), "first record is not a header"),
        ("no footer", sound[..find(op::FOOTER)].to_vec(), "without a footer"),
        ("no magic", sound[8..].to_vec(), "magic bytes are missing"),
        ("half a chunk", sound[..find(op::CHUNK) + 40].to_vec(), "within a record"),
        ("more", [&*sound, b"x"].concat(), "does not end with the magic bytes"),
    ];
    for (what, bytes, told) in cases {
        let findings = doctor::examine(&*bytes, OWN).unwrap().findings;
        assert!(findings.iter().any(|f| f.text.contains(told)), "{what}: {findings:?}");
    }
}
