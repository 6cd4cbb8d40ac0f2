//! Meshes as hulls, ball feet, and robots with other legs.

use std::sync::Arc;

use collision::{Allowance, LegChecker, Scene, survey, touchdowns, wheel_ground};
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegAngles, LegId, LinkShape, Mesh, Payload, Posture, Robot, Shape, WheelPose};

use crate::{athlete, load, plane};

/// The box of these half edges as OBJ, its faces wound one way and the other.
fn box_mesh(h: Vector3<f64>) -> Shape {
    let mut text = String::new();
    for i in 0..8 {
        let sign = |axis: usize| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
        text += &format!("v {} {} {}\n", sign(0) * h.x, sign(1) * h.y, sign(2) * h.z);
    }
    text += "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\nf 1 3 7 5\nf 2 4 8 6\n";
    let mesh = Mesh::parse("box.obj", text.as_bytes(), &Vector3::repeat(1.0)).unwrap();
    Shape::Mesh(Arc::new(mesh))
}

fn carrying(robot: &Robot, shape: Shape) -> Scene {
    let link_from_shape = Isometry3::from_parts(
        Vector3::new(0.1, 0.0, 0.4).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.2, 0.1, 0.3)),
    );
    let payload = Payload {
        shapes: vec![LinkShape { link_from_shape, shape }],
        ..Payload::boxed("chassis", 1.0, Point3::origin(), Vector3::repeat(1.0))
    };
    let loaded = robot.with_payloads(&[payload]).unwrap();
    Scene::new(Arc::new(loaded), plane(), &[]).unwrap()
}

#[test]
fn the_hull_of_a_cube_mesh_is_as_far_from_everything_as_the_box() {
    let robot = athlete();
    let half_extents = Vector3::new(0.9, 0.7, 0.3);
    let as_box = carrying(&robot, Shape::Box { half_extents });
    let as_mesh = carrying(&robot, box_mesh(half_extents));
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let mut base = robot.pose("bent").unwrap();
    base.world_from_base.translation.z = 2.0;
    let mut compared = 0;
    for _ in 0..300 {
        let model = robot.leg(LegId(0));
        let q = LegAngles::from_fn(|i, _| rng.random_range(model.lower[i]..model.upper[i]));
        let start = Posture::new(&robot, &base);
        let posture = start.with_leg(&robot, LegId(0), &q);
        let nearest = |scene: &Scene| {
            let checker = LegChecker::new(scene, &start, LegId(0), None, None);
            checker
                .clearance(&posture, Allowance { zone: None, buffered: false }, 0.5)
                .links
                .map(|v| v.distance)
        };
        match (nearest(&as_box), nearest(&as_mesh)) {
            (Some(a), Some(b)) => assert!((a - b).abs() < 1e-6, "{a} {b}"),
            (a, b) => assert_eq!(a, b),
        }
        let links = |scene: &Scene| survey(scene, &posture).links;
        let (a, b) = (links(&as_box), links(&as_mesh));
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            assert!((a.distance - b.distance).abs() < 1e-6, "{a:?} {b:?}");
            compared += 1;
        }
    }
    assert!(compared > 100, "only {compared} pairs were near: no evidence");
}

#[test]
fn a_ball_over_a_plane_has_a_gap_of_its_height_less_its_radius() {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    for _ in 0..500 {
        let mut u = || rng.random_range(-1.0..1.0);
        let center = Vector3::new(3.0 * u(), 3.0 * u(), 0.05 * u());
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(u(), u(), u()) * 3.0);
        let world_from_wheel = Isometry3::from_parts(center.into(), turn);
        let ball = WheelPose { world_from_wheel, radius: 0.02, width: 0.04, ball: true };
        let ground = wheel_ground(&ball, &plane(), |_| true);
        let gap = ground.nearest.unwrap();
        assert!((gap.gap - (center.z - 0.02)).abs() < 1e-7, "{gap:?} {center}");
        assert!((gap.ground.xy() - Point2::from(center.xy())).norm() < 2e-3, "{gap:?} {center}");
        assert!(!ground.unknown);
    }
}

/// The robot with its feet on the plane.
fn standing(robot: &Arc<Robot>) -> (Scene, Posture) {
    let scene = Scene::new(robot.clone(), plane(), &[]).unwrap();
    let mut configuration = robot.pose("standing").unwrap();
    let foot = Posture::new(robot, &configuration).wheel(robot, LegId(0));
    configuration.world_from_base.translation.z = -foot.lowest_point(&Vector3::z_axis()).z;
    (scene, Posture::new(robot, &configuration))
}

#[test]
fn other_robots_stand_on_all_feet_and_touch_nothing() {
    for name in ["quadruped", "hexapod", "slider"] {
        let robot = load(name);
        let (scene, posture) = standing(&robot);
        let seen = survey(&scene, &posture);
        assert_eq!(seen.standing.len(), robot.legs().len(), "{name}");
        assert!(seen.links.is_empty(), "{name}: {:?}", seen.links);
        assert!(seen.environment.is_empty(), "{name}: {:?}", seen.environment);
        let contacts = seen.contacts(&scene, &posture);
        for (leg, contact) in contacts {
            let foot = posture.wheel(&robot, leg).center();
            assert!((contact.xy() - foot.xy()).norm() < 2e-3 && contact.z.abs() < 1e-9);
        }
    }
}

#[test]
fn other_robots_put_their_feet_where_they_are_told() {
    for name in ["quadruped", "hexapod", "slider"] {
        let robot = load(name);
        let (scene, posture) = standing(&robot);
        for leg in robot.leg_ids() {
            let foot = posture.wheel(&robot, leg).center();
            let goal = foot.xy() + nalgebra::Vector2::new(0.02, -0.015);
            let near = robot.pose("standing").unwrap().legs[leg.0];
            let ways = touchdowns(&scene, &posture, leg, goal, &near, 3).unwrap();
            let moved = posture.with_leg(&robot, leg, &ways[0].angles).wheel(&robot, leg);
            assert!((moved.lowest_point(&Vector3::z_axis()).xy() - goal).norm() < 1e-8, "{name}");
            assert!((ways[0].wheel.center() - moved.center()).norm() < 1e-12);
            assert!((ways[0].contact.xy() - goal).norm() < 2e-3 && ways[0].contact.z.abs() < 1e-9);
            let gap = wheel_ground(&moved, scene.map(), |_| true).nearest.unwrap().gap;
            assert!(gap.abs() < 1e-6, "{name} {gap}");
        }
    }
}
