//! Straight lines as joint angles: of one wheel, and of the body over its wheels.

use nalgebra::{Isometry3, Point3, UnitQuaternion};
use rover::{Configuration, LegAngles, LegId, LinkId, Posture, Robot};

use crate::refusal::Refusal;
use crate::trace::{Lost, Trace};

/// Distance of the samples along a line, as a share of the leg's reach (5 mm of about 2.5 m). What
/// is joint-linear between two of them leaves the line by some micrometers.
const SAMPLE_SHARE: f64 = 0.002;

/// Turn from one sample to the next (rad).
const SAMPLE_TURN: f64 = 0.02;

/// Knots along the straight line of the wheel from where it is to `goal` (`world`), turning evenly;
/// the first knot is `present`, where the leg is.
pub(crate) fn wheel_line(
    robot: &Robot,
    posture: &Posture,
    leg: LegId,
    present: &LegAngles,
    goal: &Isometry3<f64>,
) -> Result<Vec<LegAngles>, Refusal> {
    if !goal.translation.vector.iter().all(|v| v.is_finite()) {
        return Err(Refusal::NotFinite { what: "the goal of the wheel's center".into() });
    }
    let start = posture.wheel(robot, leg).world_from_wheel;
    let base_from_world = posture.link(LinkId(0)).inverse();
    let way = goal.translation.vector - start.translation.vector;
    let length = way.norm();
    let n = samples(robot, leg, length, &start.rotation, &goal.rotation);
    let mut trace = Trace::new(robot, leg, *present);
    let mut knots = vec![*present];
    for i in 0..=n {
        let share = i as f64 / n as f64;
        let pose = between(&start, goal, share);
        let at = share * length;
        let angles = trace.follow(&(base_from_world * pose)).map_err(|lost| match lost {
            Lost::Reach(missing) => Refusal::OutOfReach { at, length, missing },
            Lost::Limit(joint) => Refusal::LineLimit { at, length, joint },
            Lost::Branch => Refusal::LineBranch { at, length },
        })?;
        if i > 0 {
            knots.push(angles);
        }
    }
    Ok(knots)
}

/// Angles (rad) of all legs, sample by sample, as the base moves evenly by `by` (in its frame) over
/// the wheels of `standing`; the other legs go with it as they are. The first is where they are.
pub(crate) fn body_line(
    robot: &Robot,
    configuration: &Configuration,
    standing: &[LegId],
    by: &Isometry3<f64>,
) -> Result<Vec<Vec<LegAngles>>, Refusal> {
    let posture = Posture::new(robot, configuration);
    let start = configuration.world_from_base;
    let goal = start * by;
    let of_length = |leg: &LegId| {
        samples(robot, *leg, by.translation.vector.norm(), &start.rotation, &goal.rotation)
    };
    let n = standing.iter().map(of_length).max().unwrap_or(1).min(900);
    let mut knots = vec![configuration.legs.clone(); n + 1];
    for leg in standing {
        let wheel = posture.wheel(robot, *leg).world_from_wheel;
        let mut trace = Trace::new(robot, *leg, configuration.legs[leg.0]);
        for (i, knot) in knots.iter_mut().enumerate() {
            let base = between(&start, &goal, i as f64 / n as f64);
            let followed = trace.follow(&(base.inverse() * wheel));
            let angles = followed.map_err(|lost| Refusal::BodyReach {
                leg: robot.leg(*leg).name.clone(),
                why: lost.to_string(),
            })?;
            if i > 0 {
                knot[leg.0] = angles;
            }
        }
    }
    Ok(knots)
}

/// How many samples a line takes. One longer than twice the reach leaves it early: that many find it.
fn samples(
    robot: &Robot,
    leg: LegId,
    length: f64,
    from: &UnitQuaternion<f64>,
    to: &UnitQuaternion<f64>,
) -> usize {
    let along = length / (SAMPLE_SHARE * robot.leg(leg).ik.reach());
    let turn = from.angle_to(to) / SAMPLE_TURN;
    along.max(turn).ceil().clamp(1.0, 2.0 / SAMPLE_SHARE) as usize
}

/// A pose on the straight way from one to another, turned evenly.
fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let turn = (from.rotation.inverse() * to.rotation).scaled_axis() * share;
    let rotation = from.rotation * UnitQuaternion::from_scaled_axis(turn);
    let place = Point3::from(from.translation.vector.lerp(&to.translation.vector, share));
    Isometry3::from_parts(place.into(), rotation)
}
