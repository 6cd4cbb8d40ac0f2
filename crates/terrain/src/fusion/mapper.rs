//! All that went into a map, in order; the map after each input; undoing.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::{Point2, Point3, Unit, Vector3};

use super::blend::{self, Stamp};
use super::tile::TILE;
use super::version::{INDEX_MAX, TileIndex, locate};
use super::{
    AlignSettings, Alignment, Cell, Correction, Flags, MapSettings, MapVersion, PairDem,
    StandingWheel, align, align_together,
};
use crate::TerrainError;

/// Most inputs of one map.
const INPUTS_MAX: usize = 100_000;

/// Something that tells of the ground.
#[derive(Debug, Clone)]
pub enum Input {
    /// An imported map: gives way to whatever is seen.
    Prior {
        /// Number of the source.
        source: u32,
        /// The map, on the lattice ([`PairDem::of_map`]).
        dem: Arc<PairDem>,
        /// Time it stands for, on the on-board clock (ns).
        time_ns: i64,
    },
    /// What one camera pair saw.
    Pair {
        /// Number of the source.
        source: u32,
        /// The pair's map, as it was made.
        dem: Arc<PairDem>,
        /// Capture time on the on-board clock (ns).
        time_ns: i64,
        /// By how much it is moved before it is blended, and why.
        alignment: Alignment,
    },
    /// A wheel that stands: the ground is where its lowest point is.
    Contact {
        /// Number of the source.
        source: u32,
        /// Where the wheel touches (m).
        position_m: Point3<f64>,
        /// Upward normal of the ground there.
        normal: Unit<Vector3<f64>>,
        /// Cells within this distance of it (m) are set.
        radius_m: f64,
        /// Variance of the height (m²).
        variance_m2: f64,
        /// Time on the on-board clock (ns).
        time_ns: i64,
    },
    /// A wheel that stands: there is no ground where it is. Of heights that contradict each other in a cell, those in
    /// the wheel are out; ground that was told too high is lowered to below the wheel.
    Stood {
        /// Number of the source.
        source: u32,
        /// The wheel.
        wheel: StandingWheel,
        /// Ground that is higher than it can be by more than this (m) is left as it is.
        most_m: f64,
        /// Variance of what is lowered (m²).
        variance_m2: f64,
        /// Time on the on-board clock (ns).
        time_ns: i64,
    },
    /// The robot moved near: the ground there may have changed.
    Disturbance {
        /// Center (m).
        position_m: Point2<f64>,
        /// Cells within this distance (m) are less sure.
        radius_m: f64,
        /// Variance that is added, q_e (m²).
        variance_m2: f64,
    },
}

impl Input {
    /// Number of its source; a disturbance has none.
    pub fn source(&self) -> Option<u32> {
        match self {
            Input::Prior { source, .. }
            | Input::Pair { source, .. }
            | Input::Contact { source, .. }
            | Input::Stood { source, .. } => Some(*source),
            Input::Disturbance { .. } => None,
        }
    }
}

/// What is told of a pair in the map.
#[derive(Debug, Clone, PartialEq)]
pub struct PairRecord {
    /// Number of the source.
    pub source: u32,
    /// Capture time on the on-board clock (ns).
    pub time_ns: i64,
    /// By how much it was moved, and why.
    pub alignment: Alignment,
}

/// A map with all that went into it.
#[derive(Debug, Clone)]
pub struct Mapper {
    settings: MapSettings,
    inputs: Vec<Input>,
    version: Arc<MapVersion>,
}

impl Mapper {
    /// A map of which nothing is known.
    pub fn new(settings: MapSettings) -> Result<Mapper, TerrainError> {
        settings.check()?;
        let version = Arc::new(MapVersion::empty(settings.resolution_m));
        Ok(Mapper { settings, inputs: Vec::new(), version })
    }

    /// The map that the inputs give, in this order; the same as if they had come one by one.
    pub fn rebuild(settings: MapSettings, inputs: Vec<Input>) -> Result<Mapper, TerrainError> {
        let mut mapper = Mapper::new(settings)?;
        for input in inputs {
            mapper.push(input)?;
        }
        Ok(mapper)
    }

    /// The map as it is.
    pub fn version(&self) -> &Arc<MapVersion> {
        &self.version
    }

    /// How observations are blended.
    pub fn settings(&self) -> &MapSettings {
        &self.settings
    }

