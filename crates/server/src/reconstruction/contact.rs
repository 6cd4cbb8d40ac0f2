//! Wheels that stand correct the map that cameras made: where a foot was put down, the ground is as high as its
//! contact.
//!
//! As soon as the rover is still, each standing wheel is held against the places where wheels stood when the map was
//! last told of them. What stands elsewhere becomes a version of its own, by [`Input::Contact`] as in a
//! reconstruction. By no more than `CORRECTION_MAX_M`: where contact and map differ more, one of them is in the
//! wrong place, which no patch of ground mends; that is told, and the map stays as it is.
//!
//! Plans hold over such a version ([`holds_over`]): it differs from the one before under a standing wheel only, where
//! nothing else can be.
//!
//! [`Input::Contact`]: terrain::fusion::Input::Contact

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::Point3;
use terrain::fusion::{MapVersion, ReadPolicy};
use wire::live::{EventLevel, RoverMode, RoverTelemetry};
use wire::map_version::VersionStep;
use wire::reconstruction::{ContactStep, MapStep, StoodWheel};

use super::versions::{InUse, put, told};
use super::{Blended, Kept, read};
use crate::app::AppState;
use crate::error::ApiError;

/// Time between looks at the wheels.
const LOOK: Duration = Duration::from_millis(250);
/// A wheel within this of where one stood is where the map has it (m at scale 1), across and upward.
const SAME_M: [f64; 2] = [0.02, 0.005];
/// Ground is set higher or lower by a contact by no more than this (m at scale 1): as far as pairs are moved to
/// fit.
const CORRECTION_MAX_M: f64 = 0.15;
/// Versions whose descent is remembered.
const CHAIN_MAX: usize = 256;

/// Keeps the map up to date with the wheels until the server ends.
pub async fn run(app: AppState) {
    let mut closing = app.closing.clone();
    loop {
        tokio::select! {
            _ = closing.wait_for(|closing| *closing) => return,
            () = tokio::time::sleep(LOOK) => {}
        }
        settled(&app).await;
    }
}

/// Tells the map of wheels that stand where it does not know of, if there are any. What is asked of the live rover
/// begins with this, so that no answer is about wheels in the ground of an older map.
pub async fn settled(app: &AppState) {
    if due(app).is_none() {
        return;
    }
    let inner = app.clone();
    // A change or reconstruction meanwhile wins, and knows of the wheels or is looked at again.
    match tokio::task::spawn_blocking(move || catch_up(&inner)).await {
        Ok(Err(ApiError(error))) if error.code != "cancelled" => {
            tracing::warn!("standing wheels were not told to the map: {}", error.message);
        }
        Err(error) => tracing::error!("standing wheels were not told to the map: {error}"),
        Ok(_) => {}
    }
}

/// Is a plan that was made on the first of two maps good on the second? Where only standing wheels were told to the
/// map between the two.
pub fn holds_over(app: &AppState, before: &str, now: &str) -> bool {
    app.reconstructions.locked().goes_back_to(now, before)
}

impl Kept {
    /// Goes a version back to another by contacts of wheels alone?
    fn goes_back_to(&self, version: &str, other: &str) -> bool {
        let mut at = version;
        for _ in 0..CHAIN_MAX {
            if at == other {
                return true;
            }
            let Some((_, since)) = self.touched.iter().rev().find(|(of, _)| of == at) else {
                return false;
            };
            at = since;
        }
        false
    }
}

/// The wheels that bear the still rover, by leg, which the map does not know of; none where there is nothing to
/// do.
fn due(app: &AppState) -> Option<(RoverTelemetry, BTreeMap<String, Point3<f64>>)> {
    let latest = app.live.latest().ok()?;
    if latest.frame.mode == RoverMode::Executing {
        return None;
    }
    let bears = |leg: &String| latest.frame.contacts.get(leg) == Some(&true);
    let points = latest.frame.contact_points_m.iter().filter(|(leg, _)| bears(leg));
    let wheels: BTreeMap<String, Point3<f64>> =
        points.map(|(leg, p)| (leg.clone(), Point3::from(*p))).collect();
    let scale = app.live.robot().scale();
    let kept = app.reconstructions.locked();
    let blended = kept.blended.as_ref()?;
    let new = blended.news(&wheels, scale);
    (!new.is_empty()).then_some((latest.frame, new))
}

impl Blended {
    /// Of wheels those that stand where none stood when the map was last told.
    fn news(
        &self,
        wheels: &BTreeMap<String, Point3<f64>>,
        scale: f64,
    ) -> BTreeMap<String, Point3<f64>> {
        let same = |a: &Point3<f64>, b: &Point3<f64>| {
            let off = a - b;
            off.xy().norm() <= SAME_M[0] * scale && off.z.abs() <= SAME_M[1] * scale
        };
        let is_new = |p: &Point3<f64>| !self.stood.iter().any(|known| same(known, p));
        let new = wheels.iter().filter(|(_, p)| is_new(p));
        new.map(|(leg, p)| (leg.clone(), *p)).collect()
    }

