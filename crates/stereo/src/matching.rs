//! Dense matching of a rectified pair: semi-global matching over a census.
//!
//! Cost: Hamming distance of center-symmetric censuses of 9 x 7 pixels (31 bits).
//! Aggregation along five paths (from the left, from the right, from above, and the two diagonals from
//! above), one row after another: nothing of the size of a cost volume is kept (Hirschmüller 2008,
//! "Stereo processing by semi-global matching and mutual information", section 2). Then the winner by
//! parabola, a uniqueness test, a left-right check, a 3 x 3 median and a speckle filter. What fails is
//! a hole and stays one.
//!
//! All arithmetic is in whole numbers, and rows go in bands of fixed height: any number of threads and
//! any instruction set give the same bits. Memory beyond images and result: about 8 bytes per column
//! and disparity for each thread, 1.1 MB at 1024 columns and 128 disparities.

mod census;
mod filters;
mod refine;
mod sgm;

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::StereoError;
use crate::image::{GrayImage, ImageSize};

pub use refine::{Refinement, refine};

/// How to match.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// Disparities looked at: 0 up to below this (px); 1 to 128, rounded up to 32, 64, 96 or 128.
    pub disparities: usize,
    /// Penalty for a change of disparity by one between neighbors, in census bits; 1 to 40.
    pub p1: u8,
    /// Penalty for a larger change; `p1` to 40.
    pub p2: u8,
    /// Penalty for a larger change across an edge of the image; `p1` to `p2`.
    pub p2_edge: u8,
    /// Gray levels between neighbors that make an edge.
    pub edge: u8,
    /// By how much (%) the second-best disparity must cost more than the best; 0 to 100.
    pub uniqueness_percent: u8,
    /// Largest difference of the disparities found from left and from right (px).
    pub left_right_max: u8,
    /// Connected areas smaller than this are dropped (px²).
    pub speckle_area: usize,
    /// Connected pixels differ by no more than this (px).
    pub speckle_step: f32,
    /// A pixel darker than this, or in 3 x 3 pixels whose mean is, shows nothing to match.
    pub dark: u8,
    /// Where the gray values of a census window span less than this, there is nothing to match.
    pub contrast: u8,
    /// Threads, 1 to 64; the answer does not depend on them.
    pub threads: usize,
}

impl Default for Matching {
    fn default() -> Matching {
        Matching {
            disparities: 128,
            p1: 7,
            p2: 40,
            p2_edge: 18,
            edge: 20,
            uniqueness_percent: 5,
            left_right_max: 1,
            speckle_area: 100,
            speckle_step: 1.0,
            dark: 8,
            contrast: 2,
            threads: 1,
        }
    }
}

/// Largest penalty: keeps a path's costs, and the sums that matter, within 8 bits.
const PENALTY_MAX: u8 = 40;

/// Parts of a pixel in which disparities are kept.
pub(crate) const PARTS: i16 = 64;
/// A hole among disparities in parts of a pixel.
pub(crate) const HOLE: i16 = i16::MIN;

/// Rows of a band; the paths of each band start some rows above it.
const BAND_ROWS: usize = 256;

/// Disparities of the pixels of a rectified left image.
#[derive(Debug, Clone, PartialEq)]
pub struct Disparity {
    size: ImageSize,
    parts: Vec<i16>,
}

impl Disparity {
    /// Width and height.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// The disparity of a pixel (px): it appears at x less this in the right image. None in a hole;
    /// panics outside the image.
    pub fn at(&self, x: usize, y: usize) -> Option<f32> {
        let parts = self.parts[y * self.size.width + x];
        (parts != HOLE).then(|| f32::from(parts) / f32::from(PARTS))
    }

    /// All disparities (px), row-major; NaN in holes.
    pub fn values(&self) -> Vec<f32> {
        let value = |parts: &i16| {
            if *parts == HOLE { f32::NAN } else { f32::from(*parts) / f32::from(PARTS) }
        };
        self.parts.iter().map(value).collect()
    }

    /// Share of pixels that have a disparity.
    pub fn fill(&self) -> f64 {
        let n_known = self.parts.iter().filter(|parts| **parts != HOLE).count();
        n_known as f64 / self.size.len() as f64
    }

    /// Makes holes of the pixels that `keep(x, y, disparity)` refuses.
    pub fn retain(&mut self, mut keep: impl FnMut(usize, usize, f32) -> bool) {
        for (i, parts) in self.parts.iter_mut().enumerate() {
            let (x, y) = (i % self.size.width, i / self.size.width);
            if *parts != HOLE && !keep(x, y, f32::from(*parts) / f32::from(PARTS)) {
                *parts = HOLE;
            }
        }
    }
}

impl Matching {
    fn check(&self) -> Result<(), StereoError> {
        let whole = |field: &str, value: usize, range: [usize; 2], expected| {
            let [low, high] = range.map(|bound| bound as f64);
            StereoError::check(field, value as f64, [low, high], expected).map(|_| ())
        };
        let penalty_max = usize::from(PENALTY_MAX);
        let [p1, p2, edge] = [self.p1, self.p2, self.p2_edge].map(usize::from);
        whole(
            "disparities",
            self.disparities,
            [1, 128],
            "1 to 128; match smaller images for more",
        )?;
        whole("p1", p1, [1, penalty_max], "1 to 40")?;
        whole("p2", p2, [p1, penalty_max], "p1 to 40")?;
        whole("p2_edge", edge, [p1, p2], "p1 to p2")?;
        whole("uniqueness_percent", self.uniqueness_percent.into(), [0, 100], "0 to 100")?;
        whole("threads", self.threads, [1, 64], "1 to 64")?;
        let step = f64::from(self.speckle_step);
        StereoError::check("speckle_step", step, [0.0, 128.0], "0 to 128 px").map(|_| ())
    }
}

/// The disparities of a rectified pair. `stop` is asked after each row; once it says true, the work
/// ends with [`StereoError::Stopped`].
pub fn match_rectified(
    left: &GrayImage,
    right: &GrayImage,
    how: &Matching,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Disparity, StereoError> {
    how.check()?;
    if left.size() != right.size() {
        return Err(StereoError::SizeMismatch {
            what: "right image",
            image: right.size(),
            calibration: left.size(),
        });
    }
    let size = left.size();
    let mut parts = vec![HOLE; size.len()];
    let n_bands = size.height.div_ceil(BAND_ROWS);
    let band_rows = size.height.div_ceil(n_bands);
    let bands = Mutex::new(parts.chunks_mut(band_rows * size.width).enumerate());
    let stopped = AtomicBool::new(false);
    let work = || {
        loop {
            let next = bands.lock().map(|mut bands| bands.next());
            let Ok(Some((i, band))) = next else { return };
            let done = sgm::match_band(left, right, how, i * band_rows, band, &|| {
                stop() || stopped.load(Ordering::Relaxed)
            });
            if !done {
                stopped.store(true, Ordering::Relaxed);
                return;
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..how.threads.min(n_bands) {
            scope.spawn(work);
        }
        work();
    });
    if stopped.load(Ordering::Relaxed) {
        return Err(StereoError::Stopped);
    }
    filters::drop_blank(left, how.dark, how.contrast, &mut parts);
    let mut parts = filters::median(size.width, &parts);
    let step = (how.speckle_step * f32::from(PARTS)) as i16;
    filters::drop_speckles(size.width, &mut parts, how.speckle_area, step);
    Ok(Disparity { size, parts })
}
