//! The body shift: the chassis moves over its planted wheels until a leg may be lifted.
//!
//! All wheels on the ground keep their places (brakes on, H22-H29 with closed-form legs), so a shift
//! is a way of the chassis' six numbers. The search looks for the smallest motion of the chassis
//! after which the margin rule holds on the feet that stay, with some to spare; all along the way it
//! must hold on all feet. What is executed is linear in the joints between knots: see
//! [`base_between`] for where the chassis then is. Frame `world`, meters, radians.

mod body;
mod chain;
mod executed;
mod search;

use collision::Scene;
use nalgebra::{Isometry3, Point3, Vector6};
use rand_chacha::ChaCha8Rng;
use rover::{BodyChain, BodyMotion, Configuration, LegId, Posture, Sway};
use stability::{Preference, StanceGuard, support_polygon};

pub use body::{BodyClear, CertifiedBody, SampledBody};
pub use executed::{Executed, base_between, closure_error};

use crate::watch::Watch;
use chain::ClosedChain;
use search::{Candidate, Search, seeded};

/// How far standing wheels may leave their places between knots (m at scale 1).
const CLOSURE: f64 = 0.002;

/// Way of the center of mass over half a piece below which the piece is not cut again where the margin
/// is left open (m at scale 1).
const FINEST_MARGIN: f64 = 1e-5;

/// Half length of a piece, as a share of the way, below which it is not cut again.
const SHORTEST: f64 = 1e-4;

/// Heights from which the direct search starts beside the start's own (m at scale 1).
const HEIGHTS: [f64; 2] = [-0.15, 0.15];

/// Searches from scattered poses, where those from level shifts have not enough.
const SCATTERS: usize = 4;

/// Searches that share the budget evenly, so that none starves the others.
const SEARCHES: usize = 1 + HEIGHTS.len() + SCATTERS;

/// A wish for a body shift.
#[derive(Clone)]
pub struct ShiftRequest<'a> {
    /// Robot, ground and obstacles.
    pub scene: &'a Scene,
    /// Where the robot is; its wheels close the chain.
    pub start: &'a Configuration,
    /// All legs on the ground, with their contacts in `world` (m).
    pub standing: &'a [(LegId, Point3<f64>)],
    /// The leg to be lifted afterwards; its foot does not count as support at the end.
    pub lifted: LegId,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// What the end must have to spare beyond the rule (m).
    pub wanted_spare: f64,
    /// Wheel drives hold the wheels while the forks pitch, instead of brakes.
    pub drive_hold: bool,
    /// How far wheels may leave their places between knots (m).
    pub closure: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Poses of the chassis that may be looked at.
    pub budget: usize,
}

impl<'a> ShiftRequest<'a> {
    /// A request with the defaults: 2 cm (scaled) to spare, wheels within 2 mm (scaled), brakes on.
    pub fn new(
        scene: &'a Scene,
        start: &'a Configuration,
        standing: &'a [(LegId, Point3<f64>)],
        lifted: LegId,
    ) -> ShiftRequest<'a> {
        let scale = scene.robot().scale();
        ShiftRequest {
            scene,
            start,
            standing,
            lifted,
            preference: Preference::Regular,
            wanted_spare: 0.02 * scale,
            drive_hold: false,
            closure: CLOSURE * scale,
            seed: 1,
            budget: 40_000,
        }
    }
}

/// A shift that may be executed.
#[derive(Debug, Clone, PartialEq)]
pub struct ShiftPlan {
    /// Knots with the start first; linear in the joints between them. One knot alone: nothing needs
    /// to move.
    pub configurations: Vec<Configuration>,
    /// Farthest that a wheel leaves its place on the way (m, sampled).
    pub closure_error: f64,
    /// What the feet that stay have to spare at the end (m).
    pub spare: f64,
}

/// Why there is no shift.
#[derive(Debug, Clone, PartialEq)]
pub struct NoShift {
    /// The most that the feet that stay have to spare in any pose found (m); negative infinity
    /// where no pose would do.
    pub best_spare: f64,
    /// That pose of the chassis, in `world`.
    pub pose: Isometry3<f64>,
    /// What stands in the way of more, in a sentence.
    pub why: String,
}

