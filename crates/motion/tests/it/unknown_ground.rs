//! A leg over ground that nobody has seen: by points of its links, drawn from their shapes.

use collision::Scene;
use geometry::{Grid, Raster};
use motion::{Finding, Outcome, Phase, StepAnswer, StepRequest, Target, Unwatched, plan_step};
use nalgebra::{Point2, Point3};
use rover::{LegId, Posture, Robot, Shape};
use std::collections::BTreeMap;
use terrain::cover::{CoverLimits, cover};
use terrain::{ElevationMap, Source};

use crate::{loaded, standing};

const LEG: LegId = LegId(1);

/// Level ground that nobody has seen in a strip across the way of the leg, `from` to `to` (m) beyond its foot.
fn strip(robot: &Robot, from: f64, to: f64) -> (ElevationMap, Point2<f64>) {
    let posture = Posture::new(robot, &standing(robot));
    let foot = posture.wheel(robot, LEG).center().xy();
    let grid = Grid { origin: Point2::new(-6.0, -6.0), resolution: 0.05, nx: 241, ny: 241 };
    let height = |ix, iy| {
        let p = grid.position(ix, iy) - foot;
        let is_hole = (from..to).contains(&-p.x) && p.y.abs() < 3.0;
        if is_hole { f32::NAN } else { 0.0 }
    };
    (ElevationMap::new(Raster::from_fn(grid, height), Source::file("strip")), foot)
}

fn covered(robot: std::sync::Arc<Robot>, map: ElevationMap, limits: &CoverLimits) -> Scene {
    let surface = cover(&map, &BTreeMap::new(), limits).unwrap();
    Scene::new(robot, map, &[]).unwrap().with_cover(surface)
}

fn step(scene: &Scene, foot: Point2<f64>, by: f64) -> StepAnswer {
    let start = standing(scene.robot());
    let goal = Target::Ground(Point3::new(foot.x - by, foot.y, 0.0));
    let mut request = StepRequest::new(LEG, goal, 1.0);
    request.preload = false;
    plan_step(scene, &start, 1.62, &request, &mut Unwatched)
}

/// Points of a shape's skin, in its own frame.
fn skin(shape: &Shape) -> Vec<Point3<f64>> {
    let n = 24;
    let turn = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
    let ring = |radius: f64, z: f64| {
        (0..n).map(move |i| Point3::new(radius * turn(i).cos(), radius * turn(i).sin(), z))
    };
    let along = |half: f64| (0..=10).map(move |i| half * (f64::from(i) / 5.0 - 1.0));
    match shape {
        Shape::Box { half_extents: h } => along(h.x)
            .flat_map(|x| along(h.y).map(move |y| (x, y)))
            .flat_map(|(x, y)| along(h.z).map(move |z| Point3::new(x, y, z)))
            .collect(),
        Shape::Cylinder { radius, half_length } => {
            along(*half_length).flat_map(|z| ring(*radius, z)).collect()
        }
        Shape::Capsule { radius, half_length } => {
            let ends = [1.0, -1.0].into_iter().flat_map(|side| {
                (0..6).flat_map(move |i| {
                    let angle = f64::from(i) * std::f64::consts::FRAC_PI_2 / 6.0;
                    ring(radius * angle.cos(), side * (half_length + radius * angle.sin()))
                })
            });
            along(*half_length).flat_map(|z| ring(*radius, z)).chain(ends).collect()
        }
        Shape::Sphere { radius } => along(1.0)
            .flat_map(|z| ring(radius * (1.0 - z * z).max(0.0).sqrt(), radius * z))
            .collect(),
        Shape::Mesh(_) => Vec::new(),
    }
}

