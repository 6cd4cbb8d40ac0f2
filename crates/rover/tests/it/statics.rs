//! Mass, center of mass and torques against figures derived by other means.

use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegId, Payload, Posture, Wrench, hold_torques};

use crate::athlete;

#[test]
fn the_mass_is_that_of_the_vehicle_and_symmetric() {
    let robot = athlete();
    assert!((robot.mass() - 850.0).abs() < 1e-6, "{}", robot.mass());
    let com = Posture::new(&robot, &robot.pose("standing").unwrap()).center_of_mass(&robot);
    assert!(com.x.abs() < 1e-9 && com.y.abs() < 1e-9, "{com}");
}

#[test]
fn a_payload_moves_the_center_of_mass_by_its_share() {
    let robot = athlete();
    let (com, edges) = (Point3::new(0.4, 0.0, 0.25), Vector3::new(1.2, 1.2, 0.5));
    let payload = Payload::boxed("chassis", 300.0, com, edges);
    let loaded = robot.with_payloads(&[payload]).unwrap();
    let pose = robot.pose("bent").unwrap();
    let before = Posture::new(&robot, &pose).center_of_mass(&robot);
    let after = Posture::new(&loaded, &pose).center_of_mass(&loaded);
    let expected = (before.coords * 850.0 + Vector3::new(0.4, 0.0, 0.25) * 300.0) / 1150.0;
    assert!((after.coords - expected).norm() < 1e-9);
    assert_ne!(loaded.hash(), robot.hash());
}

#[test]
fn hold_torques_are_the_gradient_of_the_potential() {
    // Independent of any moment balance: τ = dV/dq, V = g Σ m z - F · (wheel center).
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..200 {
        let leg = LegId(rng.random_range(0..6));
        let q = LegAngles::from_fn(|_, _| rng.random_range(-1.5..1.5));
        let base = Configuration {
            world_from_base: Isometry3::new(
                Vector3::new(1.0, -2.0, 0.5),
                Vector3::new(0.2, -0.1, 0.7),
            ),
            legs: vec![LegAngles::zeros(); 6],
        };
        let force = Vector3::new(30.0, -80.0, 700.0);
        let at_rest = Posture::new(&robot, &base);
        let potential = |q: &LegAngles| {
            let posture = at_rest.with_leg(&robot, leg, q);
            let height = posture.center_of_mass(&robot).z;
            let center = posture.wheel(&robot, leg).center();
            1.62 * robot.mass() * height - force.dot(&center.coords)
        };
        let posture = at_rest.with_leg(&robot, leg, &q);
        let wrench = Wrench { point: posture.wheel(&robot, leg).center(), force };
        let torques = hold_torques(&robot, &posture, leg, 1.62, Some(&wrench));
        for i in 0..6 {
            let mut step = LegAngles::zeros();
            step[i] = 1e-5;
            let gradient = (potential(&(q + step)) - potential(&(q - step))) / 2e-5;
            assert!((torques[i] - gradient).abs() < 1e-4, "joint {i}: {} {gradient}", torques[i]);
        }
    }
}
