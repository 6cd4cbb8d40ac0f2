//! Time for joint-linear pieces: as fast as joints and stability allow.
//!
//! Each piece starts and ends at rest, for the direction of motion changes at a knot at once. In
//! between the share s of the piece that is done follows a trapezoid of speed: s" is A, 0, -A. A is
//! the largest that keeps
//!
//! - the joints within their speed and acceleration, and
//! - the zero-moment point (ZMP) where the margin rule would still hold were the center of mass
//!   (CoM) there (Vukobratović and Borovac, Int. J. Humanoid Robotics 1, 2004, for point masses).
//!
//! Braking with A from any instant, as an E-stop does, is included: the bound holds for s" between
//! -A and A at every s, at any speed up to that of the profile there, and to brake only lowers it.
//!
//! **The bound.** The point pᵢ of mass mᵢ has the acceleration pᵢ' s" + pᵢ" s'², and from rest to rest
//! s'² ≤ c A with c = 2 min(s, 1 - s). With heights zᵢ over the contacts and xᵢ from the CoM, the ZMP
//! is off the CoM by |Σ mᵢ (zᵢ aᵢ,h - xᵢ aᵢ,z)| / (M (g + a_com,z)), which is at most A k / (g - A l)
//! with k = (|Σ mᵢ (zᵢ p'ᵢ,h - xᵢ p'ᵢ,z)| + c |same of p"|) / M and l = |p'_com,z| + c |p"_com,z|. With σ to
//! spare of the rule ([`StanceGuard`], which is 1-Lipschitz) it holds if A ≤ g σ / (k + l σ). Where all
//! masses move alike at height h this is the cart-table's a ≤ g σ / h. Links count as points: the
//! model has no inertia.
//!
//! **Friction.** Where the rule is friction's, accelerations use up a part of it: the contacts must also
//! give the horizontal force and the moment about gravity ([`stability::shear`]). What they can give is
//! convex, and s" and s'² lie in the rectangle with the corners (±A, 0) and (±A, c A): A is held where it
//! is at these four. That no foot slips then is exact for the linearized cones; m1 is kept at the ZMP.
//!
//! Positions and their derivatives are sampled; what lies between samples is covered by taking the
//! worse of neighbors and by a factor. Meters, radians, seconds; `gravity` in m/s² along -z.

use nalgebra::{Point3, Vector2, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use stability::{Footholds, StanceGuard, Wrench};

use crate::shift::Executed;

/// Most intervals of a piece in which stability is asked for, and the longest of them (rad, largest
/// joint).
const INTERVALS: usize = 16;
const INTERVAL: f64 = 0.04;

/// Half of the interval for finite differences, in shares of a piece.
const DIFFERENCE: f64 = 1e-3;

/// Share of the bound that is used, for what lies between samples.
const SHARE: f64 = 0.95;

/// Least acceleration of the share (1/s²): a piece then takes half an hour.
const ACCELERATION_MIN: f64 = 1e-6;

/// How fast joints may move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimingLimits {
    /// Any joint (rad/s).
    pub joint_speed: f64,
    /// Any joint (rad/s²).
    pub joint_acceleration: f64,
}

impl TimingLimits {
    /// The robot's own.
    pub fn of(robot: &Robot) -> TimingLimits {
        let motion = robot.motion();
        TimingLimits {
            joint_speed: motion.joint_speed,
            joint_acceleration: motion.joint_acceleration,
        }
    }
}

/// When a piece is where: from rest to rest, in shares of the piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPiece {
    /// Time of its first knot (s).
    pub start: f64,
    /// Time it takes (s).
    pub duration: f64,
    /// Acceleration and deceleration (1/s²).
    pub acceleration: f64,
    /// Speed in the middle (1/s).
    pub speed: f64,
    /// Largest acceleration of any joint (rad/s²).
    pub joint_acceleration: f64,
    /// Largest speed of any joint (rad/s).
    pub joint_speed: f64,
    /// The stability bound, not a joint, decides.
    pub held_back: bool,
}

impl TimedPiece {
    /// The piece with the joints' largest change `change` (rad) under these bounds on the share.
    fn new(start: f64, change: f64, limits: &TimingLimits, stability: f64) -> TimedPiece {
        if change <= 0.0 {
            return TimedPiece {
                start,
                duration: 0.0,
                acceleration: 0.0,
                speed: 0.0,
                joint_acceleration: 0.0,
                joint_speed: 0.0,
                held_back: false,
            };
        }
        let by_joints = limits.joint_acceleration / change;
        let acceleration = by_joints.min(stability);
        // Without a time at full speed the peak is reached in the middle.
        let speed = (limits.joint_speed / change).min(acceleration.sqrt());
        TimedPiece {
            start,
            duration: 1.0 / speed + speed / acceleration,
            acceleration,
            speed,
            joint_acceleration: acceleration * change,
            joint_speed: speed * change,
            held_back: stability < by_joints,
        }
    }

    /// Time of its last knot (s).
    pub fn end(&self) -> f64 {
        self.start + self.duration
    }

