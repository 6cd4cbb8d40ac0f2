//! The fast kinematics of one leg against those of the whole robot, and its bounds of motion against
//! displacements of random points.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegChain, LegId, Posture, Robot};

use crate::worlds::with_payload;
use crate::{athlete, cases, load};

/// Robots of many kinds: wheels, ball feet, short legs, joints that slide.
fn robots() -> [Arc<Robot>; 4] {
    [with_payload(&athlete()), load("hexapod"), load("quadruped"), load("slider")]
}

/// Joint angles within the limits.
fn any(robot: &Robot, leg: LegId, rng: &mut ChaCha8Rng) -> LegAngles {
    let model = robot.leg(leg);
    LegAngles::from_fn(|j, _| {
        if j < model.n_joints() { rng.random_range(model.lower[j]..=model.upper[j]) } else { 0.0 }
    })
}

/// The robot somewhere, all legs anyhow.
fn anyhow(robot: &Robot, rng: &mut ChaCha8Rng) -> Configuration {
    let mut turn = || Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let world_from_base = Isometry3::new(turn() * 5.0, turn());
    let legs = robot.leg_ids().map(|leg| any(robot, leg, rng)).collect();
    Configuration { world_from_base, legs }
}

#[test]
fn frames_and_center_of_mass_of_a_leg_are_those_of_the_posture() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let robots = robots();
    for index in 0..cases(4_000, 100_000) {
        let robot = &robots[index % robots.len()];
        let leg = LegId(rng.random_range(0..robot.legs().len()));
        let mut configuration = anyhow(robot, &mut rng);
        let chain = LegChain::new(robot, &Posture::new(robot, &configuration), leg);
        let q = any(robot, leg, &mut rng);
        let frames = chain.frames(&q);
        configuration.legs[leg.0] = q;
        let posture = Posture::new(robot, &configuration);
        let model = robot.leg(leg);
        for (place, link) in model.links.iter().enumerate() {
            let expected = posture.link(*link).to_homogeneous();
            let turn = expected.fixed_view::<3, 3>(0, 0) - frames.links[place].rotation;
            let shift = posture.link(*link).translation.vector - frames.links[place].origin;
            assert!(turn.amax() < 1e-12 && shift.amax() < 1e-12, "{turn} {shift}");
            let joint = &robot.joints()[model.joints[place]];
            let axis = posture.link(joint.child).rotation * joint.axis.into_inner();
            assert!((frames.axes[place] - axis).amax() < 1e-12);
        }
        let off = chain.center_of_mass(&frames) - posture.center_of_mass(robot);
        assert!(off.amax() < 1e-12, "{off}");
    }
}

/// Changes from a thousandth to half a radian, some joints still.
fn change(rng: &mut ChaCha8Rng) -> LegAngles {
    let size = 10.0_f64.powf(rng.random_range(-3.0..-0.3));
    LegAngles::from_fn(|_, _| if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..size) })
}

/// A move within `change`: half of the joints as far as they may.
fn within(change: &LegAngles, rng: &mut ChaCha8Rng) -> LegAngles {
    change.map(|most| {
        let share = if rng.random_bool(0.5) { 1.0 } else { rng.random_range(0.0..1.0) };
        if rng.random_bool(0.5) { most * share } else { -most * share }
    })
}

#[test]
fn no_point_of_a_body_gets_farther_than_its_bound() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let n = cases(25_000, 250_000);
    for robot in robots() {
        let leg = LegId(1);
        let model = robot.leg(leg);
        let mut at = Posture::new(&robot, &anyhow(&robot, &mut rng));
        let chain = LegChain::new(&robot, &at, leg);
        let mut moved = at.clone();
        let (mut tightest, mut near) = (0.0_f64, 0);
        for _ in 0..n {
            let q = any(&robot, leg, &mut rng);
            let change = change(&mut rng);
            at.move_leg(&robot, leg, &q);
            moved.move_leg(&robot, leg, &(q + within(&change, &mut rng)));
            let place = rng.random_range(0..model.n_joints());
            let since = rng.random_range(0..=place);
            // A body on the link, and a point of it: all in the link's frame.
            let mut any = |most: f64| Vector3::from_fn(|_, _| rng.random_range(-most..most));
            let (a, b, off) = (any(0.6), any(0.6), any(1.0));
            let radius = rng.random_range(0.0..0.3);
            let p = a.lerp(&b, rng.random_range(0.0..1.0)) + off.normalize() * radius;
            let p = Point3::from(p);
            let frames = chain.frames(&q);
            let [a, b] = [a, b].map(|end| frames.links[place].point(&Point3::from(end)));
            let bound = frames.motion_bound(place, since, [&a, &b], radius, &change);
            // Seen from the link before, which may move itself.
            let seen = |posture: &Posture| {
                let p = posture.link(model.links[place]) * p;
                if since == 0 { p } else { posture.link(model.links[since - 1]).inverse() * p }
            };
            let way = (seen(&moved) - seen(&at)).norm();
            assert!(way <= bound + 1e-12, "{way} m of {bound} m, place {place} since {since}, {q}");
            if bound > 1e-6 {
                tightest = tightest.max(way / bound);
                near += usize::from(way > 0.7 * bound);
            }
        }
        let name = robot.name();
        assert!(tightest > 0.95 && near > 100, "{name}: {tightest} of the bound at most");
    }
}

#[test]
fn the_center_of_mass_gets_no_farther_than_its_bound() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let n = cases(2_000, 50_000);
    for robot in robots() {
        let leg = LegId(robot.legs().len() - 1);
        let model = robot.leg(leg);
        let base = Posture::new(&robot, &anyhow(&robot, &mut rng));
        let chain = LegChain::new(&robot, &base, leg);
        let mut tightest = 0.0_f64;
        for _ in 0..n {
            let q = any(&robot, leg, &mut rng);
            let change = change(&mut rng);
            let to = (q + within(&change, &mut rng)).sup(&model.lower).inf(&model.upper);
            let [from, to] = [q, to].map(|q| base.with_leg(&robot, leg, &q).center_of_mass(&robot));
            let (way, bound) = ((to - from).norm(), chain.com_motion(&change));
            assert!(way <= bound + 1e-12, "{way} m of {bound} m at {q}");
            if bound > 1e-9 {
                tightest = tightest.max(way / bound);
            }
        }
        assert!(tightest > 0.5, "{}: {tightest} of the bound at most", robot.name());
    }
}
