//! The margin rule on the rover that ships.

use nalgebra::Vector3;
use rover::{LegId, StanceRules};
use stability::{Check, Preference, StanceReport, SupportError, Verdict, assess, verdict};

use crate::{athlete, contacts, on_plane};

fn report(standing: &[usize]) -> StanceReport {
    let robot = athlete();
    let posture = on_plane(&robot, "bent");
    assess(&robot, &posture, &contacts(&robot, &posture, standing), 1.62)
}

fn judge(standing: &[usize], margin: f64, preference: Preference) -> Verdict {
    let rules = StanceRules { margin, ..*athlete().stance() };
    verdict(&report(standing), &rules, preference)
}

/// Radius of the circle of feet of the bent pose (m).
fn foot_radius() -> f64 {
    report(&[0, 1, 2, 3, 4, 5]).contacts[0].coords.xy().norm()
}

const SIX: [usize; 6] = [0, 1, 2, 3, 4, 5];
const FIVE: [usize; 5] = [0, 2, 3, 4, 5];

#[test]
fn the_six_loads_sum_to_the_weight_and_are_equal() {
    let report = report(&SIX);
    let loads = report.loads.unwrap().expected_n;
    let weight = 850.0 * 1.62;
    assert!(loads.iter().all(|f| (f - weight / 6.0).abs() < 1e-6), "{loads:?}");
}

#[test]
fn six_feet_meet_the_rule_under_both_preferences() {
    let regular = judge(&SIX, 0.15, Preference::Regular);
    assert!(regular.ok && regular.shortfall_m == Some(0.0), "{regular:?}");
    let report = report(&SIX);
    let apothem = foot_radius() * 0.75_f64.sqrt();
    assert!((report.regular.unwrap().margin.depth_m - apothem).abs() < 1e-9);
    assert!((report.settlement.unwrap().margin_m - apothem).abs() < 1e-9);
    let conservative = judge(&SIX, 0.15, Preference::Conservative);
    assert!(conservative.ok, "{conservative:?}");
}

#[test]
fn five_feet_meet_the_regular_rule_and_say_where_they_would_tip() {
    // The gap of leg 2 is closed by the line from leg 1 to leg 3, half a radius away.
    let found = judge(&FIVE, 0.15, Preference::Regular);
    assert!(found.ok, "{found:?}");
    let regular = report(&FIVE).regular.unwrap();
    assert_eq!(regular.critical, [LegId(0), LegId(2)]);
    assert!((regular.margin.depth_m - 0.5 * foot_radius()).abs() < 1e-9);
}

#[test]
fn a_margin_too_small_is_told_with_its_shortfall_and_the_best() {
    let wish = 0.5 * foot_radius() + 0.1;
    let found = judge(&FIVE, wish, Preference::Regular);
    assert!(!found.ok);
    assert_eq!(found.check, Check::Regular);
    assert!((found.shortfall_m.unwrap() - 0.1).abs() < 1e-9);
    let best = found.best_m.unwrap();
    assert!(best > found.margin_m.unwrap() && best < foot_radius() * 0.75_f64.sqrt());
    assert!(found.explanation.contains("over legs 1-3"), "{}", found.explanation);
    assert!(found.explanation.contains("best over this stance"), "{}", found.explanation);
}

#[test]
fn a_stance_that_tips_when_a_foot_settles_fails_for_that() {
    let mut report = report(&[0, 2, 4]);
    report.settlement.as_mut().unwrap().margin_m = -0.07;
    let found = verdict(&report, athlete().stance(), Preference::Regular);
    assert_eq!((found.ok, found.check), (false, Check::Settlement), "{found:?}");
    assert_eq!((found.margin_m, found.shortfall_m), (Some(-0.07), Some(0.07)));
    assert!(found.explanation.contains("tips over"), "{}", found.explanation);
}

#[test]
fn five_feet_beside_the_conservative_region_hear_what_is_best() {
    let robot = athlete();
    let mut report = report(&FIVE);
    // Towards the lifted leg 2 the center of mass leaves the conservative region at once.
    let towards = Vector3::new(60.0_f64.to_radians().cos(), 60.0_f64.to_radians().sin(), 0.0);
    let conservative = report.conservative.as_mut().unwrap();
    let polygon = conservative.region.area().unwrap().clone();
    let depth = polygon.depth_of((report.com + towards * 0.1).xy());
    assert!((depth + 0.1).abs() < 1e-9, "{depth}");
    conservative.margin_m = Some(depth);
    let found = verdict(&report, robot.stance(), Preference::Conservative);
    assert_eq!((found.ok, found.check), (false, Check::Conservative), "{found:?}");
    let best = foot_radius() * (3.0_f64.sqrt() - 1.5);
    assert!((found.best_m.unwrap() - best).abs() < 1e-6, "{found:?}");
}

#[test]
fn four_and_three_feet_have_no_pose_that_survives_a_loss() {
    let four = judge(&[0, 1, 3, 4], 0.15, Preference::Conservative);
    assert_eq!((four.ok, four.check, four.best_m), (false, Check::Conservative, Some(0.0)));
    assert!(four.explanation.contains("single point"), "{}", four.explanation);
    let three = judge(&[0, 2, 4], 0.15, Preference::Conservative);
    assert_eq!((three.ok, three.check, three.best_m), (false, Check::Conservative, None));
    assert!(three.explanation.contains("empty"), "{}", three.explanation);
    assert!(judge(&[0, 2, 4], 0.15, Preference::Regular).ok);
}

#[test]
fn two_feet_are_no_support() {
    let found = judge(&[0, 3], 0.15, Preference::Regular);
    assert_eq!((found.ok, found.check, found.margin_m), (false, Check::Support, None));
    assert!(found.explanation.contains("3 or more"), "{}", found.explanation);
    let report = report(&[0, 3]);
    assert_eq!(report.regular.unwrap_err(), SupportError::TooFewContacts { n_contacts: 2 });
    assert_eq!((report.settlement, report.loads), (None, None));
}
