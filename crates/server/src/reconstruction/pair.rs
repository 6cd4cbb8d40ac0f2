//! One pair: its images, the points that they show, and the map of these.

use rover::{Configuration, Posture, Robot};
use stereo::matching::{Disparity, Matching};
use stereo::pair::{PairHealth, PairOptions, Reconstruction, reconstruct};
use stereo::ray::RayScene;
use stereo::rectification::RectifiedGeometry;
use stereo::render::CalibrationErrors;
use stereo::rig::CameraPair;
use stereo::sag::{LegSights, turned};
use stereo::self_mask::{LinkSigmas, MaskOptions, PostureErrors, TagCounts, tag_robot};
use stereo::surface::{CommonErrors, Surface, Tag, TriangulateOptions, triangulate};
use stereo::{GrayImage, StereoError};
use terrain::TerrainError;
use terrain::fusion::{self, Measurement, PairDem, RasterizeOptions, rasterize};
use wire::check::{At, RequestError};
use wire::reconstruction::{ReconstructedPair, SeenStep};

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
    /// Columns of the images as a share of those that the cameras have.
    pub share: f64,
    /// Where the rover reported to be when they were taken.
    pub reported: Configuration,
    /// Left and right.
    pub images: [GrayImage; 2],
}

/// A pair, matched: little enough to be kept until all pairs of its stand are.
pub struct Matched {
    geometry: RectifiedGeometry,
    disparity: Disparity,
    health: PairHealth,
    /// What it saw near the legs.
    pub sights: LegSights,
}

/// The points of a pair, the robot's own tagged.
pub struct Seen {
    surface: Surface,
    counts: TagCounts,
}

/// Matches the images; gives pictures of them too.
pub fn matched(
    images: &PairImages,
    robot: &Robot,
    stop: &Stop,
) -> Result<(Matched, PairPictures), StereoError> {
    let PairImages { pair, reported, images: [left, right], .. } = images;
    let cameras = pair.cameras(&Posture::new(robot, reported));
    let baseline = (cameras[1].center() - cameras[0].center()).norm();
    // As many as the nearest depth that counts has.
    let nearest_px = cameras[0].focal()[0] * baseline / pair.range[0];
    let disparities = (nearest_px.ceil() + 1.0).clamp(32.0, 128.0) as usize;
    let options = PairOptions {
        matching: Matching { disparities, threads: THREADS, ..Matching::default() },
        triangulate: triangulation(pair),
        ..PairOptions::default()
    };
    let asked = || stop.asked();
    let found = reconstruct([&cameras[0], &cameras[1]], [left, right], &options, &asked)?;
    let pictures = pictures::draw(&images.images, &found);
    let sights = LegSights::of(&found.surface, robot, reported, &PostureErrors::default());
    let Reconstruction { disparity, surface, health, .. } = found;
    Ok((Matched { geometry: surface.geometry, disparity, health, sights }, pictures))
}

fn triangulation(pair: &CameraPair) -> TriangulateOptions {
    TriangulateOptions { range: pair.range, ..TriangulateOptions::default() }
}

/// The points that a pair shows in `world`, the robot's own tagged. `turns` mend the reported hips
/// ([`stereo::sag`]).
pub fn measure(
    images: &PairImages,
    matched: &Matched,
    robot: &Robot,
    turns: &[f64],
) -> Result<Seen, StereoError> {
    let mut surface =
        triangulate(&matched.geometry, &matched.disparity, &triangulation(&images.pair))?;
    let posture = Posture::new(robot, &turned(&images.reported, turns));
    let scene = RayScene::new(None, Some((robot, &posture)));
    let sigmas = LinkSigmas::new(robot, &posture, &PostureErrors::default());
    let counts = tag_robot(&mut surface, &scene, &sigmas, &MaskOptions::default())?;
    Ok(Seen { surface, counts })
}

/// What the calibration of a pair is taken to be off by, in pixels of its images: the rig's usual errors.
fn calibration(images: &PairImages) -> CalibrationErrors {
    let usual = CalibrationErrors::default();
    CalibrationErrors { intrinsics_px: usual.intrinsics_px * images.share, ..usual }
}

/// The elevation map of the points, none where they show no ground, and what to tell of the pair.
pub fn map_of(
    images: &PairImages,
    matched: &Matched,
    seen: &Seen,
    step: &SeenStep,
) -> Result<(ReconstructedPair, Option<PairDem>), RequestError> {
    let (Seen { surface, counts }, Matched { health, geometry, .. }) = (seen, matched);
    // Height above a slope is less sure than height above level ground.
    let up = health.ground.map(|plane| plane.normal).filter(|normal| normal.z > 0.5);
    let up = up.map_or_else(nalgebra::Vector3::z, |normal| normal / normal.z);
    let common = CommonErrors::of(&calibration(images), geometry);
    let measurement = |point: &stereo::surface::SurfacePoint| Measurement {
        position_m: point.position,
        height_variance_m2: up.dot(&(point.covariance * up)).max(1e-12),
        common_variance_m2: common.height_variance(geometry, point, &up),
        footprint_m: point.footprint,
        tag: match point.tag {
            Tag::Terrain => fusion::Tag::Terrain,
            Tag::Robot => fusion::Tag::Robot,
            Tag::ShadowBand => fusion::Tag::ShadowBand,
        },
    };
    let inside = |m: &Measurement| {
        step.region.is_none_or(|region| {
            let off = m.position_m.xy() - nalgebra::Point2::from(region.center_m);
            off.norm() <= region.radius_m
        })
    };
    let points: Vec<Measurement> = surface.points.iter().map(measurement).filter(inside).collect();
    let options = RasterizeOptions {
        resolution_m: step.resolution_m,
        relief_share: step.relief_share,
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
