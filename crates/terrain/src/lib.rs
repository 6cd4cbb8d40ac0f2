//! Elevation map and its layers, traversability, file formats, synthetic terrain.
//!
//! Heights are in meters over a local, z-up `world` frame; they lie on the nodes of a
//! [`geometry::Grid`], and NaN means unknown. Unknown stays unknown: nothing here fills a hole.
//!
//! - [`ElevationMap`]: an immutable map, cheap to clone, with where it came from;
//! - [`traversability`]: where a foot of a given size can stand, after Morphin;
//! - [`formats`]: GeoTIFF and OFF meshes, bytes in and bytes out;
//! - [`fusion`]: the map over time: camera pairs aligned, blended, remembered;
//! - [`synthetic`]: fractal ground with rocks and craters, from a recipe and a seed.
//!
//! No I/O, no clock; the only random numbers are ChaCha streams of a given seed.

pub mod cover;
mod error;
pub mod formats;
pub mod fusion;
mod map;
mod plane;
mod reference_system;
pub mod synthetic;
pub mod traversability;

pub use error::TerrainError;
pub use map::{
    ElevationMap, FootprintPlane, MAX_NODES, PLANE_HALF_EXTENT_M, PLANE_RESOLUTION_M, Placement,
    Source, SourceKind,
};
pub use reference_system::ReferenceSystem;
