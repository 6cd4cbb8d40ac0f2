//! Which points are the robot itself (F89): by forward kinematics with a margin, link by link.
//!
//! The robot is drawn from the rectified left camera in the posture that was reported. Each link is
//! widened by how far it may be from there – encoders, compliance and pose – and by the window of the
//! matcher. Position in the image alone tags nothing: a point inside the widened outline is
//! *robot* if it is as near to the posed link as its uncertainty and the point's own explain, *shadow
//! band* if it lies behind the link within the matcher's window of its outline, or on the outline at a
//! disparity that the matcher cannot tell from the link's, and *terrain* else. So a rock beside a wheel
//! stays.
//!
//! The flattened template of the 2008 system is there for comparison, as [`tag_template`].

use nalgebra::{Point2, Point3, Vector3};
use rover::{LinkId, Posture, Robot};

use crate::StereoError;
use crate::ray::{RayScene, Solid};
use crate::rectification::RectifiedGeometry;
use crate::surface::{Surface, SurfacePoint, Tag};

/// How far the robot may be from its reported posture, as standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PostureErrors {
    /// Pose of the cameras to the body (m).
    pub pose: f64,
    /// Each joint angle (rad).
    pub joint_rad: f64,
    /// Deflection of a leg at its wheel (m); grows from the hip outward.
    pub sag: f64,
}

impl Default for PostureErrors {
    fn default() -> PostureErrors {
        PostureErrors { pose: 0.005, joint_rad: 0.001, sag: 0.04 }
    }
}

/// Standard deviation of where each link is (m), by [`LinkId`].
#[derive(Debug, Clone, PartialEq)]
pub struct LinkSigmas(Vec<f64>);

impl LinkSigmas {
    /// From errors of pose and joints and the compliance of the legs, in a posture.
    ///
    /// A link is moved by each joint that carries it, times its distance from that joint; sag counts
    /// in the share of the leg's joints that the link is away from the body.
    pub fn new(robot: &Robot, posture: &Posture, errors: &PostureErrors) -> LinkSigmas {
        let sigma = |i: usize| {
            let link = LinkId(i);
            let center = posture.link(link).translation.vector;
            let mut variance = errors.pose * errors.pose;
            if let Some((leg, place)) = robot.body_of(link) {
                let joints = &robot.leg(leg).joints;
                for joint in &joints[..(place + 1).min(joints.len())] {
                    let child = robot.joints()[*joint].child;
                    let lever = (center - posture.link(child).translation.vector).norm();
                    variance += (errors.joint_rad * lever).powi(2);
                }
                let share = (place + 1) as f64 / joints.len() as f64;
                variance += (errors.sag * share.min(1.0)).powi(2);
            }
            variance.sqrt()
        };
        LinkSigmas((0..robot.links().len()).map(sigma).collect())
    }

    /// Standard deviation of where a link is (m).
    pub fn of(&self, link: LinkId) -> f64 {
        self.0[link.0]
    }
}

/// How wide the margins are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskOptions {
    /// Standard deviations that count, 0 to 10.
    pub k: f64,
    /// Distance from the robot that still counts as robot beyond that (m).
    pub pad: f64,
    /// Reach of the matcher's window and of its smoothing about an outline (px), 0 to 100.
    pub spread_px: usize,
    /// Disparities that smoothing draws into one another on an outline (px), 0 to 16.
    pub smear_px: f64,
}

impl Default for MaskOptions {
    fn default() -> MaskOptions {
        MaskOptions { k: 2.0, pad: 0.02, spread_px: 9, smear_px: 2.0 }
    }
}

/// How many points got which tag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TagCounts {
    /// Terrain.
    pub terrain: usize,
    /// The robot itself.
    pub robot: usize,
    /// Neither.
    pub shadow_band: usize,
}

/// Tags the points of a surface in the frame of `scene`, which holds the robot as reported. Only its
/// solids are asked, so it may hold the ground too.
pub fn tag_robot(
    surface: &mut Surface,
    scene: &RayScene,
    sigmas: &LinkSigmas,
    options: &MaskOptions,
) -> Result<TagCounts, StereoError> {
    StereoError::check("k", options.k, [0.0, 10.0], "0 to 10 standard deviations")?;
    StereoError::check("pad", options.pad, [0.0, 10.0], "0 to 10 m")?;
    StereoError::check("spread_px", options.spread_px as f64, [0.0, 100.0], "0 to 100 px")?;
    StereoError::check("smear_px", options.smear_px, [0.0, 16.0], "0 to 16 px")?;
    let outlines = Outlines::new(&surface.geometry, scene, sigmas, options);
    let geometry = surface.geometry;
    let mut counts = TagCounts::default();
    for point in &mut surface.points {
        point.tag = outlines.tag(&geometry, point, scene, sigmas, options);
        match point.tag {
            Tag::Terrain => counts.terrain += 1,
            Tag::Robot => counts.robot += 1,
            Tag::ShadowBand => counts.shadow_band += 1,
        }
    }
    Ok(counts)
}

