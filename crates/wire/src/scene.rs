//! Scenes: robot, payloads, gravity, terrain, obstacles, state.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A pose: position (m) and unit quaternion `[x, y, z, w]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Position (m) in the frame that the field's name says.
    pub position_m: [f64; 3],
    /// Orientation as `[x, y, z, w]`.
    pub orientation_xyzw: [f64; 4],
}

/// The rover's configuration: base pose in `world` and the joint angles by leg.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RoverState {
    /// Pose of the base link in `world`.
    pub base: Pose,
    /// Joint angles (rad; m for a prismatic joint) by leg, from the hip outward: as many as the leg
    /// has joints.
    pub joints_rad: BTreeMap<String, Vec<f64>>,
    /// Wheel spin (rad) by leg; zero where absent.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub wheels_rad: BTreeMap<String, f64>,
}

/// A mass or a tool fixed to a link for a mission, with its shapes and the joint ranges that it cuts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// The link that carries it.
    pub link: String,
    /// Mass (kg).
    pub mass_kg: f64,
    /// Center of mass in the link's frame (m).
    pub com_m: [f64; 3],
    /// Shape, centered on the center of mass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<PayloadShape>,
    /// More shapes, placed in the link's frame: those of a tool, for example. At most 100.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<PlacedShape>,
    /// Joints whose range it cuts: `[lower, upper]` (rad; m for a prismatic joint) within the
    /// joint's own limits, by the joint's name in the URDF. At most 100.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub limits_rad: BTreeMap<String, [f64; 2]>,
}

/// A shape in a link's frame: exactly one of `box_m`, `cylinder_m` and `sphere_m`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacedShape {
    /// Center, in the link's frame (m).
    pub position_m: [f64; 3],
    /// Orientation in the link's frame as `[x, y, z, w]`; the link's own where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation_xyzw: Option<[f64; 4]>,
    /// Edge lengths of a box (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub box_m: Option<[f64; 3]>,
    /// Radius and length of a cylinder about z (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder_m: Option<[f64; 2]>,
    /// Radius of a sphere (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sphere_m: Option<f64>,
}

/// The shape of a payload.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PayloadShape {
    /// Edge lengths of an axis-parallel box in the link's frame (m).
    pub box_m: [f64; 3],
}

/// Which ground a request stands on: exactly one of `file`, `version`, `recipe`, `plane`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Terrain {
    /// A file: over HTTP a name in the server's terrain folder, on the command line a path
    /// relative to the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// A version of the server's own map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
    /// A synthetic terrain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recipe: Option<Recipe>,
    /// Level ground at height zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<Plane>,
    /// Seed of the recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Shift applied to the ground's coordinates (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_m: Option<[f64; 3]>,
    /// Coefficient of friction between wheel and ground.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
}

/// Level ground; no parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Plane {}

/// A named recipe of synthetic terrain with optional changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// `boulder_field`, `smooth_mare` or `rough_highlands`.
    pub name: String,
    /// Side of the square generated (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_m: Option<f64>,
    /// Distance between nodes (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution_m: Option<f64>,
}

/// Something solid that is not ground: a box, or a triangle mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum Obstacle {
    /// A box given by its edge lengths and the pose of its center.
    Box(BoxObstacle),
    /// A triangle mesh in `world`.
    Mesh(MeshObstacle),
}

/// A box given by its edge lengths and the pose of its center in `world`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxObstacle {
    /// Edge lengths (m).
    pub box_m: [f64; 3],
    /// Center (m).
    pub position_m: [f64; 3],
    /// Orientation as `[x, y, z, w]`.
    pub orientation_xyzw: [f64; 4],
}

/// A closed triangle mesh in `world`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshObstacle {
    /// Vertices (m).
    pub vertices_m: Vec<[f64; 3]>,
    /// Indices into the vertices, three a triangle, outward by the right-hand rule.
    pub triangles: Vec<[u32; 3]>,
}

/// What an analysis is about. Over HTTP the default of every part is the live one.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of a robot folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Factor on every length and tolerance of the robot's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Payloads; none where absent and the scene is not the live one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub payloads: Option<Vec<Payload>>,
    /// Gravity (m/s²), along -z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_m_s2: Option<f64>,
    /// The ground.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrain: Option<Terrain>,
    /// Solid things beside the ground.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Obstacle>,
    /// The rover's configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<RoverState>,
}
