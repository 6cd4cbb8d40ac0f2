//! Triangulation: points with covariance from disparities.
//!
//! With focal length f, baseline b and principal point (cx, cy), a pixel (u, v) of disparity d is at
//! z = f b / d, x = (u - cx) z / f, y = (v - cy) z / f. Its covariance is J diag(σd², σu², σv²) Jᵀ
//! with the Jacobian J of that, so a depth has σz = z² σd / (f b): 10 mm at 2 m and 40 mm at 4 m for
//! f = 600 px, b = 0.2 m, σd = 0.3 px.

mod common;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use crate::StereoError;
use crate::epipolar::median;
use crate::image::ImageSize;
use crate::matching::Disparity;
use crate::rectification::RectifiedGeometry;

pub use common::CommonErrors;

/// How sure matches are, and which ranges count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangulateOptions {
    /// Standard deviation of a disparity (px), over 0 to 10. Refined ones are within 0.16 to 0.21 px (one
    /// standard deviation) on simulated ground, where that of the match before was 0.19 px beside a lag of 0.23 px.
    pub sigma_disparity: f64,
    /// Standard deviation of where in the image the seen point is (px), 0 to 10: half a pixel's width.
    pub sigma_pixel: f64,
    /// Nearest and farthest depth along the view (m).
    pub range: [f64; 2],
}

impl Default for TriangulateOptions {
    fn default() -> TriangulateOptions {
        TriangulateOptions { sigma_disparity: 0.2, sigma_pixel: 0.3, range: [0.1, 20.0] }
    }
}

/// What a point belongs to (F89).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Tag {
    /// The ground or what lies on it.
    #[default]
    Terrain,
    /// The robot itself.
    Robot,
    /// So near the robot's outline in the image that either may have been seen: belongs to neither.
    ShadowBand,
}

/// A seen point in the frame of the rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where it is (m).
    pub position: Point3<f64>,
    /// Covariance of its position (m²), from the match alone: poses of cameras and rover come on top.
    pub covariance: Matrix3<f64>,
    /// Column and row in the rectified left image.
    pub pixel: [u16; 2],
    /// Its disparity (px).
    pub disparity: f32,
    /// Side of the pixel at its depth (m), across the view.
    pub footprint: f64,
    /// What it belongs to.
    pub tag: Tag,
}

/// All points of a pair, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Geometry of the pair that saw them.
    pub geometry: RectifiedGeometry,
    /// The points, in the frame of the rig.
    pub points: Vec<SurfacePoint>,
}

impl Surface {
    /// The same points seen from another frame: `motion` maps the rig's frame to it.
    pub fn moved(&self, motion: &Isometry3<f64>) -> Surface {
        let rotation = motion.rotation.to_rotation_matrix();
        let moved = |point: &SurfacePoint| SurfacePoint {
            position: motion * point.position,
            covariance: rotation.matrix() * point.covariance * rotation.matrix().transpose(),
            ..*point
        };
        let frame_from_rectified = motion * self.geometry.frame_from_rectified;
        Surface {
            geometry: RectifiedGeometry { frame_from_rectified, ..self.geometry },
            points: self.points.iter().map(moved).collect(),
        }
    }
}

/// The point of a pixel and disparity, in the frame of the rig, with its covariance; the disparity is
/// above 0.
pub fn triangulate_pixel(
    geometry: &RectifiedGeometry,
    [u, v]: [f64; 2],
    disparity: f64,
    options: &TriangulateOptions,
) -> (Point3<f64>, Matrix3<f64>) {
    let RectifiedGeometry { focal, baseline, principal, .. } = *geometry;
    let ray = Vector3::new((u - principal.x) / focal, (v - principal.y) / focal, 1.0);
    let z = focal * baseline / disparity;
    let across = z / focal;
    // Columns: change with d, u, v.
    let jacobian = Matrix3::from_columns(&[
        -ray * (z / disparity),
        Vector3::x() * across,
        Vector3::y() * across,
    ]);
    let (sd, su) = (options.sigma_disparity, options.sigma_pixel);
    let variances = Matrix3::from_diagonal(&Vector3::new(sd * sd, su * su, su * su));
    let rotation = geometry.frame_from_rectified.rotation.to_rotation_matrix();
    let jacobian = rotation.matrix() * jacobian;
    let position = geometry.frame_from_rectified * Point3::from(ray * z);
    (position, jacobian * variances * jacobian.transpose())
}

