//! Every message that leaves the process: what it holds, its schema, its conversions.
//!
//! Units are in the field names (SI, radians); quaternions are `[x, y, z, w]`; times are RFC 3339
//! UTC with nanoseconds in text and integer nanoseconds in logs. Unknown fields are refused.

pub mod live;
pub mod resources;
pub mod scene;
pub mod tile;
pub mod time;
