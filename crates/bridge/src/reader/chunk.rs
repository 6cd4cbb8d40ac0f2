//! Records, and chunks of records, into messages.

use std::collections::HashMap;
use std::sync::Arc;

use bytes::Bytes;
use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use wire::time::Timestamp;

use super::{Damage, Limits, LogMessage};

/// Chunks up to this size may be compressed as well as they can be (bytes).
const RATIO_FREE_BYTES: u64 = 1 << 20;
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
        let header = match mcap::parse_record(op::CHUNK, data) {
            Ok(Record::Chunk { header, .. }) => header,
            Ok(_) => return false,
            Err(error) => {
                self.damage.push(Damage::BadChunk { at, reason: error.to_string() });
                return false;
            }
        };
        let length = header.uncompressed_size;
        if length > self.limits.record_bytes as u64 {
            self.damage.push(Damage::ChunkTooLarge { at, length });
            return true;
        }
        let ratio = length / header.compressed_size.max(1);
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
    fn read_chunk(&mut self, header: &ChunkHeader, data: &[u8]) -> Result<(), String> {
        let start = 40 + header.compression.len();
        let length = usize::try_from(header.compressed_size).map_err(|e| e.to_string())?;
        let end = start.checked_add(length).filter(|&end| end <= data.len());
        let body = &data[start..end.ok_or("it is shorter than it says")?];
        if header.compression.is_empty() {
            return self.read_plain_chunk(header, body);
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(self.limits.record_bytes);
        let mut reader = LinearReader::new_with_options(options);
        let whole = &data[..start + length];
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

    fn read_plain_chunk(&mut self, header: &ChunkHeader, body: &[u8]) -> Result<(), String> {
        if header.uncompressed_crc != 0 && crc32(body) != header.uncompressed_crc {
            return Err("chunk CRC failed".into());
        }
        let mut rest = body;
        while let Some((frame, after)) = rest.split_first_chunk::<9>() {
            let (opcode, length) = (frame[0], &frame[1..]);
            let length = length.iter().rev().fold(0_u64, |sum, &byte| sum << 8 | u64::from(byte));
            let length = usize::try_from(length).ok().filter(|&n| n <= after.len());
            let (data, tail) = after.split_at(length.ok_or("a record runs over its end")?);
            self.take_plain(opcode, data)?;
            rest = tail;
        }
        if rest.is_empty() { Ok(()) } else { Err("it ends within a record".into()) }
    }

    fn take_plain(&mut self, opcode: u8, data: &[u8]) -> Result<(), String> {
        if !matches!(opcode, op::CHANNEL | op::MESSAGE) {
            return Ok(());
        }
        match mcap::parse_record(opcode, data).map_err(|e| e.to_string())? {
            Record::Channel(channel) => {
                if channel.topic.len() > NAME_BYTES || channel.message_encoding.len() > NAME_BYTES {
                    return Err(format!("the name of channel {} is too long", channel.id));
                }
                let names = (channel.topic.into(), channel.message_encoding.into());
                self.channels.insert(channel.id, names);
            }
            Record::Message { header, data } => {
                let known = self.channels.get(&header.channel_id).cloned();
                let (channel, encoding) =
                    known.ok_or_else(|| format!("channel {} is unknown", header.channel_id))?;
                self.messages.push(LogMessage {
                    channel,
                    encoding,
                    sequence: header.sequence,
                    log_time: Timestamp(header.log_time),
                    publish_time: Timestamp(header.publish_time),
                    data: Bytes::copy_from_slice(&data),
                });
            }
            _ => {}
        }
        Ok(())
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
