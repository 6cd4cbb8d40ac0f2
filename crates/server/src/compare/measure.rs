//! One planner in one scene: its times, its work, and its finished path looked at again.

use collision::{Allowance, ContactZone, LegChecker, survey};
use motion::smooth::SmoothOptions;
use motion::trial::Trial;
use motion::{
    EdgeRule, Outcome, Phase, Planner, Stage, StepAnswer, StepRequest, Unwatched, Watch, plan_step,
};
use nalgebra::{Isometry3, Point3};
use rover::Posture;
use tokio::time::Instant;

/// How a path is searched and what counts as free.
#[derive(Debug, Clone, Copy)]
pub struct Method {
    pub planner: Planner,
    pub edges: Edges,
    /// Are the robot's tolerances kept, or is only touching forbidden?
    pub tolerances: bool,
}

/// When an edge is free, and when smoothing ends.
#[derive(Debug, Clone, Copy)]
pub enum Edges {
    /// As we do it.
    Certified,
    /// At points 0.01 rad apart; smoothing ends when a round wins less than 25 % (F67, F78).
    Published,
    /// The same, smoothed on until a round wins next to nothing.
    SampledTaut,
}

/// What came out.
#[derive(Debug, Clone)]
pub struct Run {
    pub outcome: Outcome,
    /// From the request to the first path (s).
    pub first_path_s: f64,
    /// From the request to the answer (s).
    pub whole_s: f64,
    pub n_checked: u64,
    /// Length of the transit (rad), and of the straight line between its ends.
    length: f64,
    pub straight: f64,
    /// Is there a path, be it refused?
    pub has_path: bool,
    /// Does the path, looked at every 0.001 rad, touch anything?
    pub touches: bool,
    /// ... or come nearer to anything than the robot's tolerances?
    pub too_near: bool,
    /// Nearest distance of the leg from anything in the transit (m), up to [`REACH`].
    pub transit_clearance: f64,
}

impl Run {
    pub fn is_found(&self) -> bool {
        self.outcome == Outcome::Found
    }

    /// Length of the transit of a plan (rad).
    pub fn length(&self) -> Option<f64> {
        self.is_found().then_some(self.length)
    }
}

/// Each request is made so often, for the median of its times.
const REPEATS: usize = 3;

/// Resolution at which finished paths are looked at (rad, largest joint).
const RESOLUTION: f64 = 0.001;

/// How far distances of a transit are asked for (m at scale 1).
pub const REACH: f64 = 0.15;

/// Distances below a tolerance by rounding alone count as kept (m).
const ROUNDING: f64 = 1e-6;

impl Method {
    fn request(&self, trial: &Trial) -> StepRequest {
        let mut request = trial.request(self.planner);
        if !self.tolerances {
            request.environment_tolerance = Some(0.0);
            request.pair_tolerance = Some(0.0);
        }
        let published = match self.edges {
            Edges::Certified => None,
            Edges::Published => Some((0.25, 100)),
            Edges::SampledTaut => Some((0.001, 12)),
        };
        if let Some((stop_reduction, max_rounds)) = published {
            request.edges = EdgeRule::Sampled(0.01);
            request.smooth = SmoothOptions {
                stop_reduction,
                max_rounds,
                max_edges: 100_000,
                max_checked: u64::MAX,
                max_taut_rounds: 0,
            };
        }
        request
    }
}

/// Takes the times of a request.
struct Stopwatch {
    begun: Instant,
    first_path_s: f64,
}

impl Watch for Stopwatch {
    fn entered(&mut self, stage: Stage) {
        if stage == Stage::Smoothing && self.first_path_s.is_nan() {
            self.first_path_s = self.begun.elapsed().as_secs_f64();
        }
    }
}

/// Runs one method in one scene.
pub fn measure(trial: &Trial, method: &Method) -> Run {
    let request = method.request(trial);
    let mut times: Vec<(f64, f64)> = Vec::new();
    let mut last = None;
    for _ in 0..REPEATS {
        let mut watch = Stopwatch { begun: Instant::now(), first_path_s: f64::NAN };
        let answer = plan_step(&trial.scene, &trial.start, trial.gravity, &request, &mut watch);
        times.push((watch.begun.elapsed().as_secs_f64(), watch.first_path_s));
        last = Some(answer);
    }
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (whole_s, first_path_s) = times[REPEATS / 2];
    let answer = last.expect("a request is made at least once");
    let has_path = !answer.waypoints.is_empty();
    let touch = has_path.then(|| look_again(trial, &answer, Some(0.0)));
    // Whoever keeps no tolerances is not asked for them.
    let near = (has_path && method.tolerances).then(|| look_again(trial, &answer, None));
    Run {
        outcome: answer.outcome,
        first_path_s,
        whole_s,
        n_checked: answer.statistics.n_checked,
        length: answer.statistics.length,
        straight: answer.statistics.straight,
        has_path,
        touches: touch.as_ref().is_some_and(|seen| seen.touches),
        too_near: near.is_some_and(|seen| seen.least_spare < -ROUNDING),
        transit_clearance: touch.map_or(f64::NAN, |seen| seen.transit),
    }
}

