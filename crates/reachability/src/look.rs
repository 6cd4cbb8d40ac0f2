//! What all cells of a leg share.

use collision::{Scene, Survey, Touch, ground_normal, survey};
use geometry::Grid;
use nalgebra::{Isometry3, Point2, Point3, Translation3};
use rover::{Configuration, LegAngles, LegFrames, LegId, LinkId, Posture, Robot};

use stability::Contact;

use crate::answer::ReachOptions;
use crate::stance::Stance;

/// Most cells of one answer.
const MAX_CELLS: usize = 1_000_000;

/// One leg of a robot that stands.
pub(crate) struct Look<'a> {
    pub scene: &'a Scene,
    pub robot: &'a Robot,
    pub leg: LegId,
    pub options: &'a ReachOptions<'a>,
    pub posture: Posture,
    /// Where the leg's joints are now.
    pub angles: LegAngles,
    /// The other legs that stand, with their contacts.
    pub standing: Vec<(LegId, Contact)>,
    pub stance: Stance<'a>,
    /// Does the leg itself stand, and can it be lifted from there?
    pub stands: bool,
    pub can_lift_off: bool,
    /// Origin of the leg's first link (m).
    pub hip: Point3<f64>,
    /// Greatest distance of the wheel's center from there (m).
    pub reach: f64,
    last_link: LinkId,
    wheel_link: LinkId,
}

impl<'a> Look<'a> {
    /// Prepares `leg`; `seen` is the survey of the posture.
    pub fn new(
        scene: &'a Scene,
        configuration: &Configuration,
        seen: &Survey,
        gravity: f64,
        leg: LegId,
        options: &'a ReachOptions<'a>,
    ) -> Look<'a> {
        let robot: &Robot = scene.robot();
        let posture = Posture::new(robot, configuration);
        let others = seen.contacts(scene, &posture).into_iter().filter(|(other, _)| *other != leg);
        let on_ground = |(other, position): (LegId, Point3<f64>)| {
            let normal = ground_normal(scene, other, &position);
            (other, Contact { position, normal, friction: options.friction })
        };
        let standing: Vec<(LegId, Contact)> = others.map(on_ground).collect();
        let stance = Stance::new(robot, &posture, leg, &standing, gravity, options.preference);
        let model = robot.leg(leg);
        let hip = posture.link(model.links[0]).translation.vector.into();
        let mut look = Look {
            scene,
            robot,
            leg,
            options,
            angles: configuration.legs[leg.0],
            standing,
            stance,
            stands: seen.standing.contains(&leg),
            can_lift_off: true,
            hip,
            reach: model.ik.reach(),
            last_link: model.links[model.n_joints() - 1],
            wheel_link: model.wheel_link,
            posture,
        };
        if look.stands {
            let wheel = look.posture.wheel(robot, leg).world_from_wheel;
            look.can_lift_off = look.raises(&wheel);
        }
        look
    }

    /// True if the leg can bring a wheel straight up by the lift.
    fn raises(&self, wheel: &Isometry3<f64>) -> bool {
        let above = Translation3::new(0.0, 0.0, self.options.lift) * wheel;
        let solutions = self.posture.inverse_kinematics(self.robot, self.leg, &above);
        solutions.is_ok_and(|all| all.iter().any(|s| s.within_limits))
    }

    /// The cells: all within the square about the circle of the leg's reach. `None` if there would be
    /// too many, or their distance is not a positive number.
    pub fn grid(&self) -> Option<Grid> {
        let resolution = self.options.resolution;
        let reach = self.reach + self.robot.leg(self.leg).wheel.radius;
        let hip = self.hip;
        if !(resolution.is_finite() && resolution > 0.0 && hip.iter().all(|v| v.is_finite())) {
            return None;
        }
        let low = |v: f64| ((v - reach) / resolution).floor();
        let high = |v: f64| ((v + reach) / resolution).ceil();
        let n = |v: f64| high(v) - low(v) + 1.0;
        if n(hip.x) * n(hip.y) > MAX_CELLS as f64 {
            return None;
        }
        let origin = Point2::new(low(hip.x) * resolution, low(hip.y) * resolution);
        Some(Grid { origin, resolution, nx: n(hip.x) as usize, ny: n(hip.y) as usize })
    }

    /// True if a wheel that was seated stands just as it was: the leg can give it any orientation.
    pub fn is_seated(&self) -> bool {
        self.robot.leg(self.leg).ik.fixes_orientation()
    }

    /// The wheel's center in a posture of the leg.
    pub fn wheel_center(&self, frames: &LegFrames) -> Point3<f64> {
        let wheel = &self.robot.leg(self.leg).wheel;
        frames.links[5].point(&wheel.carrier_from_wheel.translation.vector.into())
    }

    /// True if what touches is the wheel or its fork, and what it touches does not move with the
    /// leg: then the pose of the wheel alone decides.
    pub fn is_of_the_wheel(&self, touch: Touch) -> bool {
        if !self.robot.leg(self.leg).ik.fixes_orientation() {
            return false;
        }
        let of_the_wheel = |link| link == self.last_link || link == self.wheel_link;
        match touch {
            Touch::Ground(a) | Touch::Obstacle(a, _) | Touch::UnknownGround(a) => of_the_wheel(a),
            Touch::Links(a, b) => {
                let elsewhere =
                    |link| self.robot.body_of(link).is_none_or(|(of, _)| of != self.leg);
                (of_the_wheel(a) && elsewhere(b)) || (of_the_wheel(b) && elsewhere(a))
            }
        }
    }
}

/// The survey of the robot as in `configuration`.
pub(crate) fn seen(scene: &Scene, configuration: &Configuration) -> Survey {
    survey(scene, &Posture::new(scene.robot(), configuration))
}
