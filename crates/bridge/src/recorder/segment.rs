//! One file being written.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, BufWriter, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, WriteOptions};
use wire::time::Timestamp;

use super::storage::{LogFile, Storage};
use super::{Record, RecorderOptions};
use crate::marks;
use crate::rewrite::io_error;
use crate::segments::{self, Kind};

pub struct Segment {
    pub number: u32,
    mcap: mcap::Writer<NoSeek<BufWriter<Out>>>,
    file: Arc<dyn LogFile>,
    state: Arc<OutState>,
    channels: HashMap<Arc<str>, u16>,
    /// Bytes that are safe.
    pub committed: u64,
    /// Time of its first message.
    pub start: Option<Timestamp>,
}

#[derive(Default)]
struct OutState {
    size: AtomicU64,
    /// Nothing is written any more: not what is buffered, nor the end that the crate writes when
    /// its writer is dropped.
    closed: AtomicBool,
}

/// Counts the bytes, so that the size is known without asking the disk.
struct Out {
    file: Arc<dyn LogFile>,
    state: Arc<OutState>,
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.state.closed.load(Ordering::Relaxed) {
            return Err(io::Error::other("the segment is closed"));
        }
        let written = self.file.append(bytes)?;
        self.state.size.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A channel to be written: name, encoding, and the schema by name, encoding and content.
struct New<'a> {
    channel: &'a str,
    encoding: &'a str,
    schema: Option<(&'a str, &'a str, &'a [u8])>,
}

impl Segment {
    /// Makes the file, with everything that is known before the first message, and syncs it and its
    /// name. Leaves nothing behind where it fails.
    pub fn create(
        storage: &dyn Storage,
        log: &str,
        number: u32,
        options: &RecorderOptions,
        metadata: BTreeMap<String, String>,
    ) -> io::Result<Segment> {
        let name = segments::path(log, number, Kind::Open);
        let file = storage.create(&name)?;
        let made = Segment::begin(number, file, options, metadata).and_then(|segment| {
            storage.sync_folder(log)?;
            Ok(segment)
        });
        made.inspect_err(|_| {
            // Should this fail, too, the next file gets another number.
            let _ = storage.remove(&name);
        })
    }

    fn begin(
        number: u32,
        file: Arc<dyn LogFile>,
        options: &RecorderOptions,
        metadata: BTreeMap<String, String>,
    ) -> io::Result<Segment> {
        let state = Arc::new(OutState::default());
        let out = Out { file: file.clone(), state: state.clone() };
        let mcap = WriteOptions::new()
            .profile("")
            .library(concat!("footfall ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .chunk_size(Some(1024 * 1024))
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::with_capacity(64 * 1024, out)))
            .map_err(io_error)?;
        let channels = HashMap::new();
        let mut segment =
            Segment { number, mcap, file, state, channels, committed: 0, start: None };
        // First of all: recovery reads what it says of the segments before.
        let session = marks::record(marks::SESSION, metadata);
        segment.mcap.write_metadata(&session).map_err(io_error)?;
        let json = options.schemas.iter().map(|schema| New {
            channel: &schema.channel,
            encoding: "json",
            schema: Some((&schema.name, "jsonschema", schema.schema_json.as_bytes())),
        });
        let protobuf = options.protobuf.iter().map(|of| New {
            channel: &of.channel,
            encoding: "protobuf",
            schema: Some((&of.schema_name, "protobuf", &of.descriptors)),
        });
        segment.add_channels(&json.chain(protobuf).collect::<Vec<_>>())?;
        segment.sync()?;
        Ok(segment)
    }

    fn add_channels(&mut self, new: &[New<'_>]) -> io::Result<()> {
        let first = self.channels.len() as u16 + 1;
        let numbered = || (first..).zip(new);
        for mark in marks::channels(numbered().map(|(id, new)| (id, new.channel, new.encoding))) {
            self.mcap.write_metadata(&mark).map_err(io_error)?;
        }
        for (id, new) in numbered() {
            let schema_id = match new.schema {
                Some((name, encoding, data)) => {
                    self.mcap.add_schema(name, encoding, data).map_err(io_error)?
                }
                None => 0,
            };
            self.mcap
                .add_channel_with_id(id, schema_id, new.channel, new.encoding, &BTreeMap::new())
                .map_err(io_error)?;
            self.channels.insert(new.channel.into(), id);
        }
        Ok(())
    }

    /// Writes a batch and makes it safe.
    pub fn write<'a>(&mut self, records: impl Iterator<Item = &'a Record>) -> io::Result<()> {
        for record in records {
            let channel_id = match self.channels.get(&record.channel) {
                Some(&id) => id,
                None => {
                    let channel = &record.channel;
                    self.add_channels(&[New { channel, encoding: "json", schema: None }])?;
                    self.channels.len() as u16
                }
            };
            let header = MessageHeader {
                channel_id,
                // The format has 32 bits; at 10 Hz they last for 13 years.
                sequence: record.sequence as u32,
                log_time: record.log_time.0,
                publish_time: record.publish_time.0,
            };
            self.mcap.write_to_known_channel(&header, &record.data).map_err(io_error)?;
            self.start.get_or_insert(record.log_time);
        }
        self.sync()
    }

    fn sync(&mut self) -> io::Result<()> {
        self.mcap.flush().map_err(io_error)?;
        self.file.sync_data()?;
        self.committed = self.size();
        Ok(())
    }

    /// Bytes written.
    pub fn size(&self) -> u64 {
        self.state.size.load(Ordering::Relaxed)
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        self.state.closed.store(true, Ordering::Relaxed);
    }
}
