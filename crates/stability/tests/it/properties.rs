//! Seeded properties: each compares with a slower method that shares no code with the crate.

use geometry::ConvexRegion;
use nalgebra::{Point2, Point3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::support_polygon::{conservative, margin, regular};
use stability::{settlement, spring_share};

use crate::{oracle, preloaded_share};

fn random_stance(rng: &mut ChaCha8Rng, n: usize) -> Vec<Point3<f64>> {
    (0..n)
        .map(|_| {
            let mut side = || rng.random_range(-2.0..2.0);
            let (x, y) = (side(), side());
            Point3::new(x, y, rng.random_range(-0.4..0.4))
        })
        .collect()
}

fn random_com(rng: &mut ChaCha8Rng) -> Point3<f64> {
    let mut side = || rng.random_range(-1.5..1.5);
    let (x, y) = (side(), side());
    Point3::new(x, y, rng.random_range(0.3..2.0))
}

#[test]
fn the_conservative_region_holds_exactly_what_survives_any_loss() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let (mut inside, mut total) = (0, 0);
    for _ in 0..4_000 {
        let n = rng.random_range(5..9);
        let stance = random_stance(&mut rng, n);
        let region = conservative(&stance).unwrap();
        for _ in 0..40 {
            let p = random_com(&mut rng).xy();
            let depth = region.area().map_or(-1.0, |area| area.depth_of(p));
            if depth.abs() < 1e-8 {
                continue;
            }
            let survives = oracle::survives_any_loss(&stance, p);
            assert_eq!(depth > 0.0, survives, "depth {depth} at {p} of {stance:?}");
            inside += usize::from(survives);
            total += 1;
        }
    }
    assert!(inside > total / 20, "{inside} of {total} points tell anything");
}

#[test]
fn four_or_more_contacts_never_leave_an_empty_region() {
    // A point of Tukey depth n/3 exists (Helly): 2 or more from 4 contacts on. Contacts on a small
    // integer lattice are often on lines and on each other.
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    let mut n_points = 0;
    for _ in 0..20_000 {
        let n = rng.random_range(4..8);
        let stance: Vec<Point3<f64>> = (0..n)
            .map(|_| {
                let (x, y) = (rng.random_range(0..4), rng.random_range(0..4));
                Point3::new(f64::from(x), f64::from(y), 0.0)
            })
            .collect();
        let Ok(region) = conservative(&stance) else { continue };
        let held: Vec<Point2<f64>> = match &region {
            ConvexRegion::Area(area) => area.vertices().to_vec(),
            ConvexRegion::Point(p) => {
                n_points += 1;
                vec![*p]
            }
            ConvexRegion::Empty => panic!("{stance:?}"),
        };
        for p in held {
            for lost in 0..n {
                let mut others = stance.clone();
                others.remove(lost);
                // Within rounding of the others' hull: the distance to the nearest point of it.
                let miss = distance_to_hull(&others, p);
                assert!(miss < 1e-8, "{p} misses the hull without {lost} by {miss}: {stance:?}");
            }
        }
    }
    assert!(n_points > 1_000, "{n_points} regions without area");
}

/// Distance to the hull: zero in any triangle of the points, else that to the nearest segment.
fn distance_to_hull(points: &[Point3<f64>], p: Point2<f64>) -> f64 {
    let flat: Vec<Point2<f64>> = points.iter().map(Point3::xy).collect();
    let within = |a: Point2<f64>, b: Point2<f64>, c: Point2<f64>| {
        let sides = [(a, b), (b, c), (c, a)].map(|(s, e)| (e - s).perp(&(p - s)));
        sides.iter().all(|side| *side > 0.0) || sides.iter().all(|side| *side < 0.0)
    };
    let mut nearest = f64::INFINITY;
    for (i, a) in flat.iter().enumerate() {
        for (j, b) in flat.iter().enumerate().skip(i) {
            nearest = nearest.min(distance_to_segment(*a, *b, p));
            if flat[j..].iter().any(|c| within(*a, *b, *c)) {
                return 0.0;
            }
        }
    }
    nearest
}

fn distance_to_segment(a: Point2<f64>, b: Point2<f64>, p: Point2<f64>) -> f64 {
    let length = (b - a).norm();
    if length == 0.0 {
        return (p - a).norm();
    }
    let along = ((p - a).dot(&(b - a)) / length).clamp(0.0, length);
    (p - a - (b - a) * (along / length)).norm()
}

