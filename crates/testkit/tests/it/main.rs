//! The rules of the house: which crate may import which, what stays out of the domain, and that
//! every file says what it is. They hold for all crates, so they live here.

#![allow(clippy::unwrap_used)]

mod absences;
mod arrows;
mod headers;
mod source;
