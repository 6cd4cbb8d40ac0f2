//! The final check against brute force: paths that touch by little are not passed.

use collision::{Allowance, ContactZone, Keep, LegChecker};
use motion::check::{CheckContext, check_step};
use motion::trial::{Kind, Trial, draw};
use motion::{Outcome, Phase, Planner, Unwatched, Waypoint, plan_step};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegAngles, Posture};
use stability::Preference;

use crate::loaded;

const MOON: f64 = 1.62;

/// Resolution of the brute force (rad, largest joint).
const RESOLUTION: f64 = 0.004;

/// Scenes of each kind, and paths in each.
fn cases() -> (u64, usize) {
    if std::env::var("FOOTFALL_FULL").is_ok_and(|v| v == "1") { (12, 40) } else { (2, 8) }
}

/// Joint-linear motions through these angles, held against one scene.
struct Paths<'t> {
    trial: &'t Trial,
    at_rest: Posture,
    checker: LegChecker<'t>,
    keep: Keep,
}

impl<'t> Paths<'t> {
    fn new(trial: &'t Trial, keep: &Keep) -> Paths<'t> {
        let at_rest = Posture::new(trial.scene.robot(), &trial.start);
        let checker = LegChecker::keeping(&trial.scene, &at_rest, trial.leg, keep.clone());
        Paths { trial, at_rest, checker, keep: keep.clone() }
    }

    /// Least to spare by brute force (m), a touch counting as nothing to spare and less.
    fn least(&self, knots: &[LegAngles]) -> f64 {
        let spare = |q: &LegAngles| {
            let posture = self.at_rest.with_leg(self.trial.scene.robot(), self.trial.leg, q);
            let near = self.checker.clearance(&posture, Allowance::default(), 0.01);
            let all = [near.links, near.environment].into_iter().flatten();
            all.map(|v| v.distance - v.required - if v.distance > 0.0 { 0.0 } else { 1e-6 })
                .fold(0.01, f64::min)
        };
        let of_piece = |w: &[LegAngles]| {
            let n = ((w[1] - w[0]).amax() / RESOLUTION).ceil().max(1.0);
            (0..=n as usize)
                .map(|i| spare(&w[0].lerp(&w[1], i as f64 / n)))
                .fold(f64::INFINITY, f64::min)
        };
        knots.windows(2).map(of_piece).fold(f64::INFINITY, f64::min)
    }

    /// Does the final check find nothing that is nearer than it may be?
    fn passes(&self, knots: &[LegAngles]) -> bool {
        let waypoint = |(i, angles): (usize, &LegAngles)| Waypoint {
            angles: *angles,
            phase: Phase::Transit,
            time: i as f64,
            stance: None,
            hold: false,
        };
        let waypoints: Vec<Waypoint> = knots.iter().enumerate().map(waypoint).collect();
        let none: Option<ContactZone> = None;
        let context = CheckContext {
            scene: &self.trial.scene,
            start: &self.trial.start,
            stepping_from: &self.trial.start,
            leg: self.trial.leg,
            standing: &[],
            gravity: MOON,
            preference: Preference::Regular,
            friction: 0.7,
            keep: self.keep.clone(),
            lift_zone: none,
            drop_zone: none,
            transit_only: true,
        };
        let findings = check_step(&context, &waypoints).findings;
        findings.iter().filter(|f| f.check.starts_with("clearance")).all(|f| f.ok)
    }

    /// The free path bent at a place of its own toward `aside`, as far as leaves about `spare` (m).
    fn bent(&self, free: &[LegAngles], aside: &LegAngles, spare: f64) -> Option<Vec<LegAngles>> {
        let middle = free.len() / 2;
        let bent = |share: f64| {
            let mut knots = free.to_vec();
            let at = free[middle - 1].lerp(&free[middle], 0.5) + aside * share;
            knots.insert(middle, at);
            knots
        };
        let (mut clear, mut blocked) = (0.0, 1.0);
        if self.least(&bent(clear)) < spare || self.least(&bent(blocked)) >= spare {
            return None;
        }
        for _ in 0..10 {
            let share = 0.5 * (clear + blocked);
            if self.least(&bent(share)) > spare { clear = share } else { blocked = share }
        }
        Some(bent(blocked))
    }
}

/// The transit of a plan for the trial.
fn transit(trial: &Trial) -> Vec<LegAngles> {
    let request = trial.request(Planner::Auto);
    let answer = plan_step(&trial.scene, &trial.start, MOON, &request, &mut Unwatched);
    assert_eq!(answer.outcome, Outcome::Found);
    let knots = answer.waypoints.iter().zip(answer.waypoints.iter().skip(1));
    let knots = knots.filter(|(_, b)| b.phase == Phase::Transit);
    let mut path: Vec<LegAngles> = knots.clone().take(1).map(|(a, _)| a.angles).collect();
    path.extend(knots.map(|(_, b)| b.angles));
    path
}

/// Of paths bent until `spare` (m) is left: how many there are, and how many the check passes.
fn passed(keep: &Keep, spare: f64) -> (usize, usize) {
    let robot = loaded();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (n_scenes, n_paths) = cases();
    let (mut n, mut n_passed) = (0, 0);
    for kind in [Kind::Rock, Kind::Gap, Kind::Cluttered] {
        for seed in 0..n_scenes {
            let Some(trial) = draw(&robot, MOON, kind, seed) else { continue };
            let free = transit(&trial);
            let paths = Paths::new(&trial, keep);
            for _ in 0..n_paths {
                let aside = LegAngles::from_fn(|_, _| rng.random_range(-1.0..=1.0_f64));
                let Some(path) = paths.bent(&free, &aside, spare) else { continue };
                n += 1;
                n_passed += usize::from(paths.passes(&path));
            }
        }
    }
    (n, n_passed)
}

/// Where nothing is kept, the check goes on by 0.0001 rad at least: what touches over less than that may
/// be stepped over.
#[test]
fn paths_that_touch_by_little_are_refused() {
    let exactly = Keep { environment: Some(0.0), pairs: Some(0.0), ..Keep::default() };
    let (n, n_passed) = passed(&exactly, 0.0);
    eprintln!("{n_passed} of {n} paths that touch pass");
    assert!(n > 10, "{n} paths are no evidence");
    assert_eq!(n_passed, 0, "of {n} paths that touch");
}

/// The check looks at distances again and again, so that tolerances are not broken by much in
/// between.
#[test]
fn paths_a_millimeter_nearer_than_tolerances_allow_are_refused() {
    let (n, n_passed) = passed(&Keep::default(), -1e-3);
    eprintln!("{n_passed} of {n} paths a millimeter too near pass");
    assert!(n > 10, "{n} paths are no evidence");
    assert!(n_passed * 100 <= n, "{n_passed} of {n} paths that are too near pass");
}
