//! The search for the cheapest pose of the chassis that has enough to spare.
//!
//! Mesh adaptive direct search (Audet and Dennis, SIAM J. Optim. 17, 2006, sec. 2): poll along the
//! axes and a few seeded directions (the objective has ridges, on which axes alone get stuck),
//! double the mesh on success, halve it on failure. Poses are compared by what they have to spare,
//! up to what is wanted, then by their distance from the start.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, Posture};
use stability::StanceGuard;

use super::barrier::Barrier;
use super::chain::{ChainPose, ClosedChain};
use super::wanted::Wanted;
use super::{BodyClear, Freedom};
use crate::watch::Watch;

/// Step of the level search, first and last mesh of the direct search (m at scale 1).
const LEVEL_STEP: f64 = 0.02;
const FIRST_MESH: f64 = 0.15;
const LAST_MESH: f64 = 0.001;

/// Farthest level shift that is looked at (m at scale 1).
const FARTHEST: f64 = 1.0;

/// Seeded poses tried as starts, and how far they go in each direction (m at scale 1).
const SCATTERED: usize = 1_500;
const SCATTER: f64 = 0.8;

/// Where seeded poses are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scatter {
    /// In the upright plane along which the center of mass is wanted, tilted within it.
    InPlane,
    /// Anywhere.
    Everywhere,
}

/// Seeded directions of a poll beside the axes.
const RANDOM_DIRECTIONS: usize = 12;

/// A pose that the planted legs reach and that keeps the rule on all feet.
#[derive(Clone)]
pub(crate) struct Candidate {
    /// Translation (m), and turn as rotation vector times `lever` (m), from the start, in `world`.
    pub offset: Vector6<f64>,
    pub configuration: Configuration,
    pub pose: ChainPose,
    /// What the feet that stay have to spare (m).
    pub spare: f64,
}

impl Candidate {
    pub fn distance(&self) -> f64 {
        self.offset.norm()
    }
}

pub(crate) struct Search<'a, B, W> {
    pub chain: &'a ClosedChain<'a>,
    /// What is asked of the feet that stay, and the rule on all feet.
    pub staying: &'a Wanted,
    pub all: &'a StanceGuard,
    pub wanted: f64,
    pub freedom: Freedom,
    /// Distance of the feet from the chassis: a turn by 1 rad counts like a shift by this (m).
    pub lever: f64,
    pub body: &'a mut B,
    pub watch: &'a mut W,
    /// Poses that may still be looked at.
    pub budget: usize,
    /// The way that the center of mass is wanted to go; directions go along it and across.
    pub toward: Vector2<f64>,
    /// What stood in the way of the last pose that had more to spare.
    pub obstacle: Option<Barrier>,
    /// Poses looked at so far.
    pub looked: usize,
}

