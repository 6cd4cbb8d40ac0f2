//! Distances of robot, terrain and obstacles. The only crate that uses parry.
//!
//! Ground and obstacles are solid: what lies below the surface, however deep, or inside a rock is
//! colliding. *Colliding* is distance zero; keeping a tolerance is a separate verdict (F65, F66).
//! Frame `world`, meters.
//!
//! - [`Scene`]: robot, map and obstacles, prepared once.
//! - [`LegChecker`]: one moving leg against everything else, with the rest of the robot cached.
//! - [`Certifier`]: is a motion of that leg free, at every resolution?
//! - [`BodyCertifier`]: is a shift of the whole body free?
//! - [`survey`]: the whole robot in one posture.
//! - [`QuickChecker`]: that leg in many configurations that are much alike.
//! - [`Footings`]: the orientations in which a wheel may be put down, place by place.
//! - [`over_unknown`]: what of a leg is over ground that nobody has seen.
//! - [`touchdowns`]: ways to put a wheel down at a place of the map.
//! - [`wheel_ground`]: how high a wheel is above the ground and where it would touch.

mod bisection;
mod body;
mod certificate;
mod checker;
mod clearance;
mod follow;
mod footing;
mod form;
mod gjk;
mod ground;
mod look;
mod odometer;
mod pairs;
mod quick;
mod scene;
mod solid;
mod survey;
mod touchdown;
mod unknown;
mod wheel;
mod yaws;

pub use body::BodyCertifier;
pub use certificate::{Certificate, Certifier};
pub use checker::{Allowance, ContactZone, Keep, LegChecker, Touch, Violation};
pub use clearance::{Clearance, Reach};
pub use follow::Follower;
pub use footing::{Footing, Footings, NoSeat, Seat, WheelHeading};
pub use pairs::Body;
pub use quick::{FootTouch, Hint, QuickChecker};
pub use scene::{Obstacle, Scene, SceneError};
pub use survey::{PairDistance, Survey, ground_normal, survey};
pub use touchdown::{
    FootfallPlace, NoTouchdown, Touchdown, footfall_place, no_touchdown, touchdown_cost, touchdowns,
};
pub use unknown::{OverUnknown, over_unknown};
pub use wheel::{WheelGap, WheelGround, contact_center, wheel_ground};
