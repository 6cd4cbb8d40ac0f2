//! Wheels that turn about the vertical through their centers, the base at rest.

use std::f64::consts::PI;

use collision::{Scene, wheel_ground};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rover::{LegAngles, LegId, LinkId, Posture, WheelPose};

use crate::refusal::Refusal;
use crate::trace::{Lost, Trace};

/// Turn of a wheel from one sample to the next (rad).
const SAMPLE: f64 = 0.03;

/// Least length in plan of an axle's unit vector: below it a wheel lies on its side and heads nowhere.
const LYING: f64 = 0.5;

/// Where a wheel heads in `world`: the direction, in plan, in which a positive spin rolls it. None
/// for one that lies on its side.
pub(crate) fn heading_of(wheel: &WheelPose) -> Option<f64> {
    let ahead = wheel.axle().cross(&Vector3::z());
    (ahead.xy().norm() > LYING).then(|| ahead.y.atan2(ahead.x))
}

/// Heading of the base in `world`: where its x points in plan.
pub(crate) fn base_heading(world_from_base: &Isometry3<f64>) -> f64 {
    let x = world_from_base.rotation * Vector3::x();
    x.y.atan2(x.x)
}

/// The nearest turns (rad) that make a wheel which heads to `from` head to `to`, either way round.
pub(crate) fn turns(from: f64, to: f64) -> [f64; 2] {
    let ahead = wrapped(to - from);
    let back = wrapped(ahead + PI);
    if ahead.abs() <= back.abs() { [ahead, back] } else { [back, ahead] }
}

/// An angle from -π to π.
pub(crate) fn wrapped(angle: f64) -> f64 {
    let turned = angle.rem_euclid(2.0 * PI);
    if turned > PI { turned - 2.0 * PI } else { turned }
}

/// Angles (rad) of all legs, sample by sample, as these wheels turn to headings in `world` (rad).
/// Wheels keep their gap to the ground. The first sample is where the legs are.
pub(crate) fn steer(
    scene: &Scene,
    posture: &Posture,
    legs: &[LegAngles],
    headings: &[(LegId, f64)],
) -> Result<Vec<Vec<LegAngles>>, Refusal> {
    let mut chosen = Vec::with_capacity(headings.len());
    for (leg, heading) in headings {
        chosen.push((*leg, turn_of(scene, posture, &legs[leg.0], *leg, *heading)?));
    }
    let most = chosen.iter().map(|(_, turn)| turn.abs()).fold(0.0, f64::max);
    let n = samples(most);
    let mut knots = vec![legs.to_vec(); n + 1];
    for ((leg, turn), (_, heading)) in chosen.into_iter().zip(headings) {
        let way = turned(scene, posture, &legs[leg.0], leg, turn, n)
            .map_err(|lost| cannot(scene, leg, *heading, &lost))?;
        for (knot, angles) in knots.iter_mut().zip(way) {
            knot[leg.0] = angles;
        }
    }
    Ok(knots)
}

/// The turn (rad) that brings a wheel to a heading: the nearest one that its leg can take.
fn turn_of(
    scene: &Scene,
    posture: &Posture,
    present: &LegAngles,
    leg: LegId,
    heading: f64,
) -> Result<f64, Refusal> {
    let robot = scene.robot();
    let wheel = posture.wheel(robot, leg);
    if wheel.ball {
        return Err(Refusal::NoWheel { leg: robot.leg(leg).name.clone() });
    }
    let Some(from) = heading_of(&wheel) else {
        let (leg, why) = (robot.leg(leg).name.clone(), "it lies on its side".to_owned());
        return Err(Refusal::CannotSteer { leg, heading, why });
    };
    let [near, far] = turns(from, heading);
    let lost = match turned(scene, posture, present, leg, near, samples(near)) {
        Ok(_) => return Ok(near),
        Err(lost) => lost,
    };
    match turned(scene, posture, present, leg, far, samples(far)) {
        Ok(_) => Ok(far),
        Err(_) => Err(cannot(scene, leg, heading, &lost)),
    }
}

fn cannot(scene: &Scene, leg: LegId, heading: f64, lost: &Lost) -> Refusal {
    let leg = scene.robot().leg(leg).name.clone();
    Refusal::CannotSteer { leg, heading, why: lost.to_string() }
}

fn samples(turn: f64) -> usize {
    (turn.abs() / SAMPLE).ceil().max(1.0) as usize
}

/// One leg's angles as its wheel turns by `turn` (rad) in `n` samples.
fn turned(
    scene: &Scene,
    posture: &Posture,
    present: &LegAngles,
    leg: LegId,
    turn: f64,
    n: usize,
) -> Result<Vec<LegAngles>, Lost> {
    let robot = scene.robot();
    let base_from_world = posture.link(LinkId(0)).inverse();
    let wheel = posture.wheel(robot, leg);
    let gap = wheel_ground(&wheel, scene.map(), |_| true).nearest.map(|gap| gap.gap);
    let mut trace = Trace::new(robot, leg, *present);
    let mut way = Vec::with_capacity(n + 1);
    for i in 0..=n {
        let angle = turn * i as f64 / n as f64;
        let spin = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        let mut pose = wheel.world_from_wheel;
        pose.rotation = spin * pose.rotation;
        let pose = seated(scene, WheelPose { world_from_wheel: pose, ..wheel }, gap);
        let angles = trace.follow(&(base_from_world * pose))?;
        way.push(if i == 0 { *present } else { angles });
    }
    Ok(way)
}

/// The wheel's pose, shifted along z until its gap to the ground is `gap` (m); as it is where nothing is
/// known.
pub(crate) fn seated(scene: &Scene, wheel: WheelPose, gap: Option<f64>) -> Isometry3<f64> {
    let mut pose = wheel.world_from_wheel;
    let now = wheel_ground(&wheel, scene.map(), |_| true).nearest;
    if let (Some(wanted), Some(now)) = (gap, now) {
        pose.translation.vector.z += wanted - now.gap;
    }
    pose
}
