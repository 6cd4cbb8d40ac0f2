//! What is known of the cells of a map that cameras made: its layers, and who saw a place.

use std::collections::BTreeMap;
use std::sync::Arc;

use geometry::Raster;
use nalgebra::Point2;
use terrain::ElevationMap;
use terrain::fusion::{Cell, Flags, MapSettings, MapVersion};
use wire::map_version::{VersionChanges, VersionPair};
use wire::resources::CellSeen;
use wire::time::Timestamp;

use crate::drape::PlacedShot;

/// Layers of a map that cameras made, beside those of every map. `sigma` (m) and `count` tell how well the
/// height is known, `age` how long before the newest capture it was seen (s; the tile's time is that of
/// the newest), `source` who saw it (see `sources` of the version), `mask` what stands in the way.
pub const SEEN_LAYERS: [&str; 5] = ["sigma", "count", "age", "source", "mask"];

/// Classes of the layer `mask`.
mod mask {
    pub const NOTHING: u8 = 0;
    pub const SEEN: u8 = 1;
    pub const ROBOT: u8 = 2;
    pub const SHADOW_BAND: u8 = 3;
    pub const CONFLICT: u8 = 4;
    pub const PRIOR: u8 = 5;
    pub const CONTACT: u8 = 6;
}

/// A cell with so many points is trusted in full, as in [`MapVersion::elevation`].
const LOOKS: f32 = 4.0;

/// Ground that is not plainly known is bounded with so many standard deviations.
const HINT_SIGMAS: f64 = 3.0;

/// What the first values of `source` stand for; the pairs follow.
const SOURCE_PRIOR: &str = "map from before";
const SOURCE_CONTACT: &str = "standing wheels";

/// Where the heights of a version come from: the blended map that it was read from.
#[derive(Clone)]
pub struct SeenBy {
    /// The blended map.
    pub map: Arc<MapVersion>,
    /// Names of the pairs by the numbers of their maps.
    pub pairs: BTreeMap<u32, String>,
    /// The captures in it.
    pub captures: Vec<VersionPair>,
    /// The images it is made of.
    pub shots: Vec<PlacedShot>,
    /// What came of it.
    pub changes: Option<VersionChanges>,
}

/// The same, prepared to be asked.
pub(super) struct Seen {
    map: Arc<MapVersion>,
    names: BTreeMap<u32, String>,
    labels: Vec<String>,
    newest_ns: Option<i64>,
}

impl Seen {
    pub(super) fn new(by: &SeenBy) -> Seen {
        let mut labels = vec![SOURCE_PRIOR.to_owned(), SOURCE_CONTACT.to_owned()];
        for name in by.pairs.values() {
            if !labels.contains(name) {
                labels.push(name.clone());
            }
        }
        let times = by.captures.iter().map(|pair| pair.capture_time.0);
        let newest_ns = times.max().map(|time| i64::try_from(time).unwrap_or(i64::MAX));
        Seen { map: by.map.clone(), names: by.pairs.clone(), labels, newest_ns }
    }

    /// What the values of `source` stand for, from 1 on.
    pub(super) fn labels(&self) -> &[String] {
        &self.labels
    }

    /// Time of the newest capture.
    pub(super) fn newest(&self) -> Option<Timestamp> {
        self.newest_ns.map(time)
    }

    /// The value of a layer of quantities at a place; NaN where there is none.
    pub(super) fn value(&self, layer: &str, p: Point2<f64>) -> f32 {
        let Some(cell) = self.map.cell_at(p).filter(Cell::is_ground) else { return f32::NAN };
        match layer {
            "sigma" => cell.variance_m2.sqrt(),
            "count" if cell.flags.any(Flags::PRIOR) => 0.0,
            "count" => f32::from(cell.count),
            "age" if cell.flags.any(Flags::PRIOR) => f32::NAN,
            "age" => self.newest_ns.map_or(f32::NAN, |newest| {
                (newest.saturating_sub(cell.time_ns).max(0) as f64 * 1e-9) as f32
            }),
            _ => f32::NAN,
        }
    }

