//! The map of an earlier session made again from its flight log, with the images that were received last.
//!
//! A job: at the start of the server with the log of the session before, or asked for with any log. The map is put in
//! use only if it is the same version, byte for byte; otherwise it is told why not, and nothing changes. What it was
//! made from stays in that log, to which the record in the new one points.
//!
//! Bounds: the time of a reconstruction, one at a time, and half of the bytes of images that the ground holds.

use std::sync::Arc;

use bridge::catalog;
use bridge::images::ReceivedImage;
use bridge::reader::{IndexedLog, Limits};
use terrain::ElevationMap;
use tokio::sync::OwnedSemaphorePermit;
use wire::live::{EventLevel, JobReport};
use wire::reconstruction::MapStep;

use super::rebuild::{self, Basis, Outcome, Remade};
use super::versions::{InUse, put};
use super::{Blended, DEADLINE_S, read};
use crate::app::AppState;
use crate::error::ApiError;
use crate::jobs::JobHandle;
use crate::stop::Stop;

/// Most bytes of images that are brought back: half of what the ground holds, so that what comes has room.
const IMAGE_BYTES_MAX: usize = bridge::images::HELD_BYTES_MAX / 2;
/// Most captures that are brought back.
const CAPTURES_MAX: usize = bridge::images::CAPTURES_MAX / 4;
/// Share of the work that is done when the map is there.
const MAP_SHARE: f64 = 0.8;

/// Makes the map of the session before again, and tells if it cannot be.
pub async fn of_last_session(app: AppState, log: String) {
    if let Err(ApiError(error)) = start(&app, "server".into(), log.clone(), true).await {
        tell(&app, &log, &error.message);
    }
}

fn tell(app: &AppState, log: &str, why: &str) {
    let text = format!(
        "the map of the cameras was not made again from the log {log}: {why}. Ask the pairs again, or see what `footfall \
         log rebuild` tells of the log"
    );
    let (mut ground, now) = app.live.locked();
    ground.notice(now, EventLevel::Caution, "server", &text);
}

/// Begins the job; with `only_first` the map is put in use only where nothing was put in use meanwhile.
pub async fn start(
    app: &AppState,
    who: String,
    log: String,
    only_first: bool,
) -> Result<JobReport, ApiError> {
    let dir = app.config.server.logs_dir.clone();
    let id = log.clone();
    let opened =
        tokio::task::spawn_blocking(move || catalog::open_log(&dir, &id, Limits::default()));
    let opened = opened.await.map_err(|error| ApiError::internal("opening a log", error))??;
    let busy = || ApiError::new("busy", "a reconstruction is under way; wait or cancel it");
    let place = app.reconstructions.place.clone().try_acquire_owned().map_err(|_| busy())?;
    let version = only_first.then(|| app.store.current().info.version.clone());
    let job = app.jobs.begin("restore", Stop::within(DEADLINE_S))?;
    let report = app.jobs.get(job.id())?;
    tokio::spawn(run(app.clone(), Work { who, id: log, log: opened, version }, job, place));
    Ok(report)
}

/// What is to be done.
struct Work {
    who: String,
    id: String,
    log: IndexedLog,
    /// The version that must be in use still.
    version: Option<String>,
}

async fn run(app: AppState, mut work: Work, job: JobHandle, place: OwnedSemaphorePermit) {
    let permit = match app.gate.enter().await {
        Ok(permit) => permit,
        Err(error) => return job.end(Err(error)),
    };
    let work = move || {
        let map = restored(&app, &mut work, &job);
        // The images are of use without the map, too.
        let images = if job.stop().asked() { Ok(0) } else { bring_back(&app, &mut work.log, &job) };
        let outcome = map.and_then(|version| images.map(|_| version));
        if let Err(ApiError(error)) = &outcome {
            tell(&app, &work.id, &error.message);
        }
        // Whoever sees the end of the job finds the place free.
        drop((place, permit));
        job.end(outcome.map(|version| format!("/api/v1/terrain/versions/{version}")));
    };
    if let Err(error) = tokio::task::spawn_blocking(work).await {
        tracing::error!("a map made again: {error}");
    }
}

