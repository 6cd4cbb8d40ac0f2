//! A writer of MCAP files that knows the format from its specification alone, for every combination of
//! its features that makes a difference: 208 variants of six contents, and the same with records that
//! are longer than their fields, as a later version of the format may have them.

use std::collections::BTreeMap;

use mcap::records::op;

/// What a file has.
#[derive(Debug, Clone, Copy, Default)]
pub struct Features {
    pub chunks: bool,
    pub message_index: bool,
    pub statistics: bool,
    pub repeated_schemas: bool,
    pub repeated_channels: bool,
    pub attachment_index: bool,
    pub metadata_index: bool,
    pub chunk_index: bool,
    pub summary_offsets: bool,
    pub padding: bool,
}

/// What a file says.
#[derive(Debug, Clone, Default)]
pub struct Content {
    pub name: &'static str,
    pub schema: bool,
    pub messages: u32,
    pub attachment: bool,
    pub metadata: bool,
}

pub static CONTENTS: [Content; 6] = [
    Content { name: "NoData", schema: false, messages: 0, attachment: false, metadata: false },
    Content {
        name: "OneAttachment",
        schema: false,
        messages: 0,
        attachment: true,
        metadata: false,
    },
    Content { name: "OneMetadata", schema: false, messages: 0, attachment: false, metadata: true },
    Content { name: "OneMessage", schema: true, messages: 1, attachment: false, metadata: false },
    Content {
        name: "OneSchemalessMessage",
        schema: false,
        messages: 1,
        attachment: false,
        metadata: false,
    },
    Content { name: "TenMessages", schema: true, messages: 10, attachment: false, metadata: false },
];

/// The combinations that make a difference for a content, each with its name.
pub fn variants(content: &Content) -> Vec<(String, Features)> {
    let mut found = Vec::new();
    for bits in 0..1_u32 << 10 {
        let on = |bit: u32| bits >> bit & 1 == 1;
        let f = Features {
            chunks: on(0),
            message_index: on(1),
            statistics: on(2),
            repeated_schemas: on(3),
            repeated_channels: on(4),
            attachment_index: on(5),
            metadata_index: on(6),
            chunk_index: on(7),
            summary_offsets: on(8),
            padding: on(9),
        };
        let summary = f.statistics
            || f.repeated_schemas
            || f.repeated_channels
            || f.attachment_index
            || f.metadata_index
            || f.chunk_index;
        let of_messages = f.chunks || f.message_index || f.repeated_channels || f.chunk_index;
        let senseless = (f.attachment_index && !content.attachment)
            || (f.metadata_index && !content.metadata)
            || ((of_messages || f.repeated_schemas) && content.messages == 0)
            || (f.repeated_schemas && !content.schema)
            || ((f.message_index || f.chunk_index) && !f.chunks)
            || (f.summary_offsets && !summary);
        if senseless {
            continue;
        }
        let names = ["ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum", "pad"];
        let used = names.iter().enumerate().filter(|(bit, _)| on(*bit as u32));
        let suffix: String = used.map(|(_, name)| format!("-{name}")).collect();
        found.push((format!("{}{suffix}", content.name), f));
    }
    found
}

/// Time of a message (ns).
pub fn log_time(number: u32) -> u64 {
    1_000 + 10 * u64::from(number)
}

/// Content of a message.
pub fn data(number: u32) -> Vec<u8> {
    format!("{{\"n\":{number}}}").into_bytes()
}

struct Writer {
    bytes: Vec<u8>,
    padding: bool,
}

fn text(body: &mut Vec<u8>, text: &str) {
    body.extend((text.len() as u32).to_le_bytes());
    body.extend(text.as_bytes());
}

/// A body of numbers and texts, field by field.
macro_rules! body {
    ($($field:expr),* $(,)?) => {{
        let mut body = Vec::new();
        $(Field::from($field).put(&mut body);)*
        body
    }};
}

enum Field<'a> {
    Bytes(Vec<u8>),
    Text(&'a str),
}

impl Field<'_> {
    fn put(&self, body: &mut Vec<u8>) {
        match self {
            Field::Bytes(bytes) => body.extend(bytes),
            Field::Text(t) => text(body, t),
        }
    }
}

macro_rules! numbers {
    ($($kind:ty),*) => {$(
        impl From<$kind> for Field<'_> {
            fn from(number: $kind) -> Self {
                Field::Bytes(number.to_le_bytes().to_vec())
            }
        }
    )*};
}
numbers!(u8, u16, u32, u64);

impl<'a> From<&'a str> for Field<'a> {
    fn from(text: &'a str) -> Self {
        Field::Text(text)
    }
}

impl Writer {
    /// Writes a record; its place and its length.
    fn record(&mut self, opcode: u8, mut body: Vec<u8>) -> (u64, u64) {
        // What ends with its content, or is found from the end of the file, cannot be longer; and readers
        // in use let a chunk, too, end with its content.
        if self.padding && ![op::MESSAGE, op::FOOTER, op::CHUNK].contains(&opcode) {
            body.extend([0x01, 0xFF, 0xFF]);
        }
        let at = self.bytes.len() as u64;
        self.bytes.push(opcode);
        self.bytes.extend((body.len() as u64).to_le_bytes());
        self.bytes.extend(&body);
        (at, self.bytes.len() as u64 - at)
    }
}

fn schema() -> Vec<u8> {
    let data = "{\"type\":\"object\"}";
    body!(1_u16, "Example", "jsonschema", data)
}

