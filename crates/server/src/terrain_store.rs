//! The versions of the server's own map. A version never changes; its name is its content's hash.

mod seen;

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use geometry::Raster;
use nalgebra::Point2;
use rover::Robot;
use stereo::rig::Rig;
use terrain::cover::CoverLimits;
use terrain::formats::mesh::{self, HeightMesh};
use terrain::traversability::{self, Layers, Limits};
use terrain::{ElevationMap, SourceKind, TerrainError};
use wire::check::{At, RequestError};
use wire::resources::{CellAnswer, CellComponent, CellDoubt, TerrainVersion, TerrainVersions};
use wire::tile::{Format, Header, TILE_CELLS};
use wire::time::Timestamp;

pub use seen::{SEEN_LAYERS, SeenBy};

use crate::drape::{PlacedShot, Texture};
use crate::error::ApiError;
use crate::stop::Stop;
use crate::terrains::{SERVED_NODES_MAX, terrain_error};
use crate::unknown_ground::cover_of;

/// The layers that tiles are made of: the heights, and those of traversability.
pub const LAYERS: [&str; 7] =
    ["height", "slope", "roughness", "step", "goodness", "certainty", "class"];

/// Standard deviations of doubt where the configuration says nothing.
const DOUBT_SIGMAS: f64 = 0.5;

/// A version of the map with what is computed from it.
pub struct Version {
    /// What is told of it.
    pub info: TerrainVersion,
    /// The map.
    pub map: ElevationMap,
    footprint_m: f64,
    limits: Limits,
    layers: Result<Layers, TerrainError>,
    seen: Option<seen::Seen>,
    /// How far each node is to be trusted, where cameras saw the map.
    trust: Option<Raster<f32>>,
    /// Standard deviations of doubt in what cameras saw.
    doubt_sigmas: f64,
    shots: Vec<PlacedShot>,
    texture: Mutex<Option<Arc<Texture>>>,
    /// How high its unknown ground is taken to be, once that was asked.
    cover: OnceLock<Option<ElevationMap>>,
}