/// Finds the smallest motion of the chassis over its planted wheels after which `lifted` may be
/// lifted. Deterministic for the same request, unless `watch` stops it.
pub fn plan_shift(
    request: &ShiftRequest,
    body: &mut impl BodyClear,
    watch: &mut impl Watch,
) -> Result<ShiftPlan, NoShift> {
    let robot = request.scene.robot().as_ref();
    let none = |why: &str| NoShift {
        best_spare: f64::NEG_INFINITY,
        pose: request.start.world_from_base,
        why: why.into(),
    };
    let n_legs = robot.legs().len();
    if request.start.legs.len() != n_legs || request.standing.iter().any(|(l, _)| l.0 >= n_legs) {
        return Err(none("the request names legs that the robot does not have"));
    }
    let contacts: Vec<Point3<f64>> = request.standing.iter().map(|(_, p)| *p).collect();
    let staying: Vec<Point3<f64>> =
        request.standing.iter().filter(|(l, _)| *l != request.lifted).map(|(_, p)| *p).collect();
    let guard = |contacts: &[Point3<f64>], preference| {
        StanceGuard::new(contacts, robot.stance(), preference)
    };
    // On all feet nothing is lifted yet: the wish to survive a full loss is about the step.
    let (Some(all), Some(staying)) =
        (guard(&contacts, Preference::Regular), guard(&staying, request.preference))
    else {
        return Err(none("the feet enclose no support polygon"));
    };
    let legs: Vec<LegId> = request.standing.iter().map(|(leg, _)| *leg).collect();
    let chain = ClosedChain::new(robot, request.start, &legs, request.drive_hold);
    let origin = request.start.world_from_base.translation.vector;
    let lever = contacts.iter().map(|p| (p.coords - origin).xy().norm()).sum::<f64>()
        / contacts.len() as f64;
    let shift = Shift { request, chain: &chain, staying: &staying, all: &all };
    shift.plan(&mut Search {
        chain: &chain,
        staying: &staying,
        all: &all,
        wanted: request.wanted_spare,
        lever: lever.max(1e-3),
        body,
        watch,
        budget: request.budget,
        obstacle: None,
    })
}

struct Shift<'a> {
    request: &'a ShiftRequest<'a>,
    chain: &'a ClosedChain<'a>,
    staying: &'a StanceGuard,
    all: &'a StanceGuard,
}

