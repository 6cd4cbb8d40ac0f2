//! Damage never passes silently, and takes no more with it than what it hits.
//!
//! `FOOTFALL_FULL=1`: 10 000 damages, else 1500.

use std::ops::Range;

use bridge::reader::{Damage, Limits, LogContent, LogMessage, read_log};
use bridge::recorder::Recorder;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::recorder::{messages, options};
use crate::sim_fs::SimFs;

/// A log as it is while it is written, and the same log sealed.
fn open_and_sealed() -> [Vec<u8>; 2] {
    let disk = SimFs::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    for batch in messages(600).chunks(25) {
        let (last, others) = batch.split_last().unwrap();
        others.iter().for_each(|r| recorder.record(r.clone()));
        recorder.record_durable(last.clone()).unwrap().wait_blocking().unwrap();
    }
    let open = disk.files().into_values().next().unwrap();
    recorder.finish().unwrap();
    [open, disk.files().into_values().next().unwrap()]
}

/// Where the chunks are, by the crate's own reader: byte range, and number of messages.
fn layout(bytes: &[u8]) -> Vec<(Range<usize>, usize)> {
    let options = LinearReaderOptions::default().with_emit_chunks(true);
    let mut reader = LinearReader::new_with_options(options);
    let (mut fed, mut at, mut chunks) = (0, mcap::MAGIC.len(), Vec::new());
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let given = wanted.min(bytes.len() - fed);
                reader.insert(given)[..given].copy_from_slice(&bytes[fed..fed + given]);
                fed += given;
                reader.notify_read(given);
            }
            Ok(LinearReadEvent::Record { opcode, data }) => {
                let end = at + 9 + data.len();
                if opcode == op::CHUNK {
                    chunks.push((at..end, 0));
                } else if opcode == op::MESSAGE_INDEX {
                    chunks.last_mut().unwrap().1 += (data.len() - 6) / 16;
                }
                at = end;
            }
            Err(_) => break,
        }
    }
    chunks
}

/// Damages `bytes` at a random place; the range that may have changed.
fn harm(rng: &mut ChaCha8Rng, bytes: &mut Vec<u8>) -> Range<usize> {
    let at = rng.random_range(0..bytes.len());
    match rng.random_range(0..5) {
        0 | 1 => {
            bytes[at] ^= 1 << rng.random_range(0..8);
            at..at + 1
        }
        2 => {
            let end = bytes.len();
            bytes.truncate(at);
            at..end
        }
        kind => {
            let sector = at / 512 * 512;
            let end = (sector + 512).min(bytes.len());
            for byte in &mut bytes[sector..end] {
                *byte = if kind == 3 { 0 } else { rng.random_range(0..=255) };
            }
            sector..end
        }
    }
}

fn read(bytes: &[u8]) -> LogContent {
    read_log(bytes, Limits::default()).unwrap_or_else(|error| match error {
        bridge::reader::ReadError::Damaged(damage) => {
            LogContent { messages: Vec::new(), damage: vec![damage] }
        }
        other => panic!("{other}"),
    })
}

#[test]
fn every_damage_is_told_and_good_chunks_around_it_are_returned() {
    let cases = if std::env::var_os("FOOTFALL_FULL").is_some() { 10_000 } else { 1500 };
    let originals = open_and_sealed();
    let sound = originals.clone().map(|bytes| read(&bytes));
    assert_eq!(sound[0].damage, [Damage::Torn { at: originals[0].len() as u64 }]);
    assert_eq!(sound[1].damage, []);
    let layouts = originals.clone().map(|bytes| layout(&bytes));
    assert!(layouts[0].len() > 20, "{}", layouts[0].len());
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let (mut told, mut harmless, mut kept) = (0, 0, 0);
    for case in 0..cases {
        let which = case % 2;
        let mut bytes = originals[which].clone();
        let hit = harm(&mut rng, &mut bytes);
        let content = read(&bytes);
        let same = content.messages == sound[which].messages;
        let silent = content.damage == sound[which].damage;
        assert!(
            same || !silent,
            "case {case}, bytes {hit:?}: messages changed and nothing is told"
        );
        assert!(which == 0 || !silent || bytes == originals[1], "case {case}: a sealed file");
        if silent {
            harmless += 1
        } else {
            told += 1
        }
        // Whatever stands in a chunk that was not hit.
        let (mut n, mut wanted) = (0, Vec::<&LogMessage>::new());
        for (range, messages) in &layouts[which] {
            if range.end <= hit.start || hit.end <= range.start {
                wanted.extend(&sound[which].messages[n..n + messages]);
            }
            n += messages;
        }
        let mut returned = content.messages.iter();
        for message in &wanted {
            assert!(
                returned.any(|r| r == *message),
                "case {case}, bytes {hit:?}: {} {} was not hit and is not returned; {:?}",
                message.channel,
                message.sequence,
                content.damage
            );
        }
        kept += wanted.len();
    }
    eprintln!("{cases} damages: {told} told, {harmless} of no consequence, {kept} messages kept");
    assert!(told > harmless && kept > cases * 100);
}

/// One flipped bit makes of an index of messages the end of the data, as its kind says: what stands behind
/// it is returned all the same.
#[test]
fn an_index_that_reads_as_the_end_of_the_data_ends_nothing() {
    let originals = open_and_sealed();
    let mut cases = 0;
    for original in &originals {
        let sound = read(original);
        let last_chunk = layout(original).last().unwrap().0.end;
        let mut at = mcap::MAGIC.len();
        while at + 9 < last_chunk {
            let length = u64::from_le_bytes(original[at + 1..at + 9].try_into().unwrap());
            if original[at] == op::MESSAGE_INDEX {
                let mut bytes = original.clone();
                bytes[at] ^= 8;
                assert_eq!(bytes[at], op::DATA_END);
                let content = read(&bytes);
                assert_ne!(content.damage, sound.damage, "byte {at}: told");
                assert!(content.messages == sound.messages, "byte {at}: {:?}", content.damage);
                cases += 1;
            }
            at += 9 + length as usize;
        }
    }
    assert!(cases > 20, "{cases}");
}
