//! How far each leg sags, by what the cameras see of it.
//!
//! A leg that is turned about its hip pitch is laid over the points that were seen near it: along the
//! view of each point, the leg's surface is to be where the point is. Of the turns within what is
//! expected, the one that explains most points is taken, if it explains clearly more than none does.
//! Points near the ground do not count. The turn is a free measurement of sag, and with it the self-mask
//! ([`crate::self_mask`]) draws the leg where it is.

use nalgebra::Point3;
use rover::{Configuration, LegId, Posture, Robot};

use crate::ray::{RayScene, Solid};
use crate::self_mask::PostureErrors;
use crate::surface::Surface;

/// The joint that carries most of a leg's load at the longest arm.
const HIP_PITCH: usize = 1;
/// Step of the sags that are tried (m).
const STEP: f64 = 0.01;
/// Points count that lie within this of the leg's surface along the view (m).
const NEAR: f64 = 0.05;
/// Points count that lie higher than this over the lowest point of the wheel (m).
const ABOVE: f64 = 0.15;
/// Fewest and most points of a leg.
const POINTS: [usize; 2] = [40, 600];
/// By how much more the best turn is to explain than none.
const GAIN: f64 = 1.5;

/// Turns of the hip pitch of each leg (rad) that bring the reported configuration to what was seen, zero where
/// little is seen or nothing is to be mended. Surfaces are in the frame of the configuration (`world`).
pub fn hip_turns(
    surfaces: &[&Surface],
    robot: &Robot,
    reported: &Configuration,
    errors: &PostureErrors,
) -> Vec<f64> {
    let posture = Posture::new(robot, reported);
    robot.leg_ids().map(|leg| hip_turn(surfaces, robot, reported, &posture, leg, errors)).collect()
}

/// The configuration with the hip pitches turned.
pub fn turned(reported: &Configuration, turns: &[f64]) -> Configuration {
    let mut out = reported.clone();
    for (leg, turn) in out.legs.iter_mut().zip(turns) {
        if leg.len() > HIP_PITCH {
            leg[HIP_PITCH] += turn;
        }
    }
    out
}

fn hip_turn(
    surfaces: &[&Surface],
    robot: &Robot,
    reported: &Configuration,
    posture: &Posture,
    leg: LegId,
    errors: &PostureErrors,
) -> f64 {
    let joints = &robot.leg(leg).joints;
    if joints.len() <= HIP_PITCH || errors.sag <= 0.0 {
        return 0.0;
    }
    let hip = posture.link(robot.joints()[joints[HIP_PITCH]].child).translation.vector;
    let wheel = posture.wheel(robot, leg);
    let reach = (wheel.center().coords - hip).xy().norm().max(0.1);
    let n = (3.0 * errors.sag / STEP).ceil() as i32;
    let solids = |turn: f64| -> Vec<Solid> {
        let mut turns = vec![0.0; reported.legs.len()];
        turns[leg.0] = turn;
        let posture = Posture::new(robot, &turned(reported, &turns));
        let scene = RayScene::new(None, Some((robot, &posture)));
        let own = |solid: &&Solid| {
            robot.body_of(solid.link).is_some_and(|(of, place)| of == leg && place >= HIP_PITCH)
        };
        scene.solids().iter().filter(own).cloned().collect()
    };
    // What may be the leg: near it wherever it may be.
    let (here, far) = (solids(0.0), NEAR + 4.5 * errors.sag);
    let floor = wheel.center().z - wheel.radius + ABOVE;
    let may_be = |p: &Point3<f64>| {
        p.z > floor
            && here.iter().any(|solid| {
                let (center, radius) = solid.bounds();
                (p - center).norm() - radius <= far && solid.distance(p) <= far
            })
    };
    let mut seen: Vec<(Point3<f64>, Point3<f64>)> = Vec::new();
    for surface in surfaces {
        let eye = Point3::from(surface.geometry.frame_from_rectified.translation.vector);
        let near = surface.points.iter().map(|point| point.position).filter(may_be);
        seen.extend(near.map(|p| (eye, p)));
    }
    if seen.len() < POINTS[0] {
        return 0.0;
    }
    let stride = seen.len().div_ceil(POINTS[1]);
    let explained = |turn: f64| -> f64 {
        let solids = solids(turn);
        let score = |(eye, p): &(Point3<f64>, Point3<f64>)| {
            let way = p - eye;
            let (length, direction) = (way.norm(), way.normalize());
            let hits = solids.iter().filter_map(|s| s.hit(eye, &direction, length + NEAR));
            let nearest = hits.map(|(t, _)| t).fold(f64::INFINITY, f64::min);
            let off = (nearest - length) / NEAR;
            (1.0 - off * off).max(0.0)
        };
        seen.iter().step_by(stride).map(score).sum()
    };
    let none = explained(0.0);
    // From small to large, so that of equals the smaller is taken.
    let turns = (1..=n).flat_map(|i| [i, -i]).map(|i| f64::from(i) * STEP / reach);
    let best = turns
        .map(|turn| (explained(turn), turn))
        .fold((none, 0.0), |best, one| if one.0 > best.0 { one } else { best });
    if best.0 > GAIN * none { best.1 } else { 0.0 }
}
