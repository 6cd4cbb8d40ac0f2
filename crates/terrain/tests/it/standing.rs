//! A wheel that stands is room without ground: held against points of its solid, by number.

use std::sync::Arc;

use nalgebra::{Point2, Point3, Rotation3, Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::fusion::{
    Alignment, Flags, Input, MapSettings, MapVersion, Mapper, PairCell, PairDem, ReadPolicy,
    StandingWheel,
};
use terrain::{ElevationMap, Source};

const C: f64 = 0.05;
const N: i32 = 24;
const S: i64 = 1_000_000_000;

fn wheel(rng: &mut ChaCha8Rng, tilt: f64, ball: bool) -> StandingWheel {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(-4.0..4.0))
        * Rotation3::from_axis_angle(&Vector3::x_axis(), tilt);
    let place = |rng: &mut ChaCha8Rng| rng.random_range(-0.1..0.1);
    StandingWheel {
        center_m: Point3::new(place(rng), place(rng), 0.264),
        axle: turn * Vector3::y_axis(),
        radius_m: 0.264,
        width_m: 0.24,
        ball,
    }
}

/// Points of the wheel's solid: from its middle to its skin, drawn in its own frame.
fn points(wheel: &StandingWheel, n: usize, rng: &mut ChaCha8Rng) -> Vec<Point3<f64>> {
    let across = wheel.axle.cross(&Vector3::new(0.3, 0.5, 0.81)).normalize();
    let third = wheel.axle.cross(&across);
    // Half of them on the skin.
    let share = |i: usize, inside: f64| if i % 6 < 3 { inside } else { 1.0 };
    (0..n)
        .map(|i| {
            let within = rng.random::<f64>().sqrt();
            if wheel.ball {
                let mut v = || rng.random_range(-1.0..1.0_f64);
                let v = Vector3::new(v(), v(), v()).normalize();
                return wheel.center_m + v * wheel.radius_m * share(i, within);
            }
            let angle = rng.random_range(0.0..std::f64::consts::TAU);
            let along = match i % 3 {
                0 => rng.random_range(-0.5..0.5),
                1 => 0.5,
                _ => -0.5,
            };
            wheel.center_m
                + wheel.axle.into_inner() * along * wheel.width_m
                + (across * angle.cos() + third * angle.sin()) * wheel.radius_m * share(i, within)
        })
        .collect()
}

/// What is told of square ground, by lattice index; NaN for nothing.
fn told(height: impl Fn(i32, i32) -> f64) -> Mapper {
    let nodes = (-N..=N).flat_map(|iy| (-N..=N).map(move |ix| (ix, iy)));
    let cells = nodes.map(|(ix, iy)| PairCell {
        height_m: height(ix, iy) as f32,
        variance_m2: 4e-4,
        count: 5,
        ..PairCell::EMPTY
    });
    let dem = PairDem::new(C, [-N, -N], 2 * N as usize + 1, cells.collect()).unwrap();
    let mut mapper =
        Mapper::new(MapSettings { resolution_m: C, ..MapSettings::default() }).unwrap();
    let pair = |dem| Input::Pair { source: 0, dem, time_ns: S, alignment: Alignment::NONE };
    mapper.push(pair(Arc::new(dem))).unwrap();
    mapper
}

fn stood(wheel: StandingWheel, most_m: f64) -> Input {
    Input::Stood { source: 1, wheel, most_m, variance_m2: 1e-4, time_ns: 2 * S }
}

fn read(map: &MapVersion) -> ElevationMap {
    map.elevation(ReadPolicy::default(), 3 * S, 1e9, Source::file("test")).unwrap().map
}

/// How deep points are below the ground, at most (m).
fn depth(map: &ElevationMap, points: &[Point3<f64>]) -> f64 {
    let depths = points.iter().filter_map(|p| Some(map.height_at(p.xy())? - p.z));
    depths.fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn no_point_of_a_standing_wheel_is_below_the_ground_and_ground_beside_it_stays() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let (mut n_reached, mut n_lowered) = (0, 0);
    for case in 0..60 {
        let tilt = [0.0, 0.02, 0.2, -0.4, 1.2][case % 5];
        let ball = case % 6 == 5;
        let mut wheel = wheel(&mut rng, tilt, ball);
        let slope = [rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3)];
        let noise: Vec<f64> =
            (0..4 * N * N + 4 * N + 1).map(|_| rng.random_range(0.0..0.08)).collect();
        let mapper = told(|ix, iy| {
            let noise = noise[((iy + N) * (2 * N + 1) + ix + N) as usize];
            // A hole here and there.
            let noise = if noise < 0.002 { f64::NAN } else { noise };
            C * (slope[0] * f64::from(ix) + slope[1] * f64::from(iy)) + noise
        });
        let solid = points(&wheel, 40_000, &mut rng);
        // Put down until it is some centimeters in the ground.
        let down = -depth(&read(mapper.version()), &solid) + rng.random_range(0.0..0.1);
        wheel.center_m.z -= down;
        let solid: Vec<Point3<f64>> = solid.iter().map(|p| p - Vector3::z() * down).collect();
        let before = mapper.version().clone();
        n_reached += usize::from(depth(&read(&before), &solid) > 1e-3);

        let mut mapper = mapper;
        mapper.push(stood(wheel, 10.0)).unwrap();
        let after = mapper.version();
        assert!(wheel.reached_into(after).is_none_or(|(_, over)| over < 1e-6));
        let depth = depth(&read(after), &solid);
        assert!(depth < 1e-6, "case {case}: {depth} m of the ground in the wheel");
        let lowest = solid.iter().fold(f64::INFINITY, |z, p| z.min(p.z));
        for (ix, iy) in (-N..=N).flat_map(|iy| (-N..=N).map(move |ix| (ix, iy))) {
            let (old, new) = (before.cell([ix, iy]), after.cell([ix, iy]));
            if old.height_m.to_bits() == new.height_m.to_bits() {
                assert_eq!(old.variance_m2.to_bits(), new.variance_m2.to_bits());
                continue;
            }
            n_lowered += 1;
            assert!(new.height_m < old.height_m, "ground is lowered, not raised");
            assert!(f64::from(new.height_m) > lowest - 2e-3, "nowhere below the wheel as a whole");
            assert_eq!((new.flags, new.variance_m2), (Flags::CONTACT, 1e-4));
            // One of the six triangles about the node has a point of the wheel above it.
            let slack = 1.05;
            let is_about = |p: &Point3<f64>| {
                let d = (p.xy() - Point2::new(f64::from(ix), f64::from(iy)) * C) / C;
                d.x.abs() < slack && d.y.abs() < slack && (d.x + d.y).abs() < slack
            };
            assert!(solid.iter().any(is_about), "case {case}: ({ix}, {iy}) is not below the wheel");
        }
    }
    assert!(n_reached > 50 && n_lowered > 600, "{n_reached} {n_lowered}");
}

