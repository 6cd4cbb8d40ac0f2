//! Certificates of motions against brute force: what is called free touches nothing.

use collision::{Allowance, Certificate, Certifier, ContactZone, Keep, LegChecker, Touch};
use nalgebra::{Isometry3, Point2, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use terrain::ElevationMap;

use crate::oracle::{Oracle, PARRYS, Thing, Unknown, World};
use crate::worlds::{block, holes, load, rock, spikes, standing, thin_boxes};
use crate::{athlete, cases, plane};

/// How far the oracle looks (m).
const HORIZON: f64 = 0.2;

/// Spare that an edge needs for a certificate to be expected (m).
const ROOM: f64 = 5e-3;

/// One joint-linear motion.
type Edge = [LegAngles; 2];

/// Edges of one leg whose tightest place is about as tight as wished.
struct Finder<'o, 'w> {
    robot: &'w Robot,
    leg: LegId,
    oracle: &'o Oracle<'w>,
    allowance: Allowance<'o>,
}

impl Finder<'_, '_> {
    fn spare(&self, q: &LegAngles) -> f64 {
        self.oracle.look(q, self.allowance, HORIZON).spare
    }

    /// Between a free and a colliding configuration: one with `spare` to spare.
    fn border(&self, spare: f64, rng: &mut ChaCha8Rng) -> LegAngles {
        let mut any = |wanted: fn(f64, f64) -> bool| {
            loop {
                let index = rng.random_range(0..4);
                let q = load(self.robot, self.leg, index, rng);
                if wanted(self.spare(&q), spare) {
                    return q;
                }
            }
        };
        let (mut free, mut hit) = (any(|found, asked| found > asked), any(|found, _| found < 0.0));
        for _ in 0..40 {
            let middle = (free + hit) * 0.5;
            if self.spare(&middle) > spare { free = middle } else { hit = middle }
        }
        free
    }

    fn gradient(&self, q: &LegAngles) -> LegAngles {
        let step = 1e-3;
        LegAngles::from_fn(|j, _| {
            let mut shift = LegAngles::zeros();
            shift[j] = step;
            (self.spare(&(q + shift)) - self.spare(&(q - shift))) / (2.0 * step)
        })
    }

    /// An edge through the border, along it, moved so that its tightest place has `spare` to spare
    /// where that succeeds.
    fn edge(&self, spare: f64, rng: &mut ChaCha8Rng) -> Edge {
        let mut any = || LegAngles::from_fn(|_, _| rng.random_range(-1.0..1.0_f64));
        let (direction, sides) = (any(), any());
        let q = self.border(spare, rng);
        let gradient = self.gradient(&q);
        let steep = gradient.norm_squared();
        if steep < 1e-4 {
            return [q, q + direction * 0.1];
        }
        let mut along = direction - gradient * (gradient.dot(&direction) / steep);
        along *= 0.3 / along.amax();
        let mut edge = [q - along * sides[0].abs(), q + along * sides[1].abs()];
        for _ in 0..3 {
            let n = 20;
            let at = |i: i32| edge[0].lerp(&edge[1], f64::from(i) / f64::from(n));
            let least = (0..=n).map(|i| self.spare(&at(i))).fold(f64::INFINITY, f64::min);
            let shift = gradient * ((spare - least).clamp(-0.05, 0.05) / steep);
            edge = edge.map(|end| end + shift);
        }
        edge
    }

    /// From one side of the border to beyond it: through what is thin.
    fn through(&self, rng: &mut ChaCha8Rng) -> Edge {
        let q = self.border(1e-3, rng);
        let mut across = self.gradient(&q);
        across *= 0.2 / across.amax().max(1e-3);
        [q + across * rng.random_range(0.0..1.0), q - across * rng.random_range(0.0..1.0)]
    }
}

/// How many edges were what.
#[derive(Debug, Default)]
struct Tally {
    edges: usize,
    certified: usize,
    /// Truly free with less than 2 mm to spare, and of these the certified ones.
    tight: usize,
    tight_certified: usize,
    /// Truly free with [`ROOM`] or more to spare, and of these the certified ones.
    roomy: usize,
    roomy_certified: usize,
    touching: usize,
}

impl Tally {
    fn add(&mut self, other: &Tally) {
        self.edges += other.edges;
        self.certified += other.certified;
        self.tight += other.tight;
        self.tight_certified += other.tight_certified;
        self.roomy += other.roomy;
        self.roomy_certified += other.roomy_certified;
        self.touching += other.touching;
    }
}

/// Certifies one edge and looks at it by brute force.
fn hold(
    name: &str,
    certifier: &mut Certifier,
    oracle: &Oracle,
    edge: &Edge,
    allowance: Allowance,
    tally: &mut Tally,
) {
    let [a, b] = edge;
    let said = certifier.certify(a, b, allowance);
    let (share, found) = oracle.least_on_the_way(a, b, allowance, HORIZON);
    if said.is_free() {
        assert!(
            found.spare >= -PARRYS,
            "{name}: called free, but {found:?} at {share} of {a} to {b}"
        );
        assert!(found.unknown < Unknown::Surely, "{name}: called free over unknown ground");
    }
    if let Certificate::Blocked { share, violation } = said {
        let q = a.lerp(b, share);
        let there = oracle.look(&q, allowance, HORIZON);
        let unknown = matches!(violation.touch, Touch::UnknownGround(_));
        let holds = if unknown { there.unknown > Unknown::No } else { there.spare <= PARRYS };
        assert!(holds, "{name}: {violation:?}, but {there:?} at {share} of {a} to {b}");
    }
    let free = said.is_free();
    tally.edges += 1;
    tally.certified += usize::from(free);
    if found.unknown > Unknown::No {
        return;
    }
    let (tight, roomy) = ((PARRYS..2e-3).contains(&found.spare), found.spare >= ROOM);
    tally.tight += usize::from(tight);
    tally.tight_certified += usize::from(tight && free);
    tally.roomy += usize::from(roomy);
    tally.roomy_certified += usize::from(roomy && free);
    tally.touching += usize::from(found.spare < -PARRYS);
}

fn exactly() -> Keep {
    Keep { environment: Some(0.0), pairs: Some(0.0), ..Keep::default() }
}

fn spiky(n: usize, rng: &mut ChaCha8Rng) -> ElevationMap {
    spikes(Point2::new(-1.5, -2.5), Point2::new(4.0, 2.5), n, rng)
}

fn boxes(rng: &mut ChaCha8Rng) -> Vec<Thing> {
    thin_boxes(14, Vector3::new(2.3, 0.0, 1.0), rng)
}

/// The legs beside the first one reach over to it.
fn crowded(base: &Configuration) -> Configuration {
    let mut base = base.clone();
    base.legs[1][0] -= 0.5;
    base.legs[5][0] += 0.6;
    base
}

/// `n` edges of each kind in one world.
fn adversarial(name: &str, world: &World, base: &Configuration, keep: &Keep, n: usize) -> Tally {
    let robot = world.robot();
    let leg = LegId(0);
    let posture = Posture::new(robot, base);
    let checker = LegChecker::keeping(&world.scene, &posture, leg, keep.clone());
    let oracle = Oracle::new(world, &posture, leg, keep.clone());
    let allowance = Allowance { zone: None, buffered: keep.obstacle_buffer > 0.0 };
    let finder = Finder { robot, leg, oracle: &oracle, allowance };
    let mut certifier = Certifier::new(&checker);
    let mut rng = ChaCha8Rng::seed_from_u64(name.bytes().map(u64::from).sum());
    let mut tally = Tally::default();
    for index in 0..n {
        let edge = match index % 6 {
            0..2 => finder.edge(rng.random_range(0.0..2e-3), &mut rng),
            // Touching by so little that only a short piece of the way touches.
            2 => finder.edge(rng.random_range(-1e-3..-1e-4), &mut rng),
            3 => finder.through(&mut rng),
            _ => finder.edge(rng.random_range(ROOM..0.03), &mut rng),
        };
        hold(name, &mut certifier, &oracle, &edge, allowance, &mut tally);
    }
    eprintln!("{name}: {tally:?}");
    tally
}

#[test]
fn certified_edges_hold_against_brute_force() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut up = standing(&robot);
    up.world_from_base.translation.z += 0.3;
    let spiky_world = World::new(robot.clone(), spiky(800, &mut rng), boxes(&mut rng));
    let rocks = [(2.3, 0.6, 0.2), (1.8, -0.9, 0.5), (2.9, -0.2, 0.1)]
        .map(|(x, y, z)| rock(Vector3::new(x, y, z), 0.35, &mut rng));
    let rocky_world = World::new(robot.clone(), plane(), rocks.to_vec());
    let crowd = crowded(&up);
    let n = cases(200, 2_500);
    let buffered =
        Keep { inflation: 0.01, obstacle_buffer: 0.05, terrain_lift: 0.1, ..Keep::default() };
    let mut all = Tally::default();
    for (name, world, base, keep) in [
        ("spikes and thin boxes, exactly", &spiky_world, &up, exactly()),
        ("spikes and thin boxes", &spiky_world, &crowd, Keep::default()),
        ("rocks and legs, exactly", &rocky_world, &crowd, exactly()),
        ("rocks, with buffers", &rocky_world, &up, buffered),
    ] {
        all.add(&adversarial(name, world, base, &keep, n));
    }
    let share = all.roomy_certified as f64 / all.roomy as f64;
    eprintln!("{:.2} % of {} free edges with 5 mm to spare certified", share * 100.0, all.roomy);
    assert!(all.tight * 10 > all.edges && all.touching * 10 > all.edges, "{all:?}: no evidence");
    assert!(all.roomy * 10 > all.edges && share >= 0.95, "{all:?}");
}

