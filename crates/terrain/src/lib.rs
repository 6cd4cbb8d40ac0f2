//! Elevation map and its layers, traversability, file formats (bytes in, bytes out), synthetic
//! terrain.
