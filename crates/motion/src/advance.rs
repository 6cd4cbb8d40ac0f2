//! How far a leg may go before any of its points has gone a given way: what the final check goes by.
//!
//! Apart from the bound that the search certifies with ([`rover::LegFrames::motion_bound`]) on purpose:
//! that one adds up what each joint can do, this one takes the velocities of the balls about the shapes
//! where the leg is, and bounds how much they can change.

use nalgebra::{Point3, Vector3};
use rover::{JointKind, LegAngles, LegId, LinkId, Posture, Robot};

/// A leg as balls on its links.
pub(crate) struct Advance {
    joints: Vec<Joint>,
    balls: Vec<Ball>,
}

struct Joint {
    link: LinkId,
    axis: Vector3<f64>,
    slides: bool,
}

/// Holds one shape of the leg.
struct Ball {
    link: LinkId,
    /// The joint that carries its link.
    place: usize,
    center: Point3<f64>,
    radius: f64,
}

impl Advance {
    pub fn new(robot: &Robot, leg: LegId) -> Advance {
        let model = robot.leg(leg);
        let joints = model.joints.iter().map(|index| {
            let joint = &robot.joints()[*index];
            let (axis, slides) = (joint.axis.into_inner(), joint.kind == JointKind::Prismatic);
            Joint { link: joint.child, axis, slides }
        });
        let mut balls = Vec::new();
        for (index, link) in robot.links().iter().enumerate() {
            let Some((_, place)) = robot.body_of(LinkId(index)).filter(|body| body.0 == leg) else {
                continue;
            };
            balls.extend(link.shapes.iter().map(|shape| Ball {
                link: LinkId(index),
                place,
                center: Point3::from(shape.link_from_shape.translation.vector),
                radius: shape.shape.bounding_radius(),
            }));
        }
        let wheel = &model.wheel;
        balls.push(Ball {
            link: model.links[model.n_joints() - 1],
            place: model.n_joints() - 1,
            center: Point3::from(wheel.carrier_from_wheel.translation.vector),
            radius: wheel.radius.hypot(wheel.width),
        });
        Advance { joints: joints.collect(), balls }
    }

    /// How far any point of the leg gets per share of the joint-linear motion by `way` from `posture`
    /// on (m), for shares up to `most`: never too little.
    ///
    /// That is its speed at `posture` and half of `most` times what it accelerates by at most.
    pub fn speed(&self, posture: &Posture, way: &LegAngles, most: f64) -> f64 {
        let mut fastest = 0.0_f64;
        let mut reaches = LegAngles::zeros();
        for ball in &self.balls {
            let center = posture.link(ball.link) * ball.center;
            let (mut velocity, mut turning) = (Vector3::zeros(), Vector3::zeros());
            for (place, joint) in self.joints.iter().enumerate().take(ball.place + 1) {
                let here = posture.link(joint.link);
                let rate = here.rotation * joint.axis * way[place];
                if joint.slides {
                    velocity += rate;
                    continue;
                }
                let arm = center.coords - here.translation.vector;
                velocity += rate.cross(&arm);
                turning += rate;
                reaches[place] = reaches[place].max(arm.norm() + ball.radius);
            }
            fastest = fastest.max(velocity.norm() + turning.norm() * ball.radius);
        }
        fastest + 0.5 * most * self.acceleration(&reaches, way, most)
    }

    /// Most that any point accelerates by, per square of the share, for shares up to `most`.
    ///
    /// Two joints that move together accelerate a point by the product of their turns times its
    /// distance from the outer one, which the joints beyond that one may have made greater: all
    /// these by no more than their turns times their distances, each grown by no more than the
    /// exponential of all turns.
    fn acceleration(&self, reaches: &LegAngles, way: &LegAngles, most: f64) -> f64 {
        let turns = |place: usize| if self.joints[place].slides { 0.0 } else { way[place].abs() };
        let all: f64 = (0..self.joints.len()).map(turns).sum();
        let growth = most * (most * all).exp();
        let (mut beyond, mut inward, mut acceleration) = (0.0, all, 0.0);
        for place in (0..self.joints.len()).rev() {
            let turn = turns(place);
            inward -= turn;
            let speed = if self.joints[place].slides {
                way[place].abs()
            } else {
                turn * (reaches[place] + growth * beyond)
            };
            acceleration += speed * (turn + 2.0 * inward);
            beyond += if self.joints[place].slides { speed } else { turn * reaches[place] };
        }
        acceleration
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rover::Configuration;

    use super::*;

    /// Robots with joints that turn, and one with joints that slide.
    fn robots() -> [Robot; 2] {
        ["athlete", "slider"].map(|name| {
            let text = |file: &str| testkit::fixture_text(&format!("robots/{name}/{file}"));
            Robot::from_folder(
                &text("robot.toml"),
                |file| Some(text(file)),
                |mesh| Some(text(mesh).into_bytes()),
            )
            .unwrap()
        })
    }

    /// Independent: points of the shapes' surroundings by forward kinematics.
    #[test]
    fn no_point_of_a_leg_gets_farther_than_its_speed_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for robot in robots() {
            let leg = LegId(0);
            let model = robot.leg(leg).clone();
            let advance = Advance::new(&robot, leg);
            let pose = robot.pose(&robot.poses()[0].0).unwrap();
            let mut tightest = 0.0_f64;
            for _ in 0..4_000 {
                let any = LegAngles::from_fn(|i, _| match i < model.n_joints() {
                    true => rng.random_range(model.lower[i]..=model.upper[i]),
                    false => 0.0,
                });
                let at = |angles: LegAngles| -> Posture {
                    let configuration: Configuration = pose.with_leg(leg, angles);
                    Posture::new(&robot, &configuration)
                };
                let one = rng.random_range(0..model.n_joints());
                let only = rng.random_bool(0.5);
                let way = LegAngles::from_fn(|i, _| match (only && i != one) || any[i] == 0.0 {
                    true => 0.0,
                    false => rng.random_range(-1.0..=1.0),
                });
                let share = rng.random_range(0.0..0.2);
                let (from, to) = (at(any), at(any + way * share));
                let bound = share * advance.speed(&from, &way, share);
                for (index, link) in robot.links().iter().enumerate() {
                    let id = LinkId(index);
                    if robot.body_of(id).is_none_or(|body| body.0 != leg) {
                        continue;
                    }
                    for shape in &link.shapes {
                        let off = Vector3::from_fn(|_, _| rng.random_range(-1.0..=1.0));
                        let p = shape.link_from_shape
                            * Point3::from(off.normalize() * shape.shape.bounding_radius());
                        let gone = (to.link(id) * p - from.link(id) * p).norm();
                        assert!(gone <= bound + 1e-12, "{gone} m of {bound} m");
                        tightest = tightest.max(if bound > 1e-9 { gone / bound } else { 0.0 });
                    }
                }
            }
            assert!(tightest > 0.7, "{}: {tightest} of the bound at most", robot.name());
        }
    }
}