    /// Share of the piece that is done at time `t` (s), 0 to 1.
    pub fn at(&self, t: f64) -> f64 {
        let (since, left) = (t - self.start, self.end() - t);
        if since <= 0.0 {
            return if self.duration > 0.0 || since < 0.0 { 0.0 } else { 1.0 };
        }
        if left <= 0.0 {
            return 1.0;
        }
        let ramp = self.speed / self.acceleration;
        if since < ramp {
            0.5 * self.acceleration * since * since
        } else if left < ramp {
            1.0 - 0.5 * self.acceleration * left * left
        } else {
            self.speed * (since - 0.5 * ramp)
        }
    }
}

/// A path with its times: one piece for each pair of neighboring knots.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedPath {
    /// The pieces, one after the other from time 0.
    pub pieces: Vec<TimedPiece>,
}

impl TimedPath {
    /// Time of each knot (s), the first at 0.
    pub fn times(&self) -> Vec<f64> {
        std::iter::once(0.0).chain(self.pieces.iter().map(TimedPiece::end)).collect()
    }

    /// Time of the last knot (s).
    pub fn duration(&self) -> f64 {
        self.pieces.last().map_or(0.0, TimedPiece::end)
    }

    /// The piece under way at time `t` (s) and its share done; `None` for a single knot.
    pub fn at(&self, t: f64) -> Option<(usize, f64)> {
        let last = self.pieces.len().checked_sub(1)?;
        let index = self.pieces.partition_point(|piece| piece.end() < t).min(last);
        Some((index, self.pieces[index].at(t)))
    }
}

/// Why a path has no times.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TimingError {
    /// A limit or gravity that is not above zero.
    #[error("joint speed, joint acceleration and gravity must be finite and above zero")]
    Limits,
    /// The rule does not hold even at rest.
    #[error("at rest the margin rule lacks {missing} m on piece {piece}")]
    Unstable {
        /// Index of the piece.
        piece: usize,
        /// What is missing (m).
        missing: f64,
    },
    /// The contacts hold the weight, but no acceleration to speak of.
    #[error("on piece {piece} a foot would slip however slowly it moves")]
    Slips {
        /// Index of the piece.
        piece: usize,
    },
}

/// Times for a path of one leg with the rest of the robot standing as in `posture`.
///
/// Without a guard stability does not enter.
pub fn time_leg_path(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    knots: &[LegAngles],
    guard: Option<&StanceGuard>,
    gravity: f64,
    limits: &TimingLimits,
) -> Result<TimedPath, TimingError> {
    let changes: Vec<f64> = knots.windows(2).map(|w| (w[1] - w[0]).amax()).collect();
    timed(robot, &changes, guard, gravity, limits, &|i, share| {
        let angles = knots[i].lerp(&knots[i + 1], share);
        masses(robot, &posture.with_leg(robot, leg, &angles))
    })
}

/// Times for a motion of the whole body over the wheels of `standing`, executed as
/// [`crate::base_between`] says.
pub fn time_body_path(
    robot: &Robot,
    knots: &[Configuration],
    standing: &[LegId],
    guard: Option<&StanceGuard>,
    gravity: f64,
    limits: &TimingLimits,
) -> Result<TimedPath, TimingError> {
    let largest = |w: &[Configuration]| {
        w[0].legs.iter().zip(&w[1].legs).map(|(a, b)| (b - a).amax()).fold(0.0, f64::max)
    };
    let changes: Vec<f64> = knots.windows(2).map(largest).collect();
    let executed: Vec<Executed> =
        knots.windows(2).map(|w| Executed::new(robot, &w[0], &w[1], standing)).collect();
    timed(robot, &changes, guard, gravity, limits, &|i, share| {
        masses(robot, &Posture::new(robot, &executed[i].at(share).0))
    })
}

/// Where the mass of each link is (m).
type Masses = Vec<Point3<f64>>;

fn masses(robot: &Robot, posture: &Posture) -> Masses {
    (0..robot.links().len())
        .map(|i| posture.link(rover::LinkId(i)) * robot.links()[i].com)
        .collect()
}

/// Times for pieces with these largest changes of a joint (rad); `masses_at` gives the masses at a
/// share of a piece.
fn timed(
    robot: &Robot,
    changes: &[f64],
    guard: Option<&StanceGuard>,
    gravity: f64,
    limits: &TimingLimits,
    masses_at: &dyn Fn(usize, f64) -> Masses,
) -> Result<TimedPath, TimingError> {
    let positive = |value: f64| value.is_finite() && value > 0.0;
    if !(positive(limits.joint_speed) && positive(limits.joint_acceleration) && positive(gravity)) {
        return Err(TimingError::Limits);
    }
    let mut pieces: Vec<TimedPiece> = Vec::with_capacity(changes.len());
    for (i, change) in changes.iter().enumerate() {
        let start = pieces.last().map_or(0.0, TimedPiece::end);
        let stability = match guard {
            Some(guard) if *change > 0.0 => {
                let bound =
                    stability_bound(robot, guard, gravity, *change, &|share| masses_at(i, share))
                        .map_err(|missing| TimingError::Unstable { piece: i, missing })?;
                if bound.is_nan() || bound < ACCELERATION_MIN {
                    return Err(TimingError::Slips { piece: i });
                }
                bound
            }
            _ => f64::INFINITY,
        };
        pieces.push(TimedPiece::new(start, *change, limits, stability));
    }
    Ok(TimedPath { pieces })
}

