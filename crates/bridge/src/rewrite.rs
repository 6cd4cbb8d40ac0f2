//! What was read of a log, written to a new, complete file: chunks of 1 MiB, zstd, message and chunk
//! indexes, summary, all checksums. Messages keep their bytes, times, numbers and order.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, WriteOptions};
use serde::{Deserialize, Serialize};
use wire::live::channel;
use wire::time::Timestamp;

use crate::marks;
use crate::reader::{ChannelDef, Item, LogMessage};
use crate::recorder::LogFile;

/// Target size of a chunk (bytes).
const CHUNK_BYTES: u64 = 1 << 20;
/// Name of the attachment with all command events of a file, for a quick view of the state.
pub const COMMANDS: &str = "footfall.commands";
/// Most bytes of that attachment; where there are more, it is left out and the file is searched.
const COMMANDS_BYTES: usize = 16 << 20;

/// What a file holds of one channel.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelCount {
    /// Messages.
    pub messages: u64,
    /// Number of the first.
    pub first_sequence: u32,
    /// Number of the last.
    pub last_sequence: u32,
    /// Numbers left out between them.
    pub missing: u64,
}

/// What a file holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Contents {
    /// Time of the first message.
    pub start: Option<Timestamp>,
    /// Time of the last.
    pub end: Option<Timestamp>,
    /// Messages.
    pub messages: u64,
    /// By channel.
    pub channels: BTreeMap<String, ChannelCount>,
}

impl Contents {
    /// Counts a message in.
    pub fn count(&mut self, message: &LogMessage) {
        let time = message.log_time;
        self.start = Some(self.start.map_or(time, |t| t.min(time)));
        self.end = Some(self.end.map_or(time, |t| t.max(time)));
        self.messages += 1;
        if !self.channels.contains_key(&*message.channel) {
            let first_sequence = message.sequence;
            let count = ChannelCount { first_sequence, ..ChannelCount::default() };
            self.channels.insert(message.channel.to_string(), count);
        }
        let Some(count) = self.channels.get_mut(&*message.channel) else { return };
        if count.messages > 0 {
            // Numbers wrap; one that is not after the last is another run of the program, no hole.
            let step = message.sequence.wrapping_sub(count.last_sequence);
            if (2..u32::MAX / 2).contains(&step) {
                count.missing += u64::from(step) - 1;
            }
        }
        count.messages += 1;
        count.last_sequence = message.sequence;
    }
}

/// Bytes of a [`LogFile`] as the crate wants them.
pub struct Out(pub Arc<dyn LogFile>);

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.append(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A command event in the attachment [`COMMANDS`], one in a line.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CommandLine<'a> {
    /// Its number on the channel.
    pub sequence: u32,
    /// When it was logged.
    pub log_time: u64,
    /// When it happened.
    pub publish_time: u64,
    /// The message as it stands in the log.
    #[serde(borrow)]
    pub text: std::borrow::Cow<'a, str>,
}

/// A file being written.
pub struct Rewriter<W: Write> {
    mcap: mcap::Writer<NoSeek<BufWriter<W>>>,
    channels: Vec<(Arc<ChannelDef>, u16)>,
    /// Channels that are to be written with the first message of any of them.
    introduced: Vec<Arc<ChannelDef>>,
    contents: Contents,
    commands: Option<Vec<u8>>,
}

