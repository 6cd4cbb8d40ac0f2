//! Received images into a blended map: what a reconstruction and a rebuild from the log have in common.

use std::collections::BTreeMap;
use std::sync::Arc;

use bridge::images::ReceivedImage;
use nalgebra::Point3;
use rover::{Posture, Robot};
use stereo::StereoError;
use stereo::rig::Rig;
use terrain::ElevationMap;
use terrain::fusion::AlignSettings;
use wire::check::At;
use wire::convert;
use wire::reconstruction::{PairStage, ReconstructedPair, RecordedPair, SeenStep};
use wire::time::Timestamp;

use super::pictures::PairPictures;
use super::{Blended, PairImages, add_prior, pair, stereo_error};
use crate::error::ApiError;
use crate::stop::Stop;
use crate::terrains::terrain_error;

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
    pub pairs: Vec<ReconstructedPair>,
    pub pictures: BTreeMap<String, PairPictures>,
}

impl PairSource {
    /// When it was taken, on board.
    pub fn time(&self) -> Timestamp {
        self.images[0].head.time
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
    let mut pictures = BTreeMap::new();
    let mut pairs = Vec::with_capacity(sources.len());
    for (i, source) in sources.iter().enumerate() {
        let refuse = |error: StereoError| stereo_error(stop, &source.pair, &error);
        tell(i, PairStage::Received);
        let images = images_of(site, source, stop)?;
        let seen = pair::measure(&images, site.robot, stop).map_err(refuse)?;
        tell(i, PairStage::Matched);
        stop.check()?;
        pictures.insert(source.pair.clone(), seen.pictures(&images));
        let (mut answer, dem) = pair::map_of(&images, &seen, step.resolution_m, step.region)?;
        answer.capture = source.capture.clone();
        if let Some(dem) = dem {
            let (at, number) = (At::root("cameras"), blended.next_source);
            let time_ns = ns(source.time());
            let fitted = blended
                .mapper
                .add_pair(number, Arc::new(dem), time_ns, &AlignSettings::default())
                .map_err(|error| terrain_error(&at, &error))?;
            blended.next_source += 1;
            blended.names.insert(number, source.pair.clone());
            answer.source = Some(number);
            answer.shift_m = fitted.correction.translation_m.into();
            answer.yaw_rad = fitted.correction.yaw_rad;
            answer.fit_refused = fitted.refusal.is_some();
        }
        tell(i, PairStage::Fused);
        pairs.push(answer);
    }
    if pairs.iter().any(|pair| pair.cells > 0) {
        let wheels: Vec<Point3<f64>> = step.wheels_m.iter().map(|p| Point3::from(*p)).collect();
        let radii = site.robot.leg_ids().map(|leg| site.robot.leg(leg).wheel.radius);
        blended.touch(&wheels, radii.fold(0.0, f64::max), ns(step.time))?;
    }
    Ok(Blend { pairs, pictures })
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
    let configuration = convert::configuration(&At::root("state"), site.robot, state)?;
    Ok(PairImages { pair, posture: Posture::new(site.robot, &configuration), images })
}
