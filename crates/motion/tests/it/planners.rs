//! All planners in seeded synthetic spaces, against brute force and an exact edge test.

use motion::astar::AStar;
use motion::planner::{JointLine, PathSearch, Query, Search, SearchOutcome};
use motion::rrt_connect::RrtConnect;
use motion::sbl::Sbl;
use motion::space::{Space, path_length};
use motion::{Stopped, Unwatched, Watch};

use crate::synthetic::{Synthetic, closed, cluttered, window};

/// Resolution of the brute-force oracle (rad, largest joint).
const FINE: f64 = 0.0005;

fn planners() -> Vec<Box<dyn PathSearch>> {
    vec![Box::new(Sbl::default()), Box::new(RrtConnect::default()), Box::new(AStar::default())]
}

/// Runs a planner and checks what holds for every answer.
#[track_caller]
fn check_search(planner: &dyn PathSearch, space: &mut Synthetic, query: &Query) -> Search {
    let before = space.n_checked;
    let search = planner.search(space, query, &mut Unwatched);
    assert_eq!(search.n_checked, space.n_checked - before);
    if let SearchOutcome::Found(path) = &search.outcome {
        assert_eq!((path[0], path[path.len() - 1]), (query.start, query.goal));
        for q in path {
            assert!(*q >= space.lower && *q <= space.upper, "{q} is beyond the limits");
        }
        if space.epsilon().is_none() {
            let name = planner.name();
            assert!(space.is_free_by_brute_force(path, FINE), "{name:?}, seed {}", query.seed);
            assert!(path.windows(2).all(|w| space.is_truly_free(&w[0], &w[1])), "{name:?}");
        }
    }
    search
}

fn found(search: &Search) -> Option<&Vec<rover::LegAngles>> {
    match &search.outcome {
        SearchOutcome::Found(path) => Some(path),
        _ => None,
    }
}

#[test]
fn every_path_through_clutter_is_free_by_brute_force() {
    for planner in planners() {
        let mut solved = Vec::new();
        for seed in 0..200 {
            let (mut space, query) = cluttered(seed);
            let search = check_search(planner.as_ref(), &mut space, &query);
            if let Some(path) = found(&search) {
                solved.push((search.n_checked, path_length(path)));
            }
        }
        solved.sort_by_key(|s| s.0);
        let lengths: f64 = solved.iter().map(|s| s.1).sum::<f64>() / solved.len() as f64;
        eprintln!(
            "{:?}: {} checks {:?} p95 {:?} mean length {lengths}",
            planner.name(),
            solved.len(),
            solved[solved.len() / 2].0,
            solved[solved.len() * 95 / 100].0
        );
        assert!(solved.len() > 150, "{:?} solved {} of 200", planner.name(), solved.len());
    }
}

#[test]
fn windows() {
    for side in [0.6, 0.3, 0.15] {
        for planner in planners() {
            let mut solved = Vec::new();
            for seed in 0..40 {
                let (mut space, query) = window(side, 0.1, seed);
                let search = check_search(planner.as_ref(), &mut space, &query);
                if let Some(path) = found(&search) {
                    solved.push((search.n_checked, path_length(path)));
                }
            }
            solved.sort_by_key(|s| s.0);
            if solved.is_empty() {
                eprintln!("{side} {:?}: none", planner.name());
                continue;
            }
            eprintln!(
                "{side} {:?}: {} checks {:?} p95 {:?}",
                planner.name(),
                solved.len(),
                solved[solved.len() / 2].0,
                solved[solved.len() * 95 / 100].0
            );
        }
    }
}
