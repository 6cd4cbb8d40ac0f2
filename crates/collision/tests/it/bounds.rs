//! The checker's verdict of a configuration against the plain check of every pair.

use collision::{Allowance, Keep, LegChecker, Touch};
use nalgebra::{Point2, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegId, Posture};
use terrain::formats::{ReadOptions, read_named};
use terrain::synthetic::{Recipe, generate};

use crate::oracle::{Oracle, PARRYS, Unknown, World};
use crate::worlds::{block, holes, load, rock, spikes, standing, thin_boxes, with_payload};
use crate::{athlete, cases, plane};

/// How many configurations were what.
#[derive(Debug, Default)]
struct Tally {
    free: usize,
    blocked: usize,
    unknown: usize,
    /// Within parry's error of the border.
    border: usize,
}

/// `n` configurations of a leg: no false free, no false blocked.
fn hold(
    name: &str,
    world: &World,
    base: &Configuration,
    (leg, keep): (LegId, Keep),
    n: usize,
) -> Tally {
    let robot = world.robot();
    let posture = Posture::new(robot, base);
    let checker = LegChecker::keeping(&world.scene, &posture, leg, keep.clone());
    let oracle = Oracle::new(world, &posture, leg, keep);
    let mut rng = ChaCha8Rng::seed_from_u64(name.bytes().map(u64::from).sum());
    let mut tally = Tally::default();
    for index in 0..n {
        let q = load(robot, leg, index, &mut rng);
        let allowance = Allowance { zone: None, buffered: index % 3 == 0 };
        let said = checker.violation_at(&q, allowance);
        let found = oracle.look(&q, allowance, 0.01);
        match &said {
            None => {
                assert!(found.unknown < Unknown::Surely, "{name}: free over unknown ground: {q}");
                assert!(found.spare >= -PARRYS, "{name}: called free, but {found:?} at {q}");
                tally.free += 1;
            }
            Some(violation) if matches!(violation.touch, Touch::UnknownGround(_)) => {
                assert!(found.unknown > Unknown::No, "{name}: {violation:?} over known ground");
                tally.unknown += 1;
            }
            Some(violation) => {
                assert!(
                    found.spare <= PARRYS,
                    "{name}: {violation:?}, but {} m to spare at {q}",
                    found.spare
                );
                tally.blocked += 1;
            }
        }
        tally.border += usize::from(found.spare.abs() <= PARRYS);
    }
    eprintln!("{name}: {n} configurations, {tally:?}");
    assert!(tally.border * 100 < n.max(1000), "{name}: {tally:?} is no evidence");
    tally
}

fn seen(tally: &Tally) {
    assert!(tally.free > 50 && tally.blocked > 50, "{tally:?} is no evidence");
}

/// Configurations of each world: eight worlds.
fn share() -> usize {
    cases(2_500, 125_000)
}

/// Standing, then moved up (m) and leaning (rad).
fn raised(up: f64, lean: [f64; 2]) -> Configuration {
    let mut base = standing(&athlete());
    base.world_from_base.translation.z += up;
    base.world_from_base.rotation = UnitQuaternion::from_euler_angles(lean[0], lean[1], 0.4);
    base
}

fn exactly() -> Keep {
    Keep { environment: Some(0.0), pairs: Some(0.0), ..Keep::default() }
}

#[test]
fn verdicts_on_level_ground_are_those_of_every_pair() {
    let world = World::new(athlete(), plane(), vec![]);
    let base = raised(0.1, [0.0, 0.0]);
    seen(&hold("plane", &world, &base, (LegId(0), Keep::default()), share()));
}

#[test]
fn verdicts_on_a_boulder_field_are_those_of_every_pair() {
    let map = generate(&Recipe { flat_center_m: 0.0, ..Recipe::boulder_field() }, 7).unwrap();
    let world = World::new(athlete(), map, vec![]);
    let base = raised(0.35, [0.1, -0.05]);
    seen(&hold("boulders", &world, &base, (LegId(2), Keep::default()), share() / 2));
    seen(&hold("boulders, exactly", &world, &base, (LegId(4), exactly()), share() / 2));
}