/// All points of a disparity image.
pub fn triangulate(
    geometry: &RectifiedGeometry,
    disparity: &Disparity,
    options: &TriangulateOptions,
) -> Result<Surface, StereoError> {
    let [near, far] = options.range;
    StereoError::check(
        "sigma_disparity",
        options.sigma_disparity,
        [1e-6, 10.0],
        "over 0 to 10 px",
    )?;
    StereoError::check("sigma_pixel", options.sigma_pixel, [0.0, 10.0], "0 to 10 px")?;
    StereoError::check("range.near", near, [0.0, 1e6], "a depth of 0 m or more")?;
    StereoError::check("range.far", far, [near, 1e6], "a depth beyond the nearest (m)")?;
    if disparity.size() != geometry.size {
        let (image, calibration) = (disparity.size(), geometry.size);
        return Err(StereoError::SizeMismatch { what: "disparity image", image, calibration });
    }
    let ImageSize { width, height } = geometry.size;
    let mut points = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let Some(d) = disparity.at(x, y).filter(|d| *d > 0.0) else { continue };
            let depth = geometry.depth(f64::from(d));
            if !(near..=far).contains(&depth) {
                continue;
            }
            let (position, covariance) =
                triangulate_pixel(geometry, [x as f64, y as f64], f64::from(d), options);
            points.push(SurfacePoint {
                position,
                covariance,
                pixel: [x as u16, y as u16],
                disparity: d,
                footprint: depth / geometry.focal,
                tag: Tag::Terrain,
            });
        }
    }
    Ok(Surface { geometry: *geometry, points })
}

/// A plane that most points lie near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundPlane {
    /// Its normal, toward the cameras.
    pub normal: Vector3<f64>,
    /// Normal · point of all its points (m).
    pub offset: f64,
    /// Robust standard deviation of the points about it (m): 1.4826 times the median distance of
    /// those within 3 of it.
    pub residual: f64,
    /// Points that lie near it, as a share of all.
    pub inlier_share: f64,
}

/// Points looked at to find a plane.
const PLANE_POINTS: usize = 4000;
/// Triples of points tried.
const PLANE_TRIALS: usize = 300;

/// The plane that most of the points of a surface lie near, seen from its cameras: by the median
/// distance to planes through three points, then by least squares over those near it. None of fewer
/// than 100 points.
pub fn ground_plane(surface: &Surface) -> Option<GroundPlane> {
    let n = surface.points.len();
    if n < 100 {
        return None;
    }
    let stride = n.div_ceil(PLANE_POINTS);
    let points: Vec<Vector3<f64>> =
        surface.points.iter().step_by(stride).map(|p| p.position.coords).collect();
    // Triples spread by a multiplicative sequence: the same on every machine.
    let pick = |i: usize| points[(i.wrapping_mul(2_654_435_761) >> 7) % points.len()];
    let mut best: Option<(f64, Vector3<f64>, f64)> = None;
    for trial in 0..PLANE_TRIALS {
        let [a, b, c] = [3 * trial, 3 * trial + 1, 3 * trial + 2].map(pick);
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-9) else { continue };
        let offset = normal.dot(&a);
        let score = median(points.iter().map(|p| (normal.dot(p) - offset).abs()));
        if best.is_none_or(|(least, _, _)| score < least) {
            best = Some((score, normal, offset));
        }
    }
    let (mut scale, mut normal, mut offset) = best?;
    let mut share = 0.0;
    for _ in 0..10 {
        let limit = (3.0 * 1.4826 * scale).max(1e-6);
        let near: Vec<Vector3<f64>> =
            points.iter().filter(|p| (normal.dot(p) - offset).abs() <= limit).copied().collect();
        let middle = near.iter().sum::<Vector3<f64>>() / near.len() as f64;
        let spread: Matrix3<f64> =
            near.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        normal = eigen.eigenvectors.column(least).into_owned();
        offset = normal.dot(&middle);
        scale = median(near.iter().map(|p| (normal.dot(p) - offset).abs()));
        share = near.len() as f64 / points.len() as f64;
    }
    let eye = surface.geometry.frame_from_rectified.translation.vector;
    if normal.dot(&eye) < offset {
        (normal, offset) = (-normal, -offset);
    }
    Some(GroundPlane { normal, offset, residual: 1.4826 * scale, inlier_share: share })
}
