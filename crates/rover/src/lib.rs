//! The robot: model from URDF and `robot.toml`, kinematics, mass, torques, shapes.
//!
//! Everything is derived from one model, and the legs' inverse kinematics is found from the joint
//! axes, never from the robot's name. Frames: `world` with z up; the base link x forward, y left,
//! z up (REP 103). Meters, kilograms, radians, newtons. No I/O: who loads a folder hands the text
//! of its files to [`Robot::from_folder`].
//!
//! - [`Robot`]: links, joints, [`Leg`]s, tolerances, poses ([`Robot::scaled`],
//!   [`Robot::with_payloads`]).
//! - [`Configuration`]: base pose and joint angles; [`Posture`]: where every link then is.
//! - [`LegChain`]: one leg's kinematics made fast, and how far its points can get.
//! - [`Sway`]: how far all parts get while the body moves over planted wheels.
//! - [`LegSolver`]: inverse kinematics of a leg: [`LegIk`], all branches of a leg that ends in a
//!   spherical wrist, in closed form; [`NumericalIk`] for every other.
//! - [`WheelPose`]: where a wheel or a ball foot is and where it touches.
//! - [`Mesh`]: the triangles of a link's mesh, and its connected components.

mod chain;
mod compliance;
mod config;
mod ik;
mod mesh;
mod model;
mod posture;
mod shape;
mod statics;
mod sway;
mod urdf;
mod wheel;

pub use chain::{Frame, LegChain, LegFrames, place_of};
pub use compliance::{Compliance, leg_compliance, vertical_stiffness};
pub use config::{MotionLimits, StanceRules, Tolerances, toml_message};
pub use ik::{
    Branch, FootTarget, IkSolution, IkSolutions, LegIk, LegSolver, MAX_SOLUTIONS, NoSolution,
    NumericalIk, Proof, Residual,
};
pub use mesh::{MESH_BYTES_MAX, MESH_COMPONENTS_MAX, MESH_TRIANGLES_MAX, Mesh, MeshError};
pub use model::{
    Joint, JointKind, JointRange, Leg, LegId, Link, LinkId, ModelError, Payload, Robot,
};
pub use posture::{Configuration, LegAngles, Posture};
pub use shape::{LinkShape, Shape};
pub use statics::{Wrench, hold_torques};
pub use sway::{Anchor, BodyChain, BodyMotion, Sway};
pub use urdf::MAX_LINKS;
pub use wheel::{Wheel, WheelPose};
