//! A square of cells, layer by layer.

use std::collections::BTreeMap;
use std::ops::{BitOr, BitOrAssign};
use std::sync::OnceLock;

/// Cells a side of a tile.
pub const TILE: usize = 256;
const CELLS: usize = TILE * TILE;

/// What there is to know of a cell beyond its numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Flags(pub u8);

impl Flags {
    /// Nothing.
    pub const NONE: Flags = Flags(0);
    /// The robot hides the cell; what is told of its ground is older.
    pub const ROBOT: Flags = Flags(1);
    /// The seam of the robot's image hides the cell.
    pub const SHADOW_BAND: Flags = Flags(2);
    /// Nothing but an imported map tells of the cell.
    pub const PRIOR: Flags = Flags(4);
    /// The cell shows two surfaces; the height is the upper one's.
    pub const MULTI: Flags = Flags(8);
    /// Two observations contradict each other; both are kept.
    pub const CONFLICT: Flags = Flags(16);
    /// The height is where a wheel stood.
    pub const CONTACT: Flags = Flags(32);
    /// Either way of being hidden.
    pub const MASKED: Flags = Flags(3);

    /// True if any of `other` is set.
    pub fn any(self, other: Flags) -> bool {
        self.0 & other.0 != 0
    }

    /// Without `other`.
    #[must_use]
    pub fn without(self, other: Flags) -> Flags {
        Flags(self.0 & !other.0)
    }
}

impl BitOr for Flags {
    type Output = Flags;
    fn bitor(self, other: Flags) -> Flags {
        Flags(self.0 | other.0)
    }
}

impl BitOrAssign for Flags {
    fn bitor_assign(&mut self, other: Flags) {
        self.0 |= other.0;
    }
}

/// The observation that contradicts the one a cell tells of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rival {
    /// Height (m).
    pub height_m: f32,
    /// Variance at its capture (m²).
    pub variance_m2: f32,
    /// As [`Cell::common_m2`].
    pub common_m2: f32,
    /// As [`Cell::repeated_m2`].
    pub repeated_m2: f32,
    /// As [`Cell::views`].
    pub views: u32,
    /// Observations that say so.
    pub count: u16,
    /// Capture time on the on-board clock (ns).
    pub time_ns: i64,
    /// Source.
    pub source: u32,
}

/// All that is known of one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Height (m); NaN where no ground was ever seen.
    pub height_m: f32,
    /// Variance of the height at its capture time (m²).
    pub variance_m2: f32,
    /// Part of it that the views share with themselves: looking again from there does not lessen it (m²).
    pub common_m2: f32,
    /// Part of that which is noise that the same view repeats, and no error that its cells have in common (m²).
    pub repeated_m2: f32,
    /// Views that went into the height, a bit each ([`PairDem::seen_from`](super::PairDem::seen_from)).
    pub views: u32,
    /// Observations that went into the height.
    pub count: u16,
    /// Capture time of the newest of them, on the on-board clock (ns).
    pub time_ns: i64,
    /// Source of the newest of them.
    pub source: u32,
    /// What else there is to know.
    pub flags: Flags,
    /// When the cell was last seen to be hidden (ns); `i64::MIN` if never.
    pub masked_ns: i64,
    /// Height of the lower of two surfaces (m); NaN if there is one.
    pub lower_m: f32,
    /// The observation that contradicts this one.
    pub rival: Option<Rival>,
}

impl Cell {
    /// A cell of which nothing is known.
    pub const UNKNOWN: Cell = Cell {
        height_m: f32::NAN,
        variance_m2: f32::NAN,
        common_m2: 0.0,
        repeated_m2: 0.0,
        views: 0,
        count: 0,
        time_ns: i64::MIN,
        source: 0,
        flags: Flags::NONE,
        masked_ns: i64::MIN,
        lower_m: f32::NAN,
        rival: None,
    };

    /// Variance of its height against that of ground beside it (m²): without what all cells of a view are off by
    /// together, which makes no steps.
    pub fn noise_m2(&self) -> f64 {
        let own = f64::from(self.variance_m2) - f64::from(self.common_m2);
        (own + f64::from(self.repeated_m2)).max(0.0)
    }

    /// True if ground was seen, now or before.
    pub fn is_ground(&self) -> bool {
        !self.height_m.is_nan()
    }
}

/// What few cells have.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Extra {
    lower_m: f32,
    rival: Option<Rival>,
}