fn channel(content: &Content) -> Vec<u8> {
    let mut map = Vec::new();
    text(&mut map, "foo");
    text(&mut map, "bar");
    let mut body = body!(1_u16, u16::from(content.schema), "example", "json");
    body.extend((map.len() as u32).to_le_bytes());
    body.extend(map);
    body
}

/// Schema, channel and messages; the place and the time of each message.
fn records(out: &mut Writer, content: &Content) -> Vec<(u64, u64)> {
    if content.messages > 0 {
        if content.schema {
            out.record(op::SCHEMA, schema());
        }
        out.record(op::CHANNEL, channel(content));
    }
    let message = |number: u32| {
        let time = log_time(number);
        let mut body = body!(1_u16, number, time, time + 1);
        body.extend(data(number));
        let (at, _) = out.record(op::MESSAGE, body);
        (time, at)
    };
    (0..content.messages).map(message).collect()
}

/// The file.
pub fn write(content: &Content, f: Features) -> Vec<u8> {
    let mut out = Writer { bytes: mcap::MAGIC.to_vec(), padding: f.padding };
    out.record(op::HEADER, body!("", "variants"));
    let (first, last) = match content.messages {
        0 => (0, 0),
        n => (log_time(0), log_time(n - 1)),
    };
    let mut chunk_index = None;
    if f.chunks {
        let mut inner = Writer { bytes: Vec::new(), padding: f.padding };
        let places = records(&mut inner, content);
        let inner = inner.bytes;
        let mut body = body!(first, last, inner.len() as u64, crc32fast::hash(&inner), "");
        body.extend((inner.len() as u64).to_le_bytes());
        body.extend(&inner);
        let (at, length) = out.record(op::CHUNK, body);
        let (mut map, mut index_length) = (Vec::new(), 0_u64);
        if f.message_index {
            let mut body = body!(1_u16, 16 * places.len() as u32);
            for (time, place) in places {
                body.extend(body!(time, place));
            }
            let (index_at, length) = out.record(op::MESSAGE_INDEX, body);
            (map, index_length) = (body!(1_u16, index_at), length);
        }
        let mut body = body!(first, last, at, length, map.len() as u32);
        body.extend(map);
        let size = inner.len() as u64;
        body.extend(body!(index_length, "", size, size));
        chunk_index = Some(body);
    } else {
        records(&mut out, content);
    }
    let mut attachment = None;
    if content.attachment {
        let mut body = body!(2_u64, 1_u64, "myFile", "application/octet-stream", 3_u64);
        body.extend([1, 2, 3]);
        let crc = crc32fast::hash(&body);
        body.extend(crc.to_le_bytes());
        let (at, length) = out.record(op::ATTACHMENT, body);
        let index = body!(at, length, 2_u64, 1_u64, 3_u64, "myFile", "application/octet-stream");
        attachment = Some(index);
    }
    let mut metadata = None;
    if content.metadata {
        let mut map = Vec::new();
        text(&mut map, "foo");
        text(&mut map, "bar");
        let mut body = body!("myMetadata", map.len() as u32);
        body.extend(map);
        let (at, length) = out.record(op::METADATA, body);
        metadata = Some(body!(at, length, "myMetadata"));
    }
    let data_crc = crc32fast::hash(&out.bytes);
    out.record(op::DATA_END, body!(data_crc));
    summary(&mut out, content, f, [chunk_index, attachment, metadata], (first, last));
    out.bytes
}

fn summary(
    out: &mut Writer,
    content: &Content,
    f: Features,
    [chunk_index, attachment, metadata]: [Option<Vec<u8>>; 3],
    (first, last): (u64, u64),
) {
    let begin = out.bytes.len() as u64;
    let chunks = u32::from(chunk_index.is_some());
    let statistics = || {
        let n = u64::from(content.messages);
        let channels = u32::from(content.messages > 0);
        let mut body = body!(n, u16::from(content.schema), channels);
        let counts = [u32::from(content.attachment), u32::from(content.metadata), chunks];
        counts.iter().for_each(|count| body.extend(count.to_le_bytes()));
        body.extend(body!(first, last, 10 * channels));
        if channels > 0 {
            body.extend(body!(1_u16, n));
        }
        body
    };
    let groups = [
        (op::SCHEMA, f.repeated_schemas.then(schema)),
        (op::CHANNEL, f.repeated_channels.then(|| channel(content))),
        (op::STATISTICS, f.statistics.then(statistics)),
        (op::CHUNK_INDEX, chunk_index.filter(|_| f.chunk_index)),
        (op::ATTACHMENT_INDEX, attachment.filter(|_| f.attachment_index)),
        (op::METADATA_INDEX, metadata.filter(|_| f.metadata_index)),
    ];
    let mut offsets = BTreeMap::new();
    for (kind, body) in groups {
        if let Some(body) = body {
            offsets.insert(kind, out.record(kind, body));
        }
    }
    let offsets_begin = out.bytes.len() as u64;
    if f.summary_offsets {
        for (kind, (at, length)) in &offsets {
            out.record(op::SUMMARY_OFFSET, body!(*kind, *at, *length));
        }
    }
    let begin = if offsets.is_empty() { 0 } else { begin };
    let offsets_begin = if f.summary_offsets { offsets_begin } else { 0 };
    let from = if begin == 0 { out.bytes.len() } else { begin as usize };
    let mut footer = vec![op::FOOTER];
    footer.extend(body!(20_u64, begin, offsets_begin));
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&out.bytes[from..]);
    hasher.update(&footer);
    footer.extend(hasher.finalize().to_le_bytes());
    out.bytes.extend(footer);
    out.bytes.extend(mcap::MAGIC);
}
