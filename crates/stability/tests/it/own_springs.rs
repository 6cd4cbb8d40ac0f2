//! The one model of a compliant rover, on random postures of the rover that ships: against the least energy by
//! another method, and against sampled springs.

use nalgebra::{DMatrix, DVector, Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegId, Posture, Robot, Wrench};
use stability::contact_forces::LegStatics;
use stability::loads::{LegSpring, SpringError, StanceSprings, compliant_share, leg_springs};
use stability::report::forces;
use stability::safety::hold_verticals;
use stability::torque::ratios;
use stability::{ConeModel, Contact, assess, assess_with_friction, spring_share};

use crate::linear::least_ratio;
use crate::{athlete, contacts, loaded};

const EARTH: f64 = 9.81;

/// Where legs stand.
type Feet = Vec<(LegId, Point3<f64>)>;

/// Feet up to a meter from where they stand in the bent pose; of every seventh stance all six legs.
fn random_stance(robot: &Robot, case: usize, rng: &mut ChaCha8Rng) -> (Posture, Feet) {
    let (posture, feet, _) = random_configuration(robot, case, rng);
    (posture, feet)
}

fn random_configuration(
    robot: &Robot,
    case: usize,
    rng: &mut ChaCha8Rng,
) -> (Posture, Feet, Configuration) {
    let mut bent = robot.pose("bent").expect("the fixture has it");
    for leg in &mut bent.legs {
        for joint in 0..3 {
            leg[joint] += rng.random_range(-0.3..0.3);
        }
    }
    let turn = UnitQuaternion::from_euler_angles(
        rng.random_range(-0.1..0.1),
        rng.random_range(-0.1..0.1),
        rng.random_range(-3.0..3.0),
    );
    bent.world_from_base = Isometry3::from_parts(Translation3::identity(), turn);
    let posture = Posture::new(robot, &bent);
    let legs: Vec<usize> = (0..6).filter(|leg| case % 7 != *leg).collect();
    let feet = contacts(robot, &posture, &legs);
    (posture, feet, bent)
}

fn points(feet: &Feet) -> Vec<Point3<f64>> {
    feet.iter().map(|(_, p)| *p).collect()
}

/// Vertical stiffness (N/m) of a leg by turning each of its joints a little.
fn stiffness_by_differences(
    robot: &Robot,
    (posture, angles): (&Posture, &LegAngles),
    leg: LegId,
    at: &Point3<f64>,
) -> f64 {
    let (joints, tire) = robot.compliance().springs.expect("the fixture has them");
    let fork = *robot.leg(leg).links.last().expect("a leg has links");
    let own = posture.link(fork).inverse() * at;
    let height = |place: usize, by: f64| {
        let mut turned = *angles;
        turned[place] += by;
        (posture.with_leg(robot, leg, &turned).link(fork) * own).z
    };
    let give = (0..angles.len()).map(|place| {
        let rise = (height(place, 1e-5) - height(place, -1e-5)) / 2e-5;
        rise * rise / joints[place]
    });
    1.0 / (give.sum::<f64>() + 1.0 / tire)
}

/// The loads of least energy Σ f²/2k - f d that balance and push, by Dykstra's alternating projections: in
/// g = f/√k they are the point nearest to √k d of both the plane of balances and the positive orthant.
fn least_energy(
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    weight: f64,
    springs: &[LegSpring],
) -> Vec<f64> {
    let n = contacts.len();
    let root = DVector::from_fn(n, |i, _| springs[i].stiffness_n_m.sqrt());
    let balance = DMatrix::from_fn(3, n, |row, i| {
        let arm = contacts[i] - com;
        root[i] * [1.0, arm.x, arm.y][row]
    });
    let load = DVector::from_column_slice(&[weight, 0.0, 0.0]);
    let back = balance.transpose()
        * (&balance * balance.transpose()).try_inverse().expect("feet enclose an area");
    let mut at = DVector::from_fn(n, |i, _| root[i] * springs[i].pressed_m);
    let mut off = DVector::zeros(n);
    for _ in 0..200_000 {
        let flat = &at - &back * (&balance * &at - &load);
        let pushed = (&flat + &off).map(|v| v.max(0.0));
        off = &flat + &off - &pushed;
        let moved = (&pushed - &at).amax() + (&pushed - &flat).amax();
        at = pushed;
        if moved < 1e-11 * at.amax() {
            break;
        }
    }
    at.component_mul(&root).iter().copied().collect()
}

