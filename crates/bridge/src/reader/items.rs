//! Records into items: schemas and channels are kept, messages get the channel they belong to.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use bytes::Bytes;
use mcap::records::op;
use wire::time::Timestamp;

use super::fields::{ChunkHeader, Fields, MessageHead};
use super::{Damage, Limits, LogMessage, chunk};
use crate::marks;

/// Longest name of a channel that is kept (bytes).
const NAME_BYTES: usize = 256;

/// A schema of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaDef {
    /// Its name.
    pub name: String,
    /// Its language.
    pub encoding: String,
    /// The schema itself.
    pub data: Vec<u8>,
}

/// A channel of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelDef {
    /// Its number in the file.
    pub id: u16,
    /// Its name.
    pub topic: Arc<str>,
    /// How its messages are encoded.
    pub encoding: Arc<str>,
    /// The schema of its messages.
    pub schema: Option<Arc<SchemaDef>>,
    /// Whatever else is said of it.
    pub metadata: BTreeMap<String, String>,
}

/// What a log is made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    /// A channel is introduced, at the latest before its first message.
    Channel(Arc<ChannelDef>),
    /// A message.
    Message(Arc<ChannelDef>, LogMessage),
    /// Texts by key.
    Metadata(String, BTreeMap<String, String>),
    /// A file within the file.
    Attachment {
        /// When it was logged.
        log_time: Timestamp,
        /// When it was made.
        create_time: Timestamp,
        /// Its name.
        name: String,
        /// Its kind.
        media_type: String,
        /// Its content.
        data: Bytes,
    },
}

/// The state of a reading: schemas and channels met so far, items not handed out yet, damage.
#[derive(Debug)]
pub struct Items {
    limits: Limits,
    schemas: HashMap<u16, Arc<SchemaDef>>,
    channels: HashMap<u16, Arc<ChannelDef>>,
    /// A chunk was met.
    chunked: bool,
    pub out: Vec<Item>,
    pub damage: Vec<Damage>,
    /// Bytes behind the fields of the record taken last, for whoever sees what follows to judge.
    pub surplus: usize,
}

impl Items {
    pub fn new(limits: Limits) -> Items {
        let (schemas, channels) = (HashMap::new(), HashMap::new());
        let (out, damage) = (Vec::new(), Vec::new());
        Items { limits, schemas, channels, chunked: false, out, damage, surplus: 0 }
    }

    /// Takes a record of the data section; false if its length is not to be trusted.
    pub fn take(&mut self, opcode: u8, data: &[u8], at: u64) -> bool {
        self.surplus = 0;
        let outcome = match opcode {
            op::CHUNK => return self.take_chunk(data, at),
            op::HEADER => self.header(data),
            // An index of messages is one flipped bit away from a message, and nothing here has a
            // checksum; a file has its messages in chunks, or has no chunks.
            op::MESSAGE if self.chunked => Err("it is a message outside of the chunks".into()),
            op::SCHEMA | op::CHANNEL | op::MESSAGE => self.take_plain(opcode, data),
            op::MESSAGE_INDEX => self.message_index(data),
            op::ATTACHMENT => self.attachment(data),
            op::METADATA => self.metadata(data),
            // Private records are nobody's business, but for a chunk whose first byte was hit.
            _ => match ChunkHeader::read(data) {
                Some(header) if chunk::content(&header, at, self.limits).is_ok() => {
                    self.take_chunk(data, at);
                    let reason = "it is a chunk under another name".into();
                    self.damage.push(Damage::BadRecord { at, reason });
                    Ok(())
                }
                _ if opcode >= 0x80 => Ok(()),
                _ => Err(format!("a record of kind {opcode:#04x} has no place here")),
            },
        };
        match outcome {
            Ok(()) => true,
            Err(reason) => {
                self.damage.push(Damage::BadRecord { at, reason });
                false
            }
        }
    }

    fn take_chunk(&mut self, data: &[u8], at: u64) -> bool {
        self.chunked = true;
        let Some(header) = ChunkHeader::read(data) else {
            let reason = "it is shorter than it says".into();
            self.damage.push(Damage::BadChunk { at, reason });
            return false;
        };
        // Zeros are a chunk without content, and nothing in them would tell.
        if header.uncompressed_size == 0 && !super::frames::has_chunk_shape(data, data.len()) {
            let reason = "it says that it is empty, and is not".into();
            self.damage.push(Damage::BadChunk { at, reason });
            return false;
        }
        let before = self.out.len();
        let outcome = chunk::content(&header, at, self.limits).and_then(|content| {
            chunk::records(&content, |opcode, body, _| self.take_plain(opcode, body))
                .map_err(|reason| Damage::BadChunk { at, reason })
        });
        if let Err(damage) = outcome {
            self.out.truncate(before);
            self.damage.push(damage);
            return super::frames::has_chunk_shape(data, data.len());
        }
        // The same fields as of the header, and the name of the compression and the content.
        let fields = 8 + 8 + 8 + 4 + 4 + header.compression.len() + 8 + header.body.len();
        self.surplus = data.len() - fields;
        true
    }

    fn take_plain(&mut self, opcode: u8, data: &[u8]) -> Result<(), String> {
        match opcode {
            op::SCHEMA => self.schema(data),
            op::CHANNEL => self.channel(data),
            op::MESSAGE => self.message(data),
            _ => Ok(()),
        }
    }

