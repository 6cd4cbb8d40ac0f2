//! Plans of the live rover: kept so that their commands can be staged, and checked against what
//! they rest on before anything is armed or sent.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use rover::{Configuration, Robot};
use wire::analysis::PlanAnswer;
use wire::check::At;
use wire::convert;
use wire::live::{CommandBody, JointKnot, RoverTelemetry};

use crate::error::ApiError;

/// Plans kept.
const PLANS_MAX: usize = 200;
/// How far a joint may be from where a plan took it to be (rad).
pub const BASIS_JOINT_RAD: f64 = 0.01;
/// How far the base may be from there (m).
const BASIS_BASE_M: f64 = 0.01;
/// How far the base may be turned from there (rad).
const BASIS_BASE_RAD: f64 = 0.01;

/// A plan with what it was made from.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPlan {
    /// The plan.
    pub answer: PlanAnswer,
    /// The state it starts from.
    pub start: Configuration,
}

/// The plans kept.
#[derive(Default)]
pub struct Plans(Mutex<BTreeMap<String, Arc<StoredPlan>>>);

impl Plans {
    /// Keeps a plan under its id; the oldest gives way.
    pub fn put(&self, id: &str, plan: StoredPlan) {
        let mut plans = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        while plans.len() >= PLANS_MAX {
            plans.pop_first();
        }
        plans.insert(id.into(), Arc::new(plan));
    }

    /// A plan by its id.
    pub fn get(&self, id: &str) -> Result<Arc<StoredPlan>, ApiError> {
        let plans = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        plans.get(id).cloned().ok_or_else(|| {
            ApiError::new("plan_unknown", "there is no such plan; only the newest ones are kept")
        })
    }
}

/// What a plan's basis is checked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// A command is staged: the ones before it in its plan may still be under way, so the moving
    /// leg may be anywhere.
    Staging,
    /// It is armed or sent: all must be as planned.
    Release,
}

/// What the world is now, for the check of a basis.
pub struct Present<'a> {
    /// The live robot.
    pub robot: &'a Robot,
    /// Version stamp of the live robot.
    pub model_hash: &'a str,
    /// The map in use.
    pub terrain_version: &'a str,
    /// The last frame.
    pub frame: &'a RoverTelemetry,
}

impl StoredPlan {
    /// Where the legs are when the command of this index begins.
    pub fn joints_before(&self, robot: &Robot, index: usize) -> Configuration {
        let mut configuration = self.start.clone();
        let body = self.answer.commands.get(index).map(|command| &command.body);
        if let Some(CommandBody::JointPath { leg, knots }) = body
            && let (Some(leg), Some(JointKnot { joints_rad, .. })) =
                (robot.leg_id(leg), knots.first())
            && joints_rad.len() == robot.leg(leg).n_joints()
        {
            configuration.legs[leg.0].as_mut_slice()[..joints_rad.len()]
                .copy_from_slice(joints_rad);
        }
        configuration
    }

    /// Why the plan may not be used for its command of this index now; `None` if it may.
    pub fn stale(&self, present: &Present<'_>, index: usize, when: When) -> Option<String> {
        let basis = &self.answer.basis;
        if basis.model_hash != present.model_hash {
            return Some("the robot model or its payload has changed".into());
        }
        if basis.terrain_version != present.terrain_version {
            return Some("the map has a new version".into());
        }
        let at = At::root("state");
        let Ok(now) = convert::configuration(&at, present.robot, &present.frame.state) else {
            return Some("the rover's state cannot be read".into());
        };
        let expected = self.joints_before(present.robot, index);
        let moved = expected.world_from_base.inverse() * now.world_from_base;
        if moved.translation.vector.norm() > BASIS_BASE_M || moved.rotation.angle() > BASIS_BASE_RAD
        {
            return Some("the rover's body has moved".into());
        }
        let legs = present.robot.legs().iter().zip(expected.legs.iter().zip(&now.legs));
        for (leg, (expected, now)) in legs {
            if when == When::Staging && leg.name == self.answer.leg {
                continue;
            }
            let off = (expected - now).amax();
            if off > BASIS_JOINT_RAD {
                return Some(format!(
                    "{} is {off:.3} rad from where the plan takes it to be",
                    leg.name
                ));
            }
        }
        None
    }
}
