//! A new map for the live rover, as a job.

use bridge::sim_adapter::SimAdapter;
use wire::live::{EventLevel, JobReport, RoverMode, TerrainNotice, channel};
use wire::resources::ImportRequest;

use crate::app::AppState;
use crate::error::ApiError;
use crate::imaging;
use crate::jobs::JobHandle;
use crate::stop::Stop;
use crate::terrain_store::{source_text, version_name};
use crate::world;

/// Time allowed for an import (s).
const DEADLINE_S: f64 = 600.0;

/// Begins an import.
pub fn start(app: AppState, who: String, request: ImportRequest) -> Result<JobReport, ApiError> {
    world::check_import(&request)?;
    if let Some(file) = &request.file {
        let path = app.terrain_file(file)?;
        if !path.is_file() {
            let message =
                format!("there is no file {file}; PUT /terrain/files/{file} puts it there");
            return Err(ApiError::new("terrain_file_unknown", message));
        }
    }
    rover_is_idle(&app)?;
    let job = app.jobs.begin("import", Stop::after(Some(DEADLINE_S))?)?;
    let report = app.jobs.get(job.id())?;
    tokio::spawn(async move {
        let permit = match app.gate.enter().await {
            Ok(permit) => permit,
            Err(error) => return job.end(Err(error)),
        };
        let work = move || {
            let _place = permit;
            let outcome = import(&app, &who, &request, &job);
            job.end(outcome);
        };
        // A panic drops the job, which then counts as failed.
        if let Err(error) = tokio::task::spawn_blocking(work).await {
            tracing::error!("an import: {error}");
        }
    });
    Ok(report)
}

fn rover_is_idle(app: &AppState) -> Result<(), ApiError> {
    if app.live.locked().0.carrier().is_some() {
        let message = "the rover is a process of its own, which stands on its own ground; start \
                       rover and server on the other ground";
        return Err(ApiError::new("rover_remote", message));
    }
    if app.live.latest()?.frame.mode == RoverMode::Idle {
        return Ok(());
    }
    let message = "the rover is not idle; wait for its command, or release the E-stop, before it \
                   is placed anew";
    Err(ApiError::new("rover_busy", message))
}

fn import(
    app: &AppState,
    who: &str,
    request: &ImportRequest,
    job: &JobHandle,
) -> Result<String, ApiError> {
    job.progress(0.05, "reads the ground");
    let map = world::import_map(&app.terrains, request)?;
    job.stop().check()?;
    job.progress(0.5, "seats the rover");
    let (robot, gravity) = (app.live.robot(), app.live.gravity());
    let pose = &app.config.rover.pose;
    let seated = world::seat(robot, &map, gravity, request.place_m, request.heading_rad, pose);
    let (rover, settled) = seated?;
    job.stop().check()?;
    rover_is_idle(app)?;
    let notice = TerrainNotice {
        version: version_name(&map),
        source: source_text(&map),
        synthetic_detail: map.source().synthetic_detail,
    };
    let text = format!(
        "new map: {}; the rover stands {:.2} m from the wished place, margin {:.2} m",
        notice.source, settled.moved_m, settled.margin_m
    );
    job.progress(0.8, "judges the ground");
    let version = app.store.prepare(map, app.clock.now());
    job.stop().check()?;
    let (mut ground, now) = app.live.locked();
    let silence_max_s = app.config.commands.silence_max_s();
    let cameras = imaging::cameras(app.live.rig());
    let adapter = SimAdapter::new(now, rover).with_silence_max(silence_max_s).with_cameras(cameras);
    ground.replace_rover(now, who, Box::new(adapter))?;
    if let Err(error) = version.layers() {
        let text = format!("the map has no traversability: {error}");
        ground.notice(now, EventLevel::Caution, "server", &text);
    }
    app.reconstructions.stand_on(version.map.clone());
    let name = version.info.version.clone();
    app.store.put(version);
    ground.publish(now, channel::TERRAIN, &notice);
    ground.notice(now, EventLevel::Info, who, &text);
    // Not with the link in hand: it writes a file.
    drop(ground);
    app.overlays.clear(&name);
    Ok("/api/v1/terrain/versions".into())
}
