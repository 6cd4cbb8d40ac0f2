//! Angles, convex polygons, rasters and the height-field pyramid.
//!
//! The lowest crate of the house: it imports nothing of it. Lengths in meters, angles in radians,
//! `f64` unless a type says otherwise. No I/O, no clock, no globals.

mod angle;
mod convex_polygon;
mod pyramid;
mod raster;

pub use angle::{within_limits, wrap_to_pi};
pub use convex_polygon::{ConvexPolygon, ConvexRegion};
pub use pyramid::{Block, MaxPyramid};
pub use raster::{Grid, Raster};
