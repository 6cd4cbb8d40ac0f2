//! The prepared rule against the rule.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegId, Posture, StanceRules};
use stability::{Preference, StanceGuard, assess, settlement, support_polygon, verdict};

use crate::athlete;
use crate::linear::support;
use crate::slopes::{region_with, stance};

fn random_stance(rng: &mut ChaCha8Rng) -> Vec<Point3<f64>> {
    let n = rng.random_range(3..7);
    (0..n)
        .map(|_| {
            let mut side = || rng.random_range(-2.0..2.0);
            let (x, y) = (side(), side());
            Point3::new(x, y, rng.random_range(-0.4..0.4))
        })
        .collect()
}

fn random_com(rng: &mut ChaCha8Rng, stance: &[Point3<f64>]) -> Point3<f64> {
    let middle = stance.iter().map(|p| p.coords).sum::<Vector3<f64>>() / stance.len() as f64;
    let mut side = || rng.random_range(-1.0..1.0);
    let (x, y) = (side(), side());
    Point3::new(middle.x + x, middle.y + y, rng.random_range(0.3..2.0))
}

fn random_rules(rng: &mut ChaCha8Rng) -> StanceRules {
    let margin = rng.random_range(0.0..0.2);
    let settlement = rng.random_range(0.0..0.25);
    StanceRules {
        margin,
        settlement,
        ground_tolerance: 0.02,
        contact_radius: 0.15,
        contact_height: 0.05,
        camber_limit: 0.35,
        leg_stiffness: 15_000.0,
    }
}

/// What the rule's own parts leave (m), negative where one fails.
fn rule_spare(
    stance: &[Point3<f64>],
    com: &Point3<f64>,
    rules: &StanceRules,
    preference: Preference,
) -> f64 {
    let regular = support_polygon::regular(stance).expect("the stance encloses an area");
    let mut spare = regular.depth_of(com.xy()) - rules.margin;
    spare = spare.min(
        settlement::worst(stance, com, rules.settlement)
            .expect("the stance encloses an area")
            .margin_m,
    );
    if preference == Preference::Conservative {
        let region = support_polygon::conservative(stance).expect("the stance encloses an area");
        let depth = region.area().map_or(f64::NEG_INFINITY, |area| area.depth_of(com.xy()));
        spare = spare.min(depth);
    }
    spare
}

#[test]
fn the_guard_says_what_the_rule_says_and_never_has_more_to_spare() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let (mut held, mut asked) = (0, 0);
    for _ in 0..10_000 {
        let stance = random_stance(&mut rng);
        let rules = random_rules(&mut rng);
        for preference in [Preference::Regular, Preference::Conservative] {
            let guard = StanceGuard::new(&stance, &rules, preference).unwrap();
            for _ in 0..4 {
                let com = random_com(&mut rng, &stance);
                let (spare, rule) =
                    (guard.spare(&com), rule_spare(&stance, &com, &rules, preference));
                if spare >= 0.0 {
                    assert!(rule >= 0.0, "{spare} but {rule} at {com} over {stance:?}");
                    assert!(spare <= rule + 1e-9, "{spare} of {rule} at {com} over {stance:?}");
                }
                if rule >= 0.0 {
                    // Where a center of mass is on an edge, rounding decides whether it is outside.
                    assert!(spare >= -1e-9, "{spare} but {rule} at {com} over {stance:?}");
                    held += 1;
                }
                asked += 1;
            }
        }
    }
    assert!(held > asked / 20, "{held} of {asked} tell anything");
}

#[test]
fn the_spare_changes_by_no_more_than_the_center_of_mass_moves() {
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    for _ in 0..5_000 {
        let stance = random_stance(&mut rng);
        let rules = random_rules(&mut rng);
        let guard = StanceGuard::new(&stance, &rules, Preference::Regular).unwrap();
        let from = random_com(&mut rng, &stance);
        if guard.spare(&from).is_infinite() {
            continue;
        }
        for length in [1e-4, 1e-2, 0.3] {
            let mut side = || rng.random_range(-1.0..1.0);
            let to = from + Vector3::new(side(), side(), side()) * length;
            let (a, b) = (guard.spare(&from), guard.spare(&to));
            let moved = (to - from).norm();
            assert!((a - b).abs() <= moved + 1e-9, "{a} to {b} by {moved} m over {stance:?}");
        }
    }
}

