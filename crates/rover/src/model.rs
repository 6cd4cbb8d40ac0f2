//! The robot model: links, joints, legs.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::config::{MotionLimits, RobotToml, StanceRules, Tolerances};
use crate::ik::LegIk;
use crate::posture::{Configuration, LegAngles};
use crate::shape::{LinkShape, Shape, scaled_isometry};
use crate::urdf;
use crate::wheel::Wheel;

/// Index of a link; 0 is the base.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LinkId(pub usize);

/// Index of a leg, from 0 in the order of `robot.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LegId(pub usize);

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Not at all.
    Fixed,
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
}

/// A joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Link on the base's side.
    pub parent: LinkId,
    /// Link on the far side.
    pub child: LinkId,
    /// Pose of the joint (and of the child at angle zero) in the parent.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis in the joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// How it moves.
    pub kind: JointKind,
    /// Lower limit (rad).
    pub lower: f64,
    /// Upper limit (rad).
    pub upper: f64,
    /// Torque limit (N m).
    pub effort: f64,
}

/// A link.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name in the URDF.
    pub name: String,
    /// Index of the joint that carries it; none for the base.
    pub parent_joint: Option<usize>,
    /// Mass with payloads (kg).
    pub mass: f64,
    /// Center of mass in the link's frame, with payloads (m).
    pub com: Point3<f64>,
    /// Shapes for collision, with payloads.
    pub shapes: Vec<LinkShape>,
}

/// A leg: six joints from the hip outward, and a wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// Name in `robot.toml`.
    pub name: String,
    /// Indices of its joints, from the hip outward.
    pub joints: [usize; 6],
    /// The links these joints carry, in the same order.
    pub links: [LinkId; 6],
    /// The wheel's link.
    pub wheel_link: LinkId,
    /// Index of the wheel's joint.
    pub wheel_joint: usize,
    /// The wheel, carried by the last of `links`.
    pub wheel: Wheel,
    /// Lower limits (rad).
    pub lower: LegAngles,
    /// Upper limits (rad).
    pub upper: LegAngles,
    /// Torque limits (N m).
    pub effort: LegAngles,
    /// Closed-form inverse kinematics.
    pub ik: LegIk,
}

/// A mass fixed to a link for a mission (F92).
#[derive(Debug, Clone, PartialEq)]
pub struct Payload {
    /// The link that carries it.
    pub link: String,
    /// Mass (kg).
    pub mass: f64,
    /// Center of mass in the link's frame (m).
    pub com: Point3<f64>,
    /// Edges of a box around the center of mass (m), axis-parallel in the link's frame.
    pub box_size: Option<Vector3<f64>>,
}

