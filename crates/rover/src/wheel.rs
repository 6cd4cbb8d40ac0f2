//! Wheels and ball feet: where they touch.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};

/// Tilt of the axle against the ground below which the whole width of the wheel touches; beyond
/// it the contact is on the tyre's edge.
const LEVEL_AXLE: f64 = 1e-6;

/// A wheel: a cylinder about its axle, which is y of the link that carries it. Or a ball foot: a
/// ball about the same center, which touches one radius below it whatever its orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wheel {
    /// Radius (m).
    pub radius: f64,
    /// Width along the axle (m); the diameter of a ball foot.
    pub width: f64,
    /// True for a ball foot.
    pub ball: bool,
    /// Wheel center and axle direction (y) in the frame of the carrying link; the wheel's spin is
    /// left out, for a wheel that walks is braked.
    pub carrier_from_wheel: Isometry3<f64>,
}

/// A wheel somewhere in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelPose {
    /// Center and orientation (y is the axle, x the fork's direction) in `world`.
    pub world_from_wheel: Isometry3<f64>,
    /// Radius (m).
    pub radius: f64,
    /// Width (m); the diameter of a ball foot.
    pub width: f64,
    /// True for a ball foot.
    pub ball: bool,
}

impl WheelPose {
    /// Center (m).
    pub fn center(&self) -> Point3<f64> {
        self.world_from_wheel.translation.vector.into()
    }

    /// Direction of the axle.
    pub fn axle(&self) -> Unit<Vector3<f64>> {
        self.world_from_wheel.rotation * Vector3::y_axis()
    }

    /// The wheel's point that lies deepest against `normal`: where it touches a plane with that
    /// normal. With a level axle the middle of the line of contact, else on the tyre's edge.
    pub fn lowest_point(&self, normal: &Unit<Vector3<f64>>) -> Point3<f64> {
        if self.ball {
            return self.center() - normal.into_inner() * self.radius;
        }
        let axle = self.axle();
        let along = normal.dot(&axle);
        let radial = normal.into_inner() - axle.into_inner() * along;
        let mut point = self.center();
        if radial.norm() > LEVEL_AXLE {
            point -= radial.normalize() * self.radius;
        }
        if along.abs() > LEVEL_AXLE {
            point -= axle.into_inner() * (along.signum() * 0.5 * self.width);
        }
        point
    }

    /// Tilt of the axle out of the plane with this normal (rad), 0 to π/2; a ball foot has none.
    pub fn camber(&self, normal: &Unit<Vector3<f64>>) -> f64 {
        if self.ball {
            return 0.0;
        }
        self.axle().dot(normal).abs().clamp(0.0, 1.0).asin()
    }

    /// The wheel that stands on a plane at `ground` with this `normal`: axle in the plane, turned
    /// by `yaw` (rad) about the normal from the projection of `heading`, fork leaning by
    /// `fork_pitch` (rad) about the axle, center one radius above the ground.
    ///
    /// `heading` is the wished direction of the axle; it must not be parallel to the normal, else
    /// `None`. Source: planning notes on footfalls: center = ground + radius · normal.
    pub fn standing(
        wheel: &Wheel,
        ground: Point3<f64>,
        normal: &Unit<Vector3<f64>>,
        heading: &Vector3<f64>,
        yaw: f64,
        fork_pitch: f64,
    ) -> Option<WheelPose> {
        let flat = heading - normal.into_inner() * normal.dot(heading);
        let axle = UnitQuaternion::from_axis_angle(normal, yaw) * Unit::try_new(flat, 1e-9)?;
        let fork = UnitQuaternion::from_axis_angle(&axle, fork_pitch) * -normal.into_inner();
        let z = fork.cross(&axle);
        let rotation =
            nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[
                fork,
                axle.into_inner(),
                z,
            ]));
        let center = ground + normal.into_inner() * wheel.radius;
        Some(WheelPose {
            world_from_wheel: Isometry3::from_parts(
                center.into(),
                UnitQuaternion::from_rotation_matrix(&rotation),
            ),
            radius: wheel.radius,
            width: wheel.width,
            ball: wheel.ball,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wheel() -> Wheel {
        Wheel { radius: 0.264, width: 0.24, ball: false, carrier_from_wheel: Isometry3::identity() }
    }

    #[test]
    fn a_standing_wheel_touches_where_it_was_put_whatever_yaw_and_fork() {
        let normal = Unit::new_normalize(Vector3::new(0.2, -0.1, 1.0));
        let ground = Point3::new(1.0, 2.0, 3.0);
        for (yaw, pitch) in [(0.0, 0.0), (0.7, 0.3), (-2.0, -0.5)] {
            let heading = Vector3::new(0.3, 1.0, 0.2);
            let pose =
                WheelPose::standing(&wheel(), ground, &normal, &heading, yaw, pitch).unwrap();
            assert!((pose.lowest_point(&normal) - ground).norm() < 1e-9);
            assert!(pose.camber(&normal) < 1e-9);
            let fork = pose.world_from_wheel.rotation * Vector3::x();
            assert!((fork.dot(&-normal.into_inner()) - f64::cos(pitch)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_ball_touches_one_radius_below_its_center_whatever_its_orientation() {
        let normal = Unit::new_normalize(Vector3::new(0.2, -0.1, 1.0));
        for turn in [0.0, 0.4, 2.0] {
            let world_from_wheel = Isometry3::rotation(Vector3::new(turn, 0.3, -turn));
            let pose = WheelPose { world_from_wheel, radius: 0.02, width: 0.04, ball: true };
            let lowest = pose.lowest_point(&normal);
            assert!((lowest.coords + normal.into_inner() * 0.02).norm() < 1e-15);
            assert_eq!(pose.camber(&normal), 0.0);
        }
    }

    #[test]
    fn a_cambered_wheel_touches_on_its_edge() {
        // Axle tilted by g: center height r cos g + (w/2) sin g.
        let g: f64 = 0.2;
        let pose = WheelPose {
            world_from_wheel: Isometry3::rotation(Vector3::x() * g),
            radius: 0.264,
            width: 0.24,
            ball: false,
        };
        let lowest = pose.lowest_point(&Vector3::z_axis());
        assert!((-lowest.z - (0.264 * g.cos() + 0.12 * g.sin())).abs() < 1e-12);
        assert!((pose.camber(&Vector3::z_axis()) - g).abs() < 1e-12);
    }
}
