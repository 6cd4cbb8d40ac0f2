//! Robots and grounds that the tests share.

use std::sync::Arc;

use collision::{Scene, survey, touchdowns};
use nalgebra::Vector3;
use rover::{Configuration, LegId, Posture, Robot};
use terrain::ElevationMap;
use terrain::synthetic::{Recipe, generate};

pub fn athlete() -> Arc<Robot> {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    Arc::new(robot.unwrap())
}

/// The bent pose over the plane z = 0.
pub fn standing(robot: &Robot) -> Configuration {
    let mut configuration = robot.pose("bent").unwrap();
    let posture = Posture::new(robot, &configuration);
    let low = posture.wheel(robot, LegId(0)).lowest_point(&Vector3::z_axis());
    configuration.world_from_base.translation.z = -low.z;
    configuration
}

/// The bent pose with every wheel on the ground of `scene`.
pub fn seated(scene: &Scene) -> Configuration {
    let robot = scene.robot();
    let mut configuration = standing(robot);
    let posture = Posture::new(robot, &configuration);
    let places: Vec<_> =
        robot.leg_ids().map(|leg| posture.wheel(robot, leg).center().xy()).collect();
    let heights = places.iter().map(|p| scene.map().height_at(*p).unwrap());
    configuration.world_from_base.translation.z += heights.sum::<f64>() / places.len() as f64;
    let posture = Posture::new(robot, &configuration);
    for (leg, p) in robot.leg_ids().zip(places) {
        let near = configuration.legs[leg.0];
        configuration.legs[leg.0] =
            touchdowns(scene, &posture, leg, p, &near, 1).unwrap()[0].angles;
    }
    let standing = survey(scene, &Posture::new(robot, &configuration)).standing;
    assert_eq!(standing.len(), robot.legs().len());
    configuration
}

/// Boulders all about, at a seed.
pub fn boulders(seed: u64) -> ElevationMap {
    let recipe =
        Recipe { width_m: 12.0, height_m: 12.0, flat_center_m: 0.0, ..Recipe::boulder_field() };
    generate(&recipe, seed).unwrap()
}
