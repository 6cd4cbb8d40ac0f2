//! Properties of the planar geometry and the rasters against brute force.

mod properties;
