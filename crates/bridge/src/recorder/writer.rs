//! The writer's thread: batches in, synced chunks out.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, PoisonError};

use wire::live::{EventLevel, GapReason, channel};
use wire::resources::LogInfo;
use wire::time::Timestamp;

use super::queue::{Batch, Class, Item, Progress, Queue};
use super::room::{self, Level, Room};
use super::sealer::{Job, Sealer, Sizes, Worker};
use super::segment::Segment;
use super::{Record, RecorderError, RecorderOptions, Storage};
use crate::recover::COMMITTED_KEY;
use crate::seal::SealRef;
use crate::segments;

/// Logs of one name that are tried: `name`, `name-2`, …
const NAMES_MAX: u32 = 10_000;

pub struct Writer {
    storage: Arc<dyn Storage>,
    options: RecorderOptions,
    queue: Arc<Queue>,
    log: String,
    segment: Option<Segment>,
    next_number: u32,
    /// How much counts of the segments that ended with an error.
    failed: BTreeMap<u32, u64>,
    sealer: Option<Sealer>,
    sizes: Sizes,
    room: Room,
    progress: Progress,
    /// Durable messages that no file has taken yet.
    kept: Vec<Record>,
    gap_sequence: u64,
    start: Option<Timestamp>,
    end: Option<Timestamp>,
}

impl Writer {
    /// Makes the first segment; an error here is the caller's to tell.
    pub fn open(
        storage: Arc<dyn Storage>,
        options: RecorderOptions,
        queue: Arc<Queue>,
        head: Option<SealRef>,
    ) -> io::Result<Writer> {
        let log = make_log(&*storage, options.start)?;
        let sizes = Sizes::default();
        let worker = Worker::new(storage.clone(), log.clone(), head, queue.clone(), sizes.clone());
        let sealer = Some(Sealer::start(worker, options.seal_aside)?);
        let reserve = format!("{log}/{}", segments::RESERVE);
        let room = Room::new(storage.clone(), reserve, options.reserve_bytes);
        let mut writer = Writer {
            storage,
            options,
            queue,
            log,
            segment: None,
            next_number: 1,
            failed: BTreeMap::new(),
            sealer,
            sizes,
            room,
            progress: Progress::default(),
            kept: Vec::new(),
            gap_sequence: 0,
            start: None,
            end: None,
        };
        let first = writer.new_segment()?;
        writer.segment = Some(first);
        writer.tell(true);
        Ok(writer)
    }

    /// Writes batch after batch until the recorder ends.
    pub fn run(mut self) {
        loop {
            let batch = self.queue.take_batch(self.segment.is_none());
            let last = batch.last;
            if let Some((level, text)) = self.room.look() {
                self.queue.notice(level, text);
            }
            self.turn(&batch);
            self.commit(batch.items);
            if last {
                return self.finish();
            }
        }
    }

    /// Begins a new segment where it is time to. Should that fail, the present one goes on.
    fn turn(&mut self, batch: &Batch) {
        let Some(segment) = &self.segment else { return };
        let Some(start) = segment.start else { return };
        let newest = batch.items.iter().map(|item| item.record.log_time).max();
        let old = newest.is_some_and(|time| time.seconds_since(start) >= self.options.segment_s);
        let large = segment.committed >= self.options.segment_bytes;
        if !(batch.rotate || old || large) || self.room.level() == Level::Full {
            return;
        }
        match self.new_segment() {
            Ok(next) => {
                if let Some(done) = self.segment.replace(next) {
                    self.close(done, None);
                }
            }
            Err(error) => {
                tracing::warn!("no new segment of the log can be made: {error}");
                if room::is_full(&error) {
                    self.exhausted();
                }
            }
        }
    }

