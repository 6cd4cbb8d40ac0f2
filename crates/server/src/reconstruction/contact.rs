//! Wheels that stand correct the map that cameras made: where a foot was put down, the ground is as high as its
//! contact, and where its wheel is there is none.
//!
//! As soon as the rover is still, each standing wheel is held against the places where wheels stood when the map was
//! last told of them. What stands elsewhere becomes a version of its own, by [`Input::Contact`] as in a
//! reconstruction. By no more than `CORRECTION_MAX_M`: where contact and map differ more, one of them is in the
//! wrong place, which no patch of ground mends; that is told, and the map stays as it is. The same holds of ground
//! beside the contact that was told to be where the wheel is, by [`Input::Stood`]: it is lowered to below the wheel as
//! the rover reports it, raised to its contact where it is told to be pressed down, cell by cell.
//!
//! Plans hold over such a version ([`holds_over`]): it differs from the one before under a standing wheel only, where
//! nothing else can be.
//!
//! [`Input::Contact`]: terrain::fusion::Input::Contact
//! [`Input::Stood`]: terrain::fusion::Input::Stood

use std::time::Duration;

use nalgebra::{Point3, Unit, Vector3};
use rover::{LegId, Posture, Robot, WheelPose};
use terrain::fusion::{MapVersion, ReadPolicy, StandingWheel};
use wire::check::{At, RequestError};
use wire::convert;
use wire::live::{EventLevel, RoverMode, RoverTelemetry};
use wire::map_version::VersionStep;
use wire::reconstruction::{ContactStep, MapStep, StoodWheel, WheelSolid};

use super::versions::{InUse, put, told};
use super::{Blended, Kept, read};
use crate::app::AppState;
use crate::error::ApiError;

/// Time between looks at the wheels.
const LOOK: Duration = Duration::from_millis(250);
/// A wheel within this of where one stood is where the map has it (m at scale 1), across and upward.
const SAME_M: [f64; 2] = [0.02, 0.005];
/// ... and its axle, up to so much (rad).
const SAME_AXLE_RAD: f64 = 0.02;
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

/// The wheels that bear the still rover which the map does not know of; none where there is nothing to do.
fn due(app: &AppState) -> Option<Vec<StoodWheel>> {
    let latest = app.live.latest().ok()?;
    if latest.frame.mode == RoverMode::Executing {
        return None;
    }
    let wheels = stood(app.live.robot(), &latest.frame);
    let kept = app.reconstructions.locked();
    let new = kept.blended.as_ref()?.news(wheels, app.live.robot().scale());
    (!new.is_empty()).then_some(new)
}

/// The wheels that bear the rover, with the room that they take by its reported posture.
pub(super) fn stood(robot: &Robot, frame: &RoverTelemetry) -> Vec<StoodWheel> {
    let configuration = convert::configuration(&At::root("state"), robot, &frame.state).ok();
    let posture = configuration.map(|configuration| Posture::new(robot, &configuration));
    let solid = |leg: LegId, contact: [f64; 3]| {
        let wheel = posture.as_ref()?.wheel(robot, leg);
        let up = Vector3::z() * sunk_m(&wheel, &contact.into());
        Some(WheelSolid {
            center_m: (wheel.center() + up).into(),
            axle: wheel.axle().into_inner().into(),
            radius_m: wheel.radius,
            width_m: wheel.width,
            ball: wheel.ball,
            correction_max_m: CORRECTION_MAX_M * robot.scale(),
        })
    };
    let bears = |name: &str| frame.contacts.get(name) == Some(&true);
    let legs = robot.leg_ids().map(|leg| (leg, robot.leg(leg).name.as_str()));
    let stands = legs.filter(|(_, name)| bears(name)).filter_map(|(leg, name)| {
        let contact_m = *frame.contact_points_m.get(name)?;
        Some(StoodWheel { leg: name.to_owned(), contact_m, solid: solid(leg, contact_m) })
    });
    stands.collect()
}

/// How far a wheel is to be raised for its contact not to be inside of it (m): it is told to be pressed down, and gives
/// way.
fn sunk_m(wheel: &WheelPose, contact: &Point3<f64>) -> f64 {
    let axle = if wheel.ball { Vector3::zeros() } else { wheel.axle().into_inner() };
    let across = |v: Vector3<f64>| v - axle * v.dot(&axle);
    let (off, up) = (across(contact - wheel.center()), across(Vector3::z()));
    // |off - t up| = radius, where the contact comes out below.
    let (a, b) = (up.norm_squared(), off.dot(&up));
    let c = off.norm_squared() - wheel.radius * wheel.radius;
    if c >= 0.0 || a < 1e-6 {
        return 0.0;
    }
    (b + (b * b - a * c).sqrt()) / a
}

/// The wheel for the map.
pub(super) fn standing_wheel(solid: &WheelSolid) -> Result<StandingWheel, RequestError> {
    let axle = Vector3::from(solid.axle);
    let axle = Unit::try_new(axle, 0.5).filter(|unit| (unit.into_inner() - axle).norm() < 1e-3);
    let axle = axle.ok_or_else(|| {
        let text = format_args!("is {:?}; it must be of length 1", solid.axle);
        RequestError::at("out_of_range", &At::root("solid").field("axle"), text)
    })?;
    Ok(StandingWheel {
        center_m: solid.center_m.into(),
        axle,
        radius_m: solid.radius_m,
        width_m: solid.width_m,
        ball: solid.ball,
    })
}

