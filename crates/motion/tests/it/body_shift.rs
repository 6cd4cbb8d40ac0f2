//! Certified shifts of the body against brute force.

use std::sync::Arc;

use collision::{BodyCertifier, Certificate, Obstacle, PairDistance, Scene, Survey, survey};
use geometry::Raster;
use motion::shift::Executed;
use motion::{CertifiedBody, base_between};
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{BodyChain, BodyMotion, Configuration, LegAngles, LegId, LinkId, Posture, Robot, Sway};
use terrain::{ElevationMap, Source};

use crate::{athlete, robot_with, scene, standing};

/// Knots of a shift: the wheels then keep to their places within 1 mm.
const PIECES: usize = 6;

/// Points of a whole shift at which brute force looks: all 0.02 of the way, all 0.001 where
/// `FOOTFALL_FULL` is 1.
fn n_looks() -> usize {
    if std::env::var("FOOTFALL_FULL").is_ok_and(|v| v == "1") { 1_000 } else { 50 }
}

fn any(rng: &mut impl Rng, most: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-most..most))
}

/// Knots of a shift by `offset` and a turn by `turn`, by inverse kinematics near the knot before.
fn shift(
    robot: &Robot,
    start: &Configuration,
    offset: Vector3<f64>,
    turn: Vector3<f64>,
) -> Option<Vec<Configuration>> {
    let posture = Posture::new(robot, start);
    let mut knots = vec![start.clone()];
    for i in 1..=PIECES {
        let share = i as f64 / PIECES as f64;
        let before = knots[i - 1].clone();
        let base = Isometry3::from_parts(
            Translation3::from(start.world_from_base.translation.vector + offset * share),
            UnitQuaternion::from_scaled_axis(turn * share) * start.world_from_base.rotation,
        );
        let mut next = Configuration { world_from_base: base, ..before.clone() };
        let there = Posture::new(robot, &next);
        for leg in robot.leg_ids() {
            let wheel = posture.wheel(robot, leg).world_from_wheel;
            let change = |q: &LegAngles| (q - before.legs[leg.0]).amax();
            let all = there.inverse_kinematics(robot, leg, &wheel).ok()?;
            let angles = all
                .iter()
                .filter(|solution| solution.within_limits)
                .map(|solution| solution.angles)
                .min_by(|a, b| change(a).total_cmp(&change(b)))?;
            if change(&angles) > 0.3 {
                return None;
            }
            next.legs[leg.0] = angles;
        }
        knots.push(next);
    }
    Some(knots)
}

/// What is nearer than it may be, by the exact survey: as near as at the start less a tenth is
/// allowed.
fn violated(now: &Survey, at_start: &Survey) -> Option<PairDistance> {
    let of = |now: &[PairDistance], before: &[PairDistance]| {
        now.iter().copied().find(|pair| {
            let was = before.iter().find(|p| p.touch == pair.touch).map(|p| p.distance);
            let required = was.map_or(pair.tolerance, |was| (0.9 * was).min(pair.tolerance));
            pair.distance <= 0.0 || pair.distance < required - 5e-5
        })
    };
    of(&now.links, &at_start.links).or_else(|| of(&now.environment, &at_start.environment))
}

/// All configurations at which brute force looks.
fn along<'a>(
    robot: &'a Robot,
    knots: &'a [Configuration],
) -> impl Iterator<Item = Configuration> + 'a {
    let legs: Vec<LegId> = robot.leg_ids().collect();
    let n = n_looks().div_ceil(PIECES);
    knots.windows(2).flat_map(move |w| {
        let legs = legs.clone();
        (0..=n).map(move |i| base_between(robot, &w[0], &w[1], &legs, i as f64 / n as f64))
    })
}

/// A box somewhere about the robot.
fn rock(rng: &mut impl Rng) -> Obstacle {
    let (yaw, far) = (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(0.2..3.2));
    let at = Vector3::new(far * yaw.cos(), far * yaw.sin(), rng.random_range(0.0..2.2));
    let turn = UnitQuaternion::from_scaled_axis(any(rng, 1.5));
    Obstacle::Box {
        world_from_box: Isometry3::from_parts(at.into(), turn),
        half_extents: any(rng, 0.25).abs().add_scalar(0.01),
    }
}

/// The athlete with a centimeter more to keep.
fn wider() -> Robot {
    let wider = |line: &str| match line.split_once("_m = ") {
        Some((key, value)) if line.starts_with(key) => {
            let value: f64 = value.split_whitespace().next().unwrap().parse().unwrap();
            format!("{key}_m = {}", value + 0.01)
        }
        _ => line.to_owned(),
    };
    robot_with("athlete", |text| {
        let (head, rest) = text.split_once("[tolerances]").unwrap();
        let (tolerances, tail) = rest.split_once("\n[").unwrap();
        let tolerances: Vec<String> = tolerances.lines().map(wider).collect();
        format!("{head}[tolerances]{}\n[{tail}", tolerances.join("\n"))
    })
}

