//! A reconstruction is asked for: the rover is told to take images, and they are waited for.

use std::time::Duration;

use bridge::commands::StageCommand;
use tokio::sync::OwnedSemaphorePermit;
use wire::check::{self, At, RequestError};
use wire::live::{FailedPair, ImageOrder, JobReport, SimulatedCameras};
use wire::reconstruction::{
    CAMERAS_MAX, CaptureAnswer, PairProgress, PairStage, RESOLUTION_M, ReconstructionRequest, SCALE,
};

use super::{
    DEADLINE_S, PairSource, RESOLUTION_DEFAULT_M, SCALE_DEFAULT, Work, begin, check_parts, chosen,
    reconstruct,
};
use crate::app::AppState;
use crate::error::ApiError;
use crate::imaging;
use crate::jobs::JobHandle;
use crate::stop::Stop;

/// Share of a reconstruction that is done when the images are here.
pub(super) const IMAGES_SHARE: f64 = 0.6;
/// Time between two looks at what has come.
const LOOK: Duration = Duration::from_millis(50);
/// Images may take so many times as long as they cost, and so many light times, before a job gives up. The
/// ground gives up asking for lost pieces long before.
const PATIENCE: f64 = 20.0;
const LIGHT_TIMES: f64 = 200.0;

/// What is to be waited for.
struct Wanted {
    /// Pairs that are here: capture and name.
    here: Vec<(String, String)>,
    /// The command for the others.
    command: Option<(StageCommand, Vec<String>)>,
}

/// Begins a reconstruction.
pub async fn start(
    app: AppState,
    who: String,
    request: ReconstructionRequest,
) -> Result<JobReport, ApiError> {
    let here = received(&app, &request.images)?;
    let rig = app.live.rig().clone();
    let pairs = match here.is_empty() || !request.cameras.is_empty() {
        true => chosen(&rig, &request.cameras)?,
        false => Vec::new(),
    };
    check::at_most(&At::root("images"), here.len() + pairs.len(), CAMERAS_MAX)?;
    let resolution_m = request.resolution_m.unwrap_or(RESOLUTION_DEFAULT_M);
    check::within(&At::root("resolution_m"), resolution_m, RESOLUTION_M, " m")?;
    let scale =
        check::within(&At::root("scale"), request.scale.unwrap_or(SCALE_DEFAULT), SCALE, "")?;
    check_parts(&request, &pairs)?;
    let busy = || ApiError::new("busy", "another reconstruction is under way; wait or cancel it");
    let place = app.reconstructions.place.clone().try_acquire_owned().map_err(|_| busy())?;
    app.live.latest()?;
    // Taken before the job begins: beginning one locks the link's ground, which comes first elsewhere.
    let work = {
        let mut kept = app.reconstructions.locked();
        let blended = begin(&kept, &request, resolution_m, here.len() + pairs.len())?;
        let simulated = request.simulated.as_ref().map(|simulated| simulated.seed);
        let seed = request.seed.or(simulated).unwrap_or(kept.n_begun);
        kept.n_begun += 1;
        Work {
            robot: app.live.robot().clone(),
            rig,
            ground: kept.ground.clone(),
            n_grounds: kept.n_grounds,
            resolution_m,
            scale,
            region: request.region,
            seed,
            keep_prior: request.keep_prior.unwrap_or(true),
            blended,
        }
    };
    let mut patience_s = DEADLINE_S;
    let mut command = None;
    if !pairs.is_empty() {
        let names: Vec<String> = pairs.iter().map(|pair| pair.name.clone()).collect();
        let order = ImageOrder {
            pairs: names.clone(),
            scale,
            scales: request.scales.clone(),
            depth_bits: request.depth_bits.unwrap_or(8),
            rate_bps: None,
            simulated: Some(SimulatedCameras {
                seed: work.seed,
                ..request.simulated.clone().unwrap_or_default()
            }),
        };
        let staged = imaging::command(&app, &who, None, &At::root("order"), &order)?;
        let (ground, now) = app.live.locked();
        if let Some(error) = ground.rehearse(now, &staged, &who).into_iter().next() {
            return Err(error.into());
        }
        let link = ground.link().config;
        let light_s = link.up_delay_s + link.down_delay_s;
        patience_s += PATIENCE * staged.duration_s + LIGHT_TIMES * light_s;
        command = Some((staged, names));
    }
    let job = app.jobs.begin("reconstruction", Stop::within(patience_s))?;
    let report = app.jobs.get(job.id())?;
    tokio::spawn(run(app, who, work, Wanted { here, command }, job, place));
    Ok(report)
}

/// The images that a request names, which must be here.
fn received(app: &AppState, ids: &[String]) -> Result<Vec<(String, String)>, RequestError> {
    let at = At::root("images");
    check::at_most(&at, ids.len(), CAMERAS_MAX)?;
    let (ground, _) = app.live.locked();
    let mut here: Vec<(String, String)> = Vec::with_capacity(ids.len());
    for (i, id) in ids.iter().enumerate() {
        let found = id.split_once('/').filter(|(capture, pair)| {
            let images = ground.images().pair(capture, pair);
            images.is_some_and(|images| images.iter().all(Option::is_some))
        });
        let Some((capture, pair)) = found else {
            let id: String = id.chars().take(128).collect();
            let text = format_args!(
                "is {id:?}, of which not both images are here; GET /rover/images lists what is"
            );
            return Err(RequestError::at("image_unknown", &at.index(i), text));
        };
        let pair = (capture.to_owned(), pair.to_owned());
        if !here.contains(&pair) {
            here.push(pair);
        }
    }
    Ok(here)
}

