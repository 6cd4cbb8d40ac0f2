//! The map made again of what is kept: without a pair, with a fit undone, or as it was before.

use std::sync::Arc;

use terrain::fusion::{Changes, Correction, Input, MapVersion};
use wire::check::{At, RequestError};
use wire::live::{EventLevel, TerrainNotice, channel};
use wire::map_version::{VersionChanges, VersionPair, VersionStep};
use wire::reconstruction::{MapRecord, MapStep, ReconstructedPair, WheelSolid};
use wire::resources::TerrainVersion;
use wire::time::Timestamp;

use super::{Blended, Kept, contact, read};
use crate::app::AppState;
use crate::error::ApiError;
use crate::terrain_store::{SeenBy, Version, version_name};
use crate::terrains::terrain_error;

/// What is done to the map in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Take a capture out.
    Remove(u32),
    /// Put a capture where it fitted the map (true), or where it says it is.
    Fit(u32, bool),
}

impl Change {
    /// As the log has it.
    fn step(self) -> MapStep {
        match self {
            Change::Remove(source) => MapStep::Removed { source },
            Change::Fit(source, fitted) => MapStep::Fit { source, fitted },
        }
    }
}

impl Blended {
    /// Remembers what is told of the pairs that a reconstruction brought.
    pub(super) fn note(&mut self, pairs: &[ReconstructedPair], time: Timestamp, id: &str) {
        for pair in pairs {
            let Some(source) = pair.source else { continue };
            let captured = VersionPair {
                source,
                name: pair.name.clone(),
                capture_time: time,
                reconstruction: id.to_owned(),
                cells: pair.cells,
                epipolar_px: pair.epipolar_px,
                fill: pair.fill,
                plane_residual_m: pair.plane_residual_m,
                shift_m: pair.shift_m,
                yaw_rad: pair.yaw_rad,
                fitted: !pair.fit_refused,
                fit_refused: pair.fit_refused,
            };
            self.captures.push(captured);
        }
    }

    /// What a version made of this tells of its pairs.
    pub(super) fn seen_by(&self, changes: Option<VersionChanges>) -> SeenBy {
        SeenBy {
            map: self.mapper.version().clone(),
            pairs: self.names.clone(),
            captures: self.captures.clone(),
            shots: self
                .shots
                .placed(self.mapper.pairs().map(|p| (p.source, p.alignment.correction))),
            changes,
        }
    }

