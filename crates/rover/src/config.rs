//! `robot.toml`: what a URDF cannot say.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::model::ModelError;

/// How fast the robot moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Fastest motion of any joint while walking (rad/s).
    pub joint_speed: f64,
}

/// When a wheel stands, and what a step must keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StanceRules {
    /// Smallest regular margin over the standing feet, m1 (m).
    pub margin: f64,
    /// Settlement of any one standing foot that must be survived, s (m).
    pub settlement: f64,
    /// A wheel nearer to the ground stands; deeper it collides (m).
    pub ground_tolerance: f64,
    /// A wheel may touch the ground within this radius of its contact (m).
    pub contact_radius: f64,
    /// ... and below this height above it (m).
    pub contact_height: f64,
    /// Largest tilt of the axle against the ground at touch-down (rad).
    pub camber_limit: f64,
}

/// Clearance that planned motion keeps (m), by pair of bodies (F65, F66).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerances {
    /// Any pair not named below.
    pub pair: f64,
    /// Bodies of one leg.
    pub within_leg: f64,
    /// Base and thigh (second link of a leg).
    pub base_thigh: f64,
    /// Base and the link that carries the wheel, or the wheel.
    pub base_wheel: f64,
    /// Bodies of different legs.
    pub leg_leg: f64,
    /// Any body and terrain or obstacles.
    pub environment: f64,
}

impl StanceRules {
    pub(crate) fn scaled(&self, factor: f64) -> StanceRules {
        StanceRules {
            margin: self.margin * factor,
            settlement: self.settlement * factor,
            ground_tolerance: self.ground_tolerance * factor,
            contact_radius: self.contact_radius * factor,
            contact_height: self.contact_height * factor,
            camber_limit: self.camber_limit,
        }
    }
}

impl Tolerances {
    pub(crate) fn scaled(&self, factor: f64) -> Tolerances {
        Tolerances {
            pair: self.pair * factor,
            within_leg: self.within_leg * factor,
            base_thigh: self.base_thigh * factor,
            base_wheel: self.base_wheel * factor,
            leg_leg: self.leg_leg * factor,
            environment: self.environment * factor,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RobotToml {
    pub name: String,
    pub urdf: String,
    pub base_link: String,
    motion: MotionToml,
    stance: StanceToml,
    tolerances: TolerancesToml,
    #[serde(default)]
    poses: BTreeMap<String, PoseToml>,
    pub legs: Vec<LegToml>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionToml {
    joint_speed_rad_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StanceToml {
    margin_m: f64,
    settlement_m: f64,
    ground_tolerance_m: f64,
    contact_radius_m: f64,
    contact_height_m: f64,
    camber_limit_rad: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TolerancesToml {
    pair_m: f64,
    within_leg_m: f64,
    base_thigh_m: f64,
    base_wheel_m: f64,
    leg_leg_m: f64,
    environment_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseToml {
    joints_rad: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LegToml {
    pub name: String,
    pub joints: Vec<String>,
    pub wheel_joint: String,
    pub wheel_radius_m: f64,
    pub wheel_width_m: f64,
}

impl RobotToml {
    pub(crate) fn parse(text: &str) -> Result<RobotToml, ModelError> {
        let parsed: RobotToml = toml::from_str(text)
            .map_err(|e| ModelError::Toml { message: e.to_string().trim_end().to_string() })?;
        parsed.check()?;
        Ok(parsed)
    }

    fn check(&self) -> Result<(), ModelError> {
        let (m, s, t) = (&self.motion, &self.stance, &self.tolerances);
        let positive = [
            ("motion.joint_speed_rad_s", m.joint_speed_rad_s),
            ("stance.ground_tolerance_m", s.ground_tolerance_m),
            ("stance.contact_radius_m", s.contact_radius_m),
        ];
        let not_negative = [
            ("stance.margin_m", s.margin_m),
            ("stance.settlement_m", s.settlement_m),
            ("stance.contact_height_m", s.contact_height_m),
            ("stance.camber_limit_rad", s.camber_limit_rad),
            ("tolerances.pair_m", t.pair_m),
            ("tolerances.within_leg_m", t.within_leg_m),
            ("tolerances.base_thigh_m", t.base_thigh_m),
            ("tolerances.base_wheel_m", t.base_wheel_m),
            ("tolerances.leg_leg_m", t.leg_leg_m),
            ("tolerances.environment_m", t.environment_m),
        ];
        let sizes = self.legs.iter().flat_map(|leg| {
            [("legs.wheel_radius_m", leg.wheel_radius_m), ("legs.wheel_width_m", leg.wheel_width_m)]
        });
        for (field, value) in positive.into_iter().chain(sizes) {
            if !(value.is_finite() && value > 0.0) {
                return Err(ModelError::NotPositive { field, value });
            }
        }
        for (field, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return Err(ModelError::Negative { field, value });
            }
        }
        Ok(())
    }

    pub(crate) fn motion(&self) -> MotionLimits {
        MotionLimits { joint_speed: self.motion.joint_speed_rad_s }
    }

    pub(crate) fn stance(&self) -> StanceRules {
        let s = &self.stance;
        StanceRules {
            margin: s.margin_m,
            settlement: s.settlement_m,
            ground_tolerance: s.ground_tolerance_m,
            contact_radius: s.contact_radius_m,
            contact_height: s.contact_height_m,
            camber_limit: s.camber_limit_rad,
        }
    }

    pub(crate) fn tolerances(&self) -> Tolerances {
        let t = &self.tolerances;
        Tolerances {
            pair: t.pair_m,
            within_leg: t.within_leg_m,
            base_thigh: t.base_thigh_m,
            base_wheel: t.base_wheel_m,
            leg_leg: t.leg_leg_m,
            environment: t.environment_m,
        }
    }

    pub(crate) fn poses(&self) -> impl Iterator<Item = (&str, &[f64])> {
        self.poses.iter().map(|(name, pose)| (name.as_str(), pose.joints_rad.as_slice()))
    }
}
