//! The give of a leg under load, against the least energy of its springs.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{
    Configuration, LegAngles, LegId, ModelError, Posture, Robot, leg_compliance, vertical_stiffness,
};

use crate::{load, load_with};

const JOINTS: [f64; 6] = [5700.0, 5700.0, 2750.0, 2450.0, 1850.0, 1850.0];
const TIRE: f64 = 150_000.0;

/// Where a point fixed in the last link is with the leg at these angles.
fn moved(
    robot: &Robot,
    at: &Configuration,
    leg: LegId,
    q: &LegAngles,
    point: &Point3<f64>,
) -> Point3<f64> {
    let model = robot.leg(leg);
    let link = model.links[model.n_joints() - 1];
    let here = *Posture::new(robot, at).link(link);
    let there = *Posture::new(robot, &at.with_leg(leg, *q)).link(link);
    there * here.inverse_transform_point(point)
}

/// How far the point goes per newton `along`, by Newton's method on the energy of the springs with a
/// force so small that the geometry does not change; gradients are finite differences of it.
fn give(
    robot: &Robot,
    at: &Configuration,
    leg: LegId,
    point: &Point3<f64>,
    along: &Vector3<f64>,
) -> Vector3<f64> {
    let q = at.legs[leg.0];
    let h = 1e-5;
    let work = LegAngles::from_fn(|i, _| {
        let turn = LegAngles::ith(i, h);
        let ends = [q + turn, q - turn].map(|q| moved(robot, at, leg, &q, point));
        (ends[0] - ends[1]).dot(along) / (2.0 * h)
    });
    let force = 1e-3;
    let turned = q + LegAngles::from_fn(|i, _| force * work[i] / JOINTS[i]);
    (moved(robot, at, leg, &turned, point) - point) / force + along / TIRE
}

#[test]
fn a_leg_gives_way_as_the_energy_of_its_springs_says() {
    let robot = load("athlete");
    let mut rng = ChaCha8Rng::seed_from_u64(91);
    for _ in 0..200 {
        let leg = LegId(rng.random_range(0..6));
        let mut at = robot.pose("bent").unwrap();
        let mut side = || rng.random_range(-1.0..1.0);
        let turn = UnitQuaternion::from_euler_angles(0.3 * side(), 0.3 * side(), 3.0 * side());
        at.world_from_base =
            Isometry3::from_parts(Vector3::new(side(), side(), side()).into(), turn);
        at.legs[leg.0] += LegAngles::from_fn(|_, _| 0.8 * side());
        let contact = Posture::new(&robot, &at).wheel(&robot, leg).lowest_point(&Vector3::z_axis());
        let posture = Posture::new(&robot, &at);
        let compliance = leg_compliance(&robot, &posture, leg, &contact).unwrap();
        for along in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let (found, expected) = (compliance * along, give(&robot, &at, leg, &contact, &along));
            assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");
        }
        // A stiffness exists, and is the same whichever way round the work is counted.
        assert!((compliance - compliance.transpose()).amax() < 1e-15);
        assert!(compliance.cholesky().is_some());
        let vertical = vertical_stiffness(&robot, &posture, leg, &contact);
        assert!((vertical * compliance[(2, 2)] - 1.0).abs() < 1e-12);
        assert!(vertical < TIRE);
    }
}

#[test]
fn in_the_bent_pose_a_sixth_of_the_weight_on_earth_deflects_a_leg_by_a_tenth_of_a_meter() {
    let robot = load("athlete");
    let sixth = robot.mass() * 9.80665 / 6.0;
    let deflection = sixth / robot.stance().leg_stiffness;
    assert!((deflection - 0.10).abs() < 5e-4, "{deflection} m (F83)");
    // By hand, lever arms of a planar leg: hip 0.735 cos 3° - 0.489 cos 68°, knee without the thigh.
    let (knee, hip) = (0.489 * 68_f64.to_radians().cos(), 0.735 * 3_f64.to_radians().cos());
    let give = (hip - knee).powi(2) / JOINTS[1] + knee.powi(2) / JOINTS[2] + 1.0 / TIRE;
    assert!((robot.stance().leg_stiffness * give - 1.0).abs() < 1e-3);
}

#[test]
fn a_larger_robot_sinks_by_the_same_share_of_its_legs() {
    let robot = load("athlete");
    let large = robot.scaled(2.0).unwrap();
    let give = |robot: &Robot| {
        let posture = Posture::new(robot, &robot.pose("standing").unwrap());
        let contact = posture.wheel(robot, LegId(3)).lowest_point(&Vector3::z_axis());
        leg_compliance(robot, &posture, LegId(3), &contact).unwrap()
    };
    assert!((give(&large) - give(&robot) * 2.0).amax() < 1e-15);
    assert!(
        (large.stance().leg_stiffness * 2.0 / robot.stance().leg_stiffness - 1.0).abs() < 1e-12
    );
}

#[test]
fn one_figure_for_a_whole_leg_takes_the_place_of_its_springs() {
    let one =
        |text: String| text.replace("[compliance]", "leg_stiffness_n_m = 20000.0\n[compliance]");
    let robot = load_with("athlete", one).unwrap();
    let posture = Posture::new(&robot, &robot.pose("standing").unwrap());
    let contact = Point3::origin();
    assert_eq!(leg_compliance(&robot, &posture, LegId(0), &contact), None);
    assert_eq!(vertical_stiffness(&robot, &posture, LegId(0), &contact), 20_000.0);
    // Without either, as before: 4.4 % of the reach under the leg's part of the weight on Earth.
    let hexapod = load("hexapod");
    assert_eq!(hexapod.compliance().springs, None);
    assert_eq!(hexapod.compliance().stiffness_error, 0.2);
}

#[test]
fn springs_that_cannot_be_are_named() {
    let with = |from: &'static str, to: &'static str| {
        load_with("athlete", move |text| text.replace(from, to)).unwrap_err()
    };
    let short = with("[5700.0, 5700.0, 2750.0, 2450.0, 1850.0, 1850.0]", "[5700.0]");
    assert!(matches!(short, ModelError::JointStiffness { n_joints: 1, wanted: 6, .. }), "{short}");
    let soft = with("[5700.0,", "[0.0,");
    let field = "compliance.joint_stiffness_nm_rad";
    assert!(matches!(soft, ModelError::NotPositive { field: f, .. } if f == field), "{soft}");
    let hard = with("tire_stiffness_n_m = 150000.0", "tire_stiffness_n_m = inf");
    assert!(matches!(hard, ModelError::NotPositive { .. }), "{hard}");
    let alone =
        with("joint_stiffness_nm_rad = [5700.0, 5700.0, 2750.0, 2450.0, 1850.0, 1850.0]", "");
    assert!(matches!(alone, ModelError::TireAlone), "{alone}");
    for value in ["1.0", "-0.1", "nan"] {
        let text = format!("stiffness_error = {value}");
        let result = load_with("athlete", |t| t.replace("stiffness_error = 0.2", &text));
        assert!(matches!(result, Err(ModelError::StiffnessError { .. })), "{value}");
    }
    let sunk = with("[compliance]", "[compliance]\ntouchdown_error_m = -0.01");
    assert!(matches!(sunk, ModelError::Negative { .. }), "{sunk}");
}
