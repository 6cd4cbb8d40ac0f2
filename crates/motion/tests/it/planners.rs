//! All planners and the smoother in seeded synthetic spaces, against brute force and an exact edge
//! test.

use motion::astar::AStar;
use motion::planner::{JointLine, PathSearch, Query, Search, SearchOutcome};
use motion::rrt_connect::RrtConnect;
use motion::sbl::Sbl;
use motion::smooth::{SmoothOptions, smooth};
use motion::space::{Space, edge_is_sampled_free, path_length};
use motion::{PathPlanner, Stopped, Unwatched, Watch};
use rover::LegAngles;

use crate::synthetic::{Synthetic, closed, cluttered, window};

/// Resolution of the brute-force oracle (rad, largest joint).
const FINE: f64 = 0.0005;

fn planners() -> Vec<Box<dyn PathSearch>> {
    vec![Box::new(Sbl::default()), Box::new(RrtConnect::default()), Box::new(AStar::default())]
}

/// Free by brute force and by the exact test.
#[track_caller]
fn check_free(space: &Synthetic, path: &[LegAngles], what: &str) {
    assert!(space.is_free_by_brute_force(path, FINE), "{what} touches");
    for w in path.windows(2) {
        assert!(space.is_truly_free(&w[0], &w[1]), "{what} touches, exactly");
    }
}

/// Runs a planner and checks what holds for every answer; the path, if one was found.
#[track_caller]
fn check_search(
    planner: &dyn PathSearch,
    space: &mut Synthetic,
    query: &Query,
) -> Option<Vec<LegAngles>> {
    let before = space.n_checked;
    let search = planner.search(space, query, &mut Unwatched);
    let what = format!("{:?}, seed {}", planner.name(), query.seed);
    assert_eq!(search.n_checked, space.n_checked - before, "{what}");
    assert!(search.n_checked <= query.budget + space.worst_edge.max(64), "{what}");
    let SearchOutcome::Found(path) = search.outcome else { return None };
    assert_eq!((path[0], path[path.len() - 1]), (query.start, query.goal), "{what}");
    for q in &path {
        assert!(*q >= space.lower && *q <= space.upper, "{what}: {q} is beyond the limits");
    }
    match space.epsilon() {
        None => check_free(space, &path, &what),
        Some(epsilon) => {
            let mut again = space.clone();
            let mut is_free = |a, b| edge_is_sampled_free(&mut again, a, b, epsilon);
            assert!(path.windows(2).all(|w| is_free(&w[0], &w[1])), "{what}");
        }
    }
    Some(path)
}

#[test]
fn certified_paths_through_clutter_are_free_by_brute_force() {
    for planner in planners() {
        let solved = (0..100).filter(|seed| {
            let (mut space, query) = cluttered(*seed);
            check_search(planner.as_ref(), &mut space, &query).is_some()
        });
        let n_solved = solved.count();
        assert!(n_solved >= 97, "{:?} solved {n_solved} of 100", planner.name());
    }
}

#[test]
fn sampled_edges_miss_a_thin_wall_and_certified_ones_do_not() {
    for planner in planners() {
        let mut n_through = 0;
        for seed in 0..20 {
            let (mut space, mut query) = closed(0.02, seed);
            (query.budget, query.cell) = (5_000, 0.19);
            let certified = check_search(planner.as_ref(), &mut space, &query);
            assert_eq!(certified, None, "{:?} went through a wall", planner.name());
            let mut coarse = space.sampled(0.1);
            n_through += u32::from(check_search(planner.as_ref(), &mut coarse, &query).is_some());
        }
        assert!(n_through > 10, "{:?}: the wall is no test: {n_through}", planner.name());
    }
}

