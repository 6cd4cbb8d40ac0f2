//! The stateless analyses: a request and its context in, an answer out. HTTP and command line call
//! the same functions, so both give the same JSON. What is computed is in the domain crates; here
//! it is looked up, called and put into the words of the wire.

mod derived;
mod kinematics;
mod plan;
mod plannable;
mod posture;
mod reachability;
mod regions;
mod stability;
mod traversability;

pub use derived::{Site, derive};
pub use kinematics::{inverse_kinematics, kinematics};
pub use plan::{OnProgress, Planned, is_plannable, plan, state_hash};
pub use plannable::plannable;
pub use posture::posture;
pub use reachability::{
    Reached, explain_cell, preference, reachability, reachability_again, reachability_answer,
};
pub use stability::stability;
pub use traversability::{Judged, traversability};
