//! The self-mask on rendered images of the rig, and the whole way from ground to points.

use std::collections::{HashMap, HashSet};

use geometry::{Grid, Raster};
use nalgebra::{Point2, Vector3};
use rover::{Configuration, Posture, Robot};
use stereo::camera::Camera;
use stereo::matching::Matching;
use stereo::pair::{PairOptions, Reconstruction, reconstruct};
use stereo::ray::RayScene;
use stereo::render::{Light, PairTruth, RenderOptions, pair_truth, render};
use stereo::rig::CameraPair;
use stereo::sag::{hip_turns, turned};
use stereo::self_mask::{LinkSigmas, MaskOptions, PostureErrors, tag_robot, tag_template};
use stereo::surface::{Surface, Tag, TriangulateOptions};
use terrain::{ElevationMap, Source};

use crate::camera::size;
use crate::matching::never;
use crate::ray::{athlete, standing};
use crate::rig::rig;

fn light() -> RenderOptions {
    RenderOptions {
        light: Light { sun: Vector3::new(0.5, 0.3, 0.8), ambient: 0.15, shadows: true },
        // Texture of a pixel's width is left out anyway.
        rays: 1,
        threads: 2,
        ..RenderOptions::default()
    }
}

/// Renders a pair over a scene and reconstructs it, with the truth of its rectified images.
fn take(
    scene: &RayScene,
    cameras: &[Camera; 2],
    range: [f64; 2],
    sigma_disparity: f64,
    seed: u64,
) -> (Reconstruction, PairTruth) {
    let options = light();
    let see = |camera, seed| render(scene, camera, &options, seed, &never).unwrap();
    let images = [see(&cameras[0], 2 * seed), see(&cameras[1], 2 * seed + 1)];
    let triangulate =
        TriangulateOptions { range, sigma_disparity, ..TriangulateOptions::default() };
    let matching = Matching { disparities: 128, ..Matching::default() };
    let how = PairOptions { triangulate, matching, ..PairOptions::default() };
    let [left, right] = cameras;
    let found = reconstruct([left, right], [&images[0], &images[1]], &how, &never).unwrap();
    let truth = pair_truth(scene, &found.surface.geometry, &options, &never).unwrap();
    (found, truth)
}

#[test]
fn from_rough_ground_to_points_the_noise_is_what_it_is_said_to_be() {
    // Waves and steps of a hand's height.
    let grid = Grid { origin: Point2::new(-8.0, -8.0), resolution: 0.05, nx: 321, ny: 321 };
    let heights = Raster::from_fn(grid, |ix, iy| {
        let p = grid.position(ix, iy);
        let wave = 0.10 * (1.3 * p.x + 0.4 * p.y).sin() + 0.06 * (2.1 * p.y - 0.7 * p.x).cos();
        let rock = if (p - Point2::new(4.1, 2.3)).norm() < 0.3 { 0.2 } else { 0.0 };
        (wave + rock) as f32
    });
    let map = ElevationMap::new(heights, Source::file("waves"));
    let robot = athlete();
    let (mut configuration, _) = standing(&robot);
    configuration.world_from_base.translation.z += 0.15;
    let posture = Posture::new(&robot, &configuration);
    let scene = RayScene::new(Some(&map), Some((&robot, &posture)));
    let pair = rig().pair("nav1").unwrap().resized(size(384, 288)).unwrap();
    let cameras = pair.cameras(&posture);
    let options = TriangulateOptions::default();
    let (mut found, truth) = take(&scene, &cameras, pair.range, options.sigma_disparity, 1);
    let sigmas = LinkSigmas::new(&robot, &posture, &PostureErrors::default());
    tag_robot(&mut found.surface, &scene, &sigmas, &MaskOptions::default()).unwrap();
    let (mut n, mut squares, mut normalized, mut n_far) = (0.0, 0.0, 0.0, 0.0);
    let eye = cameras[0].center();
    for point in &found.surface.points {
        let i = usize::from(point.pixel[1]) * 384 + usize::from(point.pixel[0]);
        if point.tag != Tag::Terrain || truth.left.link[i].is_some() || truth.occluded[i] {
            continue;
        }
        let p = point.position;
        let Some((z, [gx, gy])) = map.surface_at(p.xy()) else { continue };
        if (p - eye).norm() > 4.0 {
            continue;
        }
        // Height above the ground, and its variance given the slope.
        let up = Vector3::new(-gx, -gy, 1.0);
        let (miss, variance) = (p.z - z, up.dot(&(point.covariance * up)));
        if miss.abs() > 5.0 * variance.sqrt() {
            n_far += 1.0;
            continue;
        }
        n += 1.0;
        squares += miss * miss;
        normalized += miss * miss / variance;
    }
    // What is farther off is no noise of the match, but counts as so many sigmas.
    normalized += 25.0 * n_far;
    let (rmse, ratio) = (f64::sqrt(squares / n), f64::sqrt(normalized / (n + n_far)));
    let health = found.health;
    println!(
        "waves, 384 x 288 within 4 m: {n} points, z rmse {rmse:.4} m, z/sigma {ratio:.2}, {n_far} beyond 5 sigma; fill {:.2}, {:?}",
        health.fill, health.epipolar
    );
    assert!(n > 8000.0 && n_far / n < 0.01);
    // A pixel is 2.7 times as wide here as in the images of 1024 columns, for which the gate of 2 cm is.
    assert!(rmse < 0.02 * 1024.0 / 384.0, "{rmse}");
    assert!((0.8..=1.3).contains(&ratio), "{ratio}");
    // Disparities of what both cameras see.
    let values = found.disparity.values();
    let seen = (0..values.len()).filter(|i| !truth.occluded[*i] && truth.left.lit[*i]);
    let (mut total, mut bad, mut known) = (0.0, 0.0, 0.0);
    for i in seen {
        total += 1.0;
        if !values[i].is_nan() {
            known += 1.0;
            bad += f64::from(u8::from((values[i] - truth.disparity[i]).abs() > 2.0));
        }
    }
    println!("  of {total} lit pixels {:.3} known, bad-2 {:.4}", known / total, bad / known);
    assert!(known / total > 0.8 && bad / known < 0.04);
}

