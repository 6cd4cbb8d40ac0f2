//! From the wish to a way: the searches in their order, and the way to what they find.

use nalgebra::{Point3, Vector2, Vector6};
use rand_chacha::ChaCha8Rng;
use rover::{BodyChain, BodyMotion, Posture, Sway};
use stability::StanceGuard;

use super::barrier::Barrier;
use super::chain::ClosedChain;
use super::executed::Executed;
use super::search::{Candidate, Scatter, Search, seeded};
use super::wanted::Wanted;
use super::{BodyClear, Freedom, NoShift, ShiftPlan};
use crate::watch::Watch;

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

/// Ends that a way is sought to where none has enough, and halvings of such a way that is blocked.
const MOST_ENDS: usize = 4;
const HALVINGS: usize = 5;

/// A way to this near to the most found is good enough (m at scale 1).
const NEARLY: f64 = 0.003;

/// Nearer than this to what the feet allow, they are what stands in the way (m at scale 1).
const AT_THE_FEET: f64 = 0.01;

/// The chassis over planted wheels, and what is wanted of it.
#[derive(Clone, Copy)]
pub(crate) struct Shift<'a> {
    pub chain: &'a ClosedChain<'a>,
    /// What is asked of the feet that stay at the end.
    pub staying: &'a Wanted,
    /// What must hold all along the way.
    pub all: &'a StanceGuard,
    /// The feet on which the body moves (m).
    pub contacts: &'a [Point3<f64>],
    /// What the end must have to spare (m).
    pub wanted: f64,
    /// How far wheels may leave their places between knots (m).
    pub closure: f64,
    pub freedom: Freedom,
    pub seed: u64,
    /// Poses that may be looked at.
    pub budget: usize,
}

/// What a search came to.
pub(crate) struct Reached {
    /// A way that may be executed: to enough, or to the most that one was found to.
    pub plan: ShiftPlan,
    /// Without enough: what stands in the way of more.
    pub barrier: Option<Barrier>,
}

/// Every end that was found, and why none with enough could be gone to.
struct NotEnough {
    found: Vec<Candidate>,
    why: Option<Barrier>,
}

impl<'a> Shift<'a> {
    /// The memory of a search for this.
    pub fn search<'s, B, W>(&self, body: &'s mut B, watch: &'s mut W) -> Search<'s, B, W>
    where
        'a: 's,
    {
        let origin = self.chain.start.world_from_base.translation.vector;
        let lever = self.contacts.iter().map(|p| (p.coords - origin).xy().norm()).sum::<f64>()
            / self.contacts.len().max(1) as f64;
        Search {
            chain: self.chain,
            staying: self.staying,
            all: self.all,
            wanted: self.wanted,
            freedom: self.freedom,
            lever: lever.max(1e-3),
            body,
            watch,
            budget: self.budget,
            toward: self.toward(),
            obstacle: None,
            looked: 0,
        }
    }

    /// Where the center of mass is wanted, seen from where it is.
    fn toward(&self) -> Vector2<f64> {
        let com = Posture::new(self.chain.robot, self.chain.start).center_of_mass(self.chain.robot);
        let way = self.staying.best().and_then(|(goal, _)| (goal - com.xy()).try_normalize(1e-9));
        way.unwrap_or_else(Vector2::x)
    }

    /// A pose and simpler ones near it: those in the upright plane along which the center of mass is wanted,
    /// and without turns. A straight wrist can be passed in its own plane only.
    fn simplified<B: BodyClear, W: Watch>(
        &self,
        goal: &Candidate,
        search: &mut Search<'_, B, W>,
    ) -> Vec<Candidate> {
        let toward = search.toward;
        let aside = Vector2::new(-toward.y, toward.x);
        let o = &goal.offset;
        let along = toward * toward.dot(&Vector2::new(o[0], o[1]));
        let pitch = aside * aside.dot(&Vector2::new(o[3], o[4]));
        let in_plane = Vector6::new(along.x, along.y, o[2], pitch.x, pitch.y, 0.0);
        let level = Vector6::new(along.x, along.y, o[2], 0.0, 0.0, 0.0);
        let mut all = vec![goal.clone()];
        all.extend([in_plane, level].iter().filter_map(|offset| search.candidate(*offset).ok()));
        all
    }