    /// All inputs, in order.
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// The pairs in the map, in order.
    pub fn pairs(&self) -> impl Iterator<Item = PairRecord> {
        self.inputs.iter().filter_map(|input| match input {
            Input::Pair { source, time_ns, alignment, .. } => Some(PairRecord {
                source: *source,
                time_ns: *time_ns,
                alignment: alignment.clone(),
            }),
            _ => None,
        })
    }

    /// Aligns a pair with the map as it is, within bounds, and blends it in. A refused alignment
    /// leaves the pair where it says it is.
    pub fn add_pair(
        &mut self,
        source: u32,
        dem: Arc<PairDem>,
        time_ns: i64,
        settings: &AlignSettings,
    ) -> Result<Alignment, TerrainError> {
        self.check_resolution(&dem)?;
        let alignment = align(&dem, &self.version, settings)?;
        self.push(Input::Pair { source, dem, time_ns, alignment: alignment.clone() })?;
        Ok(alignment)
    }

    /// Aligns pairs that were taken from one place with each other and with the map as it is, within bounds, and
    /// blends them in. Refused, and nothing changed, as by [`Mapper::push`].
    pub fn add_pairs(
        &mut self,
        pairs: Vec<(u32, Arc<PairDem>)>,
        time_ns: i64,
        settings: &AlignSettings,
    ) -> Result<Vec<Alignment>, TerrainError> {
        pairs.iter().try_for_each(|(_, dem)| self.check_resolution(dem))?;
        let dems: Vec<&PairDem> = pairs.iter().map(|(_, dem)| dem.as_ref()).collect();
        let alignments = align_together(&dems, &self.version, settings)?;
        let mut next = self.clone();
        for ((source, dem), alignment) in pairs.into_iter().zip(&alignments) {
            next.push(Input::Pair { source, dem, time_ns, alignment: alignment.clone() })?;
        }
        *self = next;
        Ok(alignments)
    }

    /// Adds an input. Refused, and nothing changed, where its source is in the map already, its
    /// resolution is another one, or the map would become too large.
    pub fn push(&mut self, input: Input) -> Result<Arc<MapVersion>, TerrainError> {
        let known = |source| self.inputs.iter().any(|other| other.source() == Some(source));
        if let Some(source_id) = input.source().filter(|source| known(*source)) {
            let mend = "remove it first, or give the input a number of its own";
            return Err(TerrainError::MapSource { source_id, state: "already in", mend });
        }
        let n = self.inputs.len() as f64 + 1.0;
        TerrainError::check(
            "number of inputs",
            n,
            [0.0, INPUTS_MAX as f64],
            "1e5 inputs or fewer",
        )?;
        self.check(&input)?;
        let mut next = MapVersion::clone(&self.version);
        self.apply(&mut next, &input, None)?;
        self.inputs.push(input);
        self.version = Arc::new(next);
        Ok(self.version.clone())
    }

    /// Takes a source out: the map is as if it had never been in. The corrections of other pairs
    /// stay as they were found.
    pub fn remove(&mut self, source: u32) -> Result<Arc<MapVersion>, TerrainError> {
        let i = self.find(source)?;
        let tiles = self.reach(&self.inputs[i]);
        let mut inputs = self.inputs.clone();
        inputs.remove(i);
        self.renew(inputs, &tiles)
    }

    /// Blends a pair by another correction, or none: what undoes an alignment. Its alignment tells
    /// that the operator chose it.
    pub fn correct(
        &mut self,
        source: u32,
        correction: Correction,
    ) -> Result<Arc<MapVersion>, TerrainError> {
        correction.check()?;
        let i = self.find(source)?;
        let mut inputs = self.inputs.clone();
        let Input::Pair { alignment, .. } = &mut inputs[i] else {
            let mend = "only pairs are aligned";
            return Err(TerrainError::MapSource { source_id: source, state: "no pair in", mend });
        };
        *alignment = Alignment { correction, is_chosen: true, ..alignment.clone() };
        let mut tiles = self.reach(&self.inputs[i]);
        tiles.extend(self.reach(&inputs[i]));
        self.renew(inputs, &tiles)
    }

    fn find(&self, source: u32) -> Result<usize, TerrainError> {
        let found = self.inputs.iter().position(|input| input.source() == Some(source));
        let mend = "the pairs of the map tell which are";
        found.ok_or(TerrainError::MapSource { source_id: source, state: "not in", mend })
    }

    fn check_resolution(&self, dem: &PairDem) -> Result<(), TerrainError> {
        let (found_m, expected_m) = (dem.resolution_m(), self.settings.resolution_m);
        if found_m == expected_m {
            return Ok(());
        }
        Err(TerrainError::OtherResolution { found_m, expected_m })
    }