/// Why a robot's folder, scale or payload was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum ModelError {
    #[error("robot.toml: {message}")]
    Toml { message: String },
    #[error("robot.toml: {field} is {value}, but must be finite and above zero")]
    NotPositive { field: &'static str, value: f64 },
    #[error("robot.toml: {field} is {value}, but must be finite and not negative")]
    Negative { field: &'static str, value: f64 },
    #[error("the URDF has {bytes} bytes; the limit is {limit}")]
    UrdfTooLarge { bytes: usize, limit: usize },
    #[error("the URDF holds a document type or an entity; remove it")]
    DocumentType,
    #[error("the URDF has {n_links} links; the limit is {limit}")]
    TooManyLinks { n_links: usize, limit: usize },
    #[error("the URDF cannot be read: {message}")]
    UrdfSyntax { message: String },
    #[error("the URDF names the {kind} {name:?} twice")]
    DuplicateName { kind: &'static str, name: String },
    #[error("there is no link {name:?} in the URDF")]
    UnknownLink { name: String },
    #[error("there is no joint {name:?} in the URDF")]
    UnknownJoint { name: String },
    #[error("the link {link:?} has two parent joints")]
    TwoParents { link: String },
    #[error("the base link is the child of joint {joint:?}; name the root link in robot.toml")]
    BaseHasParent { joint: String },
    #[error(
        "the link {link:?} does not hang on the base link: it is part of a cycle or of a second tree"
    )]
    NotATree { link: String },
    #[error("the {what} of {name:?} is {value}; it must be finite")]
    NotFinite { what: String, name: String, value: f64 },
    #[error("the link {link:?} has the negative mass {mass} kg")]
    NegativeMass { link: String, mass: f64 },
    #[error("the link {link:?} names the mesh {file:?}, which is not in the robot's folder")]
    MissingMesh { link: String, file: String },
    #[error(
        "the link {link:?} has the mesh {file:?} as its shape; use boxes, cylinders, capsules or spheres"
    )]
    MeshShape { link: String, file: String },
    #[error("a shape of the link {link:?} has a size that is zero or negative")]
    ShapeSize { link: String },
    #[error("the joint {joint:?} is neither fixed, revolute nor continuous")]
    JointKind { joint: String },
    #[error("the joint {joint:?} has no axis")]
    NoAxis { joint: String },
    #[error("the joint {joint:?} has its lower limit {lower} above its upper limit {upper}")]
    Limits { joint: String, lower: f64, upper: f64 },
    #[error("the robot has {n_legs} legs in robot.toml; 1 to 16 are supported")]
    LegCount { n_legs: usize },
    #[error(
        "the leg {leg:?} has {n_joints} joints in robot.toml; legs of six revolute joints are supported"
    )]
    LegJoints { leg: String, n_joints: usize },
    #[error(
        "the joints of leg {leg:?} do not follow each other from the base outward: {joint:?} does not hang on the one before it"
    )]
    LegChain { leg: String, joint: String },
    #[error("the joint {joint:?} of leg {leg:?} must be revolute with limits")]
    LegJointKind { leg: String, joint: String },
    #[error(
        "the wheel joint {joint:?} of leg {leg:?} must be continuous, on the leg's last link, with its axis along that link's y"
    )]
    WheelJoint { leg: String, joint: String },
    #[error("the leg {leg:?} has no closed-form inverse kinematics: {reason}")]
    NoClosedForm { leg: String, reason: &'static str },
    #[error("the pose {pose:?} in robot.toml has {n_joints} joint angles; a leg has 6")]
    PoseJoints { pose: String, n_joints: usize },
    #[error("scale is {scale}; it must be between 0.001 and 1000")]
    Scale { scale: f64 },
    #[error("payload: {field} is {value}, but must be finite{bound}")]
    Payload { field: &'static str, value: f64, bound: &'static str },
    #[error("payload: there is no link {link:?}; the base link is {base:?}")]
    PayloadLink { link: String, base: String },
}

/// A robot: everything that analyses, planners and displays need, from one model (F62).
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    name: String,
    links: Vec<Link>,
    joints: Vec<Joint>,
    legs: Vec<Leg>,
    motion: MotionLimits,
    stance: StanceRules,
    tolerances: Tolerances,
    poses: Vec<(String, LegAngles)>,
    scale: f64,
    hash: u64,
}

impl Robot {
    /// Loads a robot from the texts of its folder. `urdf` gets the file name that `robot.toml`
    /// gives; `has_mesh` tells whether a mesh file exists in the folder.
    pub fn from_folder(
        robot_toml: &str,
        urdf: impl FnOnce(&str) -> Option<String>,
        has_mesh: impl Fn(&str) -> bool,
    ) -> Result<Robot, ModelError> {
        let config = RobotToml::parse(robot_toml)?;
        let urdf_text = urdf(&config.urdf).ok_or_else(|| ModelError::UrdfSyntax {
            message: format!("the file {:?} is not in the robot's folder", config.urdf),
        })?;
        let tree = urdf::parse(&urdf_text, &config.base_link, &has_mesh)?;
        if config.legs.is_empty() || config.legs.len() > 16 {
            return Err(ModelError::LegCount { n_legs: config.legs.len() });
        }
        let mut robot = Robot {
            name: config.name.clone(),
            links: tree.links,
            joints: tree.joints,
            legs: Vec::new(),
            motion: config.motion(),
            stance: config.stance(),
            tolerances: config.tolerances(),
            poses: Vec::new(),
            scale: 1.0,
            hash: fnv1a(fnv1a(FNV_START, robot_toml.as_bytes()), urdf_text.as_bytes()),
        };
        for leg in &config.legs {
            if robot.legs.iter().any(|other| other.name == leg.name) {
                return Err(ModelError::DuplicateName { kind: "leg", name: leg.name.clone() });
            }
            let leg = robot.leg_from(leg)?;
            robot.legs.push(leg);
        }
        for (name, joints) in config.poses() {
            let angles: [f64; 6] = joints.try_into().map_err(|_| ModelError::PoseJoints {
                pose: name.into(),
                n_joints: joints.len(),
            })?;
            if let Some(value) = angles.iter().find(|v| !v.is_finite()) {
                let (what, name) = ("pose".into(), name.into());
                return Err(ModelError::NotFinite { what, name, value: *value });
            }
            robot.poses.push((name.into(), LegAngles::from(angles)));
        }
        Ok(robot)
    }

