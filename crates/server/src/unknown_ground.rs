//! Unknown ground under what moves: kept clear of by how high it is taken to be, and never stood on.
//!
//! The cover of a map ([`terrain::cover`]) is what motions keep their clearance to where the map has holes. In a scene it
//! is lowered to where the robot is: ground cannot be where the robot stands now, whatever it may be elsewhere. There it
//! lies [`Tolerances::environment`](rover::Tolerances) below the robot, so that what stands beside a hole is no nearer
//! to it than it may be: about standing wheels the cover tells no more than the robot itself does. Right under the
//! robot that bounds ground too which is too far from known ground to be bounded otherwise.

use std::collections::BTreeMap;

use geometry::Raster;
use nalgebra::{Point3, Vector3};
use rover::{Configuration, Posture, Robot};
use stereo::ray::RayScene;
use terrain::ElevationMap;
use terrain::cover::{CoverLimits, cover};

/// How far below a cover a look upward for the robot begins (m).
const BELOW_M: f64 = 10.0;

/// The cover of a map with holes; none where there are none. `hints` are what else is told of nodes of holes (m).
pub fn cover_of(
    map: &ElevationMap,
    hints: &BTreeMap<(usize, usize), f32>,
    limits: &CoverLimits,
) -> Option<ElevationMap> {
    map.holes()?;
    // Only a map too large to be covered has none, and what is unknown stays so.
    cover(map, hints, limits).ok()
}

/// A scene with what covers its unknown ground, lowered to below the robot where it is.
pub fn covered(
    solid: collision::Scene,
    covered: Option<ElevationMap>,
    configuration: &Configuration,
) -> collision::Scene {
    let Some(covered) = covered else { return solid };
    let robot = solid.robot();
    let posture = Posture::new(robot, configuration);
    let lowered = below_robot(&covered, solid.map(), robot, &posture);
    solid.with_cover(lowered)
}