    fn check(&self, input: &Input) -> Result<(), TerrainError> {
        let check = TerrainError::check;
        let limit = 0.5 * self.settings.resolution_m * f64::from(INDEX_MAX);
        let place = |x: f64, y: f64, radius: f64| {
            check("position_m.x", x, [-limit, limit], "a place on the map's lattice")?;
            check("position_m.y", y, [-limit, limit], "a place on the map's lattice")?;
            let most = 1000.0 * self.settings.resolution_m;
            check("radius_m", radius, [0.0, most], "a radius of at most 1000 cells").map(drop)
        };
        match input {
            Input::Prior { dem, .. } => self.check_resolution(dem),
            Input::Pair { dem, alignment, .. } => {
                alignment.correction.check()?;
                self.check_resolution(dem)
            }
            Input::Contact { position_m: p, normal, radius_m, variance_m2, .. } => {
                place(p.x, p.y, *radius_m)?;
                check("position_m.z", p.z, [-1e7, 1e7], "a height within 1e7 m")?;
                check("normal.z", normal.z, [0.1, 1.1], "an upward normal")?;
                check("variance_m2", *variance_m2, [1e-12, 1e4], "a variance up to 1e4 m²")
                    .map(drop)
            }
            Input::Stood { wheel, most_m, variance_m2, .. } => {
                wheel.check(self.settings.resolution_m)?;
                check("most_m", *most_m, [0.0, 1e4], "a height from 0 to 1e4 m")?;
                check("variance_m2", *variance_m2, [1e-12, 1e4], "a variance up to 1e4 m²")
                    .map(drop)
            }
            Input::Disturbance { position_m: p, radius_m, variance_m2 } => {
                place(p.x, p.y, *radius_m)?;
                check("variance_m2", *variance_m2, [0.0, 1e4], "a variance up to 1e4 m²").map(drop)
            }
        }
    }

    /// Takes other inputs, which give other cells in these tiles only. Nothing changes if the map would
    /// become too large.
    fn renew(
        &mut self,
        inputs: Vec<Input>,
        tiles: &BTreeSet<TileIndex>,
    ) -> Result<Arc<MapVersion>, TerrainError> {
        let mut next = MapVersion::empty(self.settings.resolution_m);
        for (index, tile) in self.version.tiles().filter(|(index, _)| !tiles.contains(*index)) {
            next.tiles.insert(*index, tile.clone());
        }
        for input in &inputs {
            if !self.reach(input).is_disjoint(tiles) {
                self.apply(&mut next, input, Some(tiles))?;
            }
        }
        self.inputs = inputs;
        self.version = Arc::new(next);
        Ok(self.version.clone())
    }

    /// The tiles that an input can change.
    fn reach(&self, input: &Input) -> BTreeSet<TileIndex> {
        let (low, high) = match input {
            Input::Prior { dem, .. } => dem.ends(),
            Input::Pair { dem, alignment, .. } => dem.moved_ends(&alignment.correction),
            Input::Contact { position_m, radius_m, .. } => self.disc(position_m.xy(), *radius_m),
            Input::Stood { wheel, .. } => wheel.ends(self.settings.resolution_m),
            Input::Disturbance { position_m, radius_m, .. } => self.disc(*position_m, *radius_m),
        };
        let (low, high) = (locate(low).0, locate(high).0);
        (low[0]..=high[0]).flat_map(|x| (low[1]..=high[1]).map(move |y| [x, y])).collect()
    }

    /// Lattice indices of the square around a disc.
    fn disc(&self, p: Point2<f64>, radius: f64) -> ([i32; 2], [i32; 2]) {
        let c = self.settings.resolution_m;
        let ends = |v: f64| (((v - radius) / c).floor() as i32, ((v + radius) / c).ceil() as i32);
        let ((x0, x1), (y0, y1)) = (ends(p.x), ends(p.y));
        ([x0, y0], [x1, y1])
    }

