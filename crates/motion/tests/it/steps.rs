//! Whole steps.

use collision::{LegChecker, Obstacle, Scene};
use motion::{
    Outcome, Phase, Planner, StepAnswer, StepRequest, Stopped, Target, Unwatched, Watch, plan_step,
};
use nalgebra::{Isometry3, Point3, Vector3};
use rover::{Configuration, LegId, Posture};
use stability::rule::Preference;

use crate::{loaded, scene, standing};

const MOON: f64 = 1.62;

fn wheel_ground(scene: &Scene, at: &Configuration, leg: LegId) -> Point3<f64> {
    let posture = Posture::new(scene.robot(), at);
    posture.wheel(scene.robot(), leg).lowest_point(&Vector3::z_axis())
}

fn step(scene: &Scene, shift: [f64; 2], change: impl Fn(&mut StepRequest)) -> StepAnswer {
    let start = standing(scene.robot());
    let leg = LegId(1);
    let from = wheel_ground(scene, &start, leg);
    let to = Point3::new(from.x + shift[0], from.y + shift[1], 0.0);
    let mut request = StepRequest::new(leg, Target::Ground(to), 1.0);
    change(&mut request);
    plan_step(scene, &start, MOON, &request, &mut Unwatched)
}

#[test]
fn a_step_on_level_ground_ends_where_it_was_asked_to() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let from = wheel_ground(&scene, &start, LegId(1));
    for shift in [[0.3, 0.0], [0.0, 0.3], [-0.3, -0.2], [0.25, -0.45]] {
        let answer = step(&scene, shift, |_| {});
        assert_eq!(answer.outcome, Outcome::Found, "{shift:?}: {}", answer.reason);
        let last = answer.waypoints.last().unwrap();
        let end = wheel_ground(&scene, &start.with_leg(LegId(1), last.angles), LegId(1));
        let asked = Point3::new(from.x + shift[0], from.y + shift[1], 0.0);
        assert!((end - asked).norm() < 1e-6, "{end} {asked}");
        assert!(answer.findings.iter().all(|f| f.ok));
        let phases: Vec<Phase> = answer.waypoints.iter().map(|w| w.phase).collect();
        assert_eq!((phases[0], phases[phases.len() - 1]), (Phase::Lift, Phase::Drop));
        assert!(phases.windows(2).all(|w| w[0] as u8 <= w[1] as u8), "{phases:?}");
    }
}

#[test]
fn the_wheel_rises_by_the_lift_and_keeps_its_place_doing_so() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let from = wheel_ground(&scene, &start, LegId(1));
    let answer = step(&scene, [0.3, 0.1], |r| r.lift = 0.25);
    let lifts: Vec<_> = answer.waypoints.iter().filter(|w| w.phase == Phase::Lift).collect();
    let top =
        wheel_ground(&scene, &start.with_leg(LegId(1), lifts[lifts.len() - 1].angles), LegId(1));
    assert!((top - from - Vector3::new(0.0, 0.0, 0.25)).norm() < 1e-6, "{top} {from}");
    // Between knots the joints move linearly: the wheel stays within 2 mm of the plumb line.
    for w in lifts.windows(2) {
        for i in 0..=20 {
            let q = w[0].angles + (w[1].angles - w[0].angles) * (f64::from(i) / 20.0);
            let p = wheel_ground(&scene, &start.with_leg(LegId(1), q), LegId(1));
            assert!((p.xy() - from.xy()).norm() < 2.1e-3, "{p}");
        }
    }
}

#[test]
fn no_joint_is_faster_than_the_robot_allows() {
    let scene = scene(loaded(), &[]);
    let answer = step(&scene, [0.3, 0.2], |_| {});
    let speed = scene.robot().motion().joint_speed;
    for w in answer.waypoints.windows(2) {
        let fastest = (w[1].angles - w[0].angles).amax() / (w[1].time - w[0].time);
        assert!(fastest <= speed * (1.0 + 1e-9), "{fastest}");
    }
}

#[test]
fn a_rock_in_the_way_is_stepped_around_and_never_touched() {
    let robot = loaded();
    let start = standing(&robot);
    let from = wheel_ground(&scene(robot.clone(), &[]), &start, LegId(1));
    let rock = Obstacle::Box {
        world_from_box: Isometry3::translation(from.x + 0.45, from.y, 0.3),
        half_extents: Vector3::new(0.08, 0.3, 0.3),
    };
    let scene = scene(robot.clone(), &[rock]);
    let answer = step(&scene, [0.95, -0.1], |_| {});
    assert_eq!(answer.outcome, Outcome::Found, "{}", answer.reason);
    let at_rest = Posture::new(&robot, &start);
    let checker = LegChecker::new(&scene, &at_rest, LegId(1), Some(0.0), None);
    let transit = answer.waypoints.windows(2).filter(|w| w[1].phase == Phase::Transit);
    for w in transit {
        for i in 0..=400 {
            let q = w[0].angles + (w[1].angles - w[0].angles) * (f64::from(i) / 400.0);
            let touched = checker.collision(&at_rest.with_leg(&robot, LegId(1), &q), None);
            assert_eq!(touched, None);
        }
    }
}