/// Tags all points within `radius` (m), seen from above, of any of the `places` as robot: the template
/// that was flattened about each foot in 2008. Hides rocks beside wheels.
pub fn tag_template(surface: &mut Surface, places: &[Point2<f64>], radius: f64) {
    for point in &mut surface.points {
        let at = point.position.xy();
        if places.iter().any(|place| (at - place).norm() <= radius) {
            point.tag = Tag::Robot;
        }
    }
}

/// What counts as on an outline (px).
const CORE_PX: usize = 2;

/// The links' outlines in the left image.
struct Outlines {
    width: usize,
    /// Inside a link's outline with its whole margin.
    margin: Vec<bool>,
    /// Depth of the nearest link whose outline is within the matcher's window; infinite if none.
    band: Vec<f32>,
    /// The same on the outlines themselves.
    core: Vec<f32>,
}

impl Outlines {
    fn new(
        geometry: &RectifiedGeometry,
        scene: &RayScene,
        sigmas: &LinkSigmas,
        options: &MaskOptions,
    ) -> Outlines {
        let (width, height) = (geometry.size.width, geometry.size.height);
        let mut margin = vec![false; width * height];
        let mut band = vec![f32::INFINITY; width * height];
        let mut core = band.clone();
        for solid in scene.solids() {
            let Some(outline) = Outline::new(geometry, solid) else { continue };
            let reach = options.k * sigmas.of(solid.link) * geometry.focal / outline.depth;
            let wide = (reach.ceil() as usize).min(width + height) + options.spread_px;
            outline.widened(width, height, wide, |i| margin[i] = true);
            let depth = outline.depth as f32;
            let spread = options.spread_px;
            outline.widened(width, height, spread, |i| band[i] = band[i].min(depth));
            outline.widened(width, height, spread.min(CORE_PX), |i| core[i] = core[i].min(depth));
        }
        Outlines { width, margin, band, core }
    }

    fn tag(
        &self,
        geometry: &RectifiedGeometry,
        point: &SurfacePoint,
        scene: &RayScene,
        sigmas: &LinkSigmas,
        options: &MaskOptions,
    ) -> Tag {
        let i = usize::from(point.pixel[1]) * self.width + usize::from(point.pixel[0]);
        if !self.margin[i] {
            return Tag::Terrain;
        }
        // The longest axis of the point's uncertainty is along the view.
        let variance = point.covariance.trace();
        let is_near = |solid: &Solid| {
            let limit = options.k * (sigmas.of(solid.link).powi(2) + variance).sqrt() + options.pad;
            let (center, radius) = solid.bounds();
            (point.position - center).norm() - radius <= limit
                && solid.distance(&point.position) <= limit
        };
        if scene.solids().iter().any(is_near) {
            return Tag::Robot;
        }
        let depth = geometry.frame_from_rectified.inverse_transform_point(&point.position).z;
        let disparity = |depth: f32| geometry.focal * geometry.baseline / f64::from(depth);
        let is_smeared = f64::from(point.disparity) < disparity(self.core[i]) + options.smear_px;
        let on_outline = self.core[i] < f32::INFINITY;
        if depth > f64::from(self.band[i]) || (on_outline && is_smeared) {
            Tag::ShadowBand
        } else {
            Tag::Terrain
        }
    }
}

/// Pixels of a solid's outline, by row: a mask over a part of the image.
struct Outline {
    /// First column and row, and numbers of them.
    left: usize,
    top: usize,
    columns: usize,
    rows: usize,
    mask: Vec<bool>,
    /// Nearest depth (m).
    depth: f64,
}

