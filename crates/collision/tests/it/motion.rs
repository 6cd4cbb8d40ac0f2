//! The fast kinematics of one leg against those of the whole robot, and its bounds of motion against
//! displacements of random points.

use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegAngles, LegChain, LegId, Posture};

use crate::worlds::{load, standing, with_payload};
use crate::{athlete, cases};

#[test]
fn frames_and_center_of_mass_of_a_leg_are_those_of_the_posture() {
    let robot = with_payload(&athlete());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for index in 0..cases(2_000, 100_000) {
        let mut base = standing(&robot);
        for leg in robot.leg_ids() {
            base.legs[leg.0] = load(&robot, leg, index, &mut rng);
        }
        let at_rest = Posture::new(&robot, &base);
        let leg = LegId(index % 6);
        let chain = LegChain::new(&robot, &at_rest, leg);
        let q = load(&robot, leg, index, &mut rng);
        let frames = chain.frames(&q);
        base.legs[leg.0] = q;
        let posture = Posture::new(&robot, &base);
        for (frame, link) in frames.links.iter().zip(robot.leg(leg).links) {
            let expected = posture.link(link).to_homogeneous();
            let turn = expected.fixed_view::<3, 3>(0, 0) - frame.rotation;
            let shift = posture.link(link).translation.vector - frame.origin;
            assert!(turn.amax() < 1e-12 && shift.amax() < 1e-12, "{turn} {shift}");
        }
        for (place, axis) in frames.axes.iter().enumerate() {
            let joint = &robot.joints()[robot.leg(leg).joints[place]];
            let expected = posture.link(joint.child).rotation * joint.axis.into_inner();
            assert!((axis - expected).amax() < 1e-12);
        }
        let off = chain.center_of_mass(&frames) - posture.center_of_mass(&robot);
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
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let leg = LegId(1);
    let model = robot.leg(leg);
    let mut at = Posture::new(&robot, &standing(&robot));
    let chain = LegChain::new(&robot, &at, leg);
    let mut moved = at.clone();
    let (mut tightest, mut reached) = (0.0_f64, 0);
    for index in 0..cases(100_000, 1_000_000) {
        let q = load(&robot, leg, index, &mut rng);
        let change = change(&mut rng);
        at.move_leg(&robot, leg, &q);
        moved.move_leg(&robot, leg, &(q + within(&change, &mut rng)));
        let place = rng.random_range(0..6);
        let since = rng.random_range(0..=place);
        // A body on the link, and a point of it: all in the link's frame.
        let mut any = |most: f64| Vector3::from_fn(|_, _| rng.random_range(-most..most));
        let (a, b, off) = (any(0.6), any(0.6), any(1.0));
        let radius = rng.random_range(0.0..0.3);
        let along = rng.random_range(0.0..1.0);
        let p = Point3::from(a.lerp(&b, along) + off.normalize() * radius);
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
            reached += usize::from(way > 0.7 * bound);
        }
    }
    assert!(tightest > 0.97 && reached > 100, "the bound is {tightest} near at best");
}

#[test]
fn the_center_of_mass_gets_no_farther_than_its_bound() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let leg = LegId(4);
    let base = Posture::new(&robot, &standing(&robot));
    let chain = LegChain::new(&robot, &base, leg);
    let mut tightest = 0.0_f64;
    for index in 0..cases(5_000, 100_000) {
        let q = load(&robot, leg, index, &mut rng);
        let change = change(&mut rng);
        let to = q + within(&change, &mut rng);
        let [from, to] = [q, to].map(|q| base.with_leg(&robot, leg, &q).center_of_mass(&robot));
        let (way, bound) = ((to - from).norm(), chain.com_motion(&change));
        assert!(way <= bound + 1e-12, "{way} m of {bound} m at {q}");
        if bound > 1e-6 {
            tightest = tightest.max(way / bound);
        }
    }
    assert!(tightest > 0.5, "the bound is {tightest} near at best");
}