    /// The names of its pairs, each once.
    pub(super) fn pair_names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for capture in &self.captures {
            if !names.contains(&capture.name.as_str()) {
                names.push(&capture.name);
            }
        }
        names
    }

    pub(super) fn apply(&mut self, change: Change) -> Result<(VersionStep, String), ApiError> {
        let (Change::Remove(source) | Change::Fit(source, _)) = change;
        let unknown = || {
            let message = format!(
                "the map in use has no capture {source}; GET /terrain/versions tells which it has"
            );
            ApiError::new("capture_unknown", message)
        };
        let at = self.captures.iter().position(|c| c.source == source).ok_or_else(unknown)?;
        let name = self.captures[at].name.clone();
        let refuse = |error| terrain_error(&At::root("source"), &error);
        match change {
            Change::Remove(_) => {
                self.mapper.remove(source).map_err(refuse)?;
                self.captures.remove(at);
                self.names.remove(&source);
                self.shots.remove(source);
                self.found.remove(&source);
                Ok((VersionStep::Removed, format!("without {name}")))
            }
            Change::Fit(_, fitted) => {
                let found = self.found_fit(source).ok_or_else(unknown)?;
                if self.captures[at].fit_refused || found == Correction::NONE {
                    let message = format!("{name} was not moved: there is no fit to undo");
                    return Err(ApiError::new("fit_refused", message));
                }
                let correction = if fitted { found } else { Correction::NONE };
                self.mapper.correct(source, correction).map_err(refuse)?;
                self.captures[at].fitted = fitted;
                let (step, words) = match fitted {
                    true => (VersionStep::FitRedone, "fitted again"),
                    false => (VersionStep::FitUndone, "fit undone"),
                };
                Ok((step, format!("{name}: {words}")))
            }
        }
    }

    /// The correction that was found for a pair, remembered before it is undone.
    fn found_fit(&mut self, source: u32) -> Option<Correction> {
        if let Some(found) = self.found.get(&source) {
            return Some(*found);
        }
        let found = self.mapper.pairs().find(|pair| pair.source == source)?.alignment.correction;
        self.found.insert(source, found);
        Some(found)
    }

    /// Sets the ground where wheels stand.
    pub(super) fn touch(
        &mut self,
        wheels: &[nalgebra::Point3<f64>],
        wheel_radius_m: f64,
        time_ns: i64,
    ) -> Result<(), RequestError> {
        let least_m = 1.5 * self.mapper.settings().resolution_m;
        let radius_m = least_m.max(CONTACT_SHARE * wheel_radius_m);
        for position_m in wheels {
            let source = self.next_source;
            let contact = Input::Contact {
                source,
                position_m: *position_m,
                normal: nalgebra::Vector3::z_axis(),
                radius_m,
                variance_m2: CONTACT_SIGMA_M * CONTACT_SIGMA_M,
                time_ns,
            };
            let refuse = |error| terrain_error(&At::root("contact_points_m"), &error);
            self.mapper.push(contact).map_err(refuse)?;
            self.next_source += 1;
        }
        Ok(())
    }

    /// Tells that there is no ground where wheels are.
    pub(super) fn clear(
        &mut self,
        solids: &[WheelSolid],
        time_ns: i64,
    ) -> Result<(), RequestError> {
        for solid in solids {
            let stood = Input::Stood {
                source: self.next_source,
                wheel: contact::standing_wheel(solid)?,
                most_m: solid.correction_max_m,
                variance_m2: CONTACT_SIGMA_M * CONTACT_SIGMA_M,
                time_ns,
            };
            let refuse = |error| terrain_error(&At::root("solid"), &error);
            self.mapper.push(stood).map_err(refuse)?;
            self.next_source += 1;
        }
        Ok(())
    }
}

/// What a wheel stands over is set within this share of its radius: there the wheel is so near to the ground
/// (a fifth of its radius) that the noise of the match would reach into it.
const CONTACT_SHARE: f64 = 0.6;
/// Standard deviation of the height where a wheel stands (m).
const CONTACT_SIGMA_M: f64 = 0.01;

impl Kept {
    /// Makes this the state that reconstructions go on from, and that the version stands for.
    pub(super) fn take(&mut self, version: &str, blended: Blended, most: usize) {
        self.states.retain(|(name, _)| name != version);
        let blended = Blended { from: Some(version.to_owned()), ..blended };
        self.states.push_back((version.to_owned(), blended.clone()));
        while self.states.len() > most {
            self.states.pop_front();
        }
        self.blended = Some(blended);
    }
}

/// What is told of the changes of a map.
pub(super) fn told(
    since: &str,
    step: VersionStep,
    what: String,
    changes: &Changes,
    resolution_m: f64,
) -> VersionChanges {
    let area = |n: usize| n as f64 * resolution_m * resolution_m;
    VersionChanges {
        since: since.to_owned(),
        step,
        what,
        changed_cells: changes.cells,
        changed_m2: area(changes.cells),
        new_cells: changes.appeared,
        new_m2: area(changes.appeared),
        gone_cells: changes.vanished,
        gone_m2: area(changes.vanished),
    }
}

/// Makes the map in use again with a change: a new version.
pub async fn change(
    app: AppState,
    who: String,
    version: String,
    change: Change,
) -> Result<TerrainVersion, ApiError> {
    let place = app.reconstructions.place.clone().try_acquire_owned().map_err(|_| busy())?;
    let permit = app.gate.enter().await?;
    let work = move || {
        let _held = (place, permit);
        changed(&app, &who, &version, change)
    };
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|error| ApiError::internal("changing the map", error))?
}

fn busy() -> ApiError {
    ApiError::new("busy", "a reconstruction is under way; wait or cancel it")
}

