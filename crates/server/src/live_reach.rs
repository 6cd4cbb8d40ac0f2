//! Where the legs of the live rover can stand, kept up to date in the background.
//!
//! A change of stance, map or preference makes what is known outdated; once the rover has been still
//! for a moment the legs are computed anew, one after the other, by one thread beside the gate of
//! the analyses, so that no request waits for it: all legs on coarse cells first, then on fine ones. A
//! change meanwhile ends the work and begins it again: what is kept always belongs to one basis.
//!
//! Where only the map has changed, only the cells that the change can matter to are computed anew
//! (`before`). A change of stance computes all: the margin of every cell is taken over all feet, with the
//! center of mass of the whole rover, so even one other foot that moves changes every leg's cells.

mod before;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rover::Configuration;
use tokio::time::Instant;
use wire::analysis::{REACH_CLASSES, ReachabilityCells, ReachabilityRequest, StabilityPreference};
use wire::check::RequestError;
use wire::live::{JobReport, LegReach, ReachSummary, RoverMode, channel};

use crate::analyses;
use crate::app::AppState;
use crate::error::ApiError;
use crate::scene::Context;
use crate::stop::Stop;
use before::{Before, Changed};

/// Time between looks at the stance; a stance is still if it is the same in two.
const LOOK: Duration = Duration::from_millis(250);
/// Distances between cells, one after the other, for a robot of scale 1 (m): an answer soon, then a close
/// one.
const RESOLUTIONS_M: [f64; 2] = [0.1, 0.02];
/// Least distance that a request may ask for (m).
const LEAST_RESOLUTION_M: f64 = 0.001;
/// Longest time for all legs (s).
const DEADLINE_S: f64 = 600.0;

/// Cells of one leg.
type Known = Arc<ReachabilityCells>;

/// What is known.
#[derive(Default)]
pub struct LiveReach {
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    preference: StabilityPreference,
    basis: String,
    legs: BTreeMap<String, Arc<ReachabilityCells>>,
    /// Answers of one leg at one resolution: those that have been found, and all.
    n_found: usize,
    n_answers: usize,
    failure: Option<String>,
}

