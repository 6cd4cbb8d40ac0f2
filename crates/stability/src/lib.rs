//! Whether a stance holds: support polygons, margins, settlement, load sharing, joint torques.
//!
//! A stance is a set of contacts and a center of mass (CoM), in the gravity frame `g`: z up, so
//! `world` of the other crates. Meters, newtons, newton meters, radians. Statics only (F9): no
//! dynamics, no I/O, no clock, no random numbers.
//!
//! - [`support_polygon`]: the regular and the conservative polygon (F39, F40), the margin (F41);
//! - [`settlement`]: what is left of the margin when the ground gives way under one foot;
//! - [`loads`]: the vertical forces on the feet, legs taken as equal springs;
//! - [`torque`]: the joint torques that hold a posture, against their limits;
//! - [`rule`]: all of these for one posture, and the verdict of the margin rule on them;
//! - [`guard`]: that rule over fixed contacts, prepared for asking it many times.

pub mod contact;
pub mod contact_forces;
pub mod energy;
pub mod force_region;
pub mod guard;
pub mod loads;
pub mod rule;
pub mod settlement;
mod simplex;
pub mod support_polygon;
pub mod torque;

pub use contact::{ConeBound, ConeModel, Contact, ContactError};
pub use force_region::{ForceRegion, ForceSet};
pub use guard::StanceGuard;
pub use loads::{spring_share, spring_share_with_preload};
pub use rule::{Check, Preference, StanceReport, Verdict, assess, verdict};
pub use settlement::Settlement;
pub use support_polygon::{Margin, SupportError};
pub use torque::TorqueReport;
