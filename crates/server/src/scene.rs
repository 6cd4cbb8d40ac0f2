//! Scenes: what a request says of robot, ground, obstacles and state, and the live rover's values
//! for what it leaves out.

use std::collections::BTreeMap;
use std::sync::Arc;

use collision::{Obstacle, SceneError};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rover::{Configuration, Posture, Robot};
use terrain::ElevationMap;
use wire::analysis::{OBSTACLE_TRIANGLES_MAX, OBSTACLES_MAX, PAYLOADS_MAX};
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::scene::{
    BoxObstacle, MeshObstacle, Obstacle as WireObstacle, Scene as WireScene, Terrain,
};

use crate::config::Config;
use crate::robots::Robots;
use crate::terrain_store::Version;
use crate::terrains::{FRICTION, Terrains};
use crate::unknown_ground::{cover_of, covered};

/// Range of gravity (m/s²).
const GRAVITY_M_S2: [f64; 2] = [0.01, 100.0];

/// What a request is resolved against.
pub struct Context {
    /// The robots there are.
    pub robots: Arc<Robots>,
    /// The grounds there are.
    pub terrains: Arc<Terrains>,
    /// Settings of analyses.
    pub config: Arc<Config>,
    /// The live rover; none on the command line.
    pub live: Option<LiveScene>,
}

/// The live rover as a scene.
#[derive(Clone)]
pub struct LiveScene {
    /// The robot with scale and payloads.
    pub robot: Arc<Robot>,
    /// The ground it stands on.
    pub map: ElevationMap,
    /// The version of that ground, with its traversability.
    pub version: Arc<Version>,
    /// Gravity (m/s²).
    pub gravity: f64,
    /// Friction between wheel and ground.
    pub friction: f64,
    /// Where it is, as last reported; none before the first frame.
    pub configuration: Option<Configuration>,
}

/// A scene, complete.
#[derive(Clone)]
pub struct Scene {
    /// Robot, map and obstacles, for checks.
    pub solid: collision::Scene,
    /// The state.
    pub configuration: Configuration,
    /// Gravity (m/s²).
    pub gravity: f64,
    /// Friction between wheel and ground.
    pub friction: f64,
}

impl Scene {
    /// The robot.
    pub fn robot(&self) -> &Arc<Robot> {
        self.solid.robot()
    }
}

impl Context {
    /// The scene of a request.
    pub fn scene(&self, at: &At<'_>, scene: &WireScene) -> Result<Scene, RequestError> {
        let robot = self.robot(at, scene)?;
        let gravity = match (scene.gravity_m_s2, &self.live) {
            (Some(g), _) => check::within(&at.field("gravity_m_s2"), g, GRAVITY_M_S2, " m/s²")?,
            (None, Some(live)) => live.gravity,
            (None, None) => self.config.rover.gravity_m_s2,
        };
        let (map, friction) = self.ground(at, scene)?;
        let obstacles = obstacles(&at.field("obstacles"), &scene.obstacles)?;
        let configuration = self.configuration(at, scene, &robot)?;
        let solid = collision::Scene::new(robot, map, &obstacles)
            .map_err(|error| obstacle_error(at, &error))?;
        let limits = self.config.unknown_ground.limits();
        let cover = match self.live.as_ref().filter(|_| scene.terrain.is_none()) {
            Some(live) => live.version.cover(&limits).cloned(),
            None => cover_of(solid.map(), &BTreeMap::new(), &limits),
        };
        let solid = covered(solid, cover, &configuration);
        Ok(Scene { solid, configuration, gravity, friction })
    }

    /// The robot of a scene, scaled and loaded. The live one where nothing is said of it.
    pub fn robot(&self, at: &At<'_>, scene: &WireScene) -> Result<Arc<Robot>, RequestError> {
        if let Some(live) = &self.live
            && scene.robot.is_none()
            && scene.scale.is_none()
            && scene.payloads.is_none()
        {
            return Ok(live.robot.clone());
        }
        let live = self.live.as_ref();
        let name = match (&scene.robot, live) {
            (Some(name), _) => name.as_str(),
            (None, Some(live)) => live.robot.name(),
            (None, None) => &self.config.rover.robot,
        };
        let mut robot = self.robots.load(&at.field("robot"), name)?;
        let scale = match (scene.scale, live) {
            (Some(scale), _) => scale,
            (None, Some(live)) if scene.robot.is_none() => live.robot.scale(),
            (None, _) => 1.0,
        };
        if scale != 1.0 {
            let at = at.field("scale");
            robot = Arc::new(robot.scaled(scale).map_err(|e| convert::model_error(&at, &e))?);
        }
        let Some(payloads) = scene.payloads.as_ref().filter(|list| !list.is_empty()) else {
            return Ok(robot);
        };
        let at = at.field("payloads");
        check::at_most(&at, payloads.len(), PAYLOADS_MAX)?;
        let payloads: Vec<rover::Payload> = payloads
            .iter()
            .enumerate()
            .map(|(i, payload)| convert::payload(&at.index(i), payload))
            .collect::<Result<_, _>>()?;
        let loaded = robot.with_payloads(&payloads);
        loaded.map(Arc::new).map_err(|error| convert::model_error(&at, &error))
    }

