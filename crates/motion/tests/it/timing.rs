//! Times along a leg's path and a body shift, and what they do to the zero-moment point.

use std::sync::Arc;

use motion::{
    ShiftRequest, TimedPath, TimingError, TimingLimits, Unwatched, base_between, plan_shift,
    time_body_path, time_leg_path,
};
use nalgebra::{Point3, Vector2, Vector3};
use rover::{Configuration, LegAngles, LegId, LinkId, Posture, Robot};
use stability::{Preference, StanceGuard};

use crate::shift::{Clear, feet, legs};
use crate::{athlete, loaded, scene, standing};

const MOON: f64 = 1.62;
const EARTH: f64 = 9.81;

/// Time between the postures that accelerations are taken from (s).
const TICK: f64 = 2e-3;

fn masses(robot: &Robot, posture: &Posture) -> Vec<(f64, Point3<f64>)> {
    let links = robot.links().iter().enumerate();
    links.map(|(i, link)| (link.mass, posture.link(LinkId(i)) * link.com)).collect()
}

/// The ZMP on z = 0 of point masses whose postures are `TICK` apart, and their center of mass.
fn zmp(robot: &Robot, postures: [&Posture; 3], gravity: f64) -> (Point3<f64>, Point3<f64>) {
    let [before, here, after] = postures.map(|posture| masses(robot, posture));
    let (mut moment, mut weight) = (Vector2::zeros(), 0.0);
    for ((mass, p), (b, a)) in here.iter().zip(before.iter().zip(&after)) {
        let acceleration = (a.1.coords + b.1.coords - p.coords * 2.0) / (TICK * TICK);
        let up = acceleration.z + gravity;
        moment += (p.coords.xy() * up - acceleration.xy() * p.z) * *mass;
        weight += mass * up;
    }
    let com = postures[1].center_of_mass(robot);
    let point = moment / weight;
    (Point3::new(point.x, point.y, com.z), com)
}

/// The least that the rule has to spare at the ZMP along the path, and the ZMP's largest distance
/// from the center of mass (m).
fn walk(
    robot: &Robot,
    guard: &StanceGuard,
    gravity: f64,
    duration: f64,
    posture_at: impl Fn(f64) -> Posture,
) -> (f64, f64) {
    let (mut least, mut farthest) = (f64::INFINITY, 0.0_f64);
    for i in 0..400 {
        let t = duration * f64::from(i) / 399.0;
        let postures = [t - TICK, t, t + TICK].map(&posture_at);
        let (point, com) = zmp(robot, [&postures[0], &postures[1], &postures[2]], gravity);
        least = least.min(guard.spare(&point));
        farthest = farthest.max((point - com).xy().norm());
    }
    (least, farthest)
}

/// The bent loaded rover with leg 1 in the air, and a wide swing of that leg.
fn swing() -> (Arc<Robot>, Posture, Vec<LegAngles>, Vec<Point3<f64>>) {
    let robot = loaded();
    let start = standing(&robot);
    let q = start.legs[0];
    let knots = vec![
        q,
        q + LegAngles::new(0.0, -0.5, 0.0, 0.0, 0.0, 0.0),
        q + LegAngles::new(0.6, -0.5, 0.1, 0.0, 0.2, 0.1),
        q + LegAngles::new(0.6, -0.3, 0.1, 0.0, 0.2, 0.1),
    ];
    let contacts = feet(&robot, &start)[1..].iter().map(|(_, p)| *p).collect();
    (robot.clone(), Posture::new(&robot, &start), knots, contacts)
}

fn guard_with(
    robot: &Robot,
    contacts: &[Point3<f64>],
    spare_now: f64,
    com: &Point3<f64>,
) -> StanceGuard {
    // m1 such that just so much is to spare.
    let all = StanceGuard::new(contacts, robot.stance(), Preference::Regular).unwrap();
    let rules = rover::StanceRules {
        margin: robot.stance().margin + all.spare(com) - spare_now,
        settlement: 0.0,
        ..*robot.stance()
    };
    StanceGuard::new(contacts, &rules, Preference::Regular).unwrap()
}

fn leg_at(path: &TimedPath, knots: &[LegAngles], t: f64) -> LegAngles {
    let (piece, share) = path.at(t).unwrap();
    knots[piece].lerp(&knots[piece + 1], share)
}

const FAST: TimingLimits = TimingLimits { joint_speed: 2.0, joint_acceleration: 4.0 };

