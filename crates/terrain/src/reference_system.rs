//! The reference system of a map's source: which plane over which planet its coordinates are in.

/// GeoKey of the kind of coordinates; 1 is a plane (OGC 19-008r4, GeoTIFF 1.1, annex B).
const MODEL_TYPE: u16 = 1024;
const PROJECTED: u16 = 1;
/// GeoKey of what a pixel is; 1 is an area.
const RASTER_TYPE: u16 = 1025;
const TAG_GEO_DOUBLES: u16 = 34736;
const TAG_GEO_ASCII: u16 = 34737;
/// GeoKeys with the name of the whole, of the projection, and of the body.
const CITATIONS: [u16; 3] = [1026, 3073, 2049];
/// GeoKeys by which two systems are surely not the same: a code of the whole, the method, the ellipsoid, and all
/// parameters of the projection.
const TELLING: [std::ops::RangeInclusive<u16>; 4] =
    [3072..=3072, 3075..=3075, 2057..=2059, 3078..=3095];
/// Code of what is defined by other keys.
const USER_DEFINED: f64 = 32767.0;
/// Most keys, numbers and characters that are kept; GDAL writes about 30, 15 and 300.
const KEYS_MAX: usize = 200;
const DOUBLES_MAX: usize = 500;
const ASCII_MAX: usize = 8192;

/// A projected reference system, kept as the GeoKeys that a GeoTIFF had: what it says is written again as it was, in
/// meters, and never interpreted. Without one, coordinates are those of a local frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceSystem {
    directory: Vec<u16>,
    doubles: Vec<f64>,
    ascii: String,
}

impl ReferenceSystem {
    /// Of the three tags of GeoKeys; none if they are of no projected system, or lie.
    pub(crate) fn new(directory: &[u16], doubles: &[f64], ascii: &str) -> Option<ReferenceSystem> {
        let &[1, _, _, n_keys, ..] = directory else { return None };
        let n_keys = usize::from(n_keys);
        let directory = directory.get(..4 + 4 * n_keys)?;
        let fits = n_keys <= KEYS_MAX && doubles.len() <= DOUBLES_MAX && ascii.len() <= ASCII_MAX;
        let is_text = ascii.bytes().all(|b| (b' '..=b'~').contains(&b));
        if !(fits && is_text && doubles.iter().all(|v| v.is_finite())) {
            return None;
        }
        let mut system = ReferenceSystem {
            directory: directory.to_vec(),
            doubles: doubles.to_vec(),
            ascii: ascii.to_owned(),
        };
        if system.number(MODEL_TYPE) != Some(f64::from(PROJECTED))
            || !system.keys().all(|key| system.holds(key))
        {
            return None;
        }
        // Pixels are written as areas, whatever they were.
        for key in system.directory[4..].chunks_exact_mut(4).filter(|key| key[0] == RASTER_TYPE) {
            key.copy_from_slice(&[RASTER_TYPE, 0, 1, 1]);
        }
        Some(system)
    }

    /// What it is called; empty if it has no name.
    pub fn name(&self) -> &str {
        CITATIONS.into_iter().find_map(|id| self.text(id)).unwrap_or_default()
    }

    /// The first GeoKey in which two systems contradict each other; none where nothing tells them apart. Where one says
    /// by a code what the other spells out, nothing does.
    pub fn differs_from(&self, other: &ReferenceSystem) -> Option<u16> {
        TELLING.into_iter().flatten().find(|id| match (self.number(*id), other.number(*id)) {
            (Some(a), Some(b)) => {
                let is_open = *id == 3072 && (a == USER_DEFINED || b == USER_DEFINED);
                !is_open && (a - b).abs() > 1e-9 * a.abs().max(b.abs())
            }
            _ => false,
        })
    }

    /// GeoKey directory, numbers and texts, as their tags hold them.
    pub(crate) fn tags(&self) -> (&[u16], &[f64], &str) {
        (&self.directory, &self.doubles, &self.ascii)
    }

    fn keys(&self) -> impl Iterator<Item = &[u16]> {
        self.directory[4..].chunks_exact(4)
    }

    /// Does what a key points to exist?
    fn holds(&self, key: &[u16]) -> bool {
        let end = usize::from(key[2]) + usize::from(key[3]);
        match key[1] {
            0 => true,
            TAG_GEO_DOUBLES => end <= self.doubles.len(),
            TAG_GEO_ASCII => end <= self.ascii.len(),
            _ => false,
        }
    }

    fn find(&self, id: u16) -> Option<&[u16]> {
        self.keys().find(|key| key[0] == id)
    }

    fn number(&self, id: u16) -> Option<f64> {
        let key = self.find(id)?;
        match key[1] {
            0 => Some(f64::from(key[3])),
            TAG_GEO_DOUBLES => self.doubles.get(usize::from(key[3])).copied(),
            _ => None,
        }
    }

    fn text(&self, id: u16) -> Option<&str> {
        let key = self.find(id).filter(|key| key[1] == TAG_GEO_ASCII)?;
        let start = usize::from(key[3]);
        let text = self.ascii.get(start..start + usize::from(key[2]))?.trim_end_matches('|').trim();
        Some(text).filter(|text| !text.is_empty())
    }
}
