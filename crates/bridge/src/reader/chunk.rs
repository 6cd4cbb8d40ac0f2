//! Records, and chunks of records, into messages.

use std::collections::HashMap;
use std::sync::Arc;

use bytes::Bytes;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use wire::time::Timestamp;

use super::{Damage, Limits, LogMessage};

/// Chunks up to this size may be compressed as well as they can be (bytes): four of the recorder's,
/// for frames of a rover that stands still are all alike.
const RATIO_FREE_BYTES: u64 = 4 << 20;
/// Longest name of a channel that is kept (bytes).
const NAME_BYTES: usize = 256;

/// The state of a reading: channels met so far, messages not handed out yet, damage.
pub struct Records {
    limits: Limits,
    channels: HashMap<u16, (Arc<str>, Arc<str>)>,
    pub messages: Vec<LogMessage>,
    pub damage: Vec<Damage>,
}

impl Records {
    pub fn new(limits: Limits) -> Records {
        Records { limits, channels: HashMap::new(), messages: Vec::new(), damage: Vec::new() }
    }

    /// Takes a record of the file's data section; true if nothing after it can be trusted.
    pub fn take(&mut self, opcode: u8, data: &[u8], at: u64) -> bool {
        let outcome = match opcode {
            op::CHUNK => return self.take_chunk(data, at),
            _ => self.take_plain(opcode, data),
        };
        if let Err(reason) = outcome {
            self.damage.push(Damage::BadRecord { at, reason });
        }
        false
    }

    fn take_chunk(&mut self, data: &[u8], at: u64) -> bool {
        let Some(header) = ChunkHeader::read(data) else {
            let reason = "it is shorter than it says".into();
            self.damage.push(Damage::BadChunk { at, reason });
            return false;
        };
        let length = header.uncompressed_size;
        if length > self.limits.record_bytes as u64 {
            self.damage.push(Damage::ChunkTooLarge { at, length });
            return true;
        }
        let ratio = length / (header.body.len() as u64).max(1);
        if length > RATIO_FREE_BYTES && ratio > self.limits.ratio {
            self.damage.push(Damage::ChunkRatio { at, ratio });
            return true;
        }
        let before = self.messages.len();
        if let Err(reason) = self.read_chunk(&header, data) {
            self.messages.truncate(before);
            self.damage.push(Damage::BadChunk { at, reason });
        }
        false
    }