impl LiveReach {
    fn locked(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What must hold while a leg is up, from now on.
    pub fn prefer(&self, preference: StabilityPreference) {
        self.locked().preference = preference;
    }

    /// In short.
    pub fn summary(&self) -> ReachSummary {
        let state = self.locked();
        let short = |cells: &Arc<ReachabilityCells>| LegReach {
            cells: counts(cells),
            resolution_m: cells.resolution_m,
        };
        let legs: BTreeMap<String, LegReach> =
            state.legs.iter().map(|(name, cells)| (name.clone(), short(cells))).collect();
        ReachSummary {
            basis: state.basis.clone(),
            stability: state.preference,
            progress: state.n_found as f64 / state.n_answers.max(1) as f64,
            legs,
            failure: state.failure.clone(),
        }
    }

    /// The cells of a leg with their basis; `None` while they are not known.
    pub fn cells(&self, leg: &str) -> Option<(String, Arc<ReachabilityCells>)> {
        let state = self.locked();
        Some((state.basis.clone(), state.legs.get(leg)?.clone()))
    }

    /// Begins anew for this basis.
    fn begin(&self, basis: &str, n_answers: usize) {
        let mut state = self.locked();
        state.basis = basis.into();
        (state.n_found, state.n_answers) = (0, n_answers);
        state.legs.clear();
        state.failure = None;
    }

    /// Keeps a leg, unless another basis has begun meanwhile: `false` then.
    fn keep(&self, basis: &str, leg: &str, cells: ReachabilityCells) -> bool {
        let mut state = self.locked();
        let holds = state.basis == basis;
        if holds {
            state.legs.insert(leg.into(), Arc::new(cells));
        }
        holds
    }

    /// Keeps a closer answer in place of `before`, unless steps are being planned to the cells of that
    /// one, or another basis has begun meanwhile.
    fn refine(&self, basis: &str, leg: &str, before: Option<&Known>, cells: ReachabilityCells) {
        let mut state = self.locked();
        let now = state.legs.get(leg);
        let same = match (before, now) {
            (Some(before), Some(now)) => Arc::ptr_eq(before, now),
            (before, now) => before.is_none() && now.is_none(),
        };
        if state.basis == basis && same {
            state.legs.insert(leg.into(), Arc::new(cells));
        }
    }

    /// One leg has been looked at, at one resolution.
    fn found(&self) {
        self.locked().n_found += 1;
    }

    fn fail(&self, why: String) {
        self.locked().failure = Some(why);
    }
}

fn counts(cells: &ReachabilityCells) -> BTreeMap<String, u32> {
    let mut counts = [0_u32; REACH_CLASSES.len()];
    for class in &cells.class {
        if let Some(count) = counts.get_mut(usize::from(*class)) {
            *count += 1;
        }
    }
    REACH_CLASSES.iter().zip(counts).map(|(name, count)| ((*name).into(), count)).collect()
}

/// Keeps [`LiveReach`] up to date until the server ends.
pub async fn run(app: AppState) {
    let mut closing = app.closing.clone();
    let (mut seen, mut done) = (None, None);
    let mut before = Before::default();
    loop {
        tokio::select! {
            _ = closing.wait_for(|closing| *closing) => return,
            () = tokio::time::sleep(LOOK) => {}
        }
        let basis = basis(&app);
        let is_still = basis == seen;
        seen.clone_from(&basis);
        if !is_still || basis == done {
            continue;
        }
        // What was ended by a change is begun again, should the same basis come back.
        let Some(now) = basis else { continue };
        done = compute(&app, &now, &mut before).await.then_some(now);
    }
}

/// Plans to one reachable cell of each 10 cm square (at scale 1) of a leg, as a job; the cells planned to
/// are marked as it goes on, those beside them stay reachable. A change of stance, map or preference
/// cancels it.
pub fn plan_to_cells(app: &AppState, leg: &str) -> Result<JobReport, ApiError> {
    let Some((basis, cells)) = app.reach.cells(leg) else { return Err(not_ready(leg)) };
    let job = app.jobs.begin("plannable", Stop::after(Some(DEADLINE_S))?)?;
    let report = app.jobs.get(job.id())?;
    let (app, leg) = (app.clone(), leg.to_owned());
    tokio::spawn(async move {
        let permit = match app.gate.enter().await {
            Ok(permit) => permit,
            Err(error) => return job.end(Err(error)),
        };
        let work = move || {
            let _place = permit;
            let (context, stability) = (app.context(), app.reach.locked().preference);
            // The rover may have moved while this waited for its turn.
            if self::basis(&app).as_deref() != Some(&*basis) {
                let text = "the stance, the map or the preference has changed; ask again";
                return job.end(Err(ApiError::new("cancelled", text)));
            }
            let mut shown = Instant::now();
            let stop = job.stop().clone();
            let mut told = |share: f64, cells: &ReachabilityCells| {
                if share < 1.0 && shown.elapsed() < LOOK {
                    return;
                }
                shown = Instant::now();
                job.progress(share, "plans a step to a reachable cell of each 10 cm square");
                if !app.reach.keep(&basis, &leg, cells.clone()) {
                    stop.cancel();
                }
                tell(&app);
            };
            let cells = cells.as_ref().clone();
            let stop = job.stop().clone();
            let done = analyses::plannable(&context, &leg, stability, cells, &stop, &mut told);
            let path = format!("/api/v1/rover/reachability/{leg}");
            job.end(done.map(|()| path).map_err(ApiError::from));
        };
        if let Err(error) = tokio::task::spawn_blocking(work).await {
            tracing::error!("planning to the cells of a leg ended by a fault: {error}");
        }
    });
    Ok(report)
}

/// The answer about a leg whose cells are not known.
pub fn not_ready(leg: &str) -> ApiError {
    let leg: String = leg.chars().take(64).collect();
    ApiError::new(
        "not_ready",
        format!("the reachability of {leg:?} is not known yet, or it is no leg"),
    )
}

/// Names stance, map and preference; `None` while there is no stance, or the rover moves.
fn basis(app: &AppState) -> Option<String> {
    if app.live.latest().ok()?.frame.mode == RoverMode::Executing {
        return None;
    }
    let stance = stance(&app.live.configuration().ok()?, app.reach.locked().preference);
    Some(format!("{stance}-{}", app.store.current().info.version))
}

/// Names stance and preference.
fn stance(configuration: &Configuration, preference: StabilityPreference) -> String {
    format!("{}-{preference:?}", analyses::state_hash(configuration))
}

/// Computes all legs; `false` if a change ended the work before.
async fn compute(app: &AppState, basis_of_work: &str, before: &mut Before) -> bool {
    // All answers are about what the rover is in now, whatever changes meanwhile.
    let (context, stability) = (Arc::new(app.context()), app.reach.locked().preference);
    let Some(stance) = context.live.as_ref().and_then(|live| {
        let stance = stance(live.configuration.as_ref()?, stability);
        let is_it = format!("{stance}-{}", live.version.info.version) == basis_of_work;
        is_it.then_some(stance)
    }) else {
        return false;
    };
    let names: Vec<String> = app.live.robot().legs().iter().map(|leg| leg.name.clone()).collect();
    let scale = app.live.robot().scale();
    app.reach.begin(basis_of_work, names.len() * RESOLUTIONS_M.len());
    tell(app);
    let Ok(stop) = Stop::after(Some(DEADLINE_S)) else { return false };
    let guard = stop.guard();
    let changed = Arc::new(before.changed(&stance, &context));
    let mut shown: BTreeMap<String, Known> = BTreeMap::new();
    let mut found = before::Answers::new();
    let all = |resolution_m: f64| names.iter().map(move |name| (resolution_m, name.clone()));
    let answers = RESOLUTIONS_M.into_iter().enumerate();
    let answers: Vec<(usize, f64, String)> =
        answers.flat_map(|(i, m)| all(m).map(move |(m, name)| (i, m, name))).collect();
    for (closeness, resolution_m, name) in answers {
        let request = ReachabilityRequest {
            legs: Some(vec![name.clone()]),
            resolution_m: Some((resolution_m * scale).max(LEAST_RESOLUTION_M)),
            stability,
            ..ReachabilityRequest::default()
        };
        let known = before.answer(closeness, &name);
        let (context, stop, changed) = (context.clone(), stop.clone(), changed.clone());
        let work = move || reached(&context, &request, known.as_ref(), &changed, &stop);
        let mut work = tokio::task::spawn_blocking(work);
        let reached = loop {
            tokio::select! {
                reached = &mut work => break reached,
                () = tokio::time::sleep(LOOK) => {
                    // Another basis: dropping the guard ends the work.
                    if *app.closing.borrow() || basis(app).as_deref() != Some(basis_of_work) {
                        return false;
                    }
                }
            }
        };
        match reached {
            Ok(Ok(reached)) => {
                for (leg, cells) in reached {
                    found.insert((closeness, leg.clone()), Arc::new(cells.clone()));
                    // Another basis begins only after this work has ended.
                    app.reach.refine(basis_of_work, &leg, shown.get(&name), cells);
                }
                shown.extend(app.reach.cells(&name).map(|(_, cells)| (name.clone(), cells)));
            }
            Ok(Err(error)) => app.reach.fail(error.to_string()),
            Err(error) => {
                tracing::error!("the live reachability of {name} was not computed: {error}");
                app.reach.fail("it was not computed; the log of the server says why".into());
            }
        }
        app.reach.found();
        tell(app);
    }
    drop(guard);
    before.keep(stance, &context, found);
    true
}

/// One leg's cells: where only the map has changed, from those before.
fn reached(
    context: &Context,
    request: &ReachabilityRequest,
    before: Option<&Known>,
    changed: &Changed,
    stop: &Stop,
) -> Result<analyses::Reached, RequestError> {
    match (before, changed, request.legs.as_deref()) {
        (Some(before), Changed::Nothing, Some([leg])) => {
            Ok(vec![(leg.clone(), before.as_ref().clone())])
        }
        (Some(before), Changed::Within(area), _) => {
            analyses::reachability_again(context, request, before, area, stop)
        }
        _ => analyses::reachability(context, request, 1, stop),
    }
}

fn tell(app: &AppState) {
    let summary = app.reach.summary();
    let (mut ground, now) = app.live.locked();
    ground.publish(now, channel::ROVER_REACH, &summary);
}
