//! The fields of records, taken one by one and never beyond what is there.
//!
//! The crate's own parser reserves what a length field says before it looks whether there is as
//! much; this one reserves nothing. Layouts: MCAP specification, section "Records".

use std::collections::BTreeMap;

/// What is left of a record's body.
pub struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn bytes(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes behind a length of 32 bits.
    pub fn block(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.u32()?).ok()?;
        self.bytes(length)
    }

    /// Bytes behind a length of 64 bits.
    pub fn long_block(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.u64()?).ok()?;
        self.bytes(length)
    }

    pub fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.block()?).ok()
    }

    /// A map of texts.
    pub fn texts(&mut self) -> Option<BTreeMap<String, String>> {
        let mut inner = Fields(self.block()?);
        let mut map = BTreeMap::new();
        while !inner.0.is_empty() {
            map.insert(inner.text()?.into(), inner.text()?.into());
        }
        Some(map)
    }

    /// A list of pairs behind its length in bytes.
    pub fn pairs<T>(
        &mut self,
        mut pair: impl FnMut(&mut Fields<'a>) -> Option<T>,
    ) -> Option<Vec<T>> {
        let mut inner = Fields(self.block()?);
        let mut list = Vec::new();
        while !inner.0.is_empty() {
            list.push(pair(&mut inner)?);
        }
        Some(list)
    }
}

/// The header of a chunk, and its content.
#[derive(Debug, Clone, Copy)]
pub struct ChunkHeader<'a> {
    pub start: u64,
    pub end: u64,
    pub uncompressed_size: u64,
    pub uncompressed_crc: u32,
    pub compression: &'a str,
    pub body: &'a [u8],
}

impl<'a> ChunkHeader<'a> {
    pub fn read(data: &'a [u8]) -> Option<ChunkHeader<'a>> {
        let mut fields = Fields(data);
        let (start, end) = (fields.u64()?, fields.u64()?);
        let (uncompressed_size, uncompressed_crc) = (fields.u64()?, fields.u32()?);
        let (compression, body) = (fields.text()?, fields.long_block()?);
        Some(ChunkHeader { start, end, uncompressed_size, uncompressed_crc, compression, body })
    }
}

/// The head of a message; its content follows.
#[derive(Debug, Clone, Copy)]
pub struct MessageHead {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
}

impl MessageHead {
    pub fn read(data: &[u8]) -> Option<(MessageHead, &[u8])> {
        let mut fields = Fields(data);
        let (channel, sequence) = (fields.u16()?, fields.u32()?);
        let (log_time, publish_time) = (fields.u64()?, fields.u64()?);
        Some((MessageHead { channel, sequence, log_time, publish_time }, fields.0))
    }
}

/// Where one chunk of a file is, and what is in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChunkIndex {
    pub start: u64,
    pub end: u64,
    pub offset: u64,
    pub length: u64,
    /// Where the message index of each channel is.
    pub indexes: BTreeMap<u16, u64>,
    pub index_length: u64,
    pub compression: String,
    pub compressed_size: u64,
    pub uncompressed_size: u64,
}

impl ChunkIndex {
    pub fn read(data: &[u8]) -> Option<ChunkIndex> {
        let mut fields = Fields(data);
        let (start, end) = (fields.u64()?, fields.u64()?);
        let (offset, length) = (fields.u64()?, fields.u64()?);
        let indexes = fields.pairs(|f| Some((f.u16()?, f.u64()?)))?.into_iter().collect();
        let index_length = fields.u64()?;
        let compression = fields.text()?.into();
        let (compressed_size, uncompressed_size) = (fields.u64()?, fields.u64()?);
        Some(ChunkIndex {
            start,
            end,
            offset,
            length,
            indexes,
            index_length,
            compression,
            compressed_size,
            uncompressed_size,
        })
    }
}

/// Counts over a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Statistics {
    pub messages: u64,
    pub schemas: u16,
    pub channels: u32,
    pub attachments: u32,
    pub metadata: u32,
    pub chunks: u32,
    pub start: u64,
    pub end: u64,
    pub by_channel: BTreeMap<u16, u64>,
}

impl Statistics {
    pub fn read(data: &[u8]) -> Option<Statistics> {
        let mut f = Fields(data);
        Some(Statistics {
            messages: f.u64()?,
            schemas: f.u16()?,
            channels: f.u32()?,
            attachments: f.u32()?,
            metadata: f.u32()?,
            chunks: f.u32()?,
            start: f.u64()?,
            end: f.u64()?,
            by_channel: f.pairs(|f| Some((f.u16()?, f.u64()?)))?.into_iter().collect(),
        })
    }
}
