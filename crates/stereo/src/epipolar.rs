//! How well a rectification holds: sparse matches across the rows, and a small rotation that mends it.
//!
//! Corners of the left image are looked for in the right one by normalized cross-correlation, some rows
//! above and below too, and on both sides. If the calibration holds, they are on their own row, and to
//! the left.

use nalgebra::{Matrix3, Point2, UnitQuaternion, Vector3};

use crate::StereoError;
use crate::camera::Camera;
use crate::image::{GrayImage, ImageSize};
use crate::rectification::{Rectification, RectifiedGeometry, RectifiedPair, RectifyOptions};

/// How to look for matches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparseSearch {
    /// Rows looked at above and below, 1 to 32.
    pub rows: usize,
    /// Disparities looked at on both sides (px), 1 to 1024.
    pub disparities: usize,
    /// Corners looked for at most, 10 to 5000, spread over the image.
    pub corners: usize,
}

impl Default for SparseSearch {
    fn default() -> SparseSearch {
        SparseSearch { rows: 8, disparities: 128, corners: 400 }
    }
}

/// A corner found in both images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Where it is in the left image (px).
    pub left: Point2<f64>,
    /// Where it is in the right image (px).
    pub right: Point2<f64>,
}

/// Health of a rectification. Rows are measured on the right image against the left one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpipolarHealth {
    /// Corners found in both images.
    pub n_matches: usize,
    /// Median of the rows by which they are off (px, positive down).
    pub median_dy: f64,
    /// Median of its absolute value (px): the health figure; below 0.5 is good.
    pub median_abs_dy: f64,
    /// Median absolute deviation from the median (px): what a shift of rows cannot mend.
    pub mad_dy: f64,
    /// Share of matches of clearly negative disparity (by 1 % of the width): no point in front of the
    /// cameras has one.
    pub negative_share: f64,
}

/// Fewest matches that tell anything.
pub const MATCHES_MIN: usize = 20;

impl EpipolarHealth {
    /// The figures of these matches; none of fewer than [`MATCHES_MIN`].
    pub fn of(size: ImageSize, matches: &[Match]) -> Option<EpipolarHealth> {
        let n_matches = matches.len();
        if n_matches < MATCHES_MIN {
            return None;
        }
        let dy = || matches.iter().map(|m| m.right.y - m.left.y);
        // A calibration may be off by some pixels at far points.
        let clear = 0.01 * size.width as f64;
        let median_dy = median(dy());
        let negative = matches.iter().filter(|m| m.left.x - m.right.x < -clear).count();
        Some(EpipolarHealth {
            n_matches,
            median_dy,
            median_abs_dy: median(dy().map(f64::abs)),
            mad_dy: median(dy().map(|dy| (dy - median_dy).abs())),
            negative_share: negative as f64 / n_matches as f64,
        })
    }
}

/// Half the width of the patch that is compared.
const HALF: usize = 7;
/// Least strength of a corner: gray levels over two pixels, squared.
const CORNER_MIN: f64 = 40.0;
/// Least correlation of a match.
const CORRELATION_MIN: f64 = 0.75;
/// How much worse than the best (as one less the correlation) the next place must be.
const RIVAL_MIN: f64 = 1.5;

/// Corners of the left image that are found in the right one, both rectified.
pub fn sparse_matches(
    pair: &RectifiedPair,
    search: &SparseSearch,
) -> Result<Vec<Match>, StereoError> {
    let whole = |field, value: usize, [low, high]: [f64; 2], expected| {
        StereoError::check(field, value as f64, [low, high], expected)
    };
    whole("rows", search.rows, [1.0, 32.0], "1 to 32 rows")?;
    whole("disparities", search.disparities, [1.0, 1024.0], "1 to 1024 px")?;
    whole("corners", search.corners, [10.0, 5000.0], "10 to 5000 corners")?;
    let right = Patches::new(&pair.right, &pair.right_seen);
    let left = Patches::new(&pair.left, &pair.left_seen);
    let corners = corners(&pair.left, search.corners);
    Ok(corners.into_iter().filter_map(|at| find(&left, &right, at, search)).collect())
}