#[test]
fn the_margin_is_how_far_the_center_of_mass_can_go_and_names_the_line_it_crosses() {
    let mut rng = ChaCha8Rng::seed_from_u64(23);
    let mut checked = 0;
    while checked < 2_000 {
        let n = rng.random_range(3..7);
        let (stance, com) = (random_stance(&mut rng, n), random_com(&mut rng));
        let flat: Vec<Point2<f64>> = stance.iter().map(Point3::xy).collect();
        if !oracle::inside_hull(&flat, com.xy()) {
            continue;
        }
        checked += 1;
        let found = margin(&regular(&stance).unwrap(), &stance, &com);
        let [a, b] = found.contacts.map(|i| stance[i].xy());
        // All contacts lie on one side of the named line, the margin away from the CoM.
        let away = (b - a).perp(&(com.xy() - a)) / (b - a).norm();
        assert!((away.abs() - found.depth_m).abs() < 1e-9, "{away} {found:?}");
        let sides = flat.iter().map(|p| (b - a).perp(&(p - a)) * away.signum());
        assert!(sides.into_iter().all(|side| side > -1e-9));
        for k in 0..24 {
            let turn = std::f64::consts::TAU * f64::from(k) / 24.0;
            let step = nalgebra::Vector2::new(turn.cos(), turn.sin()) * (found.depth_m - 1e-9);
            assert!(oracle::inside_hull(&flat, com.xy() + step));
        }
    }
}

#[test]
fn conservative_margins_name_two_contacts_whose_line_is_the_margin_away() {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    for _ in 0..2_000 {
        let n = rng.random_range(5..9);
        let (stance, com) = (random_stance(&mut rng, n), random_com(&mut rng));
        let region = conservative(&stance).unwrap();
        let Some(area) = region.area() else { continue };
        let found = margin(area, &stance, &com);
        if found.depth_m < 1e-6 {
            continue;
        }
        let [a, b] = found.contacts.map(|i| stance[i].xy());
        let away = ((b - a).perp(&(com.xy() - a)) / (b - a).norm()).abs();
        assert!((away - found.depth_m).abs() < 1e-7, "{away} {found:?} {stance:?}");
    }
}

#[test]
fn the_worst_settlement_is_that_of_turning_the_rover_bit_by_bit() {
    let mut rng = ChaCha8Rng::seed_from_u64(25);
    let mut tipped = 0;
    for _ in 0..3_000 {
        let n = rng.random_range(3..7);
        let (stance, com) = (random_stance(&mut rng, n), random_com(&mut rng));
        let flat: Vec<Point2<f64>> = stance.iter().map(Point3::xy).collect();
        if !oracle::inside_hull(&flat, com.xy()) {
            continue;
        }
        let depth = rng.random_range(0.0..0.3);
        let worst = settlement::worst(&stance, &com, depth).unwrap();
        let margins: Vec<f64> =
            (0..n).map(|k| oracle::settled_margin(&stance, k, &com, depth)).collect();
        let expected = margins.iter().copied().fold(f64::INFINITY, f64::min);
        if expected == f64::NEG_INFINITY {
            // The foot cannot go down so far: clamped at the bottom of its circle, it is lost too.
            assert!(worst.margin_m < 0.0, "{worst:?} {stance:?}");
            continue;
        }
        tipped += usize::from(n == 3 || worst.margin_m < 0.0);
        let error = (worst.margin_m - expected).abs();
        assert!(error < 1e-7, "{worst:?}, expected {expected}: {margins:?} {stance:?} {com}");
        assert!((margins[worst.contact] - expected).abs() < 1e-7);
    }
    assert!(tipped > 100, "{tipped} stances tip");
}

