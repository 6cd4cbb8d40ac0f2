//! Quick answers about configurations that are much alike against the plain checks.

use collision::{
    Allowance, ContactZone, Follower, FootTouch, Footings, Hint, LegChecker, QuickChecker, Touch,
    WheelHeading,
};
use nalgebra::{Point2, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Frame, LegAngles, LegId, Posture, Robot};
use terrain::ElevationMap;
use terrain::synthetic::{Recipe, generate};

use crate::oracle::World;
use crate::worlds::{block, holes, load, spikes, standing, thin_boxes};
use crate::{athlete, cases, plane};

/// A small step: each joint by up to `most` (rad), within the limits.
fn step(robot: &Robot, leg: LegId, q: &LegAngles, most: f64, rng: &mut ChaCha8Rng) -> LegAngles {
    let model = robot.leg(leg);
    let moved = q + LegAngles::from_fn(|_, _| rng.random_range(-most..most));
    moved.sup(&model.lower).inf(&model.upper)
}

fn zone(robot: &Robot, wheel: Point3<f64>) -> ContactZone {
    let rules = robot.stance();
    ContactZone {
        contact: wheel - Vector3::z() * 0.264,
        center: wheel,
        radius: rules.contact_radius,
        height: rules.contact_height,
        ground_tolerance: rules.ground_tolerance,
    }
}

fn worlds(rng: &mut ChaCha8Rng) -> Vec<World> {
    let rough =
        Recipe { width_m: 12.0, height_m: 12.0, flat_center_m: 0.0, ..Recipe::boulder_field() };
    let (low, high) = (Point2::new(0.5, -2.5), Point2::new(4.0, 2.5));
    let about = Vector3::new(2.2, 0.2, 0.5);
    let (pins, plates) = (spikes(low, high, 60, rng), thin_boxes(12, about, rng));
    let world = |map: ElevationMap, things| World::new(athlete(), map, things);
    vec![
        world(plane(), Vec::new()),
        world(generate(&rough, 11).unwrap(), Vec::new()),
        world(plane(), plates),
        world(pins, Vec::new()),
        world(holes(4.0, 20, rng), Vec::new()),
    ]
}

#[test]
fn what_follows_closely_is_answered_as_anew() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let (mut free, mut touching) = (0, 0);
    for world in worlds(&mut rng) {
        let robot = world.scene.robot();
        let leg = LegId(0);
        let start = standing(robot);
        let posture = Posture::new(robot, &start);
        let checker = LegChecker::new(&world.scene, &posture, leg, None, None);
        let mut follower = Follower::new(&checker);
        let mut quick = QuickChecker::new(&checker);
        for walk in 0..cases(24, 400) {
            let mut q = load(robot, leg, walk, &mut rng);
            let most = [0.003, 0.01, 0.04][walk % 3];
            if walk % 5 == 0 {
                follower.begin();
            }
            let mut hint = Hint::default();
            for _ in 0..120 {
                q = step(robot, leg, &q, most, &mut rng);
                let frames = checker.chain().frames(&q);
                let center = posture.with_leg(robot, leg, &q).wheel(robot, leg).center();
                let zone = zone(robot, center);
                let zone = Some(&zone).filter(|_| walk % 2 == 0);
                let allowance = Allowance { zone, buffered: false };
                let expected = checker.violation_at(&q, allowance).is_some();
                let found = follower.touch(&frames, allowance).is_some();
                assert_eq!(found, expected, "{q:?} {:?}", checker.violation_at(&q, allowance));
                let hinted = quick.touch(&frames, allowance, &mut hint).is_some();
                assert_eq!(hinted, expected, "{q:?} {hint:?}");
                *(if expected { &mut touching } else { &mut free }) += 1;
            }
        }
    }
    assert!(free > 2_000 && touching > 2_000, "{free} {touching}");
}

