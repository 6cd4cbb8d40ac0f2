//! Every message that leaves the process: what it holds, its schema, its conversions.
//!
//! Units are in the field names (SI, radians); quaternions are `[x, y, z, w]`; times are RFC 3339
//! UTC with nanoseconds in text and integer nanoseconds in logs. Unknown fields are refused.

//!
//! Requests are checked by name ([`check`]) before they become values of the domain ([`convert`]).

pub mod admin;
pub mod analysis;
pub mod check;
pub mod convert;
pub mod drape;
pub mod dry_run;
pub mod foxglove;
pub mod live;
pub mod map_version;
pub mod precondition;
pub mod reconstruction;
pub mod resources;
pub mod scene;
pub mod tile;
pub mod time;