#[test]
fn each_leg_is_as_stiff_as_small_turns_of_its_joints_tell() {
    let robot = loaded();
    let mut rng = ChaCha8Rng::seed_from_u64(81);
    for case in 0..50 {
        let (posture, feet, all) = random_configuration(&robot, case, &mut rng);
        for ((leg, at), spring) in feet.iter().zip(leg_springs(&robot, &posture, &feet)) {
            let expected = stiffness_by_differences(&robot, (&posture, &all.legs[leg.0]), *leg, at);
            let ratio = spring.stiffness_n_m / expected;
            assert!((ratio - 1.0).abs() < 1e-6, "case {case}, {leg:?}: {ratio}");
        }
    }
}

#[test]
fn loads_of_the_rule_are_those_of_least_energy() {
    let robot = loaded();
    let weight = robot.mass() * EARTH;
    let mut rng = ChaCha8Rng::seed_from_u64(82);
    let (mut compared, mut idle) = (0, 0);
    for case in 0..300 {
        let (posture, feet, all) = random_configuration(&robot, case, &mut rng);
        let report = assess(&robot, &posture, &feet, EARTH);
        let springs: Vec<LegSpring> = feet
            .iter()
            .map(|(leg, at)| LegSpring {
                stiffness_n_m: stiffness_by_differences(
                    &robot,
                    (&posture, &all.legs[leg.0]),
                    *leg,
                    at,
                ),
                pressed_m: 0.0,
            })
            .collect();
        let Some(loads) = report.loads else { continue };
        let expected = least_energy(&points(&feet), &report.com, weight, &springs);
        for (load, expected) in loads.expected_n.iter().zip(&expected) {
            assert!((load - expected).abs() < 1e-5 * weight, "case {case}: {loads:?} {expected}");
        }
        // The same with feet that were put down at different heights, some so high that they do not touch.
        let pressed: Vec<LegSpring> = springs
            .iter()
            .map(|s| LegSpring { pressed_m: rng.random_range(-0.8..0.4), ..*s })
            .collect();
        let loads = compliant_share(&points(&feet), &report.com, weight, &pressed).unwrap();
        let expected = least_energy(&points(&feet), &report.com, weight, &pressed);
        for (load, expected) in loads.iter().zip(&expected) {
            assert!((load - expected).abs() < 1e-4 * weight, "case {case}: {loads:?} {expected}");
        }
        idle += loads.iter().filter(|load| **load == 0.0).count();
        compared += 1;
    }
    assert!(compared > 250 && idle > 100, "{compared} stances, {idle} idle feet");
}

#[test]
fn the_worst_joint_is_no_less_than_with_any_springs_within_their_error() {
    let robot = loaded();
    let weight = robot.mass() * EARTH;
    let mut rng = ChaCha8Rng::seed_from_u64(83);
    let (mut compared, mut nearest) = (0, 0.0_f64);
    for case in 0..60 {
        let (posture, feet) = random_stance(&robot, case, &mut rng);
        let report = assess(&robot, &posture, &feet, EARTH);
        if report.loads.is_none() {
            continue;
        }
        let springs = leg_springs(&robot, &posture, &feet);
        let error = SpringError::of(&robot, &springs, weight);
        for _ in 0..40 {
            let mut off = |spring: &LegSpring| LegSpring {
                stiffness_n_m: spring.stiffness_n_m
                    * (1.0 + error.stiffness * rng.random_range(-1.0..1.0)),
                pressed_m: error.height_m * rng.random_range(-1.0..1.0),
            };
            let off: Vec<LegSpring> = springs.iter().map(&mut off).collect();
            let loads = compliant_share(&points(&feet), &report.com, weight, &off).unwrap();
            let ratio = worst(&robot, &posture, &feet, &loads);
            let most = report.torque.worst.ratio.abs();
            assert!(ratio <= most + 1e-3, "case {case}: {ratio} of {most}");
            nearest = nearest.max(ratio / most);
            compared += 1;
        }
    }
    assert!(compared > 1_500 && nearest > 0.9, "{compared} {nearest}");
}

/// Largest share of a torque limit with these loads on the feet.
fn worst(robot: &Robot, posture: &Posture, feet: &Feet, loads: &[f64]) -> f64 {
    let wrench = |((leg, point), load): (&(LegId, Point3<f64>), &f64)| {
        (*leg, Wrench { point: *point, force: Vector3::z() * *load })
    };
    let ground: Vec<_> = feet.iter().zip(loads).map(wrench).collect();
    ratios(robot, posture, &ground, EARTH).worst.ratio.abs()
}

