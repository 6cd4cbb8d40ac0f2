//! The robot model: links, joints, legs.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::compliance::{Compliance, vertical_stiffness};
use crate::config::{FootToml, LegToml, MotionLimits, RobotToml, StanceRules, Tolerances};
use crate::ik::{Chain, ChainJoint, LegIk, LegSolver, NumericalIk};
use crate::mesh::MeshError;
use crate::posture::{Configuration, LegAngles, Posture};
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
    /// Slides along its axis between limits.
    Prismatic,
}

impl JointKind {
    /// A frame moved by a joint of this kind: turned about `axis` by `q` (rad), or shifted along it
    /// by `q` (m).
    pub(crate) fn moved(
        self,
        frame: Isometry3<f64>,
        axis: &Unit<Vector3<f64>>,
        q: f64,
    ) -> Isometry3<f64> {
        match self {
            JointKind::Prismatic => frame * Translation3::from(axis.into_inner() * q),
            _ => frame * UnitQuaternion::from_axis_angle(axis, q),
        }
    }
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
    /// Lower limit (rad; m for a prismatic joint).
    pub lower: f64,
    /// Upper limit (rad; m for a prismatic joint).
    pub upper: f64,
    /// Torque limit (N m; force limit in N for a prismatic joint).
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

/// A leg: one to six joints from the hip outward, and a wheel or a ball foot.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// Name in `robot.toml`.
    pub name: String,
    /// Indices of its joints, from the hip outward.
    pub joints: Vec<usize>,
    /// The links these joints carry, in the same order.
    pub links: Vec<LinkId>,
    /// The link of the wheel or of the ball foot.
    pub wheel_link: LinkId,
    /// Index of the wheel's joint; none for a ball foot.
    pub wheel_joint: Option<usize>,
    /// The wheel or ball foot, carried by the last of `links`.
    pub wheel: Wheel,
    /// Lower limits (rad; m for a prismatic joint); zero beyond the last joint.
    pub lower: LegAngles,
    /// Upper limits (rad; m for a prismatic joint); zero beyond the last joint.
    pub upper: LegAngles,
    /// Torque limits (N m; N for a prismatic joint); zero beyond the last joint.
    pub effort: LegAngles,
    /// Inverse kinematics.
    pub ik: LegSolver,
    /// All joints beyond the base that move with the leg, parents first, with their place in
    /// `joints`; the others stay at zero.
    pub(crate) moves: Vec<(usize, Option<usize>)>,
}

impl Leg {
    /// Number of its joints, 1 to 6.
    pub fn n_joints(&self) -> usize {
        self.joints.len()
    }

    /// The link that its last joint carries.
    pub(crate) fn last_link(&self) -> LinkId {
        self.links[self.links.len() - 1]
    }
}

/// A mass or a tool fixed to a link for a mission (F92).
#[derive(Debug, Clone, PartialEq)]
pub struct Payload {
    /// The link that carries it.
    pub link: String,
    /// Mass (kg).
    pub mass: f64,
    /// Center of mass in the link's frame (m).
    pub com: Point3<f64>,
    /// Its shapes, placed in the link's frame.
    pub shapes: Vec<LinkShape>,
    /// Joints whose range it cuts.
    pub limits: Vec<JointRange>,
}

impl Payload {
    /// A payload with the shape of a box around its center of mass: edges (m), axis-parallel in the
    /// link's frame.
    pub fn boxed(link: &str, mass: f64, com: Point3<f64>, edges: Vector3<f64>) -> Payload {
        let shape = Shape::Box { half_extents: edges * 0.5 };
        let shapes = vec![LinkShape { link_from_shape: Isometry3::from(com.coords), shape }];
        Payload { link: link.into(), mass, com, shapes, limits: Vec::new() }
    }
}

