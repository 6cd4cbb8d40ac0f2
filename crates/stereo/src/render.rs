//! Images of simulated cameras, and the truth behind them.
//!
//! One ray after another is cast from the camera ([`RayScene`]): the ground and the posed robot with
//! Lambert's law, the sun's hard shadows, and a band-limited texture in the world. Then the sensor: point
//! spread, vignetting, shot and read noise, quantization. Each effect can be switched off. Rows have
//! their own random streams, so any number of threads gives the same image.

mod misfit;
mod sensor;
mod texture;

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{Point2, Point3, Vector3};
use rover::LinkId;

use crate::StereoError;
use crate::camera::Camera;
use crate::image::{GrayImage, ImageSize};
use crate::ray::{Hit, RayScene, Target};
use crate::rectification::{RectifiedGeometry, Side};

pub use misfit::CalibrationErrors;
pub use sensor::Sensor;
pub use texture::Texture;

/// Light and surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Direction to the sun (any length over 0).
    pub sun: Vector3<f64>,
    /// Light in shadow, as a share of full sun; 0 to 1. On the Moon next to nothing.
    pub ambient: f64,
    /// True if things cast shadows.
    pub shadows: bool,
}

impl Default for Light {
    fn default() -> Light {
        Light { sun: Vector3::new(0.6, 0.3, 0.74), ambient: 0.01, shadows: true }
    }
}

/// All that goes into an image beside scene and camera.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderOptions {
    /// Sun and shadows.
    pub light: Light,
    /// Texture of the ground; none is an even gray.
    pub texture: Option<Texture>,
    /// The sensor; none draws the light as it is, at 128 for a white plane of albedo 0.5 in full sun.
    pub sensor: Option<Sensor>,
    /// Rays a side of each pixel, 1 to 4: its square is cast.
    pub rays: usize,
    /// Farthest thing seen (m).
    pub reach: f64,
    /// Threads, 1 to 64.
    pub threads: usize,
}

impl Default for RenderOptions {
    fn default() -> RenderOptions {
        RenderOptions {
            light: Light::default(),
            texture: Some(Texture::default()),
            sensor: Some(Sensor::default()),
            rays: 2,
            reach: 100.0,
            threads: 1,
        }
    }
}

/// What the middle of each pixel of a camera sees; row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Width and height.
    pub size: ImageSize,
    /// Depth along the camera's axis (m); NaN where nothing is seen.
    pub depth: Vec<f32>,
    /// The robot's link that is seen; none for ground and sky.
    pub link: Vec<Option<LinkId>>,
    /// True where the sun shines.
    pub lit: Vec<bool>,
}

/// Truth of a rectified pair, for the pixels of its left image.
#[derive(Debug, Clone, PartialEq)]
pub struct PairTruth {
    /// What the left camera sees.
    pub left: Truth,
    /// Disparity (px); NaN where nothing is seen.
    pub disparity: Vec<f32>,
    /// True where the right camera does not see the same point: hidden, or outside its image.
    pub occluded: Vec<bool>,
}

/// Gray value of a surface of albedo 1 that faces the sun.
const WHITE: f64 = 256.0;

/// Light without texture: albedo of ground and robot.
const ALBEDO: f64 = 0.45;

/// Pulls the ends of second rays out of the surface (m).
const LIFT: f64 = 1e-4;

/// The image of a camera in the scene's frame. `seed` is for the noise of this image. `stop` is asked
/// once a row.
pub fn render(
    scene: &RayScene,
    camera: &Camera,
    options: &RenderOptions,
    seed: u64,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<GrayImage, StereoError> {
    let sun = check(options)?;
    let size = camera.size();
    let focal = camera.focal()[0];
    let n = options.rays;
    let radiance = |pixel: Point2<f64>| {
        let Some(ray) = camera.ray(&pixel) else { return 0.0 };
        let hit = scene.cast(&ray.origin, &ray.direction, options.reach);
        hit.map_or(0.0, |hit| {
            let at = ray.origin + ray.direction.into_inner() * hit.distance;
            shade(scene, &hit, &at, &sun, hit.distance / focal, options)
        })
    };
    let mut light = vec![0.0_f32; size.len()];
    by_rows(size, &mut light, options.threads, stop, &|y, row| {
        for (x, value) in row.iter_mut().enumerate() {
            let mut sum = 0.0;
            for i in 0..n * n {
                let offset = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
                let at = Point2::new(x as f64 + offset(i % n), y as f64 + offset(i / n));
                sum += radiance(at);
            }
            *value = (WHITE * sum / (n * n) as f64) as f32;
        }
    })?;
    let pixels = match &options.sensor {
        Some(sensor) => sensor.expose(size, &light, seed),
        None => light.iter().map(|v| v.round().clamp(0.0, 255.0) as u8).collect(),
    };
    GrayImage::new(size, pixels)
}

/// What the middles of a camera's pixels see.
pub fn truth(
    scene: &RayScene,
    camera: &Camera,
    options: &RenderOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Truth, StereoError> {
    let sun = check(options)?;
    let size = camera.size();
    let axis = camera.axes() * Vector3::z();
    let mut pixels = vec![(f32::NAN, None, false); size.len()];
    by_rows(size, &mut pixels, options.threads, stop, &|y, row| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let ray = camera.ray(&Point2::new(x as f64, y as f64));
            let Some(ray) = ray else { continue };
            let hit = scene.cast(&ray.origin, &ray.direction, options.reach);
            let Some(hit) = hit else { continue };
            let at = ray.origin + ray.direction.into_inner() * hit.distance;
            let depth = hit.distance * ray.direction.dot(&axis);
            let link = match hit.target {
                Target::Ground => None,
                Target::Link(link) => Some(link),
            };
            *pixel = (depth as f32, link, is_lit(scene, &hit, &at, &sun, options));
        }
    })?;
    Ok(Truth {
        size,
        depth: pixels.iter().map(|p| p.0).collect(),
        link: pixels.iter().map(|p| p.1).collect(),
        lit: pixels.iter().map(|p| p.2).collect(),
    })
}

