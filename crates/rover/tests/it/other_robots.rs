//! Robots with other legs: three joints, prismatic joints, ball feet.

use nalgebra::{Isometry3, Matrix4, Point3, UnitQuaternion, Vector3, Vector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{
    Configuration, FootTarget, JointKind, LegAngles, LegChain, LegId, LegSolver, NumericalIk,
    Posture, Proof, Robot, Wrench, hold_torques,
};

use crate::{athlete, load};

const OTHERS: [&str; 3] = ["quadruped", "hexapod", "slider"];

fn random_angles(robot: &Robot, leg: LegId, rng: &mut ChaCha8Rng) -> LegAngles {
    let leg = robot.leg(leg);
    LegAngles::from_fn(|i, _| {
        if leg.lower[i] < leg.upper[i] { rng.random_range(leg.lower[i]..leg.upper[i]) } else { 0.0 }
    })
}

fn random_configuration(robot: &Robot, rng: &mut ChaCha8Rng) -> Configuration {
    let mut vector = || Vector3::from_fn(|_, _| rng.random_range(-2.0..2.0));
    let world_from_base =
        Isometry3::from_parts(vector().into(), UnitQuaternion::from_scaled_axis(vector()));
    let legs = robot.leg_ids().map(|leg| random_angles(robot, leg, rng)).collect();
    Configuration { world_from_base, legs }
}

/// Forward kinematics by 4 x 4 matrices along each link's own chain to the base.
fn matrix_of(robot: &Robot, configuration: &Configuration, link: usize) -> Matrix4<f64> {
    let Some(j) = robot.links()[link].parent_joint else {
        return configuration.world_from_base.to_homogeneous();
    };
    let joint = &robot.joints()[j];
    let q =
        robot.legs().iter().zip(&configuration.legs).find_map(|(leg, q)| {
            leg.joints.iter().position(|other| *other == j).map(|place| q[place])
        });
    let (q, a) = (q.unwrap_or(0.0), joint.axis.into_inner());
    let own = if joint.kind == JointKind::Prismatic {
        Matrix4::new_translation(&(a * q))
    } else {
        // Rodrigues' formula.
        let cross = a.cross_matrix();
        (nalgebra::Matrix3::identity() + cross * q.sin() + cross * cross * (1.0 - q.cos()))
            .to_homogeneous()
    };
    matrix_of(robot, configuration, joint.parent.0) * joint.parent_from_joint.to_homogeneous() * own
}

#[test]
fn links_and_center_of_mass_are_where_matrix_products_put_them() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for name in OTHERS.into_iter().chain(["athlete"]) {
        let robot = load(name);
        for _ in 0..50 {
            let configuration = random_configuration(&robot, &mut rng);
            let rest = random_configuration(&robot, &mut rng);
            // Also by moving one leg after the other.
            let mut moved = Posture::new(
                &robot,
                &Configuration { world_from_base: configuration.world_from_base, ..rest },
            );
            for (leg, q) in robot.leg_ids().zip(&configuration.legs) {
                moved.move_leg(&robot, leg, q);
            }
            let posture = Posture::new(&robot, &configuration);
            let (mut moment, mut mass) = (Vector4::zeros(), 0.0);
            for (i, link) in robot.links().iter().enumerate() {
                let expected = matrix_of(&robot, &configuration, i);
                for posture in [&posture, &moved] {
                    let got = posture.link(rover::LinkId(i)).to_homogeneous();
                    assert!((got - expected).amax() < 1e-12, "{name} {}", link.name);
                }
                moment += expected * link.com.to_homogeneous() * link.mass;
                mass += link.mass;
            }
            let com = posture.center_of_mass(&robot).coords;
            assert!((com - moment.xyz() / mass).norm() < 1e-12);
        }
    }
}