/// Cells of 5 cm.
fn cell(p: Point2<f64>) -> (i64, i64) {
    ((p.x / 0.05).floor() as i64, (p.y / 0.05).floor() as i64)
}

const CELL_AREA: f64 = 0.05 * 0.05;

/// What a tagging does: robot that got in (m²), terrain lost beyond 10 cm of the robot as a share and in m².
#[derive(Debug, Default)]
struct Outcome {
    leaked: f64,
    lost: f64,
    lost_share: f64,
}

fn judge(views: &[(Surface, PairTruth)], actual: &RayScene) -> Outcome {
    let mut leaked = HashSet::new();
    // By cell: whether it was seen as ground away from the robot, and whether any of it is kept.
    let mut ground: HashMap<(i64, i64), bool> = HashMap::new();
    for (surface, truth) in views {
        for point in &surface.points {
            let width = truth.left.size.width;
            let i = usize::from(point.pixel[1]) * width + usize::from(point.pixel[0]);
            let kept = point.tag == Tag::Terrain;
            // The plane is z = 0: a point of the robot that is well above it would be an obstacle.
            if truth.left.link[i].is_some() {
                if kept && point.position.z > 0.08 {
                    leaked.insert(cell(point.position.xy()));
                }
                continue;
            }
            let is_ground = !truth.occluded[i] && point.position.z.abs() < 0.05;
            let away = || {
                actual.solids().iter().all(|solid| {
                    let (center, radius) = solid.bounds();
                    (point.position - center).norm() - radius > 0.1
                        || solid.distance(&point.position) > 0.1
                })
            };
            if is_ground && away() {
                *ground.entry(cell(point.position.xy())).or_default() |= kept;
            }
        }
    }
    let lost = ground.values().filter(|kept| !**kept).count() as f64;
    Outcome {
        leaked: leaked.len() as f64 * CELL_AREA,
        lost: lost * CELL_AREA,
        lost_share: lost / ground.len() as f64,
    }
}

/// The posture in which each wheel is `sag` straight below where `configuration` has it.
fn sagged(robot: &Robot, configuration: &Configuration, sag: f64) -> Posture {
    let reported = Posture::new(robot, configuration);
    let mut actual = configuration.clone();
    for leg in robot.leg_ids() {
        let mut wheel = reported.wheel(robot, leg).world_from_wheel;
        wheel.translation.z -= sag;
        let solutions = reported.inverse_kinematics(robot, leg, &wheel).unwrap();
        let near = |angles: &rover::LegAngles| (angles - configuration.legs[leg.0]).norm();
        let best = solutions.iter().map(|solution| solution.angles);
        actual.legs[leg.0] = best.min_by(|a, b| near(a).total_cmp(&near(b))).unwrap();
        assert!(near(&actual.legs[leg.0]) < 0.5, "the leg bends, it does not flip");
    }
    Posture::new(robot, &actual)
}

