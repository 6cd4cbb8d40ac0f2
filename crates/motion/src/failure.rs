//! Why there is no step, in words with figures.

use collision::{NoTouchdown, Scene, Touch};
use rover::LegId;

use crate::answer::{Constraint, Outcome};
use crate::check::touch_text;
use crate::leg_space::Blocked;
use crate::line::LineError;
use crate::watch::Stopped;

/// Why there is no step. The later in the work it happened, the more it says.
pub(crate) struct Failure {
    pub outcome: Outcome,
    pub reason: String,
    pub rank: u8,
    pub constraint: Option<Constraint>,
}

impl Failure {
    pub fn new(rank: u8, outcome: Outcome, reason: impl Into<String>) -> Failure {
        Failure { outcome, reason: reason.into(), rank, constraint: None }
    }

    /// The same, with what is in the way and how much is missing (m or rad by `unit`).
    pub fn by(self, name: &'static str, missing: Option<f64>, unit: &'static str) -> Failure {
        Failure { constraint: Some(Constraint { name, missing, unit }), ..self }
    }

    /// The same, in the way of which is this.
    pub fn by_blocked(self, blocked: &Blocked) -> Failure {
        match blocked {
            Blocked::Touch(v) => match v.touch {
                Touch::UnknownGround(_) => self.by("unknown_ground", None, "m"),
                _ => self.by("clearance", Some(v.required - v.distance), "m"),
            },
            Blocked::Grazing => self.by("clearance", None, "m"),
            Blocked::Unstable(missing) => self.by("stability", Some(*missing), "m"),
            Blocked::Limits => self.by("joint_limits", None, "rad"),
        }
    }

    /// The one that happened later in the work.
    pub fn or_later(self, other: Failure) -> Failure {
        if other.rank > self.rank { other } else { self }
    }
}

impl From<Stopped> for Failure {
    fn from(stopped: Stopped) -> Failure {
        match stopped {
            Stopped::Deadline => {
                Failure::new(u8::MAX, Outcome::Deadline, "the deadline came before an answer")
            }
            Stopped::Cancelled => {
                Failure::new(u8::MAX, Outcome::Cancelled, "cancelled before an answer")
            }
        }
    }
}

/// Who tells failures: the scene and the leg give the names.
#[derive(Clone, Copy)]
pub(crate) struct Teller<'a> {
    pub scene: &'a Scene,
    pub leg: LegId,
    /// Height of the waypoints (m).
    pub lift: f64,
}

impl Teller<'_> {
    pub fn leg_name(&self) -> &str {
        &self.scene.robot().leg(self.leg).name
    }

    /// The wheel cannot be moved straight up (or down) all the way.
    pub fn line_failure(&self, rank: u8, doing: &str, error: LineError) -> Failure {
        let LineError::OutOfReach { share, distance } = error;
        let height = share * self.lift;
        let why = if distance > 0.0 {
            format!("it is {distance:.2} m out of reach")
        } else {
            "a joint limit is in the way".into()
        };
        let text =
            format!("the wheel can be {doing} by {height:.2} m of {:.2} m, then {why}", self.lift);
        let failure = Failure::new(rank, Outcome::NoLift, text);
        if distance > 0.0 {
            failure.by("reach", Some(distance), "m")
        } else {
            failure.by("joint_limits", None, "rad")
        }
    }

    /// What stands in the way.
    pub fn blocked_text(&self, blocked: &Blocked) -> String {
        match blocked {
            Blocked::Touch(v) if matches!(v.touch, Touch::UnknownGround(_)) => format!(
                "{}, at ({:.2}, {:.2}) m: nobody has seen how high that is, and it is too far from ground that \
                 was seen to be bounded",
                touch_text(self.scene, v.touch),
                v.place.x,
                v.place.y
            ),
            Blocked::Touch(v) => format!(
                "{} are {:.3} m apart where {:.3} m are kept",
                touch_text(self.scene, v.touch),
                v.distance,
                v.required
            ),
            Blocked::Unstable(missing) => {
                format!("the margin rule does not hold, {missing:.3} m are missing")
            }
            Blocked::Grazing => "the leg passes too near to something to be certified".into(),
            Blocked::Limits => "a joint is beyond its limits".into(),
        }
    }

    /// No wheel can be put down at the target.
    pub fn no_touchdown(&self, none: NoTouchdown) -> Failure {
        let leg = self.leg_name();
        let (name, missing, unit) = match none {
            NoTouchdown::UnknownGround => ("unknown_ground", None, "m"),
            NoTouchdown::Uneven { shift } => ("ground", Some(shift), "m"),
            NoTouchdown::OutOfReach { distance } => ("reach", Some(distance), "m"),
            NoTouchdown::JointLimits { overrun } => ("joint_limits", Some(overrun), "rad"),
        };
        let (outcome, text) = match none {
            NoTouchdown::UnknownGround => (
                Outcome::UnknownGround,
                "the ground there is unknown or at the edge of the map".to_string(),
            ),
            NoTouchdown::Uneven { shift } => (
                Outcome::Unreachable,
                format!("the ground there is too uneven: the wheel would stand {shift:.2} m off"),
            ),
            NoTouchdown::OutOfReach { distance } => {
                (Outcome::Unreachable, format!("{distance:.2} m out of the reach of {leg}"))
            }
            NoTouchdown::JointLimits { overrun } => (
                Outcome::Unreachable,
                format!(
                    "a joint of {leg} would be {:.0} deg beyond its limit",
                    overrun.to_degrees()
                ),
            ),
        };
        Failure::new(3, outcome, text).by(name, missing, unit)
    }
}

/// The outcome that what is in the way stands for; `otherwise` for a plain touch or limit.
pub(crate) fn outcome_of(blocked: &Blocked, otherwise: Outcome) -> Outcome {
    match blocked {
        Blocked::Unstable(_) => Outcome::Unstable,
        Blocked::Touch(v) if matches!(v.touch, Touch::UnknownGround(_)) => Outcome::UnknownGround,
        Blocked::Touch(_) | Blocked::Limits | Blocked::Grazing => otherwise,
    }
}
