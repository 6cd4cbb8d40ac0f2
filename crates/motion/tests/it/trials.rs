//! Seeded scenes for comparing planners, and the final check where nothing but touching counts.

use std::sync::Arc;

use collision::{Allowance, LegChecker};
use motion::smooth::SmoothOptions;
use motion::trial::{Kind, draw};
use motion::{Buffers, EdgeRule, Outcome, Phase, Planner, Unwatched, plan_step};
use rover::Posture;

use crate::{loaded, robot_of};

const MOON: f64 = 1.62;

#[test]
fn a_seed_draws_the_same_scene_again_and_another_seed_another() {
    let robot = loaded();
    for kind in Kind::ALL {
        let target = |seed| draw(&robot, MOON, kind, seed).unwrap().target;
        let first = target(3);
        assert_eq!(first, target(3), "{}", kind.name());
        assert_ne!(first, target(4), "{}", kind.name());
    }
}

#[test]
fn buffers_below_zero_count_as_none() {
    let trial = draw(&loaded(), MOON, Kind::Rock, 1).unwrap();
    let plan = |buffer: f64| {
        let mut request = trial.request(Planner::Auto);
        request.buffers = Buffers { terrain_lift: buffer, obstacle: buffer, inflation: buffer };
        plan_step(&trial.scene, &trial.start, MOON, &request, &mut Unwatched)
    };
    let without = plan(0.0);
    for buffer in [-0.5, f64::NEG_INFINITY, f64::NAN] {
        assert_eq!(plan(buffer), without, "{buffer}");
    }
}

#[test]
fn tolerances_below_zero_count_as_zero() {
    let trial = draw(&loaded(), MOON, Kind::Rock, 1).unwrap();
    let plan = |kept: f64| {
        let mut request = trial.request(Planner::Auto);
        (request.environment_tolerance, request.pair_tolerance) = (Some(kept), Some(kept));
        plan_step(&trial.scene, &trial.start, MOON, &request, &mut Unwatched)
    };
    let zero = plan(0.0);
    for kept in [-0.5, f64::NEG_INFINITY, f64::NAN] {
        assert_eq!(plan(kept), zero, "{kept}");
    }
}

#[test]
fn robots_with_short_and_sliding_legs_step_too() {
    for name in ["hexapod", "quadruped", "slider"] {
        let robot = Arc::new(robot_of(name));
        let trial = draw(&robot, MOON, Kind::Open, 1).unwrap();
        let request = trial.request(Planner::Auto);
        let answer = plan_step(&trial.scene, &trial.start, MOON, &request, &mut Unwatched);
        assert_eq!(answer.outcome, Outcome::Found, "{name}: {}", answer.reason);
    }
}

#[test]
fn a_path_that_touches_is_refused_where_no_tolerances_are_kept() {
    let robot = loaded();
    let (mut n_touch, mut n_paths) = (0, 0);
    for seed in 0..8 {
        let trial = draw(&robot, MOON, Kind::Rock, seed).unwrap();
        let mut request = trial.request(Planner::Sbl);
        (request.environment_tolerance, request.pair_tolerance) = (Some(0.0), Some(0.0));
        // So coarse that thin things are missed.
        request.edges = EdgeRule::Sampled(0.1);
        request.smooth = SmoothOptions { max_taut_rounds: 0, ..SmoothOptions::default() };
        let answer = plan_step(&trial.scene, &trial.start, MOON, &request, &mut Unwatched);
        if answer.waypoints.is_empty() {
            continue;
        }
        n_paths += 1;
        let at_rest = Posture::new(&robot, &trial.start);
        let checker = LegChecker::new(&trial.scene, &at_rest, trial.leg, Some(0.0), Some(0.0));
        let touches = |a: &rover::LegAngles, b: &rover::LegAngles| {
            let n = ((b - a).amax() / 0.001).ceil().max(1.0);
            (0..=n as usize).any(|i| {
                let q = a + (b - a) * (i as f64 / n);
                let posture = at_rest.with_leg(&robot, trial.leg, &q);
                let near = checker.clearance(&posture, Allowance::default(), 1e-6);
                // Deeper than a grazing touch, which the check may step over.
                [near.links, near.environment].iter().flatten().any(|v| v.distance <= 0.0)
            })
        };
        let transit = answer.waypoints.windows(2).filter(|w| w[1].phase == Phase::Transit);
        if transit.into_iter().any(|w| touches(&w[0].angles, &w[1].angles)) {
            n_touch += 1;
            assert_eq!(answer.outcome, Outcome::Refused, "seed {seed}: {}", answer.reason);
        }
    }
    assert!(n_paths > 4 && n_touch > 0, "{n_touch} of {n_paths} touch: nothing was tested");
}