    /// The smallest shift with enough to spare, or why there is none.
    pub fn plan<B: BodyClear, W: Watch>(
        &self,
        search: &mut Search<'_, B, W>,
    ) -> Result<ShiftPlan, NoShift> {
        let start = search.candidate(Vector6::zeros()).map_err(|why| NoShift {
            best_spare: f64::NEG_INFINITY,
            pose: self.chain.start.world_from_base,
            why: format!("at the start {}", why.text),
        })?;
        self.enough(&start, search).map_err(|NotEnough { found, why }| {
            let best = most(&found);
            let limit = || self.these_feet().or_else(|| self.pose_limit(best, search));
            let why = why.or_else(limit).unwrap_or_else(|| self.nothing_better(search));
            let pose = best.configuration.world_from_base;
            NoShift { best_spare: best.spare, pose, why: why.text }
        })
    }

    /// The smallest shift with enough to spare, or the one to the most found. The error is what is
    /// wrong with the start.
    pub fn reach<B: BodyClear, W: Watch>(
        &self,
        search: &mut Search<'_, B, W>,
    ) -> Result<Reached, Barrier> {
        let start = search.candidate(Vector6::zeros())?;
        match self.enough(&start, search) {
            Ok(plan) => Ok(Reached { plan, barrier: None }),
            Err(NotEnough { found, why }) => {
                let best = most(&found);
                let limit = self.feet_alone(best).or_else(|| self.pose_limit(best, search));
                let barrier = why.or(limit).unwrap_or_else(|| self.nothing_better(search));
                let plan = self.way_to_most(&start, found, search);
                Ok(Reached { plan, barrier: Some(barrier) })
            }
        }
    }

    fn stays(&self, start: &Candidate) -> ShiftPlan {
        let configurations = vec![self.chain.start.clone()];
        ShiftPlan { configurations, closure_error: 0.0, spare: start.spare }
    }

    fn enough<B: BodyClear, W: Watch>(
        &self,
        start: &Candidate,
        search: &mut Search<'_, B, W>,
    ) -> Result<ShiftPlan, NotEnough> {
        if start.spare >= self.wanted {
            return Ok(self.stays(start));
        }
        let mut rng = seeded(self.seed);
        let mut found = vec![start.clone()];
        let mut why = None;
        for near in [true, false] {
            let candidates = if near {
                self.search_at(start, 0.0, search, &mut rng)
            } else {
                self.search_elsewhere(start, search, &mut rng)
            };
            let mut enough: Vec<&Candidate> =
                candidates.iter().filter(|candidate| candidate.spare >= self.wanted).collect();
            enough.sort_by(|a, b| a.distance().total_cmp(&b.distance()));
            for candidate in enough {
                let tried = self.simplified(candidate, search);
                for candidate in tried.iter().filter(|c| c.spare >= self.wanted) {
                    match self.way(candidate, search.body) {
                        Ok(plan) => return Ok(plan),
                        Err(barrier) => why = why.or(Some(barrier.on_the_way())),
                    }
                }
            }
            found.extend(candidates);
        }
        Err(NotEnough { found, why })
    }