#[test]
fn ground_that_a_wheel_only_touches_stays_as_it_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    for case in 0..20 {
        let mut wheel = wheel(&mut rng, [0.0, 0.1][case % 2], case % 4 == 3);
        let solid = points(&wheel, 200_000, &mut rng);
        // The lowest of so many points is up to 0.1 mm above the lowest of all.
        wheel.center_m.z += 3e-4 - solid.iter().fold(f64::INFINITY, |z, p| z.min(p.z));
        let mut mapper = told(|_, _| 0.0);
        let before = mapper.version().id();
        mapper.push(stood(wheel, 0.15)).unwrap();
        assert_eq!(mapper.version().id(), before, "case {case}");
    }
}

#[test]
fn what_is_much_too_high_is_left_and_told() {
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let mut wheel = wheel(&mut rng, 0.0, false);
    wheel.center_m = Point3::new(0.01, 0.01, 0.264);
    let mut mapper = told(|ix, iy| if [ix, iy] == [0, 0] { 0.2 } else { 0.1 });
    let (at, over) = wheel.reached_into(mapper.version()).unwrap();
    assert_eq!(at, [0, 0]);
    assert!((over - 0.2).abs() < 5e-3, "{over}");
    mapper.push(stood(wheel, 0.15)).unwrap();
    assert_eq!(mapper.version().cell([0, 0]).height_m, 0.2);
    assert!(mapper.version().cell([1, 0]).height_m < 0.01);
    assert_eq!(wheel.reached_into(mapper.version()).unwrap().0, [0, 0]);
}

#[test]
fn of_two_heights_that_contradict_each_other_the_one_in_the_wheel_is_out() {
    let mut rng = ChaCha8Rng::seed_from_u64(34);
    let mut wheel = wheel(&mut rng, 0.0, false);
    wheel.center_m = Point3::new(0.0, 0.0, 0.264);
    for (first, second) in [(0.3, -0.01), (-0.01, 0.3), (0.2, 0.4), (-0.2, -0.4)] {
        let mut mapper = told(|_, _| first);
        let one =
            PairCell { height_m: second as f32, variance_m2: 4e-4, count: 5, ..PairCell::EMPTY };
        let dem = Arc::new(PairDem::new(C, [0, 0], 1, vec![one]).unwrap());
        let pair = Input::Pair { source: 7, dem, time_ns: S, alignment: Alignment::NONE };
        mapper.push(pair).unwrap();
        assert!(mapper.version().cell([0, 0]).flags.any(Flags::CONFLICT));
        mapper.push(stood(wheel, 0.15)).unwrap();
        let cell = mapper.version().cell([0, 0]);
        let height = MapVersion::read(&cell, ReadPolicy::default());
        let is_decided = (first > 0.0) != (second > 0.0);
        assert_eq!(height.is_nan(), !is_decided, "{first} {second}");
        if is_decided {
            assert_eq!((height, cell.source), (-0.01, u32::from(first > 0.0) * 7));
        }
    }
}

#[test]
fn a_wheel_that_cannot_be_is_refused_by_name() {
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let good = wheel(&mut rng, 0.0, false);
    let bad = |mend: &dyn Fn(&mut StandingWheel)| {
        let mut wheel = good;
        mend(&mut wheel);
        told(|_, _| 0.0).push(stood(wheel, 0.15)).unwrap_err().to_string()
    };
    assert!(bad(&|w| w.radius_m = f64::NAN).contains("radius_m"));
    assert!(bad(&|w| w.width_m = 1e9).contains("width_m"));
    assert!(bad(&|w| w.center_m.y = f64::INFINITY).contains("center_m.y"));
    assert!(bad(&|w| w.axle = Unit::new_unchecked(Vector3::zeros())).contains("axle"));
    let most = told(|_, _| 0.0).push(stood(good, -1.0)).unwrap_err().to_string();
    assert!(most.contains("most_m"), "{most}");
}
