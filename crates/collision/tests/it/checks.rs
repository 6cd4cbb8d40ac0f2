//! The leg checker and the survey.

use collision::{
    Allowance, Certifier, ContactZone, Keep, LegChecker, Obstacle, Scene, SceneError, Touch, survey,
};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegId, Posture, Robot, Shape};

use crate::{athlete, on_plane, plane};

/// All wheels on the plane in a pose whose fork is vertical, by the pose's own height.
fn standing(robot: &Robot, pose: &str) -> Configuration {
    let mut configuration = robot.pose(pose).unwrap();
    let posture = Posture::new(robot, &configuration);
    let low = posture.wheel(robot, LegId(0)).lowest_point(&Vector3::z_axis());
    configuration.world_from_base.translation.z = -low.z;
    configuration
}

/// Angles of the first leg with its wheel moved by `shift` (m), by the nearest branch.
fn moved(robot: &Robot, configuration: &Configuration, shift: Vector3<f64>) -> LegAngles {
    let posture = Posture::new(robot, configuration);
    let goal = Isometry3::from(shift) * posture.wheel(robot, LegId(0)).world_from_wheel;
    let branches = posture.inverse_kinematics(robot, LegId(0), &goal).unwrap();
    let off = |q: &LegAngles| (q - configuration.legs[0]).amax();
    let angles = branches.iter().map(|branch| branch.angles);
    angles.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
}

#[test]
fn the_poses_that_ship_stand_free_on_all_wheels() {
    let scene = on_plane();
    for pose in ["bent", "standing"] {
        let posture = Posture::new(scene.robot(), &standing(scene.robot(), pose));
        let seen = survey(&scene, &posture);
        assert_eq!(seen.standing.len(), 6, "{pose}");
        assert!(seen.links.is_empty(), "{pose}: {:?}", seen.links);
        assert!(seen.environment.is_empty(), "{pose}: {:?}", seen.environment);
    }
}

#[test]
fn two_legs_that_reach_for_each_other_collide() {
    let scene = on_plane();
    let robot = scene.robot();
    let mut configuration = standing(robot, "bent");
    configuration.legs[0][0] = 1.25;
    configuration.legs[1][0] = -1.25;
    let seen = survey(&scene, &Posture::new(robot, &configuration));
    let Some(Touch::Links(a, b)) = seen.self_collision().map(|pair| pair.touch) else {
        panic!("{:?}", seen.links);
    };
    let names = [a, b].map(|link| &robot.links()[link.0].name);
    assert!(names[0].starts_with("leg1") && names[1].starts_with("leg2"), "{names:?}");
}

#[test]
fn a_wheel_below_the_ground_collides_however_deep() {
    let scene = on_plane();
    let robot = scene.robot();
    for depth in [0.05, 0.5, 3.0, 50.0] {
        let mut configuration = standing(robot, "bent");
        configuration.world_from_base.translation.z -= depth;
        let seen = survey(&scene, &Posture::new(robot, &configuration));
        assert!(seen.terrain_collision().is_some(), "{depth} m deep");
        assert!(seen.standing.is_empty());
    }
}

#[test]
fn the_inside_of_an_obstacle_is_solid() {
    let cube = |half: f64, at: Vector3<f64>| {
        let corner = |i: u32| {
            let sign = |bit: u32| if i >> bit & 1 == 1 { half } else { -half };
            Point3::from(at + Vector3::new(sign(0), sign(1), sign(2)))
        };
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        Obstacle::Mesh { vertices: (0..8).map(corner).collect(), triangles: triangles.collect() }
    };
    let robot = athlete();
    let mut configuration = standing(&robot, "bent");
    configuration.world_from_base.translation.z += 0.5; // clear of the ground
    let posture = Posture::new(&robot, &configuration);
    let knee = posture.link(robot.leg(LegId(0)).links[2]).translation.vector;
    let box_obstacle = Obstacle::Box {
        world_from_box: Isometry3::from(knee),
        half_extents: Vector3::new(3.0, 3.0, 3.0),
    };
    for obstacle in [cube(1.4, knee), box_obstacle] {
        let scene = Scene::new(robot.clone(), plane(), &[obstacle]).unwrap();
        let checker = LegChecker::new(&scene, &posture, LegId(0), None, None);
        let hit = checker.collision(&posture, None).unwrap();
        assert!(matches!(hit.touch, Touch::Obstacle(_, 0)), "{hit:?}");
    }
    let Obstacle::Mesh { vertices, mut triangles } = cube(1.0, knee) else { panic!() };
    triangles.pop();
    let open = Obstacle::Mesh { vertices, triangles };
    let refused = Scene::new(robot.clone(), plane(), &[open]).err();
    assert_eq!(refused, Some(SceneError::MeshNotClosed { index: 0 }));
}

