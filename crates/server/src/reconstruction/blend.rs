//! Received images into a blended map: what a reconstruction and a rebuild from the log have in common.

use std::collections::BTreeMap;
use std::sync::Arc;

use bridge::images::ReceivedImage;
use nalgebra::Point3;
use rover::Robot;
use stereo::StereoError;
use stereo::rig::Rig;
use stereo::sag::{LegSights, hip_turns_of};
use stereo::self_mask::PostureErrors;
use terrain::ElevationMap;
use terrain::fusion::{AlignSettings, MapVersion, PairDem};
use wire::check::At;
use wire::convert;
use wire::reconstruction::{PairStage, ReconstructedPair, RecordedPair, SeenStep, StoodWheel};
use wire::time::Timestamp;

use super::pictures::PairPictures;
use super::{Blended, PairImages, add_prior, pair, stereo_error};
use crate::drape::Shot;
use crate::error::ApiError;
use crate::stop::Stop;
use crate::terrains::terrain_error;

/// Cells that pairs of one stand have in common, at least, to be fitted to each other: neighbors overlap
/// little.
const FIT_CELLS_MIN: usize = 30;

/// The two images of a pair as they were received.
#[derive(Debug, Clone)]
pub struct PairSource {
    /// The capture.
    pub capture: String,
    /// The pair.
    pub pair: String,
    /// Left and right.
    pub images: [Arc<ReceivedImage>; 2],
}

/// What images are of.
pub(super) struct Site<'a> {
    pub robot: &'a Robot,
    pub rig: &'a Rig,
    /// The map from before.
    pub ground: &'a ElevationMap,
}

/// What came of a blending.
pub(super) struct Blend {
    /// What was known before, the map from before included.
    pub before: Arc<MapVersion>,
    pub pairs: Vec<ReconstructedPair>,
    pub pictures: BTreeMap<String, PairPictures>,
    /// Turns of hips beyond what was reported, by what was seen of the legs (rad).
    pub sag: BTreeMap<String, f64>,
}

impl PairSource {
    /// When it was taken, on board.
    pub fn time(&self) -> Timestamp {
        self.images[0].head.time
    }

    /// Its left image, for textures.
    fn left(&self) -> Shot {
        let image = self.images[0].clone();
        Shot { pair: self.pair.clone(), capture: self.capture.clone(), image }
    }

    /// As the log names it.
    pub fn recorded(&self) -> RecordedPair {
        let hashes = [0, 1].map(|side| self.images[side].head.hash.clone());
        RecordedPair { capture: self.capture.clone(), pair: self.pair.clone(), hashes }
    }
}