    /// Changes the cells of a map (in `only` these tiles) by an input.
    fn apply(
        &self,
        map: &mut MapVersion,
        input: &Input,
        only: Option<&BTreeSet<TileIndex>>,
    ) -> Result<(), TerrainError> {
        let settings = &self.settings;
        match input {
            Input::Prior { source, dem, time_ns } => {
                let stamp = Stamp { time_ns: *time_ns, source: *source, is_prior: true, view: 0 };
                blend_in(map, dem, stamp, settings, only)
            }
            Input::Pair { source, dem, time_ns, alignment } => {
                let view = dem.view_bit();
                let stamp = Stamp { time_ns: *time_ns, source: *source, is_prior: false, view };
                if alignment.correction == Correction::NONE {
                    blend_in(map, dem, stamp, settings, only)
                } else {
                    blend_in(map, &dem.moved(&alignment.correction), stamp, settings, only)
                }
            }
            Input::Contact { source, position_m, normal, radius_m, variance_m2, time_ns } => {
                let stamp = Stamp { time_ns: *time_ns, source: *source, is_prior: false, view: 0 };
                let slope = -normal.xy() / normal.z;
                self.within(map, position_m.xy(), *radius_m, only, &mut |cell, offset| {
                    let height = position_m.z + slope.dot(&offset);
                    blend::touch(cell, height, *variance_m2, stamp);
                    true
                })
            }
            Input::Stood { source, wheel, most_m, variance_m2, time_ns } => {
                let stamp = Stamp { time_ns: *time_ns, source: *source, is_prior: false, view: 0 };
                for (index, ceiling) in wheel.ceilings(settings.resolution_m) {
                    let (tile, [x, y]) = locate(index);
                    if only.is_some_and(|only| !only.contains(&tile)) {
                        continue;
                    }
                    let mut cell = map.cell(index);
                    if blend::lower(&mut cell, [ceiling, *most_m], *variance_m2, stamp) {
                        map.tile_mut(tile, settings.tiles_max)?.set(x, y, &cell);
                    }
                }
                Ok(())
            }
            Input::Disturbance { position_m, radius_m, variance_m2 } => {
                self.within(map, *position_m, *radius_m, only, &mut |cell, _| {
                    blend::disturb(cell, *variance_m2);
                    cell.is_ground()
                })
            }
        }
    }

    /// Visits the cells within a radius of a place, with their offset from it (m); a visit tells
    /// whether it changed the cell.
    fn within(
        &self,
        map: &mut MapVersion,
        p: Point2<f64>,
        radius: f64,
        only: Option<&BTreeSet<TileIndex>>,
        visit: &mut dyn FnMut(&mut Cell, nalgebra::Vector2<f64>) -> bool,
    ) -> Result<(), TerrainError> {
        let (low, high) = self.disc(p, radius);
        for iy in low[1]..=high[1] {
            for ix in low[0]..=high[0] {
                let node = Point2::new(f64::from(ix), f64::from(iy)) * self.settings.resolution_m;
                let offset = node - p;
                let (tile, [x, y]) = locate([ix, iy]);
                if offset.norm() > radius || only.is_some_and(|only| !only.contains(&tile)) {
                    continue;
                }
                let mut cell = map.cell([ix, iy]);
                if visit(&mut cell, offset) {
                    map.tile_mut(tile, self.settings.tiles_max)?.set(x, y, &cell);
                }
            }
        }
        Ok(())
    }
}

/// Blends a DEM into a map, tile by tile.
fn blend_in(
    map: &mut MapVersion,
    dem: &PairDem,
    stamp: Stamp,
    settings: &MapSettings,
    only: Option<&BTreeSet<TileIndex>>,
) -> Result<(), TerrainError> {
    let (low, high) = dem.ends();
    let ([x0, y0], [x1, y1]) = (locate(low).0, locate(high).0);
    let n = TILE as i32;
    for index in (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| [x, y])) {
        if only.is_some_and(|only| !only.contains(&index)) {
            continue;
        }
        let first = index.map(|i| i * n);
        let cells = |axis: usize| {
            let [low, high] = [low[axis], high[axis]].map(|i| i - first[axis]);
            low.max(0)..high.min(n - 1) + 1
        };
        let seen = cells(1).flat_map(|y| cells(0).map(move |x| (x, y)));
        let seen = seen.map(|(x, y)| ((x, y), dem.at([first[0] + x, first[1] + y])));
        let mut tells = seen.filter(|(_, cell)| cell.is_ground() || cell.flags != Flags::NONE);
        // A tile that nothing is told of is not made.
        let Some(first_told) = tells.next() else { continue };
        let tile = map.tile_mut(index, settings.tiles_max)?;
        for ((x, y), seen) in std::iter::once(first_told).chain(tells) {
            let mut cell = tile.cell(x as usize, y as usize);
            blend::observe(&mut cell, &seen, stamp, settings);
            tile.set(x as usize, y as usize, &cell);
        }
    }
    Ok(())
}
