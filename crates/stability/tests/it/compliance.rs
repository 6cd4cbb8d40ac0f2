//! Loads of legs as springs that differ, against closed forms and a slower method.

use nalgebra::{Matrix3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::loads::{LegSpring, SpringError, compliant_share, load_band};

use crate::{hexagon, without};

fn even(n: usize) -> Vec<LegSpring> {
    vec![LegSpring { stiffness_n_m: 10_000.0, pressed_m: 0.0 }; n]
}

fn center() -> Point3<f64> {
    Point3::new(0.0, 0.0, 1.0)
}

#[test]
fn five_equal_legs_of_a_hexagon_carry_five_three_two_three_five() {
    let loads = compliant_share(&without(&[0]), &center(), 1800.0, &even(5)).unwrap();
    for (load, expected) in loads.iter().zip([500.0, 300.0, 200.0, 300.0, 500.0]) {
        assert!((load - expected).abs() < 1e-9, "{loads:?}");
    }
}

#[test]
fn a_wheel_leaves_the_ground_at_a_lift_of_twice_the_nominal_deflection() {
    // Six springs of 10 kN/m under 6 kN: d0 = 0.1 m (F83).
    let lifted = |lift: f64| {
        let mut springs = even(6);
        springs[0].pressed_m = -lift;
        compliant_share(&hexagon(), &center(), 6000.0, &springs).unwrap()[0]
    };
    assert!((lifted(0.0) - 1000.0).abs() < 1e-9);
    assert!((lifted(0.1) - 500.0).abs() < 1e-9);
    assert!(lifted(0.2 - 1e-6) > 0.0 && lifted(0.2 - 1e-6) < 0.01);
    assert_eq!(lifted(0.2 + 1e-6), 0.0);
}

/// Loads by trying every set of carrying feet.
fn by_sets(
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    weight: f64,
    springs: &[LegSpring],
) -> Option<Vec<f64>> {
    let row = |p: &Point3<f64>| Vector3::new(1.0, p.x - com.x, p.y - com.y);
    (1_u32..1 << contacts.len()).filter(|set| set.count_ones() >= 3).find_map(|set| {
        let carries = |i: usize| set >> i & 1 == 1;
        let mut stiffness = Matrix3::zeros();
        let mut missing = Vector3::new(weight, 0.0, 0.0);
        for (i, (p, s)) in contacts.iter().zip(springs).enumerate().filter(|(i, _)| carries(*i)) {
            let _ = i;
            stiffness += row(p) * row(p).transpose() * s.stiffness_n_m;
            missing -= row(p) * s.stiffness_n_m * s.pressed_m;
        }
        let plane = stiffness.try_inverse()? * missing;
        let load = |i: usize| {
            springs[i].stiffness_n_m * (plane.dot(&row(&contacts[i])) + springs[i].pressed_m)
        };
        let slack = 1e-9 * weight;
        let right = (0..contacts.len())
            .all(|i| if carries(i) { load(i) >= -slack } else { load(i) <= slack });
        right.then(|| (0..contacts.len()).map(|i| if carries(i) { load(i) } else { 0.0 }).collect())
    })
}

fn random_springs(rng: &mut ChaCha8Rng, n: usize) -> Vec<LegSpring> {
    (0..n)
        .map(|_| LegSpring {
            stiffness_n_m: rng.random_range(3_000.0..30_000.0),
            pressed_m: rng.random_range(-0.05..0.05),
        })
        .collect()
}

fn random_stance(rng: &mut ChaCha8Rng, n: usize) -> Vec<Point3<f64>> {
    (0..n)
        .map(|_| Point3::new(rng.random_range(-2.0..2.0), rng.random_range(-2.0..2.0), 0.0))
        .collect()
}

#[test]
fn springs_that_differ_share_as_the_one_right_set_of_carrying_feet_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(61);
    let mut compared = 0;
    for case in 0..2_000 {
        let n = rng.random_range(3..8);
        let (stance, springs) = (random_stance(&mut rng, n), random_springs(&mut rng, n));
        let com = Point3::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5), 1.0);
        let Some(loads) = compliant_share(&stance, &com, 5_000.0, &springs) else { continue };
        let Some(expected) = by_sets(&stance, &com, 5_000.0, &springs) else { continue };
        compared += 1;
        for (load, expected) in loads.iter().zip(&expected) {
            assert!((load - expected).abs() < 1e-4, "case {case}: {loads:?} {expected:?}");
        }
    }
    assert!(compared > 1_000, "{compared}");
}

#[test]
fn a_band_holds_the_loads_of_every_spring_within_the_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(62);
    let error = SpringError { stiffness: 0.2, height_m: 0.01 };
    let mut compared = 0;
    for _ in 0..100 {
        let springs = random_springs(&mut rng, 6);
        let Some(band) = load_band(&hexagon(), &center(), 5_000.0, &springs, &error) else {
            continue;
        };
        for _ in 0..30 {
            let off: Vec<LegSpring> = springs
                .iter()
                .map(|s| LegSpring {
                    stiffness_n_m: s.stiffness_n_m * (1.0 + rng.random_range(-0.2..0.2)),
                    pressed_m: s.pressed_m + rng.random_range(-0.01..0.01),
                })
                .collect();
            let loads = compliant_share(&hexagon(), &center(), 5_000.0, &off).unwrap();
            for (i, load) in loads.iter().enumerate() {
                let within = *load >= band.least_n[i] - 1.0 && *load <= band.most_n[i] + 1.0;
                assert!(within, "{load} of {} to {}", band.least_n[i], band.most_n[i]);
                compared += 1;
            }
        }
    }
    assert!(compared > 10_000);
}

#[test]
fn springs_that_are_none_give_no_loads() {
    let bad = |stiffness_n_m: f64, pressed_m: f64| {
        let mut springs = even(6);
        springs[2] = LegSpring { stiffness_n_m, pressed_m };
        compliant_share(&hexagon(), &center(), 100.0, &springs)
    };
    for (stiffness, pressed) in
        [(0.0, 0.0), (-1.0, 0.0), (f64::NAN, 0.0), (f64::INFINITY, 0.0), (1.0, f64::NAN)]
    {
        assert_eq!(bad(stiffness, pressed), None, "{stiffness} {pressed}");
    }
    assert_eq!(compliant_share(&hexagon(), &center(), 100.0, &even(5)), None);
    let error = SpringError { stiffness: 1.0, height_m: 0.0 };
    assert_eq!(load_band(&hexagon(), &center(), 100.0, &even(6), &error), None);
}
