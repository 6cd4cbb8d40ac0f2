//! Where and how a wheel can be put down: the footfall of a wheel on the map.
//!
//! The axle is perpendicular to the ground's normal; yaw about the normal and pitch of the fork
//! about the axle are free at touch-down, and a small set of them is tried: the fork along the
//! normal first, then 15 and 30 degrees to either side; the yaw that keeps the knee roll small
//! first. Each wheel is then seated: shifted along z until it just touches.

use nalgebra::{Isometry3, Point2, Point3, Translation3, Unit, Vector3};
use rover::{IkSolution, LegAngles, LegId, Posture, Robot, WheelPose};

use crate::scene::Scene;
use crate::wheel::{PATCH_WIDTHS, contact_center, wheel_ground};

/// Yaws tried about the ground's normal (rad), from the one that keeps the knee roll small.
const YAWS: [f64; 7] = [0.0, 0.524, -0.524, 1.047, -1.047, 1.571, -1.571];
/// Pitches of the fork tried about the axle (rad), 0 being along the normal.
const FORK_PITCHES: [f64; 5] = [0.0, 0.262, -0.262, 0.524, -0.524];
/// Most that seating may shift a wheel, as a share of its radius: beyond, the ground under it is
/// no place for a wheel.
const SEATING_SHIFT: f64 = 0.5;
/// Costs nearer than this are equal (rad): mirror images must not be told apart by rounding.
const TIE: f64 = 1e-6;

/// Ground that a wheel is to stand on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootfallPlace {
    /// The point of ground under the wheel, in `world` (m).
    pub ground: Point3<f64>,
    /// Normal of the patch around it.
    pub normal: Unit<Vector3<f64>>,
}

/// A wheel put down, and leg angles that hold it there.
#[derive(Debug, Clone, PartialEq)]
pub struct Touchdown {
    /// Where it was to stand.
    pub place: FootfallPlace,
    /// The wheel, just touching the ground.
    pub wheel: WheelPose,
    /// Where it touches, in `world` (m).
    pub contact: Point3<f64>,
    /// Joint angles within the limits.
    pub angles: LegAngles,
}

/// Why no wheel can be put down at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoTouchdown {
    /// The ground there, or next to it, is unknown or outside the map.
    UnknownGround,
    /// A seated wheel would be shifted by this much (m): a rock or a hole under the wheel.
    Uneven {
        /// The smallest shift among the orientations tried (m).
        shift: f64,
    },
    /// The wrist is out of reach by at least this much (m) for every orientation tried.
    OutOfReach {
        /// The smallest distance missed (m).
        distance: f64,
    },
    /// In reach, but beyond the joint limits for every orientation tried.
    JointLimits {
        /// Smallest overrun among the solutions (rad).
        overrun: f64,
    },
}

/// The place at `p`, or `None` where the ground is unknown.
pub fn footfall_place(scene: &Scene, leg: LegId, p: Point2<f64>) -> Option<FootfallPlace> {
    let width = PATCH_WIDTHS * scene.robot().leg(leg).wheel.width;
    let plane = scene.map().footprint_plane(p, width)?;
    let height = scene.map().height_at(p)?;
    Some(FootfallPlace { ground: Point3::new(p.x, p.y, height), normal: plane.normal })
}