async fn run(
    app: AppState,
    who: String,
    work: Work,
    wanted: Wanted,
    job: JobHandle,
    place: OwnedSemaphorePermit,
) {
    let images = collect(&app, &who, wanted, &job).await;
    let entered = match images {
        Ok(images) => app.gate.enter().await.map(|permit| (images, permit)),
        Err(error) => Err(error),
    };
    let ((images, progress), permit) = match entered {
        Ok(entered) => entered,
        Err(error) => {
            drop(place);
            return job.end(Err(error));
        }
    };
    let work = move || {
        let outcome = reconstruct(&app, &who, work, images, progress, &job);
        // Whoever sees the end of the job finds the place free.
        drop((place, permit));
        job.end(outcome);
    };
    // A panic drops the job, which then counts as failed.
    if let Err(error) = tokio::task::spawn_blocking(work).await {
        tracing::error!("a reconstruction: {error}");
    }
}

type Images = (Vec<PairSource>, Vec<FailedPair>);

/// Asks for images and waits until they are here, or will not come.
async fn collect(
    app: &AppState,
    who: &str,
    wanted: Wanted,
    job: &JobHandle,
) -> Result<(Images, Vec<PairProgress>), ApiError> {
    let progress = |pair: &str, stage| PairProgress {
        pair: pair.to_owned(),
        stage,
        fraction: 0.0,
        message: None,
    };
    let here = wanted
        .here
        .iter()
        .map(|(_, pair)| PairProgress { fraction: 1.0, ..progress(pair, PairStage::Received) });
    let mut told: Vec<PairProgress> = here.collect();
    let n_here = told.len();
    let mut pairs = wanted.here;
    let mut why = None;
    if let Some((command, names)) = wanted.command {
        told.extend(names.iter().map(|name| progress(name, PairStage::Requested)));
        job.progress_of(0.0, "asks the rover for images", &told);
        let capture = send(app, who, command).await?;
        let answer = wait(app, who, &capture, job, &mut told, n_here).await?;
        pairs.extend(names.into_iter().map(|name| (capture.clone(), name)));
        why = answer.why;
    }
    let (mut sources, mut failed) = (Vec::new(), Vec::new());
    for ((capture, pair), told) in pairs.into_iter().zip(&told) {
        let images = app.live.locked().0.images().pair(&capture, &pair);
        match images {
            Some([Some(left), Some(right)]) => {
                sources.push(PairSource { capture, pair, images: [left, right] });
            }
            _ => {
                let why = told.message.clone().unwrap_or_else(|| "it has not come".into());
                failed.push(FailedPair { pair, why });
            }
        }
    }
    if sources.is_empty() {
        let why = why.unwrap_or_else(|| "nothing has come".into());
        let message = format!("no pair has come whole: {why}");
        return Err(ApiError::new("images_missing", message));
    }
    Ok(((sources, failed), told))
}

/// Stages, arms and sends a command in somebody's name; gives its identity.
async fn send(app: &AppState, who: &str, command: StageCommand) -> Result<String, ApiError> {
    let staged = {
        let (mut ground, now) = app.live.locked();
        ground.stage(now, command)?
    };
    let id = staged.written().await?.id;
    let sent = arm_and_send(app, who, &id).await;
    if sent.is_err() {
        let (mut ground, now) = app.live.locked();
        // Whatever is beyond recall is not staged any more.
        let _ = ground.cancel(now, &id, who);
    }
    sent.map(|()| id)
}

async fn arm_and_send(app: &AppState, who: &str, id: &str) -> Result<(), ApiError> {
    let armed = {
        let (mut ground, now) = app.live.locked();
        ground.arm(now, id, who)?
    };
    armed.written().await?;
    let release = {
        let (mut ground, now) = app.live.locked();
        ground.send(now, id, who)?
    };
    release.wait().await?;
    Ok(())
}

/// Waits for the images of a capture, telling how far they are.
async fn wait(
    app: &AppState,
    who: &str,
    capture: &str,
    job: &JobHandle,
    told: &mut [PairProgress],
    n_here: usize,
) -> Result<CaptureAnswer, ApiError> {
    loop {
        if let Err(error) = job.stop().check() {
            let (mut ground, now) = app.live.locked();
            ground.let_images_go(now, who, capture);
            return Err(error.into());
        }
        let answer = app.live.locked().0.images().answer(capture);
        let Some(answer) = answer else {
            let message = "the images are forgotten: too many others were asked for";
            return Err(ApiError::new("images_missing", message));
        };
        let before = told.to_vec();
        for (pair, told) in answer.pairs.iter().zip(told.iter_mut().skip(n_here)) {
            (told.stage, told.fraction) = match &pair.failed {
                Some(_) => (PairStage::Failed, pair.fraction),
                None if pair.received => (PairStage::Received, 1.0),
                None if pair.time.is_some() => (PairStage::OnTheWay, pair.fraction),
                None => (PairStage::Requested, 0.0),
            };
            told.message = pair.failed.clone();
        }
        let ended = answer.state != "on_the_way";
        if before != told {
            let settled = |p: &PairProgress| p.stage >= PairStage::Received;
            let share = |p: &PairProgress| if settled(p) { 1.0 } else { p.fraction };
            let share = told.iter().map(share).sum::<f64>() / told.len() as f64;
            let n = told.iter().filter(|p| settled(p)).count();
            let doing = format!("images: {n} of {} pairs are here", told.len());
            job.progress_of(IMAGES_SHARE * share, &doing, told);
        }
        if ended {
            let failed = told.iter_mut().skip(n_here).filter(|p| p.stage < PairStage::Received);
            for pair in failed {
                (pair.stage, pair.message) = (PairStage::Failed, answer.why.clone());
            }
            return Ok(answer);
        }
        tokio::time::sleep(LOOK).await;
    }
}