#[test]
fn certified_shifts_are_free_at_fine_steps_and_roomy_shifts_are_certified() {
    let robot = Arc::new(athlete());
    let start = standing(&robot);
    let legs: Vec<LegId> = robot.leg_ids().collect();
    let wider = Arc::new(wider());
    assert!((wider.tolerances().pair - robot.tolerances().pair - 0.01).abs() < 1e-9);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut certified, mut blocked, mut open) = (0, 0, 0);
    let (mut roomy, mut roomy_certified) = (0, 0);
    while certified + blocked + open < 200 {
        let rocks: Vec<Obstacle> = (0..14).map(|_| rock(&mut rng)).collect();
        let here = scene(robot.clone(), &rocks);
        let at_start = survey(&here, &Posture::new(&robot, &start));
        if violated(&at_start, &at_start).is_some() {
            continue;
        }
        let (offset, turn) = (any(&mut rng, 0.2), any(&mut rng, 0.08));
        let Some(knots) = shift(&robot, &start, offset, turn) else { continue };
        let mut body = CertifiedBody::new(&here, &start, &legs);
        let answers: Vec<Certificate> =
            knots.windows(2).map(|w| body.certificate(&w[0], &w[1])).collect();
        let is_free = answers.iter().all(Certificate::is_free);
        if is_free {
            certified += 1;
            for configuration in along(&robot, &knots) {
                let now = survey(&here, &Posture::new(&robot, &configuration));
                let found = violated(&now, &at_start);
                assert!(found.is_none(), "certified, but {found:?}");
            }
        } else if let Some((i, Certificate::Blocked { share, violation })) =
            answers.iter().enumerate().find(|(_, a)| matches!(a, Certificate::Blocked { .. }))
        {
            blocked += 1;
            let there = base_between(&robot, &knots[i], &knots[i + 1], &legs, *share);
            let now = survey(&here, &Posture::new(&robot, &there));
            let near = now.links.iter().chain(&now.environment);
            let of = |pair: &&PairDistance| pair.touch == violation.touch;
            let pair = near.copied().find(|pair| of(&pair)).expect("survey sees what blocks");
            assert!(pair.distance < violation.required + 5e-5, "{violation:?}, but {pair:?}");
        } else {
            open += 1;
        }
        // Nothing nearer than a centimeter more than must be kept, all along.
        let there = scene(wider.clone(), &rocks);
        let is_roomy = along(&wider, &knots).step_by(2).all(|configuration| {
            let now = survey(&there, &Posture::new(&wider, &configuration));
            now.links.is_empty() && now.environment.is_empty()
        });
        roomy += usize::from(is_roomy);
        roomy_certified += usize::from(is_roomy && is_free);
    }
    eprintln!(
        "{certified} certified, {blocked} blocked, {open} open; {roomy_certified} of {roomy} roomy"
    );
    assert!(certified > 40 && blocked > 40, "{certified} certified, {blocked} blocked");
    assert!(roomy >= 30 && roomy_certified * 10 >= roomy * 9, "{roomy_certified} of {roomy}");
}

/// A point and what carries it.
fn any_body(robot: &Robot, rng: &mut impl Rng) -> (Option<(LegId, usize)>, LinkId) {
    let leg = LegId(rng.random_range(0..robot.legs().len()));
    let place = rng.random_range(0..robot.leg(leg).n_joints() + 1);
    match place.checked_sub(1) {
        Some(place) => (Some((leg, place)), robot.leg(leg).links[place]),
        None => (None, LinkId(0)),
    }
}

/// Motions of all kinds: shifts with all wheels planted, and joints that go anyhow, so that the wheels
/// are torn from their places and the fit leaves much.
fn any_motion(
    robot: &Robot,
    start: &Configuration,
    index: usize,
    rng: &mut impl Rng,
) -> [Configuration; 2] {
    loop {
        let (offset, turn) = (any(rng, 0.3), any(rng, 0.15));
        let Some(knots) = shift(robot, start, offset, turn) else { continue };
        let i = rng.random_range(0..PIECES);
        let (a, mut b) = (knots[i].clone(), knots[rng.random_range(i + 1..=PIECES)].clone());
        if index.is_multiple_of(3) {
            let most = rng.random_range(0.0..0.1);
            for angles in &mut b.legs {
                *angles += LegAngles::from_fn(|_, _| rng.random_range(-most..most));
            }
        }
        return [a, b];
    }
}