/// The versions that are kept.
pub struct TerrainStore {
    footprint_m: f64,
    limits: Limits,
    doubt_sigmas: f64,
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
        let first = Version::new(map, now, footprint_m, limits, None);
        TerrainStore {
            footprint_m,
            limits,
            doubt_sigmas: DOUBT_SIGMAS,
            most: most.max(1),
            versions: Mutex::new(vec![Arc::new(first)]),
        }
    }

    /// The same, with so many standard deviations of doubt in what cameras saw.
    pub fn doubting(self, doubt_sigmas: f64) -> TerrainStore {
        TerrainStore { doubt_sigmas, ..self }
    }

    /// Judges a map, to be put in use.
    pub fn prepare(&self, map: ElevationMap, now: Timestamp) -> Arc<Version> {
        Arc::new(Version::new(map, now, self.footprint_m, self.limits, None))
    }

    /// Judges a map that cameras saw, to be put in use.
    pub fn prepare_seen(&self, map: ElevationMap, now: Timestamp, seen: SeenBy) -> Arc<Version> {
        let by = Some((seen::Seen::new(&seen), self.doubt_sigmas));
        let mut version = Version::new(map, now, self.footprint_m, self.limits, by);
        (version.info.pairs, version.info.changes) = (seen.captures, seen.changes);
        version.shots = seen.shots;
        Arc::new(version)
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
fn judge(
    map: &ElevationMap,
    seen: Option<(&seen::Seen, &Raster<f32>, f64)>,
    footprint_m: f64,
    limits: &Limits,
) -> Result<Layers, TerrainError> {
    // Cells coarser than a ninth of the foot are resampled.
    let finer = (9.0 * map.grid().resolution / footprint_m).max(1.0);
    let n_nodes = map.grid().len() as f64 * finer * finer;
    // A foot of no width is refused by its name further on.
    if footprint_m > 0.0 && n_nodes > SERVED_NODES_MAX as f64 {
        let (n_nodes, max_nodes) = (n_nodes as u64, SERVED_NODES_MAX as u64);
        return Err(TerrainError::TooManyNodes { n_nodes, max_nodes });
    }
    let Some((seen, trust, sigmas)) = seen else {
        return traversability::traversability(map, footprint_m, limits);
    };
    let layers = traversability::trusted_traversability(map, trust, footprint_m, limits)?;
    let grid = *layers.class.grid();
    let doubt = Raster::from_fn(grid, |ix, iy| seen.doubt_m(grid.position(ix, iy)));
    layers.with_doubt(&doubt, sigmas)
}

/// Tiles along an axis of so many nodes.
fn n_tiles(n_nodes: usize) -> usize {
    n_nodes.saturating_sub(1).div_ceil(TILE_CELLS).max(1)
}

/// Zoom levels of a map with so many nodes along its longer side: the last is a single tile.
fn n_zooms(n_nodes: usize) -> usize {
    n_tiles(n_nodes).next_power_of_two().trailing_zeros() as usize + 1
}

/// A map's name: its content's hash.
pub fn version_name(map: &ElevationMap) -> String {
    format!("{:016x}", map.version_hash())
}

impl Version {
    fn new(
        map: ElevationMap,
        now: Timestamp,
        footprint_m: f64,
        limits: Limits,
        seen: Option<(seen::Seen, f64)>,
    ) -> Version {
        let grid = *map.grid();
        let known = map.heights().values().iter().filter(|z| !z.is_nan());
        let (mut low, mut high, mut n_known) = (f32::INFINITY, f32::NEG_INFINITY, 0_usize);
        for z in known {
            (low, high, n_known) = (low.min(*z), high.max(*z), n_known + 1);
        }
        let z_range_m = if n_known == 0 { [0.0; 2] } else { [low.into(), high.into()] };
        let trust = seen.as_ref().map(|(seen, _)| seen.trust(&map));
        let by = seen.as_ref().zip(trust.as_ref()).map(|((seen, k), trust)| (seen, trust, *k));
        let layers = judge(&map, by, footprint_m, &limits);
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
            reference_system: map
                .placement()
                .system
                .as_ref()
                .map(|system| system.name().to_owned()),
            tiles: [n_tiles(grid.nx), n_tiles(grid.ny)],
            zooms: n_zooms(grid.nx.max(grid.ny)),
            layers: if layers.is_ok() { &LAYERS[..] } else { &LAYERS[..1] }
                .iter()
                .chain(seen.iter().flat_map(|_| &SEEN_LAYERS))
                .map(|name| (*name).to_owned())
                .collect(),
            changes: None,
            pairs: Vec::new(),
            sources: seen.as_ref().map_or(Vec::new(), |(seen, _)| seen.labels().to_vec()),
            captured: seen.as_ref().and_then(|(seen, _)| seen.newest()),
        };
        let doubt_sigmas = seen.as_ref().map_or(0.0, |(_, sigmas)| *sigmas);
        let seen = seen.map(|(seen, _)| seen);
        let (shots, texture) = (Vec::new(), Mutex::default());
        Version {
            info,
            map,
            footprint_m,
            limits,
            layers,
            seen,
            trust,
            doubt_sigmas,
            shots,
            texture,
            cover: OnceLock::new(),
        }
    }

    /// The surface that motions keep clear of where the map has holes; none where it has none. The limits of the first
    /// who asks count.
    pub fn cover(&self, limits: &CoverLimits) -> Option<&ElevationMap> {
        let made = self.cover.get_or_init(|| {
            let hints = self.seen.as_ref().map(|seen| seen.hints(&self.map)).unwrap_or_default();
            cover_of(&self.map, &hints, limits)
        });
        made.as_ref()
    }

    /// Traversability of the whole map for another foot or by other limits, with the same trust and doubt.
    pub fn judged(&self, footprint_m: f64, limits: &Limits) -> Result<Layers, TerrainError> {
        let by = self.seen.as_ref().zip(self.trust.as_ref());
        let by = by.map(|(seen, trust)| (seen, trust, self.doubt_sigmas));
        judge(&self.map, by, footprint_m, limits)
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
    ///
    /// At zoom z the nodes are 2^z times as far apart. Heights there are those of the nodes that are
    /// left, so that neighboring tiles share theirs; of the other layers a node has the worst of the
    /// nodes that it stands for, unknown being worst of all: from afar nothing looks better than it is. What is known
    /// of how the ground was seen is that of the nodes that are left.
    pub fn tile(
        &self,
        layer: &str,
        zoom: usize,
        x: usize,
        y: usize,
    ) -> Result<Option<Vec<u8>>, RequestError> {
        let of_seen = self.seen.as_ref().filter(|_| SEEN_LAYERS.contains(&layer));
        if zoom >= self.info.zooms || !(LAYERS.contains(&layer) || of_seen.is_some()) {
            return Ok(None);
        }
        let (grid, step) = (self.map.grid(), 1_usize << zoom);
        let nodes = |n: usize| n.saturating_sub(1) / step + 1;
        let (nx, ny) = (nodes(grid.nx), nodes(grid.ny));
        if x >= n_tiles(nx) || y >= n_tiles(ny) {
            return Ok(None);
        }
        let span = |i: usize, n: usize| i * TILE_CELLS..((i + 1) * TILE_CELLS + 1).min(n);
        let (columns, rows) = (span(x, nx), span(y, ny));
        let origin = grid.position(columns.start * step, rows.start * step);
        let is_class = matches!(layer, "class" | "source" | "mask");
        let newest = of_seen.and_then(seen::Seen::newest);
        let header = Header {
            format: if is_class { Format::U8 } else { Format::F32 },
            planes: 1,
            size: [columns.len() as u32, rows.len() as u32],
            origin_m: [origin.x, origin.y],
            resolution_m: grid.resolution * step as f64,
            z_min_m: 0.0,
            z_scale_m: 0.0,
            time_ns: newest.unwrap_or(self.info.created).0,
        };
        let mut bytes = header.encode().to_vec();
        let nodes = rows.flat_map(|iy| columns.clone().map(move |ix| (ix * step, iy * step)));
        if layer == "height" {
            for (ix, iy) in nodes {
                bytes.extend_from_slice(&self.map.heights().at(ix, iy).to_le_bytes());
            }
            return Ok(Some(bytes));
        }
        if let Some(seen) = of_seen {
            let places = nodes.map(|(ix, iy)| grid.position(ix, iy));
            if is_class {
                bytes.extend(places.map(|p| seen.class(layer, p)));
            } else {
                bytes.extend(places.flat_map(|p| seen.value(layer, p).to_le_bytes()));
            }
            return Ok(Some(bytes));
        }
        let layers = self.layers()?;
        // The nodes that a node of this zoom stands for, as far as the map goes.
        let around = |i: usize, n: usize| i.saturating_sub(step / 2)..(i + step.div_ceil(2)).min(n);
        let block = |(ix, iy): (usize, usize)| {
            let ys = around(iy, grid.ny);
            ys.flat_map(move |iy| around(ix, grid.nx).map(move |ix| grid.position(ix, iy)))
        };
        if is_class {
            let class = |p| layers.class.nearest(p).unwrap_or(traversability::UNKNOWN);
            bytes.extend(
                nodes.map(|node| block(node).map(class).min().unwrap_or(traversability::UNKNOWN)),
            );
            return Ok(Some(bytes));
        }
        let (values, lower_is_worse) = match layer {
            "slope" => (&layers.slope_rad, false),
            "roughness" => (&layers.roughness_m, false),
            "step" => (&layers.step_m, false),
            "goodness" => (&layers.goodness, true),
            _ => (&layers.certainty, true),
        };
        let worse = |a: f32, b: f32| match a.is_nan() || b.is_nan() {
            true => f32::NAN,
            false if lower_is_worse => a.min(b),
            false => a.max(b),
        };
        for node in nodes {
            let value = |p| values.nearest(p).unwrap_or(f32::NAN);
            let worst = block(node).map(value).reduce(worse).unwrap_or(f32::NAN);
            bytes.extend_from_slice(&worst.to_le_bytes());
        }
        Ok(Some(bytes))
    }

    /// Everything known of the cell at a place; its class is that of the layers.
    pub fn cell(&self, x_m: f64, y_m: f64) -> CellAnswer {
        let p = Point2::new(x_m, y_m);
        let (trust, foot, limits) = (self.trust.as_ref(), self.footprint_m, &self.limits);
        // Where the map is too coarse for the foot there is only its height to tell.
        let cell =
            traversability::explain_trusted_cell(&self.map, trust, p, foot, limits).unwrap_or(None);
        let height_m = self.map.height_at(p);
        let doubted = self.seen.as_ref().zip(cell.as_ref()).and_then(|(seen, cell)| {
            let sigma_m = f64::from(cell.worst(|p| seen.doubt_m(p)));
            cell.doubted(sigma_m, self.doubt_sigmas).unwrap_or(None)
        });
        let plain = cell.as_ref().map_or(traversability::UNKNOWN, |c| c.class);
        CellAnswer {
            position_m: [x_m, y_m],
            height_m,
            normal: cell.as_ref().and_then(|c| c.normal).map(|n| [n.x, n.y, n.z]),
            slope_rad: cell.as_ref().and_then(|c| c.slope_rad),
            roughness_m: cell.as_ref().and_then(|c| c.roughness_m),
            step_m: cell.as_ref().and_then(|c| c.step_m),
            goodness: cell.as_ref().and_then(|c| c.goodness),
            certainty: cell.as_ref().map(|c| c.certainty),
            class: doubted.map_or(plain, |(class, _)| class),
            doubt: doubted.filter(|_| plain != traversability::UNKNOWN).map(|(_, d)| doubt(&d)),
            known_share: cell.as_ref().map(|c| c.known_share),
            seen: height_m.and_then(|_| self.seen.as_ref()?.at(p)),
            components: cell.iter().flat_map(|c| c.components()).map(component).collect(),
        }
    }

    /// The texture of the images that it is made of, made now where it was not before.
    pub fn texture(&self, robot: &Robot, rig: &Rig, stop: &Stop) -> Result<Arc<Texture>, ApiError> {
        // Whoever asks meanwhile waits for the same one.
        let mut kept = self.texture.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(texture) = &*kept {
            return Ok(texture.clone());
        }
        let made = Texture::new(&self.map, &self.shots, robot, rig, stop)?.ok_or_else(|| {
            let message = "no image of a camera lies over this map: make one of stereo pairs";
            ApiError::new("texture_none", message)
        })?;
        let made = Arc::new(made);
        *kept = Some(made.clone());
        Ok(made)
    }

    /// The map as a file: GeoTIFF of the heights and, where they lie on the same grid, the layers of
    /// traversability; or its surface as OBJ or PLY, whole or within `error_m` (m) of it.
    pub fn export(&self, format: ExportFormat, error_m: f64) -> Result<Vec<u8>, RequestError> {
        let layers = self.layers.as_ref().ok();
        export(&self.map, layers, format, error_m)
    }
}

/// A way to write a map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum ExportFormat {
    /// GeoTIFF of heights and layers.
    #[default]
    Tif,
    /// Wavefront OBJ of the surface.
    Obj,
    /// Binary PLY of the surface.
    Ply,
    /// GeoTIFF of the classes of traversability, with a color for each.
    Classes,
    /// GeoTIFF of the texture of camera images.
    Texture,
}

