//! Tests of the crate as its users see it.
#![allow(clippy::unwrap_used)]

mod cover;
mod damage;
mod formats;
mod fusion;
mod gdal;
mod hostile;
mod images;
mod large;
mod map;
mod meshes;
mod pairs;
mod pictures;
mod properties;
mod real_files;
mod standing;
mod synthetic;
mod tiff;
mod traversability;
mod update;
