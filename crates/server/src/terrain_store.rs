//! The versions of the server's own map. A version never changes; its name is its content's hash.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Point2;
use terrain::traversability::{self, Layers, Limits};
use terrain::{ElevationMap, SourceKind, TerrainError};
use wire::check::{At, RequestError};
use wire::resources::{CellAnswer, TerrainVersion, TerrainVersions};
use wire::tile::{Format, Header, TILE_CELLS};
use wire::time::Timestamp;

use crate::terrains::{SERVED_NODES_MAX, terrain_error};

/// The layers that tiles are made of: the heights, and those of traversability.
pub const LAYERS: [&str; 7] =
    ["height", "slope", "roughness", "step", "goodness", "certainty", "class"];

/// A version of the map with what is computed from it.
pub struct Version {
    /// What is told of it.
    pub info: TerrainVersion,
    /// The map.
    pub map: ElevationMap,
    footprint_m: f64,
    limits: Limits,
    layers: Result<Layers, TerrainError>,
}

/// The versions that are kept.
pub struct TerrainStore {
    footprint_m: f64,
    limits: Limits,
    most: usize,
    /// Newest first; the first is in use. Never empty.
    versions: Mutex<Vec<Arc<Version>>>,
}

impl TerrainStore {
    /// A store that judges ground for feet of this width, keeps `most` versions, and begins with
    /// `map`.
    pub fn new(
        map: ElevationMap,
        now: Timestamp,
        footprint_m: f64,
        limits: Limits,
        most: usize,
    ) -> TerrainStore {
        let first = Version::new(map, now, footprint_m, limits);
        TerrainStore {
            footprint_m,
            limits,
            most: most.max(1),
            versions: Mutex::new(vec![Arc::new(first)]),
        }
    }

    /// Judges a map, to be put in use.
    pub fn prepare(&self, map: ElevationMap, now: Timestamp) -> Arc<Version> {
        Arc::new(Version::new(map, now, self.footprint_m, self.limits))
    }

    /// Makes a version the one in use.
    pub fn put(&self, version: Arc<Version>) {
        let mut versions = self.locked();
        versions.retain(|other| other.info.version != version.info.version);
        versions.insert(0, version);
        versions.truncate(self.most);
    }

    /// The version in use.
    pub fn current(&self) -> Arc<Version> {
        self.locked()[0].clone()
    }

    /// A version by its name.
    pub fn get(&self, at: &At<'_>, name: &str) -> Result<Arc<Version>, RequestError> {
        let found = self.locked().iter().find(|v| v.info.version == name).cloned();
        found.ok_or_else(|| {
            let name: String = name.chars().take(64).collect();
            let text =
                format_args!("{name:?} is not kept; GET /terrain/versions lists those that are");
            RequestError::at("terrain_unknown", at, text)
        })
    }

    /// All that are kept, newest first.
    pub fn list(&self) -> TerrainVersions {
        let versions = self.locked();
        TerrainVersions {
            current: versions[0].info.version.clone(),
            versions: versions.iter().map(|version| version.info.clone()).collect(),
        }
    }

