//! The simulated rover on planes, slopes, synthetic and real ground.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use collision::{Scene, wheel_ground};
use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rover::{Configuration, LegAngles, LegId, Payload, Posture, Robot};
use sim::{BodyKnot, Command, Event, JointKnot, Motion, SettleOptions, SimRover, Stage, settle};
use terrain::{ElevationMap, Source};

mod cameras;
mod drive;
mod events;
mod motion;
mod operations;
mod preload;
mod properties;
mod refusals;
mod settling;
mod shift;
mod silence;
mod stops;
mod timing;

/// Moon.
const GRAVITY: f64 = 1.62;

/// The robot of the missions.
fn athlete() -> Robot {
    load("athlete")
}

/// A robot that ships.
fn load(name: &str) -> Robot {
    let text = |file: &str| testkit::fixture_text(&format!("robots/{name}/{file}"));
    Robot::from_folder(
        &text("robot.toml"),
        |file| Some(text(file)),
        |mesh| Some(text(mesh).into_bytes()),
    )
    .unwrap()
}

/// The robot of the demo mission: 300 kg on the chassis.
fn demo_robot() -> Robot {
    let (com, edges) = (Point3::new(0.0, 0.0, 0.25), Vector3::new(1.2, 1.2, 0.5));
    let payload = Payload::boxed("chassis", 300.0, com, edges);
    athlete().with_payloads(&[payload]).unwrap()
}

fn scene(robot: Robot, map: ElevationMap) -> Scene {
    Scene::new(Arc::new(robot), map, &[]).unwrap()
}

/// Ground of the given height, 16 m x 16 m around the origin, nodes 0.1 m apart.
fn ground(height: impl Fn(f64, f64) -> f64) -> ElevationMap {
    let grid = Grid { origin: Point2::new(-8.0, -8.0), resolution: 0.1, nx: 161, ny: 161 };
    let heights = Raster::from_fn(grid, |ix, iy| {
        let p = grid.position(ix, iy);
        height(p.x, p.y) as f32
    });
    ElevationMap::new(heights, Source::file("test"))
}

fn plane() -> ElevationMap {
    ElevationMap::plane(20.0, 0.5).unwrap()
}

/// The demo rover, idle on the plane z = 0, its legs bent.
fn on_plane() -> SimRover {
    let scene = scene(demo_robot(), plane());
    let options = SettleOptions::default();
    let settled = settle(&scene, Point2::origin(), 0.0, "bent", &options).unwrap();
    SimRover::new(scene, settled.configuration, GRAVITY).unwrap()
}

/// Advances by ticks of 0.1 s.
fn run(rover: &mut SimRover, seconds: f64) {
    for _ in 0..(seconds / 0.1).round() as usize {
        rover.advance(0.1);
    }
}

fn command(id: &str, motion: Motion) -> Command {
    Command { id: id.into(), motion, basis: None, epoch: None }
}

/// From where the leg is through these offsets from there (rad).
fn path_by(rover: &SimRover, leg: usize, offsets: &[LegAngles]) -> Motion {
    let here = rover.configuration().legs[leg];
    let knots = std::iter::once(here).chain(offsets.iter().map(|offset| here + offset));
    joint_path(&format!("leg{}", leg + 1), knots.map(|angles| (angles, 0.0)))
}

/// A path through angles (rad) at times (s).
fn joint_path(leg: &str, knots: impl IntoIterator<Item = (LegAngles, f64)>) -> Motion {
    let knots = knots.into_iter().map(|(angles, time_s)| JointKnot { angles, time_s }).collect();
    Motion::JointPath { leg: leg.into(), knots }
}

/// How long a motion of one piece takes whose slowest joint goes this far (s), as fast as it can:
/// 0.1 rad/s with half a second to speed up and to slow down.
fn quickest(angle: f64) -> f64 {
    assert!(angle >= 0.05);
    angle / 0.1 + 0.5
}

/// Angles (rad) of all legs with the base moved by `by` (in the base's frame) and all wheels where
/// they are: of each leg the nearest solution.
fn shifted(robot: &Robot, configuration: &Configuration, by: &Isometry3<f64>) -> Vec<LegAngles> {
    let before = Posture::new(robot, configuration);
    let world_from_base = configuration.world_from_base * by;
    let after = Posture::new(robot, &Configuration { world_from_base, ..configuration.clone() });
    let solve = |leg: LegId| {
        let wheel = before.wheel(robot, leg).world_from_wheel;
        let all = after.inverse_kinematics(robot, leg, &wheel).unwrap();
        let change = |angles: &LegAngles| (angles - configuration.legs[leg.0]).amax();
        let within = all.iter().filter(|s| s.within_limits).map(|s| s.angles);
        within.min_by(|a, b| change(a).total_cmp(&change(b))).unwrap()
    };
    robot.leg_ids().map(solve).collect()
}

/// Knots of a shift by `by` in `n` equal pieces, each `piece_s` long (s).
fn shift_knots(rover: &SimRover, by: &Isometry3<f64>, n: usize, piece_s: f64) -> Vec<BodyKnot> {
    let robot = rover.scene().robot();
    let turn = by.rotation.scaled_axis();
    (0..=n)
        .map(|i| {
            let share = i as f64 / n as f64;
            let part = Isometry3::new(by.translation.vector * share, turn * share);
            let angles = shifted(robot, rover.configuration(), &part);
            let name = |leg: LegId| robot.leg(leg).name.clone();
            let legs = robot.leg_ids().map(|leg| (name(leg), angles[leg.0])).collect();
            BodyKnot { legs, time_s: piece_s * i as f64 }
        })
        .collect()
}
/// Hip pitch up by `angle` (rad): lifts the wheel.
fn raise(angle: f64) -> LegAngles {
    LegAngles::new(0.0, -angle, 0.0, 0.0, 0.0, 0.0)
}

/// The stages that a command went through.
fn stages(events: &[Event], id: &str) -> Vec<Stage> {
    events.iter().filter(|event| event.id == id).map(|event| event.stage).collect()
}

/// What was said of a command last.
fn last_detail(events: &[Event], id: &str) -> String {
    let last = events.iter().rev().find(|event| event.id == id).unwrap();
    last.detail.clone().unwrap_or_default()
}

fn wheel_center(rover: &SimRover, leg: usize) -> Point3<f64> {
    let robot = rover.scene().robot();
    Posture::new(robot, rover.configuration()).wheel(robot, LegId(leg)).center()
}

/// Vertical gap of a wheel to the ground (m).
fn gap(scene: &Scene, configuration: &Configuration, leg: usize) -> f64 {
    let robot = scene.robot();
    let wheel = Posture::new(robot, configuration).wheel(robot, LegId(leg));
    wheel_ground(&wheel, scene.map(), |_| true).nearest.unwrap().gap
}

/// The wheel of a level robot pose at the origin touches this far below the base (m).
fn pose_height(robot: &Robot, pose: &str) -> f64 {
    let configuration =
        Configuration { world_from_base: Isometry3::identity(), ..robot.pose(pose).unwrap() };
    let wheel = Posture::new(robot, &configuration).wheel(robot, LegId(0));
    -wheel.lowest_point(&Vector3::z_axis()).z
}