#[test]
fn tree_planners_pass_narrow_windows() {
    for (side, least) in [(0.5, 20), (0.25, 14)] {
        for planner in [&Sbl::default() as &dyn PathSearch, &RrtConnect::default()] {
            let solved = (0..20).filter(|seed| {
                let (mut space, query) = window(side, 0.1, *seed);
                check_search(planner, &mut space, &query).is_some()
            });
            let n_solved = solved.count();
            assert!(n_solved >= least, "{:?}: {n_solved} of 20 at {side} rad", planner.name());
        }
    }
}

#[test]
fn a_finer_grid_passes_a_window_that_a_coarse_one_does_not() {
    let solved = |cell: f64| {
        let passes = |seed: &u64| {
            let (mut space, mut query) = window(0.3, 0.1, *seed);
            query.cell = cell;
            check_search(&AStar::default(), &mut space, &query).is_some()
        };
        (0..20).filter(passes).count()
    };
    // The window is 0.15 m wide.
    let (coarse, fine) = (solved(0.3), solved(0.1));
    assert!(fine == 20 && coarse < 15, "{coarse} of 20 at 0.3 m, {fine} at 0.1 m");
}

#[test]
fn closed_walls_end_with_the_budget_or_the_grid_and_say_so() {
    for planner in planners() {
        for budget in [0, 100, 1_000] {
            let (mut space, mut query) = closed(0.1, budget);
            query.budget = budget;
            assert_eq!(check_search(planner.as_ref(), &mut space, &query), None);
            let search = planner.search(&mut space, &query, &mut Unwatched);
            assert_eq!(search.outcome, SearchOutcome::NotFound { exhausted: false });
            assert!(search.n_checked >= budget);
        }
        let (mut space, mut query) = closed(0.1, 1);
        query.max_nodes = 30;
        let search = planner.search(&mut space, &query, &mut Unwatched);
        assert_eq!(search.outcome, SearchOutcome::NotFound { exhausted: false });
    }
    let (mut space, query) = closed(0.1, 1);
    let coarse = Query { cell: 0.5, budget: u64::MAX, ..query };
    let search = AStar::default().search(&mut space, &coarse, &mut Unwatched);
    assert_eq!(search.outcome, SearchOutcome::NotFound { exhausted: true });
}

#[test]
fn the_same_seed_gives_the_same_path_and_another_seed_another() {
    let searched = |planner: &dyn PathSearch, seed: u64| -> Search {
        let (mut space, mut query) = window(0.5, 0.1, 7);
        query.seed = seed;
        planner.search(&mut space, &query, &mut Unwatched)
    };
    for planner in planners() {
        assert_eq!(searched(planner.as_ref(), 5), searched(planner.as_ref(), 5));
        let differs = searched(planner.as_ref(), 5) != searched(planner.as_ref(), 6);
        assert_eq!(differs, planner.name() != PathPlanner::AStar, "only A* has no random numbers");
    }
}

/// Stops when asked for the given time.
struct StopsAt(u32);

impl Watch for StopsAt {
    fn stopped(&mut self) -> Option<Stopped> {
        self.0 = self.0.saturating_sub(1);
        (self.0 == 0).then_some(Stopped::Deadline)
    }
}

#[test]
fn a_stop_ends_the_search_and_the_smoothing_and_is_named() {
    let mut all = planners();
    all.push(Box::new(JointLine));
    for planner in all {
        for asked in [1, 20] {
            let (mut space, query) = closed(0.1, 3);
            let search = planner.search(&mut space, &query, &mut StopsAt(asked));
            if asked == 1 || planner.name() != PathPlanner::JointLine {
                assert_eq!(search.outcome, SearchOutcome::Stopped(Stopped::Deadline));
            }
        }
    }
    let (mut space, query) = window(0.5, 0.1, 3);
    let path = check_search(&RrtConnect::default(), &mut space, &query).unwrap();
    let stopped = smooth(&mut space, &path, &SmoothOptions::default(), &mut StopsAt(3));
    assert_eq!(stopped, Err(Stopped::Deadline));
}