#[test]
fn spring_loads_are_those_of_the_one_right_set_of_carrying_feet() {
    let mut rng = ChaCha8Rng::seed_from_u64(26);
    let (mut idle_feet, mut compared) = (0, 0);
    for _ in 0..10_000 {
        let n = rng.random_range(3..9);
        let (stance, com) = (random_stance(&mut rng, n), random_com(&mut rng));
        let flat: Vec<Point2<f64>> = stance.iter().map(Point3::xy).collect();
        let loads = spring_share(&stance, &com, 5_000.0);
        assert_eq!(loads.is_some(), oracle::inside_hull(&flat, com.xy()));
        let (Some(loads), Some(expected)) = (loads, oracle::spring_loads(&stance, &com, 5_000.0))
        else {
            continue;
        };
        for (load, expected) in loads.iter().zip(&expected) {
            assert!((load - expected).abs() < 1e-4, "{loads:?} {expected} {stance:?} {com}");
        }
        check_balance(&stance, &com, &loads, 5_000.0, 1e-11);
        idle_feet += loads.iter().filter(|f| **f == 0.0).count();
        compared += 1;
    }
    assert!(compared > 2_000 && idle_feet > 500, "{compared} stances, {idle_feet} idle feet");
}

#[test]
fn preloaded_springs_push_only_and_balance_as_the_one_right_set_of_feet_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(28);
    let (mut idle_feet, mut compared) = (0, 0);
    for _ in 0..5_000 {
        let n = rng.random_range(3..9);
        let (stance, com) = (random_stance(&mut rng, n), random_com(&mut rng));
        let preload: Vec<f64> = (0..n).map(|_| rng.random_range(-3_000.0..3_000.0)).collect();
        let loads = preloaded_share(&stance, &com, 5_000.0, &preload);
        let (Some(loads), Some(expected)) =
            (loads, oracle::preloaded_loads(&stance, &com, 5_000.0, &preload))
        else {
            continue;
        };
        for (load, expected) in loads.iter().zip(&expected) {
            assert!((load - expected).abs() < 1e-4, "{loads:?} {expected} {stance:?} {com}");
        }
        check_balance(&stance, &com, &loads, 5_000.0, 1e-11);
        // What all feet have in common, and what a tilt levels, changes nothing.
        let tilt = |(p, own): (&Point3<f64>, &f64)| own + 700.0 - 300.0 * p.x + 450.0 * p.y;
        let tilted: Vec<f64> = stance.iter().zip(&preload).map(tilt).collect();
        let same = preloaded_share(&stance, &com, 5_000.0, &tilted).unwrap();
        assert!(same.iter().zip(&loads).all(|(a, b)| (a - b).abs() < 1e-4), "{same:?} {loads:?}");
        idle_feet += loads.iter().filter(|f| **f == 0.0).count();
        compared += 1;
    }
    assert!(compared > 1_000 && idle_feet > 500, "{compared} stances, {idle_feet} idle feet");
}

#[test]
fn loads_balance_however_near_the_border_the_center_of_mass_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(27);
    for _ in 0..3_000 {
        let n = rng.random_range(3..7);
        let stance = random_stance(&mut rng, n);
        let hull = regular(&stance).unwrap();
        let (a, b) = hull.edges().next().unwrap();
        let inward = nalgebra::Vector2::new(-(b - a).y, (b - a).x).normalize();
        let on_edge = a + (b - a) * rng.random_range(0.0..1.0);
        for depth in [0.0, 1e-12, 1e-9, 1e-6, 1e-3] {
            let p = on_edge + inward * depth;
            let com = Point3::new(p.x, p.y, 1.0);
            if hull.depth_of(p) < 0.0 {
                continue;
            }
            let loads = spring_share(&stance, &com, 1_000.0).unwrap();
            // On the border itself rounding puts it outside, where nothing balances exactly.
            let tolerance = if depth > 0.0 { 1e-11 } else { 1e-7 };
            check_balance(&stance, &com, &loads, 1_000.0, tolerance);
        }
    }
}

/// `tolerance` is the share of the weight that may be missing, and of weight times 1 m.
#[track_caller]
fn check_balance(
    stance: &[Point3<f64>],
    com: &Point3<f64>,
    loads: &[f64],
    weight: f64,
    tolerance: f64,
) {
    assert!(loads.iter().all(|f| *f >= 0.0), "{loads:?}");
    let sum: f64 = loads.iter().sum();
    assert!((sum - weight).abs() < tolerance * weight, "{sum} N: {stance:?} {com}");
    let moments = stance.iter().zip(loads).map(|(p, f)| (p.xy() - com.xy()) * *f);
    let moment: nalgebra::Vector2<f64> = moments.sum();
    assert!(moment.norm() < tolerance * weight, "{moment} N m: {stance:?} {com}");
}
