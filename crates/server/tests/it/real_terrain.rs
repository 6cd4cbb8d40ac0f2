//! The main job on real ground, where the shared data is at hand.

use std::path::Path;

use server::serve::Mission;
use server::terrains::FileRoot;

use crate::support::{Ground, TempDir, config};

/// Brings a ground up on a file, plans steps of each leg until one is found, and takes it.
async fn one_step_on(file: &Path, scale: f64, change: impl FnOnce(&mut Mission)) {
    let dir = TempDir::new();
    let mut config = config(dir.path());
    config.terrain.file = file.file_name().unwrap().to_str().unwrap().to_owned();
    let root = FileRoot::Relative(file.parent().unwrap().to_owned());
    let mut mission = Mission { config, root, place_m: None, rover: None };
    change(&mut mission);
    let ground = Ground::of(mission, dir).await;
    let mut found = None;
    'search: for leg in 1..=6 {
        for step in [[0.2, 0.0], [0.0, 0.2], [-0.2, 0.0], [0.0, -0.2], [0.1, 0.1], [-0.1, 0.1]] {
            let plan = ground.plan(&format!("leg{leg}"), step.map(|d: f64| d * scale)).await;
            if plan["outcome"] == "found" {
                found = Some(plan);
                break 'search;
            }
        }
    }
    let plan = found.expect("a step of some leg");
    for index in 0..3 {
        let ended = ground.execute(plan["id"].as_str().unwrap(), index).await;
        assert_eq!(ended["state"], "done", "{ended}");
    }
    let leg = plan["leg"].as_str().unwrap();
    let there = || async {
        let rover = ground.get("/api/v1/rover").await.json();
        rover["latest"]["frame"]["contacts"][leg] == true && ground.off_footfall(&plan).await < 1e-6
    };
    ground.until("the wheel at its footfall", there).await;
}

#[tokio::test]
async fn one_step_on_the_fractal_terrain_at_model_scale() {
    let test = "server::one_step_on_the_fractal_terrain_at_model_scale";
    let path = testkit::shared_data_path(test, "klampt_terrains/fractal_terrain_1.off");
    let Some(path) = path else { return };
    one_step_on(&path, 1.0 / 3.0, |mission| {
        let rover = &mut mission.config.rover;
        rover.scale = 1.0 / 3.0;
        for length in [
            &mut rover.payload_z_m,
            &mut rover.payload_box_x_m,
            &mut rover.payload_box_y_m,
            &mut rover.payload_box_z_m,
        ] {
            *length /= 3.0;
        }
    })
    .await;
}

#[tokio::test]
async fn one_step_on_mars_with_foot_scale_detail() {
    let test = "server::one_step_on_mars_with_foot_scale_detail";
    let Some(path) = testkit::shared_data_path(test, "gale_hirise_1m/missionDEM.tif") else {
        return;
    };
    one_step_on(&path, 1.0, |mission| {
        mission.config.rover.gravity_m_s2 = 3.71;
        mission.config.terrain.crop_width_m = 60.0;
        mission.config.terrain.detail_resolution_m = 0.05;
    })
    .await;
}
