//! SBL in 1000 seeded scenes: what it calls a path is free at its own resolution.

use collision::{LegChecker, Obstacle, Scene};
use motion::Unwatched;
use motion::planner::{Query, SearchOutcome};
use motion::sbl::plan;
use motion::space::{Space, distance, edge_is_sampled_free};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegAngles, LegId, Posture, Robot};

use crate::{loaded, scene, standing};

/// Resolution of the edges (rad, largest joint).
const EPSILON: f64 = 0.01;

/// The leg's space straight from the checker, without the planner's own adapter.
struct Plain<'a> {
    robot: &'a Robot,
    checker: LegChecker<'a>,
    posture: Posture,
    n_checked: u64,
}

impl Space for Plain<'_> {
    fn lower(&self) -> &LegAngles {
        &self.robot.leg(self.checker.leg()).lower
    }
    fn upper(&self) -> &LegAngles {
        &self.robot.leg(self.checker.leg()).upper
    }
    fn is_free(&mut self, q: &LegAngles) -> bool {
        self.n_checked += 1;
        self.posture.move_leg(self.robot, self.checker.leg(), q);
        self.checker.violation(&self.posture, None).is_none()
    }
    fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
        edge_is_sampled_free(self, a, b, EPSILON)
    }
    fn epsilon(&self) -> Option<f64> {
        Some(EPSILON)
    }
    fn n_checked(&self) -> u64 {
        self.n_checked
    }
}

fn rocks(rng: &mut ChaCha8Rng) -> Vec<Obstacle> {
    (0..rng.random_range(1..4))
        .map(|_| {
            let bearing: f64 = rng.random_range(-0.8..0.8);
            let radius = rng.random_range(1.9..3.0);
            let size = rng.random_range(0.1..0.35);
            Obstacle::Box {
                world_from_box: Isometry3::from_parts(
                    Vector3::new(radius * bearing.cos(), radius * bearing.sin(), 0.7 * size).into(),
                    UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.1, bearing)),
                ),
                half_extents: Vector3::new(size, size, size),
            }
        })
        .collect()
}

#[test]
fn every_path_of_a_thousand_scenes_is_free_at_its_own_resolution() {
    let robot = loaded();
    let start = standing(&robot);
    let at_rest = Posture::new(&robot, &start);
    let leg = LegId(0);
    let (mut found, mut crooked, mut scenes) = (0, 0, 0);
    let mut seed = 0;
    while scenes < 1000 {
        seed += 1;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let scene: Scene = scene(robot.clone(), &rocks(&mut rng));
        let mut space = Plain {
            robot: &robot,
            checker: LegChecker::new(&scene, &at_rest, leg, None, None),
            posture: at_rest.clone(),
            n_checked: 0,
        };
        let mut free = || {
            (0..60)
                .map(|_| start.legs[0] + LegAngles::from_fn(|_, _| rng.random_range(-0.8..0.8)))
                .find(|q| *q >= *space.lower() && *q <= *space.upper() && space.is_free(q))
        };
        let (Some(from), Some(to)) = (free(), free()) else { continue };
        scenes += 1;
        let (budget, max_nodes) = (u64::MAX, 400);
        let query = Query { start: from, goal: to, seed, budget, max_nodes, cell: 0.2 };
        let result = plan(&mut space, &query, 0.5, &mut Unwatched);
        let SearchOutcome::Found(path) = result.outcome else { continue };
        found += 1;
        crooked += u32::from(path.len() > 2);
        assert_eq!((path[0], path[path.len() - 1]), (from, to));
        for w in path.windows(2) {
            // The points that the resolution names: a power of two pieces, none above ε.
            let mut pieces = 1;
            while distance(&w[0], &w[1]) / f64::from(pieces) > EPSILON {
                pieces *= 2;
            }
            for i in 0..=pieces {
                let t = f64::from(i) / f64::from(pieces);
                let q = w[0] * (1.0 - t) + w[1] * t;
                assert!(space.is_free(&q), "scene {seed}: {q} is not free");
            }
        }
    }
    assert!(found > 800, "only {found} of 1000 scenes were solved");
    assert!(crooked > 500, "only {crooked} paths have a corner: the scenes are too easy");
}
