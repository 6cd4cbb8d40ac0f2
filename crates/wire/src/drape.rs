//! What can be laid over the ground: the texture of camera images, and imported rasters.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Texels along a side of a tile.
pub const TILE_TEXELS: usize = 256;

/// Where the texels of a drape lie. Tile (x, y) has those from (256 x, 256 y) on, counted from the least x and
/// y, as a PNG whose first row is that of the greatest y.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DrapeShape {
    /// Outer corner of the first texel: least x and y in `world` (m).
    pub origin_m: [f64; 2],
    /// Side of a texel (m).
    pub texel_m: f64,
    /// Texels along x and y.
    pub size: [usize; 2],
    /// Tiles along x and y.
    pub tiles: [usize; 2],
}

/// One image of a texture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TextureView {
    /// The stereo pair; its left image.
    pub pair: String,
    /// The capture.
    pub capture: String,
    /// Number of the capture among the map's sources.
    pub source: u32,
    /// What its gray values were multiplied by, so that images agree where they overlap.
    pub gain: f64,
    /// Share of the texture where it counts most.
    pub share: f64,
}

/// Camera images laid over a version of the map: gray with alpha, transparent where no image shows ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TextureAnswer {
    /// The version of the map.
    pub terrain_version: String,
    /// Where it lies.
    pub shape: DrapeShape,
    /// Share of its texels that are known.
    pub known_share: f64,
    /// The images it is made of.
    pub views: Vec<TextureView>,
}

/// Asks to lay a raster over the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct OverlayRequest {
    /// A GeoTIFF of the terrain folder, in the coordinates of the file that the map was made from.
    pub file: String,
}

/// A raster that can be laid over the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OverlayAnswer {
    /// What it is called in routes.
    pub id: String,
    /// The file.
    pub file: String,
    /// Where it lies.
    pub shape: DrapeShape,
    /// Is it gray?
    pub gray: bool,
    /// Values that became black and white, where its samples are no bytes.
    pub stretch: Option<[f64; 2]>,
    /// Share of its texels that are known.
    pub known_share: f64,
}

/// All rasters that can be laid over the ground, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OverlayList {
    /// The rasters.
    pub overlays: Vec<OverlayAnswer>,
}