/// A square of [`TILE`] x [`TILE`] cells, row by row along x from low to high y.
#[derive(Debug, Clone)]
pub struct Tile {
    height: Vec<f32>,
    variance: Vec<f32>,
    common: Vec<f32>,
    repeated: Vec<f32>,
    views: Vec<u32>,
    count: Vec<u16>,
    time: Vec<i64>,
    source: Vec<u32>,
    flags: Vec<u8>,
    masked: Vec<i64>,
    extras: BTreeMap<u16, Extra>,
    hash: OnceLock<[u8; 32]>,
}

impl Default for Tile {
    fn default() -> Tile {
        let unknown = Cell::UNKNOWN;
        Tile {
            height: vec![unknown.height_m; CELLS],
            variance: vec![unknown.variance_m2; CELLS],
            common: vec![0.0; CELLS],
            repeated: vec![0.0; CELLS],
            views: vec![0; CELLS],
            count: vec![0; CELLS],
            time: vec![unknown.time_ns; CELLS],
            source: vec![0; CELLS],
            flags: vec![0; CELLS],
            masked: vec![unknown.masked_ns; CELLS],
            extras: BTreeMap::new(),
            hash: OnceLock::new(),
        }
    }
}

impl Tile {
    /// The cell in column `x` and row `y`, both under [`TILE`].
    pub fn cell(&self, x: usize, y: usize) -> Cell {
        let i = y * TILE + x;
        let extra = self.extras.get(&(i as u16));
        Cell {
            height_m: self.height[i],
            variance_m2: self.variance[i],
            common_m2: self.common[i],
            repeated_m2: self.repeated[i],
            views: self.views[i],
            count: self.count[i],
            time_ns: self.time[i],
            source: self.source[i],
            flags: Flags(self.flags[i]),
            masked_ns: self.masked[i],
            lower_m: extra.map_or(f32::NAN, |extra| extra.lower_m),
            rival: extra.and_then(|extra| extra.rival),
        }
    }

    /// The heights, row by row (m), hidden and contradicted cells included.
    pub fn heights(&self) -> &[f32] {
        &self.height
    }

    /// Replaces a cell.
    pub(super) fn set(&mut self, x: usize, y: usize, cell: &Cell) {
        let i = y * TILE + x;
        self.height[i] = cell.height_m;
        self.variance[i] = cell.variance_m2;
        self.common[i] = cell.common_m2;
        self.repeated[i] = cell.repeated_m2;
        self.views[i] = cell.views;
        self.count[i] = cell.count;
        self.time[i] = cell.time_ns;
        self.source[i] = cell.source;
        self.flags[i] = cell.flags.0;
        self.masked[i] = cell.masked_ns;
        if cell.lower_m.is_nan() && cell.rival.is_none() {
            self.extras.remove(&(i as u16));
        } else {
            let extra = Extra { lower_m: cell.lower_m, rival: cell.rival };
            self.extras.insert(i as u16, extra);
        }
        self.hash = OnceLock::new();
    }

    /// A hash (BLAKE3) of all that the tile holds: the same on every machine.
    pub fn hash(&self) -> &[u8; 32] {
        self.hash.get_or_init(|| *blake3::hash(&self.to_bytes()).as_bytes())
    }

    /// All that the tile holds, little-endian, layer by layer; every unknown is the same NaN. Left out is which part of
    /// an error in common is noise that repeats: that follows from the same inputs as the rest, and maps of logs from
    /// before it was kept have the same names.
    pub fn to_bytes(&self) -> Vec<u8> {
        let float = |z: &f32| if z.is_nan() { f32::NAN } else { *z + 0.0 }.to_bits().to_le_bytes();
        let mut bytes = Vec::with_capacity(CELLS * 39 + 48 * self.extras.len());
        bytes.extend(self.height.iter().flat_map(float));
        bytes.extend(self.variance.iter().flat_map(float));
        bytes.extend(self.common.iter().flat_map(float));
        bytes.extend(self.views.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(self.count.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(self.time.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(self.source.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(&self.flags);
        bytes.extend(self.masked.iter().flat_map(|v| v.to_le_bytes()));
        for (i, extra) in &self.extras {
            bytes.extend(i.to_le_bytes());
            bytes.extend(float(&extra.lower_m));
            if let Some(rival) = &extra.rival {
                bytes.extend(float(&rival.height_m));
                bytes.extend(float(&rival.variance_m2));
                bytes.extend(float(&rival.common_m2));
                bytes.extend(rival.views.to_le_bytes());
                bytes.extend(rival.count.to_le_bytes());
                bytes.extend(rival.time_ns.to_le_bytes());
                bytes.extend(rival.source.to_le_bytes());
            }
        }
        bytes
    }
}
