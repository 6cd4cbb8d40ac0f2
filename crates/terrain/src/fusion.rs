//! The map over time: elevation maps of camera pairs, aligned, blended and remembered.
//!
//! - [`rasterize`] makes the elevation map of one pair ([`PairDem`]) of its points;
//! - [`align()`] finds by how much it is off the map, within bounds, or says why it cannot;
//!   [`align_together`] does so for all pairs of one stand, which are off each other too;
//! - [`Mapper`] keeps all that went into the map and gives a [`MapVersion`] after each input;
//! - a [`MapVersion`] never changes; its tiles are shared with the versions before it, and its name
//!   is the hash of its content.
//!
//! Each cell has height, variance, number of observations, capture time on the on-board clock (ns),
//! source and flags. Age inflates variance and deletes nothing. Cells that the robot hides are
//! unknown, with the ground last seen there kept underneath; cells whose observations contradict
//! each other keep both and are unknown to planners. The same inputs give the same bytes on every
//! machine: cells are blended one by one, in f64, in the order of the inputs.
//!
//! Cells lie on one endless lattice, a node at every whole multiple of the resolution, so that maps
//! of pairs and the map share their nodes.

mod align;
mod blend;
mod mapper;
mod pair;
mod rasterize;
mod settings;
mod standing;
mod tile;
mod together;
mod version;

pub use align::{AlignSettings, Alignment, Correction, Refusal, align};
pub use mapper::{Input, Mapper, PairRecord};
pub use pair::{PairCell, PairDem};
pub use rasterize::{Measurement, RasterizeOptions, Rasterized, Tag, rasterize};
pub use settings::{MapSettings, ReadPolicy};
pub use standing::StandingWheel;
pub use tile::{Cell, Flags, Rival, TILE, Tile};
pub use together::align_together;
pub use version::{Changes, MapVersion, Observed, TileIndex, VersionId};