    fn joint_index(&self, name: &str) -> Result<usize, ModelError> {
        self.joints
            .iter()
            .position(|j| j.name == name)
            .ok_or_else(|| ModelError::UnknownJoint { name: name.into() })
    }

    fn leg_from(&self, leg: &crate::config::LegToml) -> Result<Leg, ModelError> {
        let indices: Vec<usize> =
            leg.joints.iter().map(|name| self.joint_index(name)).collect::<Result<_, _>>()?;
        let joints: [usize; 6] = indices.as_slice().try_into().map_err(|_| {
            ModelError::LegJoints { leg: leg.name.clone(), n_joints: indices.len() }
        })?;
        let mut parent = LinkId(0);
        for &j in &joints {
            let joint = &self.joints[j];
            if joint.parent != parent {
                let (leg, joint) = (leg.name.clone(), joint.name.clone());
                return Err(ModelError::LegChain { leg, joint });
            }
            if joint.kind != JointKind::Revolute {
                let (leg, joint) = (leg.name.clone(), joint.name.clone());
                return Err(ModelError::LegJointKind { leg, joint });
            }
            parent = joint.child;
        }
        let wheel_joint = self.joint_index(&leg.wheel_joint)?;
        let wheel = &self.joints[wheel_joint];
        let axis = wheel.parent_from_joint.rotation * wheel.axis;
        let along_y = axis.cross(&Vector3::y()).norm() < 1e-9;
        if wheel.kind != JointKind::Continuous || wheel.parent != parent || !along_y {
            let (leg, joint) = (leg.name.clone(), wheel.name.clone());
            return Err(ModelError::WheelJoint { leg, joint });
        }
        let chain = joints.map(|j| &self.joints[j]);
        let carrier_from_wheel = Isometry3::from(wheel.parent_from_joint.translation);
        let ik = LegIk::new(&chain, &carrier_from_wheel)
            .map_err(|reason| ModelError::NoClosedForm { leg: leg.name.clone(), reason })?;
        Ok(Leg {
            name: leg.name.clone(),
            joints,
            links: joints.map(|j| self.joints[j].child),
            wheel_link: wheel.child,
            wheel_joint,
            wheel: Wheel {
                radius: leg.wheel_radius_m,
                width: leg.wheel_width_m,
                carrier_from_wheel,
            },
            lower: LegAngles::from(chain.map(|j| j.lower)),
            upper: LegAngles::from(chain.map(|j| j.upper)),
            effort: LegAngles::from(chain.map(|j| j.effort)),
            ik,
        })
    }

    /// The same robot with every length, tolerance and joint torque limit times `scale`; masses
    /// and angles stay. Payloads are not scaled: add them afterwards.
    pub fn scaled(&self, scale: f64) -> Result<Robot, ModelError> {
        if !(scale.is_finite() && (0.001..=1000.0).contains(&scale)) {
            return Err(ModelError::Scale { scale });
        }
        let mut robot = self.clone();
        for link in &mut robot.links {
            link.com *= scale;
            for shape in &mut link.shapes {
                *shape = shape.scaled(scale);
            }
        }
        for joint in &mut robot.joints {
            joint.parent_from_joint = scaled_isometry(&joint.parent_from_joint, scale);
            joint.effort *= scale;
        }
        for leg in &mut robot.legs {
            leg.wheel.radius *= scale;
            leg.wheel.width *= scale;
            leg.wheel.carrier_from_wheel = scaled_isometry(&leg.wheel.carrier_from_wheel, scale);
            leg.effort *= scale;
            leg.ik = leg.ik.scaled(scale);
        }
        robot.stance = self.stance.scaled(scale);
        robot.tolerances = self.tolerances.scaled(scale);
        robot.scale = self.scale * scale;
        robot.hash = fnv1a(self.hash, &scale.to_bits().to_le_bytes());
        Ok(robot)
    }