    /// The map that a request names.
    pub fn terrain(
        &self,
        at: &At<'_>,
        terrain: Option<&Terrain>,
    ) -> Result<ElevationMap, RequestError> {
        match (terrain, &self.live) {
            (Some(terrain), _) => self.terrains.resolve(at, terrain),
            (None, Some(live)) => Ok(live.map.clone()),
            (None, None) => {
                let plane = Terrain { plane: Some(Default::default()), ..Terrain::default() };
                self.terrains.resolve(at, &plane)
            }
        }
    }

    fn ground(&self, at: &At<'_>, scene: &WireScene) -> Result<(ElevationMap, f64), RequestError> {
        let map = self.terrain(&at.field("terrain"), scene.terrain.as_ref())?;
        let friction = match (&scene.terrain, &self.live) {
            (Some(terrain), _) => terrain.friction.unwrap_or(FRICTION),
            (None, Some(live)) => live.friction,
            (None, None) => FRICTION,
        };
        Ok((map, friction))
    }

    /// The state of a scene: the one given, else the live one of the same robot, else the robot's
    /// first pose with its lowest wheel at height zero.
    fn configuration(
        &self,
        at: &At<'_>,
        scene: &WireScene,
        robot: &Robot,
    ) -> Result<Configuration, RequestError> {
        if let Some(state) = &scene.state {
            return convert::configuration(&at.field("state"), robot, state);
        }
        match &self.live {
            Some(LiveScene { configuration: Some(configuration), robot: live, .. })
                if live.name() == robot.name() && live.scale() == robot.scale() =>
            {
                Ok(configuration.clone())
            }
            _ => Ok(standing_at_origin(robot, &self.config.rover.pose)),
        }
    }
}

/// The robot over the origin in a pose of its folder (its first one if that is missing), its lowest
/// wheel touching height zero.
pub fn standing_at_origin(robot: &Robot, pose: &str) -> Configuration {
    let first = robot.poses().first().map(|(name, _)| name.as_str());
    let pose = robot.pose(pose).or_else(|| robot.pose(first?));
    let mut configuration = pose.unwrap_or_else(|| Configuration {
        world_from_base: Isometry3::identity(),
        legs: vec![rover::LegAngles::zeros(); robot.legs().len()],
    });
    let posture = Posture::new(robot, &configuration);
    let lowest = robot
        .leg_ids()
        .map(|leg| posture.wheel(robot, leg).lowest_point(&Vector3::z_axis()).z)
        .fold(f64::INFINITY, f64::min);
    if lowest.is_finite() {
        configuration.world_from_base = Translation3::new(0.0, 0.0, -lowest).into();
    }
    configuration
}

fn obstacles(at: &At<'_>, obstacles: &[WireObstacle]) -> Result<Vec<Obstacle>, RequestError> {
    check::at_most(at, obstacles.len(), OBSTACLES_MAX)?;
    let mut n_triangles = 0;
    obstacles
        .iter()
        .enumerate()
        .map(|(i, obstacle)| match obstacle {
            WireObstacle::Box(solid) => box_of(&at.index(i), solid),
            WireObstacle::Mesh(mesh) => {
                n_triangles += mesh.triangles.len();
                check::at_most(at, n_triangles, OBSTACLE_TRIANGLES_MAX)?;
                mesh_of(&at.index(i), mesh)
            }
        })
        .collect()
}

fn box_of(at: &At<'_>, solid: &BoxObstacle) -> Result<Obstacle, RequestError> {
    let edges = check::edges(&at.field("box_m"), solid.box_m)?;
    let p = check::position(&at.field("position_m"), solid.position_m)?;
    let q = check::unit_quaternion(&at.field("orientation_xyzw"), solid.orientation_xyzw)?;
    Ok(Obstacle::Box {
        world_from_box: Isometry3::from_parts(Vector3::from(p).into(), q),
        half_extents: Vector3::from(edges) * 0.5,
    })
}

fn mesh_of(at: &At<'_>, mesh: &MeshObstacle) -> Result<Obstacle, RequestError> {
    let at = at.field("vertices_m");
    check::at_most(&at, mesh.vertices_m.len(), 3 * OBSTACLE_TRIANGLES_MAX)?;
    for (i, vertex) in mesh.vertices_m.iter().enumerate() {
        check::position(&at.index(i), *vertex)?;
    }
    let vertices = mesh.vertices_m.iter().map(|v| Point3::from(*v)).collect();
    Ok(Obstacle::Mesh { vertices, triangles: mesh.triangles.clone() })
}

fn obstacle_error(at: &At<'_>, error: &SceneError) -> RequestError {
    RequestError::at(
        "obstacle_invalid",
        &at.field("obstacles"),
        format_args!("was refused: {error}"),
    )
}