/// The strongest corner of each of about `count` squares of the image.
fn corners(image: &GrayImage, count: usize) -> Vec<(usize, usize)> {
    let (width, height) = (image.size().width, image.size().height);
    let side = ((image.size().len() as f64 / count as f64).sqrt() as usize).max(2 * HALF);
    let margin = HALF + 1;
    let mut corners = Vec::new();
    for top in (margin..height.saturating_sub(margin)).step_by(side) {
        for start in (margin..width.saturating_sub(margin)).step_by(side) {
            let mut best = (CORNER_MIN, None);
            for y in (top..(top + side).min(height - margin)).step_by(2) {
                for x in (start..(start + side).min(width - margin)).step_by(2) {
                    let strength = corner_strength(image, x, y);
                    if strength > best.0 {
                        best = (strength, Some((x, y)));
                    }
                }
            }
            corners.extend(best.1);
        }
    }
    corners
}

/// The smaller eigenvalue of the mean structure tensor over 7 x 7 (Shi and Tomasi 1994).
fn corner_strength(image: &GrayImage, x: usize, y: usize) -> f64 {
    let [mut xx, mut xy, mut yy] = [0_i32; 3];
    for v in y - 3..=y + 3 {
        let (above, row, below) = (image.row(v - 1), image.row(v), image.row(v + 1));
        for u in x - 3..=x + 3 {
            let gx = i32::from(row[u + 1]) - i32::from(row[u - 1]);
            let gy = i32::from(below[u]) - i32::from(above[u]);
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
        }
    }
    let [xx, xy, yy] = [xx, xy, yy].map(|sum| f64::from(sum) / 49.0);
    0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt())
}

/// Side of the patch that is compared.
const SIDE: usize = 2 * HALF + 1;

/// An image with sums of gray values and of their squares over any rectangle.
struct Patches<'a> {
    image: &'a GrayImage,
    seen: &'a [bool],
    /// Sums over all rows above and columns before: values and squares.
    sums: Vec<[i64; 2]>,
}

impl<'a> Patches<'a> {
    fn new(image: &'a GrayImage, seen: &'a [bool]) -> Patches<'a> {
        let (width, height) = (image.size().width, image.size().height);
        let mut sums = vec![[0_i64; 2]; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = [0_i64; 2];
            for (x, gray) in image.row(y).iter().enumerate() {
                let gray = i64::from(*gray);
                row = [row[0] + gray, row[1] + gray * gray];
                let above = sums[y * (width + 1) + x + 1];
                sums[(y + 1) * (width + 1) + x + 1] = [above[0] + row[0], above[1] + row[1]];
            }
        }
        Patches { image, seen, sums }
    }

    /// Sum and spread (n Σv² - (Σv)²) of the patch about a pixel; none beside the image, beside what
    /// was seen, and where all is even.
    fn spread(&self, x: usize, y: usize) -> Option<[f64; 2]> {
        let (width, height) = (self.image.size().width, self.image.size().height);
        if x < HALF || y < HALF || x + HALF >= width || y + HALF >= height {
            return None;
        }
        let (x0, y0) = (x - HALF, y - HALF);
        let seen = |dx: usize, dy: usize| self.seen[(y0 + dy) * width + x0 + dx];
        let last = SIDE - 1;
        if !(seen(0, 0) && seen(last, 0) && seen(0, last) && seen(last, last)) {
            return None;
        }
        let at = |dx: usize, dy: usize| self.sums[(y0 + dy) * (width + 1) + x0 + dx];
        let (a, b, c, d) = (at(0, 0), at(SIDE, 0), at(0, SIDE), at(SIDE, SIDE));
        let [sum, squares] = [0, 1].map(|i| (d[i] - b[i] - c[i] + a[i]) as f64);
        let spread = (SIDE * SIDE) as f64 * squares - sum * sum;
        (spread > 0.0).then_some([sum, spread])
    }

    fn row(&self, x: usize, y: usize) -> &[u8] {
        &self.image.row(y)[x - HALF..][..SIDE]
    }
}

