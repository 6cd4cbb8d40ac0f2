//! The ortho-texture of a version of the map: made when it is first asked for, kept with the version.

use std::collections::BTreeMap;
use std::sync::Arc;

use bridge::images::ReceivedImage;
use bytes::Bytes;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rover::{Posture, Robot};
use stereo::ortho::{OrthoImage, OrthoOptions, View, ortho};
use stereo::ray::RayScene;
use stereo::rig::Rig;
use terrain::formats::geotiff;
use terrain::fusion::Correction;
use terrain::{ElevationMap, Placement};
use wire::check::{At, RequestError};
use wire::convert;
use wire::drape::{TextureAnswer, TextureView};

use super::{shape_of, tile};
use crate::error::ApiError;
use crate::stop::Stop;
use crate::terrains::terrain_error;

/// Most bytes of images (PNG) that are kept for textures: those of the oldest captures give way.
const SHOT_BYTES_MAX: usize = 64 << 20;
/// Side of a texel (m): half a cell of the map, within these.
const TEXEL_M: [f64; 2] = [0.005, 0.02];

/// The left image of a capture.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Its pair.
    pub pair: String,
    /// Its capture.
    pub capture: String,
    /// The image, with where the rover was.
    pub image: Arc<ReceivedImage>,
}

/// The left images of what a map is made of, by the numbers of its sources.
#[derive(Debug, Clone, Default)]
pub struct Shots(BTreeMap<u32, Shot>);

impl Shots {
    /// Keeps an image.
    pub fn keep(&mut self, source: u32, shot: Shot) {
        self.0.insert(source, shot);
        let bytes =
            |shots: &BTreeMap<u32, Shot>| shots.values().map(|s| s.image.png.len()).sum::<usize>();
        while self.0.len() > stereo::ortho::VIEWS_MAX || bytes(&self.0) > SHOT_BYTES_MAX {
            self.0.pop_first();
        }
    }

    /// Lets go of an image.
    pub fn remove(&mut self, source: u32) {
        self.0.remove(&source);
    }

    /// The images where their pairs were fitted to the map.
    pub fn placed(&self, fits: impl Iterator<Item = (u32, Correction)>) -> Vec<PlacedShot> {
        let placed = |(source, fit): (u32, Correction)| {
            let shot = self.0.get(&source)?.clone();
            Some(PlacedShot { source, shot, fit })
        };
        fits.filter_map(placed).collect()
    }
}

/// An image, and where its pair was fitted to the map.
#[derive(Debug, Clone)]
pub struct PlacedShot {
    source: u32,
    shot: Shot,
    fit: Correction,
}

/// A texture with what is told of it.
pub struct Texture {
    image: OrthoImage,
    views: Vec<TextureView>,
    placement: Placement,
}

impl Texture {
    /// Lays images over a map; none if they show none of it.
    pub fn new(
        map: &ElevationMap,
        shots: &[PlacedShot],
        robot: &Robot,
        rig: &Rig,
        stop: &Stop,
    ) -> Result<Option<Texture>, ApiError> {
        let views =
            shots.iter().map(|shot| view(shot, robot, rig)).collect::<Result<Vec<_>, _>>()?;
        let [least, most] = TEXEL_M;
        let texel_m = (0.5 * map.grid().resolution).clamp(least, most);
        let options = OrthoOptions { texel_m, ..OrthoOptions::default() };
        let made = ortho(map, &views, &options, &|| stop.asked());
        let made = made.map_err(|error| match stop.check() {
            Err(stopped) => ApiError::from(stopped),
            Ok(()) => ApiError::internal("the texture", error),
        })?;
        let told = |(placed, of): (&PlacedShot, &stereo::ortho::ViewShare)| TextureView {
            pair: placed.shot.pair.clone(),
            capture: placed.shot.capture.clone(),
            source: placed.source,
            gain: of.gain,
            share: of.share,
        };
        Ok(made.map(|image| {
            let views = shots.iter().zip(&image.views).map(told).collect();
            Texture { image, views, placement: map.placement().clone() }
        }))
    }

    /// What is told of it.
    pub fn answer(&self, terrain_version: &str) -> TextureAnswer {
        let known = self.image.alpha.iter().filter(|alpha| **alpha > 0).count();
        TextureAnswer {
            terrain_version: terrain_version.to_owned(),
            shape: shape_of(&self.image.grid),
            known_share: known as f64 / self.image.alpha.len().max(1) as f64,
            views: self.views.clone(),
        }
    }

    /// A tile as PNG of gray and alpha.
    pub fn tile(&self, at: [usize; 2]) -> Option<Result<Bytes, png::EncodingError>> {
        let texel = |i: usize| [self.image.gray[i], self.image.alpha[i]];
        tile(&self.image.grid, at, png::ColorType::GrayscaleAlpha, texel)
    }

    /// The same as a GeoTIFF.
    pub fn geotiff(&self) -> Result<Vec<u8>, RequestError> {
        let OrthoImage { grid, gray, alpha, .. } = &self.image;
        geotiff::write_picture(grid, gray, alpha, &self.placement)
            .map_err(|error| terrain_error(&At::root("version"), &error))
    }
}

fn view(placed: &PlacedShot, robot: &Robot, rig: &Rig) -> Result<View, ApiError> {
    let PlacedShot { shot, fit, .. } = placed;
    let refuse = |error: stereo::StereoError| {
        ApiError::new("out_of_range", format!("pair {}: {error}", shot.pair))
    };
    let pair = rig.pair(&shot.pair).ok_or_else(|| {
        ApiError::new("camera_unknown", format!("the robot has no pair {:?}", shot.pair))
    })?;
    let image = stereo::codec::decode(&shot.image.png).map_err(refuse)?;
    let pair = pair.resized(image.size()).map_err(refuse)?;
    let configuration = convert::configuration(&At::root("state"), robot, &shot.image.head.state)?;
    let posture = Posture::new(robot, &configuration);
    let [camera, _] = pair.cameras(&posture);
    Ok(View {
        camera,
        image,
        fit: motion_of(fit),
        robot: Some(RayScene::new(None, Some((robot, &posture)))),
        range: pair.range,
    })
}

/// A correction as a motion.
fn motion_of(fit: &Correction) -> Isometry3<f64> {
    let about = Vector3::new(fit.about_m.x, fit.about_m.y, 0.0);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), fit.yaw_rad);
    Translation3::from(fit.translation_m + about) * turn * Translation3::from(-about)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Point3};

    use super::*;

    #[test]
    fn the_motion_is_what_the_correction_does_to_points() {
        let fit = Correction {
            translation_m: Vector3::new(0.3, -0.2, 0.05),
            yaw_rad: 0.2,
            about_m: Point2::new(4.0, -3.0),
        };
        for p in [Point3::origin(), Point3::new(2.0, 7.0, -1.0), Point3::new(-4.0, 3.0, 2.0)] {
            assert!((motion_of(&fit) * p - fit.apply(p)).norm() < 1e-12);
        }
    }
}