/// Truth of a rectified pair given in the scene's frame.
pub fn pair_truth(
    scene: &RayScene,
    geometry: &RectifiedGeometry,
    options: &RenderOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<PairTruth, StereoError> {
    let left = truth(scene, &geometry.camera(Side::Left)?, options, stop)?;
    let right = geometry.camera(Side::Right)?.center();
    let width = geometry.size.width;
    let mut disparity = Vec::with_capacity(left.depth.len());
    let mut occluded = Vec::with_capacity(left.depth.len());
    for (i, depth) in left.depth.iter().enumerate() {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let depth = f64::from(*depth);
        let d = geometry.focal * geometry.baseline / depth;
        let pixel = Point2::new(x, y) - geometry.principal;
        let point = Point3::from(pixel.push(geometry.focal) * (depth / geometry.focal));
        let point = geometry.frame_from_rectified * point;
        disparity.push(d as f32);
        // NaN is occluded too.
        occluded.push(!(x - d >= 0.0 && scene.sees(&right, &point, 1e-3)));
    }
    Ok(PairTruth { left, disparity, occluded })
}

fn check(options: &RenderOptions) -> Result<Vector3<f64>, StereoError> {
    let light = &options.light;
    StereoError::check("ambient", light.ambient, [0.0, 1.0], "a share of 0 to 1")?;
    StereoError::check("rays", options.rays as f64, [1.0, 4.0], "1 to 4 rays a side")?;
    StereoError::check("reach", options.reach, [1e-3, 1e6], "1e-3 to 1e6 m")?;
    StereoError::check("threads", options.threads as f64, [1.0, 64.0], "1 to 64")?;
    if let Some(sensor) = &options.sensor {
        sensor.check()?;
    }
    if let Some(texture) = &options.texture {
        texture.check()?;
    }
    let length = light.sun.norm();
    StereoError::check("sun", length, [1e-9, 1e12], "a direction of a length over 0")?;
    Ok(light.sun / length)
}

fn is_lit(
    scene: &RayScene,
    hit: &Hit,
    at: &Point3<f64>,
    sun: &Vector3<f64>,
    options: &RenderOptions,
) -> bool {
    let faces = hit.normal.dot(sun) > 0.0;
    let lifted = || at + hit.normal * LIFT;
    faces && !(options.light.shadows && scene.is_blocked(&lifted(), sun, options.reach))
}

/// Light from a hit, of a pixel that is `footprint` (m) wide there.
fn shade(
    scene: &RayScene,
    hit: &Hit,
    at: &Point3<f64>,
    sun: &Vector3<f64>,
    footprint: f64,
    options: &RenderOptions,
) -> f64 {
    let direct = if is_lit(scene, hit, at, sun, options) { hit.normal.dot(sun) } else { 0.0 };
    let ambient = options.light.ambient;
    let light = ambient + (1.0 - ambient) * direct;
    let albedo = match &options.texture {
        Some(texture) => {
            let salt = match hit.target {
                Target::Ground => 0,
                Target::Link(link) => 1 + link.0 as u64,
            };
            ALBEDO * texture.factor(&at.coords, footprint, salt)
        }
        None => ALBEDO,
    };
    albedo * light
}

/// Fills rows by several threads, until `stop` says true.
fn by_rows<T: Send>(
    size: ImageSize,
    values: &mut [T],
    threads: usize,
    stop: &(dyn Fn() -> bool + Sync),
    fill: &(dyn Fn(usize, &mut [T]) + Sync),
) -> Result<(), StereoError> {
    let rows = Mutex::new(values.chunks_mut(size.width).enumerate());
    let stopped = AtomicBool::new(false);
    let work = || {
        loop {
            if stopped.load(Ordering::Relaxed) || stop() {
                stopped.store(true, Ordering::Relaxed);
                return;
            }
            let next = rows.lock().map(|mut rows| rows.next());
            let Ok(Some((y, row))) = next else { return };
            fill(y, row);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    if stopped.into_inner() { Err(StereoError::Stopped) } else { Ok(()) }
}
