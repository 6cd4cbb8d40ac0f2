//! Binary rasters: terrain tiles and reachability grids share one 64-byte header.
//!
//! All little-endian:
//!
//! | offset | type | what |
//! |---|---|---|
//! | 0 | 4 bytes | `FFT1` |
//! | 4 | u16 | format of a value: 0 = u16 height, 1 = f32, 2 = u8 |
//! | 6 | u16 | number of planes that follow, one after the other |
//! | 8 | u32 | nodes along x |
//! | 12 | u32 | nodes along y |
//! | 16 | f64 | x of node (0, 0) (m) |
//! | 24 | f64 | y of node (0, 0) (m) |
//! | 32 | f64 | distance between nodes (m) |
//! | 40 | f64 | height of value 1 of a u16 plane (m); 0 otherwise |
//! | 48 | f64 | meters per step of a u16 plane; 0 otherwise |
//! | 56 | u64 | capture time (ns since 1970); 0 where there is none |
//!
//! Values follow row-major, rows along x, from low to high y. A u16 height of 0 is unknown, else
//! height = z_min + (value - 1) · z_scale. An f32 of NaN is unknown.
//! A reachability grid has format 2 and four blocks: class (u8), reason (u8), missing amount (f32)
//! and margin (f32); the header says 4 planes, and the f32 blocks follow the two u8 blocks, padded
//! with zero bytes to a multiple of 4.

/// Length of the header in bytes.
pub const HEADER_LEN: usize = 64;

/// Cells along each side of a full tile; a tile has one node more, shared with its neighbor.
pub const TILE_CELLS: usize = 256;

/// How a value is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Heights in steps; 0 is unknown.
    U16Height = 0,
    /// Plain values; NaN is unknown.
    F32 = 1,
    /// Classes and reasons.
    U8 = 2,
}

/// What the header says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// How a value is stored.
    pub format: Format,
    /// Number of planes.
    pub planes: u16,
    /// Nodes along x and y.
    pub size: [u32; 2],
    /// Position of node (0, 0) (m).
    pub origin_m: [f64; 2],
    /// Distance between nodes (m).
    pub resolution_m: f64,
    /// Height of value 1 of a u16 plane (m).
    pub z_min_m: f64,
    /// Meters per step of a u16 plane.
    pub z_scale_m: f64,
    /// Capture time (ns since 1970), 0 where there is none.
    pub time_ns: u64,
}

impl Header {
    /// The 64 bytes.
    pub fn encode(&self) -> [u8; HEADER_LEN] {
        let mut out = [0; HEADER_LEN];
        out[..4].copy_from_slice(b"FFT1");
        out[4..6].copy_from_slice(&(self.format as u16).to_le_bytes());
        out[6..8].copy_from_slice(&self.planes.to_le_bytes());
        out[8..12].copy_from_slice(&self.size[0].to_le_bytes());
        out[12..16].copy_from_slice(&self.size[1].to_le_bytes());
        let floats =
            [self.origin_m[0], self.origin_m[1], self.resolution_m, self.z_min_m, self.z_scale_m];
        for (i, value) in floats.iter().enumerate() {
            out[16 + 8 * i..24 + 8 * i].copy_from_slice(&value.to_le_bytes());
        }
        out[56..].copy_from_slice(&self.time_ns.to_le_bytes());
        out
    }
}
