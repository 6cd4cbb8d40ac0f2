//! A campaign in simulation: ground of a recipe, the seated rover, its pairs with errors, their map, and
//! how that compares with the ground.

use std::sync::Arc;

use geometry::Grid;
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, Posture, Robot};
use stereo::camera::Camera;
use stereo::coverage::coverage;
use stereo::matching::Matching;
use stereo::pair::{PairOptions, reconstruct};
use stereo::ray::RayScene;
use stereo::render::{CalibrationErrors, RenderOptions, render};
use stereo::rig::CameraPair;
use stereo::self_mask::{LinkSigmas, MaskOptions, PostureErrors, tag_robot};
use stereo::surface::{CommonErrors, Tag, TriangulateOptions};
use terrain::fusion::{
    self, AlignSettings, MapSettings, MapVersion, Mapper, Measurement, PairDem, RasterizeOptions,
    ReadPolicy, rasterize,
};
use terrain::synthetic::{Recipe, generate};
use terrain::traversability::{
    CAUTION, Layers, Limits, SAFE, UNKNOWN, UNSAFE, traversability, trusted_traversability,
};
use terrain::{ElevationMap, Source};

use crate::camera::size;
use crate::matching::never;
use crate::ray::athlete;
use crate::rig::rig;

/// Width of a foot (m): what `config/demo.toml` judges by.
pub const FOOTPRINT_M: f64 = 0.55;
/// Points whose height is less sure than this (m) do not become ground.
const HEIGHT_SIGMA_MAX_M: f64 = 0.1;

/// What is not as reported; standard deviations, zero for none.
#[derive(Debug, Clone, Copy)]
pub struct Errors {
    pub calibration: CalibrationErrors,
    /// Deflection of each leg about its hip pitch, as height of its wheel (m).
    pub sag_m: f64,
    /// Place of the rover at each station after the first, along each axis (m).
    pub place_m: f64,
    /// Its heading (rad).
    pub heading_rad: f64,
}

impl Errors {
    /// Everything is as it is said to be; images have their noise.
    pub const NONE: Errors = Errors {
        calibration: CalibrationErrors {
            intrinsics_px: 0.0,
            relative_rad: 0.0,
            pair: 0.0,
            pair_rad: 0.0,
        },
        sag_m: 0.0,
        place_m: 0.0,
        heading_rad: 0.0,
    };

    /// What a rover in the field has: its calibration is off, its legs sag.
    pub fn usual() -> Errors {
        Errors {
            calibration: CalibrationErrors::default(),
            sag_m: 0.04,
            place_m: 0.015,
            heading_rad: 0.3_f64.to_radians(),
        }
    }
}

/// Where and how it is imaged.
#[derive(Debug, Clone)]
pub struct Campaign {
    pub recipe: Recipe,
    pub seed: u64,
    pub size_px: [usize; 2],
    pub rays: usize,
    /// Places (m) and headings (rad) of the rover.
    pub stations: Vec<[f64; 3]>,
    /// Pairs whose names begin with one of these.
    pub pairs: Vec<&'static str>,
    pub errors: Errors,
}

impl Campaign {
    pub fn of(recipe: Recipe, seed: u64) -> Campaign {
        Campaign {
            recipe,
            seed,
            size_px: [1024, 768],
            rays: 1,
            stations: vec![[0.0, 0.0, 0.0]],
            pairs: vec!["nav", "haz"],
            errors: Errors::usual(),
        }
    }
}

/// What one pair saw from one station.
pub struct Taken {
    pub station: usize,
    /// Which pair.
    pub view: u32,
    pub points: Vec<Measurement>,
}

impl Taken {
    /// The map of the pair.
    pub fn dem(&self) -> PairDem {
        let options = RasterizeOptions {
            variance_max_m2: HEIGHT_SIGMA_MAX_M * HEIGHT_SIGMA_MAX_M,
            ..RasterizeOptions::default()
        };
        rasterize(&self.points, &options).unwrap().dem.seen_from(self.view)
    }
}