fn find(
    left: &Patches<'_>,
    right: &Patches<'_>,
    (x, y): (usize, usize),
    search: &SparseSearch,
) -> Option<Match> {
    let [sum, spread] = left.spread(x, y)?;
    let patch: [&[u8]; SIDE] = std::array::from_fn(|dy| left.row(x, y + dy - HALF));
    // Normalized cross-correlation of the patch with that about (u, v) of the right image.
    let score = |u: usize, v: usize| {
        let Some([other_sum, other_spread]) = right.spread(u, v) else { return -1.0 };
        let mut dot = 0_u32;
        for (dy, row) in patch.iter().enumerate() {
            let other = right.row(u, v + dy - HALF);
            dot += row.iter().zip(other).map(|(a, b)| u32::from(*a) * u32::from(*b)).sum::<u32>();
        }
        let together = (SIDE * SIDE) as f64 * f64::from(dot) - sum * other_sum;
        together / (spread * other_spread).sqrt()
    };
    let columns = x.saturating_sub(search.disparities)..=x + search.disparities;
    let rows = y.saturating_sub(search.rows)..=y + search.rows;
    let n_columns = columns.end() + 1 - columns.start();
    let places = rows.clone().flat_map(|v| columns.clone().map(move |u| (u, v)));
    let scores: Vec<f64> = places.map(|(u, v)| score(u, v)).collect();
    let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let (bx, by) = (best % n_columns, best / n_columns);
    let n_rows = scores.len() / n_columns;
    let inside = (1..n_columns - 1).contains(&bx) && (1..n_rows - 1).contains(&by);
    if !inside || scores[best] < CORRELATION_MIN {
        return None;
    }
    // Nothing else may be nearly as good.
    let rival = (0..scores.len())
        .filter(|i| (i % n_columns).abs_diff(bx) > 3 || (i / n_columns).abs_diff(by) > 3)
        .map(|i| scores[i])
        .fold(-1.0, f64::max);
    if 1.0 - rival < RIVAL_MIN * (1.0 - scores[best]) {
        return None;
    }
    let vertex = |before: f64, here: f64, after: f64| {
        let bend = before + after - 2.0 * here;
        if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 }
    };
    let at = |i: usize| scores[i];
    let dx = vertex(at(best - 1), at(best), at(best + 1));
    let dy = vertex(at(best - n_columns), at(best), at(best + n_columns));
    let found = Point2::new((columns.start() + bx) as f64 + dx, (rows.start() + by) as f64 + dy);
    Some(Match { left: Point2::new(x as f64, y as f64), right: found })
}

/// Largest rotation that counts as a correction (rad): 2 degrees. Beyond, a calibration is wrong.
const CORRECTION_MAX: f64 = 0.035;

/// The rotation about its center, in the rig's frame, by which the right camera must be turned for
/// matches to lie on their rows, by robust least squares. None if there are fewer than
/// [`MATCHES_MIN`] matches or it would be more than 2 degrees.
///
/// A turn of the right camera by a small ω (in rectified axes) moves a point (x, y) of the plane z = 1
/// down by ωx (1 + y²) - ωy x y - ωz x. About y it hardly shows across the rows and changes all depths,
/// so ωy stays zero: what matches cannot tell is not touched.
pub fn correction(geometry: &RectifiedGeometry, matches: &[Match]) -> Option<UnitQuaternion<f64>> {
    if matches.len() < MATCHES_MIN {
        return None;
    }
    let rows: Vec<(Vector3<f64>, f64)> = matches
        .iter()
        .map(|m| {
            let p = (m.right - geometry.principal) / geometry.focal;
            let effect = Vector3::new(1.0 + p.y * p.y, -p.x * p.y, -p.x);
            (effect * geometry.focal, m.right.y - m.left.y)
        })
        .collect();
    let mut turn = Vector3::zeros();
    for _ in 0..20 {
        let miss = |(effect, dy): &(Vector3<f64>, f64)| dy - effect.dot(&turn);
        let scale = (1.4826 * median(rows.iter().map(|row| miss(row).abs()))).max(0.1);
        let (mut normal, mut side) = (Matrix3::zeros(), Vector3::zeros());
        for row in &rows {
            // Tukey's weight: what is far off is no match.
            let off = miss(row) / (4.685 * scale);
            let weight = if off.abs() < 1.0 { (1.0 - off * off).powi(2) } else { 0.0 };
            normal += row.0 * row.0.transpose() * weight;
            side += row.0 * (row.1 * weight);
        }
        // Nothing is known about y.
        normal.fill_row(1, 0.0);
        normal.fill_column(1, 0.0);
        (normal[(1, 1)], side.y) = (1.0, 0.0);
        let next: Vector3<f64> = normal.cholesky()?.solve(&side);
        let moved = (next - turn).norm();
        turn = next;
        if moved < 1e-9 {
            break;
        }
    }
    let axes = geometry.frame_from_rectified.rotation;
    (turn.norm() <= CORRECTION_MAX).then(|| UnitQuaternion::from_scaled_axis(axes * turn))
}