/// Joints alone or a few together, by steps of any size to and fro: then a part's way is as long as it can be for
/// what its links and the joints between say.
#[test]
fn sweeps_of_single_joints_are_followed_as_anew() {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    let (mut free, mut touching, mut turns) = (0, 0, 0);
    let n_worlds = worlds(&mut rng).len();
    // Little rods about the housings that turn with the hip yaw alone, which just miss them or just touch.
    let robot = athlete();
    let posture = Posture::new(&robot, &standing(&robot));
    let leg = robot.leg(LegId(0));
    let housings: Vec<Point3<f64>> = leg.links[..2]
        .iter()
        .flat_map(|link| {
            let shapes = robot.links()[link.0].shapes.iter();
            shapes.map(|s| posture.link(*link) * Point3::from(s.link_from_shape.translation.vector))
        })
        .collect();
    let mut all = worlds(&mut rng);
    for _ in 0..cases(24, 100) {
        let mut rod = || {
            let at = housings[rng.random_range(0..housings.len())].coords;
            let aside = Vector3::from_fn(|_, _| rng.random_range(-0.4..0.4));
            block(at + aside, Vector3::zeros(), Vector3::repeat(0.004))
        };
        let rods = (0..2).map(|_| rod()).collect();
        all.push(World::new(athlete(), plane(), rods));
    }
    for (index, world) in all.into_iter().enumerate() {
        let robot = world.scene.robot();
        let leg = LegId(0);
        let posture = Posture::new(robot, &standing(robot));
        let checker = LegChecker::new(&world.scene, &posture, leg, None, None);
        let mut follower = Follower::new(&checker);
        for walk in 0..if index < n_worlds { cases(36, 300) } else { 6 } {
            let model = robot.leg(leg);
            let mut q = load(robot, leg, walk, &mut rng);
            // A joint alone, the wrist, or thigh and knee.
            let alone = if index < n_worlds { walk % 8 } else { 0 };
            let moves = |joint: usize| match alone {
                6 => joint >= 3,
                7 => joint == 1 || joint == 2,
                alone => joint == alone,
            };
            let mut step = rng.random_range(0.002..0.08);
            let mut before = None;
            for _ in 0..60 {
                if rng.random_range(0..12) == 0 {
                    step = -step * rng.random_range(0.5..1.5);
                }
                let shares = LegAngles::from_fn(|_, _| rng.random_range(0.3..1.0));
                q += LegAngles::from_fn(
                    |joint, _| if moves(joint) { step * shares[joint] } else { 0.0 },
                );
                if q != q.sup(&model.lower).inf(&model.upper) {
                    q = q.sup(&model.lower).inf(&model.upper);
                    step = -step;
                }
                let expected = checker.violation_at(&q, Allowance::default()).is_some();
                let frames = checker.chain().frames(&q);
                let found = follower.touch(&frames, Allowance::default()).is_some();
                assert_eq!(found, expected, "{q:?}");
                *(if expected { &mut touching } else { &mut free }) += 1;
                turns += usize::from(before.is_some_and(|before| before != expected));
                before = Some(expected);
            }
        }
    }
    assert!(free > 1_000 && touching > 1_000 && turns > 100, "{free} {touching} {turns}");
}

#[test]
fn what_is_in_the_way_of_a_foot_is_so_whatever_the_leg_and_of_a_wheel_whatever_its_fork() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    let (mut of_foot, mut of_wheel) = (0, 0);
    for world in worlds(&mut rng) {
        let robot = world.scene.robot();
        let leg = LegId(0);
        let posture = Posture::new(robot, &standing(robot));
        let checker = LegChecker::new(&world.scene, &posture, leg, None, None);
        let mut quick = QuickChecker::new(&checker);
        for i in 0..cases(400, 4000) {
            let q = load(robot, leg, i, &mut rng);
            let wheel = posture.with_leg(robot, leg, &q).wheel(robot, leg);
            let wheel = Frame::from(&wheel.world_from_wheel);
            let mut hint = Hint::default();
            let none = Allowance::default();
            let touch = quick.touch(&checker.chain().frames(&q), none, &mut hint);
            let foot = touch.and_then(|_| quick.foot_touch_at(&wheel, none, &mut hint));
            let Some(FootTouch { touch: of, is_wheel }) = foot else { continue };
            assert_eq!(Some(of), touch);
            of_foot += 1;
            // The other ways to hold the wheel there touch something too.
            let pose = wheel.to_isometry();
            for solution in posture.inverse_kinematics(robot, leg, &pose).unwrap() {
                assert!(checker.violation_at(&solution.angles, none).is_some(), "{solution:?}");
            }
            if !is_wheel || matches!(of, Touch::Links(..)) {
                continue;
            }
            let pitch =
                UnitQuaternion::from_axis_angle(&Vector3::y_axis(), rng.random_range(-0.5..0.5));
            let turned = pose * pitch;
            let Ok(all) = posture.inverse_kinematics(robot, leg, &turned) else { continue };
            for solution in all {
                of_wheel += 1;
                assert!(checker.violation_at(&solution.angles, none).is_some(), "{solution:?}");
            }
        }
    }
    assert!(of_foot > 200 && of_wheel > 200, "{of_foot} {of_wheel}");
}

