//! The stateless analyses: a request and its context in, an answer out. HTTP and command line call
//! the same functions, so both give the same JSON. What is computed is in the domain crates; here
//! it is looked up, called and put into the words of the wire.

mod kinematics;
mod plan;
mod posture;
mod reachability;
mod stability;
mod traversability;

pub use kinematics::{inverse_kinematics, kinematics};
pub use plan::{OnProgress, Planned, plan, state_hash};
pub use posture::posture;
pub use reachability::{Reached, reachability, reachability_answer};
pub use stability::{derive, stability};
pub use traversability::{Judged, traversability};