/// The range that a joint is left with.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRange {
    /// Name of a joint of a leg.
    pub joint: String,
    /// Lower limit (rad; m for a prismatic joint), not below the joint's own.
    pub lower: f64,
    /// Upper limit (rad; m for a prismatic joint), not above the joint's own.
    pub upper: f64,
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
    #[error(
        "robot.toml: compliance.joint_stiffness_nm_rad has {n_joints} values, but {leg:?} has {wanted} joints"
    )]
    JointStiffness { n_joints: usize, leg: String, wanted: usize },
    #[error(
        "robot.toml: compliance.tire_stiffness_n_m needs compliance.joint_stiffness_nm_rad beside it"
    )]
    TireAlone,
    #[error("robot.toml: compliance.stiffness_error is {value}, but must be 0 or more and below 1")]
    StiffnessError { value: f64 },
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
        "the link {link:?} names the mesh {file:?}; a mesh is a relative path in the robot's folder, or package://NAME/ and such a path"
    )]
    MeshPath { link: String, file: String },
    #[error("the mesh {file:?} of the link {link:?} {reason}")]
    Mesh { link: String, file: String, reason: MeshError },
    #[error("the meshes hold {bytes} bytes in all; the limit is {limit}")]
    MeshesTooLarge { bytes: usize, limit: usize },
    #[error("a shape of the link {link:?} has a size that is zero, negative or not finite")]
    ShapeSize { link: String },
    #[error("the joint {joint:?} is neither fixed, revolute, continuous nor prismatic")]
    JointKind { joint: String },
    #[error("the joint {joint:?} has no axis")]
    NoAxis { joint: String },
    #[error("the joint {joint:?} has its lower limit {lower} above its upper limit {upper}")]
    Limits { joint: String, lower: f64, upper: f64 },
    #[error("the robot has {n_legs} legs in robot.toml; 1 to 16 are supported")]
    LegCount { n_legs: usize },
    #[error("the leg {leg:?} has {n_joints} joints in robot.toml; 1 to 6 are supported")]
    LegJoints { leg: String, n_joints: usize },
    #[error(
        "the joints of leg {leg:?} do not follow each other from the base outward: {joint:?} does not hang on the one before it, by fixed joints at most"
    )]
    LegChain { leg: String, joint: String },
    #[error("the joint {joint:?} of leg {leg:?} must be revolute or prismatic with limits")]
    LegJointKind { leg: String, joint: String },
    #[error(
        "the wheel joint {joint:?} of leg {leg:?} must be continuous, on the leg's last link, with its axis along that link's y"
    )]
    WheelJoint { leg: String, joint: String },
    #[error(
        "the leg {leg:?} in robot.toml must have either wheel_joint, wheel_radius_m and wheel_width_m, or foot_link and foot_radius_m"
    )]
    LegFoot { leg: String },
    #[error(
        "the foot link {link:?} of leg {leg:?} must hang on the leg's last link by fixed joints, and not be that link"
    )]
    FootLink { leg: String, link: String },
    #[error(
        "the pose {pose:?} in robot.toml has {n_joints} joint angles, but the leg {leg:?} has {wanted} joints"
    )]
    PoseJoints { pose: String, n_joints: usize, leg: String, wanted: usize },
    #[error(
        "the pose {pose:?} in robot.toml stands for all legs, but not all have the same kinds of joints"
    )]
    PoseKinds { pose: String },
    #[error("scale is {scale}; it must be between 0.001 and 1000")]
    Scale { scale: f64 },
    #[error("payload: {field} is {value}, but must be finite{bound}")]
    Payload { field: &'static str, value: f64, bound: &'static str },
    #[error("payload: there is no link {link:?}; the base link is {base:?}")]
    PayloadLink { link: String, base: String },
    #[error("payload: there is no joint {joint:?} in any leg")]
    PayloadJoint { joint: String },
    #[error("payload: a shape has a size that is zero, negative or not finite")]
    PayloadShape,
    #[error(
        "payload: the range {lower} to {upper} of joint {joint:?} must be within its range {own_lower} to {own_upper}"
    )]
    PayloadLimits { joint: String, lower: f64, upper: f64, own_lower: f64, own_upper: f64 },
}

/// A robot: everything that analyses, planners and displays need, from one model (F62).
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    name: String,
    links: Vec<Link>,
    joints: Vec<Joint>,
    legs: Vec<Leg>,
    /// By link: the leg and the place in it whose joint carries the link; none for the base.
    bodies: Vec<Option<(LegId, usize)>>,
    motion: MotionLimits,
    stance: StanceRules,
    compliance: Compliance,
    tolerances: Tolerances,
    poses: Vec<(String, LegAngles)>,
    scale: f64,
    hash: u64,
}