#[test]
fn verdicts_among_spikes_are_those_of_every_pair() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let map = spikes(Point2::new(-1.5, -2.5), Point2::new(4.0, 2.5), 600, &mut rng);
    let world = World::new(athlete(), map, vec![]);
    let mut base = standing(&athlete());
    base.world_from_base.translation.z += 0.3;
    seen(&hold("spikes", &world, &base, (LegId(0), Keep::default()), share() / 2));
    seen(&hold("spikes, exactly", &world, &base, (LegId(0), exactly()), share() / 2));
}

#[test]
fn verdicts_among_boxes_are_those_of_every_pair() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let around = Vector3::new(2.2, 0.0, 1.0);
    let mut things = thin_boxes(12, around, &mut rng);
    things.push(block(Vector3::new(2.4, 0.8, 0.4), Vector3::zeros(), Vector3::repeat(0.4)));
    let world = World::new(athlete(), plane(), things);
    let base = raised(0.3, [0.0, 0.0]);
    let footfalls = vec![Point2::new(2.2, 0.0), Point2::new(2.3, 0.3)];
    let keep = Keep {
        inflation: 0.01,
        obstacle_buffer: 0.07,
        terrain_lift: 0.15,
        footfalls,
        ..Keep::default()
    };
    seen(&hold("boxes", &world, &base, (LegId(0), keep), share() / 2));
    seen(&hold("boxes, exactly", &world, &base, (LegId(0), exactly()), share() / 2));
}

#[test]
fn verdicts_among_rocks_are_those_of_every_pair() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let at = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    let places = [(2.3, 0.6, 0.2), (1.8, -0.9, 0.5), (2.9, -0.2, 0.1), (1.9, 0.1, 1.6)];
    let things = places.map(|(x, y, z)| rock(at(x, y, z), 0.35, &mut rng)).to_vec();
    let world = World::new(athlete(), plane(), things);
    let base = raised(0.3, [0.0, 0.0]);
    seen(&hold("rocks", &world, &base, (LegId(0), Keep::default()), share() / 2));
    seen(&hold("rocks, exactly", &world, &base, (LegId(0), exactly()), share() / 2));
}

#[test]
fn verdicts_beside_other_legs_and_a_payload_are_those_of_every_pair() {
    let robot = with_payload(&athlete());
    let world = World::new(robot.clone(), plane(), vec![]);
    let mut base = raised(0.6, [0.05, 0.1]);
    base.legs[2][0] += 0.7;
    base.legs[4][0] -= 0.6;
    base.legs[4][2] -= 0.6;
    seen(&hold("legs", &world, &base, (LegId(3), Keep::default()), share() / 2));
    seen(&hold("legs, exactly", &world, &base, (LegId(3), exactly()), share() / 2));
}

#[test]
fn verdicts_over_holes_and_at_the_maps_edge_are_those_of_every_pair() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let world = World::new(athlete(), holes(3.2, 20, &mut rng), vec![]);
    let base = raised(0.3, [0.0, 0.0]);
    for (leg, keep) in [(LegId(0), Keep::default()), (LegId(5), exactly())] {
        let tally = hold("holes", &world, &base, (leg, keep), share() / 2);
        assert!(tally.unknown > 50 && tally.free > 20, "{tally:?} is no evidence");
    }
}

#[test]
fn verdicts_on_the_fractal_terrain_are_those_of_every_pair() {
    let test = "verdicts_on_the_fractal_terrain_are_those_of_every_pair";
    let name = "fractal_terrain_1.off";
    let Some(bytes) = testkit::shared_data(test, &format!("klampt_terrains/{name}")) else {
        return;
    };
    let map = read_named(name, &bytes, &ReadOptions::default()).unwrap();
    let middle = Point2::new(10.0, 10.0);
    let ground = map.height_at(middle).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let center = Vector3::new(12.2, 10.3, ground + 0.2);
    let world = World::new(athlete(), map, vec![rock(center, 0.5, &mut rng)]);
    let mut base = raised(0.3 + ground, [0.0, 0.0]);
    base.world_from_base.translation.x = middle.x;
    base.world_from_base.translation.y = middle.y;
    for leg in [0, 3] {
        let name = format!("fractal terrain, leg {leg}");
        seen(&hold(&name, &world, &base, (LegId(leg), Keep::default()), share() / 2));
    }
}