/// Ways to put the wheel of `leg` down at `p`, best first: `most` of them and what equals the last;
/// the base stands where `posture` has it.
///
/// The order prefers a small knee roll and angles near `near`. Collisions and stability are not
/// looked at.
pub fn touchdowns(
    scene: &Scene,
    posture: &Posture,
    leg: LegId,
    p: Point2<f64>,
    near: &LegAngles,
    most: usize,
) -> Result<Vec<Touchdown>, NoTouchdown> {
    let robot = scene.robot();
    let model = robot.leg(leg);
    let place = footfall_place(scene, leg, p).ok_or(NoTouchdown::UnknownGround)?;
    let hip = posture.link(model.links[0]).translation.vector;
    let outward = Vector3::new(p.x - hip.x, p.y - hip.y, 0.0);
    let across = Vector3::z().cross(&outward);
    let heading = if across.norm() > 1e-6 { across } else { Vector3::y() };

    // Orientations by what they promise before the wheel is seated, which is the dear part.
    let mut failure = Failure::default();
    let mut promising: Vec<(f64, WheelPose)> = Vec::new();
    // Where the leg cannot choose the orientation, one stands for all.
    let free = model.ik.fixes_orientation();
    let (yaws, fork_pitches) =
        if free { (&YAWS[..], &FORK_PITCHES[..]) } else { (&YAWS[..1], &FORK_PITCHES[..1]) };
    for &yaw in yaws {
        for &fork_pitch in fork_pitches {
            let wheel = WheelPose::standing(
                &model.wheel,
                place.ground,
                &place.normal,
                &heading,
                yaw,
                fork_pitch,
            );
            let Some(wheel) = wheel else { continue };
            let best = failure
                .solutions(posture, scene, leg, &wheel.world_from_wheel)
                .iter()
                .map(|s| cost(&s.angles, near))
                .min_by(f64::total_cmp);
            promising.extend(best.map(|cost| (cost, wheel)));
        }
    }
    promising.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found: Vec<(f64, Touchdown)> = Vec::new();
    let mut enough = f64::INFINITY;
    for (promise, wheel) in promising {
        if promise > enough + TIE {
            break;
        }
        let Some((wheel, contact)) = seat(scene, &wheel, &mut failure) else { continue };
        for solution in failure.solutions(posture, scene, leg, &wheel.world_from_wheel) {
            let angles = solution.angles;
            let (wheel, contact) = if free {
                (wheel, contact)
            } else {
                let wheel = posture.with_leg(robot, leg, &angles).wheel(robot, leg);
                let Some(contact) = stands(scene, robot, &wheel, &place) else { continue };
                (wheel, contact)
            };
            found.push((cost(&angles, near), Touchdown { place, wheel, contact, angles }));
        }
        if found.len() >= most {
            enough = enough.min(promise);
        }
    }
    if found.is_empty() {
        return Err(failure.verdict());
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let last = found.get(most.saturating_sub(1)).map_or(f64::INFINITY, |(cost, _)| *cost);
    found.retain(|(cost, _)| *cost <= last + TIE);
    Ok(found.into_iter().map(|(_, touchdown)| touchdown).collect())
}

/// What counts against joint angles (rad): their distance from `near`, and the knee's roll.
fn cost(angles: &LegAngles, near: &LegAngles) -> f64 {
    (angles - near).amax() + angles[3].abs()
}

/// Where a wheel touches whose orientation the leg's joints gave it: none if it does not stand there
/// by the robot's rules. A ball stands wherever it was put.
fn stands(
    scene: &Scene,
    robot: &Robot,
    wheel: &WheelPose,
    place: &FootfallPlace,
) -> Option<Point3<f64>> {
    let below = wheel_ground(wheel, scene.map(), |_| true);
    let gap = below.nearest.filter(|_| !below.unknown)?;
    let rules = robot.stance();
    let level = wheel.camber(&place.normal) <= rules.camber_limit;
    (level && gap.gap.abs() <= rules.ground_tolerance)
        .then(|| contact_center(wheel, scene.map(), &gap))
}

/// The wheel shifted along z until it just touches, and where it touches.
fn seat(
    scene: &Scene,
    wheel: &WheelPose,
    failure: &mut Failure,
) -> Option<(WheelPose, Point3<f64>)> {
    let below = wheel_ground(wheel, scene.map(), |_| true);
    let gap = below.nearest.filter(|_| !below.unknown);
    let Some(gap) = gap else {
        failure.unknown = true;
        return None;
    };
    if gap.gap.abs() > SEATING_SHIFT * wheel.radius {
        failure.shift = failure.shift.min(gap.gap.abs());
        return None;
    }
    let lift = Translation3::new(0.0, 0.0, -gap.gap);
    let seated = WheelPose { world_from_wheel: lift * wheel.world_from_wheel, ..*wheel };
    let contact = contact_center(&seated, scene.map(), &gap);
    Some((seated, contact))
}

/// What stood in the way, over all orientations tried.
struct Failure {
    unknown: bool,
    shift: f64,
    distance: f64,
    overrun: f64,
}

impl Default for Failure {
    fn default() -> Failure {
        let none = f64::INFINITY;
        Failure { unknown: false, shift: none, distance: none, overrun: none }
    }
}

impl Failure {
    fn solutions(
        &mut self,
        posture: &Posture,
        scene: &Scene,
        leg: LegId,
        wheel: &Isometry3<f64>,
    ) -> Vec<IkSolution> {
        let all = match posture.inverse_kinematics(scene.robot(), leg, wheel) {
            Ok(all) => all,
            Err(missed) => {
                self.distance = self.distance.min(missed.distance);
                return Vec::new();
            }
        };
        let model = scene.robot().leg(leg);
        let (inside, outside): (Vec<_>, Vec<_>) = all.into_iter().partition(|s| s.within_limits);
        for s in outside {
            let over = (s.angles - model.upper).sup(&(model.lower - s.angles)).max();
            self.overrun = self.overrun.min(over.max(0.0));
        }
        inside
    }

    /// The reason that came nearest to a footfall.
    fn verdict(&self) -> NoTouchdown {
        if self.overrun.is_finite() {
            NoTouchdown::JointLimits { overrun: self.overrun }
        } else if self.shift.is_finite() {
            NoTouchdown::Uneven { shift: self.shift }
        } else if self.unknown {
            NoTouchdown::UnknownGround
        } else {
            NoTouchdown::OutOfReach { distance: self.distance }
        }
    }
}