impl Robot {
    /// Loads a robot from the texts of its folder. `urdf` gets the file name that `robot.toml`
    /// gives, `mesh` the path of a mesh that `<collision>` names, relative to the folder and without
    /// `..`; it gives the file's content, or none if there is no such file.
    pub fn from_folder(
        robot_toml: &str,
        urdf: impl FnOnce(&str) -> Option<String>,
        mesh: impl Fn(&str) -> Option<Vec<u8>>,
    ) -> Result<Robot, ModelError> {
        let config = RobotToml::parse(robot_toml)?;
        let urdf_text = urdf(&config.urdf).ok_or_else(|| ModelError::UrdfSyntax {
            message: format!("the file {:?} is not in the robot's folder", config.urdf),
        })?;
        let tree = urdf::parse(&urdf_text, &config.base_link, &mesh)?;
        if config.legs.is_empty() || config.legs.len() > 16 {
            return Err(ModelError::LegCount { n_legs: config.legs.len() });
        }
        let texts = [robot_toml.as_bytes(), urdf_text.as_bytes()].into_iter();
        let files = texts.chain(tree.mesh_files.iter().map(Vec::as_slice));
        let mut robot = Robot {
            name: config.name.clone(),
            bodies: vec![None; tree.links.len()],
            links: tree.links,
            joints: tree.joints,
            legs: Vec::new(),
            motion: config.motion(),
            stance: config.stance(0.0, 1.0),
            compliance: config.compliance(std::iter::empty())?,
            tolerances: config.tolerances(),
            poses: Vec::new(),
            scale: 1.0,
            hash: files.fold(FNV_START, fnv1a),
        };
        for leg in &config.legs {
            if robot.legs.iter().any(|other| other.name == leg.name) {
                return Err(ModelError::DuplicateName { kind: "leg", name: leg.name.clone() });
            }
            let mut leg = robot.leg_from(leg)?;
            robot.claim(&mut leg)?;
            robot.legs.push(leg);
        }
        let reach: f64 = robot.legs.iter().map(|leg| leg.ik.reach()).sum();
        robot.stance = config.stance(robot.mass(), reach / robot.legs.len() as f64);
        for (name, joints) in config.poses() {
            let angles = robot.pose_from(name, joints)?;
            robot.poses.push((name.into(), angles));
        }
        let legs = robot.legs.iter().map(|leg| (leg.name.as_str(), leg.n_joints()));
        robot.compliance = config.compliance(legs)?;
        robot.stance.leg_stiffness = robot.mean_stiffness();
        Ok(robot)
    }

    /// The mean vertical stiffness of the legs in the first named pose (N/m), where it follows from
    /// their joints.
    fn mean_stiffness(&self) -> f64 {
        let pose = self.poses.first().and_then(|(name, _)| self.pose(name));
        let Some(pose) = pose.filter(|_| self.compliance.springs.is_some()) else {
            return self.stance.leg_stiffness;
        };
        let posture = Posture::new(self, &pose);
        let stiffness = |leg: LegId| {
            let contact = posture.wheel(self, leg).lowest_point(&Vector3::z_axis());
            vertical_stiffness(self, &posture, leg, &contact)
        };
        self.leg_ids().map(stiffness).sum::<f64>() / self.legs.len() as f64
    }

    fn pose_from(&self, pose: &str, joints: &[f64]) -> Result<LegAngles, ModelError> {
        if let Some(value) = joints.iter().find(|v| !v.is_finite()) {
            let (what, name) = ("pose".into(), pose.into());
            return Err(ModelError::NotFinite { what, name, value: *value });
        }
        if let Some(leg) = self.legs.iter().find(|leg| leg.n_joints() != joints.len()) {
            return Err(ModelError::PoseJoints {
                pose: pose.into(),
                n_joints: joints.len(),
                leg: leg.name.clone(),
                wanted: leg.n_joints(),
            });
        }
        let kinds = |leg: &Leg| leg.joints.iter().map(|j| self.joints[*j].kind).collect::<Vec<_>>();
        if self.legs.iter().any(|leg| kinds(leg) != kinds(&self.legs[0])) {
            return Err(ModelError::PoseKinds { pose: pose.into() });
        }
        Ok(LegAngles::from_fn(|i, _| joints.get(i).copied().unwrap_or(0.0)))
    }