/// All that was taken, and the truth.
pub struct Gathered {
    pub ground: ElevationMap,
    pub truth: Layers,
    pub taken: Vec<Taken>,
    /// Where the evaluated cells are.
    pub grid: Grid,
    /// Cells that a pair saw by rays: the distance of the nearest that did (m), NaN for none.
    pub seen_at: Vec<f64>,
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// The rover at a station with its wheels on the ground.
pub fn seated(robot: &Robot, ground: &ElevationMap, [x, y, yaw]: [f64; 3]) -> Configuration {
    let mut configuration = robot.pose("bent").unwrap();
    let posture = Posture::new(robot, &configuration);
    let wheel = posture.wheel(robot, rover::LegId(0));
    let level = ground.height_at(Point2::new(x, y)).unwrap();
    let z = level + wheel.radius - wheel.world_from_wheel.translation.z;
    configuration.world_from_base =
        Isometry3::new(Vector3::new(x, y, z), Vector3::new(0.0, 0.0, yaw));
    let posture = Posture::new(robot, &configuration);
    let mut out = configuration.clone();
    for leg in robot.leg_ids() {
        let wheel = posture.wheel(robot, leg);
        let forward = wheel.world_from_wheel.rotation * Vector3::x();
        let flat = Vector3::new(forward.x, forward.y, 0.0).normalize();
        let center = wheel.center();
        // How far the circle is above the ground, at its least.
        let gap = (-10..=10)
            .map(|i| {
                let t = f64::from(i) / 10.0 * wheel.radius * 0.99;
                let p = center + flat * t;
                let under = center.z - (wheel.radius * wheel.radius - t * t).sqrt();
                under - ground.height_at(p.xy()).unwrap()
            })
            .fold(f64::INFINITY, f64::min);
        let mut pose = wheel.world_from_wheel;
        pose.translation.z -= gap;
        let near = |angles: &rover::LegAngles| (angles - configuration.legs[leg.0]).norm();
        let solutions = posture.inverse_kinematics(robot, leg, &pose).unwrap();
        let best = solutions.iter().map(|solution| solution.angles);
        out.legs[leg.0] = best.min_by(|a, b| near(a).total_cmp(&near(b))).unwrap();
    }
    out
}

/// Draws, matches and rasterizes all that a campaign asks.
pub fn gather(campaign: &Campaign) -> Gathered {
    let robot = athlete();
    let ground = generate(&campaign.recipe, campaign.seed).unwrap();
    let rig = rig();
    let mut rng = ChaCha8Rng::seed_from_u64(campaign.seed ^ 0x5eed);
    let chosen: Vec<CameraPair> = rig
        .pairs()
        .iter()
        .filter(|pair| campaign.pairs.iter().any(|name| pair.name.starts_with(name)))
        .map(|pair| pair.resized(size(campaign.size_px[0], campaign.size_px[1])).unwrap())
        .collect();
    // A rig is calibrated once.
    let errors = campaign.errors;
    let calibration = CalibrationErrors {
        // In pixels of the images at full size.
        intrinsics_px: errors.calibration.intrinsics_px * campaign.size_px[0] as f64 / 1024.0,
        ..errors.calibration
    };
    let actual_pairs: Vec<[Camera; 2]> = chosen
        .iter()
        .enumerate()
        .map(|(i, pair)| {
            calibration.actual([&pair.left, &pair.right], 1000 * campaign.seed + i as u64).unwrap()
        })
        .collect();
    let grid = Grid { origin: Point2::new(-9.0, -9.0), resolution: 0.1, nx: 181, ny: 181 };
    let mut seen_at = vec![f64::NAN; grid.len()];
    let mut taken = Vec::new();
    for (station, at) in campaign.stations.iter().enumerate() {
        let actual = seated(&robot, &ground, *at);
        let mut reported = actual.clone();
        for leg in &mut reported.legs {
            // A leg is about 2 m long.
            leg[1] += errors.sag_m / 2.0 * normal(&mut rng);
        }
        if station > 0 {
            let off = Vector3::from_fn(|_, _| errors.place_m * normal(&mut rng));
            let yaw = errors.heading_rad * normal(&mut rng);
            let base = reported.world_from_base;
            reported.world_from_base = Isometry3::from_parts(
                (base.translation.vector + off).into(),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * base.rotation,
            );
        }
        let (actual, reported) = (Posture::new(&robot, &actual), Posture::new(&robot, &reported));
        let scene = RayScene::new(Some(&ground), Some((&robot, &actual)));
        let believed = RayScene::new(None, Some((&robot, &reported)));
        let sigmas = LinkSigmas::new(&robot, &reported, &PostureErrors::default());
        for (i, pair) in chosen.iter().enumerate() {
            let from = actual.link(pair.link);
            let cameras = actual_pairs[i].each_ref().map(|camera| camera.moved(from));
            let options =
                RenderOptions { rays: campaign.rays, threads: 2, ..RenderOptions::default() };
            let salt = 7919 * (campaign.seed * 64 + (station * 9 + i) as u64);
            let images = [0, 1].map(|side| {
                render(&scene, &cameras[side], &options, salt + side as u64, &never).unwrap()
            });
            let said = pair.cameras(&reported);
            let baseline = (said[1].center() - said[0].center()).norm();
            let nearest_px = said[0].focal()[0] * baseline / pair.range[0];
            let disparities = (nearest_px.ceil() + 1.0).clamp(32.0, 128.0) as usize;
            let how = PairOptions {
                matching: Matching { disparities, threads: 2, ..Matching::default() },
                triangulate: TriangulateOptions {
                    range: pair.range,
                    ..TriangulateOptions::default()
                },
                ..PairOptions::default()
            };
            let both = [&images[0], &images[1]];
            let mut found = reconstruct([&said[0], &said[1]], both, &how, &never).unwrap();
            tag_robot(&mut found.surface, &believed, &sigmas, &MaskOptions::default()).unwrap();
            let up = found.health.ground.map(|plane| plane.normal).filter(|n| n.z > 0.5);
            let up = up.map_or_else(Vector3::z, |n| n / n.z);
            let geometry = found.surface.geometry;
            let common = CommonErrors::of(&calibration, &geometry);
            let points: Vec<Measurement> = found
                .surface
                .points
                .iter()
                .map(|point| Measurement {
                    position_m: point.position,
                    height_variance_m2: up.dot(&(point.covariance * up)).max(1e-12),
                    common_variance_m2: common.height_variance(&geometry, point, &up),
                    footprint_m: point.footprint,
                    tag: match point.tag {
                        Tag::Terrain => fusion::Tag::Terrain,
                        Tag::Robot => fusion::Tag::Robot,
                        Tag::ShadowBand => fusion::Tag::ShadowBand,
                    },
                })
                .collect();
            taken.push(Taken { station, view: i as u32, points });
            let ideal = CameraPair::with_cameras(
                pair.clone(),
                actual_pairs[i][0].clone(),
                actual_pairs[i][1].clone(),
            );
            let seen = coverage(&[&ideal], &robot, &actual, &ground, &grid, &never).unwrap();
            let seen = &seen.pairs[0].ground_resolution;
            let eye = cameras[0].center();
            for iy in 0..grid.ny {
                for ix in 0..grid.nx {
                    if !seen.at(ix, iy).is_nan() {
                        let p = grid.position(ix, iy);
                        let z = ground.height_at(p).unwrap();
                        let away = (Point3::new(p.x, p.y, z) - eye).norm();
                        let at = &mut seen_at[iy * grid.nx + ix];
                        *at = if at.is_nan() { away } else { at.min(away) };
                    }
                }
            }
        }
    }
    let truth = traversability(&ground, FOOTPRINT_M, &Limits::default()).unwrap();
    Gathered { ground, truth, taken, grid, seen_at }
}

/// The map of all that was taken, station by station.
pub fn map_of(gathered: &Gathered) -> Mapper {
    let mut mapper = Mapper::new(MapSettings::default()).unwrap();
    let stations = 1 + gathered.taken.iter().map(|taken| taken.station).max().unwrap();
    for station in 0..stations {
        let of = gathered.taken.iter().enumerate().filter(|(_, taken)| taken.station == station);
        let pairs = of.map(|(i, taken)| (i as u32, Arc::new(taken.dem()))).collect();
        // Few cells say little, and are given little weight.
        let settings = AlignSettings { cells_min: 30, ..AlignSettings::default() };
        for found in mapper.add_pairs(pairs, station as i64, &settings).unwrap() {
            println!("  station {station}: {found:.4?}");
        }
    }
    mapper
}

/// How a map compares with the ground.
#[derive(Debug, Default, Clone, Copy)]
pub struct Score {
    /// Cells that a pair could see.
    pub visible: f64,
    /// Of these: cells whose height is known, and whose class is known.
    pub known: f64,
    pub classed: f64,
    /// Cells that are unsafe in truth, and those called safe, and those called caution.
    pub truly_unsafe: f64,
    pub unsafe_called_safe: f64,
    pub unsafe_called_caution: f64,
    /// Cells that are safe in truth, and those called unsafe.
    pub truly_safe: f64,
    pub safe_called_unsafe: f64,
    /// Heights within 4 m of a camera: RMS error (m) and RMS of error over sigma.
    pub rmse_4m: f64,
    pub normalized_4m: f64,
    /// The same of all visible cells.
    pub rmse: f64,
    pub normalized: f64,
    /// Mean error of all (m).
    pub bias: f64,
    /// Cells called safe, and the mean sigma (m).
    pub safe: f64,
    pub mean_sigma: f64,
    pub conflicts: f64,
}

/// `k` is how many sigmas of doubt the classes take into account.
pub fn score(gathered: &Gathered, map: &MapVersion, k: f64) -> Score {
    let observed = map.elevation(ReadPolicy::default(), 0, 1e9, Source::file("seen")).unwrap();
    let layers =
        trusted_traversability(&observed.map, &observed.trust, FOOTPRINT_M, &Limits::default())
            .unwrap();
    let class = layers.cautious_class(&observed.noise_m, k).unwrap();
    let mut s = Score::default();
    let (mut near, mut all) = (0.0, 0.0);
    for iy in 0..gathered.grid.ny {
        for ix in 0..gathered.grid.nx {
            let away = gathered.seen_at[iy * gathered.grid.nx + ix];
            if away.is_nan() {
                continue;
            }
            let p = gathered.grid.position(ix, iy);
            let truth = gathered.truth.class.nearest(p).unwrap();
            if truth == UNKNOWN {
                continue;
            }
            s.visible += 1.0;
            let found = class.nearest(p).unwrap_or(UNKNOWN);
            let count = |yes: bool| f64::from(u8::from(yes));
            s.classed += count(found != UNKNOWN);
            s.safe += count(found == SAFE);
            s.truly_unsafe += count(truth == UNSAFE);
            s.unsafe_called_safe += count(truth == UNSAFE && found == SAFE);
            s.unsafe_called_caution += count(truth == UNSAFE && found == CAUTION);
            s.truly_safe += count(truth == SAFE);
            s.safe_called_unsafe += count(truth == SAFE && found == UNSAFE);
            let cell = map.cell_at(p).unwrap();
            s.conflicts += count(cell.flags.any(fusion::Flags::CONFLICT));
            let height = MapVersion::read(&cell, ReadPolicy::default());
            if height.is_nan() {
                continue;
            }
            s.known += 1.0;
            let error = f64::from(height) - gathered.ground.height_at(p).unwrap();
            let variance = MapVersion::variance_at(&cell, 0, 0.0);
            all += 1.0;
            s.rmse += error * error;
            s.bias += error;
            s.mean_sigma += variance.sqrt();
            s.normalized += error * error / variance;
            if away <= 4.0 {
                near += 1.0;
                s.rmse_4m += error * error;
                s.normalized_4m += error * error / variance;
            }
        }
    }
    for (value, n) in [
        (&mut s.rmse, all),
        (&mut s.normalized, all),
        (&mut s.rmse_4m, near),
        (&mut s.normalized_4m, near),
    ] {
        *value = (*value / f64::max(n, 1.0)).sqrt();
    }
    s.bias /= all;
    s.mean_sigma /= all;
    s
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let of = |n: f64, total: f64| 100.0 * n / total;
        write!(
            f,
            "{} visible cells, known {:.1} %, classed {:.1} %, called safe {:.1} %; truly unsafe {:.1} %, \
             called safe {:.3} % of visible ({:.2} % of unsafe), caution {:.2} %; truly safe {:.1} %, called unsafe \
             {:.2} %; z rmse within 4 m {:.4} m, z/sigma {:.2}; all {:.4} m, {:.2}; bias {:.4} m, \
             mean sigma {:.4} m, conflicts {:.2} %",
            self.visible,
            of(self.known, self.visible),
            of(self.classed, self.visible),
            of(self.safe, self.visible),
            of(self.truly_unsafe, self.visible),
            of(self.unsafe_called_safe, self.visible),
            of(self.unsafe_called_safe, self.truly_unsafe),
            of(self.unsafe_called_caution, self.visible),
            of(self.truly_safe, self.visible),
            of(self.safe_called_unsafe, self.visible),
            self.rmse_4m,
            self.normalized_4m,
            self.rmse,
            self.normalized,
            self.bias,
            self.mean_sigma,
            of(self.conflicts, self.visible),
        )
    }
}
