//! Margins along a step against the full assessment at the same times.

use collision::ground_normal;
use motion::{
    AdviceOptions, Answer, MOST_SAMPLES, MarginSample, Motion, Outcome, Phase, StepAnswer,
    StepRequest, Stretch, Target, Unwatched, Waypoint, Wish, advise, base_between, margins_along,
    plan_step,
};
use nalgebra::{Point3, Vector3};
use rover::{Configuration, LegId, Posture};
use stability::{ConeModel, Contact, Preference, assess_with_friction, energy};

use crate::{loaded, scene, standing};

const MOON: f64 = 1.62;
const FRICTION: f64 = 0.7;
const LEG: LegId = LegId(1);

fn step(change: impl Fn(&mut StepRequest)) -> (collision::Scene, Configuration, StepAnswer) {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let from = Posture::new(scene.robot(), &start).wheel(scene.robot(), LEG);
    let to = from.lowest_point(&Vector3::z_axis()) + Vector3::new(0.2, 0.1, 0.0);
    let mut request = StepRequest::new(LEG, Target::Ground(to), 1.0);
    change(&mut request);
    let answer = plan_step(&scene, &start, MOON, &request, &mut Unwatched);
    assert_eq!(answer.outcome, Outcome::Found, "{}", answer.reason);
    (scene, start, answer)
}

/// Where the rover is at a time of the step; before the leg moves, over these feet, if any are given.
fn at(
    scene: &collision::Scene,
    start: &Configuration,
    (leg, waypoints): (LegId, &[Waypoint]),
    time: f64,
    bearing: Option<&[(LegId, Point3<f64>)]>,
) -> Configuration {
    let shifting = bearing.is_some();
    let legs: Vec<LegId> = bearing.iter().flat_map(|feet| feet.iter().map(|f| f.0)).collect();
    let mut here = start.clone();
    for w in waypoints.windows(2) {
        let is_shift = w[1].phase == Phase::Shift;
        let next = match &w[1].stance {
            Some(stance) => stance.clone(),
            None => here.with_leg(leg, w[1].angles),
        };
        if is_shift == shifting && time <= w[1].time + 1e-9 {
            let t = ((time - w[0].time) / (w[1].time - w[0].time)).clamp(0.0, 1.0);
            return match is_shift {
                true => base_between(scene.robot(), &here, &next, &legs, t),
                false => here.with_leg(leg, w[0].angles.lerp(&w[1].angles, t)),
            };
        }
        here = next;
    }
    here
}

fn check(
    scene: &collision::Scene,
    there: &Configuration,
    feet: &[(LegId, Point3<f64>)],
    sample: &MarginSample,
) {
    let robot = scene.robot();
    let contact = |(leg, position): &(LegId, Point3<f64>)| {
        let normal = ground_normal(scene, *leg, position);
        (*leg, Contact { position: *position, normal, friction: FRICTION })
    };
    let standing: Vec<(LegId, Contact)> = feet.iter().map(contact).collect();
    let posture = Posture::new(robot, there);
    let cone = ConeModel::default();
    let report = assess_with_friction(robot, &posture, &standing, MOON, cone).unwrap();
    let points: Vec<Point3<f64>> = feet.iter().map(|(_, p)| *p).collect();
    let regular = report.regular.unwrap();
    let near = |found: Option<f64>, expected: Option<f64>| match (found, expected) {
        (Some(a), Some(b)) => assert!((a - b).abs() < 1e-7, "{sample:?}: {a} {b}"),
        (a, b) => assert_eq!(a, b),
    };
    near(sample.regular, Some(regular.margin.depth_m));
    near(sample.conservative, report.conservative.and_then(|c| c.margin_m));
    near(sample.friction, report.friction.unwrap().margin(&report.com));
    near(sample.energy_height, energy::margin(&points, &report.com).ok().map(|e| e.height_m));
    assert_eq!(sample.critical, Some(regular.critical));
}

