//! Where and how a wheel can be put down: the footfall of a wheel on the map.
//!
//! The axle is perpendicular to the ground's normal; yaw about the normal and pitch of the fork
//! about the axle are free at touch-down, and a small set of them is tried: the fork along the
//! normal first, then 15 and 30 degrees to either side; the yaw that keeps the knee roll small
//! first. Each wheel is then seated: shifted along z until it just touches.

use nalgebra::{Point2, Point3, Unit, Vector3};
use rover::{Frame, LegAngles, LegId, LinkId, Posture, WheelPose};

use crate::footing::{Footing, Footings, NoSeat, WheelHeading};
use crate::scene::Scene;
use crate::wheel::PATCH_WIDTHS;

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
    let footings = Footings::new(scene, posture, leg, WheelHeading::Free);
    let mut footing = footings.at(p).ok_or(NoTouchdown::UnknownGround)?;
    // Orientations by what they promise before the wheel is seated.
    let mut failure = Failure::default();
    let mut promising: Vec<(f64, usize)> = Vec::new();
    for orientation in 0..footings.n_orientations() {
        let best = failure
            .angles(scene, posture, leg, &footing.unseated(orientation))
            .iter()
            .map(|angles| touchdown_cost(angles, near))
            .min_by(f64::total_cmp);
        promising.extend(best.map(|cost| (cost, orientation)));
    }
    promising.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found: Vec<(f64, Touchdown)> = Vec::new();
    let mut enough = f64::INFINITY;
    for (promise, orientation) in promising {
        if promise > enough + TIE {
            break;
        }
        let seat = match footing.seat(orientation) {
            Ok(seat) => seat,
            Err(NoSeat::Unknown) => {
                failure.unknown = true;
                continue;
            }
            Err(NoSeat::Uneven(shift)) => {
                failure.shift = failure.shift.min(shift);
                continue;
            }
        };
        let seated = footing.seated_frame(orientation, &seat, 0.0);
        let all = failure.angles(scene, posture, leg, &seated);
        let ways = all.into_iter().filter_map(|q| footing.touchdown(orientation, &seat, q));
        found.extend(ways.map(|way| (touchdown_cost(&way.angles, near), way)));
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

/// Why no orientation of the wheel can be put down at a place; none if one can.
pub fn no_touchdown(
    scene: &Scene,
    posture: &Posture,
    leg: LegId,
    footing: &mut Footing<'_>,
) -> Option<NoTouchdown> {
    let mut failure = Failure::default();
    for orientation in 0..footing.n_orientations() {
        let before = failure.angles(scene, posture, leg, &footing.unseated(orientation));
        if before.is_empty() {
            continue;
        }
        match footing.seat(orientation) {
            Err(NoSeat::Unknown) => failure.unknown = true,
            Err(NoSeat::Uneven(shift)) => failure.shift = failure.shift.min(shift),
            Ok(seat) => {
                let seated = footing.seated_frame(orientation, &seat, 0.0);
                let all = failure.angles(scene, posture, leg, &seated);
                let stands = |q: &LegAngles| footing.touchdown(orientation, &seat, *q).is_some();
                if all.iter().any(stands) {
                    return None;
                }
            }
        }
    }
    Some(failure.verdict())
}

/// What counts against joint angles (rad): their distance from `near`, and the knee's roll.
pub fn touchdown_cost(angles: &LegAngles, near: &LegAngles) -> f64 {
    (angles - near).amax() + angles[3].abs()
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
    /// Joint angles within the limits for a wheel in `world`.
    fn angles(
        &mut self,
        scene: &Scene,
        posture: &Posture,
        leg: LegId,
        wheel: &Frame,
    ) -> Vec<LegAngles> {
        let model = scene.robot().leg(leg);
        let base_from_world = Frame::from(&posture.link(LinkId(0)).inverse());
        let base_from_wheel = base_from_world.after(wheel).to_isometry();
        let all = match model.ik.solve(model, &base_from_wheel) {
            Ok(all) => all,
            Err(missed) => {
                self.distance = self.distance.min(missed.distance);
                return Vec::new();
            }
        };
        for s in all.iter().filter(|s| !s.within_limits) {
            let over = (s.angles - model.upper).sup(&(model.lower - s.angles)).max();
            self.overrun = self.overrun.min(over.max(0.0));
        }
        all.iter().filter(|s| s.within_limits).map(|s| s.angles).collect()
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