    fn locked(&self) -> std::sync::MutexGuard<'_, Vec<Arc<Version>>> {
        self.versions.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Traversability of a whole map, unless it would take too many cells.
fn judge(map: &ElevationMap, footprint_m: f64, limits: &Limits) -> Result<Layers, TerrainError> {
    // Cells coarser than a ninth of the foot are resampled.
    let finer = (9.0 * map.grid().resolution / footprint_m).max(1.0);
    let n_nodes = map.grid().len() as f64 * finer * finer;
    if n_nodes > SERVED_NODES_MAX as f64 {
        let (n_nodes, max_nodes) = (n_nodes as u64, SERVED_NODES_MAX as u64);
        return Err(TerrainError::TooManyNodes { n_nodes, max_nodes });
    }
    traversability::traversability(map, footprint_m, limits)
}

/// A map's name: its content's hash.
pub fn version_name(map: &ElevationMap) -> String {
    format!("{:016x}", map.version_hash())
}

impl Version {
    fn new(map: ElevationMap, now: Timestamp, footprint_m: f64, limits: Limits) -> Version {
        let grid = *map.grid();
        let known = map.heights().values().iter().filter(|z| !z.is_nan());
        let (mut low, mut high, mut n_known) = (f32::INFINITY, f32::NEG_INFINITY, 0_usize);
        for z in known {
            (low, high, n_known) = (low.min(*z), high.max(*z), n_known + 1);
        }
        let z_range_m = if n_known == 0 { [0.0; 2] } else { [low.into(), high.into()] };
        let tiles = |n: usize| n.saturating_sub(1).div_ceil(TILE_CELLS).max(1);
        let layers = judge(&map, footprint_m, &limits);
        let info = TerrainVersion {
            version: version_name(&map),
            source: source_text(&map),
            synthetic_detail: map.source().synthetic_detail,
            created: now,
            origin_m: [grid.origin.x, grid.origin.y],
            resolution_m: grid.resolution,
            size: [grid.nx, grid.ny],
            z_range_m,
            known_share: n_known as f64 / grid.len().max(1) as f64,
            frame_offset_m: map.frame_offset().into(),
            tiles: [tiles(grid.nx), tiles(grid.ny)],
            layers: if layers.is_ok() { &LAYERS[..] } else { &LAYERS[..1] }
                .iter()
                .map(|name| (*name).to_owned())
                .collect(),
        };
        Version { info, map, footprint_m, limits, layers }
    }

    /// Traversability of the whole map, or why there is none.
    pub fn layers(&self) -> Result<&Layers, RequestError> {
        self.layers.as_ref().map_err(|error| terrain_error(&At::root("traversability"), error))
    }

    /// The goodness below which its cells are unsafe.
    pub fn unsafe_below(&self) -> f64 {
        self.limits.unsafe_below
    }

    /// A tile of a layer, as `wire::tile` says; `None` if there is no such layer or tile. Layers
    /// that were computed on a finer grid are given at the map's own nodes.
    pub fn tile(&self, layer: &str, x: usize, y: usize) -> Result<Option<Vec<u8>>, RequestError> {
        let [tiles_x, tiles_y] = self.info.tiles;
        if x >= tiles_x || y >= tiles_y || !LAYERS.contains(&layer) {
            return Ok(None);
        }
        let grid = self.map.grid();
        let span = |i: usize, n: usize| i * TILE_CELLS..((i + 1) * TILE_CELLS + 1).min(n);
        let (columns, rows) = (span(x, grid.nx), span(y, grid.ny));
        let origin = grid.position(columns.start, rows.start);
        let is_class = layer == "class";
        let header = Header {
            format: if is_class { Format::U8 } else { Format::F32 },
            planes: 1,
            size: [columns.len() as u32, rows.len() as u32],
            origin_m: [origin.x, origin.y],
            resolution_m: grid.resolution,
            z_min_m: 0.0,
            z_scale_m: 0.0,
            time_ns: self.info.created.0,
        };
        let mut bytes = header.encode().to_vec();
        let nodes = rows.flat_map(|iy| columns.clone().map(move |ix| (ix, iy)));
        if layer == "height" {
            for (ix, iy) in nodes {
                bytes.extend_from_slice(&self.map.heights().at(ix, iy).to_le_bytes());
            }
            return Ok(Some(bytes));
        }
        let layers = self.layers()?;
        if is_class {
            bytes.extend(nodes.map(|(ix, iy)| {
                layers.class.nearest(grid.position(ix, iy)).unwrap_or(traversability::UNKNOWN)
            }));
            return Ok(Some(bytes));
        }
        let values = match layer {
            "slope" => &layers.slope_rad,
            "roughness" => &layers.roughness_m,
            "step" => &layers.step_m,
            "goodness" => &layers.goodness,
            _ => &layers.certainty,
        };
        for (ix, iy) in nodes {
            let value = values.nearest(grid.position(ix, iy)).unwrap_or(f32::NAN);
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        Ok(Some(bytes))
    }

    /// Everything known of the cell at a place.
    pub fn cell(&self, x_m: f64, y_m: f64) -> CellAnswer {
        let p = Point2::new(x_m, y_m);
        // Where the map is too coarse for the foot there is only its height to tell.
        let cell = traversability::explain_cell(&self.map, p, self.footprint_m, &self.limits)
            .unwrap_or(None);
        let height_m = self.map.height_at(p);
        CellAnswer {
            position_m: [x_m, y_m],
            height_m,
            normal: cell.as_ref().and_then(|c| c.normal).map(|n| [n.x, n.y, n.z]),
            slope_rad: cell.as_ref().and_then(|c| c.slope_rad),
            roughness_m: cell.as_ref().and_then(|c| c.roughness_m),
            step_m: cell.as_ref().and_then(|c| c.step_m),
            goodness: cell.as_ref().and_then(|c| c.goodness),
            certainty: cell.as_ref().map(|c| c.certainty),
            class: cell.map_or(traversability::UNKNOWN, |c| c.class),
        }
    }

    /// The heights and, where they lie on the same grid, the layers of traversability, as GeoTIFF.
    pub fn geotiff(&self) -> Result<Vec<u8>, RequestError> {
        let heights = self.map.heights();
        terrain::formats::geotiff::write_layers(self.map.grid(), &[("height_m", heights)])
            .map_err(|error| terrain_error(&At::root("version"), &error))
    }
}

/// Where a map came from, in words.
pub fn source_text(map: &ElevationMap) -> String {
    fn of(kind: &SourceKind) -> String {
        match kind {
            SourceKind::Plane => "level ground".into(),
            SourceKind::File { name } => name.clone(),
            SourceKind::Recipe { seed, .. } => format!("synthetic ground, seed {seed}"),
            SourceKind::Detailed { base, seed, .. } => {
                format!("{} with synthetic detail, seed {seed}", of(base))
            }
        }
    }
    of(&map.source().kind)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Grid, Raster};
    use terrain::Source;
    use wire::tile::HEADER_LEN;