    /// The same robot carrying `payloads` (F92): mass, center of mass and shapes change with them.
    pub fn with_payloads(&self, payloads: &[Payload]) -> Result<Robot, ModelError> {
        let mut robot = self.clone();
        for payload in payloads {
            check_payload(payload)?;
            let id = self.link_id(&payload.link).ok_or_else(|| ModelError::PayloadLink {
                link: payload.link.clone(),
                base: self.links[0].name.clone(),
            })?;
            let link = &mut robot.links[id.0];
            let mass = link.mass + payload.mass;
            if mass > 0.0 {
                let moment = link.com.coords * link.mass + payload.com.coords * payload.mass;
                link.com = Point3::from(moment / mass);
            }
            link.mass = mass;
            if let Some(size) = payload.box_size {
                link.shapes.push(LinkShape {
                    link_from_shape: Isometry3::from(payload.com.coords),
                    shape: Shape::Box { half_extents: size * 0.5 },
                });
            }
            robot.hash = fnv1a(robot.hash, payload.link.as_bytes());
            let size = payload.box_size.unwrap_or_default();
            let numbers = [payload.mass].into_iter().chain(payload.com.coords.iter().copied());
            for number in numbers.chain(size.iter().copied()) {
                robot.hash = fnv1a(robot.hash, &number.to_bits().to_le_bytes());
            }
        }
        Ok(robot)
    }

    /// Name in `robot.toml`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// All links, parents before children; the first is the base.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// All joints.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// The legs, in the order of `robot.toml`.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// A leg by its index; panics for an index that is not of this robot.
    pub fn leg(&self, leg: LegId) -> &Leg {
        &self.legs[leg.0]
    }

    /// All leg indices.
    pub fn leg_ids(&self) -> impl Iterator<Item = LegId> + use<> {
        (0..self.legs.len()).map(LegId)
    }

    /// A leg by its name.
    pub fn leg_id(&self, name: &str) -> Option<LegId> {
        self.legs.iter().position(|leg| leg.name == name).map(LegId)
    }

    /// A link by its name.
    pub fn link_id(&self, name: &str) -> Option<LinkId> {
        self.links.iter().position(|link| link.name == name).map(LinkId)
    }

    /// The leg that a link belongs to and its place in the leg: 0 to 5, the wheel being of the
    /// same body as the last link (F64). None for links of the base.
    pub fn body_of(&self, link: LinkId) -> Option<(LegId, usize)> {
        self.legs.iter().enumerate().find_map(|(i, leg)| {
            let place = leg.links.iter().position(|l| *l == link);
            let place = place.or((leg.wheel_link == link).then_some(5));
            place.map(|place| (LegId(i), place))
        })
    }

    /// How fast the robot moves.
    pub fn motion(&self) -> &MotionLimits {
        &self.motion
    }

    /// When a wheel stands, and what a step must keep.
    pub fn stance(&self) -> &StanceRules {
        &self.stance
    }

    /// Clearance that planned motion keeps.
    pub fn tolerances(&self) -> &Tolerances {
        &self.tolerances
    }

    /// Named joint angles, the same for every leg.
    pub fn poses(&self) -> &[(String, LegAngles)] {
        &self.poses
    }

    /// All legs in the named pose with the base at the origin of the world.
    pub fn pose(&self, name: &str) -> Option<Configuration> {
        let (_, angles) = self.poses.iter().find(|(n, _)| n == name)?;
        Some(Configuration {
            world_from_base: Isometry3::identity(),
            legs: vec![*angles; self.legs.len()],
        })
    }

    /// Factor on the folder's lengths.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Total mass with payloads (kg).
    pub fn mass(&self) -> f64 {
        self.links.iter().map(|link| link.mass).sum()
    }

    /// Version stamp: a hash of the folder's texts, the scale and the payloads. Plans made on one
    /// model are not valid on another.
    pub fn hash(&self) -> u64 {
        self.hash
    }
}

fn check_payload(payload: &Payload) -> Result<(), ModelError> {
    let bad = |field, value, bound| Err(ModelError::Payload { field, value, bound });
    if !(payload.mass.is_finite() && payload.mass >= 0.0) {
        return bad("mass_kg", payload.mass, " and not negative");
    }
    if let Some(value) = payload.com.coords.iter().find(|v| !v.is_finite()) {
        return bad("com_m", *value, "");
    }
    let sizes = payload.box_size.iter().flat_map(|size| size.iter());
    match sizes.into_iter().find(|v| !(v.is_finite() && **v > 0.0)) {
        Some(value) => bad("box_m", *value, " and above zero"),
        None => Ok(()),
    }
}

const FNV_START: u64 = 0xcbf2_9ce4_8422_2325;

/// Fowler-Noll-Vo hash, 64 bit, variant 1a: portable, and enough to tell versions apart.
fn fnv1a(start: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(start, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