/// Known and free at one end, over unknown ground or beside the map by a little at the other end,
/// and nothing in between; `None` where something else is in the way.
fn over_the_brink(finder: &Finder, overshoot: f64, rng: &mut ChaCha8Rng) -> Option<Edge> {
    let look = |q: &LegAngles| finder.oracle.look(q, finder.allowance, HORIZON);
    let surely = |q: &LegAngles| look(q).unknown == Unknown::Surely;
    let index = rng.random_range(0..4);
    let from = load(finder.robot, finder.leg, index, rng);
    let way = LegAngles::from_fn(|_, _| rng.random_range(-0.6..0.6));
    let room = |q: &LegAngles| look(q).spare > 0.02;
    if surely(&from) || !surely(&(from + way)) || !room(&from) || !room(&(from + way)) {
        return None;
    }
    let (mut known, mut unknown) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (known + unknown);
        if surely(&(from + way * middle)) { unknown = middle } else { known = middle }
    }
    let back = rng.random_range(0.0..0.3);
    let size = way.amax();
    Some([from + way * (unknown - back / size), from + way * (unknown + overshoot / size)])
}

#[test]
fn no_edge_over_unknown_ground_or_beyond_the_map_is_free() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut base = standing(&robot);
    base.world_from_base.translation.z += 0.4;
    let posture = Posture::new(&robot, &base);
    let leg = LegId(0);
    let n = cases(15, 1_000);
    for (name, map) in [
        ("holes", holes(4.5, 70, &mut rng)),
        ("edge", ElevationMap::plane(2.5, 0.5).unwrap()),
        ("fine edge", ElevationMap::plane(2.4, 0.05).unwrap()),
    ] {
        let world = World::new(robot.clone(), map, vec![]);
        for keep in [Keep::default(), exactly()] {
            let checker = LegChecker::keeping(&world.scene, &posture, leg, keep.clone());
            let oracle = Oracle::new(&world, &posture, leg, keep);
            let allowance = Allowance::default();
            let finder = Finder { robot: &robot, leg, oracle: &oracle, allowance };
            let mut certifier = Certifier::new(&checker);
            let mut tally = Tally::default();
            let mut found = 0;
            while found < n {
                let overshoot = 10.0_f64.powf(rng.random_range(-4.0..-1.0));
                let Some(edge) = over_the_brink(&finder, overshoot, &mut rng) else { continue };
                found += 1;
                hold(name, &mut certifier, &oracle, &edge, allowance, &mut tally);
                let back = [edge[1], edge[0]];
                hold(name, &mut certifier, &oracle, &back, allowance, &mut tally);
            }
            assert_eq!(tally.certified, 0, "{name}: {tally:?}");
        }
    }
}

