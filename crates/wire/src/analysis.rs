//! Stateless analyses: arrays in, arrays out; the same bodies over HTTP and on the command line.
//!
//! Every list is bounded ([`STATES_MAX`] and its siblings); what is beyond is refused, not cut.

mod kinematics;
mod plan;
mod posture;
mod reachability;
mod stability;
mod traversability;

pub use kinematics::*;
pub use plan::*;
pub use posture::*;
pub use reachability::*;
pub use stability::*;
pub use traversability::*;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Most states of one request.
pub const STATES_MAX: usize = 10_000;
/// Most targets of one request.
pub const TARGETS_MAX: usize = 10_000;
/// Most cases of one request.
pub const CASES_MAX: usize = 10_000;
/// Most contacts of one case.
pub const CONTACTS_MAX: usize = 64;
/// Most tethers of one case.
pub const TETHERS_MAX: usize = 8;
/// Most obstacles of a scene.
pub const OBSTACLES_MAX: usize = 1_000;
/// Most triangles of all obstacles of a scene.
pub const OBSTACLE_TRIANGLES_MAX: usize = 200_000;
/// Most payloads of a scene.
pub const PAYLOADS_MAX: usize = 100;
/// Shortest and longest deadline (s).
pub const DEADLINE_S: [f64; 2] = [0.001, 3600.0];
/// Deadline where the request gives none (s).
pub const DEADLINE_DEFAULT_S: f64 = 30.0;

/// Bytes as base64 text.
pub fn base64_bytes(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// Numbers as base64 text of their little-endian bytes.
pub fn base64_f32(values: &[f32]) -> String {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    STANDARD.encode(bytes)
}