/// A pair rectified and, where that helps, mended.
#[derive(Debug, Clone)]
pub struct Checked {
    /// The rectification that is best.
    pub rectification: Rectification,
    /// The images by it.
    pub images: RectifiedPair,
    /// Its health; none where too few corners are found to tell.
    pub health: Option<EpipolarHealth>,
    /// Health by the calibration alone.
    pub health_as_calibrated: Option<EpipolarHealth>,
    /// By how much the right camera was turned about its center (rad, about the rig's axes); zero if
    /// the calibration was kept.
    pub correction: Vector3<f64>,
    /// The right camera as it was used.
    pub right: Camera,
}

/// Median |dy| (px) from which on a correction is tried.
const MEND_FROM: f64 = 0.25;

/// Rectifies a pair, measures how well rows agree, and turns the right camera a little where that makes
/// them agree better. Images that are swapped are refused.
pub fn rectify_checked(
    cameras: [&Camera; 2],
    images: [&GrayImage; 2],
    options: &RectifyOptions,
    search: &SparseSearch,
) -> Result<Checked, StereoError> {
    let [left, right] = cameras;
    left.check_image("left image", images[0])?;
    right.check_image("right image", images[1])?;
    let rectification = Rectification::new(left, right, options)?;
    let pair = rectification.apply(images[0], images[1])?;
    let size = rectification.geometry().size;
    let matches = sparse_matches(&pair, search)?;
    let health = EpipolarHealth::of(size, &matches);
    if is_swapped(&rectification, images, health.as_ref(), search)? {
        return Err(StereoError::Swapped);
    }
    let as_is = Checked {
        rectification,
        images: pair,
        health,
        health_as_calibrated: health,
        correction: Vector3::zeros(),
        right: right.clone(),
    };
    let Some(before) = health.filter(|health| health.median_abs_dy > MEND_FROM) else {
        return Ok(as_is);
    };
    let Some(turn) = correction(as_is.rectification.geometry(), &matches) else {
        return Ok(as_is);
    };
    let turned = right.turned(&turn);
    let rectification = Rectification::new(left, &turned, options)?;
    let pair = rectification.apply(images[0], images[1])?;
    let after = EpipolarHealth::of(size, &sparse_matches(&pair, search)?);
    // A correction that makes nothing better is none.
    if !after.is_some_and(|after| after.median_abs_dy < 0.8 * before.median_abs_dy) {
        return Ok(as_is);
    }
    Ok(Checked {
        rectification,
        images: pair,
        health: after,
        health_as_calibrated: Some(before),
        correction: turn.scaled_axis(),
        right: turned,
    })
}

/// True if the images fit the calibration much better the other way around.
fn is_swapped(
    rectification: &Rectification,
    images: [&GrayImage; 2],
    health: Option<&EpipolarHealth>,
    search: &SparseSearch,
) -> Result<bool, StereoError> {
    let is_fine = |health: &EpipolarHealth| {
        health.negative_share < 0.2 && health.mad_dy < 0.25 * search.rows as f64
    };
    if images[0].size() != images[1].size() || health.is_some_and(is_fine) {
        return Ok(false);
    }
    let pair = rectification.apply(images[1], images[0])?;
    let size = pair.left.size();
    let swapped = EpipolarHealth::of(size, &sparse_matches(&pair, search)?);
    let n_matches = health.map_or(0, |health| health.n_matches);
    Ok(swapped.is_some_and(|other| is_fine(&other) && other.n_matches > 2 * n_matches))
}

/// The middle of some values; zero of none.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
