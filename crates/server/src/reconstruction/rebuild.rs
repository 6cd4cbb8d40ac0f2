//! Versions of the map made again from a flight log: from the images that it holds, and the steps that it
//! tells.

use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;

use bridge::catalog;
use bridge::images::ReceivedImage;
use bridge::reader::{IndexedLog, Limits, LogMessage, ReadError};
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
    /// Where the logs of earlier sessions are.
    pub logs_dir: Option<PathBuf>,
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

/// Logs that go back to one another, one before the other, at most.
const CHAIN_MAX: usize = 16;

/// What came of a log.
pub struct Remade {
    /// Version by version, in the order of the log.
    pub rebuilt: Vec<Rebuilt>,
    /// What the newest versions are made of, oldest first.
    pub(super) states: VecDeque<(String, Blended)>,
    /// The last of the log: what was in use at its end.
    pub last: Option<MapRecord>,
}

/// Makes all versions of a log again, in the order of the log.
pub fn rebuild(
    log: &mut IndexedLog,
    basis: &Basis<'_>,
    stop: &Stop,
) -> Result<Vec<Rebuilt>, ApiError> {
    remake(log, basis, stop, 0, &mut |_, _| {}).map(|made| made.rebuilt)
}

/// As [`rebuild`], with what is made, telling how many of how many versions are; `depth` logs go back to this one.
pub fn remake(
    log: &mut IndexedLog,
    basis: &Basis<'_>,
    stop: &Stop,
    depth: usize,
    tell: &mut dyn FnMut(usize, usize),
) -> Result<Remade, ApiError> {
    let records: Vec<MapRecord> = all(log, channel::MAP)?;
    let (n, last) = (records.len(), records.last().cloned());
    let heads = heads(log)?;
    let mut states: VecDeque<(String, Blended)> = VecDeque::new();
    let mut rebuilt = Vec::with_capacity(records.len());
    for (i, record) in records.into_iter().enumerate() {
        stop.check()?;
        tell(i, n);
        let made = match &record.step {
            MapStep::Restored { log } => earlier(basis, log, &record, stop, depth)?,
            _ => make(log, basis, &heads, &states, &record, stop)?,
        };
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
    Ok(Remade { rebuilt, states, last })
}

/// What a log tells of its images, by their names.
pub(super) fn heads(log: &mut IndexedLog) -> Result<Heads, ApiError> {
    let told = all::<ImageReceived>(log, channel::IMAGE)?.into_iter().take(IMAGES_MAX);
    Ok(told.map(|image| (image.head.image.clone(), image)).collect())
}

/// The blended map of a version that was made again from the log of an earlier session.
fn earlier(
    basis: &Basis<'_>,
    id: &str,
    record: &MapRecord,
    stop: &Stop,
    depth: usize,
) -> Result<Result<Option<Blended>, String>, ApiError> {
    let lacks = |why: String| Ok(Err(format!("it was made again from the log {id}, {why}")));
    let Some(dir) = &basis.logs_dir else { return lacks("which is not beside this one".into()) };
    if depth >= CHAIN_MAX {
        return lacks(format!("and {CHAIN_MAX} logs before it go back to others"));
    }
    let mut log = match catalog::open_log(dir, id, Limits::default()) {
        Ok(log) => log,
        Err(error) => return lacks(format!("which cannot be read: {error}")),
    };
    let made = remake(&mut log, basis, stop, depth + 1, &mut |_, _| {})?;
    let state = made.states.into_iter().rev().find(|(of, _)| *of == record.terrain_version);
    match state {
        Some((_, blended)) => Ok(Ok(Some(Blended { from: None, ..blended }))),
        None => lacks("of which it could not be made".into()),
    }
}

/// Of a version that goes on from none.
const UNTOLD: &str = "the log does not tell what it goes on from";

/// What a log tells of its images.
pub(super) type Heads = BTreeMap<ImageName, ImageReceived>;

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
        // Of another log: not made of what is here.
        MapStep::Restored { log } => Ok(Err(format!("it was made again from the log {log}"))),
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
pub(super) fn png(
    log: &mut IndexedLog,
    topic: &str,
    head: &ImageHead,
) -> Result<Option<Vec<u8>>, ApiError> {
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
