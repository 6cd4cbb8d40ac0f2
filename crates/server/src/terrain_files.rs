//! Terrain files on the disk: large ones piece by piece, the others as a whole.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use terrain::formats::{ByteSource, ReadOptions, geotiff, pds3, read_with};
use terrain::{ElevationMap, Source, TerrainError};
use wire::check::{At, RequestError};

use crate::terrains::{FILE_BYTES_MAX, terrain_error};

/// A file that is read piece by piece.
struct Pieces {
    file: File,
    len: u64,
}

impl Pieces {
    fn open(path: &Path) -> std::io::Result<Pieces> {
        let file = File::open(path)?;
        let len = file.metadata()?.len();
        Ok(Pieces { file, len })
    }
}

impl ByteSource for Pieces {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&mut self, offset: u64, n: usize) -> Result<Vec<u8>, String> {
        if offset.checked_add(n as u64).is_none_or(|end| end > self.len) {
            return Err("ends too early".to_owned());
        }
        let mut bytes = vec![0; n];
        let read = self.file.seek(SeekFrom::Start(offset));
        let read = read.and_then(|_| self.file.read_exact(&mut bytes));
        read.map(|()| bytes).map_err(|error| format!("cannot be read: {error}"))
    }
}

/// Reads a terrain file called `name`; `beside` gives the path of another file of its folder.
pub fn read(
    at: &At<'_>,
    name: &str,
    path: &Path,
    beside: impl Fn(&str) -> Option<PathBuf>,
    options: &ReadOptions,
) -> Result<ElevationMap, RequestError> {
    let refuse = |error: TerrainError| terrain_error(at, &error);
    let ending = name.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
    let map = match ending.as_deref() {
        Some("tif" | "tiff") => {
            let file = geotiff::GeoTiffFile::open_with_options(path, geotiff::limits(options));
            let file = file.map_err(|error| refuse(error.into()))?;
            geotiff::read_open(&file, options).map_err(refuse)?
        }
        Some("img" | "lbl") => {
            let open = |path: &Path| Pieces::open(path).map_err(|error| unreadable(at, &error));
            let mut label = open(path)?;
            let image = pds3::read_label(&mut label).map_err(refuse)?;
            match image.file.as_deref().filter(|other| !name.eq_ignore_ascii_case(other)) {
                None => pds3::read(&image, &mut label, options).map_err(refuse)?,
                Some(other) => {
                    let missing = || TerrainError::CompanionMissing {
                        file_name: name.to_owned(),
                        companion: other.chars().take(80).collect(),
                    };
                    let path = beside(other).ok_or_else(|| refuse(missing()))?;
                    pds3::read(&image, &mut open(&path)?, options).map_err(refuse)?
                }
            }
        }
        _ => {
            let bytes = read_bounded(at, path)?;
            let mut companion = |name: &str| read_bounded(at, &beside(name)?).ok();
            return read_with(name, &bytes, &mut companion, options).map_err(refuse);
        }
    };
    Ok(map.with_source(Source::file(name)))
}

fn unreadable(at: &At<'_>, error: &std::io::Error) -> RequestError {
    RequestError::at("terrain_file_invalid", at, format_args!("cannot be read: {error}"))
}

fn read_bounded(at: &At<'_>, path: &Path) -> Result<Vec<u8>, RequestError> {
    let mut bytes = Vec::new();
    let read =
        File::open(path).and_then(|file| file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes));
    read.map_err(|error| unreadable(at, &error))?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        let text = format_args!("has more than {FILE_BYTES_MAX} bytes; crop it");
        return Err(RequestError::at("too_many", at, text));
    }
    Ok(bytes)
}