#[test]
fn the_rule_holds_within_what_is_to_spare() {
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let mut asked = 0;
    while asked < 3_000 {
        let stance = random_stance(&mut rng);
        let rules = random_rules(&mut rng);
        let guard = StanceGuard::new(&stance, &rules, Preference::Regular).unwrap();
        let com = random_com(&mut rng, &stance);
        let spare = guard.spare(&com);
        if spare <= 0.0 {
            continue;
        }
        asked += 1;
        for _ in 0..8 {
            let mut side = || rng.random_range(-1.0..1.0);
            let way = Vector3::new(side(), side(), side()).normalize();
            let radius = spare * rng.random_range(0.0..0.999);
            let moved = com + way * radius;
            assert!(guard.spare_about(&com, radius) > 0.0);
            let rule = rule_spare(&stance, &moved, &rules, Preference::Regular);
            assert!(rule >= 0.0, "{rule} m at {radius} of {spare} m over {stance:?}");
        }
    }
}

#[test]
fn on_the_rover_the_guard_gives_the_verdict_of_the_rule() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(34);
    let mut held = 0;
    for _ in 0..600 {
        let mut side = || rng.random_range(-1.0..1.0);
        let start = robot.pose("bent").unwrap();
        let tilt = UnitQuaternion::from_euler_angles(0.2 * side(), 0.2 * side(), side());
        let place = Vector3::new(1.2 * side(), 1.2 * side(), 1.6);
        let base = Isometry3::from_parts(place.into(), tilt);
        let standing: Vec<(LegId, Point3<f64>)> = (0..6)
            .filter(|k| k % 5 != 2)
            .map(|k| {
                let azimuth = f64::from(k) * std::f64::consts::FRAC_PI_3;
                let point = Point3::new(2.2 * azimuth.cos(), 2.2 * azimuth.sin(), 0.2 * side());
                (LegId(k as usize), point)
            })
            .collect();
        let posture = Posture::new(&robot, &Configuration { world_from_base: base, ..start });
        let report = assess(&robot, &posture, &standing, 1.62);
        let preference = if side() > 0.0 { Preference::Regular } else { Preference::Conservative };
        let verdict = verdict(&report, robot.stance(), preference);
        let contacts: Vec<Point3<f64>> = standing.iter().map(|(_, p)| *p).collect();
        let guard = StanceGuard::new(&contacts, robot.stance(), preference).unwrap();
        let spare = guard.spare(&report.com);
        assert_eq!(spare >= 0.0, verdict.ok, "{spare} m: {}", verdict.explanation);
        held += usize::from(verdict.ok);
    }
    assert!(held > 60, "{held} of 600 tell anything");
}

#[test]
fn the_guard_with_friction_holds_where_linear_programs_say_so() {
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let (mut held, mut refused) = (0, 0);
    for _ in 0..1_000 {
        let contacts = stance(&mut rng);
        let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
        let rules = StanceRules { margin: 0.2, settlement: 0.0, ..random_rules(&mut rng) };
        let Some(regular) = StanceGuard::new(&points, &rules, Preference::Regular) else {
            continue;
        };
        assert!(StanceGuard::new(&points, &rules, Preference::Friction).is_none());
        let guard = StanceGuard::over(&contacts, &rules, Preference::Friction).unwrap();
        let com = random_com(&mut rng, &points);
        assert!(guard.spare(&com) <= regular.spare(&com));
        // What another author's solver says of a center of mass that has m1 on this side.
        let reaches = |along: Vector2<f64>| {
            let reach = support(&contacts, 8, along.x, along.y);
            reach.map(|reach| reach - along.dot(&com.coords.xy()) - rules.margin)
        };
        let ring = (0..24).map(|i| f64::from(i) * std::f64::consts::TAU / 24.0);
        if guard.spare(&com) >= 0.0 {
            held += 1;
            for angle in ring {
                let spare = reaches(Vector2::new(angle.cos(), angle.sin())).unwrap();
                assert!(spare >= guard.spare(&com) - 1e-6, "{spare} {}", guard.spare(&com));
            }
        } else if regular.spare(&com) >= 0.0 {
            // Refused for friction alone: a program shows on which side.
            refused += 1;
            let found = region_with(&contacts);
            let shown = match found.region.area() {
                None => true,
                Some(area) => area.edges().any(|(a, b)| {
                    let along = (b - a).normalize();
                    reaches(Vector2::new(along.y, -along.x)).is_none_or(|spare| spare < 1e-6)
                }),
            };
            assert!(shown, "{contacts:?}");
        }
    }
    assert!(held > 60 && refused > 100, "{held} {refused}");
}