impl Shift<'_> {
    fn plan<B: BodyClear, W: Watch>(
        &self,
        search: &mut Search<'_, B, W>,
    ) -> Result<ShiftPlan, NoShift> {
        let start = search.candidate(Vector6::zeros()).map_err(|why| NoShift {
            best_spare: f64::NEG_INFINITY,
            pose: self.request.start.world_from_base,
            why: format!("at the start {why}"),
        })?;
        if start.spare >= self.request.wanted_spare {
            let configurations = vec![self.request.start.clone()];
            return Ok(ShiftPlan { configurations, closure_error: 0.0, spare: start.spare });
        }
        let mut rng = seeded(self.request.seed);
        let mut best = start.clone();
        let mut why = None;
        for near in [true, false] {
            let mut candidates = if near {
                self.search_at(&start, 0.0, search, &mut rng)
            } else {
                self.search_elsewhere(&start, search, &mut rng)
            };
            for candidate in &candidates {
                if candidate.spare > best.spare {
                    best = candidate.clone();
                }
            }
            candidates.retain(|candidate| candidate.spare >= self.request.wanted_spare);
            candidates.sort_by(|a, b| a.distance().total_cmp(&b.distance()));
            for candidate in &candidates {
                match self.way(candidate, search.body) {
                    Ok(plan) => return Ok(plan),
                    Err(text) => why = why.or(Some(format!("on the way {text}"))),
                }
            }
        }
        let why = why.unwrap_or_else(|| self.what_limits(&best, search));
        let pose = best.configuration.world_from_base;
        Err(NoShift { best_spare: best.spare, pose, why })
    }

    /// Where the center of mass would best be over the feet that stay.
    fn goal_of_com(&self) -> Option<(Point3<f64>, f64)> {
        let contacts = self.staying.contacts();
        let regular = support_polygon::regular(contacts).ok()?;
        let conservative = match self.request.preference {
            Preference::Regular | Preference::Friction => None,
            Preference::Conservative => support_polygon::conservative(contacts).ok(),
        };
        let area = conservative.as_ref().and_then(|region| region.area());
        let (point, depth) = area.unwrap_or(&regular).deepest_point();
        Some((Point3::new(point.x, point.y, 0.0), depth))
    }

    /// A level shift from a height over the start (m), and what the direct search makes of it.
    fn search_at<B: BodyClear, W: Watch>(
        &self,
        start: &Candidate,
        height: f64,
        search: &mut Search<'_, B, W>,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Candidate> {
        search.budget = self.request.budget / SEARCHES;
        let Ok(from) = search.candidate(start.offset + Vector6::ith(2, height)) else {
            return Vec::new();
        };
        let com =
            Posture::new(self.chain.robot, &from.configuration).center_of_mass(self.chain.robot);
        let toward = self.goal_of_com().and_then(|(goal, _)| (goal - com).xy().try_normalize(1e-9));
        let level = toward.map_or_else(|| from.clone(), |way| search.level(&way, &from));
        let polished = search.direct(&level, rng);
        vec![level, polished]
    }

    /// From other heights and from scattered poses.
    fn search_elsewhere<B: BodyClear, W: Watch>(
        &self,
        start: &Candidate,
        search: &mut Search<'_, B, W>,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Candidate> {
        let scale = self.chain.robot.scale();
        let mut found: Vec<Candidate> = HEIGHTS
            .iter()
            .flat_map(|height| self.search_at(start, height * scale, search, rng))
            .collect();
        for _ in 0..SCATTERS {
            search.budget = self.request.budget / SEARCHES;
            let Some(from) = search.scattered(start, rng) else { continue };
            found.push(search.direct(&from, rng));
        }
        found
    }

    /// The way to a candidate with its margin and its clearance.
    fn way(&self, goal: &Candidate, body: &mut impl BodyClear) -> Result<ShiftPlan, String> {
        let robot = self.chain.robot;
        let (configurations, closure_error) =
            self.chain.way(&goal.pose, self.request.closure).map_err(|o| o.text(robot))?;
        if closure_error.is_nan() || closure_error > self.request.closure {
            return Err(format!("the wheels would leave their places by {closure_error:.4} m"));
        }
        let legs = self.chain.legs();
        let chain = BodyChain::new(robot);
        for piece in configurations.windows(2) {
            let executed = Executed::new(robot, &piece[0], &piece[1], &legs);
            if !holds_along(self.all, &chain, &executed, FINEST_MARGIN * robot.scale()) {
                return Err("the margin rule does not hold on all feet".into());
            }
            body.piece(&piece[0], &piece[1])?;
        }
        Ok(ShiftPlan { configurations, closure_error, spare: goal.spare })
    }

    /// What stops the best pose from being better.
    fn what_limits<B: BodyClear, W: Watch>(
        &self,
        best: &Candidate,
        search: &mut Search<'_, B, W>,
    ) -> String {
        let robot = self.chain.robot;
        if search.watch.stopped().is_some() {
            return "the search was stopped".into();
        }
        if let Some((goal, depth)) = self.goal_of_com() {
            let rule = match self.request.preference {
                Preference::Regular | Preference::Friction => robot.stance().margin,
                Preference::Conservative => 0.0,
            };
            if depth - rule < self.request.wanted_spare {
                let most = depth - rule;
                return format!("no pose over these feet has more than {most:.2} m to spare");
            }
            let com = Posture::new(robot, &best.configuration).center_of_mass(robot);
            let way = (goal - com).xy().try_normalize(1e-9).unwrap_or_default();
            let step = Vector6::new(way.x, way.y, 0.0, 0.0, 0.0, 0.0) * (0.02 * robot.scale());
            if let Err(text) = search.candidate(best.offset + step) {
                return text;
            }
        }
        search.obstacle.take().unwrap_or_else(|| {
            "the search found no better pose; turns and heights of the chassis were tried".into()
        })
    }
}

/// Does the rule hold all along a motion? By the way that the center of mass can go from the middle
/// of a piece; pieces where that leaves it open are cut until it goes less than `finest` (m).
fn holds_along(
    guard: &StanceGuard,
    chain: &BodyChain,
    motion: &impl BodyMotion,
    finest: f64,
) -> bool {
    let mut pieces = vec![(0.5, 0.5)];
    while let Some((middle, half)) = pieces.pop() {
        let (com, bound) = Sway::new(chain, motion, middle, half).center_of_mass();
        if guard.spare_about(&com, bound) >= 0.0 {
            continue;
        }
        if guard.spare(&com) < 0.0 || bound < finest || half < SHORTEST {
            return false;
        }
        let half = 0.5 * half;
        pieces.extend([(middle + half, half), (middle - half, half)]);
    }
    true
}