#[test]
fn no_point_gets_farther_than_the_bounds_say() {
    let robot = athlete();
    let start = standing(&robot);
    let chain = BodyChain::new(&robot);
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let (mut ratios, mut infinite) = (Vec::new(), 0);
    for index in 0..400 {
        let [a, b] = any_motion(&robot, &start, index, &mut rng);
        let mut legs: Vec<LegId> = robot.leg_ids().collect();
        for _ in 0..rng.random_range(0..4) {
            legs.remove(rng.random_range(0..legs.len()));
        }
        let executed = Executed::new(&robot, &a, &b, &legs);
        let half = 0.5_f64.powi(rng.random_range(1..8));
        let middle = rng.random_range(half..=1.0 - half);
        let sway = Sway::new(&chain, &executed, middle, half);
        let at = |t: f64| Posture::new(&robot, &BodyMotion::at(&executed, t));
        let postures: Vec<Posture> =
            (-20..=20).map(|i| at(middle + half * f64::from(i) / 20.0)).collect();
        let still = &postures[20];
        let (com, com_bound) = sway.center_of_mass();
        assert!((com - still.center_of_mass(&robot)).norm() < 1e-9);
        for posture in &postures {
            let moved = (posture.center_of_mass(&robot) - com).norm();
            assert!(moved <= com_bound, "center of mass: {moved} of {com_bound} m");
        }
        for _ in 0..20 {
            let (body, link) = any_body(&robot, &mut rng);
            let ends = [0, 1].map(|_| Point3::from(any(&mut rng, 0.5)));
            let radius = rng.random_range(0.0..0.3);
            let along = ends[0] + (ends[1] - ends[0]) * rng.random_range(0.0..=1.0);
            let aside = any(&mut rng, 1.0).normalize() * radius;
            let point = along + aside;
            let [p, q] = ends.map(|p| still.link(link) * p);
            let bound = sway.bound(body, [&p, &q], radius);
            let from = still.link(link) * point;
            let moved = postures
                .iter()
                .map(|posture| (posture.link(link) * point - from).norm())
                .fold(0.0, f64::max);
            assert!(moved <= bound, "{body:?}: {moved} of {bound} m, {legs:?} stand");
            if bound.is_finite() {
                ratios.push(bound / moved.max(1e-6));
            } else {
                infinite += 1;
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    eprintln!("bounds: median {median:.2} of the way, {infinite} infinite of {}", 400 * 20);
    assert!(median < 2.5, "median bound is {median} of the way");
    assert!(infinite < 800, "{infinite} bounds are infinite");
}

#[test]
fn a_wheel_that_is_torn_from_its_place_or_pressed_into_the_ground_is_refused() {
    let robot = Arc::new(athlete());
    let start = standing(&robot);
    let legs: Vec<LegId> = robot.leg_ids().collect();
    let scene = scene(robot.clone(), &[]);
    let mut certifier = BodyCertifier::new(&scene, &start, &legs);
    assert_eq!(certifier.violation(&start), None);
    let moved = |by: Vector3<f64>| {
        let base = Translation3::from(by) * start.world_from_base;
        Configuration { world_from_base: base, ..start.clone() }
    };
    let tolerance = robot.stance().ground_tolerance;
    let deep = Vector3::z() * -tolerance;
    assert_eq!(certifier.violation(&moved(deep * 1.2)), None);
    assert!(certifier.violation(&moved(deep * 1.3)).is_some());
    let aside = Vector3::x() * robot.stance().contact_radius;
    assert_eq!(certifier.violation(&moved(aside * 0.99)), None);
    assert!(certifier.violation(&moved(aside * 1.01)).is_some());
}

#[test]
fn ground_unseen_at_the_start_is_no_obstacle_and_ground_unseen_later_is() {
    let robot = Arc::new(athlete());
    let start = standing(&robot);
    let legs: Vec<LegId> = robot.leg_ids().collect();
    // The chassis reaches to 1.30 m at the start and to 1.45 m at the end.
    let knots = shift(&robot, &start, Vector3::y() * 0.15, Vector3::zeros()).unwrap();
    let is_free = |hole: Point2<f64>| {
        let level = ElevationMap::plane(20.0, 0.05).unwrap();
        let grid = *level.grid();
        let heights = Raster::from_fn(grid, |ix, iy| {
            if (grid.position(ix, iy) - hole).norm() < 0.01 { f32::NAN } else { 0.0 }
        });
        let map = ElevationMap::new(heights, Source::plane());
        let scene = Scene::new(robot.clone(), map, &[]).unwrap();
        let mut body = CertifiedBody::new(&scene, &start, &legs);
        knots.windows(2).all(|w| body.certificate(&w[0], &w[1]).is_free())
    };
    assert!(is_free(Point2::new(0.0, 0.0)), "below the chassis");
    assert!(is_free(Point2::new(0.0, 1.6)), "out of reach");
    assert!(!is_free(Point2::new(0.0, 1.45)));
}