#[test]
fn the_moving_wheel_may_touch_only_in_its_zone() {
    let scene = on_plane();
    let robot = scene.robot();
    let configuration = standing(robot, "bent");
    let posture = Posture::new(robot, &configuration);
    let checker = LegChecker::new(&scene, &posture, LegId(0), None, None);
    let wheel = posture.wheel(robot, LegId(0));
    let contact = wheel.lowest_point(&Vector3::z_axis());
    let zone = |at: Point3<f64>| ContactZone {
        contact: at,
        center: at + Vector3::new(0.0, 0.0, 0.264),
        radius: 0.15,
        height: 0.05,
        ground_tolerance: 0.02,
    };
    assert!(matches!(checker.collision(&posture, None).unwrap().touch, Touch::Ground(_)));
    assert_eq!(checker.violation(&posture, Some(&zone(contact))), None);
    let elsewhere = contact + Vector3::new(0.3, 0.0, 0.0);
    assert!(checker.collision(&posture, Some(&zone(elsewhere))).is_some());
}

#[test]
fn a_wheel_that_leaves_the_map_by_a_little_is_never_certified() {
    let robot = athlete();
    let mut configuration = standing(&robot, "bent");
    configuration.world_from_base.translation.z += 0.3;
    let posture = Posture::new(&robot, &configuration);
    // The map ends 1 cm beside the wheel's tread, measured with the leg straight ahead.
    let edge = posture.wheel(&robot, LegId(0)).center().x + 0.264 + 0.01;
    let map = terrain::ElevationMap::plane(edge, edge).unwrap();
    let scene = Scene::new(robot.clone(), map, &[]).unwrap();
    let checker = LegChecker::new(&scene, &posture, LegId(0), Some(0.0), None);
    let mut certifier = Certifier::new(&checker);
    let ahead = |by: f64| moved(&robot, &configuration, Vector3::x() * by);
    let inside = ahead(-0.03);
    assert!(certifier.certify(&inside, &ahead(0.005), Allowance::default()).is_free());
    for beyond in [0.015, 0.03, 0.05, 0.1] {
        let end = certifier.violation(&ahead(beyond), Allowance::default()).unwrap();
        assert!(matches!(end.touch, Touch::UnknownGround(_)), "{end:?}");
        let whole = certifier.certify(&inside, &ahead(beyond), Allowance::default());
        assert!(!whole.is_free(), "{beyond} m ahead: {whole:?}");
    }
}

#[test]
fn a_lift_from_a_footfall_in_raised_ground_is_certified_across_the_zones_top() {
    let scene = on_plane();
    let robot = scene.robot();
    let configuration = standing(robot, "bent");
    let posture = Posture::new(robot, &configuration);
    let wheel = posture.wheel(robot, LegId(0));
    let zone = ContactZone {
        contact: wheel.lowest_point(&Vector3::z_axis()),
        center: wheel.center(),
        radius: 0.15,
        height: 0.05,
        ground_tolerance: 0.02,
    };
    let keep = Keep { terrain_lift: 0.15, footfalls: vec![wheel.center().xy()], ..Keep::default() };
    let checker = LegChecker::keeping(&scene, &posture, LegId(0), keep);
    let mut certifier = Certifier::new(&checker);
    for up in (6..20).map(|cm| f64::from(cm) * 0.01) {
        let lifted = moved(robot, &configuration, Vector3::z() * up);
        for raised in [false, true] {
            let allowance = Allowance { zone: Some(&zone), buffered: raised };
            let lift = certifier.certify(&configuration.legs[0], &lifted, allowance);
            assert!(lift.is_free(), "{up} m, raised {raised}: {lift:?}");
        }
    }
}

