//! Six joints that move a wheel freely among balls and boxes: a space in which a straight edge can
//! be tested exactly.
//!
//! The first three joints are the place of the wheel, 0.5 m per radian; the last three are the
//! roll, pitch and yaw of its axle, which every turn has twice: two branches. Only the first three
//! joints meet obstacles, so that a segment against a ball or a box is the whole truth.

use motion::planner::Query;
use motion::space::{Space, WheelSpace, edge_is_sampled_free};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::LegAngles;

/// How far the wheel goes for a turn of one of the first three joints (m/rad).
pub const LEVER: f64 = 0.5;

/// Shortest piece of a certificate (rad, Euclidean).
const SHORTEST_PIECE: f64 = 1e-3;

/// An obstacle in the first three joints (rad).
#[derive(Debug, Clone, Copy)]
pub enum Solid {
    Ball { center: Vector3<f64>, radius: f64 },
    Box { center: Vector3<f64>, half: Vector3<f64> },
}

impl Solid {
    /// Distance of a point from the solid; zero inside.
    fn distance(&self, p: &Vector3<f64>) -> f64 {
        match self {
            Solid::Ball { center, radius } => ((p - center).norm() - radius).max(0.0),
            Solid::Box { center, half } => ((p - center).abs() - half).map(|d| d.max(0.0)).norm(),
        }
    }

    /// Does the segment touch the solid? Exact.
    fn meets(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        let way = b - a;
        match self {
            Solid::Ball { center, .. } => {
                let share = way.dot(&(center - a)) / way.norm_squared().max(1e-300);
                self.distance(&(a + way * share.clamp(0.0, 1.0))) <= 0.0
            }
            Solid::Box { center, half } => {
                let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
                for i in 0..3 {
                    let (low, high) = (center[i] - half[i] - a[i], center[i] + half[i] - a[i]);
                    if way[i].abs() < 1e-15 {
                        if low > 0.0 || high < 0.0 {
                            return false;
                        }
                    } else {
                        let (s, t) = (low / way[i], high / way[i]);
                        (enter, leave) = (enter.max(s.min(t)), leave.min(s.max(t)));
                    }
                }
                enter <= leave
            }
        }
    }
}

/// The space; with an `epsilon` edges are sampled, without one they are certified.
#[derive(Debug, Clone)]
pub struct Synthetic {
    pub lower: LegAngles,
    pub upper: LegAngles,
    pub solids: Vec<Solid>,
    pub epsilon: Option<f64>,
    pub n_checked: u64,
    /// What the most expensive edge cost.
    pub worst_edge: u64,
}

impl Synthetic {
    fn new(solids: Vec<Solid>) -> Synthetic {
        let upper = LegAngles::new(2.0, 2.0, 2.0, 2.5, 1.4, 2.5);
        Synthetic { lower: -upper, upper, solids, epsilon: None, n_checked: 0, worst_edge: 0 }
    }

    fn clearance(&self, q: &LegAngles) -> f64 {
        let p = q.fixed_rows::<3>(0).into_owned();
        self.solids.iter().map(|s| s.distance(&p)).fold(f64::INFINITY, f64::min)
    }

    /// The certificate: a piece is free when the clearance of its middle exceeds half its length.
    fn is_certified(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
        self.n_checked += 1;
        let middle = (a + b) * 0.5;
        let clearance = self.clearance(&middle);
        let length = (b - a).norm();
        if clearance > 0.5 * length {
            return true;
        }
        clearance > 0.0
            && length > SHORTEST_PIECE
            && self.is_certified(a, &middle)
            && self.is_certified(&middle, b)
    }

    /// The oracle: is the edge free, exactly?
    pub fn is_truly_free(&self, a: &LegAngles, b: &LegAngles) -> bool {
        let place = |q: &LegAngles| q.fixed_rows::<3>(0).into_owned();
        !self.solids.iter().any(|s| s.meets(&place(a), &place(b)))
    }

    /// The same scene with edges sampled at ε (rad, largest joint).
    pub fn sampled(mut self, epsilon: f64) -> Synthetic {
        self.epsilon = Some(epsilon);
        self
    }

    /// Is every point of the path free when looked at every `resolution` (rad)?
    pub fn is_free_by_brute_force(&self, path: &[LegAngles], resolution: f64) -> bool {
        path.windows(2).all(|w| {
            let n = ((w[1] - w[0]).amax() / resolution).ceil().max(1.0) as u32;
            (0..=n).all(|i| {
                self.clearance(&(w[0] + (w[1] - w[0]) * (f64::from(i) / f64::from(n)))) > 0.0
            })
        })
    }
}

