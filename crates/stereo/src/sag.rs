//! How far each leg sags, by what the cameras see of it.
//!
//! A leg that is turned about its hip pitch is laid over the points that were seen near it: along the
//! view of each point, the leg's surface is to be where the point is. Of the turns within what is
//! expected, the one that explains most points is taken, if it explains clearly more than none does, and is not
//! the farthest of them.
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
/// Share of the points that it is to explain beside those that none does.
const EXPLAINED: f64 = 0.1;

/// What a pair saw near each leg: points that may be of it, each with the place that it was seen from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LegSights(Vec<Vec<(Point3<f64>, Point3<f64>)>>);

impl LegSights {
    /// Of the points of a pair, in the frame of the configuration (`world`), those that may be of a leg.
    pub fn of(
        surface: &Surface,
        robot: &Robot,
        reported: &Configuration,
        errors: &PostureErrors,
    ) -> LegSights {
        let posture = Posture::new(robot, reported);
        let eye = Point3::from(surface.geometry.frame_from_rectified.translation.vector);
        let legs = robot.leg_ids().map(|leg| {
            let Some(hip) = Hip::of(robot, reported, &posture, leg, errors) else {
                return Vec::new();
            };
            let (here, far) = (hip.solids(0.0), NEAR + 4.5 * errors.sag);
            // Wherever the leg may be, it is near where it was reported.
            let may_be = |p: &Point3<f64>| {
                p.z > hip.floor
                    && here.iter().any(|solid| {
                        let (center, radius) = solid.bounds();
                        (p - center).norm() - radius <= far && solid.distance(p) <= far
                    })
            };
            let near = surface.points.iter().map(|point| point.position).filter(may_be);
            near.map(|p| (eye, p)).collect()
        });
        LegSights(legs.collect())
    }
}

/// Turns of the hip pitch of each leg (rad) that bring the reported configuration to what was seen, zero where
/// little is seen or nothing is to be mended. Surfaces are in the frame of the configuration (`world`).
pub fn hip_turns(
    surfaces: &[&Surface],
    robot: &Robot,
    reported: &Configuration,
    errors: &PostureErrors,
) -> Vec<f64> {
    let sight = |surface: &&Surface| LegSights::of(surface, robot, reported, errors);
    let sights: Vec<LegSights> = surfaces.iter().map(sight).collect();
    hip_turns_of(&sights, robot, reported, errors)
}

/// As [`hip_turns`], of what all pairs of one instant saw near the legs.
pub fn hip_turns_of(
    sights: &[LegSights],
    robot: &Robot,
    reported: &Configuration,
    errors: &PostureErrors,
) -> Vec<f64> {
    let posture = Posture::new(robot, reported);
    let turn = |leg: LegId| {
        let seen: Vec<&(Point3<f64>, Point3<f64>)> =
            sights.iter().filter_map(|of| of.0.get(leg.0)).flatten().collect();
        let hip = Hip::of(robot, reported, &posture, leg, errors)?;
        Some(hip.turn(&seen, errors))
    };
    robot.leg_ids().map(|leg| turn(leg).unwrap_or(0.0)).collect()
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

/// A leg that may be turned about its hip pitch.
struct Hip<'a> {
    robot: &'a Robot,
    reported: &'a Configuration,
    leg: LegId,
    /// From the hip to the wheel, across (m).
    reach: f64,
    /// Points below this (m) may be of the ground.
    floor: f64,
}

impl<'a> Hip<'a> {
    /// None where the leg has no such joint, or nothing is expected of it.
    fn of(
        robot: &'a Robot,
        reported: &'a Configuration,
        posture: &Posture,
        leg: LegId,
        errors: &PostureErrors,
    ) -> Option<Hip<'a>> {
        let joint = *robot.leg(leg).joints.get(HIP_PITCH)?;
        if errors.sag <= 0.0 {
            return None;
        }
        let hip = posture.link(robot.joints()[joint].child).translation.vector;
        let wheel = posture.wheel(robot, leg);
        let reach = (wheel.center().coords - hip).xy().norm().max(0.1);
        let floor = wheel.center().z - wheel.radius + ABOVE;
        Some(Hip { robot, reported, leg, reach, floor })
    }

    /// What the joint carries, turned.
    fn solids(&self, turn: f64) -> Vec<Solid> {
        let (robot, leg) = (self.robot, self.leg);
        let mut turns = vec![0.0; self.reported.legs.len()];
        turns[leg.0] = turn;
        let posture = Posture::new(robot, &turned(self.reported, &turns));
        let scene = RayScene::new(None, Some((robot, &posture)));
        let own = |solid: &&Solid| {
            robot.body_of(solid.link).is_some_and(|(of, place)| of == leg && place >= HIP_PITCH)
        };
        scene.solids().iter().filter(own).cloned().collect()
    }

    fn turn(&self, seen: &[&(Point3<f64>, Point3<f64>)], errors: &PostureErrors) -> f64 {
        if seen.len() < POINTS[0] {
            return 0.0;
        }
        let stride = seen.len().div_ceil(POINTS[1]);
        let explained = |turn: f64| -> f64 {
            let solids = self.solids(turn);
            let score = |(eye, p): &&(Point3<f64>, Point3<f64>)| {
                let way = p - eye;
                let (length, direction) = (way.norm(), way.normalize());
                let hits = solids.iter().filter_map(|s| s.hit(eye, &direction, length + NEAR));
                let nearest = hits.map(|(t, _)| t).fold(f64::INFINITY, f64::min);
                let off = (nearest - length) / NEAR;
                (1.0 - off * off).max(0.0)
            };
            seen.iter().step_by(stride).map(score).sum()
        };
        let n = (3.0 * errors.sag / STEP).ceil() as i32;
        let none = explained(0.0);
        // From small to large, so that of equals the smaller is taken.
        let turns = (1..=n).flat_map(|i| [i, -i]).map(|i| f64::from(i) * STEP / self.reach);
        let best = turns
            .map(|turn| (explained(turn), turn))
            .fold((none, 0.0), |best, one| if one.0 > best.0 { one } else { best });
        // What fits best at the end of what is expected would fit better beyond: that is something else than the
        // leg, as is what explains few of the points.
        let is_within = best.1.abs() < (f64::from(n) - 0.5) * STEP / self.reach;
        let n_looked = seen.len().div_ceil(stride) as f64;
        let is_clear = best.0 > GAIN * none && best.0 - none > EXPLAINED * n_looked;
        if is_within && is_clear { best.1 } else { 0.0 }
    }
}
