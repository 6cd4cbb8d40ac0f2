//! Stability against closed forms, independent oracles and degenerate input.

use nalgebra::{Isometry3, Point3, Vector3};
use rover::{Configuration, LegId, Payload, Posture, Robot};
use stability::loads::{LegSpring, compliant_share};

mod compliance;
mod contact_forces;
mod degenerate;
mod energy;
mod guard;
mod kept_region;
mod linear;
mod margins;
mod oracle;
mod own_springs;
mod paper;
mod properties;
mod regions;
mod rule;
mod shear;
mod slopes;
mod torque;

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

/// The same robot with 35 % of its mass more, in the middle of the chassis.
fn loaded() -> Robot {
    let robot = athlete();
    let payload = Payload {
        link: "chassis".into(),
        mass: 0.35 * robot.mass(),
        com: Point3::origin(),
        shapes: Vec::new(),
        limits: Vec::new(),
    };
    robot.with_payloads(&[payload]).expect("the fixture has it")
}

/// The robot with all legs in a named pose, its wheels on the plane z = 0.
fn on_plane(robot: &Robot, pose: &str) -> Posture {
    let at_origin = robot.pose(pose).expect("the fixture has it");
    let wheel = Posture::new(robot, &at_origin).wheel(robot, LegId(0));
    let lift = -wheel.lowest_point(&Vector3::z_axis()).z;
    Posture::new(
        robot,
        &Configuration { world_from_base: Isometry3::translation(0.0, 0.0, lift), ..at_origin },
    )
}

/// Contacts of these legs' wheels on a level plane.
fn contacts(robot: &Robot, posture: &Posture, legs: &[usize]) -> Vec<(LegId, Point3<f64>)> {
    let touch = |leg| posture.wheel(robot, leg).lowest_point(&Vector3::z_axis());
    legs.iter().map(|leg| (LegId(*leg), touch(LegId(*leg)))).collect()
}

/// Loads of equal springs that would bear `preload_n` in the stance's present shape.
fn preloaded_share(
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    weight: f64,
    preload_n: &[f64],
) -> Option<Vec<f64>> {
    let spring = |load: &f64| LegSpring { stiffness_n_m: 2_000.0, pressed_m: load / 2_000.0 };
    let springs: Vec<LegSpring> = preload_n.iter().map(spring).collect();
    compliant_share(contacts, com, weight, &springs)
}

/// The corners of a regular hexagon of 1 m radius, at 60° k, on ground of uneven height.
fn hexagon() -> Vec<Point3<f64>> {
    (0..6_u32)
        .map(|k| {
            let azimuth = std::f64::consts::TAU * f64::from(k) / 6.0;
            Point3::new(azimuth.cos(), azimuth.sin(), 0.2 * f64::from(k % 3))
        })
        .collect()
}

/// The hexagon without some corners.
fn without(lost: &[usize]) -> Vec<Point3<f64>> {
    let kept = |k: &usize| !lost.contains(k);
    (0..6).filter(kept).map(|k| hexagon()[k]).collect()
}
