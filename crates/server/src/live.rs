//! The live rover as the server holds it: its model, its ground, and what is asked of it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bridge::bus::Bus;
use bridge::clock::Clock;
use bridge::ground::{Derive, Ground};
use rover::{Configuration, Robot};
use stereo::rig::Rig;
use wire::check::At;
use wire::convert;
use wire::live::{EventLevel, RoverTelemetry};
use wire::resources::{LatestFrame, LegModel, RoverAnswer, RoverModel};
use wire::scene::Payload;
use wire::time::Timestamp;

use crate::analyses::{self, Site};
use crate::error::ApiError;
use crate::scene::LiveScene;
use crate::terrain_store::TerrainStore;

/// The live rover.
pub struct Live {
    /// Rover, link, commands, log and listeners.
    pub ground: Arc<Mutex<Ground>>,
    /// Everything that is published.
    pub bus: Bus,
    clock: Arc<dyn Clock>,
    robot: Arc<Robot>,
    rig: Arc<Rig>,
    payloads: Vec<Payload>,
    gravity: f64,
    friction: f64,
    log_id: String,
}

/// What a live rover is made of.
pub struct LiveParts {
    /// The ground's end of the link.
    pub ground: Ground,
    /// The time.
    pub clock: Arc<dyn Clock>,
    /// The robot, scaled and loaded.
    pub robot: Arc<Robot>,
    /// Its stereo pairs.
    pub rig: Arc<Rig>,
    /// What it is loaded with.
    pub payloads: Vec<Payload>,
    /// Gravity (m/s²).
    pub gravity: f64,
    /// Friction between wheel and ground.
    pub friction: f64,
}

/// What the ground computes from each frame of this robot.
pub fn derive_for(robot: Arc<Robot>, site: Site) -> Derive {
    Box::new(move |frame: &RoverTelemetry| analyses::derive(&robot, &site, frame))
}

impl Live {
    /// A live rover; [`bridge::ground::run`] is to drive its ground.
    pub fn new(parts: LiveParts) -> Live {
        let LiveParts { ground, clock, robot, rig, payloads, gravity, friction } = parts;
        let (bus, log_id) = (ground.bus(), ground.recorder_status().log.id);
        let ground = Arc::new(Mutex::new(ground));
        Live { ground, bus, clock, robot, rig, payloads, gravity, friction, log_id }
    }

    /// The ground, with the time. Held for the length of a call; nothing is awaited under it.
    pub fn locked(&self) -> (MutexGuard<'_, Ground>, Timestamp) {
        let ground = self.ground.lock().unwrap_or_else(PoisonError::into_inner);
        let now = self.clock.now();
        (ground, now)
    }

    /// The robot with scale and payloads.
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Its stereo pairs.
    pub fn rig(&self) -> &Arc<Rig> {
        &self.rig
    }

    /// Gravity (m/s²).
    pub fn gravity(&self) -> f64 {
        self.gravity
    }

    /// The last frame received.
    pub fn latest(&self) -> Result<LatestFrame, ApiError> {
        let (ground, _) = self.locked();
        ground.latest().cloned().ok_or_else(|| {
            ApiError::new("no_state", "no telemetry has come yet; wait one light time and a second")
        })
    }

    /// Where the rover is, as last reported.
    pub fn configuration(&self) -> Result<Configuration, ApiError> {
        let latest = self.latest()?;
        Ok(convert::configuration(&At::root("state"), &self.robot, &latest.frame.state)?)
    }

    /// The rover as a scene on the map in use.
    pub fn scene(&self, store: &TerrainStore) -> LiveScene {
        let version = store.current();
        LiveScene {
            robot: self.robot.clone(),
            map: version.map.clone(),
            version,
            gravity: self.gravity,
            friction: self.friction,
            configuration: self.configuration().ok(),
        }
    }

    /// What the robot is loaded with.
    pub fn payloads(&self) -> &[Payload] {
        &self.payloads
    }

    /// `GET /rover`.
    pub fn answer(&self, terrain_version: String) -> RoverAnswer {
        let (ground, now) = self.locked();
        RoverAnswer {
            model: self.model(),
            latest: ground.latest().cloned(),
            stability: ground.stability().cloned(),
            terrain_version,
            link: ground.link(),
            now,
            simulated: true,
            log_id: self.log_id.clone(),
        }
    }

    /// Tells operators and log what happened.
    pub fn notice(&self, level: EventLevel, who: &str, text: &str) {
        let (mut ground, now) = self.locked();
        ground.notice(now, level, who, text);
    }

    fn model(&self) -> RoverModel {
        let robot = &self.robot;
        RoverModel {
            robot: robot.name().into(),
            model_hash: hash_text(robot.hash()),
            scale: robot.scale(),
            legs: robot.leg_ids().map(|leg| leg_model(robot, leg)).collect(),
            base_link: robot.links().first().map(|link| link.name.clone()).unwrap_or_default(),
            payloads: self.payloads.clone(),
            gravity_m_s2: self.gravity,
            mass_kg: robot.mass(),
            margin_m: robot.stance().margin,
            settlement_m: robot.stance().settlement,
            joint_speed_rad_s: robot.motion().joint_speed,
        }
    }
}

/// A hash as it stands on the wire.
pub fn hash_text(hash: u64) -> String {
    format!("{hash:016x}")
}

fn leg_model(robot: &Robot, leg: rover::LegId) -> LegModel {
    let leg = robot.leg(leg);
    let joint = |index: usize| robot.joints()[index].name.clone();
    LegModel {
        name: leg.name.clone(),
        joints: leg.joints.iter().map(|index| joint(*index)).collect(),
        limits_rad: (0..leg.n_joints()).map(|i| [leg.lower[i], leg.upper[i]]).collect(),
        torque_limits_nm: convert::by_joint(leg, &leg.effort),
        wheel_link: robot.links()[leg.wheel_link.0].name.clone(),
        wheel_joint: leg.wheel_joint.map(joint).unwrap_or_default(),
        wheel_radius_m: leg.wheel.radius,
        wheel_width_m: leg.wheel.width,
        reach_m: leg.ik.reach(),
    }
}
