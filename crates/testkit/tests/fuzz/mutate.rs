//! Damage to good files that knows how they are built.

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

/// How a file is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Text,
    Binary,
    Tiff,
    Png,
}

/// A good file.
pub struct Seed {
    pub what: String,
    pub kind: Kind,
    pub bytes: Vec<u8>,
}

impl Seed {
    pub fn new(what: &str, kind: Kind, bytes: impl Into<Vec<u8>>) -> Seed {
        Seed { what: what.to_owned(), kind, bytes: bytes.into() }
    }
}

/// Largest damaged file (bytes).
const BYTES_MAX: usize = 1 << 20;

/// Numbers at the ends of what formats can hold, and just beyond.
const NUMBERS: [u64; 24] = [
    0,
    1,
    2,
    3,
    4,
    7,
    8,
    16,
    127,
    128,
    255,
    256,
    32_767,
    32_768,
    65_535,
    65_536,
    1 << 24,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFE,
    0xFFFF_FFFF,
    1 << 40,
    i64::MAX as u64,
    u64::MAX,
];

/// What may stand where a text has a number.
const WORDS: [&str; 22] = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-320",
    "1e999",
    "-0",
    "0",
    "-1",
    "1",
    "2",
    "65536",
    "2147483648",
    "4294967296",
    "18446744073709551615",
    "18446744073709551616",
    "99999999999999999999999999",
    "1e30",
    "0x10",
    "16#FF7FFFFB#",
    "é",
];

/// What may stand anywhere in a text.
const PIECES: [&str; 34] = [
    "\n",
    "\r\n",
    " ",
    "\t",
    "\"",
    "'",
    "#",
    "<",
    ">",
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    ":",
    ",",
    "=",
    "/",
    "//",
    "/*",
    "*/",
    "-",
    "\0",
    "END",
    "OBJECT = A\n",
    "END_OBJECT\n",
    "list",
    "nan",
    "f 1 1 1\n",
    "v 1 2 3\n",
    "3 0 0 0\n",
    "---\n",
    "!!x ",
];

/// Seed `i`, damaged in one to four places.
pub fn mutated(rng: &mut ChaCha8Rng, seeds: &[Seed], i: usize) -> Vec<u8> {
    let seed = &seeds[i];
    let mut bytes = seed.bytes.clone();
    for _ in 0..rng.random_range(1..5) {
        if bytes.is_empty() {
            break;
        }
        match seed.kind {
            Kind::Text if rng.random_range(0..8) > 0 => text(rng, &mut bytes),
            Kind::Tiff if rng.random_range(0..3) > 0 => tiff(rng, &mut bytes),
            Kind::Png if rng.random_range(0..3) > 0 => png(rng, &mut bytes),
            _ => {
                let other = rng.random_range(0..seeds.len());
                binary(rng, &mut bytes, &seeds[other].bytes);
            }
        }
        bytes.truncate(BYTES_MAX);
    }
    // Without this hardly any damage would come past the sums.
    if seed.kind == Kind::Png && rng.random_range(0..8) > 0 {
        mend_sums(&mut bytes);
    }
    bytes
}

fn number(rng: &mut ChaCha8Rng) -> u64 {
    let near = rng.random_range(0..3_u64);
    match rng.random_range(0..4) {
        0 => rng.next_u64() >> rng.random_range(0..64),
        1 => NUMBERS[rng.random_range(0..NUMBERS.len())].wrapping_sub(near),
        _ => NUMBERS[rng.random_range(0..NUMBERS.len())].wrapping_add(near),
    }
}

/// Writes the lowest `size` bytes of a number as far as the file goes.
fn put(bytes: &mut [u8], at: usize, size: usize, value: u64, is_big: bool) {
    for k in 0..size {
        if let Some(byte) = bytes.get_mut(at + k) {
            let shift = 8 * if is_big { size - 1 - k } else { k };
            *byte = (value >> shift) as u8;
        }
    }
}

/// Damage to any file; `other` is one to take a part of.
fn binary(rng: &mut ChaCha8Rng, bytes: &mut Vec<u8>, other: &[u8]) {
    let at = rng.random_range(0..bytes.len());
    let to = (at + rng.random_range(1..64)).min(bytes.len());
    match rng.random_range(0..8) {
        0 => bytes[at] ^= 1 << rng.random_range(0..8),
        1 => bytes[at] = rng.next_u32() as u8,
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(at..to)),
        4 => {
            let part = bytes[at..to].to_vec();
            bytes.splice(at..at, part);
        }
        5 if !other.is_empty() => {
            let from = rng.random_range(0..other.len());
            let part = other[from..].iter().take(rng.random_range(1..512)).copied();
            bytes.splice(at..to, part.collect::<Vec<_>>());
        }
        6 => {
            let special = [f64::NAN, f64::INFINITY, -1e308, 1e-310, 0.0, 1e30];
            let value = special[rng.random_range(0..special.len())];
            let is_big = rng.random();
            if rng.random() {
                put(bytes, at, 8, value.to_bits(), is_big);
            } else {
                put(bytes, at, 4, u64::from((value as f32).to_bits()), is_big);
            }
        }
        _ => {
            let size = 1 << rng.random_range(0..4);
            let (value, is_big) = (number(rng), rng.random());
            put(bytes, at, size, value, is_big);
        }
    }
}