#[test]
fn rule_and_report_judge_alike_and_refuse_stances_that_equal_springs_would_pass() {
    let robot = loaded();
    let weight = robot.mass() * EARTH;
    let mut rng = ChaCha8Rng::seed_from_u64(84);
    let (mut safe, mut refused) = (0, 0);
    for case in 0..200 {
        let (posture, feet) = random_stance(&robot, case, &mut rng);
        let report = assess(&robot, &posture, &feet, EARTH);
        if report.loads.is_none() {
            continue;
        }
        let level: Vec<_> = feet.iter().map(|(leg, p)| (*leg, Contact::level(*p, 0.7))).collect();
        let full = forces(&robot, &posture, &level, EARTH, ConeModel::default()).unwrap();
        assert_eq!(!report.torque.worst.is_overloaded(), full.is_torque_safe(), "case {case}");
        assert_eq!(report.loads, full.load_band, "case {case}");
        // Where friction holds verticals, the best forces are no worse than the loads of springs.
        let best = full.least_torque.as_ref().unwrap().ratio;
        assert!(best <= report.torque.worst.ratio.abs() + 1e-9, "case {case}: {best}");
        let equal = spring_share(&points(&feet), &report.com, weight).unwrap();
        let passes_equal = worst(&robot, &posture, &feet, &equal) <= 1.0;
        safe += usize::from(full.is_torque_safe());
        refused += usize::from(passes_equal && !full.is_torque_safe());
    }
    assert!(safe > 20 && refused > 20, "{safe} safe, {refused} refused");
}

#[test]
fn where_loads_are_surely_borne_the_band_says_so_and_elsewhere_it_does_not_or_a_foot_may_hang() {
    let robot = loaded();
    let mut rng = ChaCha8Rng::seed_from_u64(85);
    let (mut inside, mut outside) = (0, 0);
    for case in 0..60 {
        let (posture, feet) = random_stance(&robot, case, &mut rng);
        let weight = robot.mass() * EARTH;
        let Some(springs) = StanceSprings::of(&robot, &posture, &feet, EARTH) else { continue };
        let bearable: Vec<(f64, f64)> =
            feet.iter().map(|_| (-0.1 * weight, rng.random_range(0.2..0.5) * weight)).collect();
        let sure = springs.surely_within(&bearable);
        for _ in 0..50 {
            let com = Point3::new(rng.random_range(-0.8..0.8), rng.random_range(-0.8..0.8), 0.0);
            let Some(band) = springs.band(&com) else { continue };
            let within = band.most_n.iter().zip(&bearable).all(|(most, (_, may))| most <= may);
            let hangs = band.least_n.contains(&0.0);
            match sure.as_ref().map_or(f64::NEG_INFINITY, |sure| sure.depth_of(com.xy())) {
                depth if depth > 1e-9 => {
                    assert!(within && !hangs, "case {case}: {depth} deep, {band:?}");
                    inside += 1;
                }
                depth if depth < -1e-9 => {
                    assert!(!within || hangs, "case {case}: {depth} deep, {band:?}");
                    outside += 1;
                }
                _ => {}
            }
        }
    }
    assert!(inside > 100 && outside > 500, "{inside} {outside}");
}

#[test]
fn a_robot_with_one_figure_for_a_leg_has_equal_springs_and_a_band() {
    let text = testkit::fixture_text("robots/athlete/robot.toml")
        .replace("margin_m = 0.15", "margin_m = 0.15\nleg_stiffness_n_m = 20000.0");
    let plain = Robot::from_folder(
        &text,
        |file| Some(testkit::fixture_text(&format!("robots/athlete/{file}"))),
        |_| None,
    )
    .unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(86);
    for case in 0..30 {
        let (posture, feet) = random_stance(&plain, case, &mut rng);
        let report = assess(&plain, &posture, &feet, EARTH);
        let equal = spring_share(&points(&feet), &report.com, plain.mass() * EARTH);
        assert_eq!(report.loads.is_some(), equal.is_some());
        for (load, equal) in
            report.loads.iter().flat_map(|l| &l.expected_n).zip(equal.iter().flatten())
        {
            assert!((load - equal).abs() < 1e-6, "case {case}: {load} {equal}");
        }
        if let Some(loads) = report.loads {
            let spread = loads.most_n.iter().zip(&loads.least_n).map(|(most, least)| most - least);
            assert!(spread.fold(0.0, f64::max) > 100.0);
        }
    }
}

