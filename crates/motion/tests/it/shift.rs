//! Body shifts of the athlete on its planted wheels.

use std::sync::Arc;

use motion::shift::closure_error;
use motion::{
    BodyClear, NoShift, SampledBody, ShiftPlan, ShiftRequest, Unwatched, base_between, plan_shift,
};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use stability::{Preference, assess, verdict};

use crate::{athlete, loaded, scene, standing};

/// Everything is clear: for what kinematics and stability alone allow.
struct Clear;

impl BodyClear for Clear {
    fn piece(&mut self, _: &Configuration, _: &Configuration) -> Result<(), String> {
        Ok(())
    }
}

fn feet(robot: &Robot, configuration: &Configuration) -> Vec<(LegId, Point3<f64>)> {
    let posture = Posture::new(robot, configuration);
    let touch = |leg| (leg, posture.wheel(robot, leg).lowest_point(&Vector3::z_axis()));
    robot.leg_ids().map(touch).collect()
}

fn legs(robot: &Robot) -> Vec<LegId> {
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

fn most(robot: Robot, preference: Preference, drive_hold: bool) -> (NoShift, f64) {
    let robot = Arc::new(robot);
    let start = standing(&robot);
    let feet = feet(&robot, &start);
    let radius = foot_radius(&robot, &start);
    let scene = scene(robot, &[]);
    let wanted_spare = 10.0;
    let request = ShiftRequest {
        preference,
        drive_hold,
        wanted_spare,
        ..ShiftRequest::new(&scene, &start, &feet, LegId(0))
    };
    (plan_shift(&request, &mut Clear, &mut Unwatched).unwrap_err(), radius)
}

#[test]
fn explore() {
    let robot = athlete();
    let start = standing(&robot);
    for n in [1, 2, 4, 8] {
        let knots: Vec<_> = (0..=n)
            .map(|i| {
                moved(&robot, &start, Vector3::new(0.0, 0.30, 0.0) * f64::from(i) / f64::from(n))
            })
            .collect();
        let worst = knots
            .windows(2)
            .map(|w| closure_error(&robot, &w[0], &w[1], &legs(&robot)))
            .fold(0.0, f64::max);
        println!("{n}: {worst}");
    }
    for r in [athlete(), Robot::clone(&loaded())] {
        let com = |c: &Configuration| Posture::new(&r, c).center_of_mass(&r);
        let ratio = |o: Vector3<f64>| (com(&moved(&r, &start, o)) - com(&start)).norm() / o.norm();
        println!("{} {}", ratio(Vector3::x() * 0.2), ratio(Vector3::y() * 0.2));
    }
    for hold in [false, true] {
        let (none, radius) = most(athlete(), Preference::Conservative, hold);
        println!("cons {} of R: {none:?}", none.best_spare / radius);
    }
    let (none, radius) = most(athlete(), Preference::Regular, false);
    println!("reg {} of R: {none:?}", none.best_spare / radius);
}