    /// The way to the pose with most to spare; where that is blocked, as far as one can go.
    fn way_to_most<B: BodyClear, W: Watch>(
        &self,
        start: &Candidate,
        mut found: Vec<Candidate>,
        search: &mut Search<'_, B, W>,
    ) -> ShiftPlan {
        found.sort_by(|a, b| b.spare.total_cmp(&a.spare));
        let mut best = self.stays(start);
        for goal in found.iter().take(MOST_ENDS) {
            if goal.spare <= best.spare {
                break;
            }
            for simple in self.simplified(goal, search) {
                if simple.spare > best.spare
                    && let Ok(plan) = self.way(&simple, search.body)
                {
                    best = plan;
                }
            }
            if best.spare >= goal.spare - NEARLY * self.chain.robot.scale() {
                break;
            }
            let (mut free, mut blocked) = (0.0, 1.0);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (free + blocked);
                let there = search.candidate(goal.offset * middle).ok();
                match there.and_then(|c| self.way(&c, search.body).ok()) {
                    Some(plan) => {
                        free = middle;
                        if plan.spare > best.spare {
                            best = plan;
                        }
                    }
                    None => blocked = middle,
                }
            }
        }
        best
    }

    /// A level shift from a height over the start (m), and what the direct search makes of it.
    fn search_at<B: BodyClear, W: Watch>(
        &self,
        start: &Candidate,
        height: f64,
        search: &mut Search<'_, B, W>,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Candidate> {
        search.budget = self.budget / SEARCHES;
        let Ok(from) = search.candidate(start.offset + Vector6::ith(2, height)) else {
            return Vec::new();
        };
        let level = search.level(&from);
        let polished = search.direct(&level, rng);
        vec![level, polished]
    }

    /// From other heights and from scattered poses, where the chassis may go there.
    fn search_elsewhere<B: BodyClear, W: Watch>(
        &self,
        start: &Candidate,
        search: &mut Search<'_, B, W>,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Candidate> {
        if self.freedom == Freedom::Level {
            return Vec::new();
        }
        let scale = self.chain.robot.scale();
        let mut found: Vec<Candidate> = HEIGHTS
            .iter()
            .flat_map(|height| self.search_at(start, height * scale, search, rng))
            .collect();
        for i in 0..SCATTERS {
            search.budget = self.budget / SEARCHES;
            let scatter = if i % 2 == 0 { Scatter::InPlane } else { Scatter::Everywhere };
            let Some(from) = search.scattered(start, scatter, rng) else { continue };
            found.push(search.direct(&from, rng));
        }
        found
    }

    /// The way to a candidate with its margin and its clearance.
    fn way(&self, goal: &Candidate, body: &mut impl BodyClear) -> Result<ShiftPlan, Barrier> {
        let robot = self.chain.robot;
        let (configurations, closure_error) =
            self.chain.way(&goal.pose, self.closure).map_err(|o| Barrier::of(o, robot))?;
        if closure_error.is_nan() || closure_error > self.closure {
            let text = format!("the wheels would leave their places by {closure_error:.4} m");
            return Err(Barrier::new("closure", text).missing(closure_error - self.closure, "m"));
        }
        let legs = self.chain.legs();
        let chain = BodyChain::new(robot);
        for piece in configurations.windows(2) {
            let executed = Executed::new(robot, &piece[0], &piece[1], &legs);
            if !holds_along(self.all, &chain, &executed, FINEST_MARGIN * robot.scale()) {
                return Err(Barrier::new("stability", "the margin rule does not hold on all feet"));
            }
            body.piece(&piece[0], &piece[1])
                .map_err(|text| Barrier { constraint: body.constraint(), text })?;
        }
        Ok(ShiftPlan { configurations, closure_error, spare: goal.spare })
    }

    /// The feet themselves, where they allow less than is wanted.
    fn these_feet(&self) -> Option<Barrier> {
        let (_, most) = self.staying.best()?;
        (most < self.wanted).then(|| {
            let text = format!("no pose over these feet has more than {most:.2} m to spare");
            Barrier::new("region", text).missing(self.wanted - most, "m")
        })
    }

    /// The same where the best pose is at what they allow already.
    fn feet_alone(&self, best: &Candidate) -> Option<Barrier> {
        let (_, most) = self.staying.best()?;
        let near = best.spare >= most - AT_THE_FEET * self.chain.robot.scale();
        self.these_feet().filter(|_| near).map(|barrier| Barrier {
            text: "these feet allow no more, wherever the center of mass is".into(),
            ..barrier
        })
    }

    /// What keeps the chassis from going on from the best pose.
    fn pose_limit<B: BodyClear, W: Watch>(
        &self,
        best: &Candidate,
        search: &mut Search<'_, B, W>,
    ) -> Option<Barrier> {
        let robot = self.chain.robot;
        let (goal, _) = self.staying.best()?;
        if search.watch.stopped().is_some() {
            return None;
        }
        let com = Posture::new(robot, &best.configuration).center_of_mass(robot);
        let way = (goal - com.xy()).try_normalize(1e-9).unwrap_or_default();
        let step = Vector6::new(way.x, way.y, 0.0, 0.0, 0.0, 0.0) * (0.02 * robot.scale());
        search.candidate(best.offset + step).err()
    }

    fn nothing_better<B: BodyClear, W: Watch>(&self, search: &mut Search<'_, B, W>) -> Barrier {
        if search.watch.stopped().is_some() {
            return Barrier::new("search", "the search was stopped");
        }
        search.obstacle.take().unwrap_or_else(|| {
            let tried = match self.freedom {
                Freedom::Level => "only level shifts were tried",
                Freedom::Whole => "turns and heights of the chassis were tried",
            };
            Barrier::new("search", format!("the search found no better pose; {tried}"))
        })
    }
}

/// The candidate with most to spare, the earliest of equals.
fn most(found: &[Candidate]) -> &Candidate {
    found.iter().fold(&found[0], |best, next| if next.spare > best.spare { next } else { best })
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