/// A cover lowered to below the robot where it is now.
fn below_robot(
    covered: &ElevationMap,
    map: &ElevationMap,
    robot: &Robot,
    posture: &Posture,
) -> ElevationMap {
    let scene = RayScene::new(None, Some((robot, posture)));
    let grid = *covered.grid();
    let tolerance = robot.tolerances().environment;
    let is_unknown = |ix: usize, iy: usize| {
        map.heights().nearest(grid.position(ix, iy)).is_none_or(|of| of.is_nan())
    };
    // Where the robot may be above, with a cell about it.
    let margin = 2.0 * grid.resolution;
    let mut ends = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for solid in scene.solids() {
        let (center, radius) = solid.bounds();
        let reach = radius + margin;
        ends = [
            ends[0].min(center.x - reach),
            ends[1].min(center.y - reach),
            ends[2].max(center.x + reach),
            ends[3].max(center.y + reach),
        ];
    }
    let near = |ix: usize, iy: usize| {
        let p = grid.position(ix, iy);
        p.x >= ends[0] && p.y >= ends[1] && p.x <= ends[2] && p.y <= ends[3]
    };
    let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    let beside_unknown = |ix: usize, iy: usize| {
        around(iy, grid.ny).any(|y| around(ix, grid.nx).any(|x| is_unknown(x, y)))
    };
    // The robot's underside over each node that matters (m).
    let undersides: BTreeMap<(usize, usize), f64> = (0..grid.ny)
        .flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy)))
        .filter(|(ix, iy)| near(*ix, *iy) && beside_unknown(*ix, *iy))
        .filter_map(|(ix, iy)| {
            let p = grid.position(ix, iy);
            let floor = f64::from(*covered.heights().at(ix, iy));
            let level = posture.link(rover::LinkId(0)).translation.z;
            let from = if floor.is_nan() { level } else { floor } - BELOW_M;
            let eye = Point3::new(p.x, p.y, from);
            let hit = scene.cast(&eye, &Vector3::z(), 2.0 * BELOW_M)?;
            Some(((ix, iy), from + hit.distance))
        })
        .collect();
    let lowered = Raster::from_fn(grid, |ix, iy| {
        let z = *covered.heights().at(ix, iy);
        if !is_unknown(ix, iy) {
            return z;
        }
        if z.is_nan() {
            return undersides.get(&(ix, iy)).map_or(z, |under| (under - tolerance) as f32);
        }
        // The surface between nodes is to be below the robot too: the lowest about a node counts.
        let under = around(iy, grid.ny)
            .flat_map(|y| around(ix, grid.nx).map(move |x| (x, y)))
            .filter_map(|node| undersides.get(&node))
            .fold(f64::INFINITY, |a, b| a.min(*b));
        z.min((under - tolerance) as f32)
    });
    ElevationMap::new(lowered, covered.source().clone()).with_frame_offset(covered.frame_offset())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geometry::Grid;
    use nalgebra::Point2;
    use rover::LegId;
    use stability::Preference;
    use terrain::Source;
    use terrain::traversability::Limits;
    use wire::check::At;
    use wire::scene::Scene as WireScene;
    use wire::time::Timestamp;

    use super::*;
    use crate::analyses::is_plannable;
    use crate::config::Config;
    use crate::robots::Robots;
    use crate::scene::{Context, LiveScene, Scene, standing_at_origin};
    use crate::stop::Stop;
    use crate::terrain_store::TerrainStore;
    use crate::terrains::{FileRoot, Terrains};

    /// The bent rover on level ground that nobody has seen in a strip of `y` (m), and the way for leg 1 over it.
    fn beside_strip(y: [f64; 2]) -> (Context, Scene) {
        let grid = Grid { origin: Point2::new(-6.0, -6.0), resolution: 0.05, nx: 241, ny: 241 };
        let is_hole = |p: Point2<f64>| p.x > 1.0 && (y[0]..y[1]).contains(&p.y);
        let height = |ix, iy| if is_hole(grid.position(ix, iy)) { f32::NAN } else { 0.0 };
        let map = ElevationMap::new(Raster::from_fn(grid, height), Source::file("strip"));
        let robots = Arc::new(Robots::new(Vec::new()));
        let robot = robots.load(&At::root("robot"), "athlete").unwrap();
        let store = TerrainStore::new(map, Timestamp(5), 0.55, Limits::default(), 2);
        let version = store.current();
        let context = Context {
            robots,
            terrains: Arc::new(Terrains::new(FileRoot::Relative("".into()), None)),
            config: Arc::new(Config::demo()),
            live: Some(LiveScene {
                configuration: Some(standing_at_origin(&robot, "bent")),
                robot,
                map: version.map.clone(),
                version,
                gravity: 1.62,
                friction: 0.7,
            }),
        };
        let scene = context.scene(&At::root("scene"), &WireScene::default()).unwrap();
        (context, scene)
    }

    fn found(scene: &Scene, [x, y]: [f64; 2]) -> bool {
        let stop = Stop::within(60.0);
        let (leg, place) = (LegId(0), Point3::new(x, y, 0.0));
        is_plannable(scene, leg, place, Preference::Regular, &stop).unwrap()
    }

    #[test]
    fn a_leg_goes_over_a_narrow_hole_and_stands_in_none() {
        let (context, scene) = beside_strip([0.38, 0.58]);
        let posture = Posture::new(scene.robot(), &scene.configuration);
        let foot = posture.wheel(scene.robot(), LegId(0)).center();
        let beyond = [foot.x, foot.y + 0.95];
        assert!(found(&scene, beyond), "over it");
        assert!(
            !found(&scene, [foot.x, foot.y + 0.48]),
            "a wheel does not stand on what nobody has seen"
        );
        // What refused it before: no cover.
        let map = context.live.unwrap().map;
        let bare = collision::Scene::new(scene.robot().clone(), map, &[]).unwrap();
        let bare = Scene { solid: bare, ..scene };
        assert!(!found(&bare, beyond), "without a cover a leg goes over no unknown ground");
    }

    #[test]
    fn a_cover_lies_below_the_robot_where_it_stands() {
        // The strip goes right under the foot.
        let (context, scene) = beside_strip([0.1, 0.3]);
        let live = context.live.unwrap();
        let posture = Posture::new(scene.robot(), &scene.configuration);
        let covered = live.version.cover(&CoverLimits::default()).unwrap();
        let lowered = below_robot(covered, &live.map, scene.robot(), &posture);
        let wheel = posture.wheel(scene.robot(), LegId(0));
        let (mut n_lowered, grid) = (0, *lowered.grid());
        for (ix, iy) in (0..grid.ny).flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy))) {
            let (before, after) = (*covered.heights().at(ix, iy), *lowered.heights().at(ix, iy));
            assert!(after <= before || before.is_nan());
            let p = grid.position(ix, iy);
            n_lowered += usize::from(after < before);
            let off = (p - wheel.center().xy()).norm();
            assert!(
                after >= before || off < 1.0 || p.coords.norm() < 4.0,
                "{p} is not below the robot"
            );
        }
        assert!(n_lowered > 0);
        // So the robot is clear of it, as it was of the map.
        let survey = collision::survey(&scene.solid, &posture);
        assert!(survey.terrain_collision().is_none(), "{:?}", survey.environment);
    }
}
