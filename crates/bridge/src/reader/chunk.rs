//! The content of a chunk: decompressed within limits, and checked before anything is taken of it.

use std::borrow::Cow;
use std::io::Read;

use super::fields::{ChunkHeader, Fields};
use super::{Damage, Limits};

/// Chunks up to this size may be compressed as well as they can be (bytes): four of the recorder's,
/// for frames of a rover that stands still are all alike.
const RATIO_FREE_BYTES: u64 = 4 << 20;
/// Largest window of a zstd stream: 2 to this power (bytes).
const ZSTD_WINDOW_LOG: u32 = 26;

/// The records of a chunk as one piece.
pub fn content<'a>(
    header: &ChunkHeader<'a>,
    at: u64,
    limits: Limits,
) -> Result<Cow<'a, [u8]>, Damage> {
    let length = header.uncompressed_size;
    if length > limits.record_bytes as u64 {
        return Err(Damage::ChunkTooLarge { at, length });
    }
    let ratio = length / (header.body.len() as u64).max(1);
    if length > RATIO_FREE_BYTES && ratio > limits.ratio {
        return Err(Damage::ChunkRatio { at, ratio });
    }
    let bad = |reason: String| Damage::BadChunk { at, reason };
    let content = match header.compression {
        "" => Cow::Borrowed(header.body),
        "zstd" => {
            let decoder =
                zstd::stream::read::Decoder::with_buffer(header.body).and_then(|mut d| {
                    d.window_log_max(ZSTD_WINDOW_LOG)?;
                    Ok(d)
                });
            Cow::Owned(decoder.and_then(|d| expand(d, length)).map_err(|e| bad(e.to_string()))?)
        }
        "lz4" => {
            let decoder = lz4::Decoder::new(header.body);
            Cow::Owned(decoder.and_then(|d| expand(d, length)).map_err(|e| bad(e.to_string()))?)
        }
        other => return Err(bad(format!("the compression {other:?} is unknown"))),
    };
    if content.len() as u64 != length {
        return Err(bad(format!("it holds another number of bytes than the {length} it says")));
    }
    if header.uncompressed_crc != 0 && crc32fast::hash(&content) != header.uncompressed_crc {
        return Err(bad("chunk CRC failed".into()));
    }
    Ok(content)
}

/// At most one byte more than expected is taken, so that more is noticed.
fn expand(decoder: impl Read, expected: u64) -> std::io::Result<Vec<u8>> {
    let mut content = Vec::new();
    decoder.take(expected + 1).read_to_end(&mut content)?;
    Ok(content)
}

/// Goes over the records of a chunk's content: opcode, body, offset within the content.
pub fn records<'a>(
    content: &'a [u8],
    mut take: impl FnMut(u8, &'a [u8], u64) -> Result<(), String>,
) -> Result<(), String> {
    let mut rest = content;
    while !rest.is_empty() {
        let at = (content.len() - rest.len()) as u64;
        let mut fields = Fields(rest);
        let opcode = fields.u8().ok_or("it ends within a record")?;
        let frame = fields.u64().ok_or("it ends within a record")?;
        let length = usize::try_from(frame).map_err(|_| "a record runs over its end")?;
        let body = fields.bytes(length).ok_or("a record runs over its end")?;
        if opcode == 0 {
            // No record is of this kind, and zeros would be millions of them.
            return Err("a record of kind 0 stands in it".into());
        }
        take(opcode, body, at)?;
        rest = fields.0;
    }
    Ok(())
}
