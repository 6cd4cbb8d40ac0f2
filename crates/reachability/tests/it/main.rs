//! Cells against closed forms, the step planner's rules and each other.
#![allow(clippy::unwrap_used)]

mod again;
mod explain;
mod options;
mod oracle;
mod scenes;

use collision::{Obstacle, Scene};
use geometry::Raster;
use nalgebra::{Isometry3, Point2, Vector3};
use reachability::{CellClass, ReachGrid, ReachOptions, Reason, reach};
use rover::LegId;
use stability::rule::Preference;
use terrain::{ElevationMap, Source};

const LEG: LegId = LegId(0);

use scenes::{athlete, standing};

fn options() -> ReachOptions<'static> {
    ReachOptions { resolution: 0.1, lift: 0.2, workers: 2, ..ReachOptions::default() }
}

fn reach_on(map: ElevationMap, obstacles: &[Obstacle], options: &ReachOptions) -> ReachGrid {
    let scene = Scene::new(athlete(), map, obstacles).unwrap();
    let start = standing(scene.robot());
    reach(&scene, &start, 1.62, LEG, options, &|| false).unwrap()
}

fn level() -> ElevationMap {
    ElevationMap::plane(12.0, 0.25).unwrap()
}

fn class(grid: &ReachGrid, x: f64, y: f64) -> u8 {
    grid.class.nearest(Point2::new(x, y)).unwrap()
}

#[test]
fn the_place_under_the_wheel_is_reachable_and_far_ground_is_not() {
    let grid = reach_on(level(), &[], &options());
    let foot = 2.2428; // the bent stance's foot radius
    assert_eq!(class(&grid, foot, 0.0), CellClass::Reachable as u8);
    assert_eq!(class(&grid, foot, 0.4), CellClass::Reachable as u8);
    // Straight out the wrist is at most 0.351 + 0.735 + 0.489 m from the hip axis.
    assert_eq!(class(&grid, 1.341 + 0.351 + 0.735 + 0.489 + 0.552 + 0.1, 0.0), 1);
}

#[test]
fn what_is_out_of_reach_says_by_how_much() {
    let grid = reach_on(level(), &[], &options());
    let p = Point2::new(3.6, 0.0);
    assert_eq!(grid.reason.nearest(p).unwrap(), Reason::OutOfReach as u8);
    let missing = f64::from(grid.missing.nearest(p).unwrap());
    // The fork may lean 30 degrees: wheel center up to 0.552 sin 30 further out than the wrist,
    // whose height is then 0.264 + 0.552 cos 30. Radius from the hip pitch axis: 1.224 m at most.
    let wrist_z = 0.264 + 0.552 * 30.0_f64.to_radians().cos();
    let hip_z = 1.5915 - 0.36;
    let flat = (1.224_f64.powi(2) - (hip_z - wrist_z).powi(2)).sqrt();
    let furthest = 1.341 + 0.351 + flat + 0.552 * 0.5;
    assert!(furthest < 3.6);
    let expected = (3.6 - furthest).max(0.0);
    assert!(missing > 0.5 * expected && missing < 2.0 * expected + 0.1, "{missing} {expected}");
}

#[test]
fn a_level_field_is_mirror_symmetric_about_the_leg() {
    let grid = reach_on(level(), &[], &options());
    let g = *grid.grid();
    let mut compared = 0;
    for iy in 0..g.ny {
        for ix in 0..g.nx {
            let p = g.position(ix, iy);
            let Some(mirrored) = grid.class.nearest(Point2::new(p.x, -p.y)) else { continue };
            compared += 1;
            assert_eq!(*grid.class.at(ix, iy), mirrored, "{p}");
        }
    }
    assert!(compared > 1000);
}

#[test]
fn a_high_lift_turns_the_far_ring_blue() {
    let low = reach_on(level(), &[], &options());
    let high = reach_on(level(), &[], &ReachOptions { lift: 1.2, ..options() });
    let count = |grid: &ReachGrid, class: CellClass| {
        grid.class.values().iter().filter(|c| **c == class as u8).count()
    };
    assert!(count(&high, CellClass::NoLift) > count(&low, CellClass::NoLift));
    assert!(count(&high, CellClass::Reachable) < count(&low, CellClass::Reachable));
}

#[test]
fn nothing_is_reachable_when_full_leg_loss_must_be_survived() {
    // Five regular feet: the centered stance lies on the border of the conservative polygon, so
    // only a leg stretched to the other side could help; outward is always unstable.
    let options = ReachOptions { preference: Preference::Conservative, ..options() };
    let grid = reach_on(level(), &[], &options);
    assert_eq!(class(&grid, 2.4, 0.0), CellClass::Unstable as u8);
    let p = Point2::new(2.4, 0.0);
    assert_eq!(grid.reason.nearest(p).unwrap(), Reason::Margin as u8);
    assert!(grid.missing.nearest(p).unwrap() > 0.0);
}

#[test]
fn a_boulder_collides_and_a_hole_in_the_map_is_unknown() {
    let boulder = Obstacle::Box {
        world_from_box: Isometry3::translation(2.25, 0.6, 0.3),
        half_extents: Vector3::new(0.2, 0.2, 0.3),
    };
    let mut heights = Raster::from_fn(*level().grid(), |_, _| 0.0_f32);
    let hole = heights.grid().nearest(Point2::new(2.2, -0.7)).unwrap();
    let index = heights.grid().index(hole.0, hole.1);
    heights.values_mut()[index] = f32::NAN;
    let grid = reach_on(ElevationMap::new(heights, Source::file("t")), &[boulder], &options());
    assert_eq!(class(&grid, 2.25, 0.6), CellClass::Colliding as u8);
    assert_eq!(class(&grid, 2.2, -0.7), CellClass::Unknown as u8);
    assert_eq!(class(&grid, 2.2428, 0.0), CellClass::Reachable as u8);
}

#[test]
fn the_number_of_threads_does_not_change_the_answer_and_a_stop_ends_it() {
    let one = reach_on(level(), &[], &ReachOptions { workers: 1, ..options() });
    let two = reach_on(level(), &[], &options());
    assert_eq!(one.class, two.class);
    assert_eq!(one.reason, two.reason);
    let bits = |grid: &ReachGrid| -> Vec<u32> {
        grid.missing.values().iter().chain(grid.margin.values()).map(|v| v.to_bits()).collect()
    };
    assert_eq!(bits(&one), bits(&two));
    let scene = Scene::new(athlete(), level(), &[]).unwrap();
    let start = standing(scene.robot());
    assert_eq!(reach(&scene, &start, 1.62, LEG, &options(), &|| true), None);
    let nonsense = ReachOptions { resolution: 0.0, ..options() };
    assert_eq!(reach(&scene, &start, 1.62, LEG, &nonsense, &|| false), None);
}