#[test]
fn samples_are_what_the_full_assessment_says_at_their_times() {
    for preference in [Preference::Regular, Preference::Conservative] {
        let (scene, start, answer) = step(|r| r.preference = preference);
        let samples = margins_along(&scene, &[Stretch::of_step(&start, LEG, &answer)], FRICTION);
        assert_eq!(samples.len(), MOST_SAMPLES);
        let last = answer.waypoints.last().unwrap().time;
        assert_eq!(samples[0].time, 0.0);
        assert!((samples[MOST_SAMPLES - 1].time - last).abs() < 1e-9);
        assert!(samples.windows(2).all(|w| w[1].time >= w[0].time));
        let lift = samples.windows(2).position(|w| w[1].time == w[0].time);
        // Only a shift comes before the lift, and the margin falls as the leg is lifted.
        assert_eq!(lift.is_some(), preference == Preference::Conservative);
        for (i, sample) in samples.iter().enumerate() {
            let shifting = lift.is_some_and(|lift| i <= lift);
            let feet = if shifting { &answer.on_ground } else { &answer.standing };
            assert_eq!(feet.len(), if shifting { 6 } else { 5 });
            let step = (LEG, &answer.waypoints[..]);
            check(
                &scene,
                &at(&scene, &start, step, sample.time, shifting.then_some(feet)),
                feet,
                sample,
            );
        }
        if let Some(lift) = lift {
            assert!(samples[lift + 1].regular < samples[lift].regular);
        }
        // The final check saw no less along the denser samples of its own.
        let least = samples.iter().filter_map(|s| s.regular).fold(f64::INFINITY, f64::min);
        let seen = answer.margins.iter().map(|m| m.1).fold(f64::INFINITY, f64::min);
        assert!((least - seen).abs() < 0.01, "{least} {seen}");
    }
}

/// The feet on the ground, by a survey.
fn feet(scene: &collision::Scene, at: &Configuration) -> Vec<(LegId, Point3<f64>)> {
    let posture = Posture::new(scene.robot(), at);
    collision::survey(scene, &posture).contacts(scene, &posture)
}

#[test]
fn along_the_way_to_a_posture_they_are_those_of_the_feet_that_bear() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let wish = Wish { conservative: Some(0.2), ..Wish::default() };
    let options = AdviceOptions { replace: false, ..AdviceOptions::default() };
    let advice = advise(&scene, &start, MOON, LEG, &wish, &options, &mut Unwatched).unwrap();
    let Answer::Proposals(proposals) = &advice.answer else { panic!("{advice:?}") };
    let mut n_folded = 0;
    for proposal in proposals {
        let stretches: Vec<Stretch> = proposal.motions.iter().map(Motion::stretch).collect();
        let samples = margins_along(&scene, &stretches, FRICTION);
        assert_eq!(samples.len(), MOST_SAMPLES);
        assert!(samples.windows(2).all(|w| w[1].time >= w[0].time));
        assert!((samples[MOST_SAMPLES - 1].time - proposal.cost.duration).abs() < 1e-9);
        let mut left = samples.as_slice();
        let mut begin = 0.0;
        for motion in &proposal.motions {
            let ends = |shift: bool| {
                let of = motion.waypoints.iter().filter(|w| (w.phase == Phase::Shift) == shift);
                of.map(|w| w.time).next_back()
            };
            // A shift on all feet that touch; then the leg moves over the others.
            for (shifting, until) in [(true, ends(true)), (false, ends(false))] {
                let Some(until) = until else { continue };
                let mut bearing = feet(&scene, &motion.start);
                bearing.retain(|(leg, _)| shifting || *leg != LEG);
                let last = left.iter().position(|s| s.time >= begin + until - 1e-9).unwrap();
                let (part, rest) = left.split_at(last + 1);
                assert!(part.len() >= 2);
                for sample in part {
                    let way = (motion.leg, &motion.waypoints[..]);
                    let there = at(
                        &scene,
                        &motion.start,
                        way,
                        sample.time - begin,
                        shifting.then_some(&bearing),
                    );
                    check(&scene, &there, &bearing, sample);
                }
                n_folded += usize::from(!shifting);
                left = rest;
            }
            begin += motion.waypoints.last().unwrap().time;
        }
        assert!(left.is_empty());
    }
    assert!(n_folded > 0 && proposals.len() > n_folded, "{proposals:?}");
}

#[test]
fn a_transit_alone_and_no_path_have_no_margins() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let raised = |by: f64| {
        let mut angles = start.legs[1];
        angles[1] -= by;
        angles
    };
    let target = Target::Angles(raised(0.5));
    let request = StepRequest { transit_only: true, ..StepRequest::new(LEG, target, 1.0) };
    let lifted = start.with_leg(LEG, raised(0.3));
    let transit = plan_step(&scene, &lifted, MOON, &request, &mut Unwatched);
    assert!(!transit.waypoints.is_empty(), "{}", transit.reason);
    assert_eq!(margins_along(&scene, &[Stretch::of_step(&lifted, LEG, &transit)], FRICTION), []);
    let far = StepRequest::new(LEG, Target::Ground(Point3::new(9.0, 9.0, 0.0)), 1.0);
    let none = plan_step(&scene, &start, MOON, &far, &mut Unwatched);
    assert_eq!(margins_along(&scene, &[Stretch::of_step(&start, LEG, &none)], FRICTION), []);
}