/// Damage to a text: its numbers, lines and signs.
fn text(rng: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    let at = rng.random_range(0..bytes.len());
    let line = |bytes: &[u8], at: usize| {
        let start = bytes[..at].iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
        let end = bytes[at..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |i| at + i + 1);
        start..end
    };
    match rng.random_range(0..8) {
        0..4 => {
            let is_number = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
            let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit) else { return };
            let start = at + start;
            let end = bytes[start..].iter().position(|b| !is_number(b));
            let end = end.map_or(bytes.len(), |n| start + n);
            let word = match rng.random_range(0..3) {
                0 => number(rng).to_string(),
                _ => WORDS[rng.random_range(0..WORDS.len())].to_owned(),
            };
            bytes.splice(start..end, word.into_bytes());
        }
        4 => drop(bytes.drain(line(bytes, at))),
        5 => {
            let range = line(bytes, at);
            let copies = bytes[range.clone()].repeat(1 << rng.random_range(0..10_u32));
            bytes.splice(range.start..range.start, copies.into_iter().take(100_000));
        }
        6 => {
            let other = rng.random_range(0..bytes.len());
            let part = bytes[line(bytes, other)].to_vec();
            bytes.splice(line(bytes, at), part);
        }
        _ => {
            let piece = PIECES[rng.random_range(0..PIECES.len())];
            let to = (at + rng.random_range(0..4)).min(bytes.len());
            bytes.splice(at..to, piece.bytes());
        }
    }
}

/// Damage to an entry of a TIFF's first directory: its tag, type, count or value.
fn tiff(rng: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    let is_big = bytes.starts_with(b"MM");
    let get = |bytes: &[u8], at: usize, size: usize| {
        let byte = |k: usize| u64::from(bytes.get(at.saturating_add(k)).copied().unwrap_or(0));
        let shift = |k: usize| 8 * if is_big { size - 1 - k } else { k };
        (0..size).fold(0, |sum, k| sum | byte(k) << shift(k))
    };
    let is_long = get(bytes, 2, 2) == 43;
    let (directory, n_size, size) =
        if is_long { (get(bytes, 8, 8), 8, 20) } else { (get(bytes, 4, 4), 2, 12) };
    let Ok(directory) = usize::try_from(directory) else { return };
    if directory >= bytes.len() {
        return binary(rng, bytes, &[]);
    }
    let n = get(bytes, directory, n_size).min(64) as usize;
    let entry = directory + n_size + size * rng.random_range(0..n.max(1));
    let wide = if is_long { 8 } else { 4 };
    let value = number(rng);
    match rng.random_range(0..8) {
        0 => {
            let tags = [
                256, 257, 258, 259, 262, 273, 277, 278, 279, 284, 317, 322, 323, 324, 325, 339,
                33550, 33922, 34735,
            ];
            put(bytes, entry, 2, tags[rng.random_range(0..tags.len())], is_big);
        }
        1 => put(bytes, entry + 2, 2, rng.random_range(0..20), is_big),
        2 => put(bytes, entry + 4, wide, value, is_big),
        // Short values stand at the start of the field.
        3 | 4 => put(bytes, entry + 4 + wide, 2, value, is_big),
        5 => put(bytes, entry + 4 + wide, wide, value, is_big),
        6 => {
            // What the entry points to.
            let at = get(bytes, entry + 4 + wide, wide).min(bytes.len() as u64) as usize;
            let size = [2, 4, 8][rng.random_range(0..3)];
            put(bytes, at.saturating_add(size * rng.random_range(0..8)), size, value, is_big);
        }
        _ => put(bytes, directory, n_size, value & 0xFF, is_big),
    }
}

/// Places of a PNG's chunks: their start and the length of their data.
fn chunks(bytes: &[u8]) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut at = 8;
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        if at + 12 + length > bytes.len() {
            break;
        }
        found.push((at, length));
        at += 12 + length;
    }
    found
}

/// Damage to one chunk of a PNG: its length, kind, data, or how often it stands there.
fn png(rng: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    let chunks = chunks(bytes);
    let Some(&(at, length)) = chunks.get(rng.random_range(0..chunks.len().max(1))) else { return };
    match rng.random_range(0..8) {
        0 => put(bytes, at, 4, number(rng), true),
        1 => {
            let kinds = [
                b"IHDR", b"IDAT", b"IEND", b"PLTE", b"tRNS", b"zTXt", b"iCCP", b"acTL", b"fcTL",
                b"fdAT",
            ];
            let kind = kinds[rng.random_range(0..kinds.len())];
            bytes[at + 4..at + 8].copy_from_slice(kind);
        }
        2 => {
            let part = bytes[at..at + 12 + length].to_vec();
            bytes.splice(at..at, part);
        }
        3 => drop(bytes.drain(at..at + 12 + length)),
        // The header: width, height, depth, color, method, filter, interlace.
        4 | 5 => match rng.random_range(0..7) {
            field @ 0..2 => put(bytes, 16 + 4 * field, 4, number(rng), true),
            field => {
                let values = [0, 1, 2, 3, 4, 6, 8, 16, 255];
                put(bytes, 22 + field, 1, values[rng.random_range(0..values.len())], true);
            }
        },
        _ if length > 0 => {
            let hit = at + 8 + rng.random_range(0..length);
            bytes[hit] = rng.next_u32() as u8;
        }
        _ => {}
    }
}

/// Puts right the sums of all chunks.
fn mend_sums(bytes: &mut [u8]) {
    for (at, length) in chunks(bytes) {
        let sum = crc32fast::hash(&bytes[at + 4..at + 8 + length]);
        put(bytes, at + 8 + length, 4, u64::from(sum), true);
    }
}
