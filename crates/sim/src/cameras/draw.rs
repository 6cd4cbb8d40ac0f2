//! Drawing the images of a capture, aside or at once.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

use rover::{Posture, Robot};
use stereo::camera::Camera;
use stereo::codec::encode;
use stereo::ray::RayScene;
use stereo::render::{CalibrationErrors, Light, RenderOptions, Sensor, render};
use stereo::rig::{CameraPair, Rig};
use stereo::{ImageSize, StereoError};
use terrain::ElevationMap;

use super::{Effects, IMAGE_BYTES_MAX, ImageName, Side};

/// Threads of drawing; the images do not depend on them.
const THREADS: usize = 2;

/// All that drawing needs, for it goes on while the rover does.
pub(super) struct Task {
    pub capture: String,
    /// The pairs, as large as their images.
    pub pairs: Vec<CameraPair>,
    /// The same as they are by themselves.
    pub rig: Rig,
    pub robot: Arc<Robot>,
    pub map: ElevationMap,
    pub posture: Posture,
    pub depth_bits: u8,
    pub effects: Effects,
}

/// An image with its size as PNG, or why there is none.
type Drawn = (ImageName, Result<(ImageSize, Vec<u8>), String>);

/// Draws until it is dropped. Its images wait here, at most as many as the task has.
#[derive(Debug)]
pub(super) struct Drawer {
    stop: Arc<AtomicBool>,
    drawn: Mutex<Receiver<Drawn>>,
}

impl Drawer {
    /// Draws by a thread of its own. Where there is none to be had, all images have failed.
    pub fn aside(task: Task) -> Drawer {
        let (sender, drawer) = Drawer::new();
        let stop = drawer.stop.clone();
        let failed: Vec<ImageName> =
            task.pairs.iter().map(|pair| name(&task, pair, Side::Left)).collect();
        let (again, capture) = (sender.clone(), task.capture.clone());
        let work = move || task.draw(&stop, &sender);
        let thread = std::thread::Builder::new().name("cameras".into()).spawn(work);
        if let Err(error) = thread {
            for name in failed {
                // The receiver is held by `drawer`.
                let _ = again.send((name, Err(format!("no thread draws {capture}: {error}"))));
            }
        }
        drawer
    }

    /// Draws at once.
    pub fn here(task: Task) -> Drawer {
        let (sender, drawer) = Drawer::new();
        task.draw(&drawer.stop, &sender);
        drawer
    }

    fn new() -> (Sender<Drawn>, Drawer) {
        let (sender, receiver) = channel();
        (sender, Drawer { stop: Arc::default(), drawn: Mutex::new(receiver) })
    }

    /// What has been drawn since the last call, and whether that is all.
    pub fn take(&self) -> (Vec<Drawn>, bool) {
        let receiver = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        let mut drawn = Vec::new();
        loop {
            match receiver.try_recv() {
                Ok(image) => drawn.push(image),
                Err(TryRecvError::Empty) => return (drawn, false),
                Err(TryRecvError::Disconnected) => return (drawn, true),
            }
        }
    }
}

impl Drop for Drawer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn name(task: &Task, pair: &CameraPair, side: Side) -> ImageName {
    ImageName { capture: task.capture.clone(), pair: pair.name.clone(), side }
}

impl Task {
    fn draw(&self, stop: &AtomicBool, sender: &Sender<Drawn>) {
        for pair in &self.pairs {
            match self.cameras(pair) {
                Err(error) => {
                    let _ = sender.send((name(self, pair, Side::Left), Err(error.to_string())));
                }
                Ok(cameras) => {
                    for (camera, side) in cameras.iter().zip([Side::Left, Side::Right]) {
                        let outcome = self.image(pair, camera, side, stop);
                        let stopped = outcome.is_err() && stop.load(Ordering::Relaxed);
                        // Nobody waits for it any more.
                        if stopped || sender.send((name(self, pair, side), outcome)).is_err() {
                            return;
                        }
                    }
                }
            }
        }
    }

    /// The cameras in `world` as they truly are.
    fn cameras(&self, pair: &CameraPair) -> Result<[Camera; 2], StereoError> {
        let cameras = pair.cameras(&self.posture);
        let Effects { calibration_errors: times, calibration_seed, .. } = self.effects;
        if times == 0.0 {
            return Ok(cameras);
        }
        let usual = CalibrationErrors::default();
        let width = |pair: &CameraPair| pair.left.size().width as f64;
        let share = self.rig.pair(&pair.name).map_or(1.0, |whole| width(pair) / width(whole));
        let errors = CalibrationErrors {
            // In pixels of the whole image: of a smaller one they are fewer.
            intrinsics_px: times * usual.intrinsics_px * share,
            relative_rad: times * usual.relative_rad,
            pair: times * usual.pair,
            pair_rad: times * usual.pair_rad,
        };
        errors.actual([&cameras[0], &cameras[1]], salted(calibration_seed, &pair.name))
    }

    fn image(
        &self,
        pair: &CameraPair,
        camera: &Camera,
        side: Side,
        stop: &AtomicBool,
    ) -> Result<(ImageSize, Vec<u8>), String> {
        let scene = RayScene::new(Some(&self.map), Some((&self.robot, &self.posture)));
        let options = RenderOptions {
            light: Light { shadows: self.effects.shadows, ..Light::default() },
            sensor: self.effects.noise.then(Sensor::default),
            threads: THREADS,
            ..RenderOptions::default()
        };
        let seed = salted(self.effects.seed, &pair.name);
        let seed = seed.wrapping_add(u64::from(side == Side::Right));
        let asked = || stop.load(Ordering::Relaxed);
        let image = render(&scene, camera, &options, seed, &asked).map_err(|e| e.to_string())?;
        let content = encode(&image, self.depth_bits).map_err(|e| e.to_string())?;
        if content.len() > IMAGE_BYTES_MAX {
            let bytes = content.len();
            return Err(format!("an image of {bytes} bytes; at most {IMAGE_BYTES_MAX} are sent"));
        }
        Ok((image.size(), content))
    }
}

/// A seed for each pair, which neither the choice of pairs nor their order changes.
fn salted(seed: u64, name: &str) -> u64 {
    name.bytes()
        .fold(seed, |salt, byte| (salt ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
