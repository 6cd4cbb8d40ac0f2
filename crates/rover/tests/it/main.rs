//! The robot model against hand-derived figures, oracles and hostile input.

use rover::Robot;

mod bad_input;
mod kinematics;
mod statics;

/// The robot that ships.
fn athlete() -> Robot {
    let folder = "robots/athlete/";
    Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    )
    .expect("the fixture loads")
}