impl<W: Write> Rewriter<W> {
    /// Begins a file.
    pub fn new(out: W) -> io::Result<Rewriter<W>> {
        let mcap = WriteOptions::new()
            .profile("")
            .library(concat!("footfall ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::with_capacity(256 * 1024, out)))
            .map_err(io_error)?;
        let (channels, introduced) = (Vec::new(), Vec::new());
        let (contents, commands) = (Contents::default(), Some(Vec::new()));
        Ok(Rewriter { mcap, channels, introduced, contents, commands })
    }

    /// Takes an item over.
    pub fn take(&mut self, item: &Item) -> io::Result<()> {
        match item {
            Item::Channel(channel) => {
                self.introduced.push(channel.clone());
                Ok(())
            }
            Item::Message(channel, message) => self.message(channel, message),
            Item::Metadata(name, texts) => self.metadata(name, texts.clone()),
            // Made anew from the messages.
            Item::Attachment { name, .. } if name == COMMANDS => Ok(()),
            Item::Attachment { log_time, create_time, name, media_type, data } => {
                self.attach(*log_time, *create_time, name, media_type, data)
            }
        }
    }

    /// Writes a metadata record.
    pub fn metadata(&mut self, name: &str, texts: BTreeMap<String, String>) -> io::Result<()> {
        self.mcap.write_metadata(&marks::record(name, texts)).map_err(io_error)
    }

    /// Attaches a file.
    pub fn attach(
        &mut self,
        log_time: Timestamp,
        create_time: Timestamp,
        name: &str,
        media_type: &str,
        data: &[u8],
    ) -> io::Result<()> {
        let attachment = Attachment {
            log_time: log_time.0,
            create_time: create_time.0,
            name: name.into(),
            media_type: media_type.into(),
            data: data.into(),
        };
        self.mcap.attach(&attachment).map_err(io_error)
    }

    /// The channel's number in the new file. Channels that were introduced together are written
    /// together: first the records that repeat them, then, in a chunk, what these repeat.
    fn channel(&mut self, channel: &Arc<ChannelDef>) -> io::Result<u16> {
        if let Some((_, id)) = self.channels.iter().find(|(known, _)| Arc::ptr_eq(known, channel)) {
            return Ok(*id);
        }
        let mut introduced = std::mem::take(&mut self.introduced);
        introduced.push(channel.clone());
        let mut new = Vec::new();
        for channel in introduced {
            let alike =
                |known: &ChannelDef| ChannelDef { id: channel.id, ..known.clone() } == *channel;
            let id = match self.channels.iter().find(|(known, _)| alike(known)) {
                Some((_, id)) => *id,
                None => {
                    let last = self.channels.iter().map(|(_, id)| *id).max().unwrap_or(0);
                    let many = || io::Error::other("there are more than 65535 channels");
                    let id = last.checked_add(1).ok_or_else(many)?;
                    new.push((channel.clone(), id));
                    id
                }
            };
            self.channels.push((channel, id));
        }
        let said = new.iter().map(|(channel, id)| (*id, &*channel.topic, &*channel.encoding));
        for mark in if new.is_empty() { Vec::new() } else { marks::channels(said) } {
            self.mcap.write_metadata(&mark).map_err(io_error)?;
        }
        for (channel, id) in &new {
            let schema = match &channel.schema {
                Some(s) => self.mcap.add_schema(&s.name, &s.encoding, &s.data).map_err(io_error)?,
                None => 0,
            };
            let (topic, encoding) = (&*channel.topic, &*channel.encoding);
            self.mcap
                .add_channel_with_id(*id, schema, topic, encoding, &channel.metadata)
                .map_err(io_error)?;
        }
        self.channels.last().map(|(_, id)| *id).ok_or_else(|| io::Error::other("no channel"))
    }

    fn message(&mut self, channel: &Arc<ChannelDef>, message: &LogMessage) -> io::Result<()> {
        let header = MessageHeader {
            channel_id: self.channel(channel)?,
            sequence: message.sequence,
            log_time: message.log_time.0,
            publish_time: message.publish_time.0,
        };
        self.mcap.write_to_known_channel(&header, &message.data).map_err(io_error)?;
        self.contents.count(message);
        if *message.channel == *channel::COMMAND_EVENT {
            self.keep_command(message);
        }
        Ok(())
    }

    fn keep_command(&mut self, message: &LogMessage) {
        let Ok(text) = std::str::from_utf8(&message.data) else { return };
        let line = CommandLine {
            sequence: message.sequence,
            log_time: message.log_time.0,
            publish_time: message.publish_time.0,
            text: text.into(),
        };
        if let Some(commands) = &mut self.commands
            && serde_json::to_writer(&mut *commands, &line).is_ok()
        {
            commands.push(b'\n');
        }
        if self.commands.as_ref().is_some_and(|c| c.len() > COMMANDS_BYTES) {
            self.commands = None;
        }
    }

    /// What was written so far.
    pub fn contents(&self) -> &Contents {
        &self.contents
    }

    /// Writes summary and end; the caller syncs.
    pub fn finish(mut self) -> io::Result<Contents> {
        if let Some(last) = self.introduced.pop() {
            self.channel(&last)?;
        }
        if let Some(commands) = self.commands.take() {
            let time = self.contents.end.unwrap_or(Timestamp(0));
            self.attach(time, time, COMMANDS, "application/x-ndjson", &commands)?;
        }
        self.mcap.finish().map_err(io_error)?;
        self.mcap.into_inner().into_inner().flush()?;
        Ok(self.contents)
    }
}

/// The cause, where the crate only says that there was one.
pub fn io_error(error: mcap::McapError) -> io::Error {
    match error {
        mcap::McapError::Io(io) => io,
        other => io::Error::other(other),
    }
}