impl Space for Synthetic {
    fn lower(&self) -> &LegAngles {
        &self.lower
    }
    fn upper(&self) -> &LegAngles {
        &self.upper
    }
    fn is_free(&mut self, q: &LegAngles) -> bool {
        assert!(*q >= self.lower && *q <= self.upper, "asked beyond the limits: {q}");
        self.n_checked += 1;
        self.clearance(q) > 0.0
    }
    fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
        let before = self.n_checked;
        let is_free = match self.epsilon {
            Some(epsilon) => {
                self.is_free(a) && self.is_free(b) && edge_is_sampled_free(self, a, b, epsilon)
            }
            None => self.is_certified(a, b),
        };
        self.worst_edge = self.worst_edge.max(self.n_checked - before);
        is_free
    }
    fn epsilon(&self) -> Option<f64> {
        self.epsilon
    }
    fn n_checked(&self) -> u64 {
        self.n_checked
    }
}

impl WheelSpace for Synthetic {
    fn wheel(&self, q: &LegAngles) -> Isometry3<f64> {
        let center = q.fixed_rows::<3>(0) * LEVER;
        Isometry3::from_parts(
            center.into_owned().into(),
            UnitQuaternion::from_euler_angles(q[3], q[4], q[5]),
        )
    }
    fn angles_at(&self, wheel: &Isometry3<f64>) -> Vec<LegAngles> {
        use std::f64::consts::PI;
        let p = wheel.translation.vector / LEVER;
        let (roll, pitch, yaw) = wheel.rotation.euler_angles();
        let wrapped = |x: f64| if x > PI { x - 2.0 * PI } else { x };
        [(roll, pitch, yaw), (wrapped(roll + PI), wrapped(PI - pitch), wrapped(yaw + PI))]
            .into_iter()
            .map(|(roll, pitch, yaw)| LegAngles::new(p.x, p.y, p.z, roll, pitch, yaw))
            .filter(|q| *q >= self.lower && *q <= self.upper)
            .collect()
    }
}

/// A query of the usual size.
pub fn query(start: LegAngles, goal: LegAngles, seed: u64) -> Query {
    Query { start, goal, seed, budget: 200_000, max_nodes: 10_000, cell: 0.2 }
}

/// Balls and boxes at random between a start and a goal that are both free.
pub fn cluttered(seed: u64) -> (Synthetic, Query) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut solids = Vec::new();
    for _ in 0..rng.random_range(6..14) {
        let center = Vector3::from_fn(|_, _| rng.random_range(-1.4..1.4));
        solids.push(if rng.random_bool(0.5) {
            Solid::Ball { center, radius: rng.random_range(0.2..0.7) }
        } else {
            Solid::Box { center, half: Vector3::from_fn(|_, _| rng.random_range(0.1..0.7)) }
        });
    }
    let space = Synthetic::new(solids);
    let mut free = |side: f64| loop {
        let unit = LegAngles::from_fn(|_, _| rng.random_range(-0.8..0.8));
        let mut q = unit.component_mul(&space.upper);
        q[0] = side * rng.random_range(0.8..1.8);
        if space.clearance(&q) > 0.02 {
            return q;
        }
    };
    let (start, goal) = (free(-1.0), free(1.0));
    (space, query(start, goal, seed))
}

/// A wall of this thickness across joint 1 with a square window of this side (rad).
pub fn window(side: f64, thickness: f64, seed: u64) -> (Synthetic, Query) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (y, z) = (rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
    let half = thickness / 2.0;
    let bar = |low: [f64; 2], high: [f64; 2]| Solid::Box {
        center: Vector3::new(0.0, (low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0),
        half: Vector3::new(half, (high[0] - low[0]) / 2.0, (high[1] - low[1]) / 2.0),
    };
    let (near, far) = ([y - side / 2.0, z - side / 2.0], [y + side / 2.0, z + side / 2.0]);
    let solids = vec![
        bar([-3.0, -3.0], [near[0], 3.0]),
        bar([far[0], -3.0], [3.0, 3.0]),
        bar([near[0], -3.0], [far[0], near[1]]),
        bar([near[0], far[1]], [far[0], 3.0]),
    ];
    let mut start = LegAngles::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let mut goal = LegAngles::from_fn(|_, _| rng.random_range(-1.0..1.0));
    (start[0], goal[0]) = (-1.2, 1.2);
    (Synthetic::new(solids), query(start, goal, seed))
}

/// A wall of this thickness without a window.
pub fn closed(thickness: f64, seed: u64) -> (Synthetic, Query) {
    let (mut space, query) = window(0.5, thickness, seed);
    let half = Vector3::new(thickness / 2.0, 3.0, 3.0);
    space.solids = vec![Solid::Box { center: Vector3::zeros(), half }];
    (space, query)
}