/// Makes the map and puts it in use; its name.
fn restored(app: &AppState, work: &mut Work, job: &JobHandle) -> Result<String, ApiError> {
    let (ground, n_grounds) = {
        let kept = app.reconstructions.locked();
        (kept.ground.clone(), kept.n_grounds)
    };
    let logs_dir = Some(app.config.server.logs_dir.clone());
    let (robot, rig) = (app.live.robot(), app.live.rig());
    let basis = Basis { robot, rig, ground: &ground, logs_dir };
    let mut tell = |i: usize, n: usize| {
        let doing = format!("makes version {} of {n} of the map again", i + 1);
        job.progress(MAP_SHARE * i as f64 / n.max(1) as f64, &doing);
    };
    let made = rebuild::remake(&mut work.log, &basis, job.stop(), 0, &mut tell)?;
    let (version, blended) = newest(made)?;
    job.progress(MAP_SHARE, "judges the ground");
    let map = map_of(&blended, &ground)?;
    let made = app.store.prepare_seen(map, app.clock.now(), blended.seen_by(None));
    job.stop().check()?;
    let of = InUse { n_grounds, version: work.version.clone() };
    let text = format!("map {version} of the cameras was made again from the log {}", work.id);
    let step = MapStep::Restored { log: work.id.clone() };
    // In the log of this session it goes on from none.
    let blended = Blended { from: None, ..blended };
    put(app, &work.who, made, &of, &text, (Some(blended), step))?;
    Ok(version)
}

fn map_of(blended: &Blended, ground: &ElevationMap) -> Result<ElevationMap, ApiError> {
    Ok(read(blended.mapper.version(), ground, blended.keep_prior, &blended.pair_names())?)
}

/// What was in use at the end of a log, if it is the same as it was.
fn newest(made: Remade) -> Result<(String, Blended), ApiError> {
    let refuse = |why: String| Err(ApiError::new("map_not_restored", why));
    let Some(last) = made.last.filter(|last| last.blended.is_some()) else {
        return refuse("no map that cameras made was in use at its end".into());
    };
    let version = last.terrain_version;
    let outcome = made.rebuilt.into_iter().rev().find(|rebuilt| rebuilt.version == version);
    match outcome.map(|rebuilt| rebuilt.outcome) {
        Some(Outcome::Same) => {}
        Some(Outcome::Lacks { why }) => return refuse(why),
        Some(Outcome::Differs { version: now, .. }) => {
            return refuse(format!(
                "it would be {now} instead of {version}: robot or program are others"
            ));
        }
        None => return refuse("the log does not tell how it was made".into()),
    }
    match made.states.into_iter().rev().find(|(of, _)| *of == version) {
        Some((_, blended)) => Ok((version, blended)),
        None => refuse("the log does not tell how it was made".into()),
    }
}

/// Brings the images back that were received last, newest captures first as far as there is room; the number of captures.
fn bring_back(app: &AppState, log: &mut IndexedLog, job: &JobHandle) -> Result<usize, ApiError> {
    let heads = rebuild::heads(log)?;
    let mut captures: Vec<(wire::time::Timestamp, String)> = Vec::new();
    for told in heads.values() {
        let (time, id) = (told.head.time, &told.head.image.capture);
        match captures.iter_mut().find(|(_, known)| known == id) {
            Some((newest, _)) => *newest = (*newest).max(time),
            None => captures.push((time, id.clone())),
        }
    }
    captures.sort_by(|a, b| b.cmp(a));
    let (mut n, mut bytes) = (0, 0);
    for (_, id) in captures.into_iter().take(CAPTURES_MAX) {
        job.stop().check()?;
        let told: Vec<_> = heads.values().filter(|told| told.head.image.capture == id).collect();
        bytes += told.iter().map(|told| told.head.bytes as usize).sum::<usize>();
        if bytes > IMAGE_BYTES_MAX {
            break;
        }
        job.progress(0.9, &format!("reads the images of {} cameras", told.len()));
        let mut images = Vec::with_capacity(told.len());
        for told in told {
            if let Some(png) = rebuild::png(log, &told.topic, &told.head)? {
                images.push(Arc::new(ReceivedImage { head: told.head.clone(), png: png.into() }));
            }
        }
        n += usize::from(app.live.locked().0.bring_back_images(&id, images));
    }
    Ok(n)
}
