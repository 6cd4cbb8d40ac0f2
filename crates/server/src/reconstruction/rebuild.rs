//! Versions of the map made again from a flight log: from the images that it holds, and the steps that it
//! tells.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use bridge::images::ReceivedImage;
use bridge::reader::{IndexedLog, LogMessage, ReadError};
use rover::Robot;
use serde::de::DeserializeOwned;
use stereo::rig::Rig;
use terrain::ElevationMap;
use wire::foxglove::png_of;
use wire::live::{ImageHead, ImageName, ImageReceived, Side, channel};
use wire::reconstruction::{MapRecord, MapStep, RecordedPair, SeenStep};

use super::blend::{PairSource, Site, blend};
use super::versions::Change;
use super::{Blended, read};
use crate::error::ApiError;
use crate::stop::Stop;
use crate::terrain_store::version_name;

/// Versions that later ones may go on from.
const STATES_MAX: usize = 32;
/// Most images that a log may tell of.
const IMAGES_MAX: usize = 100_000;

/// What a log is rebuilt with: all that it does not hold.
pub struct Basis<'a> {
    /// The robot, scaled and loaded.
    pub robot: &'a Robot,
    /// Its stereo pairs.
    pub rig: &'a Rig,
    /// The map from before.
    pub ground: &'a ElevationMap,
}

/// What came of one version.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rebuilt {
    /// The version as logged.
    pub version: String,
    /// What came of it.
    pub outcome: Outcome,
}

/// Is a version the same when it is made again?
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// Yes: height by height, and with all variances, times and sources.
    Same,
    /// No: this is what it became.
    Differs {
        /// The version.
        version: String,
        /// The blended map beneath it.
        blended: String,
    },
    /// It cannot be made again.
    Lacks {
        /// What is missing.
        why: String,
    },
}

/// Makes all versions of a log again, in the order of the log.
pub fn rebuild(
    log: &mut IndexedLog,
    basis: &Basis<'_>,
    stop: &Stop,
) -> Result<Vec<Rebuilt>, ApiError> {
    let records: Vec<MapRecord> = all(log, channel::MAP)?;
    let mut heads = BTreeMap::new();
    for image in all::<ImageReceived>(log, channel::IMAGE)? {
        if heads.len() < IMAGES_MAX {
            heads.insert(image.head.image.clone(), image);
        }
    }
    let mut states: VecDeque<(String, Blended)> = VecDeque::new();
    let mut rebuilt = Vec::with_capacity(records.len());
    for record in records {
        stop.check()?;
        let made = make(log, basis, &heads, &states, &record, stop)?;
        let outcome = match made {
            Err(why) => Outcome::Lacks { why },
            Ok(None) => Outcome::Same,
            Ok(Some(blended)) => {
                let outcome = compare(basis, &record, &blended)?;
                // What goes on from it goes on from what it was.
                states.retain(|(version, _)| *version != record.terrain_version);
                states.push_back((record.terrain_version.clone(), blended));
                if states.len() > STATES_MAX {
                    states.pop_front();
                }
                outcome
            }
        };
        rebuilt.push(Rebuilt { version: record.terrain_version, outcome });
    }
    Ok(rebuilt)
}

/// Of a version that goes on from none.
const UNTOLD: &str = "the log does not tell what it goes on from";

type Heads = BTreeMap<ImageName, ImageReceived>;

/// The blended map of a record, or what is missing; none where no camera made the map.
fn make(
    log: &mut IndexedLog,
    basis: &Basis<'_>,
    heads: &Heads,
    states: &VecDeque<(String, Blended)>,
    record: &MapRecord,
    stop: &Stop,
) -> Result<Result<Option<Blended>, String>, ApiError> {
    let known = |version: &str| {
        let state = states.iter().rev().find(|(of, _)| of == version);
        let why = || format!("it goes on from version {version}, which was not made again before");
        state.map(|(_, blended)| blended.clone()).ok_or_else(why)
    };
    let before = record.from.as_deref().map(known).transpose();
    let before = match before {
        Ok(before) => before,
        Err(why) => return Ok(Err(why)),
    };
    match &record.step {
        MapStep::Seen(step) => {
            let ground = version_name(basis.ground);
            if let Some(prior) = step.prior.as_ref().filter(|prior| **prior != ground) {
                return Ok(Err(format!(
                    "it lies on the map {prior}, which no log holds, and the configuration gives the \
                     map {ground}: name the configuration that the session was begun with"
                )));
            }
            let mut sources = Vec::with_capacity(step.pairs.len());
            for pair in &step.pairs {
                match source(log, heads, pair)? {
                    Ok(source) => sources.push(source),
                    Err(why) => return Ok(Err(why)),
                }
            }
            seen(basis, step, before, &sources, stop).map(|blended| Ok(Some(blended)))
        }
        MapStep::Removed { source } => changed(before, Change::Remove(*source)),
        MapStep::Fit { source, fitted } => changed(before, Change::Fit(*source, *fitted)),
        MapStep::Selected {} => Ok(Ok(before)),
        MapStep::Contact(step) => {
            let Some(mut blended) = before else { return Ok(Err(UNTOLD.into())) };
            blended.contacts(step)?;
            Ok(Ok(Some(blended)))
        }
    }
}

