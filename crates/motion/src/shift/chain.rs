//! The closed chain of a rover on planted wheels: joint angles for a pose of the chassis, and where
//! the chassis is while the joints move linearly.
//!
//! With closed-form leg kinematics a pose of the chassis gives the angles of every planted leg, so
//! the stance manifold (H22-H29) is parametrized by six numbers and needs no iteration. One branch
//! per leg is kept, that of the start. Frame `world`, meters, radians.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use rover::{Branch, Configuration, LegAngles, LegId, Posture, Robot};

/// Largest change of a joint between two samples of a way (rad): a larger one is a jump past a
/// singularity.
const JUMP: f64 = 0.35;

/// Length of the chassis' way between two samples (m at scale 1, and rad).
const SAMPLING: f64 = 0.02;

/// Fork pitches that a held wheel may take from its start, by size (rad): least and count.
const FORK_STEP: f64 = 0.05;
const FORK_STEPS: i32 = 12;

/// Share of the closure tolerance that the sampled deviation of a piece may take; the rest is for
/// what lies between samples.
const CLOSURE_SHARE: f64 = 0.9;

/// Interior points of a piece at which the wheels are looked at.
const CLOSURE_SAMPLES: usize = 8;

/// What keeps a leg from following the chassis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstruction {
    /// Its wrist would be out of reach.
    Reach {
        /// The leg.
        leg: LegId,
        /// How far (m).
        distance: f64,
    },
    /// A joint would leave its limits.
    Limit {
        /// The leg.
        leg: LegId,
        /// The joint, 0 to 5 from the hip outward.
        joint: usize,
        /// How far (rad).
        beyond: f64,
    },
    /// It would have to pass a straight knee, a straight wrist or the hip-yaw axis.
    Singular {
        /// The leg.
        leg: LegId,
    },
}

impl Obstruction {
    /// In words for people: legs counted from 1, degrees.
    pub fn text(&self, robot: &Robot) -> String {
        let name = |leg: LegId| robot.legs().get(leg.0).map_or("?", |leg| leg.name.as_str());
        match *self {
            Obstruction::Reach { leg, distance } => {
                format!("the planted wheel of {} is {distance:.2} m out of reach", name(leg))
            }
            Obstruction::Limit { leg, joint, beyond } => {
                let index = robot.leg(leg).joints[joint];
                let degrees = beyond.to_degrees();
                format!("{} would be {degrees:.1} deg beyond its limit", robot.joints()[index].name)
            }
            Obstruction::Singular { leg } => {
                format!("{} would have to pass a singular posture", name(leg))
            }
        }
    }
}

struct Planted {
    leg: LegId,
    world_from_wheel: Isometry3<f64>,
    branch: Option<Branch>,
}

/// The rover on its planted wheels.
pub(crate) struct ClosedChain<'a> {
    pub robot: &'a Robot,
    pub start: &'a Configuration,
    planted: Vec<Planted>,
    drive_hold: bool,
}

/// A pose of the chassis with the fork pitch of each planted leg, from the start's (rad).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChainPose {
    pub world_from_base: Isometry3<f64>,
    forks: Vec<f64>,
}