/// A leg that stands, and the zone about its wheel.
struct Stand {
    posture: Posture,
    angles: LegAngles,
    zone: ContactZone,
}

/// Standing in the bent pose with the wheels `depth` (m) in level ground.
fn stand(robot: &Robot, leg: LegId, depth: f64) -> Stand {
    let mut base = standing(robot);
    base.world_from_base.translation.z -= depth;
    let posture = Posture::new(robot, &base);
    let wheel = posture.wheel(robot, leg);
    let rules = robot.stance();
    let zone = ContactZone {
        contact: wheel.lowest_point(&Vector3::z_axis()),
        center: wheel.center(),
        radius: rules.contact_radius,
        height: rules.contact_height,
        ground_tolerance: rules.ground_tolerance,
    };
    Stand { posture, angles: base.legs[leg.0], zone }
}

impl Stand {
    /// The wheel moved by `shift` (m), turned by `yaw` (rad), by the nearest branch.
    fn moved(&self, robot: &Robot, leg: LegId, shift: Vector3<f64>, yaw: f64) -> Option<LegAngles> {
        let wheel = self.posture.wheel(robot, leg).world_from_wheel;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let goal =
            Isometry3::from_parts((wheel.translation.vector + shift).into(), turn * wheel.rotation);
        let branches = self.posture.inverse_kinematics(robot, leg, &goal).ok()?;
        let off = |q: &LegAngles| (q - self.angles).amax();
        let angles = branches.iter().map(|branch| branch.angles);
        angles.min_by(|a, b| off(a).total_cmp(&off(b))).filter(|q| off(q) < 0.8)
    }
}