#[test]
fn a_band_of_ten_feet_holds_nearly_all_loads_of_springs_within_the_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(87);
    let feet: Vec<Point3<f64>> = (0..10)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * 0.2 * std::f64::consts::PI).sin_cos();
            Point3::new(2.0 * cos, 1.2 * sin, 0.0)
        })
        .collect();
    let error = SpringError { stiffness: 0.2, height_m: 0.005 };
    let com = Point3::new(0.2, 0.1, 1.0);
    for case in 0..20 {
        let mut spring =
            || LegSpring { stiffness_n_m: rng.random_range(10_000.0..20_000.0), pressed_m: 0.0 };
        let springs: Vec<LegSpring> = (0..10).map(|_| spring()).collect();
        let prepared = StanceSprings::new(&feet, 10_000.0, &springs, &error).unwrap();
        let band = prepared.band(&com).unwrap();
        for _ in 0..100 {
            // At the ends of the errors, where loads are farthest off.
            let mut end = || if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            let mut off = |s: &LegSpring| LegSpring {
                stiffness_n_m: s.stiffness_n_m * (1.0 + 0.2 * end()),
                pressed_m: 0.005 * end(),
            };
            let off: Vec<LegSpring> = springs.iter().map(&mut off).collect();
            let loads = compliant_share(&feet, &com, 10_000.0, &off).unwrap();
            for (i, load) in loads.iter().enumerate() {
                let (least, most) = (band.least_n[i] - 5.0, band.most_n[i] + 5.0);
                assert!((least..=most).contains(load), "case {case}: {load} {band:?}");
            }
        }
    }
    let many = vec![Point3::origin(); 17];
    let even = vec![LegSpring { stiffness_n_m: 1.0, pressed_m: 0.0 }; 17];
    assert_eq!(StanceSprings::new(&many, 1.0, &even, &error), None);
}

#[test]
fn where_feet_stand_too_steep_for_vertical_loads_the_best_forces_count_too() {
    let tilted = |slope: f64| {
        let normal = Unit::new_normalize(Vector3::new(slope.sin(), 0.0, slope.cos()));
        [Contact { normal, ..Contact::level(Point3::new(1.0, 1.0, 0.0), 0.7) }]
    };
    // The linearized cone is inside of the true one, which ends at 35°.
    let cone = ConeModel::default();
    assert!(hold_verticals(&tilted(0.0), cone) && hold_verticals(&tilted(0.5), cone));
    assert!(!hold_verticals(&tilted(0.62), cone) && !hold_verticals(&tilted(3.0), cone));

    let robot = athlete();
    let weight = robot.mass() * EARTH;
    let mut rng = ChaCha8Rng::seed_from_u64(88);
    let mut worse = 0;
    for case in 0..40 {
        let (posture, feet) = random_stance(&robot, case, &mut rng);
        // A bowl that is steeper than friction holds verticals.
        let com = posture.center_of_mass(&robot);
        let slope = rng.random_range(0.7..1.2);
        let standing: Vec<(LegId, Contact)> = feet
            .iter()
            .map(|(leg, p)| {
                let inward = (com - p).xy().normalize();
                let normal = (inward * f64::sin(slope)).insert_row(2, f64::cos(slope));
                let normal = Unit::new_normalize(normal);
                (*leg, Contact { normal, ..Contact::level(*p, 0.7) })
            })
            .collect();
        let report = assess_with_friction(&robot, &posture, &standing, EARTH, cone).unwrap();
        let plain = assess(&robot, &posture, &feet, EARTH);
        let contacts: Vec<Contact> = standing.iter().map(|(_, c)| *c).collect();
        if report.friction.as_ref().unwrap().margin(&com).is_none_or(|m| m <= 0.0) {
            continue;
        }
        let statics: Vec<LegStatics> =
            feet.iter().map(|(leg, p)| LegStatics::new(&robot, &posture, *leg, p, EARTH)).collect();
        let best = least_ratio(&statics, &contacts, &com, weight);
        let expected = best.max(plain.torque.worst.ratio.abs());
        let found = report.torque.worst.ratio.abs();
        assert!((found - expected).abs() < 1e-6, "case {case}: {found} {expected}");
        worse += usize::from(best > plain.torque.worst.ratio.abs());
    }
    assert!(worse > 3, "{worse}");
}
