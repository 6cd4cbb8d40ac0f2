//! What stands in the way of a pose of the chassis, in words and figures.

use rover::Robot;

use super::chain::Obstruction;
use crate::answer::Constraint;

/// What stands in the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Barrier {
    /// Its kind and how much is missing: `reach`, `joint_limits`, `singularity`, `clearance`, `torque`,
    /// `stability`, `region` (these feet allow no more, whatever the posture) or `search`.
    pub constraint: Constraint,
    /// In a sentence, with names and figures.
    pub text: String,
}

impl Barrier {
    /// Without a figure.
    pub(crate) fn new(name: &'static str, text: impl Into<String>) -> Barrier {
        Barrier { constraint: Constraint { name, missing: None, unit: "m" }, text: text.into() }
    }

    /// With what is missing.
    pub(crate) fn missing(self, missing: f64, unit: &'static str) -> Barrier {
        let missing = missing.is_finite().then_some(missing);
        Barrier { constraint: Constraint { missing, unit, ..self.constraint }, ..self }
    }

    pub(super) fn of(obstruction: Obstruction, robot: &Robot) -> Barrier {
        let text = obstruction.text(robot);
        match obstruction {
            Obstruction::Reach { distance, .. } => {
                Barrier::new("reach", text).missing(distance, "m")
            }
            Obstruction::Limit { beyond, .. } => {
                Barrier::new("joint_limits", text).missing(beyond, "rad")
            }
            Obstruction::Singular { .. } => Barrier::new("singularity", text),
        }
    }

    /// The same, met on the way.
    pub(super) fn on_the_way(self) -> Barrier {
        Barrier { text: format!("on the way {}", self.text), ..self }
    }
}
