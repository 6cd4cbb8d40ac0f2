//! Brings the directories of a TIFF in front of its data, as cloud-optimized readers want them.

use crate::TerrainError;

/// What GDAL looks for after the header of such a file (GDAL, COG driver, "Header ghost area").
const GHOST: &[u8] = b"GDAL_STRUCTURAL_METADATA_SIZE=000140 bytes\n\
LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\n\
BLOCK_TRAILER=LAST_4_BYTES_REPEATED\nKNOWN_INCOMPATIBLE_EDITION=NO\n\x20";
const HEADER: usize = 8;
const TILE_OFFSETS: u16 = 324;
const TILE_BYTE_COUNTS: u16 = 325;
const LONG: u16 = 4;

struct Entry {
    tag: u16,
    kind: u16,
    count: u32,
    value: Vec<u8>,
}

/// The same file with all directories before the data, and each block with its length before it and its
/// last four bytes repeated after it, as the header then says. `bytes` is a classic little-endian TIFF in
/// tiles; a BigTIFF stays as it is.
pub(super) fn directories_first(bytes: Vec<u8>) -> Result<Vec<u8>, TerrainError> {
    if bytes.get(..4) != Some(b"II\x2a\0") {
        return Ok(bytes);
    }
    let file = Bytes(&bytes);
    let mut directories = Vec::new();
    let mut at = file.u32(4)? as usize;
    while at != 0 {
        let n = usize::from(file.u16(at)?);
        let mut entries = Vec::with_capacity(n);
        for i in 0..n {
            let entry = at + 2 + 12 * i;
            let (tag, kind, count) = (file.u16(entry)?, file.u16(entry + 2)?, file.u32(entry + 4)?);
            let size = size_of(kind)? * count as usize;
            let from = if size <= 4 { entry + 8 } else { file.u32(entry + 8)? as usize };
            entries.push(Entry { tag, kind, count, value: file.slice(from, size)?.to_vec() });
        }
        directories.push(entries);
        at = file.u32(at + 2 + 12 * n)? as usize;
    }
    // Every part begins at an even place.
    let even = |n: usize| n + n % 2;
    let own = |entries: &[Entry]| 2 + 12 * entries.len() + 4;
    let outside = |entry: &Entry| if entry.value.len() > 4 { even(entry.value.len()) } else { 0 };
    let length = |entries: &Vec<Entry>| own(entries) + entries.iter().map(outside).sum::<usize>();
    let first = even(HEADER + GHOST.len());
    let new_start = first + directories.iter().map(length).sum::<usize>();
    let mut blocks = Vec::new();
    for entries in &directories {
        blocks.extend(blocks_of(entries)?);
    }
    blocks.sort_unstable();
    let mut out = Vec::with_capacity(new_start + bytes.len());
    out.extend(b"II\x2a\0");
    out.extend((first as u32).to_le_bytes());
    out.extend(GHOST);
    out.resize(first, 0);
    let n_directories = directories.len();
    for (i, entries) in directories.into_iter().enumerate() {
        let (start, total) = (out.len(), length(&entries));
        let mut outside_at = start + own(&entries);
        let mut values = Vec::new();
        out.extend((entries.len() as u16).to_le_bytes());
        for mut entry in entries {
            if entry.tag == TILE_OFFSETS {
                move_offsets(&mut entry, &blocks, new_start)?;
            }
            out.extend(entry.tag.to_le_bytes());
            out.extend(entry.kind.to_le_bytes());
            out.extend(entry.count.to_le_bytes());
            if entry.value.len() <= 4 {
                entry.value.resize(4, 0);
                out.extend(&entry.value);
                continue;
            }
            out.extend((outside_at as u32).to_le_bytes());
            entry.value.resize(even(entry.value.len()), 0);
            outside_at += entry.value.len();
            values.extend(entry.value);
        }
        let next = if i + 1 < n_directories { start + total } else { 0 };
        out.extend((next as u32).to_le_bytes());
        out.extend(values);
    }
    for (at, n) in &blocks {
        let block = file.slice(*at as usize, *n as usize)?;
        out.extend(n.to_le_bytes());
        out.extend(block);
        out.extend(&block[block.len().saturating_sub(4)..]);
        let short = 4_usize.saturating_sub(block.len());
        out.extend(std::iter::repeat_n(0, short));
    }
    if u32::try_from(out.len()).is_err() {
        return Ok(bytes);
    }
    Ok(out)
}

/// Place and length of each block of a directory.
fn blocks_of(entries: &[Entry]) -> Result<Vec<(u32, u32)>, TerrainError> {
    let values = |tag: u16| {
        let entry = entries.iter().find(|entry| entry.tag == tag && entry.kind == LONG);
        let entry = entry.ok_or_else(|| damaged("blocks without LONG places and lengths"))?;
        let values =
            entry.value.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        Ok::<Vec<u32>, TerrainError>(values.collect())
    };
    Ok(values(TILE_OFFSETS)?.into_iter().zip(values(TILE_BYTE_COUNTS)?).collect())
}

/// Puts the places of blocks where they come to lie, one after the other with 8 bytes more each.
fn move_offsets(
    entry: &mut Entry,
    blocks: &[(u32, u32)],
    start: usize,
) -> Result<(), TerrainError> {
    let mut at = start as u64 + 4;
    let place = |(old, n): &(u32, u32)| {
        let new = at;
        at += u64::from(*n) + 8;
        (*old, new as u32)
    };
    let places: std::collections::HashMap<u32, u32> = blocks.iter().map(place).collect();
    for offset in entry.value.chunks_exact_mut(4) {
        let old = u32::from_le_bytes([offset[0], offset[1], offset[2], offset[3]]);
        let new = places.get(&old).ok_or_else(|| damaged("a block in no place"))?;
        offset.copy_from_slice(&new.to_le_bytes());
    }
    Ok(())
}

fn size_of(kind: u16) -> Result<usize, TerrainError> {
    Ok(match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 => 4,
        5 | 10 | 12 => 8,
        _ => return Err(damaged("a tag of unknown type")),
    })
}

fn damaged(what: &str) -> TerrainError {
    TerrainError::TiffWrite { reason: format!("the writer gave {what}") }
}

struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn slice(&self, at: usize, n: usize) -> Result<&'a [u8], TerrainError> {
        let end = at.checked_add(n).ok_or_else(|| damaged("an offset beyond all files"))?;
        self.0.get(at..end).ok_or_else(|| damaged("an offset beyond the file"))
    }

    fn u16(&self, at: usize) -> Result<u16, TerrainError> {
        self.slice(at, 2).map(|b| u16::from_le_bytes([b[0], b[1]]))
    }

    fn u32(&self, at: usize) -> Result<u32, TerrainError> {
        self.slice(at, 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }
}