impl ExportFormat {
    /// The format of a file by the end of its name.
    pub fn of_name(name: &str) -> Option<ExportFormat> {
        match name.rsplit_once('.')?.1.to_ascii_lowercase().as_str() {
            "tif" | "tiff" => Some(ExportFormat::Tif),
            "obj" => Some(ExportFormat::Obj),
            "ply" => Some(ExportFormat::Ply),
            _ => None,
        }
    }

    /// End of the name and media type of such a file.
    pub fn names(self) -> (&'static str, &'static str) {
        match self {
            ExportFormat::Tif => ("tif", "image/tiff"),
            ExportFormat::Obj => ("obj", "model/obj"),
            ExportFormat::Ply => ("ply", "application/octet-stream"),
            ExportFormat::Classes => ("classes.tif", "image/tiff"),
            ExportFormat::Texture => ("texture.tif", "image/tiff"),
        }
    }
}

/// Colors of the classes of traversability: unknown, unsafe, caution, safe.
const CLASS_COLORS: [[u8; 3]; 4] = [[0, 0, 0], [200, 66, 52], [217, 178, 74], [79, 174, 138]];

/// A map as a file, with the layers of traversability in a GeoTIFF where they lie on its grid.
pub fn export(
    map: &ElevationMap,
    layers: Option<&Layers>,
    format: ExportFormat,
    error_m: f64,
) -> Result<Vec<u8>, RequestError> {
    let refuse = |field, error: TerrainError| terrain_error(&At::root(field), &error);
    if format == ExportFormat::Classes {
        let classes = layers.map(|layers| &layers.class).ok_or_else(|| {
            RequestError::at("not_ready", &At::root("format"), "is of a map without traversability")
        })?;
        return terrain::formats::geotiff::write_classes(
            classes,
            "class",
            &CLASS_COLORS,
            map.placement(),
        )
        .map_err(|error| refuse("version", error));
    }
    if format == ExportFormat::Tif {
        let layers = layers.filter(|layers| layers.class.grid() == map.grid());
        let class = layers.map(|layers| {
            let class = layers.class.values().iter().map(|class| f32::from(*class));
            Raster::new(*map.grid(), class.collect()).expect("one class per node")
        });
        let mut bands = vec![("height_m", map.heights())];
        if let (Some(layers), Some(class)) = (layers, &class) {
            bands.extend([
                ("slope_rad", &layers.slope_rad),
                ("roughness_m", &layers.roughness_m),
                ("step_m", &layers.step_m),
                ("goodness", &layers.goodness),
                ("certainty", &layers.certainty),
                ("class", class),
            ]);
        }
        return terrain::formats::geotiff::write_layers(map.grid(), &bands, map.placement())
            .map_err(|error| refuse("version", error));
    }
    let mesh = if error_m > 0.0 {
        HeightMesh::simplified(map, error_m).map_err(|error| refuse("error_m", error))?
    } else {
        HeightMesh::whole(map)
    };
    let comments = [
        format!("FootFall map {}: {}", version_name(map), source_text(map)),
        mesh::frame_text(map.grid(), map.frame_offset()),
        format!("nowhere farther than {error_m} m above or below the surface of the map"),
    ];
    Ok(match format {
        ExportFormat::Obj => mesh::write_obj(&mesh, &comments),
        _ => terrain::formats::ply::write(&mesh, &comments),
    })
}