#[test]
fn joints_keep_their_speed_and_acceleration_and_stop_at_every_knot() {
    let (robot, posture, knots, _) = swing();
    let limits = TimingLimits::of(&robot);
    assert_eq!((limits.joint_speed, limits.joint_acceleration), (0.1, 0.2));
    let path = time_leg_path(&robot, &posture, LegId(0), &knots, None, MOON, &limits).unwrap();
    let times = path.times();
    // The longest change is 0.5, 0.6 and 0.2 rad: at 0.1 rad/s, and 0.5 s to stop and to go.
    let expected = [0.0, 5.5, 5.5 + 6.5, 5.5 + 6.5 + 2.5];
    assert!(times.iter().zip(expected).all(|(t, e)| (t - e).abs() < 1e-9), "{times:?}");
    let h = 1e-3;
    let mut length = 0.0;
    for i in 1..14_500 {
        let t = f64::from(i) * h;
        let [a, b, c] = [t - h, t, t + h].map(|t| leg_at(&path, &knots, t));
        let (speed, acceleration) = ((c - a) / (2.0 * h), (a + c - b * 2.0) / (h * h));
        assert!(speed.amax() < 0.1 + 1e-6, "{speed} at {t}");
        assert!(acceleration.amax() < 0.2 + 1e-4, "{acceleration} at {t}");
        length += (c - b).norm();
    }
    let straight: f64 = knots.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    assert!((length - straight).abs() < 2e-2, "{length} of {straight}");
    for (time, knot) in times.iter().zip(&knots) {
        assert!((leg_at(&path, &knots, *time) - knot).amax() < 1e-9);
    }
    for piece in &path.pieces {
        assert!(piece.joint_speed <= 0.1 && piece.joint_acceleration <= 0.2 + 1e-12);
        assert!(!piece.held_back);
    }
}

#[test]
fn a_fast_swing_keeps_the_zmp_where_the_rule_holds_on_moon_and_earth() {
    let (robot, posture, knots, contacts) = swing();
    let com = posture.center_of_mass(&robot);
    for gravity in [MOON, EARTH] {
        let guard = guard_with(&robot, &contacts, 0.10, &com);
        let path = time_leg_path(&robot, &posture, LegId(0), &knots, Some(&guard), gravity, &FAST)
            .unwrap();
        let at = |t| posture.with_leg(&robot, LegId(0), &leg_at(&path, &knots, t));
        let (least, farthest) = walk(&robot, &guard, gravity, path.duration(), at);
        assert!(least >= 0.0, "{least} m at gravity {gravity}");
        let held_back = path.pieces.iter().any(|piece| piece.held_back);
        assert_eq!(held_back, gravity == MOON, "{:?}", path.pieces);
        assert!(farthest > 0.02, "{farthest}");
        // Without the guard the Moon's ZMP would leave.
        let blind =
            time_leg_path(&robot, &posture, LegId(0), &knots, None, gravity, &FAST).unwrap();
        let at = |t| posture.with_leg(&robot, LegId(0), &leg_at(&blind, &knots, t));
        let (least, _) = walk(&robot, &guard, gravity, blind.duration(), at);
        assert_eq!(least < 0.0, gravity == MOON, "{least} m at gravity {gravity}");
    }
}

#[test]
fn an_emergency_stop_at_any_instant_keeps_the_rule() {
    let (robot, posture, knots, contacts) = swing();
    let com = posture.center_of_mass(&robot);
    let guard = guard_with(&robot, &contacts, 0.05, &com);
    let path =
        time_leg_path(&robot, &posture, LegId(0), &knots, Some(&guard), MOON, &FAST).unwrap();
    for (i, piece) in path.pieces.iter().enumerate() {
        for k in 1..20 {
            let t0 = piece.start + piece.duration * f64::from(k) / 20.0;
            let h = 1e-6;
            let (s0, v0) = (piece.at(t0), (piece.at(t0 + h) - piece.at(t0 - h)) / (2.0 * h));
            let stop = v0 / piece.acceleration;
            let at = |t: f64| {
                let t = t.clamp(0.0, stop);
                let share = s0 + v0 * t - 0.5 * piece.acceleration * t * t;
                posture.with_leg(&robot, LegId(0), &knots[i].lerp(&knots[i + 1], share))
            };
            for j in 1..20 {
                // Well inside the braking, where accelerations have no step.
                let t = TICK + (stop - 2.0 * TICK).max(0.0) * f64::from(j) / 20.0;
                let postures = [t - TICK, t, t + TICK].map(at);
                let (point, _) = zmp(&robot, [&postures[0], &postures[1], &postures[2]], MOON);
                let spare = guard.spare(&point);
                assert!(spare >= 0.0, "{spare} m, piece {i} stopped at {t0} s");
            }
        }
    }
}