    fn header(&mut self, data: &[u8]) -> Result<(), String> {
        let mut fields = Fields(data);
        let whole = fields.text().is_some() && fields.text().is_some();
        self.surplus = fields.0.len();
        if whole { Ok(()) } else { Err("the header is shorter than it says, or not text".into()) }
    }

    fn schema(&mut self, data: &[u8]) -> Result<(), String> {
        let mut fields = Fields(data);
        let id = fields.u16();
        let texts = (fields.text(), fields.text(), fields.block());
        let (Some(id), (Some(name), Some(encoding), Some(data))) = (id, texts) else {
            return Err("a schema record is shorter than it says, or not text".into());
        };
        let (name, encoding, data) = (name.into(), encoding.into(), data.into());
        self.schemas.insert(id, Arc::new(SchemaDef { name, encoding, data }));
        Ok(())
    }

    fn channel(&mut self, data: &[u8]) -> Result<(), String> {
        let mut fields = Fields(data);
        let (id, schema) = (fields.u16(), fields.u16());
        let texts = (fields.text(), fields.text(), fields.texts());
        let (Some(id), Some(schema), (Some(topic), Some(encoding), Some(metadata))) =
            (id, schema, texts)
        else {
            return Err("a channel record is shorter than it says, or not text".into());
        };
        if topic.len() > NAME_BYTES || encoding.len() > NAME_BYTES {
            return Err(format!("the name of channel {id} is too long"));
        }
        let schema = self.schemas.get(&schema).cloned();
        let (topic, encoding) = (topic.into(), encoding.into());
        self.introduce(ChannelDef { id, topic, encoding, schema, metadata });
        Ok(())
    }

    fn introduce(&mut self, channel: ChannelDef) {
        let (id, channel) = (channel.id, Arc::new(channel));
        if self.channels.get(&id) != Some(&channel) {
            self.channels.insert(id, channel.clone());
            self.out.push(Item::Channel(channel));
        }
    }

    fn message(&mut self, data: &[u8]) -> Result<(), String> {
        let Some((head, data)) = MessageHead::read(data) else {
            return Err("a message is shorter than its header".into());
        };
        let id = head.channel;
        let channel =
            self.channels.get(&id).cloned().ok_or_else(|| format!("channel {id} is unknown"))?;
        let message = LogMessage {
            channel: channel.topic.clone(),
            encoding: channel.encoding.clone(),
            sequence: head.sequence,
            log_time: Timestamp(head.log_time),
            publish_time: Timestamp(head.publish_time),
            data: Bytes::copy_from_slice(data),
        };
        self.out.push(Item::Message(channel, message));
        Ok(())
    }

    fn metadata(&mut self, data: &[u8]) -> Result<(), String> {
        let mut fields = Fields(data);
        let (Some(name), Some(texts)) = (fields.text(), fields.texts()) else {
            return Err("a metadata record is shorter than it says, or not text".into());
        };
        self.surplus = fields.0.len();
        if !marks::is_sound(name, &texts) {
            return Err(format!("the metadata record {name:?} is not what was written"));
        }
        match marks::channel_of(name, &texts) {
            // What a chunk said is checked by its CRC and stands.
            Some((id, ..)) if self.channels.contains_key(&id) => {}
            Some((id, topic, encoding)) => {
                let (topic, encoding) = (topic.into(), encoding.into());
                let metadata = BTreeMap::new();
                // Not introduced: only a message on it makes it one of the log's channels.
                let channel = ChannelDef { id, topic, encoding, schema: None, metadata };
                self.channels.insert(id, Arc::new(channel));
            }
            None if marks::is_of_the_file(name) => {}
            None => self.out.push(Item::Metadata(name.into(), texts)),
        }
        Ok(())
    }

    fn attachment(&mut self, data: &[u8]) -> Result<(), String> {
        let mut fields = Fields(data);
        let times = (fields.u64(), fields.u64());
        let texts = (fields.text(), fields.text());
        let (content, crc) = (fields.long_block(), fields.u32());
        let ((Some(log_time), Some(create_time)), (Some(name), Some(media_type))) = (times, texts)
        else {
            return Err("an attachment is shorter than it says, or its name not text".into());
        };
        let (Some(content), Some(crc)) = (content, crc) else {
            return Err("an attachment is shorter than it says".into());
        };
        if crc != 0 && crc32fast::hash(&data[..data.len() - fields.0.len() - 4]) != crc {
            return Err(format!("the attachment {name:?} is not what was written"));
        }
        self.surplus = fields.0.len();
        self.out.push(Item::Attachment {
            log_time: Timestamp(log_time),
            create_time: Timestamp(create_time),
            name: name.into(),
            media_type: media_type.into(),
            data: Bytes::copy_from_slice(content),
        });
        Ok(())
    }

    fn message_index(&mut self, data: &[u8]) -> Result<(), String> {
        let mut fields = Fields(data);
        let pairs = |fields: &mut Fields<'_>| fields.pairs(|f| Some((f.u64()?, f.u64()?)));
        if fields.u16().is_none() || pairs(&mut fields).is_none() {
            return Err("a message index is shorter than it says".into());
        }
        self.surplus = fields.0.len();
        Ok(())
    }
}
