//! What the options change: ground that is judged, several legs at once.

use collision::Scene;
use reachability::{CellClass, GroundClasses, ReachOptions, Reason, reach, reach_legs};
use rover::LegId;
use terrain::traversability::{Limits, UNSAFE, traversability};

use crate::scenes::{athlete, boulders, seated};

#[test]
fn ground_that_is_judged_unsafe_is_refused_for_that_and_nothing_else_changes() {
    let scene = Scene::new(athlete(), boulders(3), &[]).unwrap();
    let start = seated(&scene);
    let limits = Limits::default();
    let layers = traversability(scene.map(), 0.5, &limits).unwrap();
    let any = ReachOptions { resolution: 0.15, workers: 2, ..Default::default() };
    let ground = Some(GroundClasses { layers: &layers, unsafe_below: limits.unsafe_below });
    let safe = ReachOptions { ground, ..any };
    let [all, some] =
        [any, safe].map(|o| reach(&scene, &start, 1.62, LegId(3), &o, &|| false).unwrap());
    let mut n = 0;
    for iy in 0..all.grid().ny {
        for ix in 0..all.grid().nx {
            let p = all.grid().position(ix, iy);
            let (before, after) = (*all.class.at(ix, iy), *some.class.at(ix, iy));
            if *some.reason.at(ix, iy) == Reason::Traversability as u8 {
                n += 1;
                assert_eq!(after, CellClass::Unreachable as u8);
                assert_eq!(layers.class.nearest(p), Some(UNSAFE));
                assert!(*some.missing.at(ix, iy) > 0.0);
            } else {
                assert_eq!(before, after, "{p}");
                let reachable = after == CellClass::Reachable as u8;
                assert!(!reachable || layers.class.nearest(p) != Some(UNSAFE), "{p}");
            }
        }
    }
    assert!(n > 10, "{n}");
}

#[test]
fn several_legs_at_once_are_answered_as_one_by_one() {
    let scene = Scene::new(athlete(), boulders(12), &[]).unwrap();
    let start = seated(&scene);
    let options = ReachOptions { resolution: 0.3, workers: 2, ..Default::default() };
    let legs = [LegId(5), LegId(0), LegId(2)];
    let together = reach_legs(&scene, &start, 1.62, &legs, &options, &|| false).unwrap();
    for (leg, grid) in legs.iter().zip(&together) {
        let alone = reach(&scene, &start, 1.62, *leg, &options, &|| false).unwrap();
        assert_eq!((&alone.class, &alone.reason), (&grid.class, &grid.reason));
    }
    assert_eq!(reach_legs(&scene, &start, 1.62, &[], &options, &|| false), Some(Vec::new()));
    assert_eq!(reach_legs(&scene, &start, 1.62, &legs, &options, &|| true), None);
}