    /// Gives a leg the joints and links that move with it; refuses links that another leg moves.
    fn claim(&mut self, leg: &mut Leg) -> Result<(), ModelError> {
        let id = LegId(self.legs.len());
        for place in 0..leg.n_joints() {
            let link = leg.links[place];
            if self.bodies[link.0].replace((id, place)).is_some() {
                let name = self.joints[leg.joints[place]].name.clone();
                return Err(ModelError::DuplicateName { kind: "leg joint", name });
            }
        }
        // Links are in topological order: parents have their body before their children ask.
        for i in 1..self.links.len() {
            let Some(joint) = self.links[i].parent_joint else { continue };
            let parent = self.joints[joint].parent.0;
            if self.bodies[i].is_none() {
                self.bodies[i] = self.bodies[parent].filter(|(of, _)| *of == id);
            }
            if self.bodies[i].is_some_and(|(of, _)| of == id) {
                leg.moves.push((joint, leg.joints.iter().position(|j| *j == joint)));
            }
        }
        Ok(())
    }

    /// Pose of `link` in `ancestor` if only fixed joints are between them.
    fn fixed_between(&self, ancestor: LinkId, link: LinkId) -> Option<Isometry3<f64>> {
        let (mut link, mut pose) = (link, Isometry3::identity());
        while link != ancestor {
            let joint = &self.joints[self.links[link.0].parent_joint?];
            if joint.kind != JointKind::Fixed {
                return None;
            }
            pose = joint.parent_from_joint * pose;
            link = joint.parent;
        }
        Some(pose)
    }

    /// The leg's joints in a row, as the solvers want them.
    pub(crate) fn chain_of(&self, leg: &Leg) -> Chain {
        let mut parent = LinkId(0);
        let mut chain =
            Chain { joints: Default::default(), link_from_foot: leg.wheel.carrier_from_wheel };
        for &j in &leg.joints {
            let joint = &self.joints[j];
            // What is between was found fixed when the leg was read.
            let between = self.fixed_between(parent, joint.parent).unwrap_or_default();
            chain.joints.push(ChainJoint {
                link_from_joint: between * joint.parent_from_joint,
                axis: joint.axis,
                kind: joint.kind,
            });
            parent = joint.child;
        }
        chain
    }

    fn joint_index(&self, name: &str) -> Result<usize, ModelError> {
        self.joints
            .iter()
            .position(|j| j.name == name)
            .ok_or_else(|| ModelError::UnknownJoint { name: name.into() })
    }

    fn leg_from(&self, leg: &LegToml) -> Result<Leg, ModelError> {
        let joints: Vec<usize> =
            leg.joints.iter().map(|name| self.joint_index(name)).collect::<Result<_, _>>()?;
        if !(1..=6).contains(&joints.len()) {
            let (leg, n_joints) = (leg.name.clone(), joints.len());
            return Err(ModelError::LegJoints { leg, n_joints });
        }
        let mut parent = LinkId(0);
        for &j in &joints {
            let joint = &self.joints[j];
            if self.fixed_between(parent, joint.parent).is_none() {
                let (leg, joint) = (leg.name.clone(), joint.name.clone());
                return Err(ModelError::LegChain { leg, joint });
            }
            if !matches!(joint.kind, JointKind::Revolute | JointKind::Prismatic) {
                let (leg, joint) = (leg.name.clone(), joint.name.clone());
                return Err(ModelError::LegJointKind { leg, joint });
            }
            parent = joint.child;
        }
        let (wheel_link, wheel_joint, wheel) = match leg.foot()? {
            FootToml::Wheel { joint, radius, width } => {
                let index = self.joint_index(joint)?;
                let carrier_from_wheel =
                    self.wheel_center(parent, &self.joints[index]).ok_or_else(|| {
                        ModelError::WheelJoint { leg: leg.name.clone(), joint: joint.into() }
                    })?;
                let wheel = Wheel { radius, width, ball: false, carrier_from_wheel };
                (self.joints[index].child, Some(index), wheel)
            }
            FootToml::Ball { link, radius, offset } => {
                let (id, carrier_from_wheel) = self.foot_center(parent, link, offset, leg)?;
                let wheel = Wheel { radius, width: 2.0 * radius, ball: true, carrier_from_wheel };
                (id, None, wheel)
            }
        };
        let each = |value: fn(&Joint) -> f64| {
            LegAngles::from_fn(|i, _| joints.get(i).map_or(0.0, |j| value(&self.joints[*j])))
        };
        let (lower, upper) = (each(|j| j.lower), each(|j| j.upper));
        // The solver needs the chain of the leg: a first one stands in until it is known.
        let empty = Chain { joints: Default::default(), link_from_foot: Isometry3::identity() };
        let mut model = Leg {
            name: leg.name.clone(),
            links: joints.iter().map(|j| self.joints[*j].child).collect(),
            wheel_link,
            wheel_joint,
            wheel,
            lower,
            upper,
            effort: each(|j| j.effort),
            ik: LegSolver::Numerical(NumericalIk::new(empty, false, &lower, &upper)),
            joints,
            moves: Vec::new(),
        };
        let chain = self.chain_of(&model);
        model.ik = match LegIk::new(&chain).filter(|_| !wheel.ball) {
            Some(closed_form) => LegSolver::ClosedForm(closed_form),
            None => LegSolver::Numerical(NumericalIk::new(chain, !wheel.ball, &lower, &upper)),
        };
        Ok(model)
    }