fn seen(
    basis: &Basis<'_>,
    step: &SeenStep,
    before: Option<Blended>,
    sources: &[PairSource],
    stop: &Stop,
) -> Result<Blended, ApiError> {
    let mut blended = match before {
        Some(before) => before,
        None => Blended::new(step.resolution_m)?,
    };
    let site = Site { robot: basis.robot, rig: basis.rig, ground: basis.ground };
    let made = blend(&mut blended, &site, step, sources, stop, &mut |_, _| {})?;
    let time = sources.iter().map(PairSource::time).max().unwrap_or(step.time);
    blended.note(&made.pairs, time, &step.id);
    Ok(blended)
}

fn changed(
    before: Option<Blended>,
    change: Change,
) -> Result<Result<Option<Blended>, String>, ApiError> {
    let Some(mut blended) = before else {
        return Ok(Err(UNTOLD.into()));
    };
    blended.apply(change)?;
    Ok(Ok(Some(blended)))
}

fn compare(basis: &Basis<'_>, record: &MapRecord, blended: &Blended) -> Result<Outcome, ApiError> {
    let map =
        read(blended.mapper.version(), basis.ground, blended.keep_prior, &blended.pair_names())?;
    let (version, id) = (version_name(&map), blended.mapper.version().id().to_string());
    let same = version == record.terrain_version && record.blended.as_ref() == Some(&id);
    Ok(if same { Outcome::Same } else { Outcome::Differs { version, blended: id } })
}

/// The images of a pair from the log, or which is not there.
fn source(
    log: &mut IndexedLog,
    heads: &Heads,
    of: &RecordedPair,
) -> Result<Result<PairSource, String>, ApiError> {
    let mut images = Vec::with_capacity(2);
    for (side, hash) in [Side::Left, Side::Right].into_iter().zip(&of.hashes) {
        let name = ImageName { capture: of.capture.clone(), pair: of.pair.clone(), side };
        let told = heads.get(&name).filter(|told| told.head.hash == *hash);
        let png = match told {
            Some(told) => png(log, &told.topic, &told.head)?,
            None => None,
        };
        let (Some(told), Some(png)) = (told, png) else {
            let RecordedPair { capture, pair, .. } = of;
            return Ok(Err(format!("the log lacks the {side} image of {pair}, capture {capture}")));
        };
        images.push(Arc::new(ReceivedImage { head: told.head.clone(), png: png.into() }));
    }
    let images: Result<[Arc<ReceivedImage>; 2], _> = images.try_into();
    let images = images.map_err(|_| ApiError::new("internal", "a pair has two images"))?;
    Ok(Ok(PairSource { capture: of.capture.clone(), pair: of.pair.clone(), images }))
}

/// The PNG of an image, by its hash.
fn png(log: &mut IndexedLog, topic: &str, head: &ImageHead) -> Result<Option<Vec<u8>>, ApiError> {
    for piece in log.pieces_of(topic).to_vec() {
        let of_time = |m: &LogMessage| *m.channel == *topic && m.publish_time == head.time;
        let messages = log.read(piece as usize).map_err(ApiError::from)?;
        for message in messages.iter().filter(|message| of_time(message)) {
            let png = png_of(&message.data);
            let same = |png: &Vec<u8>| blake3::hash(png).to_hex().as_str() == head.hash;
            if let Some(png) = png.filter(same) {
                return Ok(Some(png));
            }
        }
    }
    Ok(None)
}

/// All messages of a channel that can be read.
fn all<T: DeserializeOwned>(log: &mut IndexedLog, topic: &str) -> Result<Vec<T>, ReadError> {
    let mut list = Vec::new();
    for piece in log.pieces_of(topic).to_vec() {
        let messages = log.read(piece as usize)?;
        let of_topic = messages.iter().filter(|message| *message.channel == *topic);
        list.extend(of_topic.filter_map(|message| serde_json::from_slice::<T>(&message.data).ok()));
    }
    Ok(list)
}