#[test]
fn torques_and_forces_hold_the_gradient_of_the_potential() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let gravity = 9.8;
    for name in OTHERS {
        let robot = load(name);
        for _ in 0..30 {
            let base = random_configuration(&robot, &mut rng);
            let posture = Posture::new(&robot, &base);
            let leg = LegId(rng.random_range(0..robot.legs().len()));
            let force = Vector3::from_fn(|_, _| rng.random_range(-50.0..50.0));
            let foot = |p: &Posture| p.wheel(&robot, leg).center();
            let wrench = Wrench { point: foot(&posture), force };
            let torques = hold_torques(&robot, &posture, leg, gravity, Some(&wrench));
            let potential = |q: &LegAngles| {
                let p = posture.with_leg(&robot, leg, q);
                p.center_of_mass(&robot).z * robot.mass() * gravity - force.dot(&foot(&p).coords)
            };
            for i in 0..robot.leg(leg).n_joints() {
                let mut step = LegAngles::zeros();
                step[i] = 1e-6;
                let q = base.legs[leg.0];
                let gradient = (potential(&(q + step)) - potential(&(q - step))) / 2e-6;
                assert!(
                    (torques[i] - gradient).abs() < 1e-4,
                    "{name} {i}: {} {gradient}",
                    torques[i]
                );
            }
            assert!((robot.leg(leg).n_joints()..6).all(|i| torques[i] == 0.0));
        }
    }
}

#[test]
fn every_closed_form_solution_is_a_fixed_point_of_the_numerical_solver() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut checked = 0;
    while checked < 500 {
        let leg = LegId(rng.random_range(0..6));
        let (model, numerical) = (robot.leg(leg), NumericalIk::of(&robot, leg));
        assert!(numerical.fixes_orientation());
        let q = random_angles(&robot, leg, &mut rng);
        let configuration =
            Configuration { world_from_base: Isometry3::identity(), legs: vec![q; 6] };
        let target = Posture::new(&robot, &configuration).wheel(&robot, leg).world_from_wheel;
        for s in model.ik.solve(model, &target).unwrap().iter().filter(|s| s.within_limits) {
            let again = numerical.refine(model, &FootTarget::Pose(target), &s.angles).unwrap();
            assert!((again.angles - s.angles).amax() < 1e-6, "{s:?} {again:?}");
            let residual = again.residual.unwrap();
            assert!(residual.position < 1e-9 && residual.angle < 1e-9);
            checked += 1;
        }
    }
}

#[test]
fn the_numerical_solver_finds_what_the_closed_form_has() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut found, mut there) = (0, 0);
    for _ in 0..60 {
        let leg = LegId(rng.random_range(0..6));
        let (model, numerical) = (robot.leg(leg), NumericalIk::of(&robot, leg));
        let q = random_angles(&robot, leg, &mut rng);
        let configuration =
            Configuration { world_from_base: Isometry3::identity(), legs: vec![q; 6] };
        let target = Posture::new(&robot, &configuration).wheel(&robot, leg).world_from_wheel;
        let exact = model.ik.solve(model, &target).unwrap();
        let near = numerical.solve(model, &FootTarget::Pose(target));
        for s in near.iter().flatten() {
            // Nothing is invented: each is one of the branches.
            assert!(exact.iter().any(|e| (e.angles - s.angles).amax() < 1e-5), "{s:?} {exact:?}");
        }
        there += 1;
        found += usize::from(near.is_ok());
    }
    assert!(found * 10 >= there * 9, "{found} of {there}");
}

/// All joint angles of a hexapod's leg that bring its tip to a point of the leg's own frame, by
/// plane trigonometry: yaw, then the triangle of femur 0.12 m and tibia 0.14 m.
fn hexapod_leg(p: Vector3<f64>) -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    for (yaw, r) in [(p.y.atan2(p.x), p.xy().norm()), ((-p.y).atan2(-p.x), -p.xy().norm())] {
        let (x, down) = (r - 0.05, -p.z);
        let cosine =
            (x * x + down * down - 0.12_f64.powi(2) - 0.14_f64.powi(2)) / (2.0 * 0.12 * 0.14);
        if cosine.abs() > 1.0 {
            continue;
        }
        for knee in [cosine.acos(), -cosine.acos()] {
            let inner = (0.14 * knee.sin()).atan2(0.12 + 0.14 * knee.cos());
            all.push([yaw, geometry::wrap_to_pi(down.atan2(x) - inner), knee]);
        }
    }
    all
}

