//! The robot model against hand-derived figures, oracles and hostile input.

use rover::{ModelError, Robot};

mod bad_input;
mod compliance;
mod kinematics;
mod meshes;
mod other_robots;
mod payloads;
mod statics;

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
    .expect("the fixture loads")
}

/// The same with another `robot.toml`.
fn load_with(name: &str, changed: impl Fn(String) -> String) -> Result<Robot, ModelError> {
    let text = |file: &str| testkit::fixture_text(&format!("robots/{name}/{file}"));
    Robot::from_folder(&changed(text("robot.toml")), |file| Some(text(file)), |_| None)
}