/// What is to be told where a map has ground in a standing wheel that no contact mends.
pub(super) fn conflicts(
    map: &MapVersion,
    wheels: &[StoodWheel],
) -> Result<Vec<String>, RequestError> {
    let mut told = Vec::new();
    for wheel in wheels {
        let Some(solid) = &wheel.solid else { continue };
        let reached = standing_wheel(solid)?.reached_into(map);
        let Some((index, over)) = reached.filter(|(_, over)| *over > solid.correction_max_m) else {
            continue;
        };
        let [x, y] = index.map(|i| f64::from(i) * map.resolution_m());
        told.push(format!(
            "the map has ground in the wheel of {}, which stands: {over:.2} m too high at ({x:.2}, {y:.2}), which \
             is more than a contact mends: look at that ground again before relying on it",
            wheel.leg
        ));
    }
    Ok(told)
}

impl Blended {
    /// Of wheels those that stand where, or as, none stood when the map was last told.
    fn news(&self, wheels: Vec<StoodWheel>, scale: f64) -> Vec<StoodWheel> {
        let is_known = |new: &StoodWheel| self.stood.iter().any(|known| same(known, new, scale));
        wheels.into_iter().filter(|wheel| !is_known(wheel)).collect()
    }

    /// Sets the ground under wheels as a step says.
    pub(super) fn contacts(&mut self, step: &ContactStep) -> Result<(), ApiError> {
        let ns = i64::try_from(step.time.0).unwrap_or(i64::MAX);
        let wheels: Vec<Point3<f64>> =
            step.wheels.iter().map(|wheel| Point3::from(wheel.contact_m)).collect();
        self.touch(&wheels, step.wheel_radius_m, ns)?;
        let solids: Vec<WheelSolid> =
            step.wheels.iter().filter_map(|wheel| wheel.solid.clone()).collect();
        self.clear(&solids, ns)?;
        self.stood.extend(step.wheels.iter().cloned());
        Ok(())
    }
}

/// Does a wheel stand as another did?
fn same(a: &StoodWheel, b: &StoodWheel, scale: f64) -> bool {
    let is_at = |a: [f64; 3], b: [f64; 3]| {
        let off = Point3::from(a) - Point3::from(b);
        off.xy().norm() <= SAME_M[0] * scale && off.z.abs() <= SAME_M[1] * scale
    };
    let turned = |a: &WheelSolid, b: &WheelSolid| {
        let [a, b] = [a.axle, b.axle].map(Vector3::from);
        a.cross(&b).norm()
    };
    let as_one = match (&a.solid, &b.solid) {
        (Some(a), Some(b)) => {
            is_at(a.center_m, b.center_m) && (a.ball || turned(a, b) <= SAME_AXLE_RAD)
        }
        _ => true,
    };
    as_one && is_at(a.contact_m, b.contact_m)
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
    let Some(wheels) = due(app) else { return Ok(()) };
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
    let correction = |wheel: &StoodWheel| {
        correction(&before, blended.keep_prior, &Point3::from(wheel.contact_m))
    };
    let (near, far): (Vec<_>, Vec<_>) = wheels
        .into_iter()
        .partition(|wheel| correction(wheel).is_none_or(|dz| dz.abs() <= CORRECTION_MAX_M * scale));
    if !far.is_empty() {
        // Told once: from now on they count as known.
        let mut kept = app.reconstructions.locked();
        if let Some(kept) = &mut kept.blended {
            kept.stood.extend(far.iter().cloned());
        }
        drop(kept);
        for wheel in &far {
            let (leg, dz) = (&wheel.leg, correction(wheel).unwrap_or_default());
            let side = if dz > 0.0 { "above" } else { "below" };
            let text = format!(
                "{leg} stands {:.2} m {side} the ground of the map, which is more than a contact mends: look \
                 at that ground again before relying on it",
                dz.abs()
            );
            app.live.notice(EventLevel::Caution, "server", &text);
        }
        blended.stood.extend(far);
    }
    if near.is_empty() {
        return Ok(());
    }
    let robot = app.live.robot();
    let radii = robot.leg_ids().map(|leg| robot.leg(leg).wheel.radius);
    let names: Vec<&str> = near.iter().map(|wheel| wheel.leg.as_str()).collect();
    let what = format!("wheel contact: {}", names.join(", "));
    let step = ContactStep { wheel_radius_m: radii.fold(0.0, f64::max), time, wheels: near };
    blended.contacts(&step)?;
    let after = blended.mapper.version().clone();
    for text in conflicts(&after, &step.wheels)? {
        app.live.notice(EventLevel::Caution, "server", &text);
    }
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

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    #[test]
    fn a_wheel_that_is_pressed_down_is_raised_until_its_contact_is_on_its_skin() {
        for (tilt, ball) in [(0.0, false), (0.3, false), (-0.2, false), (0.0, true)] {
            let at = |z: f64| WheelPose {
                world_from_wheel: Isometry3::new(Vector3::new(1.0, 2.0, z), Vector3::x() * tilt),
                radius: 0.264,
                width: 0.24,
                ball,
            };
            let lowest = at(0.0).lowest_point(&Vector3::z_axis());
            assert!((sunk_m(&at(-0.01), &lowest) - 0.01).abs() < 1e-9, "{tilt}");
            assert_eq!(sunk_m(&at(0.01), &lowest), 0.0, "{tilt}");
        }
    }
}
