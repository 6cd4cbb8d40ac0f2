//! Driving along an arc in plan: where the base is, and which way each wheel goes (F7).
//!
//! A rigid body that turns by `turn` while its origin goes `distance` along an arc turns about one
//! fixed center, at the radius `distance / turn` to the left of its course. Every wheel goes about
//! the same center: it heads across the line to it, as fast as it is far (Ackermann). Lengths in
//! meters, angles in radians, in the heading frame: the base's origin in plan, x where the base's x
//! points in plan.

use nalgebra::{Isometry3, Point2, UnitQuaternion, Vector2, Vector3};

use crate::command::DriveArc;

/// Turns below this (rad) are series, not quotients: both agree to rounding here.
const SMALL: f64 = 1e-4;

impl DriveArc {
    /// The center of the arc; none for a straight line.
    pub(crate) fn center(&self) -> Option<Point2<f64>> {
        let radius = self.distance / self.turn;
        let left = Vector2::new(-self.course.sin(), self.course.cos());
        radius.is_finite().then(|| Point2::from(left * radius))
    }

    /// The heading frame after a share of the arc, in the one it began in.
    pub(crate) fn pose_at(&self, share: f64) -> Isometry3<f64> {
        let angle = self.turn * share;
        let (along, across) = if angle.abs() < SMALL {
            (1.0 - angle * angle / 6.0, 0.5 * angle)
        } else {
            (angle.sin() / angle, (1.0 - angle.cos()) / angle)
        };
        let way = self.distance * share;
        let (sin, cos) = self.course.sin_cos();
        let moved = Vector3::new(along * cos - across * sin, along * sin + across * cos, 0.0) * way;
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Isometry3::from_parts(moved.into(), turned)
    }

    /// The way of a point of the body at the beginning, per unit of share: direction and length.
    pub(crate) fn way_of(&self, point: Point2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.course.sin_cos();
        Vector2::new(
            self.distance * cos - self.turn * point.y,
            self.distance * sin + self.turn * point.x,
        )
    }
}

/// A way from rest to rest at bounded speed and acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ramped {
    length: f64,
    speed: f64,
    acceleration: f64,
}

impl Ramped {
    /// A way of this length, at most so fast.
    pub fn new(length: f64, speed: f64, acceleration: f64) -> Ramped {
        Ramped { length, speed: speed.min((length * acceleration).sqrt()), acceleration }
    }

    /// One over the length (1/m).
    pub fn length_inverse(&self) -> f64 {
        if self.length > 0.0 { 1.0 / self.length } else { 0.0 }
    }

    /// How long it takes (s).
    pub fn duration(&self) -> f64 {
        if self.length <= 0.0 {
            return 0.0;
        }
        self.length / self.speed + self.speed / self.acceleration
    }

    /// Share of the way passed after `t` (s).
    pub fn share_at(&self, t: f64) -> f64 {
        let duration = self.duration();
        if t >= duration {
            return 1.0;
        }
        let ramp = self.speed / self.acceleration;
        let passed = |t: f64| 0.5 * self.acceleration * t * t;
        let way = if t < ramp {
            passed(t.max(0.0))
        } else if t > duration - ramp {
            self.length - passed(duration - t)
        } else {
            self.speed * (t - 0.5 * ramp)
        };
        (way / self.length).clamp(0.0, 1.0)
    }

    /// Speed after `t` (s), in lengths per second.
    pub fn speed_at(&self, t: f64) -> f64 {
        let left = self.duration() - t;
        (self.acceleration * t.min(left)).clamp(0.0, self.speed)
    }
}
