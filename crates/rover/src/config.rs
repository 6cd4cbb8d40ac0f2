//! `robot.toml`: what a URDF cannot say.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::compliance::Compliance;
use crate::model::ModelError;
use crate::posture::LegAngles;

/// How fast the robot moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Fastest motion of any joint while walking (rad/s; m/s for a prismatic joint).
    pub joint_speed: f64,
    /// Largest acceleration of any joint while walking (rad/s²; m/s² for a prismatic joint).
    pub joint_acceleration: f64,
}

/// Joint acceleration where `robot.toml` gives none (rad/s²).
const JOINT_ACCELERATION: f64 = 0.2;

/// Standard gravity (m/s²).
const STANDARD_GRAVITY: f64 = 9.80665;

/// Deflection of a leg under its share of the robot's weight on Earth, as a share of the leg's
/// reach, where `robot.toml` gives no stiffness: 0.10 m for `athlete` (F83).
const NOMINAL_DEFLECTION: f64 = 0.044;

/// How well stiffness is known where `robot.toml` does not say it.
const STIFFNESS_ERROR: f64 = 0.2;

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
    /// Vertical stiffness of a leg with its tire, load over deflection (N/m): one figure for all legs
    /// and postures. Where joints and tire are told, that of the first named pose, by alphabet.
    pub leg_stiffness: f64,
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
            // Loads stay and lengths scale: the deflection keeps its share of the leg.
            leg_stiffness: self.leg_stiffness / factor,
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
    compliance: ComplianceToml,
    #[serde(default)]
    poses: BTreeMap<String, PoseToml>,
    pub legs: Vec<LegToml>,
    /// Read by `stereo`.
    #[serde(default, rename = "camera_pairs")]
    _camera_pairs: serde::de::IgnoredAny,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionToml {
    joint_speed_rad_s: f64,
    joint_acceleration_rad_s2: Option<f64>,
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
    leg_stiffness_n_m: Option<f64>,
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

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct ComplianceToml {
    joint_stiffness_nm_rad: Option<Vec<f64>>,
    tire_stiffness_n_m: Option<f64>,
    stiffness_error: Option<f64>,
    touchdown_error_m: Option<f64>,
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
    wheel_joint: Option<String>,
    wheel_radius_m: Option<f64>,
    wheel_width_m: Option<f64>,
    foot_link: Option<String>,
    foot_radius_m: Option<f64>,
    foot_offset_m: Option<[f64; 3]>,
}

/// What a leg stands on.
pub(crate) enum FootToml<'a> {
    Wheel { joint: &'a str, radius: f64, width: f64 },
    Ball { link: &'a str, radius: f64, offset: [f64; 3] },
}

impl LegToml {
    pub(crate) fn foot(&self) -> Result<FootToml<'_>, ModelError> {
        let wheel = (&self.wheel_joint, self.wheel_radius_m, self.wheel_width_m);
        let ball = (&self.foot_link, self.foot_radius_m, self.foot_offset_m);
        match (wheel, ball) {
            ((Some(joint), Some(radius), Some(width)), (None, None, None)) => {
                Ok(FootToml::Wheel { joint, radius, width })
            }
            ((None, None, None), (Some(link), Some(radius), offset)) => {
                Ok(FootToml::Ball { link, radius, offset: offset.unwrap_or_default() })
            }
            _ => Err(ModelError::LegFoot { leg: self.name.clone() }),
        }
    }
}

impl RobotToml {
    pub(crate) fn parse(text: &str) -> Result<RobotToml, ModelError> {
        let parsed: RobotToml = toml::from_str(text)
            .map_err(|e| ModelError::Toml { message: toml_message(text, &e) })?;
        parsed.check()?;
        Ok(parsed)
    }

    fn check(&self) -> Result<(), ModelError> {
        let (m, s, t, c) = (&self.motion, &self.stance, &self.tolerances, &self.compliance);
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
            ("compliance.touchdown_error_m", c.touchdown_error_m.unwrap_or(0.0)),
        ];
        let sizes = self.legs.iter().flat_map(|leg| {
            [
                ("legs.wheel_radius_m", leg.wheel_radius_m),
                ("legs.wheel_width_m", leg.wheel_width_m),
                ("legs.foot_radius_m", leg.foot_radius_m),
            ]
        });
        if c.tire_stiffness_n_m.is_some() && c.joint_stiffness_nm_rad.is_none() {
            return Err(ModelError::TireAlone);
        }
        let joints = c.joint_stiffness_nm_rad.iter().flatten();
        let joints = joints.map(|k| ("compliance.joint_stiffness_nm_rad", Some(*k)));
        let error = c.stiffness_error.unwrap_or(STIFFNESS_ERROR);
        if !(0.0..1.0).contains(&error) {
            return Err(ModelError::StiffnessError { value: error });
        }
        let optional = [
            ("compliance.tire_stiffness_n_m", c.tire_stiffness_n_m),
            ("motion.joint_acceleration_rad_s2", m.joint_acceleration_rad_s2),
            ("stance.leg_stiffness_n_m", s.leg_stiffness_n_m),
        ];
        let given =
            sizes.chain(optional).chain(joints).filter_map(|(field, value)| Some((field, value?)));
        for (field, value) in positive.into_iter().chain(given) {
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
        MotionLimits {
            joint_speed: self.motion.joint_speed_rad_s,
            joint_acceleration: (self.motion.joint_acceleration_rad_s2)
                .unwrap_or(JOINT_ACCELERATION),
        }
    }

    /// The rules for a robot of this mass (kg) on legs of this mean reach (m).
    pub(crate) fn stance(&self, mass: f64, reach: f64) -> StanceRules {
        let s = &self.stance;
        StanceRules {
            margin: s.margin_m,
            settlement: s.settlement_m,
            ground_tolerance: s.ground_tolerance_m,
            contact_radius: s.contact_radius_m,
            contact_height: s.contact_height_m,
            camber_limit: s.camber_limit_rad,
            leg_stiffness: s.leg_stiffness_n_m.unwrap_or_else(|| {
                let share = mass * STANDARD_GRAVITY / self.legs.len().max(1) as f64;
                let stiffness = share / (NOMINAL_DEFLECTION * reach);
                // Without mass any stiffness will do.
                if stiffness.is_finite() && stiffness > 0.0 { stiffness } else { 1.0 }
            }),
        }
    }

    /// Springs for legs of so many joints; the error names a leg with another number. Where the single
    /// figure for a whole leg is given, it stands.
    pub(crate) fn compliance<'a>(
        &self,
        mut legs: impl Iterator<Item = (&'a str, usize)>,
    ) -> Result<Compliance, ModelError> {
        let c = &self.compliance;
        let joints = c.joint_stiffness_nm_rad.as_deref();
        let n_joints = joints.map_or(0, <[f64]>::len);
        if joints.is_some()
            && let Some((leg, wanted)) = legs.find(|(_, n)| *n != n_joints)
        {
            return Err(ModelError::JointStiffness { n_joints, leg: leg.into(), wanted });
        }
        let joints = joints.filter(|_| self.stance.leg_stiffness_n_m.is_none());
        let springs = joints.map(|given| {
            // A leg has no joints beyond its own.
            let by_place = LegAngles::from_fn(|i, _| given.get(i).copied().unwrap_or(1.0));
            (by_place, c.tire_stiffness_n_m.unwrap_or(f64::INFINITY))
        });
        Ok(Compliance {
            springs,
            stiffness_error: c.stiffness_error.unwrap_or(STIFFNESS_ERROR),
            touchdown_error: c.touchdown_error_m,
        })
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

/// What is wrong with a TOML text, for messages: with the line itself unless that is long.
pub fn toml_message(text: &str, error: &toml::de::Error) -> String {
    const MESSAGE_MAX: usize = 800;
    let whole = error.to_string();
    if whole.len() <= MESSAGE_MAX {
        return whole.trim_end().to_owned();
    }
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = before.map_or(1, |before| before.matches('\n').count() + 1);
    let what: String = error.message().chars().take(300).collect();
    format!("line {line}: {what}")
}
