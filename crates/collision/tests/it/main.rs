//! Distances against closed forms and brute-force point clouds.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use collision::Scene;
use rover::Robot;
use terrain::ElevationMap;

mod bounds;
mod certificates;
mod checks;
mod follow;
mod motion;
mod oracle;
mod other_robots;
mod wheels;
mod worlds;

fn athlete() -> Arc<Robot> {
    load("athlete")
}

/// A robot that ships.
fn load(name: &str) -> Arc<Robot> {
    let text = |file: &str| testkit::fixture_text(&format!("robots/{name}/{file}"));
    let robot = Robot::from_folder(
        &text("robot.toml"),
        |file| Some(text(file)),
        |mesh| Some(text(mesh).into_bytes()),
    );
    Arc::new(robot.expect("the fixture loads"))
}

fn plane() -> ElevationMap {
    ElevationMap::plane(20.0, 0.5).expect("a plane is a map")
}

/// How many cases a test looks at: `full` where `FOOTFALL_FULL` is 1, else `ordinary`.
fn cases(ordinary: usize, full: usize) -> usize {
    if std::env::var("FOOTFALL_FULL").is_ok_and(|v| v == "1") { full } else { ordinary }
}

fn on_plane() -> Scene {
    Scene::new(athlete(), plane(), &[]).expect("a scene without obstacles")
}