#[test]
fn a_leg_of_three_joints_has_the_solutions_of_its_own_formula() {
    let robot = load("hexapod");
    let posture = Posture::new(&robot, &robot.pose("standing").unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..400 {
        let leg = LegId(rng.random_range(0..6));
        let model = robot.leg(leg);
        assert!(matches!(model.ik, LegSolver::Numerical(_)) && !model.ik.fixes_orientation());
        let q = random_angles(&robot, leg, &mut rng);
        if q[2] < 0.15 {
            continue; // almost straight: two solutions grow together
        }
        let center = posture.with_leg(&robot, leg, &q).wheel(&robot, leg).center();
        let hip = robot.joints()[model.joints[0]].parent_from_joint;
        let in_leg = hip.inverse_transform_point(&center).coords;
        let wanted: Vec<[f64; 3]> = hexapod_leg(in_leg)
            .into_iter()
            .filter(|q| (0..3).all(|i| q[i] > model.lower[i] && q[i] < model.upper[i]))
            .collect();
        let found =
            posture.inverse_kinematics(&robot, leg, &Isometry3::from(center.coords)).unwrap();
        assert_eq!(found.len(), wanted.len(), "{q} {found:?} {wanted:?}");
        for s in &found {
            let residual = s.residual.unwrap();
            assert!(s.within_limits && residual.position < 1e-9 && residual.angle == 0.0);
            let got = posture.with_leg(&robot, leg, &s.angles).wheel(&robot, leg).center();
            assert!((got - center).norm() < 1e-9);
            let same = |w: &[f64; 3]| (0..3).all(|i| (w[i] - s.angles[i]).abs() < 1e-6);
            assert!(wanted.iter().any(same));
            assert!((3..6).all(|i| s.angles[i] == 0.0));
        }
    }
}

#[test]
fn prismatic_legs_are_solved_in_meters() {
    let robot = load("slider");
    let posture = Posture::new(&robot, &robot.pose("standing").unwrap());
    let leg = robot.leg(LegId(0));
    // At azimuth zero: x = 0.42 + (0.25 + reach + 0.12) cos yaw, z = -0.4 - height.
    let target = Isometry3::translation(0.42 + 0.52 * 0.3_f64.cos(), 0.52 * 0.3_f64.sin(), -0.55);
    let found = posture.inverse_kinematics(&robot, LegId(0), &target).unwrap();
    assert_eq!(found.len(), 1);
    let expected = LegAngles::new(0.3, 0.15, 0.15, 0.0, 0.0, 0.0);
    assert!((found[0].angles - expected).amax() < 1e-9, "{found:?}");
    // Twice the size: strokes and poses in meters are twice as long, turns stay.
    let large = robot.scaled(2.0).unwrap();
    let doubled = Posture::new(&large, &large.pose("standing").unwrap());
    for id in robot.leg_ids() {
        let (a, b) = (posture.wheel(&robot, id).center(), doubled.wheel(&large, id).center());
        assert!((a.coords * 2.0 - b.coords).norm() < 1e-12);
        assert_eq!(large.leg(id).upper[1], 2.0 * leg.upper[1]);
        assert_eq!(large.leg(id).effort[1], leg.effort[1]);
        assert_eq!(large.leg(id).effort[0], 2.0 * leg.effort[0]);
    }
    assert_eq!(large.stance().leg_stiffness, 0.5 * robot.stance().leg_stiffness);
    let target =
        Isometry3::translation(2.0 * target.translation.x, 2.0 * target.translation.y, -1.1);
    let found = doubled.inverse_kinematics(&large, LegId(0), &target).unwrap();
    assert!((found[0].angles - LegAngles::new(0.3, 0.3, 0.3, 0.0, 0.0, 0.0)).amax() < 1e-9);
}

#[test]
fn out_of_reach_is_proven_and_the_rest_is_not_found() {
    let robot = load("hexapod");
    let posture = Posture::new(&robot, &robot.pose("standing").unwrap());
    let at = |x: f64, z: f64| {
        posture
            .inverse_kinematics(&robot, LegId(5), &Isometry3::translation(x, 0.0, z))
            .unwrap_err()
    };
    // Hip at 0.12 m, coxa 0.05 + femur 0.12 + tibia 0.14 m long.
    let far = at(0.12 + 0.31 + 0.2, 0.0);
    assert_eq!(far.proof, Proof::Unreachable);
    assert!((far.distance - 0.2).abs() < 1e-9);
    let folded = at(0.12 + 0.05, 0.0); // the tip would have to be in the femur's joint
    assert_eq!(folded.proof, Proof::NotFound);
    assert!(folded.distance > 0.01, "{folded:?}");
}

#[test]
fn ball_feet_stand_one_radius_above_the_ground_in_every_pose() {
    let robot = load("quadruped");
    let leg = robot.leg(LegId(0));
    assert_eq!((leg.n_joints(), leg.wheel_joint, leg.wheel.ball), (3, None, true));
    let posture = Posture::new(&robot, &robot.pose("standing").unwrap());
    for id in robot.leg_ids() {
        let foot = posture.wheel(&robot, id);
        // Thigh and calf of 0.2 m at ±0.8 rad from the vertical: the foot is below the hip.
        let hip = posture.link(robot.leg(id).links[1]).translation.vector;
        let expected = Point3::from(hip - Vector3::z() * 0.4 * 0.8_f64.cos());
        assert!((foot.center() - expected).norm() < 1e-12);
        let lowest = foot.lowest_point(&Vector3::z_axis());
        assert!((lowest - (expected - Vector3::z() * 0.02)).norm() < 1e-12);
    }
}

#[test]
fn the_fast_chain_is_the_same_kinematics_and_bounds_every_motion() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for name in OTHERS {
        let robot = load(name);
        for _ in 0..100 {
            let posture = Posture::new(&robot, &random_configuration(&robot, &mut rng));
            let leg = LegId(rng.random_range(0..robot.legs().len()));
            let model = robot.leg(leg);
            let chain = LegChain::new(&robot, &posture, leg);
            let q = random_angles(&robot, leg, &mut rng);
            let (frames, moved) = (chain.frames(&q), posture.with_leg(&robot, leg, &q));
            for place in 0..6 {
                let link = model.links[place.min(model.n_joints() - 1)];
                let got = frames.links[place].to_isometry().to_homogeneous();
                assert!((got - moved.link(link).to_homogeneous()).amax() < 1e-12, "{name}");
            }
            let com = moved.center_of_mass(&robot);
            assert!((chain.center_of_mass(&frames) - com).norm() < 1e-12, "{name}");
            // The foot and the center of mass stay within their bounds.
            let change = LegAngles::from_fn(|i, _| {
                if i < model.n_joints() { rng.random_range(0.0..0.3) } else { 0.0 }
            });
            let foot = moved.wheel(&robot, leg).center();
            let bound = frames.motion_bound(5, 0, [&foot, &foot], 0.0, &change);
            for _ in 0..20 {
                let step = change.map(|c| if c > 0.0 { rng.random_range(-c..c) } else { 0.0 });
                let there = posture.with_leg(&robot, leg, &(q + step));
                let way = (there.wheel(&robot, leg).center() - foot).norm();
                assert!(way <= bound + 1e-12, "{name}: {way} {bound}");
                let shift = (there.center_of_mass(&robot) - com).norm();
                assert!(shift <= chain.com_motion(&change) + 1e-12, "{name}");
            }
        }
    }
}