#[test]
fn a_wheel_sits_the_same_wherever_the_ground_is_looked_at_first() {
    let rough =
        Recipe { width_m: 12.0, height_m: 12.0, flat_center_m: 0.0, ..Recipe::boulder_field() };
    let world = World::new(athlete(), generate(&rough, 12).unwrap(), Vec::new());
    let robot = world.scene.robot();
    let posture = Posture::new(robot, &standing(robot));
    let footings = Footings::new(&world.scene, &posture, LegId(0), WheelHeading::Free);
    let mut rng = ChaCha8Rng::seed_from_u64(23);
    let mut n_seats = 0;
    for _ in 0..cases(300, 3000) {
        let p = Point2::new(rng.random_range(0.5..4.0), rng.random_range(-2.0..2.0));
        let near =
            p + Vector3::new(rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3), 0.0).xy();
        let orientation = rng.random_range(0..footings.n_orientations());
        let mut plain = footings.at(p).unwrap();
        let mut seeded = footings.at(p).unwrap();
        seeded.nearest = Some(near);
        match (plain.seat(orientation), seeded.seat(orientation)) {
            (Ok(a), Ok(b)) => {
                n_seats += 1;
                assert!((a.shift - b.shift).abs() < 5e-8, "{p}: {a:?} {b:?}");
            }
            (a, b) => assert_eq!(a.is_err(), b.is_err(), "{p}: {a:?} {b:?}"),
        }
    }
    assert!(n_seats > 150, "{n_seats}");
}

#[test]
fn a_wheel_that_sits_on_the_ground_is_answered_as_by_a_look() {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    let (mut free, mut touching) = (0, 0);
    for world in worlds(&mut rng) {
        let robot = world.scene.robot();
        let leg = LegId(0);
        let posture = Posture::new(robot, &standing(robot));
        let checker = LegChecker::new(&world.scene, &posture, leg, None, None);
        let mut follower = Follower::new(&checker);
        let footings = Footings::new(&world.scene, &posture, leg, WheelHeading::Free);
        for i in 0..cases(150, 3000) {
            if i % 10 == 0 {
                follower.begin();
            }
            let p = Point2::new(rng.random_range(1.6..3.2), rng.random_range(-1.2..1.2));
            let orientation = rng.random_range(0..footings.n_orientations());
            let Some(mut footing) = footings.at(p) else { continue };
            let Ok(seat) = footing.seat(orientation) else { continue };
            let center = footing.seated_frame(orientation, &seat, 0.0).origin;
            let zone = zone(robot, center.into());
            let allowance = Allowance { zone: Some(&zone), buffered: false };
            for q in footing.angles(orientation, &seat, 0.0).unwrap_or_default() {
                let expected = checker.violation_at(&q, allowance).is_some();
                let found =
                    follower.touch_standing(&checker.chain().frames(&q), &zone, true).is_some();
                assert_eq!(found, expected, "{p} {q:?} {:?}", checker.violation_at(&q, allowance));
                *(if expected { &mut touching } else { &mut free }) += 1;
            }
        }
    }
    assert!(free > 50 && touching > 50, "{free} {touching}");
}