#[test]
fn lifts_from_the_ground_hold_against_brute_force() {
    let robot = athlete();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let leg = LegId(0);
    // A block so near to the standing wheel that only the zone allows it.
    let beside = |at: &ContactZone| {
        let (half, aside) = (Vector3::repeat(0.1), 0.12 + 0.1 + 0.015);
        let center = Vector3::new(at.contact.x, at.contact.y + aside, 0.01 - half.z);
        block(center, Vector3::zeros(), half)
    };
    let mut tally = Tally::default();
    let mut pressed = 0;
    for round in 0..cases(8, 100) {
        let tolerance = robot.stance().ground_tolerance;
        let depth = rng.random_range(-0.5..1.0) * tolerance;
        let stand = stand(&robot, leg, depth);
        let things = if round % 2 == 0 { vec![] } else { vec![beside(&stand.zone)] };
        let world = World::new(robot.clone(), plane(), things);
        let keep = Keep::default();
        let checker = LegChecker::keeping(&world.scene, &stand.posture, leg, keep.clone());
        let oracle = Oracle::new(&world, &stand.posture, leg, keep);
        let allowance = Allowance { zone: Some(&stand.zone), buffered: false };
        let mut certifier = Certifier::new(&checker);
        for kind in 0..10 {
            let up = rng.random_range(0.01..0.3);
            let mut aside =
                || Vector3::new(rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2), 0.0);
            // Straight up; up and aside; down into the ground.
            let shift = match kind {
                0..4 => Vector3::z() * up,
                4..8 => Vector3::z() * up + aside(),
                _ => aside() * 0.2 - Vector3::z() * 0.3 * up,
            };
            let yaw = if kind % 2 == 0 { 0.0 } else { rng.random_range(-0.2..0.2) };
            let Some(to) = stand.moved(&robot, leg, shift, yaw) else { continue };
            let edge = [stand.angles, to];
            let before = tally.certified;
            hold("lifts", &mut certifier, &oracle, &edge, allowance, &mut tally);
            let free = tally.certified > before;
            if kind >= 8 && 0.3 * up + depth > 1.3 * tolerance {
                pressed += 1;
                assert!(!free, "pressed into the ground, but free");
            }
        }
    }
    eprintln!("lifts: {tally:?}");
    assert!(pressed > 5 && tally.roomy > 20, "{tally:?}: no evidence");
    assert!(tally.roomy_certified * 20 >= tally.roomy * 19, "{tally:?}");
}

#[test]
fn raised_ground_stays_as_it_is_under_start_and_goal() {
    let robot = athlete();
    let leg = LegId(0);
    let stand = stand(&robot, leg, 0.0);
    let world = World::new(robot.clone(), plane(), vec![]);
    let goal_shift = Vector3::new(0.05, 0.4, 0.0);
    let start = stand.zone.center.xy();
    let keep = Keep {
        terrain_lift: 0.15,
        footfalls: vec![start, start + goal_shift.xy()],
        ..Keep::default()
    };
    let checker = LegChecker::keeping(&world.scene, &stand.posture, leg, keep.clone());
    let oracle = Oracle::new(&world, &stand.posture, leg, keep);
    let mut certifier = Certifier::new(&checker);
    let raised = Allowance { zone: None, buffered: true };
    let at = |aside: Vector3<f64>, up: f64| {
        stand.moved(&robot, leg, aside + Vector3::z() * up, 0.0).unwrap()
    };
    let aside = Vector3::new(0.0, 0.2, 0.0);
    for (place, low_is_free) in [(Vector3::zeros(), true), (goal_shift, true), (aside, false)] {
        let low = certifier.certify(&at(place, 0.04), &at(place, 0.12), raised);
        assert_eq!(low.is_free(), low_is_free, "{place}: {low:?}");
        let high = certifier.certify(&at(place, 0.19), &at(place, 0.25), raised);
        assert!(high.is_free(), "{place}: {high:?}");
    }
    // With the zone of the start: from the ground up.
    let zoned = Allowance { zone: Some(&stand.zone), buffered: true };
    let lift = certifier.certify(&stand.angles, &at(Vector3::zeros(), 0.1), zoned);
    assert!(lift.is_free(), "{lift:?}");

    // Anywhere about and between the footfalls.
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut tally = Tally::default();
    for _ in 0..cases(30, 2_000) {
        let mut place = || {
            let between = goal_shift * rng.random_range(-0.5..1.5);
            let off = Vector3::new(rng.random_range(-0.2..0.2), 0.0, 0.0);
            between + off + Vector3::z() * rng.random_range(0.01..0.3)
        };
        let [a, b] = [place(), place()].map(|at| stand.moved(&robot, leg, at, 0.0));
        let (Some(a), Some(b)) = (a, b) else { continue };
        hold("raised", &mut certifier, &oracle, &[a, b], raised, &mut tally);
        hold("raised, zone", &mut certifier, &oracle, &[a, b], zoned, &mut tally);
    }
    eprintln!("raised: {tally:?}");
    assert!(tally.certified > 10 && tally.touching > 10, "{tally:?}: no evidence");
}
