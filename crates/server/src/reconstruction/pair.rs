//! One pair: its images, the points that they show, and the map of these.

use rover::{Posture, Robot};
use stereo::matching::Matching;
use stereo::pair::{PairOptions, Reconstruction, reconstruct};
use stereo::ray::RayScene;
use stereo::rig::CameraPair;
use stereo::self_mask::{LinkSigmas, MaskOptions, PostureErrors, TagCounts, tag_robot};
use stereo::surface::{Tag, TriangulateOptions};
use stereo::{GrayImage, StereoError};
use terrain::TerrainError;
use terrain::fusion::{self, Measurement, PairDem, RasterizeOptions, rasterize};
use wire::check::{At, RequestError};
use wire::map_version::MapRegion;
use wire::reconstruction::ReconstructedPair;

use super::pictures::{self, PairPictures};
use crate::stop::Stop;
use crate::terrains::terrain_error;

/// Threads of matching; the result does not depend on them.
const THREADS: usize = 2;
/// Points whose height is less sure than this (m, standard deviation) do not become ground.
const HEIGHT_SIGMA_MAX_M: f64 = 0.1;

/// The two images of a pair, with what is needed to make use of them: the same wherever they come from.
pub struct PairImages {
    /// The pair, its cameras as large as the images.
    pub pair: CameraPair,
    /// The posture that the rover reported when they were taken.
    pub posture: Posture,
    /// Left and right.
    pub images: [GrayImage; 2],
}

/// The points of a pair, the robot's own tagged.
pub struct Seen {
    found: Reconstruction,
    counts: TagCounts,
}

impl Seen {
    /// The images and disparities, to be looked at.
    pub fn pictures(&self, images: &PairImages) -> PairPictures {
        pictures::draw(&images.images, &self.found)
    }
}

/// The points that the images show in `world`, the robot's own tagged by the reported posture.
pub fn measure(images: &PairImages, robot: &Robot, stop: &Stop) -> Result<Seen, StereoError> {
    let PairImages { pair, posture, images: [left, right] } = images;
    let cameras = pair.cameras(posture);
    let baseline = (cameras[1].center() - cameras[0].center()).norm();
    // As many as the nearest depth that counts has.
    let nearest_px = cameras[0].focal()[0] * baseline / pair.range[0];
    let disparities = (nearest_px.ceil() + 1.0).clamp(32.0, 128.0) as usize;
    let options = PairOptions {
        matching: Matching { disparities, threads: THREADS, ..Matching::default() },
        triangulate: TriangulateOptions { range: pair.range, ..TriangulateOptions::default() },
        ..PairOptions::default()
    };
    let asked = || stop.asked();
    let mut found = reconstruct([&cameras[0], &cameras[1]], [left, right], &options, &asked)?;
    let scene = RayScene::new(None, Some((robot, posture)));
    let sigmas = LinkSigmas::new(robot, posture, &PostureErrors::default());
    let counts = tag_robot(&mut found.surface, &scene, &sigmas, &MaskOptions::default())?;
    Ok(Seen { found, counts })
}

/// The elevation map of the points, none where they show no ground, and what to tell of the pair.
pub fn map_of(
    images: &PairImages,
    seen: &Seen,
    resolution_m: f64,
    region: Option<MapRegion>,
) -> Result<(ReconstructedPair, Option<PairDem>), RequestError> {
    let Seen { found, counts } = seen;
    let health = &found.health;
    // Height above a slope is less sure than height above level ground.
    let up = health.ground.map(|plane| plane.normal).filter(|normal| normal.z > 0.5);
    let up = up.map_or_else(nalgebra::Vector3::z, |normal| normal / normal.z);
    let measurement = |point: &stereo::surface::SurfacePoint| Measurement {
        position_m: point.position,
        height_variance_m2: up.dot(&(point.covariance * up)).max(1e-12),
        common_variance_m2: 0.0,
        footprint_m: point.footprint,
        tag: match point.tag {
            Tag::Terrain => fusion::Tag::Terrain,
            Tag::Robot => fusion::Tag::Robot,
            Tag::ShadowBand => fusion::Tag::ShadowBand,
        },
    };
    let inside = |m: &Measurement| {
        region.is_none_or(|region| {
            let off = m.position_m.xy() - nalgebra::Point2::from(region.center_m);
            off.norm() <= region.radius_m
        })
    };
    let points: Vec<Measurement> =
        found.surface.points.iter().map(measurement).filter(inside).collect();
    let options = RasterizeOptions {
        resolution_m,
        variance_max_m2: HEIGHT_SIGMA_MAX_M * HEIGHT_SIGMA_MAX_M,
        ..RasterizeOptions::default()
    };
    let dem = if points.is_empty() {
        None
    } else {
        match rasterize(&points, &options) {
            Ok(rasterized) => Some(rasterized.dem),
            Err(TerrainError::NoKnownHeight) => None,
            Err(error) => return Err(terrain_error(&At::root("cameras"), &error)),
        }
    };
    let size = images.pair.left.size();
    let answer = ReconstructedPair {
        name: images.pair.name.clone(),
        capture: String::new(),
        source: None,
        size_px: [size.width, size.height],
        epipolar_px: health.epipolar.map(|health| health.median_abs_dy),
        fill: health.fill,
        plane_residual_m: health.ground.map(|plane| plane.residual),
        terrain_points: counts.terrain,
        robot_points: counts.robot,
        shadow_band_points: counts.shadow_band,
        cells: dem.as_ref().map_or(0, |dem| dem.cells().iter().filter(|c| c.is_ground()).count()),
        shift_m: [0.0; 3],
        yaw_rad: 0.0,
        fit_refused: false,
    };
    Ok((answer, dem))
}