    fn commit(&mut self, items: Vec<Item>) {
        let (mut records, mut waiting) = (Vec::new(), Vec::new());
        records.extend(std::mem::take(&mut self.kept).into_iter().map(|r| (r, Class::Durable)));
        if self.room.level() < Level::Full {
            records.extend(self.gap_records().into_iter().map(|r| (r, Class::Durable)));
        }
        for item in items {
            waiting.extend(item.written);
            records.push((item.record, item.class));
        }
        self.shed(&mut records);
        if records.is_empty() {
            return self.tell(self.segment.is_some());
        }
        let outcome = self.write_somewhere(&mut records);
        match &outcome {
            Ok(()) => {
                self.progress.commits += 1;
                self.progress.messages += records.len() as u64;
                let times = || records.iter().map(|(record, _)| record.log_time);
                self.start = self.start.into_iter().chain(times()).min();
                self.end = self.end.into_iter().chain(times()).max();
                self.progress.error = None;
            }
            Err(error) => {
                if self.progress.error.is_none() {
                    let text = format!("the flight log cannot be written: {error}");
                    self.queue.notice(EventLevel::Critical, text);
                }
                self.progress.error = Some(error.to_string());
                let lost = records.iter().filter(|(_, class)| *class != Class::Durable);
                self.queue.drop_all(lost.map(|(record, _)| record), GapReason::DiskError);
                records.retain(|(_, class)| *class == Class::Durable);
                let mut kept: Vec<Record> = records.into_iter().map(|(record, _)| record).collect();
                let surplus = kept.len().saturating_sub(super::DURABLE_MAX);
                self.queue.drop_all(kept[..surplus].iter(), GapReason::DiskError);
                self.kept = kept.split_off(surplus);
            }
        }
        self.tell(outcome.is_ok());
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

    /// Gives up what there is no room for.
    fn shed(&self, records: &mut Vec<(Record, Class)>) {
        let level = self.room.level();
        let fits = |class: Class| match class {
            Class::Durable => true,
            Class::Telemetry => level < Level::Full,
            Class::Bulk => level < Level::NoBulk,
        };
        let lost = records.iter().filter(|(_, class)| !fits(*class));
        self.queue.drop_all(lost.map(|(record, _)| record), GapReason::DiskFull);
        records.retain(|(_, class)| fits(*class));
    }

    /// What the log lacks, as messages for it.
    fn gap_records(&mut self) -> Vec<Record> {
        let log_time = self.end.unwrap_or(self.options.start);
        let mut records = Vec::new();
        for gap in self.queue.take_gaps() {
            let Ok(json) = serde_json::to_vec(&gap) else { continue };
            self.gap_sequence += 1;
            records.push(Record {
                channel: channel::LOG_GAP.into(),
                sequence: self.gap_sequence,
                log_time,
                publish_time: gap.to,
                data: json.into(),
            });
        }
        records
    }

    /// Writes to the present segment, or else to one new one; to a second one where the first
    /// error was a full disk and the reserve makes room.
    fn write_somewhere(&mut self, records: &mut Vec<(Record, Class)>) -> io::Result<()> {
        let mut outcome = self.write_once(records);
        for _ in 0..2 {
            let Err(error) = &outcome else { break };
            if room::is_full(error) {
                self.exhausted();
                self.shed(records);
            }
            outcome = self.write_once(records);
        }
        outcome
    }

    fn write_once(&mut self, records: &[(Record, Class)]) -> io::Result<()> {
        if records.is_empty() {
            return Ok(());
        }
        let mut segment = match self.segment.take() {
            Some(segment) => segment,
            None => self.new_segment()?,
        };
        match segment.write(records.iter().map(|(record, _)| record)) {
            Ok(()) => {
                self.segment = Some(segment);
                Ok(())
            }
            Err(error) => {
                let number = segment.number;
                let text = format!(
                    "segment {number} of the log ends with an error: {error}; a new one begins"
                );
                tracing::error!("{text}");
                self.queue.notice(EventLevel::Warning, text);
                let committed = segment.committed;
                self.failed.insert(number, committed);
                self.close(segment, Some(committed));
                Err(error)
            }
        }
    }

    fn exhausted(&mut self) {
        if let Some((level, text)) = self.room.exhausted() {
            self.queue.notice(level, text);
        }
    }

    fn new_segment(&mut self) -> io::Result<Segment> {
        let mut metadata = self.options.metadata.clone();
        metadata.insert("log".into(), self.log.clone());
        if !self.failed.is_empty() {
            let pairs = self.failed.iter().map(|(number, bytes)| format!("{number}:{bytes}"));
            metadata.insert(COMMITTED_KEY.into(), pairs.collect::<Vec<_>>().join(" "));
        }
        loop {
            let number = self.next_number;
            match Segment::create(
                &*self.storage,
                &self.log,
                number,
                &self.options,
                metadata.clone(),
            ) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => self.next_number += 1,
                Err(error) => return Err(error),
                Ok(segment) => {
                    self.next_number += 1;
                    self.progress.segments += 1;
                    return Ok(segment);
                }
            }
        }
    }

    fn close(&mut self, segment: Segment, limit: Option<u64>) {
        let (number, bytes) = (segment.number, segment.committed);
        drop(segment);
        self.sizes.lock().unwrap_or_else(PoisonError::into_inner).insert(number, bytes);
        if let Some(sealer) = &mut self.sealer {
            sealer.take(Job { segment: number, bytes, limit });
        }
    }

    fn finish(mut self) {
        let mut notices = Vec::new();
        let log_time = self.end.unwrap_or(self.options.start);
        for notice in self.queue.take_notices() {
            let Ok(json) = serde_json::to_vec(&notice) else { continue };
            let (channel, data) = (channel::EVENT.into(), json.into());
            let record = Record { channel, sequence: 0, log_time, publish_time: log_time, data };
            notices.push(Item { record, class: Class::Durable, written: None });
        }
        self.commit(notices);
        if let Some(segment) = self.segment.take() {
            self.close(segment, None);
        }
        if let Some(sealer) = self.sealer.take() {
            sealer.finish();
        }
        self.tell(true);
        if let Some(log) = &mut self.progress.log {
            log.open = false;
        }
        self.queue.set_progress(self.progress.clone());
    }

    fn tell(&mut self, written: bool) {
        if self.room.level() == Level::Full {
            let why = "the disk is full: commands are logged from a reserve, telemetry is not";
            let worse = self.progress.error.take().filter(|_| !written);
            self.progress.error = Some(worse.unwrap_or_else(|| why.into()));
        } else if written && self.kept.is_empty() {
            self.progress.error = None;
        }
        let closed: u64 = self.sizes.lock().unwrap_or_else(PoisonError::into_inner).values().sum();
        self.progress.log = Some(LogInfo {
            id: self.log.clone(),
            size: closed + self.segment.as_ref().map_or(0, |segment| segment.committed),
            start: self.start,
            end: self.end,
            messages: self.progress.messages,
            open: true,
        });
        self.queue.set_progress(self.progress.clone());
    }
}

/// A folder for a new log.
fn make_log(storage: &dyn Storage, start: Timestamp) -> io::Result<String> {
    let time: String = start.to_rfc3339()[..19].chars().filter(|c| !"-:".contains(*c)).collect();
    let name = format!("footfall-{time}Z");
    // Logs of one file, as earlier versions wrote them.
    let files = storage.files("").unwrap_or_default();
    for number in 1..=NAMES_MAX {
        let log = if number == 1 { name.clone() } else { format!("{name}-{number}") };
        if files.contains(&format!("{log}.mcap")) {
            continue;
        }
        match storage.make_folder(&log) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
            Ok(()) => return Ok(log),
        }
    }
    Err(io::Error::other(format!("there are {NAMES_MAX} logs named {name} already")))
}