#[test]
fn a_hip_yaw_at_4_rad_s2_moves_the_zmp_on_the_moon_by_about_a_quarter_meter() {
    // Planning notes: 0.23 m at full scale, without payload.
    let robot = athlete();
    let start = standing(&robot);
    let posture = Posture::new(&robot, &start);
    let q = start.legs[0];
    let raised = q + LegAngles::new(0.0, -0.5, 0.0, 0.0, 0.0, 0.0);
    let mut moved = Vec::new();
    for q in [q, raised] {
        let turned = q + LegAngles::ith(0, 0.5 * 4.0 * TICK * TICK);
        let postures = [turned, q, turned].map(|q| posture.with_leg(&robot, LegId(0), &q));
        // From rest, and to rest before: the posture is the same at -TICK and TICK.
        let (point, com) = zmp(&robot, [&postures[0], &postures[1], &postures[2]], MOON);
        moved.push((point - com).xy().norm());
    }
    assert!(moved.iter().all(|m| (0.12..0.35).contains(m)), "{moved:?}");
}

#[test]
fn a_body_shift_is_slower_on_the_moon_and_keeps_the_rule_there() {
    let robot = loaded();
    let start = standing(&robot);
    let feet = feet(&robot, &start);
    let scene = scene(robot.clone(), &[]);
    let request = ShiftRequest {
        preference: Preference::Conservative,
        wanted_spare: 0.08,
        ..ShiftRequest::new(&scene, &start, &feet, LegId(0))
    };
    let plan = plan_shift(&request, &mut Clear, &mut Unwatched).unwrap();
    let knots: &[Configuration] = &plan.configurations;
    let contacts: Vec<Point3<f64>> = feet.iter().map(|(_, p)| *p).collect();
    let com = Posture::new(&robot, &knots[0]).center_of_mass(&robot);
    let guard = guard_with(&robot, &contacts, 0.25, &com);
    let standing = legs(&robot);
    let mut durations = Vec::new();
    for gravity in [MOON, EARTH] {
        let path = time_body_path(&robot, knots, &standing, Some(&guard), gravity, &FAST).unwrap();
        let at = |t: f64| {
            let (piece, share) = path.at(t).unwrap();
            let here = base_between(&robot, &knots[piece], &knots[piece + 1], &standing, share);
            Posture::new(&robot, &here)
        };
        let (least, _) = walk(&robot, &guard, gravity, path.duration(), at);
        assert!(least >= 0.0, "{least} m at gravity {gravity}");
        durations.push(path.duration());
    }
    assert!(durations[0] > 1.2 * durations[1], "{durations:?}");
}

#[test]
fn what_cannot_be_timed_is_said() {
    let (robot, posture, knots, contacts) = swing();
    let slow = TimingLimits { joint_speed: 0.0, joint_acceleration: 0.2 };
    let ask = |guard: Option<&StanceGuard>, gravity, limits: &TimingLimits| {
        time_leg_path(&robot, &posture, LegId(0), &knots, guard, gravity, limits)
    };
    assert_eq!(ask(None, MOON, &slow), Err(TimingError::Limits));
    assert_eq!(ask(None, f64::NAN, &FAST), Err(TimingError::Limits));
    let far: Vec<Point3<f64>> = contacts.iter().map(|p| p + Vector3::x() * 5.0).collect();
    let guard = StanceGuard::new(&far, robot.stance(), Preference::Regular).unwrap();
    let refused = ask(Some(&guard), MOON, &FAST);
    assert!(matches!(refused, Err(TimingError::Unstable { piece: 0, missing }) if missing > 1.0));
    let none = time_leg_path(&robot, &posture, LegId(0), &knots[..1], None, MOON, &FAST).unwrap();
    assert_eq!((none.times(), none.at(1.0)), (vec![0.0], None));
    let still = [knots[0], knots[0], knots[1]];
    let path = time_leg_path(&robot, &posture, LegId(0), &still, None, MOON, &FAST).unwrap();
    assert_eq!(path.times()[1], 0.0);
}