    /// Where a wheel is in the leg's last link, if it hangs there and turns about y.
    fn wheel_center(&self, last: LinkId, wheel: &Joint) -> Option<Isometry3<f64>> {
        let carrier_from_wheel = self.fixed_between(last, wheel.parent)? * wheel.parent_from_joint;
        let axis = carrier_from_wheel.rotation * wheel.axis;
        let along_y = axis.cross(&Vector3::y()).norm() < 1e-9;
        (wheel.kind == JointKind::Continuous && along_y)
            .then(|| Isometry3::from(carrier_from_wheel.translation))
    }

    /// Link and center of a ball foot, the center in the leg's last link.
    fn foot_center(
        &self,
        last: LinkId,
        link: &str,
        offset: [f64; 3],
        leg: &LegToml,
    ) -> Result<(LinkId, Isometry3<f64>), ModelError> {
        if let Some(value) = offset.iter().find(|v| !v.is_finite()) {
            let (what, name) = ("foot_offset_m".into(), leg.name.clone());
            return Err(ModelError::NotFinite { what, name, value: *value });
        }
        let id = self.link_id(link).ok_or_else(|| ModelError::UnknownLink { name: link.into() })?;
        let carrier_from_link = self.fixed_between(last, id).filter(|_| id != last);
        let carrier_from_link = carrier_from_link
            .ok_or_else(|| ModelError::FootLink { leg: leg.name.clone(), link: link.into() })?;
        let center = carrier_from_link * Point3::from(offset);
        Ok((id, Isometry3::from(center.coords)))
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
            if joint.kind == JointKind::Prismatic {
                joint.lower *= scale;
                joint.upper *= scale;
            } else {
                joint.effort *= scale;
            }
        }
        if let Some(leg) = self.legs.first() {
            for (place, _) in self.prismatic_places(leg) {
                robot.poses.iter_mut().for_each(|(_, angles)| angles[place] *= scale);
            }
        }
        for leg in &mut robot.legs {
            for (place, joint) in leg.joints.iter().enumerate() {
                let joint = &robot.joints[*joint];
                leg.lower[place] = joint.lower;
                leg.upper[place] = joint.upper;
                leg.effort[place] = joint.effort;
            }
            leg.wheel.radius *= scale;
            leg.wheel.width *= scale;
            leg.wheel.carrier_from_wheel = scaled_isometry(&leg.wheel.carrier_from_wheel, scale);
            leg.ik = leg.ik.scaled(scale);
        }
        robot.stance = self.stance.scaled(scale);
        let prismatic: Vec<usize> = self.legs.first().map_or_else(Vec::new, |leg| {
            self.prismatic_places(leg).map(|(place, _)| place).collect()
        });
        robot.compliance = self.compliance.scaled(scale, |place| prismatic.contains(&place));
        robot.tolerances = self.tolerances.scaled(scale);
        robot.scale = self.scale * scale;
        robot.hash = fnv1a(self.hash, &scale.to_bits().to_le_bytes());
        Ok(robot)
    }

    /// Places of a leg's prismatic joints, and their indices.
    fn prismatic_places<'a>(&'a self, leg: &'a Leg) -> impl Iterator<Item = (usize, usize)> + 'a {
        let places = leg.joints.iter().copied().enumerate();
        places.filter(|(_, joint)| self.joints[*joint].kind == JointKind::Prismatic)
    }

    /// The same robot carrying `payloads` (F92): mass, center of mass, shapes and the ranges of
    /// joints change with them, and the version stamp. A range only ever narrows.
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
            link.shapes.extend(payload.shapes.iter().cloned());
            for range in &payload.limits {
                robot.narrow(range)?;
            }
            robot.hash = payload_hash(robot.hash, payload);
        }
        Ok(robot)
    }

    fn narrow(&mut self, range: &JointRange) -> Result<(), ModelError> {
        let leg_joint = |leg: &mut Leg, joints: &[Joint]| {
            leg.joints.iter().position(|j| joints[*j].name == range.joint)
        };
        let joints = &mut self.joints;
        let found = self.legs.iter_mut().find_map(|leg| Some((leg_joint(leg, joints)?, leg)));
        let Some((place, leg)) = found else {
            return Err(ModelError::PayloadJoint { joint: range.joint.clone() });
        };
        let joint = &mut joints[leg.joints[place]];
        let (lower, upper) = (range.lower, range.upper);
        if !(lower >= joint.lower && lower <= upper && upper <= joint.upper) {
            return Err(ModelError::PayloadLimits {
                joint: range.joint.clone(),
                lower,
                upper,
                own_lower: joint.lower,
                own_upper: joint.upper,
            });
        }
        (joint.lower, joint.upper) = (lower, upper);
        (leg.lower[place], leg.upper[place]) = (lower, upper);
        Ok(())
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

    /// The leg that a link belongs to and its place in the leg, from 0 at the hip: what is fixed to
    /// a link of the leg is of the same body, and the wheel is of one body with the last link (F64).
    /// None for links of the base.
    pub fn body_of(&self, link: LinkId) -> Option<(LegId, usize)> {
        self.bodies[link.0]
    }

    /// How fast the robot moves.
    pub fn motion(&self) -> &MotionLimits {
        &self.motion
    }

    /// When a wheel stands, and what a step must keep.
    pub fn stance(&self) -> &StanceRules {
        &self.stance
    }

    /// How legs give way under load.
    pub fn compliance(&self) -> &Compliance {
        &self.compliance
    }

    /// Clearance that planned motion keeps.
    pub fn tolerances(&self) -> &Tolerances {
        &self.tolerances
    }

    /// Named joint angles, the same for every leg, at the robot's scale.
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

    /// Version stamp: a hash of the folder's texts and meshes, the scale and the payloads. Plans made on one
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
    let fine = |placed: &LinkShape| {
        let at = placed.link_from_shape.translation.vector;
        placed.shape.is_proper() && at.iter().all(|v| v.is_finite())
    };
    if payload.shapes.iter().all(fine) { Ok(()) } else { Err(ModelError::PayloadShape) }
}

fn payload_hash(start: u64, payload: &Payload) -> u64 {
    let number = |hash: u64, value: &f64| fnv1a(hash, &value.to_bits().to_le_bytes());
    let mut hash = fnv1a(start, payload.link.as_bytes());
    hash = number(hash, &payload.mass);
    hash = payload.com.coords.iter().fold(hash, number);
    for placed in &payload.shapes {
        hash = placed.link_from_shape.translation.vector.iter().fold(hash, number);
        hash = placed.link_from_shape.rotation.coords.iter().fold(hash, number);
        hash = placed.shape.numbers().iter().fold(hash, number);
    }
    for range in &payload.limits {
        hash = fnv1a(hash, range.joint.as_bytes());
        hash = [range.lower, range.upper].iter().fold(hash, number);
    }
    hash
}

const FNV_START: u64 = 0xcbf2_9ce4_8422_2325;

/// Fowler-Noll-Vo hash, 64 bit, variant 1a: portable, and enough to tell versions apart.
fn fnv1a(start: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(start, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
