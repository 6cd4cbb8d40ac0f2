//! Whether a stance holds: support polygons, margins, settlement, load sharing, joint torques.
//!
//! A stance is a set of contacts and a center of mass (CoM), in the gravity frame `g`: z up, so
//! `world` of the other crates. Meters, newtons, newton meters, radians. Statics only (F9): no
//! dynamics, no I/O, no clock, no random numbers.
//!
//! - [`support_polygon`]: the regular and the conservative polygon (F39, F40), the margin (F41);
//! - [`settlement`]: what is left of the margin when the ground gives way under one foot;
//! - [`force_region`]: where the center of mass may be with limited friction and torque (H7 to H12),
//!   and what is left of it should any one contact be lost;
//! - [`kept_region`]: such a region of friction, kept for moving one contact at a time;
//! - [`contact_forces`]: the smallest forces, those that spare the joints most, the slip margin;
//! - [`energy`]: the work that it takes to tip the rover over (A28 to A32);
//! - [`robust`]: margins with contacts that are not known exactly;
//! - [`loads`]: the vertical forces on the feet, legs taken as springs;
//! - [`torque`]: the joint torques that hold a posture, against their limits;
//! - [`safety`]: whether the joints bear a stance, by both ways to share its load;
//! - [`rule`]: all of these for one posture, and the verdict of the margin rule on them;
//! - [`report`]: friction, forces, torque and energy of one posture;
//! - [`margins`]: all margins over fixed contacts, for many centers of mass;
//! - [`shear`]: what accelerations ask of friction;
//! - [`guard`]: that rule over fixed contacts, prepared for asking it many times.

pub mod contact;
pub mod contact_forces;
pub mod energy;
pub mod force_region;
pub mod guard;
pub mod kept_region;
pub mod loads;
pub mod margins;
pub mod report;
pub mod robust;
pub mod rule;
pub mod safety;
pub mod settlement;
pub mod shear;
mod simplex;
pub mod support_polygon;
pub mod torque;

pub use contact::{ConeBound, ConeModel, Contact, ContactError};
pub use force_region::{ForceRegion, ForceSet};
pub use guard::StanceGuard;
pub use kept_region::KeptRegion;
pub use loads::{StanceSprings, spring_share};
pub use margins::StanceMargins;
pub use report::ForceReport;
pub use rule::{Check, Preference, StanceReport, Verdict, assess, assess_with_friction, verdict};
pub use settlement::Settlement;
pub use shear::{Footholds, Wrench};
pub use support_polygon::{Margin, SupportError};
pub use torque::TorqueReport;