    fn store(nx: usize, ny: usize) -> TerrainStore {
        let grid = Grid { origin: Point2::new(-1.0, -2.0), resolution: 0.1, nx, ny };
        let heights = Raster::from_fn(grid, |ix, iy| (ix + 1000 * iy) as f32);
        let map = ElevationMap::new(heights, Source::plane());
        TerrainStore::new(map, Timestamp(5), 0.9, Limits::default(), 2)
    }

    #[test]
    fn neighboring_tiles_share_a_node_and_the_last_one_is_shorter() {
        let version = store(300, 257).current();
        assert_eq!(version.info.tiles, [2, 1]);
        let (first, second) = (version.tile("height", 0, 0), version.tile("height", 1, 0));
        let (first, second) = (first.unwrap().unwrap(), second.unwrap().unwrap());
        assert_eq!(first.len(), HEADER_LEN + 4 * 257 * 257);
        assert_eq!(second.len(), HEADER_LEN + 4 * 44 * 257);
        let shared = HEADER_LEN + 4 * 256;
        assert_eq!(first[shared..shared + 4], 256.0_f32.to_le_bytes());
        assert_eq!(second[HEADER_LEN..HEADER_LEN + 4], 256.0_f32.to_le_bytes());
        assert_eq!(version.tile("height", 2, 0).unwrap(), None);
        assert_eq!(version.tile("hight", 0, 0).unwrap(), None);
        let classes = version.tile("class", 0, 0).unwrap().unwrap();
        assert_eq!(classes.len(), HEADER_LEN + 257 * 257);
    }

    #[test]
    fn the_oldest_version_gives_way_and_the_same_ground_is_the_same_version() {
        let store = store(20, 20);
        let first = store.current();
        let plane = ElevationMap::plane(2.0, 0.1).unwrap();
        let second = store.prepare(plane.clone(), Timestamp(6));
        store.put(second.clone());
        store.put(store.prepare(plane, Timestamp(7)));
        assert_eq!(store.list().versions.len(), 2);
        assert_eq!(store.list().current, second.info.version);
        store.put(store.prepare(ElevationMap::plane(3.0, 0.1).unwrap(), Timestamp(8)));
        let at = At::root("version");
        assert!(store.get(&at, &second.info.version).is_ok());
        let gone = store.get(&at, &first.info.version).err().unwrap();
        assert_eq!(gone.code, "terrain_unknown");
    }
}