/// Blends pairs into a map as the step says. Deterministic: the same images, step and map give the same
/// map, whichever way the images have come.
pub(super) fn blend(
    blended: &mut Blended,
    site: &Site<'_>,
    step: &SeenStep,
    sources: &[PairSource],
    stop: &Stop,
    tell: &mut dyn FnMut(usize, PairStage),
) -> Result<Blend, ApiError> {
    let ns = |time: Timestamp| i64::try_from(time.0).unwrap_or(i64::MAX);
    if step.prior.is_some() {
        add_prior(blended, site.ground, step.resolution_m, ns(step.time))?;
    }
    blended.keep_prior = step.keep_prior;
    let before: Arc<MapVersion> = blended.mapper.version().clone();
    let mut pictures = BTreeMap::new();
    let mut pairs: Vec<Option<ReconstructedPair>> = vec![None; sources.len()];
    let mut sag = BTreeMap::new();
    // What was taken at one instant is from one stand: the legs are looked at by all of it, and its maps are fitted
    // together.
    let mut captures: Vec<(Timestamp, &str)> =
        sources.iter().map(|source| (source.time(), source.capture.as_str())).collect();
    captures.sort_unstable();
    captures.dedup();
    let settings = AlignSettings {
        cells_min: FIT_CELLS_MIN,
        pair_shift_sigma_m: step.pair_shift_sigma_m,
        ..AlignSettings::default()
    };
    for (time, capture) in captures {
        let stand: Vec<usize> =
            (0..sources.len()).filter(|&i| sources[i].capture == capture).collect();
        let mut seen = Vec::with_capacity(stand.len());
        for &i in &stand {
            let (source, refuse) = (&sources[i], |e| stereo_error(stop, &sources[i].pair, &e));
            tell(i, PairStage::Received);
            let images = images_of(site, source, stop)?;
            let (matched, drawn) = pair::matched(&images, site.robot, stop).map_err(refuse)?;
            tell(i, PairStage::Matched);
            stop.check()?;
            pictures.insert(source.pair.clone(), drawn);
            seen.push((i, images, matched));
        }
        let Some(reported) = seen.first().map(|(_, images, _)| images.reported.clone()) else {
            continue;
        };
        let sights: Vec<LegSights> =
            seen.iter_mut().map(|(_, _, matched)| std::mem::take(&mut matched.sights)).collect();
        let turns = hip_turns_of(&sights, site.robot, &reported, &PostureErrors::default());
        drop(sights);
        let legs = site.robot.legs().iter().zip(&turns).filter(|(_, turn)| **turn != 0.0);
        sag.extend(legs.map(|(leg, turn)| (leg.name.clone(), *turn)));
        let mut dems: Vec<(usize, Arc<PairDem>)> = Vec::with_capacity(seen.len());
        for (i, images, matched) in seen {
            stop.check()?;
            let name = &sources[i].pair;
            let points = pair::measure(&images, &matched, site.robot, &turns)
                .map_err(|error| stereo_error(stop, name, &error))?;
            let (mut answer, dem) = pair::map_of(&images, &matched, &points, step)?;
            answer.capture = sources[i].capture.clone();
            pairs[i] = Some(answer);
            let view = view_of(site.rig, name);
            dems.extend(dem.map(|dem| (i, Arc::new(dem.seen_from(view)))));
        }
        let numbers = blended.next_source..;
        let numbered = numbers.zip(dems.iter().map(|(_, dem)| dem.clone()));
        let fits = blended
            .mapper
            .add_pairs(numbered.collect(), ns(time), &settings)
            .map_err(|error| terrain_error(&At::root("cameras"), &error))?;
        for ((i, _), fitted) in dems.into_iter().zip(fits) {
            let number = blended.next_source;
            blended.next_source += 1;
            blended.names.insert(number, sources[i].pair.clone());
            blended.shots.keep(number, sources[i].left());
            let Some(answer) = &mut pairs[i] else { continue };
            answer.source = Some(number);
            answer.shift_m = fitted.correction.translation_m.into();
            answer.yaw_rad = fitted.correction.yaw_rad;
            answer.fit_refused = fitted.refusal.is_some();
        }
    }
    let pairs: Vec<ReconstructedPair> = pairs.into_iter().flatten().collect();
    (0..sources.len()).for_each(|i| tell(i, PairStage::Fused));
    if pairs.iter().any(|pair| pair.cells > 0) {
        let wheels: Vec<Point3<f64>> = step.wheels_m.iter().map(|p| Point3::from(*p)).collect();
        let radii = site.robot.leg_ids().map(|leg| site.robot.leg(leg).wheel.radius);
        blended.touch(&wheels, radii.fold(0.0, f64::max), ns(step.time))?;
        blended.clear(&step.solids, ns(step.time))?;
        let mut solids = step.solids.iter().cloned();
        let stood = step.wheels_m.iter().map(|contact_m| StoodWheel {
            leg: String::new(),
            contact_m: *contact_m,
            solid: solids.next(),
        });
        blended.stood = stood.collect();
    }
    Ok(Blend { before, pairs, pictures, sag })
}

/// The number of a pair's view: what one pair sees again and again errs the same way.
fn view_of(rig: &Rig, pair: &str) -> u32 {
    let place = rig.pairs().iter().position(|other| other.name == pair);
    place.and_then(|place| u32::try_from(place).ok()).unwrap_or_default()
}

/// The images of a pair, decoded, with its cameras where the rover said that it was.
fn images_of(site: &Site<'_>, source: &PairSource, stop: &Stop) -> Result<PairImages, ApiError> {
    let refuse = |error: StereoError| stereo_error(stop, &source.pair, &error);
    let camera = site.rig.pair(&source.pair).ok_or_else(|| {
        let message = format!("the robot has no pair {:?}", source.pair);
        ApiError::new("camera_unknown", message)
    })?;
    let [left, right] = &source.images;
    let decode = |image: &ReceivedImage| stereo::codec::decode(&image.png).map_err(refuse);
    let images = [decode(left)?, decode(right)?];
    let pair = camera.resized(images[0].size()).map_err(refuse)?;
    let state = &left.head.state;
    let reported = convert::configuration(&At::root("state"), site.robot, state)?;
    let share = images[0].size().width as f64 / camera.left.size().width as f64;
    Ok(PairImages { pair, share, reported, images })
}
