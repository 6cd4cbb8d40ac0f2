//! The writer's thread: batches in, synced chunks out.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Write};
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::write::{Metadata, NoSeek};
use mcap::{Compression, WriteOptions};
use wire::live::{EventLevel, channel};
use wire::resources::LogInfo;
use wire::time::Timestamp;

use super::queue::{Item, Progress, Queue};
use super::{LogFile, Record, RecorderError, RecorderOptions, Storage};

/// Files of one name that are tried: `name`, `name-2`, …
const NAMES_MAX: u32 = 10_000;

type McapWriter = mcap::Writer<NoSeek<Counted>>;

pub struct Writer {
    storage: Box<dyn Storage>,
    options: RecorderOptions,
    queue: Arc<Queue>,
    segment: Option<Segment>,
    progress: Progress,
    /// Durable messages that no file has taken yet.
    kept: Vec<Record>,
}

struct Segment {
    id: String,
    mcap: McapWriter,
    file: Box<dyn LogFile>,
    size: Arc<std::sync::atomic::AtomicU64>,
    channels: HashMap<Arc<str>, u16>,
    start: Option<Timestamp>,
    end: Option<Timestamp>,
    messages: u64,
}

/// Counts the bytes, so that the size is known without asking the disk.
struct Counted {
    inner: Box<dyn Write + Send>,
    size: Arc<std::sync::atomic::AtomicU64>,
}