    /// How far each node of a map is to be trusted, 0 to 1: by how often it was seen. What was imported, or a
    /// wheel stood on, is trusted in full.
    pub(super) fn trust(&self, map: &ElevationMap) -> Raster<f32> {
        let grid = *map.grid();
        Raster::from_fn(grid, |ix, iy| match self.map.cell_at(grid.position(ix, iy)) {
            Some(cell) if cell.flags.any(Flags::PRIOR | Flags::CONTACT) => 1.0,
            Some(cell) if cell.is_ground() => (f32::from(cell.count) / LOOKS).min(1.0),
            _ => 0.0,
        })
    }

    /// Standard deviation of the height, against that of ground beside it, that its class is to allow for (m): none of a map that was imported, which
    /// counts as it looks before and after cameras saw some of it; NaN where nothing is known.
    pub(super) fn doubt_m(&self, p: Point2<f64>) -> f32 {
        match self.map.cell_at(p) {
            Some(cell) if cell.flags.any(Flags::PRIOR) => 0.0,
            Some(cell) if cell.is_ground() => cell.noise_m2().sqrt() as f32,
            _ => f32::NAN,
        }
    }

    /// How high unknown nodes of a map are where something was seen there all the same: the ground that the robot
    /// hides, as last seen, or the higher of two heights that contradict each other, with [`HINT_SIGMAS`].
    pub(super) fn hints(&self, map: &ElevationMap) -> BTreeMap<(usize, usize), f32> {
        let grid = *map.grid();
        let now = self.newest_ns.unwrap_or(i64::MIN);
        let growth = MapSettings::default().growth_m2_s;
        let nodes = (0..grid.ny).flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy)));
        let unknown = nodes.filter(|(ix, iy)| map.heights().at(*ix, *iy).is_nan());
        let hint = |(ix, iy): (usize, usize)| {
            let cell = self.map.cell_at(grid.position(ix, iy)).filter(Cell::is_ground)?;
            if cell.flags.any(Flags::PRIOR) {
                return None;
            }
            let sigma = MapVersion::variance_at(&cell, now, growth).sqrt();
            let one = f64::from(cell.height_m) + HINT_SIGMAS * sigma;
            let other = cell.rival.map_or(one, |rival| {
                f64::from(rival.height_m) + HINT_SIGMAS * f64::from(rival.variance_m2).sqrt()
            });
            Some(((ix, iy), one.max(other) as f32))
        };
        unknown.filter_map(hint).collect()
    }

    /// The value of a layer of classes at a place.
    pub(super) fn class(&self, layer: &str, p: Point2<f64>) -> u8 {
        let Some(cell) = self.map.cell_at(p) else { return 0 };
        if layer == "source" { self.source(&cell) } else { mask_of(&cell) }
    }

    fn source(&self, cell: &Cell) -> u8 {
        if !cell.is_ground() {
            return 0;
        }
        let name = match self.names.get(&cell.source) {
            _ if cell.flags.any(Flags::PRIOR) => SOURCE_PRIOR,
            Some(name) => name,
            None => SOURCE_CONTACT,
        };
        let at = self.labels.iter().position(|label| label == name);
        at.and_then(|at| u8::try_from(at + 1).ok()).unwrap_or(0)
    }

    /// Who saw the node at a place, and when; none where nobody did.
    pub(super) fn at(&self, p: Point2<f64>) -> Option<CellSeen> {
        let cell = self.map.cell_at(p).filter(Cell::is_ground)?;
        let is_prior = cell.flags.any(Flags::PRIOR);
        Some(CellSeen {
            camera: self.names.get(&cell.source).filter(|_| !is_prior).cloned(),
            capture_time: time(cell.time_ns),
            sigma_m: f64::from(cell.variance_m2).sqrt(),
            observations: cell.count,
            prior: is_prior,
            hidden: cell.flags.any(Flags::MASKED),
        })
    }
}

fn time(ns: i64) -> Timestamp {
    Timestamp(u64::try_from(ns).unwrap_or(0))
}

fn mask_of(cell: &Cell) -> u8 {
    let flags = cell.flags;
    if flags.any(Flags::CONTACT) {
        mask::CONTACT
    } else if flags.any(Flags::CONFLICT) {
        mask::CONFLICT
    } else if flags.any(Flags::ROBOT) {
        mask::ROBOT
    } else if flags.any(Flags::SHADOW_BAND) {
        mask::SHADOW_BAND
    } else if !cell.is_ground() {
        mask::NOTHING
    } else if flags.any(Flags::PRIOR) {
        mask::PRIOR
    } else {
        mask::SEEN
    }
}
