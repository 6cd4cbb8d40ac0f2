//! What is executed between two knots of a shift: joints linear, the chassis where the wheels put it.
//!
//! Frame `world`, meters, radians.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use rover::{Anchor, BodyMotion, Configuration, LegAngles, LegId, Posture, Robot};

/// Interior points of a piece at which the wheels are looked at.
const CLOSURE_SAMPLES: usize = 8;

/// The executed motion between two knots: linear in the joints, the chassis where the standing
/// wheels put it.
pub struct Executed<'a> {
    robot: &'a Robot,
    a: &'a Configuration,
    b: &'a Configuration,
    /// Ends of each wheel's axle, and the direction of its fork, at both knots.
    wheels: Vec<(LegId, [WheelMark; 2])>,
    way: Vec<LegAngles>,
    anchors: Vec<Anchor>,
}

#[derive(Clone, Copy)]
struct WheelMark {
    ends: [Point3<f64>; 2],
    fork: Vector3<f64>,
}

impl WheelMark {
    fn new(robot: &Robot, posture: &Posture, leg: LegId) -> WheelMark {
        let wheel = posture.wheel(robot, leg);
        let half = wheel.axle().into_inner() * (0.5 * wheel.width);
        let fork = wheel.world_from_wheel.rotation * Vector3::x();
        WheelMark { ends: [wheel.center() + half, wheel.center() - half], fork }
    }
}

impl<'a> Executed<'a> {
    /// The motion from `a` to `b` on the wheels of `standing`.
    pub fn new(
        robot: &'a Robot,
        a: &'a Configuration,
        b: &'a Configuration,
        standing: &[LegId],
    ) -> Executed<'a> {
        let ends = [Posture::new(robot, a), Posture::new(robot, b)];
        let mark = |leg: LegId| (leg, [0, 1].map(|end| WheelMark::new(robot, &ends[end], leg)));
        let wheels: Vec<(LegId, [WheelMark; 2])> = standing.iter().map(|leg| mark(*leg)).collect();
        let anchor = |&(leg, [from, to]): &(LegId, [WheelMark; 2])| {
            let wheel = &robot.leg(leg).wheel;
            [(0, 0.5), (1, -0.5)].map(|(end, side)| Anchor {
                leg,
                in_link: wheel.carrier_from_wheel * Point3::new(0.0, side * wheel.width, 0.0),
                places: [from.ends[end], to.ends[end]],
            })
        };
        Executed {
            robot,
            a,
            b,
            way: a.legs.iter().zip(&b.legs).map(|(a, b)| b - a).collect(),
            anchors: wheels.iter().flat_map(anchor).collect(),
            wheels,
        }
    }

    /// The configuration at `t` from 0 to 1, and how far the wheels are off their places (m): the
    /// ends of the axles, and the tread where the fork turns about them otherwise than evenly.
    pub fn at(&self, t: f64) -> (Configuration, f64) {
        let legs: Vec<LegAngles> =
            self.a.legs.iter().zip(&self.b.legs).map(|(a, b)| a.lerp(b, t)).collect();
        let base = between(&self.a.world_from_base, &self.b.world_from_base, t);
        let mut configuration = Configuration { world_from_base: base, legs };
        let posture = Posture::new(self.robot, &configuration);
        let marks: Vec<WheelMark> =
            self.wheels.iter().map(|(leg, _)| WheelMark::new(self.robot, &posture, *leg)).collect();
        let places: Vec<Point3<f64>> = self
            .wheels
            .iter()
            .flat_map(|(_, [a, b])| [0, 1].map(|end| lerp(&a.ends[end], &b.ends[end], t)))
            .collect();
        let points: Vec<Point3<f64>> = marks.iter().flat_map(|mark| mark.ends).collect();
        let correction = rigid_fit(&points, &places);
        configuration.world_from_base = correction * base;
        let misses = points.iter().zip(&places).map(|(p, place)| (correction * p - place).norm());
        let treads = self.wheels.iter().zip(&marks).map(|((leg, [a, b]), mark)| {
            // The fork's turn about the axle rolls the tread by the radius times the angle.
            let even = a.fork.lerp(&b.fork, t);
            let now = correction * mark.fork;
            now.cross(&even.normalize()).norm() * self.robot.leg(*leg).wheel.radius
        });
        (configuration, misses.chain(treads).fold(0.0, f64::max))
    }

    /// The largest of the wheels' deviations (m), sampled.
    pub(crate) fn largest_deviation(&self) -> f64 {
        let n = CLOSURE_SAMPLES;
        (1..n).map(|i| self.at(i as f64 / n as f64).1).fold(0.0, f64::max)
    }
}