/// Length (rad) of the shortest transit found within this time (s), with every budget raised.
pub fn long_run(trial: &Trial, seconds: f64) -> f64 {
    let begun = Instant::now();
    let mut best = f64::INFINITY;
    let mut seed = 1_000;
    while begun.elapsed().as_secs_f64() < seconds {
        for planner in [Planner::Auto, Planner::RrtConnect, Planner::Sbl] {
            let mut request = trial.request(planner);
            request.seed = seed;
            request.smooth = SmoothOptions {
                stop_reduction: 1e-3,
                max_rounds: 12,
                max_edges: 100_000,
                max_checked: 40_000,
                max_taut_rounds: 100,
            };
            let answer =
                plan_step(&trial.scene, &trial.start, trial.gravity, &request, &mut Unwatched);
            if answer.outcome == Outcome::Found {
                best = best.min(answer.statistics.length);
                // Nothing is shorter than the straight line.
                if answer.statistics.length <= answer.statistics.straight * (1.0 + 1e-9) {
                    return best;
                }
            }
            seed += 1;
        }
    }
    best
}

/// What a finished path is seen to do.
struct Seen {
    touches: bool,
    /// The least that is to spare beyond what is kept, over the whole motion of the leg (m).
    least_spare: f64,
    /// The least distance in the transit (m).
    transit: f64,
}

/// Looks at a finished path every [`RESOLUTION`], by exact distances: nothing of the search has a
/// part in it. `kept` (m) is what counts as too near; the robot's tolerances where absent.
fn look_again(trial: &Trial, answer: &StepAnswer, kept: Option<f64>) -> Seen {
    let robot = trial.scene.robot();
    let shifted = answer.waypoints.iter().take_while(|w| w.stance.is_some()).count();
    let stance = shifted.checked_sub(1).and_then(|last| answer.waypoints[last].stance.as_ref());
    let mut posture = Posture::new(robot, stance.unwrap_or(&trial.start));
    let standing = posture.clone();
    let checker = LegChecker::new(&trial.scene, &standing, trial.leg, kept, kept);
    let rules = robot.stance();
    let zone = |contact: Point3<f64>, wheel: &Isometry3<f64>| ContactZone {
        contact,
        center: wheel.translation.vector.into(),
        radius: rules.contact_radius,
        height: rules.contact_height,
        ground_tolerance: rules.ground_tolerance,
    };
    let contacts = survey(&trial.scene, &standing).contacts(&trial.scene, &standing);
    let here = contacts.into_iter().find(|(leg, _)| *leg == trial.leg);
    let wheel = standing.wheel(robot, trial.leg).world_from_wheel;
    let lift_zone = here.map(|(_, contact)| zone(contact, &wheel));
    let drop_zone = answer.footfall.as_ref().map(|f| zone(f.contact, &f.world_from_wheel));

    let mut seen = Seen { touches: false, least_spare: f64::INFINITY, transit: f64::INFINITY };
    let knots = &answer.waypoints[shifted.saturating_sub(1)..];
    for w in knots.windows(2) {
        let phase = w[1].phase;
        let zone = match phase {
            Phase::Lift => lift_zone.as_ref(),
            Phase::Shift | Phase::Transit => None,
            Phase::Drop | Phase::Preload => drop_zone.as_ref(),
        };
        let reach = if phase == Phase::Transit { REACH * robot.scale() } else { 1e-6 };
        let n = ((w[1].angles - w[0].angles).amax() / RESOLUTION).ceil().max(1.0);
        for i in 0..=n as usize {
            let share = i as f64 / n;
            let angles = w[0].angles * (1.0 - share) + w[1].angles * share;
            posture.move_leg(robot, trial.leg, &angles);
            let allowance = Allowance { zone, buffered: false };
            let clearance = checker.clearance(&posture, allowance, reach);
            for near in [clearance.links, clearance.environment].into_iter().flatten() {
                seen.touches |= near.distance <= 0.0;
                seen.least_spare = seen.least_spare.min(near.distance - near.required);
                if phase == Phase::Transit {
                    seen.transit = seen.transit.min(near.distance);
                }
            }
        }
    }
    seen.transit = seen.transit.min(REACH * robot.scale());
    seen
}