impl<'a> ClosedChain<'a> {
    pub fn new(
        robot: &'a Robot,
        start: &'a Configuration,
        legs: &[LegId],
        drive_hold: bool,
    ) -> ClosedChain<'a> {
        let posture = Posture::new(robot, start);
        let planted = legs
            .iter()
            .map(|&leg| {
                let world_from_wheel = posture.wheel(robot, leg).world_from_wheel;
                let near = |q: &LegAngles| (q - start.legs[leg.0]).amax();
                let branch = posture
                    .inverse_kinematics(robot, leg, &world_from_wheel)
                    .ok()
                    .and_then(|all| {
                        all.into_iter().min_by(|a, b| near(&a.angles).total_cmp(&near(&b.angles)))
                    })
                    .map(|solution| solution.branch);
                Planted { leg, world_from_wheel, branch }
            })
            .collect();
        ClosedChain { robot, start, planted, drive_hold }
    }

    pub fn legs(&self) -> Vec<LegId> {
        self.planted.iter().map(|planted| planted.leg).collect()
    }

    fn leg_angles(
        &self,
        planted: &Planted,
        base: &Isometry3<f64>,
        fork: f64,
    ) -> Result<LegAngles, Obstruction> {
        let leg = planted.leg;
        let model = self.robot.leg(leg);
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), fork);
        let wheel = base.inverse() * planted.world_from_wheel * turned;
        let all = model
            .ik
            .solve(model, &wheel)
            .map_err(|missed| Obstruction::Reach { leg, distance: missed.distance })?;
        let solution = all
            .iter()
            .find(|solution| Some(solution.branch) == planted.branch)
            .ok_or(Obstruction::Singular { leg })?;
        if solution.within_limits {
            return Ok(solution.angles);
        }
        let q = &solution.angles;
        let beyond = (q - model.upper).sup(&(model.lower - q));
        let joint = beyond.imax();
        Err(Obstruction::Limit { leg, joint, beyond: beyond[joint] })
    }

    /// Joint angles for a pose of the chassis, each fork pitched as little as it can be.
    pub fn reach(&self, base: &Isometry3<f64>) -> Result<(Configuration, ChainPose), Obstruction> {
        let mut configuration = self.start.clone();
        configuration.world_from_base = *base;
        let mut forks = Vec::with_capacity(self.planted.len());
        for planted in &self.planted {
            let mut found = self.leg_angles(planted, base, 0.0).map(|angles| (angles, 0.0));
            for i in 1..=FORK_STEPS {
                if found.is_ok() || !self.drive_hold {
                    break;
                }
                for fork in [f64::from(i) * FORK_STEP, -f64::from(i) * FORK_STEP] {
                    if let (Err(_), Ok(angles)) = (&found, self.leg_angles(planted, base, fork)) {
                        found = Ok((angles, fork));
                    }
                }
            }
            let (angles, fork) = found?;
            configuration.legs[planted.leg.0] = angles;
            forks.push(fork);
        }
        Ok((configuration, ChainPose { world_from_base: *base, forks }))
    }

    /// The chassis on the straight way (even in place and turn) from the start to `goal`.
    fn along(&self, goal: &ChainPose, t: f64) -> Result<Configuration, Obstruction> {
        let base = between(&self.start.world_from_base, &goal.world_from_base, t);
        let mut configuration = self.start.clone();
        configuration.world_from_base = base;
        for (planted, fork) in self.planted.iter().zip(&goal.forks) {
            configuration.legs[planted.leg.0] = self.leg_angles(planted, &base, fork * t)?;
        }
        Ok(configuration)
    }

    /// Knots of the way from the start to `goal`, such that between them the wheels keep to their
    /// places within `closure` (m); and the largest deviation seen (m).
    pub fn way(
        &self,
        goal: &ChainPose,
        closure: f64,
    ) -> Result<(Vec<Configuration>, f64), Obstruction> {
        let (from, to) = (&self.start.world_from_base, &goal.world_from_base);
        let length = (to.translation.vector - from.translation.vector).norm();
        let turn = from.rotation.angle_to(&to.rotation);
        let fork = goal.forks.iter().fold(0.0, |most: f64, fork| most.max(fork.abs()));
        let steps = (length / self.robot.scale()).max(turn).max(fork) / SAMPLING;
        let n = steps.ceil().clamp(8.0, 2_000.0) as usize;
        let mut samples: Vec<Configuration> = vec![self.start.clone()];
        for i in 1..=n {
            let here = self.along(goal, i as f64 / n as f64)?;
            let before = &samples[i - 1];
            let jumped = self.planted.iter().find(|planted| {
                (here.legs[planted.leg.0] - before.legs[planted.leg.0]).amax() > JUMP
            });
            if let Some(planted) = jumped {
                return Err(Obstruction::Singular { leg: planted.leg });
            }
            samples.push(here);
        }
        Ok(self.thinned(&samples, closure))
    }

    fn thinned(&self, samples: &[Configuration], closure: f64) -> (Vec<Configuration>, f64) {
        let mut knots = vec![samples[0].clone()];
        let mut largest: f64 = 0.0;
        let mut stack = vec![(0, samples.len() - 1)];
        let legs = self.legs();
        while let Some((a, b)) = stack.pop() {
            let deviation =
                Executed::new(self.robot, &samples[a], &samples[b], &legs).largest_deviation();
            if deviation > CLOSURE_SHARE * closure && b - a > 1 {
                let middle = (a + b) / 2;
                stack.push((middle, b));
                stack.push((a, middle));
            } else {
                largest = largest.max(deviation);
                knots.push(samples[b].clone());
            }
        }
        (knots, largest)
    }
}

fn between(a: &Isometry3<f64>, b: &Isometry3<f64>, t: f64) -> Isometry3<f64> {
    let place = a.translation.vector.lerp(&b.translation.vector, t);
    let turn = a.rotation.rotation_to(&b.rotation);
    let part = UnitQuaternion::from_scaled_axis(turn.scaled_axis() * t);
    Isometry3::from_parts(Translation3::from(place), part * a.rotation)
}

/// The executed motion between two knots: linear in the joints, the chassis where the standing
/// wheels put it.
pub(crate) struct Executed<'a> {
    robot: &'a Robot,
    a: &'a Configuration,
    b: &'a Configuration,
    /// Ends of each wheel's axle, and the direction of its fork, at both knots.
    wheels: Vec<(LegId, [WheelMark; 2])>,
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
    pub fn new(
        robot: &'a Robot,
        a: &'a Configuration,
        b: &'a Configuration,
        standing: &[LegId],
    ) -> Executed<'a> {
        let ends = [Posture::new(robot, a), Posture::new(robot, b)];
        let mark = |leg: LegId| (leg, [0, 1].map(|end| WheelMark::new(robot, &ends[end], leg)));
        Executed { robot, a, b, wheels: standing.iter().map(|leg| mark(*leg)).collect() }
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

    pub fn largest_deviation(&self) -> f64 {
        let n = CLOSURE_SAMPLES;
        (1..n).map(|i| self.at(i as f64 / n as f64).1).fold(0.0, f64::max)
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
