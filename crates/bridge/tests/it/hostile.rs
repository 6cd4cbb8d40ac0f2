//! Files made to harm: each gives a named answer within the limits.

use std::collections::BTreeMap;
use std::io::Cursor;

use bridge::reader::{Damage, Limits, LogContent, ReadError, read_log};
use bridge::recorder::Recorder;
use mcap::records::{MessageHeader, op};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::recorder::{messages, options};
use crate::support::FaultyDisk;

fn sound_log() -> Vec<u8> {
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    for message in messages(60) {
        recorder.record_durable(message).unwrap().wait_blocking().unwrap();
    }
    recorder.finish().unwrap();
    disk.files().into_values().next().unwrap()
}

/// A log of one uncompressed chunk.
fn plain_log() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(None).use_chunks(true);
    let mut writer = options.create(&mut bytes).unwrap();
    let channel_id = writer.add_channel(0, "rover/state", "json", &BTreeMap::new()).unwrap();
    for sequence in 0..10 {
        let header = MessageHeader { channel_id, sequence, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, b"{\"speed\":0.25}").unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// A log with a chunk for each of 30 messages.
fn chunked_log() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new().create(&mut bytes).unwrap();
    let channel_id = writer.add_channel(0, "rover/state", "json", &BTreeMap::new()).unwrap();
    for sequence in 0..30 {
        let header = MessageHeader { channel_id, sequence, log_time: 1, publish_time: 1 };
        let text = format!("{{\"n\":{sequence},\"text\":\"{}\"}}", "rover ".repeat(10));
        writer.write_to_known_channel(&header, text.as_bytes()).unwrap();
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// A file of the given records, without an end.
fn file_of(records: &[(u8, u64, &[u8])]) -> Vec<u8> {
    let mut bytes = mcap::MAGIC.to_vec();
    for (opcode, length, body) in records {
        bytes.push(*opcode);
        bytes.extend(length.to_le_bytes());
        bytes.extend(*body);
    }
    bytes
}

fn chunk(compression: &str, uncompressed_size: u64, data: &[u8]) -> Vec<u8> {
    let mut body = [0; 16].to_vec();
    body.extend(uncompressed_size.to_le_bytes());
    body.extend(0_u32.to_le_bytes());
    body.extend((compression.len() as u32).to_le_bytes());
    body.extend(compression.as_bytes());
    body.extend((data.len() as u64).to_le_bytes());
    body.extend(data);
    body
}

fn read(bytes: &[u8]) -> Result<LogContent, ReadError> {
    read_log(bytes, Limits::default())
}

fn code(bytes: &[u8]) -> &'static str {
    read(bytes).expect_err("nothing can be read of this").code()
}

#[test]
fn lengths_beyond_reason_are_refused_by_name() {
    for length in [u64::MAX, u64::MAX - 8, 100_000_000_000, (64 << 20) + 1] {
        let bytes = file_of(&[(op::SCHEMA, length, b"")]);
        assert_eq!(code(&bytes), "log_record_too_long", "{length}");
        let bytes = file_of(&[(op::CHUNK, length, b"")]);
        assert_eq!(code(&bytes), "log_record_too_long", "{length}");
    }
    for opcode in [op::DATA_END, op::FOOTER] {
        let bytes = file_of(&[(opcode, u64::MAX, b"")]);
        assert_eq!(code(&bytes), "log_record_too_long");
    }
}

#[test]
fn bombs_are_refused_before_they_are_opened() {
    let bomb = chunk("zstd", 4 << 30, &[0; 100]);
    assert_eq!(code(&file_of(&[(op::CHUNK, bomb.len() as u64, &bomb)])), "log_chunk_too_large");
    let dense = chunk("zstd", 60 << 20, &[0; 100]);
    assert_eq!(code(&file_of(&[(op::CHUNK, dense.len() as u64, &dense)])), "log_chunk_ratio");
}

#[test]
fn a_bomb_that_lies_about_its_size_is_opened_no_further_than_it_says() {
    // 64 MiB of zeros, which the header says are 1000 bytes.
    let mut zeros = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd));
    let mut writer = options.chunk_size(None).create(&mut zeros).unwrap();
    let channel_id = writer.add_channel(0, "x", "json", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, &vec![0; 64 << 20]).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let mut bytes = zeros.into_inner();
    let at = bytes.windows(4).position(|w| w == b"zstd").unwrap();
    bytes[at - 16..at - 8].copy_from_slice(&1000_u64.to_le_bytes());
    let content = read(&bytes);
    let damage = content.unwrap_err();
    assert_eq!(damage.code(), "log_chunk_damaged", "{damage}");
}