impl Write for Counted {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(buf)?;
        self.size.fetch_add(written as u64, std::sync::atomic::Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl Writer {
    /// Makes the first file; an error here is the caller's to tell.
    pub fn open(
        mut storage: Box<dyn Storage>,
        options: RecorderOptions,
        queue: Arc<Queue>,
    ) -> io::Result<Writer> {
        let segment = Segment::create(storage.as_mut(), &options)?;
        let progress = Progress { segments: 1, ..Progress::default() };
        let mut writer =
            Writer { storage, options, queue, segment: Some(segment), progress, kept: Vec::new() };
        writer.tell();
        Ok(writer)
    }

    /// Writes batch after batch until the recorder ends.
    pub fn run(mut self) {
        loop {
            let batch = self.queue.take_batch(self.segment.is_none());
            if !batch.items.is_empty() || !self.kept.is_empty() {
                self.commit(batch.items);
            }
            if batch.last {
                return self.finish();
            }
        }
    }

    fn commit(&mut self, items: Vec<Item>) {
        let (mut records, mut waiting) = (std::mem::take(&mut self.kept), Vec::new());
        let mut durable = vec![true; records.len()];
        for item in items {
            durable.push(item.written.is_some());
            waiting.extend(item.written);
            records.push(item.record);
        }
        let outcome = self.write_somewhere(&records);
        match &outcome {
            Ok(()) => {
                self.progress.commits += 1;
                self.progress.messages += records.len() as u64;
                self.progress.error = None;
            }
            Err(error) => {
                if self.progress.error.is_none() {
                    let text = format!("the flight log cannot be written: {error}");
                    self.queue.notice(EventLevel::Critical, text);
                }
                self.progress.error = Some(error.to_string());
                let lost = records.iter().zip(&durable).filter(|(_, d)| !**d);
                self.queue.drop_all(lost.map(|(record, _)| &record.channel));
                let mut keep = durable.iter();
                records.retain(|_| keep.next().is_some_and(|d| *d));
                let surplus = records.len().saturating_sub(super::DURABLE_MAX);
                self.queue.drop_all(records[..surplus].iter().map(|record| &record.channel));
                self.kept = records.split_off(surplus);
            }
        }
        self.tell();
        let answer = outcome.map_err(|e| RecorderError::Write(e.to_string()));
        let somebody_waits = !waiting.is_empty();
        for sender in waiting {
            // Who no longer waits needs no answer.
            let _ = sender.send(answer.clone());
        }
        if somebody_waits {
            self.queue.committed.notify_one();
        }
    }

    /// Writes to the present file, or else to one new file.
    fn write_somewhere(&mut self, records: &[Record]) -> io::Result<()> {
        if let Some(segment) = &mut self.segment {
            let Err(error) = segment.write(records) else { return Ok(()) };
            let text = format!("log {} ends with an error: {error}; a new one begins", segment.id);
            tracing::error!("{text}");
            self.queue.notice(EventLevel::Warning, text);
            self.segment = None;
        }
        let mut segment = Segment::create(self.storage.as_mut(), &self.options)?;
        self.progress.segments += 1;
        segment.write(records)?;
        self.segment = Some(segment);
        Ok(())
    }

    fn finish(mut self) {
        let mut notices = Vec::new();
        let log_time = self.progress.log.as_ref().and_then(|l| l.end).unwrap_or(self.options.start);
        for notice in self.queue.take_notices() {
            let Ok(json) = serde_json::to_vec(&notice) else { continue };
            let channel: Arc<str> = channel::EVENT.into();
            let record = Record {
                channel,
                sequence: 0,
                log_time,
                publish_time: log_time,
                json: json.into(),
            };
            notices.push(Item { record, written: None });
        }
        if !notices.is_empty() {
            self.commit(notices);
        }
        if let Some(segment) = self.segment.take() {
            let (info, outcome) = segment.finish();
            if let Err(error) = outcome {
                tracing::error!("log {} could not be closed: {error}", info.id);
                self.progress.error = Some(error.to_string());
            }
            self.progress.log = Some(info);
        }
        self.tell();
    }

    fn tell(&mut self) {
        if let Some(segment) = &self.segment {
            self.progress.log = Some(segment.info());
        }
        self.queue.set_progress(self.progress.clone());
    }
}

impl Segment {
    fn create(storage: &mut dyn Storage, options: &RecorderOptions) -> io::Result<Segment> {
        let (id, mut file) = create_under_free_name(storage, options.start)?;
        let size = Arc::<std::sync::atomic::AtomicU64>::default();
        let out = Counted { inner: file.writer()?, size: size.clone() };
        let mcap = WriteOptions::new()
            .profile("")
            .library(concat!("footfall ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .chunk_size(Some(1024 * 1024))
            .disable_seeking(true)
            .create(NoSeek::new(out))
            .map_err(io_error)?;
        let (start, end) = (None, None);
        let channels = HashMap::new();
        let mut segment = Segment { id, mcap, file, size, channels, start, end, messages: 0 };
        for schema in &options.schemas {
            segment.add_channel(&schema.channel, Some((&schema.name, &schema.schema_json)))?;
        }
        let metadata = Metadata { name: "footfall".into(), metadata: options.metadata.clone() };
        segment.mcap.write_metadata(&metadata).map_err(io_error)?;
        segment.sync()?;
        Ok(segment)
    }

    fn add_channel(&mut self, channel: &str, schema: Option<(&str, &str)>) -> io::Result<u16> {
        let schema_id = match schema {
            Some((name, text)) => {
                self.mcap.add_schema(name, "jsonschema", text.as_bytes()).map_err(io_error)?
            }
            None => 0,
        };
        let id = self
            .mcap
            .add_channel(schema_id, channel, "json", &BTreeMap::new())
            .map_err(io_error)?;
        self.channels.insert(channel.into(), id);
        Ok(id)
    }

    fn write(&mut self, records: &[Record]) -> io::Result<()> {
        for record in records {
            let channel_id = match self.channels.get(&record.channel) {
                Some(&id) => id,
                None => self.add_channel(&record.channel, None)?,
            };
            let header = MessageHeader {
                channel_id,
                // The format has 32 bits; at 10 Hz they last for 13 years.
                sequence: record.sequence as u32,
                log_time: record.log_time.0,
                publish_time: record.publish_time.0,
            };
            self.mcap.write_to_known_channel(&header, &record.json).map_err(io_error)?;
        }
        self.sync()?;
        let times = || records.iter().map(|record| record.log_time);
        self.start = self.start.into_iter().chain(times()).min();
        self.end = self.end.into_iter().chain(times()).max();
        self.messages += records.len() as u64;
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        self.mcap.flush().map_err(io_error)?;
        self.file.sync_data()
    }

    /// Writes the summary and the end of the file.
    fn finish(mut self) -> (LogInfo, io::Result<()>) {
        let finished = self.mcap.finish().map(drop).map_err(io_error);
        let info = LogInfo { open: false, ..self.info() };
        let flushed = self.mcap.into_inner().into_inner().flush();
        (info, finished.and(flushed).and_then(|()| self.file.sync_data()))
    }

    fn info(&self) -> LogInfo {
        LogInfo {
            id: self.id.clone(),
            size: self.size.load(std::sync::atomic::Ordering::Relaxed),
            start: self.start,
            end: self.end,
            messages: self.messages,
            open: true,
        }
    }
}

fn create_under_free_name(
    storage: &mut dyn Storage,
    start: Timestamp,
) -> io::Result<(String, Box<dyn LogFile>)> {
    let time: String = start.to_rfc3339()[..19].chars().filter(|c| !"-:".contains(*c)).collect();
    let name = format!("footfall-{time}Z");
    for number in 1..=NAMES_MAX {
        let id = if number == 1 { name.clone() } else { format!("{name}-{number}") };
        match storage.create(&id) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
            Ok(file) => return Ok((id, file)),
        }
    }
    Err(io::Error::other(format!("there are {NAMES_MAX} logs named {name} already")))
}

/// The cause, where the crate only says that there was one.
fn io_error(error: mcap::McapError) -> io::Error {
    match error {
        mcap::McapError::Io(io) => io,
        other => io::Error::other(other),
    }
}
