//! Distances against closed forms and brute-force point clouds.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use collision::Scene;
use rover::Robot;
use terrain::ElevationMap;

mod checks;
mod wheels;

fn athlete() -> Arc<Robot> {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    Arc::new(robot.expect("the fixture loads"))
}

fn plane() -> ElevationMap {
    ElevationMap::plane(20.0, 0.5).expect("a plane is a map")
}

fn on_plane() -> Scene {
    Scene::new(athlete(), plane(), &[]).expect("a scene without obstacles")
}