impl BodyMotion for Executed<'_> {
    fn at(&self, share: f64) -> Configuration {
        Executed::at(self, share).0
    }

    fn way(&self) -> &[LegAngles] {
        &self.way
    }

    fn anchors(&self) -> &[Anchor] {
        &self.anchors
    }
}

fn lerp(a: &Point3<f64>, b: &Point3<f64>, t: f64) -> Point3<f64> {
    Point3::from(a.coords.lerp(&b.coords, t))
}

/// The rigid motion that brings `points` nearest to `places` in the least squares, by Gauss and
/// Newton's iteration from the identity; what the points leave open (they lie on a line) stays.
fn rigid_fit(points: &[Point3<f64>], places: &[Point3<f64>]) -> Isometry3<f64> {
    let mut motion = Isometry3::identity();
    if points.is_empty() {
        return motion;
    }
    let n = points.len() as f64;
    for _ in 0..8 {
        let moved: Vec<Point3<f64>> = points.iter().map(|p| motion * p).collect();
        let middle = moved.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
        let mut shift = Vector3::zeros();
        let mut moment = Vector3::zeros();
        let mut inertia = Matrix3::zeros();
        for (p, place) in moved.iter().zip(places) {
            let (arm, miss) = (p.coords - middle, place - p);
            shift += miss / n;
            moment += arm.cross(&miss);
            inertia += Matrix3::identity() * arm.norm_squared() - arm * arm.transpose();
        }
        let damped = inertia + Matrix3::identity() * (1e-9 * inertia.trace() + 1e-12);
        let turn = damped.cholesky().map_or_else(Vector3::zeros, |factor| factor.solve(&moment));
        let rotation = UnitQuaternion::from_scaled_axis(turn);
        let place = middle + shift - rotation * middle;
        motion = Isometry3::from_parts(place.into(), rotation) * motion;
        if shift.norm() < 1e-13 && turn.norm() < 1e-13 {
            break;
        }
    }
    motion
}

/// The executed motion between two knots at `t` from 0 to 1: the joints linear, the chassis where
/// the wheels of `standing` put it.
///
/// Planted wheels close the chain only at the knots. In between the chassis takes the pose that
/// brings the ends of the standing wheels' axles nearest to their places in the least squares;
/// their places are those at `a`, going over evenly to those at `b` should these differ. Without
/// standing wheels the chassis goes evenly.
pub fn base_between(
    robot: &Robot,
    a: &Configuration,
    b: &Configuration,
    standing: &[LegId],
    t: f64,
) -> Configuration {
    Executed::new(robot, a, b, standing).at(t).0
}

/// The largest distance (m) by which standing wheels leave their places between two knots, sampled
/// at eighths: of the ends of the axles, and of the tread by a turn about the axle.
pub fn closure_error(
    robot: &Robot,
    a: &Configuration,
    b: &Configuration,
    standing: &[LegId],
) -> f64 {
    Executed::new(robot, a, b, standing).largest_deviation()
}

/// Evenly in place and turn.
pub(super) fn between(a: &Isometry3<f64>, b: &Isometry3<f64>, t: f64) -> Isometry3<f64> {
    let place = a.translation.vector.lerp(&b.translation.vector, t);
    let turn = a.rotation.rotation_to(&b.rotation);
    let part = UnitQuaternion::from_scaled_axis(turn.scaled_axis() * t);
    Isometry3::from_parts(Translation3::from(place), part * a.rotation)
}
