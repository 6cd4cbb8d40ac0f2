//! A pair of images to points: rectify, check, match, triangulate, and what to think of it.

use crate::StereoError;
use crate::camera::Camera;
use crate::epipolar::{Checked, EpipolarHealth, SparseSearch, rectify_checked};
use crate::image::GrayImage;
use crate::matching::{Disparity, Matching, Refinement, match_rectified, refine};
use crate::rectification::{RectifiedPair, RectifyOptions};
use crate::surface::{GroundPlane, Surface, TriangulateOptions, ground_plane, triangulate};

/// All options of [`reconstruct`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PairOptions {
    /// What the rectified images are like.
    pub rectify: RectifyOptions,
    /// How their rows are checked.
    pub search: SparseSearch,
    /// How they are matched.
    pub matching: Matching,
    /// How their disparities are made finer.
    pub refine: Refinement,
    /// How points are made.
    pub triangulate: TriangulateOptions,
}

/// Health of a pair: what an operator looks at before trusting its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairHealth {
    /// How well rows agree, as used; none where too few corners are found to tell.
    pub epipolar: Option<EpipolarHealth>,
    /// The same by the calibration alone.
    pub epipolar_as_calibrated: Option<EpipolarHealth>,
    /// Angle by which the right camera was turned to mend it (rad).
    pub correction_rad: f64,
    /// Share of the pixels both cameras could see that have a disparity.
    pub fill: f64,
    /// The plane that most points lie near; none of too few points. Its residual is the noise of the
    /// match where the ground is flat.
    pub ground: Option<GroundPlane>,
}

/// Points of a pair with all that led to them.
#[derive(Debug, Clone)]
pub struct Reconstruction {
    /// The rectified images.
    pub images: RectifiedPair,
    /// Their disparities.
    pub disparity: Disparity,
    /// The points in the frame of the cameras.
    pub surface: Surface,
    /// What to think of it.
    pub health: PairHealth,
}

/// Half the window of the census and one: beside the edge of what a camera saw nothing matches.
const BORDER: [usize; 2] = [5, 4];

/// The points that a calibrated pair sees. `stop` ends the work with [`StereoError::Stopped`].
pub fn reconstruct(
    cameras: [&Camera; 2],
    images: [&GrayImage; 2],
    options: &PairOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Reconstruction, StereoError> {
    let checked = rectify_checked(cameras, images, &options.rectify, &options.search)?;
    if stop() {
        return Err(StereoError::Stopped);
    }
    let Checked { rectification, images, health, health_as_calibrated, correction, .. } = checked;
    let geometry = *rectification.geometry();
    let mut disparity = match_rectified(&images.left, &images.right, &options.matching, stop)?;
    let (how, threads) = (&options.refine, options.matching.threads);
    refine(&images.left, &images.right, &mut disparity, how, threads, stop)?;
    let width = geometry.size.width;
    let left = eroded(width, &images.left_seen);
    let right = eroded(width, &images.right_seen);
    disparity.retain(|x, y, d| {
        let seen_at = x as f32 - d;
        let row = y * width;
        left[row + x] && seen_at >= 0.0 && right[row + seen_at as usize]
    });
    let surface = triangulate(&geometry, &disparity, &options.triangulate)?;
    let n_seen = left.iter().filter(|seen| **seen).count();
    let n_known = disparity.fill() * geometry.size.len() as f64;
    let health = PairHealth {
        epipolar: health,
        epipolar_as_calibrated: health_as_calibrated,
        correction_rad: correction.norm(),
        fill: if n_seen == 0 { 0.0 } else { n_known / n_seen as f64 },
        ground: ground_plane(&surface),
    };
    Ok(Reconstruction { images, disparity, surface, health })
}

/// Pixels whose window was all seen: what is left of `seen` less a border.
fn eroded(width: usize, seen: &[bool]) -> Vec<bool> {
    let [half_x, half_y] = BORDER;
    let height = seen.len() / width;
    let mut out = seen.to_vec();
    for (y, row) in seen.chunks_exact(width).enumerate() {
        for (x, is_seen) in row.iter().enumerate() {
            if !is_seen {
                let from = x.saturating_sub(half_x);
                out[y * width + from..=y * width + (x + half_x).min(width - 1)].fill(false);
            }
        }
    }
    let across = out.clone();
    for (y, row) in across.chunks_exact(width).enumerate() {
        for v in y.saturating_sub(half_y)..=(y + half_y).min(height - 1) {
            if v != y {
                let to = &mut out[v * width..][..width];
                for (to, from) in to.iter_mut().zip(row) {
                    *to &= from;
                }
            }
        }
    }
    out
}