#[test]
fn fields_that_say_more_than_there_is_reserve_nothing() {
    // A channel whose name is 4 GB long, it says.
    let mut channel = vec![1, 0, 0, 0];
    channel.extend(u32::MAX.to_le_bytes());
    let bytes = file_of(&[(op::CHANNEL, channel.len() as u64, &channel)]);
    assert_eq!(code(&bytes), "log_record_damaged");
    let mut body = chunk("", 10, b"0123456789");
    body[24 + 4..24 + 8].copy_from_slice(&u32::MAX.to_le_bytes());
    let bytes = file_of(&[(op::CHUNK, body.len() as u64, &body)]);
    assert_eq!(code(&bytes), "log_chunk_damaged");
}

#[test]
fn a_record_that_runs_over_the_end_of_its_chunk_is_refused() {
    let mut inner = vec![op::MESSAGE];
    inner.extend(1000_u64.to_le_bytes());
    inner.extend([0; 20]);
    let mut body = chunk("", inner.len() as u64, &inner);
    body.extend([0; 2000]);
    let bytes = file_of(&[(op::CHUNK, body.len() as u64, &body)]);
    assert_eq!(code(&bytes), "log_chunk_damaged");
}

#[test]
fn what_is_no_log_is_told_so() {
    assert_eq!(code(b"GIF89a, which is something else"), "log_not_mcap");
    let empty = read(b"").unwrap();
    assert!(matches!(empty.damage[..], [Damage::Torn { .. }]), "an empty file is a torn log");
}

#[test]
fn a_flipped_bit_costs_its_chunk_and_is_told() {
    let sound = plain_log();
    let at = sound.windows(4).position(|w| w == b"0.25").unwrap();
    let mut bytes = sound;
    bytes[at + 2] ^= 1;
    assert_eq!(code(&bytes), "log_chunk_damaged", "0.35 is never handed out");

    let sound = chunked_log();
    let all = read(&sound).unwrap().messages;
    let chunks: Vec<usize> =
        sound.windows(4).enumerate().filter(|(_, w)| w == b"zstd").map(|(at, _)| at).collect();
    let mut bytes = sound;
    bytes[chunks[20] + 4 + 8 + 30] ^= 0x10;
    let content = read(&bytes).unwrap();
    assert!(matches!(content.damage[0], Damage::BadChunk { .. }), "{:?}", content.damage);
    assert_eq!(content.messages.len(), all.len() - 1, "the chunks after it are read");
}

#[test]
fn more_than_the_limit_is_refused() {
    let limits = Limits { total_bytes: 1000, ..Limits::default() };
    assert_eq!(read_log(&*sound_log(), limits).unwrap_err().code(), "log_too_large");
}

/// Flips, cuts, copies and overwrites bytes at random places.
fn mutate(rng: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..bytes.len());
        match rng.random_range(0..5) {
            0 => bytes[at] ^= 1 << rng.random_range(0..8),
            1 => bytes[at] = [0, 1, 0x7F, 0x80, 0xFF][rng.random_range(0..5)],
            2 => bytes.truncate(at.max(1)),
            3 => {
                let end = (at + 8).min(bytes.len());
                let value = [0, 1, u64::MAX, 1 << 31, 1 << 62][rng.random_range(0..5)];
                bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
            }
            _ => {
                let from = rng.random_range(0..bytes.len());
                let length = rng.random_range(0..64).min(bytes.len() - from.max(at));
                bytes.copy_within(from..from + length, at);
            }
        }
    }
}

#[test]
fn no_damage_passes_silently_or_panics() {
    let originals = [sound_log(), plain_log()];
    let contents = originals.clone().map(|bytes| read(&bytes).unwrap().messages);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut told, mut harmless) = (0, 0);
    for case in 0..4_000 {
        let which = case % 2;
        let mut bytes = originals[which].clone();
        mutate(&mut rng, &mut bytes);
        match read(&bytes) {
            Err(_) => told += 1,
            Ok(content) if !content.damage.is_empty() => told += 1,
            Ok(content) => {
                assert_eq!(content.messages, contents[which], "case {case}: silent change");
                harmless += 1;
            }
        }
    }
    assert!(told > harmless, "{told} told, {harmless} of no consequence");
}
