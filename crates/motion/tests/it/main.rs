//! Steps of the athlete on planes, slopes and boulder fields, and SBL in seeded scenes.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use collision::{Obstacle, Scene};
use nalgebra::Vector3;
use rover::{Configuration, LegId, Payload, Posture, Robot};
use terrain::ElevationMap;

mod adviser;
mod body_shift;
mod final_check;
mod friction;
mod margins;
mod planners;
mod rehearsal;
mod sbl_scenes;
mod shift;

mod soak;
mod steps;
mod synthetic;
mod timing;
mod trials;
mod unknown_ground;

/// A robot of the fixtures.
fn robot_of(name: &str) -> Robot {
    robot_with(name, |text| text)
}

/// The same with another `robot.toml`.
fn robot_with(name: &str, changed: impl Fn(String) -> String) -> Robot {
    let folder = format!("robots/{name}/");
    let mesh = |file: &str| {
        let path = testkit::project_dir().join("fixtures").join(&folder).join(file);
        std::fs::read(path).ok()
    };
    Robot::from_folder(
        &changed(testkit::fixture_text(&format!("{folder}robot.toml"))),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        mesh,
    )
    .unwrap()
}

fn athlete() -> Robot {
    robot_of("athlete")
}

/// The demo mission's rover: 300 kg on the chassis.
fn loaded() -> Arc<Robot> {
    let (com, edges) = (nalgebra::Point3::new(0.0, 0.0, 0.25), Vector3::new(1.2, 1.2, 0.5));
    let payload = Payload::boxed("chassis", 300.0, com, edges);
    Arc::new(athlete().with_payloads(&[payload]).unwrap())
}

fn scene(robot: Arc<Robot>, obstacles: &[Obstacle]) -> Scene {
    Scene::new(robot, ElevationMap::plane(20.0, 0.25).unwrap(), obstacles).unwrap()
}

/// All wheels on the plane z = 0 in the bent pose.
fn standing(robot: &Robot) -> Configuration {
    let mut configuration = robot.pose("bent").unwrap();
    let posture = Posture::new(robot, &configuration);
    let low = posture.wheel(robot, LegId(0)).lowest_point(&Vector3::z_axis());
    configuration.world_from_base.translation.z = -low.z;
    configuration
}