/// The same, all by a turn of the hip pitch.
fn hip_sagged(robot: &Robot, configuration: &Configuration, sag: f64) -> Posture {
    let height = |configuration: &Configuration, leg| {
        Posture::new(robot, configuration).wheel(robot, leg).center().z
    };
    let mut actual = configuration.clone();
    for leg in robot.leg_ids() {
        let wanted = height(configuration, leg) - sag;
        for _ in 0..20 {
            let here = height(&actual, leg);
            let mut turned = actual.clone();
            turned.legs[leg.0][1] += 1e-4;
            let slope = (height(&turned, leg) - here) / 1e-4;
            actual.legs[leg.0][1] += (wanted - here) / slope;
        }
        assert!((height(&actual, leg) - wanted).abs() < 1e-6);
    }
    Posture::new(robot, &actual)
}

#[test]
fn the_self_mask_keeps_legs_out_and_the_ground_beside_them_in() {
    let robot = athlete();
    let (on_ground, _) = standing(&robot);
    let map = ElevationMap::plane(8.0, 0.1).unwrap();
    let rig = rig();
    for (sag, in_hip) in [(0.0, false), (0.1, false), (0.1, true)] {
        // Reported `sag` above the ground; in truth the wheels still stand.
        let mut reported = on_ground.clone();
        reported.world_from_base.translation.z += sag;
        let actual = if in_hip { hip_sagged } else { sagged }(&robot, &reported, sag);
        let said = reported;
        let reported = Posture::new(&robot, &said);
        let scene = RayScene::new(Some(&map), Some((&robot, &actual)));
        let sigmas = LinkSigmas::new(&robot, &reported, &PostureErrors::default());
        let wheels: Vec<Point2<f64>> = robot
            .leg_ids()
            .map(|leg| reported.wheel(&robot, leg).world_from_wheel.translation.vector.xy().into())
            .collect();
        let [mut masked, mut flattened, mut raw] = [const { Vec::new() }; 3];
        let pairs = rig.pairs().iter().filter(|pair| pair.name.starts_with("haz"));
        let mut taken = Vec::new();
        for (i, pair) in pairs.enumerate() {
            let pair: CameraPair = pair.resized(size(512, 384)).unwrap();
            // The cameras are on the chassis, which is where it is said to be.
            let (found, truth) = take(&scene, &pair.cameras(&actual), pair.range, 0.3, i as u64);
            taken.push((found, truth));
        }
        let surfaces: Vec<&Surface> = taken.iter().map(|(found, _)| &found.surface).collect();
        let turns = hip_turns(&surfaces, &robot, &said, &PostureErrors::default());
        println!("turns of the hips (rad): {turns:.3?}");
        if sag == 0.0 {
            assert!(turns.iter().all(|turn| *turn == 0.0), "{turns:?}");
        }
        let mended = Posture::new(&robot, &turned(&said, &turns));
        let believed = RayScene::new(None, Some((&robot, &mended)));
        for (found, truth) in taken {
            let mut mask = found.surface.clone();
            let counts = tag_robot(&mut mask, &believed, &sigmas, &MaskOptions::default()).unwrap();
            assert_eq!(counts.terrain + counts.robot + counts.shadow_band, mask.points.len());
            let mut template = found.surface.clone();
            tag_template(&mut template, &wheels, 0.6);
            masked.push((mask, truth.clone()));
            flattened.push((template, truth.clone()));
            raw.push((found.surface, truth));
        }
        let [mask, template, raw] = [masked, flattened, raw].map(|views| judge(&views, &scene));
        println!(
            "sag {sag} m{}:\n  mask {mask:?}\n  template {template:?}\n  raw {raw:?}",
            if in_hip { ", all in the hip" } else { "" }
        );
        assert!(raw.leaked > 0.2, "without a mask the robot is in the map: {raw:?}");
        assert!(mask.lost * 5.0 <= template.lost, "{mask:?} {template:?}");
        if sag == 0.0 {
            assert_eq!(mask.leaked, 0.0);
            assert!(mask.lost_share < 0.02, "{mask:?}");
        } else {
            assert!(mask.leaked <= 0.1, "{mask:?}");
        }
    }
}
