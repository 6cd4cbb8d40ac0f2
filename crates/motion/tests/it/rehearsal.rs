//! The leg-loss rehearsal against the margins of the assessment and the search of ways.

use std::sync::Arc;

use collision::{Scene, survey};
use motion::{
    AdviceError, Aftermath, RehearsalOptions, Unwatched, WayBack, base_between, rehearse,
};
use nalgebra::{Point3, Translation3, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use stability::{assess, settlement, support_polygon, verdict};

use crate::{athlete, loaded, scene, standing};

const MOON: f64 = 1.62;

/// The chassis moved level with all wheels in their places, by inverse kinematics here.
fn shifted(robot: &Robot, start: &Configuration, by: Vector3<f64>) -> Configuration {
    let wheels = Posture::new(robot, start);
    let base = Translation3::from(by) * start.world_from_base;
    let mut moved = Configuration { world_from_base: base, ..start.clone() };
    let there = Posture::new(robot, &moved);
    for leg in robot.leg_ids() {
        let wheel = wheels.wheel(robot, leg).world_from_wheel;
        let near = |q: &LegAngles| (q - start.legs[leg.0]).amax();
        let all = there.inverse_kinematics(robot, leg, &wheel).unwrap();
        let best = all.iter().min_by(|a, b| near(&a.angles).total_cmp(&near(&b.angles)));
        moved.legs[leg.0] = best.unwrap().angles;
    }
    moved
}

fn contacts(scene: &Scene, at: &Configuration) -> Vec<(LegId, Point3<f64>)> {
    let posture = Posture::new(scene.robot(), at);
    survey(scene, &posture).contacts(scene, &posture)
}

/// Regular margin over all feet but one (m).
fn margin_without(scene: &Scene, at: &Configuration, leg: LegId) -> f64 {
    let feet: Vec<Point3<f64>> =
        contacts(scene, at).iter().filter(|(l, _)| *l != leg).map(|(_, p)| *p).collect();
    let com = Posture::new(scene.robot(), at).center_of_mass(scene.robot());
    support_polygon::regular(&feet).map_or(f64::NEG_INFINITY, |hull| hull.depth_of(com.xy()))
}

/// The end of a way back holds the margin rule on all feet but `leg`, and the margin does not get less on
/// the way there.
#[track_caller]
fn check_way_back(scene: &Scene, start: &Configuration, leg: LegId, after: &Aftermath) {
    let WayBack::Shift { motion, end, .. } = &after.way_back else { panic!("{after:?}") };
    let robot = scene.robot();
    assert_eq!(motion.start, *start);
    let mut feet = contacts(scene, end);
    assert_eq!(feet.len(), contacts(scene, start).len());
    feet.retain(|(other, _)| *other != leg);
    let report = assess(robot, &Posture::new(robot, end), &feet, MOON);
    assert!(verdict(&report, robot.stance(), Default::default()).ok);
    assert!(report.torque.worst.ratio.abs() <= 1.0);
    let least = (margin_without(scene, start, leg).min(robot.stance().margin) - 0.0101).max(0.0);
    let legs: Vec<LegId> = contacts(scene, start).iter().map(|(leg, _)| *leg).collect();
    let knots: Vec<Configuration> =
        motion.waypoints.iter().map(|w| w.stance.clone().unwrap()).collect();
    assert_eq!((knots.first(), knots.last()), (Some(start), Some(end)));
    for w in knots.windows(2) {
        for k in 0..=4 {
            let here = base_between(robot, &w[0], &w[1], &legs, f64::from(k) / 4.0);
            let margin = margin_without(scene, &here, leg);
            assert!(margin >= least, "{margin} m on the way, {least} m at the start");
        }
    }
}

#[test]
fn a_centered_hexagon_survives_every_accident() {
    let robot = loaded();
    let start = standing(&robot);
    let here = scene(robot.clone(), &[]);
    let options = RehearsalOptions::default();
    let rehearsal = rehearse(&here, &start, MOON, &options, &mut Unwatched).unwrap();
    assert_eq!(rehearsal.legs.len(), 6);
    assert!((rehearsal.settlement - robot.stance().settlement).abs() < 1e-12);
    let radius = contacts(&here, &start)[0].1.coords.xy().norm();
    for accident in &rehearsal.legs {
        // The short diagonal is half a foot radius from the middle.
        assert!((accident.lost.margin.unwrap() - 0.5 * radius).abs() < 1e-6);
        assert!(!accident.settled.rocks && !accident.lost.tips_over);
        assert_eq!(accident.lost.way_back, WayBack::NotNeeded);
        assert_eq!(accident.settled.way_back, WayBack::NotNeeded);
    }
    assert_eq!(rehearsal.n_looked, 0);
}

#[test]
fn off_the_middle_the_loss_of_a_near_leg_asks_for_a_way_back() {
    let robot = loaded();
    let here = scene(robot.clone(), &[]);
    let start = standing(&robot);
    // Without legs 2 and 3 the hull's edge goes through the middle; the shift leaves less than m1.
    let mut raised = start;
    raised.legs[1][1] -= 0.1;
    let off = shifted(&robot, &raised, Vector3::y() * -0.15);
    let options = RehearsalOptions::default();
    let ask = || rehearse(&here, &off, MOON, &options, &mut Unwatched).unwrap();
    let rehearsal = ask();
    assert_eq!(rehearsal, ask());
    assert!(rehearsal.n_looked <= options.budget + 2_000);
    let mut ways = 0;
    for accident in &rehearsal.legs {
        let margin = margin_without(&here, &off, accident.leg);
        assert!((accident.lost.margin.unwrap() - margin).abs() < 1e-9);
        assert_eq!(accident.lost.tips_over, margin < 0.0);
        if matches!(accident.lost.way_back, WayBack::Shift { .. }) {
            check_way_back(&here, &off, accident.leg, &accident.lost);
            ways += 1;
        } else if margin < robot.stance().margin {
            eprintln!("{:?}: {:?}", accident.leg, accident.lost.way_back);
        }
    }
    assert!(ways > 0, "{rehearsal:?}");
}

#[test]
fn the_worst_settlement_is_that_of_the_margin_rule() {
    let robot = Arc::new(athlete());
    let here = scene(robot.clone(), &[]);
    let start = standing(&robot);
    for (x, y) in [(0.0, 0.0), (0.25, 0.0), (-0.1, 0.2)] {
        let at = shifted(&robot, &start, Vector3::new(x, y, 0.0));
        let feet: Vec<Point3<f64>> = contacts(&here, &at).iter().map(|(_, p)| *p).collect();
        let com = Posture::new(&robot, &at).center_of_mass(&robot);
        for s in [0.0, 0.1, 0.6] {
            let options = RehearsalOptions { settlement: Some(s), ..Default::default() };
            let rehearsal = rehearse(&here, &at, MOON, &options, &mut Unwatched).unwrap();
            let worst = settlement::worst(&feet, &com, s).unwrap();
            let least = rehearsal
                .legs
                .iter()
                .filter_map(|leg| leg.settled.margin)
                .fold(f64::INFINITY, f64::min);
            assert!((least - worst.margin_m).abs() < 1e-9, "{least} m, {worst:?}");
        }
    }
}

#[test]
fn with_three_feet_any_loss_is_a_fall_and_bad_requests_are_named() {
    let robot = loaded();
    let here = scene(robot.clone(), &[]);
    let mut three = standing(&robot);
    for leg in [1, 3, 5] {
        three.legs[leg][1] -= 0.1;
    }
    let options = RehearsalOptions::default();
    let rehearsal = rehearse(&here, &three, MOON, &options, &mut Unwatched).unwrap();
    assert_eq!(rehearsal.legs.len(), 3);
    for accident in &rehearsal.legs {
        assert!(accident.lost.tips_over && accident.lost.margin.is_none());
        assert!(
            matches!(&accident.lost.way_back, WayBack::None(b) if b.text.contains("tips over"))
        );
        assert!(accident.settled.rocks);
    }
    for value in [f64::NAN, -0.1, f64::INFINITY, 99.0] {
        let options = RehearsalOptions { settlement: Some(value), ..Default::default() };
        let error = rehearse(&here, &three, MOON, &options, &mut Unwatched).unwrap_err();
        assert!(matches!(error, AdviceError::BadSettlement { .. }), "{error:?}");
    }
    let mut two = three.clone();
    two.legs[0][1] -= 0.1;
    let error = rehearse(&here, &two, MOON, &options, &mut Unwatched).unwrap_err();
    assert_eq!(error, AdviceError::TooFewFeet { n_staying: 2 });
}
