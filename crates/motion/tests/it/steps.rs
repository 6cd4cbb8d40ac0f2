//! Whole steps.

use collision::{LegChecker, Obstacle, Scene, survey};
use motion::{
    Outcome, Phase, Planner, Stage, StepAnswer, StepRequest, Stopped, Target, Unwatched, Watch,
    plan_step,
};
use nalgebra::{Isometry3, Point3, Vector3};
use rover::{Configuration, LegId, Posture};
use stability::rule::{self, Preference};

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
    request.preload = false;
    change(&mut request);
    plan_step(scene, &start, MOON, &request, &mut Unwatched)
}

#[test]
fn at_the_end_the_wheel_is_pressed_to_its_predicted_load() {
    let scene = scene(loaded(), &[]);
    let robot = scene.robot();
    let start = standing(robot);
    let answer = step(&scene, [0.3, 0.0], |r| r.preload = true);
    assert_eq!(answer.outcome, Outcome::Found, "{}", answer.reason);
    let load = answer.preload.unwrap();
    // Six equal springs on a nearly regular hexagon bear about a sixth each.
    let sixth = robot.mass() * MOON / 6.0;
    assert!((load / sixth - 1.0).abs() < 0.25, "{load} N of {sixth} N");
    let last = answer.waypoints.last().unwrap();
    assert_eq!(last.phase, Phase::Preload);
    let end = wheel_ground(&scene, &start.with_leg(LegId(1), last.angles), LegId(1));
    let wanted = (load / robot.stance().leg_stiffness).min(0.01);
    assert!((end.z + wanted).abs() < 1e-6, "{} m deep, {wanted} m wanted", -end.z);
}

#[test]
fn where_the_rule_asks_for_it_the_body_is_shifted_first() {
    let scene = scene(loaded(), &[]);
    let conservative = |r: &mut StepRequest| r.preference = Preference::Conservative;
    let answer = step(&scene, [0.2, 0.1], conservative);
    assert_eq!(answer.outcome, Outcome::Found, "{}", answer.reason);
    let shift: Vec<_> = answer.waypoints.iter().take_while(|w| w.stance.is_some()).collect();
    assert!(shift.len() > 1, "{}", answer.reason);
    assert!(shift.iter().all(|w| w.phase == Phase::Shift));
    assert!(answer.waypoints.windows(2).all(|w| w[1].time > w[0].time));
    // The feet stay while the body goes.
    let feet = |c: &Configuration| {
        let posture = Posture::new(scene.robot(), c);
        scene.robot().leg_ids().map(|leg| posture.wheel(scene.robot(), leg).center()).collect()
    };
    let [first, last] = [shift[0], shift[shift.len() - 1]].map(|w| w.stance.clone().unwrap());
    let (before, after): (Vec<Point3<f64>>, Vec<Point3<f64>>) = (feet(&first), feet(&last));
    assert!(before.iter().zip(&after).all(|(a, b)| (a - b).norm() < 1e-6));
    let way = last.world_from_base.translation.vector - first.world_from_base.translation.vector;
    assert!(way.norm() > 0.02, "{way}");
    // Without leave to shift, the answer says what is missing.
    let refused = step(&scene, [0.2, 0.1], |r| {
        conservative(r);
        r.may_shift = false;
    });
    assert_eq!(refused.outcome, Outcome::Unstable);
    assert_eq!(refused.constraint.unwrap().name, "stability");
}

#[test]
fn a_place_out_of_reach_is_answered_with_what_is_missing_and_the_nearest_that_works() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let from = wheel_ground(&scene, &start, LegId(1));
    let shift = [from.x * 0.45, from.y * 0.45];
    let far = step(&scene, shift, |_| {});
    assert_eq!(far.outcome, Outcome::Unreachable, "{}", far.reason);
    let constraint = far.constraint.unwrap();
    assert!(constraint.missing.unwrap() > 0.0, "{constraint:?}");
    let nearest = far.nearest.unwrap();
    let there = step(&scene, [nearest.x - from.x, nearest.y - from.y], |_| {});
    assert_eq!(there.outcome, Outcome::Found, "{}", there.reason);
    let asked = Point3::new(from.x + shift[0], from.y + shift[1], 0.0);
    // On level ground the way home is the shortest: by centimeters along it, to the first that is found.
    let home = Vector3::new(-shift[0], -shift[1], 0.0).normalize();
    let first = (1..100).map(|cm| f64::from(cm) * 0.01).find(|d| {
        let p = asked + home * *d;
        step(&scene, [p.x - from.x, p.y - from.y], |_| {}).outcome == Outcome::Found
    });
    let (first, away) = (first.unwrap(), (nearest - asked).norm());
    assert!(
        (first - 0.02..first + 0.4 / 8.0).contains(&away),
        "{away} m, the first is at {first} m"
    );
}

