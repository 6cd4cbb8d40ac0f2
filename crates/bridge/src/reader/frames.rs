//! From bytes to records: framing, and finding the way back after damage to it.

use std::io::{self, Read};

use mcap::records::op;

use super::fields::{ChunkHeader, Fields};

/// Read at a time (bytes).
const STEP: usize = 256 * 1024;
/// Most bytes that a writer adds to a record: more are taken for damage.
const PADDING_BYTES: usize = 4096;
/// The fields of a chunk before its content, without the name of the compression.
const CHUNK_FIELDS: usize = 8 + 8 + 8 + 4 + 4 + 8;

/// A window on a stream of bytes that grows only with what really comes.
pub struct Window<R> {
    source: R,
    bytes: Vec<u8>,
    /// Where the window begins in `bytes`, and in the file.
    start: usize,
    at: u64,
    ended: bool,
    /// Checksum of all that was passed.
    crc: crc32fast::Hasher,
}

impl<R: Read> Window<R> {
    pub fn new(source: R) -> Window<R> {
        let crc = crc32fast::Hasher::new();
        Window { source, bytes: Vec::new(), start: 0, at: 0, ended: false, crc }
    }

    /// True once `wanted` bytes are in the window; false if the source has no more.
    pub fn fill(&mut self, wanted: usize) -> io::Result<bool> {
        while self.rest().len() < wanted && !self.ended {
            if self.start > STEP {
                self.bytes.drain(..self.start);
                self.start = 0;
            }
            let before = self.bytes.len();
            self.bytes.resize(before + STEP, 0);
            let read = loop {
                match self.source.read(&mut self.bytes[before..]) {
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    other => break other,
                }
            };
            self.bytes.truncate(before + *read.as_ref().unwrap_or(&0));
            self.ended = read? == 0;
        }
        Ok(self.rest().len() >= wanted)
    }

    /// What is in the window.
    pub fn rest(&self) -> &[u8] {
        &self.bytes[self.start..]
    }

    /// Offset of the window in the file.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// Checksum of all bytes before the window.
    pub fn crc(&self) -> u32 {
        self.crc.clone().finalize()
    }

    /// Begins the checksum anew.
    pub fn reset_crc(&mut self) {
        self.crc = crc32fast::Hasher::new();
    }

    /// Goes on by `n` bytes that are in the window.
    pub fn pass(&mut self, n: usize) {
        let n = n.min(self.rest().len());
        self.crc.update(&self.bytes[self.start..self.start + n]);
        self.start += n;
        self.at += n as u64;
    }

    /// Opcode and length of the record at the window, which holds its first nine bytes.
    pub fn frame(&self) -> Option<(u8, u64)> {
        let mut fields = Fields(self.rest());
        Some((fields.u8()?, fields.u64()?))
    }

    /// Are the last `surplus` bytes of a record that is `size` bytes long, frame and all, added to it, as
    /// writers of later versions of the format may? They are not if its length grew by damage: then they
    /// begin with the frame of the record that really follows, or no frame stands behind them.
    pub fn is_padding(&mut self, size: usize, surplus: usize, limit: usize) -> io::Result<bool> {
        self.fill(size + 9)?;
        let begins = |at: usize| {
            let mut fields = Fields(self.rest().get(at..).unwrap_or_default());
            let (opcode, length) = (fields.u8().unwrap_or(0), fields.u64().unwrap_or(u64::MAX));
            (op::HEADER..=op::DATA_END).contains(&opcode) && length <= limit as u64
        };
        Ok(surplus <= PADDING_BYTES && begins(size) && !begins(size - surplus))
    }

    /// Goes on, from the byte after the present one, to a place where a whole, sound chunk stands.
    /// False, at the end of the source, if there is none.
    pub fn find_chunk(
        &mut self,
        limit: usize,
        sound: impl Fn(&ChunkHeader<'_>) -> bool,
    ) -> io::Result<bool> {
        self.pass(1);
        while self.fill(9 + CHUNK_FIELDS)? {
            let Some(ahead) = self.rest().iter().position(|&byte| byte == op::CHUNK) else {
                self.pass(self.rest().len());
                continue;
            };
            self.pass(ahead);
            if self.chunk_here(limit, &sound)? {
                return Ok(true);
            }
            self.pass(1);
        }
        Ok(false)
    }

    fn chunk_here(
        &mut self,
        limit: usize,
        sound: impl Fn(&ChunkHeader<'_>) -> bool,
    ) -> io::Result<bool> {
        if !self.fill(9 + CHUNK_FIELDS)? {
            return Ok(false);
        }
        let Some((_, length)) = self.frame() else { return Ok(false) };
        let Some(length) = usize::try_from(length).ok().filter(|&n| n <= limit) else {
            return Ok(false);
        };
        if !has_chunk_shape(&self.rest()[9..], length) || !self.fill(9 + length)? {
            return Ok(false);
        }
        Ok(ChunkHeader::read(&self.rest()[9..9 + length]).is_some_and(|header| sound(&header)))
    }
}

/// Do the first bytes of a record of `length` bytes agree with a chunk without padding?
pub fn has_chunk_shape(body: &[u8], length: usize) -> bool {
    let mut fields = Fields(body);
    let known = |name: &[u8]| matches!(name, b"" | b"lz4" | b"zstd");
    let content = (|| {
        fields.bytes(28)?;
        let compression = fields.block().filter(|name| known(name))?;
        Some(fields.u64()?.checked_add((CHUNK_FIELDS + compression.len()) as u64))
    })();
    content.flatten() == Some(length as u64)
}
