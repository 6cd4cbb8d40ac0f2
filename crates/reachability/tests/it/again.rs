//! An answer brought up to date against one that is found anew.

use collision::Scene;
use geometry::Raster;
use nalgebra::{Point2, UnitQuaternion, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reachability::{Area, CellClass, ReachGrid, ReachOptions, reach, reach_again};
use rover::{LegId, Posture};
use terrain::{ElevationMap, Source};

use crate::scenes::{athlete, boulders, seated};

fn raised(map: &ElevationMap, area: &Area, by: f32) -> ElevationMap {
    let grid = *map.grid();
    let heights = Raster::from_fn(grid, |ix, iy| {
        let p = grid.position(ix, iy);
        let inside = p >= area.min && p <= area.max;
        map.heights().at(ix, iy) + if inside { by } else { 0.0 }
    });
    ElevationMap::new(heights, Source::file("changed"))
}

fn bits(grid: &ReachGrid) -> Vec<(u8, u8, u32, u32)> {
    let numbers = grid.missing.values().iter().zip(grid.margin.values());
    let classes = grid.class.values().iter().zip(grid.reason.values());
    let all = classes.zip(numbers);
    all.map(|((c, r), (missing, margin))| (*c, *r, missing.to_bits(), margin.to_bits())).collect()
}

#[test]
fn what_is_brought_up_to_date_is_what_is_found_anew() {
    let before = Scene::new(athlete(), boulders(9), &[]).unwrap();
    let start = seated(&before);
    let options = ReachOptions { resolution: 0.1, workers: 2, ..Default::default() };
    let leg = LegId(0);
    let of = |scene: &Scene| reach(scene, &start, 1.62, leg, &options, &|| false).unwrap();
    let first = of(&before);
    let mut n_changed = 0;
    // Beside the leg, between hip and wheel, under a wheel that stands, and far away.
    for (x, y) in [(2.4, 1.2), (1.9, -0.4), (2.2, 0.0), (3.6, 0.9), (-4.0, 3.0)] {
        let min = Point2::new(x, y);
        let area = Area { min, max: Point2::new(x + 0.3, y + 0.2) };
        let after = Scene::new(athlete(), raised(before.map(), &area, 0.25), &[]).unwrap();
        let anew = of(&after);
        let again =
            reach_again(&first, &area, &after, &start, 1.62, leg, &options, &|| false).unwrap();
        assert_eq!(bits(&again), bits(&anew), "{x} {y}");
        n_changed += usize::from(bits(&first) != bits(&anew));
    }
    assert!(n_changed >= 3);
}

/// Towers up to the thigh, anywhere about the leg, the base level and tilted.
#[test]
fn wherever_a_tower_rises_what_is_brought_up_to_date_is_what_is_found_anew() {
    let before = Scene::new(athlete(), boulders(10), &[]).unwrap();
    let options = ReachOptions { resolution: 0.1, workers: 2, ..Default::default() };
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let mut n_changed = 0;
    for (leg, tilt) in [(LegId(0), 0.0), (LegId(2), 0.12)] {
        let mut start = seated(&before);
        let turn = UnitQuaternion::from_euler_angles(tilt, -tilt, 0.0);
        start.world_from_base.rotation = turn * start.world_from_base.rotation;
        let of = |scene: &Scene| reach(scene, &start, 1.62, leg, &options, &|| false).unwrap();
        let first = of(&before);
        let posture = Posture::new(before.robot(), &start);
        let hip = posture.link(before.robot().leg(leg).links[0]);
        for _ in 0..14 {
            let (way, turn) = (rng.random_range(0.2..2.6_f64), rng.random_range(-3.2..3.2_f64));
            let min = Point2::from(hip.translation.vector.xy())
                + Vector2::new(turn.cos(), turn.sin()) * way;
            let area = Area { min, max: min + Vector2::new(0.25, 0.15) };
            let by = rng.random_range(0.1..1.2);
            let after = Scene::new(athlete(), raised(before.map(), &area, by), &[]).unwrap();
            let anew = of(&after);
            let again =
                reach_again(&first, &area, &after, &start, 1.62, leg, &options, &|| false).unwrap();
            assert_eq!(bits(&again), bits(&anew), "{leg:?} {min} by {by}");
            n_changed += usize::from(bits(&first) != bits(&anew));
        }
    }
    assert!(n_changed >= 14, "{n_changed}");
}

#[test]
fn an_answer_on_other_cells_is_of_no_use() {
    let scene = Scene::new(athlete(), boulders(9), &[]).unwrap();
    let start = seated(&scene);
    let fine = ReachOptions { resolution: 0.2, ..Default::default() };
    let coarse = ReachOptions { resolution: 0.4, ..Default::default() };
    let far = Area { min: Point2::new(90.0, 90.0), max: Point2::new(91.0, 91.0) };
    let of =
        |options: &ReachOptions| reach(&scene, &start, 1.62, LegId(0), options, &|| false).unwrap();
    let again =
        reach_again(&of(&coarse), &far, &scene, &start, 1.62, LegId(0), &fine, &|| false).unwrap();
    assert_eq!(bits(&again), bits(&of(&fine)));
    assert!(again.class.values().contains(&(CellClass::Reachable as u8)));
}
