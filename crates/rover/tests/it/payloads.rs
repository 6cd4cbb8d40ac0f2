//! Payloads and tools: what they change, and what they may not.

use nalgebra::{Isometry3, Point3, Vector3};
use rover::{JointRange, LinkShape, ModelError, Payload, Posture, Shape};

use crate::athlete;

fn range(joint: &str, lower: f64, upper: f64) -> JointRange {
    JointRange { joint: joint.into(), lower, upper }
}

/// A drill on leg 1's last link, for which the hip must not turn far.
fn drill() -> Payload {
    Payload {
        link: "leg1_ankle_roll_link".into(),
        mass: 20.0,
        com: Point3::new(0.3, 0.3, 0.0),
        shapes: vec![
            LinkShape {
                link_from_shape: Isometry3::translation(0.3, 0.3, 0.0),
                shape: Shape::Cylinder { radius: 0.05, half_length: 0.2 },
            },
            LinkShape {
                link_from_shape: Isometry3::translation(0.3, 0.3, 0.2),
                shape: Shape::Sphere { radius: 0.06 },
            },
        ],
        limits: vec![range("leg1_hip_yaw", -0.5, 0.5)],
    }
}

#[test]
fn a_tool_changes_mass_shapes_limits_and_the_version_stamp() {
    let robot = athlete();
    let armed = robot.with_payloads(&[drill()]).unwrap();
    assert!((armed.mass() - robot.mass() - 20.0).abs() < 1e-9);
    let shapes = |r: &rover::Robot| r.links().iter().map(|l| l.shapes.len()).sum::<usize>();
    assert_eq!(shapes(&armed), shapes(&robot) + 2);
    let (leg, joint) = (&armed.legs()[0], &armed.joints()[armed.legs()[0].joints[0]]);
    assert_eq!((leg.lower[0], leg.upper[0], joint.lower, joint.upper), (-0.5, 0.5, -0.5, 0.5));
    assert_eq!(armed.legs()[1].lower, robot.legs()[1].lower);
    let pose = robot.pose("bent").unwrap();
    let com = |r: &rover::Robot| Posture::new(r, &pose).center_of_mass(r);
    let link = robot.link_id("leg1_ankle_roll_link").unwrap();
    let at = Posture::new(&robot, &pose).link(link) * Point3::new(0.3, 0.3, 0.0);
    let expected = (com(&robot).coords * 850.0 + at.coords * 20.0) / 870.0;
    assert!((com(&armed).coords - expected).norm() < 1e-9);
    // Each part of it is part of the stamp.
    let mut stamps = vec![robot.hash(), armed.hash()];
    let changes: [fn(&mut Payload); 5] = [
        |p| p.mass = 21.0,
        |p| p.com.x = 0.31,
        |p| p.shapes[1].shape = Shape::Sphere { radius: 0.07 },
        |p| p.shapes[0].link_from_shape = Isometry3::rotation(Vector3::x()),
        |p| p.limits[0].upper = 0.4,
    ];
    for change in changes {
        let mut payload = drill();
        change(&mut payload);
        stamps.push(robot.with_payloads(&[payload]).unwrap().hash());
    }
    let n = stamps.len();
    stamps.sort_unstable();
    stamps.dedup();
    assert_eq!(stamps.len(), n);
}

#[test]
fn ranges_that_widen_or_contradict_are_refused() {
    let robot = athlete();
    let with = |limits: Vec<JointRange>| robot.with_payloads(&[Payload { limits, ..drill() }]);
    for (lower, upper) in [(-3.0, 0.5), (-0.5, 3.0), (0.5, -0.5), (f64::NAN, 0.5), (-0.5, f64::NAN)]
    {
        let error = with(vec![range("leg1_hip_yaw", lower, upper)]).unwrap_err();
        assert!(matches!(error, ModelError::PayloadLimits { .. }), "{lower} {upper}");
    }
    // What one payload has cut another cannot give back.
    let cut = vec![range("leg1_hip_yaw", -0.5, 0.5), range("leg1_hip_yaw", -0.6, 0.5)];
    assert!(matches!(with(cut), Err(ModelError::PayloadLimits { .. })));
    for nobody in ["leg1_wheel", "nobody"] {
        let error = with(vec![range(nobody, 0.0, 0.1)]).unwrap_err();
        assert_eq!(error, ModelError::PayloadJoint { joint: nobody.into() });
    }
    assert!(with(vec![range("leg1_hip_yaw", 0.0, 0.0)]).is_ok());
}

#[test]
fn shapes_without_size_are_refused() {
    let robot = athlete();
    for shape in [
        Shape::Sphere { radius: 0.0 },
        Shape::Sphere { radius: f64::NAN },
        Shape::Cylinder { radius: 0.1, half_length: -1.0 },
        Shape::Box { half_extents: Vector3::new(1.0, f64::INFINITY, 1.0) },
    ] {
        let link_from_shape = Isometry3::identity();
        let payload = Payload { shapes: vec![LinkShape { link_from_shape, shape }], ..drill() };
        assert_eq!(robot.with_payloads(&[payload]), Err(ModelError::PayloadShape));
    }
}