fn doubt(d: &traversability::Doubt) -> CellDoubt {
    let known = |v: f64| Some(v).filter(|v| !v.is_nan());
    CellDoubt {
        sigmas: d.sigmas,
        sigma_m: known(d.sigma_m),
        step_m: known(d.step_m),
        slope_rad: known(d.slope_rad),
        class_as_seen: d.class_as_seen,
    }
}

fn component(c: traversability::Component) -> CellComponent {
    CellComponent {
        name: c.name.into(),
        value: c.value,
        lo: c.lo,
        hi: c.hi,
        goodness: c.goodness,
        reason: c.reason.into(),
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
        let (first, second) = (version.tile("height", 0, 0, 0), version.tile("height", 0, 1, 0));
        let (first, second) = (first.unwrap().unwrap(), second.unwrap().unwrap());
        assert_eq!(first.len(), HEADER_LEN + 4 * 257 * 257);
        assert_eq!(second.len(), HEADER_LEN + 4 * 44 * 257);
        let shared = HEADER_LEN + 4 * 256;
        assert_eq!(first[shared..shared + 4], 256.0_f32.to_le_bytes());
        assert_eq!(second[HEADER_LEN..HEADER_LEN + 4], 256.0_f32.to_le_bytes());
        assert_eq!(version.tile("height", 0, 2, 0).unwrap(), None);
        assert_eq!(version.tile("hight", 0, 0, 0).unwrap(), None);
        let classes = version.tile("class", 0, 0, 0).unwrap().unwrap();
        assert_eq!(classes.len(), HEADER_LEN + 257 * 257);
    }

    /// Value `i` of an f32 tile.
    fn value(tile: &[u8], i: usize) -> f32 {
        let at = HEADER_LEN + 4 * i;
        f32::from_le_bytes(tile[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn coarser_zooms_keep_every_second_height_and_the_worst_of_all_else() {
        let grid = Grid { origin: Point2::new(-1.0, -2.0), resolution: 0.1, nx: 700, ny: 300 };
        // A step at one node of the level ground, and a hole.
        let heights = Raster::from_fn(grid, |ix, iy| match (ix, iy) {
            (201, 101) => 0.5,
            (401..420, 101..120) => f32::NAN,
            _ => 0.0,
        });
        let map = ElevationMap::new(heights, Source::plane());
        let store = TerrainStore::new(map, Timestamp(5), 0.9, Limits::default(), 2);
        let version = store.current();
        assert_eq!((version.info.tiles, version.info.zooms), ([3, 2], 3));
        for zoom in 0..3 {
            let step = 1 << zoom;
            let (nx, ny) = (699 / step + 1, 299 / step + 1);
            let tiles = |n: usize| (n - 1_usize).div_ceil(256);
            assert!(version.tile("class", zoom, tiles(nx), 0).unwrap().is_none());
            for (tx, ty) in (0..tiles(nx)).flat_map(|x| (0..tiles(ny)).map(move |y| (x, y))) {
                let of = |layer| version.tile(layer, zoom, tx, ty).unwrap().unwrap();
                let (height, class, slope) = (of("height"), of("class"), of("slope"));
                let size = |at: usize| u32::from_le_bytes(class[at..at + 4].try_into().unwrap());
                let (w, h) = (size(8) as usize, size(12) as usize);
                assert_eq!((w, h), (257.min(nx - 256 * tx), 257.min(ny - 256 * ty)));
                for i in (0..w * h).step_by(13) {
                    let (ix, iy) = ((256 * tx + i % w) * step, (256 * ty + i / w) * step);
                    let z = *version.map.heights().at(ix, iy);
                    assert!(value(&height, i) == z || (value(&height, i).is_nan() && z.is_nan()));
                    let half = step / 2;
                    let near =
                        |i: usize, n: usize| i.saturating_sub(half)..(i + half.max(1)).min(n);
                    let layers = version.layers().unwrap();
                    let cells = || near(iy, 300).flat_map(|y| near(ix, 700).map(move |x| (x, y)));
                    let worst = cells().map(|(x, y)| *layers.class.at(x, y)).min().unwrap();
                    assert_eq!(class[HEADER_LEN + i], worst, "zoom {zoom}, node {ix}, {iy}");
                    let steepest = cells().map(|(x, y)| *layers.slope_rad.at(x, y));
                    let steepest = steepest.fold(0.0, |a: f32, b| {
                        if a.is_nan() || b.is_nan() { f32::NAN } else { a.max(b) }
                    });
                    let found = value(&slope, i);
                    assert!(found == steepest || (found.is_nan() && steepest.is_nan()));
                }
            }
        }
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