impl Outline {
    /// None where the solid is not in the image.
    fn new(geometry: &RectifiedGeometry, solid: &Solid) -> Option<Outline> {
        let (width, height) = (geometry.size.width, geometry.size.height);
        let (center, radius) = solid.bounds();
        let local = geometry.frame_from_rectified.inverse_transform_point(&center);
        if local.z + radius <= 0.0 {
            return None;
        }
        // The pixels that the bounding sphere may cover; all of them where it is beside the camera.
        let nearest = local.z - radius;
        let span = |middle: f64, principal: f64, n: usize| {
            if nearest <= 1e-3 {
                return Some((0, n));
            }
            let ends = [middle - radius, middle + radius];
            let at = |v: f64, z: f64| v / z * geometry.focal + principal;
            let far = local.z + radius;
            let low = at(ends[0], nearest).min(at(ends[0], far)).floor().max(0.0);
            let high = at(ends[1], nearest).max(at(ends[1], far)).ceil().min(n as f64 - 1.0);
            (low <= high).then(|| (low as usize, high as usize + 1))
        };
        let (left, right) = span(local.x, geometry.principal.x, width)?;
        let (top, bottom) = span(local.y, geometry.principal.y, height)?;
        let (columns, rows) = (right - left, bottom - top);
        let origin = Point3::from(geometry.frame_from_rectified.translation.vector);
        let mut mask = vec![false; columns * rows];
        let mut depth = f64::INFINITY;
        for (i, is_in) in mask.iter_mut().enumerate() {
            let (x, y) = ((left + i % columns) as f64, (top + i / columns) as f64);
            let ray = Vector3::new(
                (x - geometry.principal.x) / geometry.focal,
                (y - geometry.principal.y) / geometry.focal,
                1.0,
            );
            let direction = geometry.frame_from_rectified.rotation * ray.normalize();
            if let Some((distance, _)) = solid.hit(&origin, &direction, 1e3) {
                *is_in = true;
                depth = depth.min(distance / ray.norm());
            }
        }
        (depth < f64::INFINITY).then_some(Outline { left, top, columns, rows, mask, depth })
    }

    /// Calls `mark` for each pixel of the image within `by` columns and rows of the outline.
    fn widened(&self, width: usize, height: usize, by: usize, mut mark: impl FnMut(usize)) {
        let (left, top) = (self.left.saturating_sub(by), self.top.saturating_sub(by));
        let right = (self.left + self.columns + by).min(width);
        let bottom = (self.top + self.rows + by).min(height);
        // For each row of the outline its columns widened; then rows are joined over the window.
        let wide = right - left;
        let mut counts = vec![0_u32; wide];
        let across = |row: usize, counts: &mut Vec<u32>, add: bool| {
            let mask = &self.mask[row * self.columns..][..self.columns];
            let mut reach = 0;
            for (x, is_in) in mask.iter().enumerate() {
                if !is_in {
                    continue;
                }
                let at = self.left + x;
                let from = at.saturating_sub(by).max(left).max(reach);
                let to = (at + by + 1).min(right);
                for count in &mut counts[from - left..(to - left).max(from - left)] {
                    if add {
                        *count += 1;
                    } else {
                        *count -= 1;
                    }
                }
                reach = to.max(reach);
            }
        };
        for y in top..bottom {
            // Rows of the outline within `by` of y: one enters, one leaves.
            let first = y as i64 - by as i64 - self.top as i64;
            let last = y as i64 + by as i64 - self.top as i64;
            if y == top {
                for row in first.max(0)..=last.min(self.rows as i64 - 1) {
                    across(row as usize, &mut counts, true);
                }
            } else {
                if (0..self.rows as i64).contains(&last) {
                    across(last as usize, &mut counts, true);
                }
                if (0..self.rows as i64).contains(&(first - 1)) {
                    across((first - 1) as usize, &mut counts, false);
                }
            }
            for (x, count) in counts.iter().enumerate() {
                if *count > 0 {
                    mark(y * width + left + x);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn a_widened_outline_is_all_within_the_window() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (width, height) = (31, 23);
        for _ in 0..300 {
            let (left, top) = (rng.random_range(0..20), rng.random_range(0..15));
            let (columns, rows) =
                (rng.random_range(1..=width - left), rng.random_range(1..=height - top));
            let mask: Vec<bool> = (0..columns * rows).map(|_| rng.random::<f64>() < 0.03).collect();
            let outline = Outline { left, top, columns, rows, mask, depth: 1.0 };
            let by = rng.random_range(0..12);
            let mut marked = vec![false; width * height];
            outline.widened(width, height, by, |i| marked[i] = true);
            for (i, marked) in marked.iter().enumerate() {
                let (x, y) = (i % width, i / width);
                let near = (0..columns * rows).filter(|k| outline.mask[*k]).any(|k| {
                    let (u, v) = (left + k % columns, top + k / columns);
                    u.abs_diff(x) <= by && v.abs_diff(y) <= by
                });
                assert_eq!(*marked, near, "({x}, {y}) by {by}");
            }
        }
    }
}