    /// The records within a chunk. Uncompressed ones are walked here, compressed ones by the
    /// crate's reader, which is given the chunk without any padding and decompresses at most what
    /// the header says.
    fn read_chunk(&mut self, header: &ChunkHeader<'_>, data: &[u8]) -> Result<(), String> {
        let body = header.body;
        if header.compression.is_empty() {
            return self.read_plain_chunk(header, body);
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(self.limits.record_bytes);
        let mut reader = LinearReader::new_with_options(options);
        let whole = &data[..data.len() - header.padding];
        let frame = [&[op::CHUNK][..], &(whole.len() as u64).to_le_bytes()].concat();
        let mut rest = [&frame[..], whole].into_iter().flat_map(|part| part.chunks(64 * 1024));
        let mut part: &[u8] = &[];
        while let Some(event) = reader.next_event() {
            match event.map_err(|e| e.to_string())? {
                LinearReadEvent::ReadRequest(wanted) => {
                    if part.is_empty() {
                        part = rest.next().unwrap_or_default();
                    }
                    let given = wanted.min(part.len());
                    reader.insert(given)[..given].copy_from_slice(&part[..given]);
                    part = &part[given..];
                    reader.notify_read(given);
                }
                LinearReadEvent::Record { opcode, data } => self.take_plain(opcode, data)?,
            }
        }
        Ok(())
    }

    fn read_plain_chunk(&mut self, header: &ChunkHeader<'_>, body: &[u8]) -> Result<(), String> {
        if header.uncompressed_crc != 0 && crc32(body) != header.uncompressed_crc {
            return Err("chunk CRC failed".into());
        }
        let mut rest = body;
        while let Some((frame, after)) = rest.split_first_chunk::<9>() {
            let mut length = Fields(&frame[1..]);
            let length = length.u64().and_then(|n| usize::try_from(n).ok());
            let parts = length.and_then(|length| after.split_at_checked(length));
            let (data, tail) = parts.ok_or("a record runs over its end")?;
            self.take_plain(frame[0], data)?;
            rest = tail;
        }
        if rest.is_empty() { Ok(()) } else { Err("it ends within a record".into()) }
    }

    fn take_plain(&mut self, opcode: u8, data: &[u8]) -> Result<(), String> {
        if !matches!(opcode, op::CHANNEL | op::MESSAGE) {
            return Ok(());
        }
        let mut fields = Fields(data);
        if opcode == op::CHANNEL {
            let (id, _schema) = (fields.u16(), fields.u16());
            let (topic, encoding) = (fields.text(), fields.text());
            let (Some(id), Some(topic), Some(encoding)) = (id, topic, encoding) else {
                return Err("a channel record is shorter than it says, or not text".into());
            };
            if topic.len() > NAME_BYTES || encoding.len() > NAME_BYTES {
                return Err(format!("the name of channel {id} is too long"));
            }
            self.channels.insert(id, (topic.into(), encoding.into()));
            return Ok(());
        }
        let (id, sequence) = (fields.u16(), fields.u32());
        let (log_time, publish_time) = (fields.u64(), fields.u64());
        let (Some(id), Some(sequence), Some(log_time), Some(publish_time)) =
            (id, sequence, log_time, publish_time)
        else {
            return Err("a message is shorter than its header".into());
        };
        let (channel, encoding) =
            self.channels.get(&id).cloned().ok_or_else(|| format!("channel {id} is unknown"))?;
        self.messages.push(LogMessage {
            channel,
            encoding,
            sequence,
            log_time: Timestamp(log_time),
            publish_time: Timestamp(publish_time),
            data: Bytes::copy_from_slice(fields.0),
        });
        Ok(())
    }
}

/// The header of a chunk, checked against the length of its record.
struct ChunkHeader<'a> {
    uncompressed_size: u64,
    uncompressed_crc: u32,
    compression: &'a str,
    body: &'a [u8],
    /// Bytes of the record after the body.
    padding: usize,
}

impl<'a> ChunkHeader<'a> {
    fn read(data: &'a [u8]) -> Option<ChunkHeader<'a>> {
        let mut fields = Fields(data);
        let (_start, _end) = (fields.u64()?, fields.u64()?);
        let (uncompressed_size, uncompressed_crc) = (fields.u64()?, fields.u32()?);
        let compression = fields.text()?;
        let length = usize::try_from(fields.u64()?).ok()?;
        let body = fields.bytes(length)?;
        let padding = fields.0.len();
        Some(ChunkHeader { uncompressed_size, uncompressed_crc, compression, body, padding })
    }
}

/// Takes the fields of a record one by one. The crate's own parser reserves what a length field
/// says before it looks whether there is as much.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.u32()?).ok()?;
        std::str::from_utf8(self.bytes(length)?).ok()
    }
}

/// CRC-32 as in zlib, the format's checksum.
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0_u32; 256];
        let mut i = 0;
        while i < 256 {
            let (mut value, mut bit) = (i as u32, 0);
            while bit < 8 {
                value = if value & 1 == 1 { 0xEDB8_8320 ^ (value >> 1) } else { value >> 1 };
                bit += 1;
            }
            table[i] = value;
            i += 1;
        }
        table
    };
    !bytes
        .iter()
        .fold(!0_u32, |crc, &byte| TABLE[((crc ^ u32::from(byte)) & 0xFF) as usize] ^ (crc >> 8))
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_checksum_is_the_one_of_the_format() {
        // The check value of CRC-32/ISO-HDLC.
        assert_eq!(super::crc32(b"123456789"), 0xCBF4_3926);
    }
}