#[test]
fn buffers_hold_on_the_way_but_not_under_the_feet() {
    // A low sill between start and goal: 5 cm high.
    let start = standing(&loaded());
    let from = wheel_ground(&scene(loaded(), &[]), &start, LegId(1));
    let sill = Obstacle::Box {
        world_from_box: Isometry3::translation(from.x + 0.4, from.y, 0.025),
        half_extents: Vector3::new(0.05, 0.5, 0.025),
    };
    let scene = scene(loaded(), &[sill]);
    let least_height = |answer: &StepAnswer| {
        let transit = answer.waypoints.windows(2).filter(|w| w[1].phase == Phase::Transit);
        let mut least = f64::INFINITY;
        for w in transit {
            for i in 0..=20 {
                let q = w[0].angles.lerp(&w[1].angles, f64::from(i) / 20.0);
                let posture = Posture::new(scene.robot(), &start.with_leg(LegId(1), q));
                let wheel = posture.wheel(scene.robot(), LegId(1));
                let center = wheel.center();
                let near_foot = |x: f64| (center.x - x).hypot(center.y - from.y) <= 0.15;
                if !near_foot(from.x) && !near_foot(from.x + 0.8) {
                    least = least.min(wheel.lowest_point(&Vector3::z_axis()).z);
                }
            }
        }
        least
    };
    let raised = step(&scene, [0.8, 0.0], |r| r.buffers.terrain_lift = 0.25);
    assert_eq!(raised.outcome, Outcome::Found, "{}", raised.reason);
    // The waypoints are 0.20 m up, lower than the raised ground: only beside the feet is it raised.
    assert!(least_height(&raised) >= 0.25 + 0.03 - 1e-3, "{}", least_height(&raised));
    let buffered = step(&scene, [0.8, 0.0], |r| r.buffers.obstacle = 0.2);
    assert_eq!(buffered.outcome, Outcome::Found, "{}", buffered.reason);
    assert!(buffered.findings.iter().all(|f| f.ok));
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
fn waypoints_where_the_robot_may_be_held_are_those_where_the_rule_holds() {
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let answer = step(&scene, [0.3, 0.2], |_| {});
    let posture = Posture::new(scene.robot(), &start);
    let feet = survey(&scene, &posture).contacts(&scene, &posture);
    let others: Vec<_> = feet.into_iter().filter(|(leg, _)| *leg != LegId(1)).collect();
    for w in &answer.waypoints {
        let at = Posture::new(scene.robot(), &start.with_leg(LegId(1), w.angles));
        let report = rule::assess(scene.robot(), &at, &others, MOON);
        let verdict = rule::verdict(&report, scene.robot().stance(), Preference::Regular);
        assert_eq!(w.hold, verdict.ok, "{}", verdict.explanation);
    }
    // A bare motion of the leg says nothing of stability.
    let goal = answer.waypoints[answer.waypoints.len() / 2].angles;
    let mut request = StepRequest::new(LegId(1), Target::Angles(goal), 1.0);
    request.transit_only = true;
    let lifted = start.with_leg(LegId(1), answer.waypoints[2].angles);
    let bare = plan_step(&scene, &lifted, MOON, &request, &mut Unwatched);
    assert!(bare.waypoints.iter().all(|w| !w.hold), "{}", bare.reason);
}

#[test]
fn the_ground_is_not_raised_under_a_goal_given_by_angles() {
    let scene = scene(loaded(), &[]);
    let there = step(&scene, [0.6, 0.0], |_| {});
    let angles = there.waypoints.last().unwrap().angles;
    let raised = step(&scene, [0.0, 0.0], |r| {
        r.target = Target::Angles(angles);
        r.buffers.terrain_lift = 0.25; // above the waypoints, which are 0.20 m up
    });
    assert_eq!(raised.outcome, Outcome::Found, "{}", raised.reason);
}

#[test]
fn a_deadline_while_a_shift_is_sought_is_a_deadline() {
    struct InShift(bool);
    impl Watch for InShift {
        fn stopped(&mut self) -> Option<Stopped> {
            self.0.then_some(Stopped::Deadline)
        }
        fn entered(&mut self, stage: Stage) {
            self.0 |= stage == Stage::Shift;
        }
    }
    let scene = scene(loaded(), &[]);
    let start = standing(scene.robot());
    let target = Target::Ground(wheel_ground(&scene, &start, LegId(1)));
    let mut request = StepRequest::new(LegId(1), target, 1.0);
    request.preference = Preference::Conservative;
    let answer = plan_step(&scene, &start, MOON, &request, &mut InShift(false));
    assert_eq!(answer.outcome, Outcome::Deadline, "{}", answer.reason);
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
        let mut request = StepRequest::new(leg, Target::Ground(from + outward), 1.0);
        request.preload = false;
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