#[test]
fn locked_joints_keep_their_place() {
    for planner in planners() {
        for seed in 0..10 {
            let (mut space, mut query) = window(0.5, 0.1, seed);
            for joint in [2, 4] {
                let value = query.start[joint];
                query.goal[joint] = value;
                (space.lower[joint], space.upper[joint]) = (value, value);
            }
            let Some(path) = check_search(planner.as_ref(), &mut space, &query) else { continue };
            let short = smooth(&mut space, &path, &SmoothOptions::default(), &mut Unwatched);
            for q in path.iter().chain(&short.unwrap().path) {
                assert!(*q >= space.lower && *q <= space.upper, "{q}");
            }
        }
    }
}

#[test]
fn the_straight_line_is_found_where_it_is_free() {
    let (mut n_found, mut n_blocked) = (0, 0);
    for seed in 0..100 {
        let (mut space, query) = cluttered(seed);
        let path = check_search(&JointLine, &mut space, &query);
        let is_free = space.is_truly_free(&query.start, &query.goal);
        assert!(path.is_none() || is_free);
        (n_found, n_blocked) =
            (n_found + u32::from(path.is_some()), n_blocked + u32::from(!is_free));
    }
    assert!(n_found + n_blocked >= 98, "{n_found} found, {n_blocked} blocked");
}

#[test]
fn smoothed_paths_are_free_short_and_have_few_knots() {
    let long = SmoothOptions {
        stop_reduction: 0.001,
        max_rounds: 8,
        max_edges: 100_000,
        max_checked: 300_000,
        max_taut_rounds: 60,
    };
    let published = SmoothOptions { max_taut_rounds: 0, ..SmoothOptions::default() };
    let (mut ratios, mut published_ratios, mut knots) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..60 {
        let (mut space, query) =
            if seed % 3 == 0 { window(0.5, 0.2, seed) } else { cluttered(seed) };
        if space.is_truly_free(&query.start, &query.goal) {
            continue;
        }
        let mut paths = Vec::new();
        for (planner, seed) in planners().iter().flat_map(|p| [(p, seed), (p, seed + 1_000)]) {
            let query = Query { seed, ..query };
            paths.extend(check_search(planner.as_ref(), &mut space, &query));
        }
        let mut shortened = |path: &[LegAngles], options: &SmoothOptions| {
            let smoothed = smooth(&mut space, path, options, &mut Unwatched).unwrap();
            let mut edges = smoothed.path.windows(2);
            assert!(edges.all(|w| space.is_truly_free(&w[0], &w[1])), "seed {seed}");
            assert_eq!(smoothed.path[0], query.start);
            assert_eq!(smoothed.path[smoothed.path.len() - 1], query.goal);
            assert!(smoothed.n_checked <= options.max_checked + space.worst_edge);
            assert!(path_length(&smoothed.path) <= path_length(path) + 1e-9);
            smoothed.path
        };
        let lengths = paths.iter().map(|path| path_length(&shortened(path, &long)));
        let best = lengths.fold(f64::INFINITY, f64::min);
        let first = &paths[seed as usize % paths.len()];
        let short = shortened(first, &SmoothOptions::default());
        published_ratios.push(path_length(&shortened(first, &published)) / best);
        check_free(&space, &short, &format!("smoothed path, seed {seed}"));
        ratios.push(path_length(&short) / best);
        knots.push(short.len());
    }
    ratios.sort_by(f64::total_cmp);
    published_ratios.sort_by(f64::total_cmp);
    knots.sort_unstable();
    let (half, most) = (ratios.len() / 2, ratios.len() * 9 / 10);
    assert!(ratios.len() > 25);
    assert!(ratios[half] < 1.02 && ratios[most] < 1.10, "{} {}", ratios[half], ratios[most]);
    assert!(ratios[most] < published_ratios[most], "the published rounds alone are as good");
    assert!(knots[half] <= 5 && knots[ratios.len() * 3 / 4] <= 5, "{knots:?}");
}