/// What one point of a piece says about the acceleration A of the share: σ, k and l of the header.
#[derive(Clone, Copy)]
struct Demand {
    spare: f64,
    horizontal: f64,
    vertical: f64,
    /// The largest A under which no foot slips.
    grip: f64,
}

/// The largest acceleration of the share (1/s²) under which the rule holds at the ZMP; the error is
/// what is missing at rest (m).
fn stability_bound(
    robot: &Robot,
    guard: &StanceGuard,
    gravity: f64,
    change: f64,
    masses_at: &dyn Fn(f64) -> Masses,
) -> Result<f64, f64> {
    let n = ((change / INTERVAL).ceil() as usize).clamp(2, INTERVALS);
    let demands: Vec<Demand> =
        (0..=n).map(|i| demand(robot, guard, gravity, i as f64 / n as f64, masses_at)).collect();
    let least = demands.iter().map(|d| d.spare).fold(f64::INFINITY, f64::min);
    if least <= 0.0 || least.is_nan() {
        return Err(-least);
    }
    let bound = demands.windows(2).map(|ends| {
        let spare = ends[0].spare.min(ends[1].spare);
        let horizontal = ends[0].horizontal.max(ends[1].horizontal);
        let vertical = ends[0].vertical.max(ends[1].vertical);
        let held = gravity * spare / (horizontal + vertical * spare);
        held.min(ends[0].grip).min(ends[1].grip)
    });
    Ok(SHARE * bound.fold(f64::INFINITY, f64::min))
}

fn demand(
    robot: &Robot,
    guard: &StanceGuard,
    gravity: f64,
    share: f64,
    masses_at: &dyn Fn(f64) -> Masses,
) -> Demand {
    // At the ends the differences are taken just inside.
    let middle = share.clamp(DIFFERENCE, 1.0 - DIFFERENCE);
    let [before, here, after] = [middle - DIFFERENCE, middle, middle + DIFFERENCE].map(masses_at);
    let total = robot.mass().max(f64::MIN_POSITIVE);
    let weighted = |points: &[Point3<f64>]| {
        let links = robot.links().iter().zip(points);
        links.map(|(link, p)| p.coords * (link.mass / total)).sum::<Vector3<f64>>()
    };
    let com = Point3::from(weighted(&here));
    let heights = guard.contacts().iter().map(|contact| contact.z);
    let (low, high) = heights
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));

    let first = |i: usize| (after[i] - before[i]) / (2.0 * DIFFERENCE);
    let second = |i: usize| {
        (after[i].coords + before[i].coords - here[i].coords * 2.0) / (DIFFERENCE * DIFFERENCE)
    };
    // How far the ZMP at height `ground` goes per unit of acceleration of this kind, times g; the
    // greatest over uneven contacts is at the lowest or highest, for it is convex in the height.
    let moment = |rate: &dyn Fn(usize) -> Vector3<f64>| {
        let at = |ground: f64| {
            let of_link = |i: usize| {
                let (p, a) = (here[i], rate(i));
                let mass = robot.links()[i].mass / total;
                (a.xy() * (p.z - ground) - (p - com).xy() * a.z) * mass
            };
            (0..here.len()).map(of_link).sum::<Vector2<f64>>().norm()
        };
        at(low).max(at(high))
    };
    let rise = |rate: &dyn Fn(usize) -> Vector3<f64>| {
        (0..here.len()).map(|i| rate(i).z * robot.links()[i].mass / total).sum::<f64>().abs()
    };
    let c = 2.0 * share.min(1.0 - share);
    let wrench = |rate: &dyn Fn(usize) -> Vector3<f64>| {
        let mut sum = Wrench { force: Vector3::zeros(), moment: Vector3::zeros() };
        for (i, link) in robot.links().iter().enumerate() {
            let force = rate(i) * (link.mass / (total * gravity));
            sum.force += force;
            sum.moment += (here[i] - com).cross(&force);
        }
        sum
    };
    let grip = |footholds| grip(footholds, &com, &wrench(&first), &wrench(&second), c);
    Demand {
        grip: guard.footholds().map_or(f64::INFINITY, grip),
        spare: guard.spare(&com),
        horizontal: moment(&first) + c * moment(&second),
        vertical: rise(&first) + c * rise(&second),
    }
}

/// The largest A that these contacts hold at all corners of (s", s'²) up to (±A, c A), for the wrenches
/// that each of the two asks for.
fn grip(footholds: &Footholds, com: &Point3<f64>, first: &Wrench, second: &Wrench, c: f64) -> f64 {
    let mix = |a: f64, b: f64| Wrench {
        force: first.force * a + second.force * b,
        moment: first.moment * a + second.moment * b,
    };
    let corners = [mix(1.0, 0.0), mix(-1.0, 0.0), mix(1.0, c), mix(-1.0, c)];
    corners.iter().map(|wrench| footholds.most(com, wrench)).fold(f64::INFINITY, f64::min)
}