#[test]
fn failures_say_why() {
    let open = scene(loaded(), &[]);
    let far = step(&open, [3.0, 3.0], |_| {});
    assert_eq!(far.outcome, Outcome::Unreachable);
    assert!(far.reason.contains("out of the reach"), "{}", far.reason);

    let off_the_map = step(&open, [40.0, 0.0], |_| {});
    assert_eq!(off_the_map.outcome, Outcome::UnknownGround, "{}", off_the_map.reason);

    let high = step(&open, [0.1, 0.0], |r| r.lift = 3.0);
    assert_eq!(high.outcome, Outcome::NoLift, "{}", high.reason);

    let conservative = step(&open, [0.2, 0.0], |r| {
        r.preference = Preference::Conservative;
        r.may_shift = false;
    });
    assert_eq!(conservative.outcome, Outcome::Unstable, "{}", conservative.reason);
    assert!(conservative.reason.contains("at best"), "{}", conservative.reason);

    let start = standing(open.robot());
    let goal = wheel_ground(&open, &start, LegId(1)) + Vector3::new(0.35, 0.0, 0.3);
    let slab = Obstacle::Box {
        world_from_box: Isometry3::from(goal.coords),
        half_extents: Vector3::new(0.3, 0.3, 0.3),
    };
    let covered = scene(loaded(), &[slab]);
    let blocked = step(&covered, [0.35, 0.0], |_| {});
    assert_eq!(blocked.outcome, Outcome::Colliding, "{}", blocked.reason);
    assert!(blocked.reason.contains("obstacle 0"), "{}", blocked.reason);
}

#[test]
fn the_same_request_gives_the_same_plan_and_work() {
    let scene = scene(loaded(), &[]);
    let with_seed = |seed| {
        step(&scene, [0.4, 0.3], |r| {
            r.planner = Planner::Sbl;
            r.seed = seed;
        })
    };
    assert_eq!(with_seed(3), with_seed(3));
    assert_eq!(with_seed(4).outcome, Outcome::Found);
}

#[test]
fn a_stop_is_obeyed_and_named() {
    struct After(u32, Stopped);
    impl Watch for After {
        fn stopped(&mut self) -> Option<Stopped> {
            self.0 = self.0.saturating_sub(1);
            (self.0 == 0).then_some(self.1)
        }
    }
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let to = wheel_ground(&scene, &start, LegId(1)) + Vector3::new(0.3, 0.0, 0.0);
    let mut request = StepRequest::new(LegId(1), Target::Ground(to), 1.0);
    request.planner = Planner::Sbl;
    for (stopped, outcome) in
        [(Stopped::Deadline, Outcome::Deadline), (Stopped::Cancelled, Outcome::Cancelled)]
    {
        let answer = plan_step(&scene, &start, MOON, &request, &mut After(3, stopped));
        assert_eq!(answer.outcome, outcome);
        assert!(answer.waypoints.is_empty());
    }
}

#[test]
fn a_leg_in_the_air_is_put_down_without_a_second_lift() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let first = step(&scene, [0.3, 0.0], |_| {});
    let lifted = first.waypoints.iter().rfind(|w| w.phase == Phase::Lift).unwrap();
    let in_the_air = start.with_leg(LegId(1), lifted.angles);
    let to = wheel_ground(&scene, &start, LegId(1)) + Vector3::new(0.2, 0.2, 0.0);
    let request = StepRequest::new(LegId(1), Target::Ground(to), 1.0);
    let answer = plan_step(&scene, &in_the_air, MOON, &request, &mut Unwatched);
    assert_eq!(answer.outcome, Outcome::Found, "{}", answer.reason);
    assert!(answer.waypoints.iter().all(|w| w.phase != Phase::Lift));
    let margin = answer.margins.iter().map(|m| m.1).fold(f64::INFINITY, f64::min);
    assert!(margin > scene.robot().stance().margin);
}

#[test]
fn a_step_in_a_boulder_field_lands_on_the_ground() {
    let robot = loaded();
    let map =
        terrain::synthetic::generate(&terrain::synthetic::Recipe::boulder_field(), 7).unwrap();
    let scene = Scene::new(robot.clone(), map, &[]).unwrap();
    // The middle of the field is kept free: seat every wheel on its own ground.
    let mut start = standing(&robot);
    start.world_from_base.translation.z += 0.1;
    for leg in robot.leg_ids() {
        let posture = Posture::new(&robot, &start);
        let below = wheel_ground(&scene, &start, leg).xy();
        let down = collision::touchdowns(&scene, &posture, leg, below, &start.legs[leg.0], 1);
        start.legs[leg.0] = down.unwrap()[0].angles;
    }
    let mut found = 0;
    for leg in robot.leg_ids() {
        let from = wheel_ground(&scene, &start, leg);
        let outward = Vector3::new(from.x, from.y, 0.0).normalize() * 0.25;
        let request = StepRequest::new(leg, Target::Ground(from + outward), 1.0);
        let answer = plan_step(&scene, &start, MOON, &request, &mut Unwatched);
        if answer.outcome == Outcome::Found {
            found += 1;
            let footfall = answer.footfall.unwrap();
            let ground = scene.map().height_at(footfall.contact.xy()).unwrap();
            assert!((footfall.contact.z - ground).abs() < robot.stance().ground_tolerance);
            let last = answer.waypoints.last().unwrap();
            let end = Posture::new(&robot, &start.with_leg(leg, last.angles));
            let gap = collision::wheel_ground(&end.wheel(&robot, leg), scene.map(), |_| true);
            assert!(gap.nearest.unwrap().gap.abs() < 1e-4, "{gap:?}");
        } else {
            assert!(!answer.reason.is_empty());
        }
    }
    assert!(found >= 4, "only {found} of 6 legs could step 0.25 m outward");
}