fn changed(
    app: &AppState,
    who: &str,
    version: &str,
    change: Change,
) -> Result<TerrainVersion, ApiError> {
    app.store.get(&At::root("version"), version)?;
    let (mut blended, ground, n_grounds) = {
        let kept = app.reconstructions.locked();
        if app.store.current().info.version != version {
            let message = "only the map in use can be changed; select that version first";
            return Err(ApiError::new("not_current", message));
        }
        let blended = kept
            .blended
            .clone()
            .ok_or_else(|| ApiError::new("capture_unknown", "no camera has made the map in use"))?;
        (blended, kept.ground.clone(), kept.n_grounds)
    };
    let before: Arc<MapVersion> = blended.mapper.version().clone();
    let (step, what) = blended.apply(change)?;
    let after = blended.mapper.version().clone();
    let resolution_m = after.resolution_m();
    let changes = told(version, step, what.clone(), &after.changes_since(&before), resolution_m);
    let map = read(&after, &ground, blended.keep_prior, &blended.pair_names())?;
    let made = app.store.prepare_seen(map, app.clock.now(), blended.seen_by(Some(changes)));
    let info = made.info.clone();
    put(
        app,
        who,
        made,
        &InUse { n_grounds, version: None },
        &format!("map changed: {what}"),
        (Some(blended), change.step()),
    )?;
    Ok(info)
}

/// Puts an older version in use again, with what reconstructions go on from.
pub fn select(app: &AppState, who: &str, name: &str) -> Result<TerrainVersion, ApiError> {
    let place = app.reconstructions.place.clone().try_acquire_owned();
    let _place = place.map_err(|_| busy())?;
    let version = app.store.get(&At::root("version"), name)?;
    let (blended, n_grounds) = {
        let kept = app.reconstructions.locked();
        let state = kept.states.iter().find(|(of, _)| of == name);
        if state.is_none() && version_name(&kept.ground) != name {
            let message = "that map is of other ground than the rover stands on";
            return Err(ApiError::new("other_ground", message));
        }
        (state.map(|(_, blended)| blended.clone()), kept.n_grounds)
    };
    let info = version.info.clone();
    put(
        app,
        who,
        version,
        &InUse { n_grounds, version: None },
        &format!("map {name} is in use again"),
        (blended, MapStep::Selected {}),
    )?;
    Ok(info)
}

/// What a version was made from, which must still be so when it is put in use.
pub(super) struct InUse {
    /// Number of the ground that the rover stands on.
    pub n_grounds: u64,
    /// The version in use; none where it need not be the same.
    pub version: Option<String>,
}

/// Puts a version in use, unless the rover was placed on other ground meanwhile, or what it was made from is
/// in use no more.
pub(super) fn put(
    app: &AppState,
    who: &str,
    version: Arc<Version>,
    of: &InUse,
    text: &str,
    (blended, step): (Option<Blended>, MapStep),
) -> Result<(), ApiError> {
    let notice = TerrainNotice {
        version: version.info.version.clone(),
        source: version.info.source.clone(),
        synthetic_detail: version.info.synthetic_detail,
    };
    // The ground of the link first: an import holds it when it changes what the rover stands on.
    let (mut ground, now) = app.live.locked();
    let mut kept = app.reconstructions.locked();
    if kept.n_grounds != of.n_grounds {
        let message = "another ground was imported meanwhile; ask again";
        return Err(ApiError::new("cancelled", message));
    }
    if of.version.as_ref().is_some_and(|made_from| *made_from != app.store.current().info.version) {
        return Err(ApiError::new("cancelled", "another map was put in use meanwhile"));
    }
    let record = MapRecord {
        terrain_version: notice.version.clone(),
        blended: blended.as_ref().map(|blended| blended.mapper.version().id().to_string()),
        from: blended.as_ref().and_then(|blended| blended.from.clone()),
        step,
    };
    match blended {
        Some(blended) => {
            kept.take(&notice.version, blended, app.config.server.terrain_versions_max);
        }
        None => kept.blended = None,
    }
    if let Err(error) = version.layers() {
        let text = format!("the map has no traversability: {error}");
        ground.notice(now, EventLevel::Caution, "server", &text);
    }
    app.store.put(version);
    ground.publish(now, channel::TERRAIN, &notice);
    ground.publish(now, channel::MAP, &record);
    ground.notice(now, EventLevel::Info, who, text);
    Ok(())
}