    /// Sets the ground under wheels as a step says.
    pub(super) fn contacts(&mut self, step: &ContactStep) -> Result<(), ApiError> {
        let ns = i64::try_from(step.time.0).unwrap_or(i64::MAX);
        let wheels: Vec<Point3<f64>> =
            step.wheels.iter().map(|wheel| Point3::from(wheel.contact_m)).collect();
        self.touch(&wheels, step.wheel_radius_m, ns)?;
        self.stood.extend(wheels);
        Ok(())
    }
}

/// By how much a contact would change the height of the map at its place (m); none where that is unknown.
fn correction(map: &MapVersion, keep_prior: bool, p: &Point3<f64>) -> Option<f64> {
    let cell = map.cell_at(p.xy())?;
    let policy = ReadPolicy { use_prior: keep_prior, use_masked: true, use_conflicts: false };
    let height = f64::from(MapVersion::read(&cell, policy));
    (!height.is_nan()).then_some(p.z - height)
}

fn catch_up(app: &AppState) -> Result<(), ApiError> {
    // A reconstruction that is under way sets the ground under wheels itself.
    if app.reconstructions.place.available_permits() == 0 {
        return Ok(());
    }
    let Some((_, wheels)) = due(app) else { return Ok(()) };
    let scale = app.live.robot().scale();
    let time = app.live.latest()?.onboard_time;
    let (mut blended, ground, n_grounds, in_use) = {
        let mut kept = app.reconstructions.locked();
        let in_use = app.store.current().info.version.clone();
        let (n_grounds, ground) = (kept.n_grounds, kept.ground.clone());
        let Some(blended) = &mut kept.blended else { return Ok(()) };
        if blended.from.as_ref() != Some(&in_use) {
            return Ok(());
        }
        (blended.clone(), ground, n_grounds, in_use)
    };
    let before = blended.mapper.version().clone();
    let (near, far): (Vec<_>, Vec<_>) = wheels.into_iter().partition(|(_, p)| {
        correction(&before, blended.keep_prior, p)
            .is_none_or(|dz| dz.abs() <= CORRECTION_MAX_M * scale)
    });
    if !far.is_empty() {
        // Told once: from now on they count as known.
        let mut kept = app.reconstructions.locked();
        if let Some(kept) = &mut kept.blended {
            kept.stood.extend(far.iter().map(|(_, p)| *p));
        }
        drop(kept);
        for (leg, p) in &far {
            let dz = correction(&before, blended.keep_prior, p).unwrap_or_default();
            let side = if dz > 0.0 { "above" } else { "below" };
            let text = format!(
                "{leg} stands {:.2} m {side} the ground of the map, which is more than a contact mends: look \
                 at that ground again before relying on it",
                dz.abs()
            );
            app.live.notice(EventLevel::Caution, "server", &text);
        }
        blended.stood.extend(far.iter().map(|(_, p)| *p));
    }
    if near.is_empty() {
        return Ok(());
    }
    let robot = app.live.robot();
    let radii = robot.leg_ids().map(|leg| robot.leg(leg).wheel.radius);
    let names: Vec<&str> = near.iter().map(|(leg, _)| leg.as_str()).collect();
    let what = format!("wheel contact: {}", names.join(", "));
    let wheels =
        near.iter().map(|(leg, p)| StoodWheel { leg: leg.clone(), contact_m: (*p).into() });
    let step =
        ContactStep { wheels: wheels.collect(), wheel_radius_m: radii.fold(0.0, f64::max), time };
    blended.contacts(&step)?;
    let after = blended.mapper.version().clone();
    let changes = after.changes_since(&before);
    let changes = told(&in_use, VersionStep::Contact, what.clone(), &changes, after.resolution_m());
    let map = read(&after, &ground, blended.keep_prior, &blended.pair_names())?;
    let made = app.store.prepare_seen(map, app.clock.now(), blended.seen_by(Some(changes)));
    let name = made.info.version.clone();
    let of = InUse { n_grounds, version: Some(in_use.clone()) };
    let text = format!("map corrected by {what}");
    put(app, "server", made, &of, &text, (Some(blended), MapStep::Contact(step)))?;
    let mut kept = app.reconstructions.locked();
    kept.touched.push_back((name, in_use));
    if kept.touched.len() > CHAIN_MAX {
        kept.touched.pop_front();
    }
    Ok(())
}