impl<B: BodyClear, W: Watch> Search<'_, B, W> {
    /// The candidate at an offset; the error is what is in the way.
    pub fn candidate(&mut self, offset: Vector6<f64>) -> Result<Candidate, Barrier> {
        let robot = self.chain.robot;
        self.budget = self.budget.saturating_sub(1);
        self.looked += 1;
        let start = &self.chain.start.world_from_base;
        let shift = Vector3::new(offset[0], offset[1], offset[2]);
        let turn = Vector3::new(offset[3], offset[4], offset[5]) / self.lever;
        let base = Isometry3::from_parts(
            Translation3::from(start.translation.vector + shift),
            UnitQuaternion::from_scaled_axis(turn) * start.rotation,
        );
        let (configuration, pose) = self.chain.reach(&base).map_err(|o| Barrier::of(o, robot))?;
        let com = Posture::new(robot, &configuration).center_of_mass(robot);
        let on_all = self.all.spare(&com);
        if on_all < 0.0 {
            let text = "the margin rule would not hold on all feet";
            return Err(Barrier::new("stability", text).missing(-on_all, "m"));
        }
        Ok(Candidate { offset, configuration, pose, spare: self.staying.spare(&com) })
    }

    fn score(&self, candidate: &Candidate) -> (f64, f64) {
        (candidate.spare.min(self.wanted), -candidate.distance())
    }

    /// Is `candidate` better than `than` by more than rounding, and can it be taken?
    fn better(&mut self, candidate: &Candidate, than: &Candidate) -> bool {
        let (new, old) = (self.score(candidate), self.score(than));
        if !(new.0 > old.0 + 1e-9 || (new.0 >= old.0 && new.1 > old.1 + 1e-9)) {
            return false;
        }
        self.is_free(candidate)
    }

    fn is_free(&mut self, candidate: &Candidate) -> bool {
        if let Err(obstruction) = self.chain.follows(&candidate.pose) {
            self.obstacle = Some(Barrier::of(obstruction, self.chain.robot));
            return false;
        }
        match self.body.piece(&candidate.configuration, &candidate.configuration) {
            Ok(()) => true,
            Err(text) => {
                self.obstacle = Some(Barrier { constraint: self.body.constraint(), text });
                false
            }
        }
    }

    fn over(&mut self) -> bool {
        self.budget == 0 || self.watch.stopped().is_some()
    }

    /// The shortest level shift toward where the center of mass is wanted that has what is wanted, or the
    /// one with most.
    pub fn level(&mut self, from: &Candidate) -> Candidate {
        let toward = self.toward;
        let scale = self.chain.robot.scale();
        let at = |d: f64| from.offset + Vector6::new(toward.x, toward.y, 0.0, 0.0, 0.0, 0.0) * d;
        let mut best = from.clone();
        let steps = (FARTHEST / LEVEL_STEP).round() as usize;
        for i in 1..=steps {
            if self.over() || best.spare >= self.wanted {
                break;
            }
            let distance = i as f64 * LEVEL_STEP * scale;
            let Ok(next) = self.candidate(at(distance)) else { break };
            if !self.better(&next, &best) {
                continue;
            }
            best = next;
            if best.spare < self.wanted {
                continue;
            }
            let (mut short, mut enough) = (distance - LEVEL_STEP * scale, distance);
            for _ in 0..8 {
                let middle = 0.5 * (short + enough);
                match self.candidate(at(middle)) {
                    Ok(nearer) if self.better(&nearer, &best) => (best, enough) = (nearer, middle),
                    _ => short = middle,
                }
            }
        }
        best
    }

    /// Direct search in all six directions from `start`.
    pub fn direct(&mut self, start: &Candidate, rng: &mut ChaCha8Rng) -> Candidate {
        let scale = self.chain.robot.scale();
        let mut best = start.clone();
        let mut mesh = FIRST_MESH * scale;
        while mesh > LAST_MESH * scale && !self.over() {
            let mut found = false;
            for direction in directions(self.freedom, &self.toward, rng) {
                let Ok(next) = self.candidate(best.offset + direction * mesh) else { continue };
                if self.better(&next, &best) {
                    best = next;
                    found = true;
                    break;
                }
            }
            mesh = if found { (2.0 * mesh).min(FIRST_MESH * scale) } else { 0.5 * mesh };
        }
        best
    }
}

impl<B: BodyClear, W: Watch> Search<'_, B, W> {
    /// Seeded poses about `from`, the best of those that are free: starts far from each other.
    pub fn scattered(
        &mut self,
        from: &Candidate,
        scatter: Scatter,
        rng: &mut ChaCha8Rng,
    ) -> Option<Candidate> {
        let width = SCATTER * self.chain.robot.scale();
        let mut best: Option<Candidate> = None;
        for _ in 0..SCATTERED {
            if self.over() {
                break;
            }
            let any = Vector6::from_fn(|_, _| rng.random_range(-width..width));
            let (x, y) = (self.toward.x, self.toward.y);
            let offset = match scatter {
                Scatter::Everywhere => any,
                Scatter::InPlane => {
                    Vector6::new(any[0] * x, any[0] * y, any[2], -any[4] * y, any[4] * x, 0.0)
                }
            };
            let Ok(next) = self.candidate(from.offset + offset) else { continue };
            let better = best.as_ref().is_none_or(|best| self.score(&next) > self.score(best));
            if better && self.is_free(&next) {
                best = Some(next);
            }
        }
        best
    }
}

/// Both ways along the free axes, of which the first goes `toward`, and along seeded unit vectors.
fn directions(freedom: Freedom, toward: &Vector2<f64>, rng: &mut ChaCha8Rng) -> Vec<Vector6<f64>> {
    let n_free = freedom.n_axes();
    let (x, y) = (toward.x, toward.y);
    let axes = [
        Vector6::new(x, y, 0.0, 0.0, 0.0, 0.0),
        Vector6::new(-y, x, 0.0, 0.0, 0.0, 0.0),
        Vector6::ith(2, 1.0),
        Vector6::new(0.0, 0.0, 0.0, x, y, 0.0),
        Vector6::new(0.0, 0.0, 0.0, -y, x, 0.0),
        Vector6::ith(5, 1.0),
    ];
    let mut ways = axes[..n_free].to_vec();
    for _ in 0..RANDOM_DIRECTIONS {
        let way =
            Vector6::from_fn(|i, _| if i < n_free { rng.random_range(-1.0..1.0) } else { 0.0 });
        ways.extend(way.try_normalize(1e-3));
    }
    ways.iter().flat_map(|way| [*way, -way]).collect()
}

pub(crate) fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}