#[test]
fn a_wheel_that_lacks_a_hair_of_its_clearance_is_too_near() {
    let scene = on_plane();
    let robot = scene.robot();
    let required = robot.tolerances().environment;
    for (height, free) in [(-4e-5, false), (-1e-5, false), (-1e-6, false), (1e-6, true)] {
        let mut configuration = standing(robot, "bent");
        configuration.world_from_base.translation.z += required + height;
        let posture = Posture::new(robot, &configuration);
        let checker = LegChecker::new(&scene, &posture, LegId(0), None, None);
        let found = checker.violation(&posture, None);
        assert_eq!(found.is_none(), free, "{height} m: {found:?}");
    }
}

#[test]
fn clearance_above_level_ground_is_the_height_of_the_wheel() {
    let scene = on_plane();
    let robot = scene.robot();
    let mut configuration = standing(robot, "bent");
    configuration.world_from_base.translation.z += 0.2;
    let posture = Posture::new(robot, &configuration);
    let checker = LegChecker::new(&scene, &posture, LegId(3), None, None);
    let nearest = checker.clearance(&posture, Allowance::default(), 1.0).environment.unwrap();
    assert!((nearest.distance - 0.2).abs() < 1e-6, "{nearest:?}");
    assert!(checker.violation(&posture, None).is_none());
    let tight = LegChecker::new(&scene, &posture, LegId(3), Some(0.21), None);
    let violation = tight.violation(&posture, None).unwrap();
    assert!((violation.distance - 0.2).abs() < 1e-6 && violation.required == 0.21);
}

/// Points on and in a shape, for oracles.
fn cloud(shape: &Shape, rng: &mut ChaCha8Rng) -> Point3<f64> {
    let mut u = || rng.random_range(-1.0..1.0_f64);
    match *shape {
        Shape::Box { half_extents: h } => Point3::new(u() * h.x, u() * h.y, u() * h.z),
        Shape::Cylinder { radius, half_length } => loop {
            let (x, y) = (u(), u());
            if x * x + y * y <= 1.0 {
                break Point3::new(x * radius, y * radius, u() * half_length);
            }
        },
        Shape::Capsule { .. } | Shape::Sphere { .. } | Shape::Mesh(_) => Point3::origin(),
    }
}

#[test]
fn what_is_called_free_holds_no_point_below_the_ground_or_in_an_obstacle() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let map =
        terrain::synthetic::generate(&terrain::synthetic::Recipe::boulder_field(), 3).unwrap();
    let rock = Obstacle::Box {
        world_from_box: Isometry3::translation(2.4, 0.0, 0.4),
        half_extents: Vector3::new(0.3, 0.3, 0.4),
    };
    let scene = Scene::new(robot.clone(), map, &[rock]).unwrap();
    let leg = LegId(0);
    let mut base = standing(&robot, "bent");
    base.world_from_base.translation.z += 0.3;
    let at_rest = Posture::new(&robot, &base);
    let checker = LegChecker::new(&scene, &at_rest, leg, Some(0.0), Some(0.0));
    let (mut free, mut colliding) = (0, 0);
    for _ in 0..1_500 {
        let q = base.legs[0] + LegAngles::from_fn(|_, _| rng.random_range(-0.5..0.5));
        let posture = at_rest.with_leg(&robot, leg, &q);
        let called_free = checker.collision(&posture, None).is_none();
        let inside = |link: rover::LinkId, rng: &mut ChaCha8Rng| {
            robot.links()[link.0].shapes.iter().any(|placed| {
                (0..60).any(|_| {
                    let p = posture.link(link) * placed.link_from_shape * cloud(&placed.shape, rng);
                    let in_rock =
                        (p.x - 2.4).abs() < 0.3 && p.y.abs() < 0.3 && p.z < 0.8 && p.z > 0.0;
                    in_rock || scene.map().height_at(p.xy()).is_some_and(|ground| p.z < ground)
                })
            })
        };
        let model = robot.leg(leg);
        let touches = model.links.iter().chain([&model.wheel_link]).any(|l| inside(*l, &mut rng));
        if called_free {
            free += 1;
            assert!(!touches, "{q} is called free, but a point of the leg is in the ground");
        } else {
            colliding += 1;
        }
    }
    assert!(free > 200 && colliding > 200, "{free} free, {colliding} colliding: no evidence");
}
