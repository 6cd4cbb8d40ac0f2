//! What the robot itself hides of the ground from its pairs, part by part.

use std::collections::BTreeMap;

use geometry::Raster;
use nalgebra::{Point2, Point3, Vector3};
use rover::{Posture, Robot};
use stereo::StereoError;
use stereo::camera::Camera;
use stereo::coverage::Coverage;
use stereo::ray::{RayScene, Target};
use stereo::rig::CameraPair;
use terrain::ElevationMap;
use wire::map_version::HiddenGround;

/// Ground within this of the end of a ray is what was meant (m).
const SLACK_M: f64 = 5e-3;

/// The map, its unknown nodes at the height of the nearest of `wheels` (m): what pairs would see there is
/// asked with a guess, which no plan ever rests on.
pub fn guessed(map: &ElevationMap, wheels: &[Point3<f64>]) -> ElevationMap {
    let heights = map.heights();
    if wheels.is_empty() || !heights.values().iter().any(|z| z.is_nan()) {
        return map.clone();
    }
    let grid = *map.grid();
    let filled = Raster::from_fn(grid, |ix, iy| {
        let z = *heights.at(ix, iy);
        let p = grid.position(ix, iy);
        let off = |wheel: &&Point3<f64>| (wheel.xy() - p).norm_squared();
        let nearest = || wheels.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        if z.is_nan() { nearest().map_or(z, |wheel| wheel.z as f32) } else { z }
    });
    ElevationMap::new(filled, map.source().clone())
}

/// The ground that no pair sees and one would see if a part of the robot were not in between: what
/// hides it, largest first, and for each node 0 or one more than its place in that list.
///
/// The area is that of whole nodes; of a leg all links count together.
pub fn hidden(
    covered: &Coverage,
    pairs: &[CameraPair],
    robot: &Robot,
    posture: &Posture,
    map: &ElevationMap,
    stop: &dyn Fn() -> bool,
) -> Result<(Vec<HiddenGround>, Vec<u8>), StereoError> {
    let grid = covered.grid;
    let (ground, body) =
        (RayScene::new(Some(map), None), RayScene::new(None, Some((robot, posture))));
    let seen = covered.counts();
    let cameras: Vec<([Camera; 2], [f64; 2])> =
        pairs.iter().map(|pair| (pair.cameras(posture), pair.range)).collect();
    let mut nodes: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for iy in 0..grid.ny {
        if stop() {
            return Err(StereoError::Stopped);
        }
        for ix in (0..grid.nx).filter(|ix| *seen.at(*ix, iy) == 0) {
            let at = grid.position(ix, iy);
            let Some(z) = map.height_at(at) else { continue };
            let point = Point3::new(at.x, at.y, z);
            let blocked = cameras.iter().find_map(|(cameras, range)| {
                blocked_by(cameras, *range, &ground, &body, robot, &point)
            });
            if let Some(name) = blocked {
                nodes.entry(name).or_default().push(grid.index(ix, iy));
            }
        }
    }
    let mut groups: Vec<(String, Vec<usize>)> = nodes.into_iter().collect();
    groups.sort_by_key(|(_, nodes)| std::cmp::Reverse(nodes.len()));
    groups.truncate(usize::from(u8::MAX));
    let mut mask = vec![0_u8; grid.len()];
    let mut told = Vec::with_capacity(groups.len());
    for (i, (by, nodes)) in groups.into_iter().enumerate() {
        let place = |node: &usize| grid.position(node % grid.nx, node / grid.nx);
        let sum = nodes.iter().fold(Vector3::zeros().xy(), |sum, node| sum + place(node).coords);
        let middle = Point2::from(sum / nodes.len() as f64);
        let off = |node: &&usize| (place(node) - middle).norm_squared();
        let nearest = nodes.iter().min_by(|a, b| off(a).total_cmp(&off(b))).map(place);
        let area_m2 = nodes.len() as f64 * grid.resolution * grid.resolution;
        let place_m = nearest.unwrap_or(middle);
        told.push(HiddenGround { by, area_m2, place_m: [place_m.x, place_m.y] });
        for node in nodes {
            mask[node] = i as u8 + 1;
        }
    }
    Ok((told, mask))
}

/// The part of the robot between a pair and a point that lies in both images, within its range, and behind
/// no ground.
fn blocked_by(
    cameras: &[Camera; 2],
    [near, far]: [f64; 2],
    ground: &RayScene,
    body: &RayScene,
    robot: &Robot,
    point: &Point3<f64>,
) -> Option<String> {
    let mut hit = None;
    for camera in cameras {
        let depth = camera.depth_in_view(point)?;
        let way = point - camera.center();
        if !((near..=far).contains(&depth) && ground.sees(&camera.center(), point, SLACK_M)) {
            return None;
        }
        let length = way.norm();
        hit = hit
            .or_else(|| body.cast(&camera.center(), &(way / length), (length - SLACK_M).max(0.0)));
    }
    let Target::Link(link) = hit?.target else { return None };
    Some(match robot.body_of(link) {
        Some((leg, _)) => robot.leg(leg).name.clone(),
        None => robot.links()[link.0].name.clone(),
    })
}