/// Least height of the leg's points over the surface that is kept clear of, where the map knows the ground and where
/// not (m), from when the wheel has left its contact until it comes down.
fn least(scene: &Scene, answer: &StepAnswer) -> [f64; 2] {
    let (robot, start) = (scene.robot(), standing(scene.robot()));
    let posture = Posture::new(robot, &start);
    let mut least = [f64::INFINITY; 2];
    for w in answer.waypoints.windows(2).filter(|w| w[1].phase == Phase::Transit) {
        let n = ((w[1].angles - w[0].angles).amax() / 0.01).ceil().max(1.0);
        for i in 0..=n as usize {
            let at = posture.with_leg(robot, LEG, &w[0].angles.lerp(&w[1].angles, i as f64 / n));
            for (link, of) in robot.links().iter().enumerate() {
                let is_moving =
                    robot.body_of(rover::LinkId(link)).is_some_and(|(leg, _)| leg == LEG);
                for placed in of.shapes.iter().filter(|_| is_moving) {
                    for p in skin(&placed.shape) {
                        let p = at.link(rover::LinkId(link)) * placed.link_from_shape * p;
                        let known = scene.map().height_at(p.xy());
                        let floor = scene
                            .cover()
                            .height_at(p.xy())
                            .expect("nothing is over what has no bound");
                        let side = &mut least[usize::from(known.is_none())];
                        *side = side.min(p.z - floor);
                    }
                }
            }
        }
    }
    least
}

fn assumed(answer: &StepAnswer) -> Option<&Finding> {
    answer.findings.iter().find(|finding| finding.is_assumption())
}

#[test]
fn a_leg_keeps_clear_of_the_highest_that_unknown_ground_is_taken_to_be_and_says_so() {
    let robot = loaded();
    let (map, foot) = strip(&robot, 0.25, 0.4);
    let scene = covered(robot.clone(), map.clone(), &CoverLimits::default());
    let answer = step(&scene, foot, 0.75);
    assert_eq!(answer.outcome, Outcome::Found, "{}", answer.reason);
    let [known, unknown] = least(&scene, &answer);
    let tolerance = robot.tolerances().environment;
    // Drawn points miss some of a shape by less than a millimeter.
    assert!(unknown > tolerance - 1e-3 && unknown < 0.5, "{unknown} m over unknown ground");
    assert!(known > tolerance - 1e-3, "{known} m over known ground");
    let finding = assumed(&answer).expect("the assumption is told");
    let above = finding.margin.unwrap();
    assert!(above > tolerance - 1e-3, "{finding:?}");
    assert!(finding.place.contains("over (") && finding.detail.contains("nobody has seen"));

    // What nobody has to assume is not told.
    let plain = Scene::new(robot.clone(), ElevationMap::plane(8.0, 0.05).unwrap(), &[]).unwrap();
    let plain = step(&plain, foot, 0.75);
    assert_eq!(plain.outcome, Outcome::Found);
    assert_eq!(assumed(&plain), None);
    // Without a bound no leg passes.
    let bare = Scene::new(robot.clone(), map.clone(), &[]).unwrap();
    let refused = step(&bare, foot, 0.75);
    assert_eq!(refused.outcome, Outcome::UnknownGround, "{}", refused.reason);
    // A bound higher than the leg can be lifted is one that it does not pass.
    let high = CoverLimits { rise_m: 2.0, ..CoverLimits::default() };
    let refused = step(&covered(robot, map, &high), foot, 0.75);
    assert_ne!(refused.outcome, Outcome::Found);
}

#[test]
fn where_a_hole_is_too_wide_or_under_the_goal_the_answer_names_the_place() {
    let robot = loaded();
    // Nothing is bounded in the middle of a hole of 1.1 m.
    let (map, foot) = strip(&robot, 0.3, 1.4);
    let scene = covered(robot.clone(), map, &CoverLimits::default());
    let over = step(&scene, foot, 0.6);
    assert_eq!(over.outcome, Outcome::UnknownGround, "{}", over.reason);
    // No wheel is put down in a hole, however narrow.
    let (map, foot) = strip(&robot, 0.3, 0.5);
    let scene = covered(robot, map, &CoverLimits::default());
    let within = step(&scene, foot, 0.4);
    assert_eq!(within.outcome, Outcome::UnknownGround, "{}", within.reason);
    assert_eq!(within.constraint.unwrap().name, "unknown_ground");
}
