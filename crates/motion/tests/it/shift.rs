//! Body shifts of the athlete on its planted wheels.

use std::sync::Arc;

use collision::Obstacle;
use motion::shift::closure_error;
use motion::{
    BodyClear, NoShift, SampledBody, ShiftPlan, ShiftRequest, Unwatched, base_between, plan_shift,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use stability::{Preference, assess, verdict};

use crate::{athlete, loaded, scene, standing};

/// Everything is clear: for what kinematics and stability alone allow.
pub struct Clear;

impl BodyClear for Clear {
    fn piece(&mut self, _: &Configuration, _: &Configuration) -> Result<(), String> {
        Ok(())
    }
}

pub fn feet(robot: &Robot, configuration: &Configuration) -> Vec<(LegId, Point3<f64>)> {
    let posture = Posture::new(robot, configuration);
    let touch = |leg| (leg, posture.wheel(robot, leg).lowest_point(&Vector3::z_axis()));
    robot.leg_ids().map(touch).collect()
}

pub fn legs(robot: &Robot) -> Vec<LegId> {
    robot.leg_ids().collect()
}

/// The chassis moved by `offset` with all wheels in their places, by inverse kinematics here.
fn moved(robot: &Robot, start: &Configuration, offset: Vector3<f64>) -> Configuration {
    let posture = Posture::new(robot, start);
    let base = Translation3::from(offset) * start.world_from_base;
    let mut configuration = Configuration { world_from_base: base, ..start.clone() };
    let there = Posture::new(robot, &configuration);
    for leg in robot.leg_ids() {
        let wheel = posture.wheel(robot, leg).world_from_wheel;
        let solutions = there.inverse_kinematics(robot, leg, &wheel).unwrap();
        let change = |q: &LegAngles| (q - start.legs[leg.0]).amax();
        let nearest =
            solutions.iter().min_by(|a, b| change(&a.angles).total_cmp(&change(&b.angles)));
        configuration.legs[leg.0] = nearest.unwrap().angles;
    }
    configuration
}

/// Foot radius: distance of the feet from the middle (m).
fn foot_radius(robot: &Robot, start: &Configuration) -> f64 {
    feet(robot, start)[0].1.coords.xy().norm()
}

/// The request of `f` for the loaded rover in the bent pose about to lift its first leg, answered.
fn answer(
    robot: Arc<Robot>,
    obstacles: &[Obstacle],
    f: impl FnOnce(&mut ShiftRequest),
) -> (Configuration, Result<ShiftPlan, NoShift>) {
    let start = standing(&robot);
    let feet = feet(&robot, &start);
    let scene = scene(robot, obstacles);
    let mut request = ShiftRequest::new(&scene, &start, &feet, LegId(0));
    f(&mut request);
    let legs: Vec<LegId> = request.standing.iter().map(|(leg, _)| *leg).collect();
    let mut body = SampledBody::new(&scene, &start, &legs);
    let answer = plan_shift(&request, &mut body, &mut Unwatched);
    (start, answer)
}

/// The most that a conservative wish gets on these legs, without regard to collisions, over the
/// foot radius.
fn best_conservative(first_foot: usize, drive_hold: bool) -> f64 {
    let robot = Arc::new(athlete());
    let start = standing(&robot);
    let feet = feet(&robot, &start);
    let radius = foot_radius(&robot, &start);
    let scene = scene(robot, &[]);
    let request = ShiftRequest {
        preference: Preference::Conservative,
        drive_hold,
        wanted_spare: 10.0,
        ..ShiftRequest::new(&scene, &start, &feet[first_foot..], LegId(0))
    };
    plan_shift(&request, &mut Clear, &mut Unwatched).unwrap_err().best_spare / radius
}

#[test]
fn wheels_leave_their_places_by_what_planning_notes_say() {
    // 0.30 m to the side in 1, 2, 4, 8 pieces.
    let robot = athlete();
    let start = standing(&robot);
    for (n, expected) in [(1, 0.023), (2, 0.0058), (4, 0.0014), (8, 0.0004)] {
        let knot = |i| moved(&robot, &start, Vector3::y() * (0.3 * f64::from(i) / f64::from(n)));
        let knots: Vec<Configuration> = (0..=n).map(knot).collect();
        let worst = knots
            .windows(2)
            .map(|w| closure_error(&robot, &w[0], &w[1], &legs(&robot)))
            .fold(0.0, f64::max);
        assert!((worst / expected - 1.0).abs() < 0.35, "{n} pieces: {worst} of {expected} m");
    }
}

#[test]
fn the_center_of_mass_follows_the_chassis_by_a_part_only() {
    let ratio = |robot: &Robot| {
        let start = standing(robot);
        let com = |c: &Configuration| Posture::new(robot, c).center_of_mass(robot);
        (com(&moved(robot, &start, Vector3::x() * 0.2)) - com(&start)).norm() / 0.2
    };
    let bare = ratio(&athlete());
    assert!((0.36..0.45).contains(&bare), "{bare}");
    let with_payload = ratio(&loaded());
    assert!((with_payload - 0.55).abs() < 0.03, "{with_payload}");
}

#[test]
fn a_level_wish_is_met_by_a_shift_that_keeps_wheels_and_rule() {
    let robot = loaded();
    let before = foot_radius(&robot, &standing(&robot)) * 0.5 - robot.stance().margin;
    let wanted = before + 0.08;
    let (start, answer) = answer(robot.clone(), &[], |r| r.wanted_spare = wanted);
    let plan = answer.unwrap();
    assert_eq!(plan.configurations[0], start);
    assert!(plan.spare >= wanted && plan.closure_error < 0.002, "{plan:?}");
    let feet = feet(&robot, &start);
    let end = Posture::new(&robot, plan.configurations.last().unwrap());
    let report = assess(&robot, &end, &feet[1..], 1.62);
    let margin = report.regular.unwrap().margin.depth_m;
    assert!(margin >= robot.stance().margin + wanted - 1e-9, "{margin} m");
    // 0.08 m of center of mass are about 0.15 m of chassis.
    let way = (plan.configurations.last().unwrap().world_from_base.translation.vector
        - start.world_from_base.translation.vector)
        .norm();
    assert!((0.10..0.17).contains(&way), "{way} m");
    check_way(&robot, &start, &plan);
}

/// Wheels and rule along the executed motion, by forward kinematics and the full assessment.
#[track_caller]
fn check_way(robot: &Robot, start: &Configuration, plan: &ShiftPlan) {
    let feet = feet(robot, start);
    let places = Posture::new(robot, start);
    for piece in plan.configurations.windows(2) {
        for i in 0..=40 {
            let t = f64::from(i) / 40.0;
            let here = base_between(robot, &piece[0], &piece[1], &legs(robot), t);
            let posture = Posture::new(robot, &here);
            for leg in robot.leg_ids() {
                let off = posture.wheel(robot, leg).center() - places.wheel(robot, leg).center();
                assert!(off.norm() < 0.002, "{leg:?} by {} m", off.norm());
                let (q, model) = (here.legs[leg.0], robot.leg(leg));
                assert!(q >= model.lower.add_scalar(-1e-9) && q <= model.upper.add_scalar(1e-9));
            }
            let report = assess(robot, &posture, &feet, 1.62);
            let verdict = verdict(&report, robot.stance(), Preference::Regular);
            assert!(verdict.ok, "{}", verdict.explanation);
        }
    }
}

#[test]
fn before_a_lift_that_must_survive_a_loss_the_body_shifts() {
    let robot = loaded();
    let wish = |r: &mut ShiftRequest| r.preference = Preference::Conservative;
    let (start, answer) = answer(robot.clone(), &[], wish);
    let plan = answer.unwrap();
    check_way(&robot, &start, &plan);
    let feet = feet(&robot, &start);
    let conservative = |configuration: &Configuration| {
        let report = assess(&robot, &Posture::new(&robot, configuration), &feet[1..], 1.62);
        report.conservative.unwrap().margin_m.unwrap()
    };
    // A centered hexagon without a foot has a conservative margin of zero.
    assert!(conservative(&start).abs() < 1e-9);
    assert!(conservative(plan.configurations.last().unwrap()) >= 0.02);
}

#[test]
fn what_whole_poses_win_is_what_planning_notes_say() {
    // Notes, with all six feet planted: 0.090 and, with forks free, 0.182 foot radii, without regard to how
    // the legs get there.
    let (planted, planted_held) = (best_conservative(0, false), best_conservative(0, true));
    assert!((0.070..0.0905).contains(&planted), "{planted}");
    assert!((0.080..0.182).contains(&planted_held), "{planted_held}");
    // With the foot that is to be lifted in the air already.
    let (braked, held) = (best_conservative(1, false), best_conservative(1, true));
    assert!(braked > planted && braked < 0.15, "{braked}");
    assert!(held > 0.9 * braked && held < 0.226, "{held}");
}

#[test]
fn an_impossible_wish_is_answered_with_the_best_pose_and_its_reason() {
    let (start, nothing) = answer(loaded(), &[], |r| r.wanted_spare = 3.0);
    let none = nothing.unwrap_err();
    assert!(none.best_spare > 0.9 && none.best_spare < 3.0, "{none:?}");
    assert!(none.why.contains("no pose over these feet has more than"), "{}", none.why);
    assert_ne!(none.pose, start.world_from_base);
    let (_, again) = answer(loaded(), &[], |r| r.wanted_spare = 3.0);
    assert_eq!(again.unwrap_err(), none);

    // A wish that the feet would allow, but not the legs.
    let (_, nothing) = answer(loaded(), &[], |r| {
        r.preference = Preference::Conservative;
        r.wanted_spare = 0.4;
    });
    let none = nothing.unwrap_err();
    assert!(none.best_spare > 0.0 && none.best_spare < 0.4, "{none:?}");
    assert!(!none.why.contains("no pose over"), "{}", none.why);
}

#[test]
fn what_is_met_already_needs_no_motion() {
    let (start, answer) = answer(loaded(), &[], |_| ());
    let plan = answer.unwrap();
    assert_eq!(plan.configurations, [start]);
}

#[test]
fn a_rock_beside_the_chassis_keeps_the_body_where_it_is_or_turns_it_aside() {
    let robot = loaded();
    let wish = |r: &mut ShiftRequest| r.preference = Preference::Conservative;
    let (start, free) = answer(robot.clone(), &[], wish);
    let end = free.unwrap().configurations.last().unwrap().world_from_base;
    let way = end.translation.vector - start.world_from_base.translation.vector;
    // A wall behind the chassis on the side to which it would go, 5 cm away from it.
    let aside = way.xy().normalize();
    let middle = start.world_from_base.translation.vector
        + Vector3::new(aside.x, aside.y, 0.0) * (1.5 + 0.05 + 0.1);
    let wall = Obstacle::Box {
        world_from_box: Isometry3::from_parts(
            middle.into(),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), aside.y.atan2(aside.x)),
        ),
        half_extents: Vector3::new(0.1, 0.1, 0.15),
    };
    let (_, blocked) = answer(robot, &[wall], wish);
    match blocked {
        Err(none) => assert!(none.why.contains("obstacle 0"), "{none:?}"),
        Ok(plan) => assert_ne!(plan.configurations.last().unwrap().world_from_base, end),
    }
}

#[test]
fn bad_requests_are_answered() {
    let bad = [(LegId(9), Point3::origin())];
    let (_, nothing) = answer(loaded(), &[], |r| {
        r.standing = &[];
        r.wanted_spare = f64::NAN;
    });
    assert!(nothing.unwrap_err().why.contains("no support polygon"));
    let robot = loaded();
    let start = standing(&robot);
    let scene = scene(robot, &[]);
    let request = ShiftRequest::new(&scene, &start, &bad, LegId(9));
    let none = plan_shift(&request, &mut Clear, &mut Unwatched).unwrap_err();
    assert!(none.why.contains("legs that the robot does not have"), "{}", none.why);
}
