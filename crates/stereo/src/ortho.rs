//! Ortho-texture: images of cameras laid over the ground that they show (F35, F36).
//!
//! A texel is gray where a view shows the ground there, and transparent elsewhere: what no view shows stays
//! unknown. Whether a view shows a place – in its image, within its range, with neither ground nor robot in
//! between – is asked on a lattice of at most 5 cm; a texel counts as shown only if all four places about
//! it are. Places near ground that the robot hides are in its *band*, where the outline of the robot as reported
//! and as it was may differ: a view counts there only if no other shows the place clear of its own band.
//!
//! Where several views show a texel, they are mixed by the eighth power of how fine their pixels are on
//! the ground, so that the best counts almost alone and seams are soft; toward the edge of its image a
//! view fades. Before that the views are balanced: one gain for each (Brown and Lowe, "Automatic panoramic image
//! stitching using invariant features", IJCV 74, 2007, eq. 28 and 29). The same views give the same bytes.

mod gains;

use geometry::Grid;
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use terrain::ElevationMap;

use crate::StereoError;
use crate::camera::Camera;
use crate::image::GrayImage;
use crate::ray::RayScene;

/// Most views of one texture.
pub const VIEWS_MAX: usize = 128;
/// Most texels of one texture: what is larger gets coarser ones.
pub const TEXELS_MAX: usize = 1 << 22;
/// Most places of the lattice on which is asked what a view shows.
const PLACES_MAX: usize = 1 << 20;
/// Largest distance of these places (m).
const PLACE_M: f64 = 0.05;
/// Ground within this of the end of a ray is what was meant (m).
const SLACK_M: f64 = 5e-3;
/// Least cosine between the ground's normal and the way to the camera.
const FACING_MIN: f64 = 0.05;
/// How far from the edge of its image a view fades (px).
const FADE_PX: f64 = 24.0;
/// How much more a finer view counts.
const FINENESS: i32 = 8;

/// A camera's image, and what may hide the ground from it.
#[derive(Debug, Clone)]
pub struct View {
    /// The camera in `world`, where it was reported.
    pub camera: Camera,
    /// Its image.
    pub image: GrayImage,
    /// Where it fitted the map: moves the camera, and what was reported with it.
    pub fit: Isometry3<f64>,
    /// The robot as reported when the image was taken.
    pub robot: Option<RayScene>,
    /// Depths that count (m).
    pub range: [f64; 2],
}

/// How a texture is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrthoOptions {
    /// Distance of texels (m), 0.001 to 10.
    pub texel_m: f64,
    /// Width of the band about ground that the robot hides (m), 0 to 1.
    pub band_m: f64,
}

impl Default for OrthoOptions {
    fn default() -> OrthoOptions {
        OrthoOptions { texel_m: 0.02, band_m: 0.15 }
    }
}

/// What a view gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewShare {
    /// What its gray values were multiplied by.
    pub gain: f64,
    /// Share of the known texels where it counted most.
    pub share: f64,
}

/// Gray and transparent texels over the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct OrthoImage {
    /// Middles of the texels, row by row from the least y.
    pub grid: Grid,
    /// Gray value of each texel; 0 where it is unknown.
    pub gray: Vec<u8>,
    /// 255 where a texel is known, 0 elsewhere.
    pub alpha: Vec<u8>,
    /// View by view, as given.
    pub views: Vec<ViewShare>,
}

/// Lays images over a map (frame `world`); none if no view shows any of it. `stop` is asked once a row.
pub fn ortho(
    map: &ElevationMap,
    views: &[View],
    options: &OrthoOptions,
    stop: &dyn Fn() -> bool,
) -> Result<Option<OrthoImage>, StereoError> {
    StereoError::check("views", views.len() as f64, [0.0, VIEWS_MAX as f64], "at most 128 views")?;
    StereoError::check("texel_m", options.texel_m, [1e-3, 10.0], "0.001 to 10 m")?;
    StereoError::check("band_m", options.band_m, [0.0, 1.0], "0 to 1 m")?;
    for view in views {
        view.camera.check_image("image of a view", &view.image)?;
    }
    let Some(lattice) = lattice(map, views) else { return Ok(None) };
    let ground = RayScene::new(Some(map), None);
    let mut shown = Vec::with_capacity(views.len());
    for view in views {
        shown.push(Shown::of(view, map, &ground, &lattice, options.band_m, stop)?);
    }
    let gains = gains::gains(&shown);
    let Some(grid) = texels(&lattice, &shown, options.texel_m) else { return Ok(None) };
    let mut image = OrthoImage {
        grid,
        gray: vec![0; grid.len()],
        alpha: vec![0; grid.len()],
        views: gains.iter().map(|gain| ViewShare { gain: *gain, share: 0.0 }).collect(),
    };
    let mut known = 0_usize;
    for iy in 0..grid.ny {
        if stop() {
            return Err(StereoError::Stopped);
        }
        for ix in 0..grid.nx {
            let at = grid.position(ix, iy);
            let Some(z) = map.height_at(at) else { continue };
            let point = Point3::new(at.x, at.y, z);
            let Some((gray, best)) = mixed(&shown, &gains, &lattice, &point) else { continue };
            let i = grid.index(ix, iy);
            (image.gray[i], image.alpha[i]) = (gray, 255);
            image.views[best].share += 1.0;
            known += 1;
        }
    }
    if known == 0 {
        return Ok(None);
    }
    image.views.iter_mut().for_each(|view| view.share /= known as f64);
    Ok(Some(image))
}

/// How well a view shows a place.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
enum Sight {
    No,
    /// Near ground that the robot hides.
    Band,
    Clear,
}

/// What a view shows, on the lattice.
struct Shown<'a> {
    view: &'a View,
    /// Where it fits the map.
    camera: Camera,
    sight: Vec<Sight>,
    /// Length of a pixel on the ground (m).
    pixel_m: Vec<f32>,
    /// Gray value; NaN where it is not shown, black or white.
    gray: Vec<f32>,
}

impl<'a> Shown<'a> {
    fn of(
        view: &'a View,
        map: &ElevationMap,
        ground: &RayScene,
        lattice: &Grid,
        band_m: f64,
        stop: &dyn Fn() -> bool,
    ) -> Result<Shown<'a>, StereoError> {
        let n = lattice.len();
        let mut shown = Shown {
            view,
            camera: view.camera.moved(&view.fit),
            sight: vec![Sight::No; n],
            pixel_m: vec![f32::NAN; n],
            gray: vec![f32::NAN; n],
        };
        let mut hidden = Vec::new();
        for iy in 0..lattice.ny {
            if stop() {
                return Err(StereoError::Stopped);
            }
            for ix in 0..lattice.nx {
                let i = lattice.index(ix, iy);
                let at = lattice.position(ix, iy);
                let Some((z, [gx, gy])) = map.surface_at(at) else { continue };
                let point = Point3::new(at.x, at.y, z);
                let normal = Vector3::new(-gx, -gy, 1.0).normalize();
                let Some(pixel_m) = shown.pixel_on(&point, &normal) else { continue };
                if shown.is_hidden_by_robot(&point) {
                    hidden.push((ix, iy));
                } else if ground.sees(&shown.camera.center(), &point, SLACK_M) {
                    shown.sight[i] = Sight::Clear;
                    shown.pixel_m[i] = pixel_m as f32;
                    let gray = shown.gray_at(&point).filter(|gray| (3.0..=252.0).contains(gray));
                    shown.gray[i] = gray.map_or(f32::NAN, |gray| gray as f32);
                }
            }
        }
        shown.mark_band(&hidden, lattice, band_m);
        Ok(shown)
    }

    /// Length of a pixel on the ground (m) where the image shows a place that faces it, whatever may hide it.
    fn pixel_on(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> Option<f64> {
        let depth = self.camera.depth_in_view(point)?;
        let [near, far] = self.view.range;
        let facing = -(point - self.camera.center()).normalize().dot(normal);
        let counts = depth >= near && depth <= far && facing >= FACING_MIN;
        counts.then(|| depth / self.camera.focal()[0] / facing)
    }

    fn is_hidden_by_robot(&self, point: &Point3<f64>) -> bool {
        let reported = self.view.fit.inverse_transform_point(point);
        let from = self.view.camera.center();
        self.view.robot.as_ref().is_some_and(|robot| !robot.sees(&from, &reported, SLACK_M))
    }

    /// The band about hidden places.
    fn mark_band(&mut self, hidden: &[(usize, usize)], lattice: &Grid, band_m: f64) {
        let reach = (band_m / lattice.resolution).floor() as usize;
        for &(hx, hy) in hidden {
            for iy in hy.saturating_sub(reach)..(hy + reach + 1).min(lattice.ny) {
                for ix in hx.saturating_sub(reach)..(hx + reach + 1).min(lattice.nx) {
                    let off = ix.abs_diff(hx).pow(2) + iy.abs_diff(hy).pow(2);
                    let i = lattice.index(ix, iy);
                    if off <= reach * reach && self.sight[i] == Sight::Clear {
                        self.sight[i] = Sight::Band;
                        self.gray[i] = f32::NAN;
                    }
                }
            }
        }
    }

    /// The gray value where a point appears, between the four pixels about it.
    fn gray_at(&self, point: &Point3<f64>) -> Option<f64> {
        let pixel = self.camera.project(point)?;
        let size = self.view.image.size();
        let inside = |v: f64, n: usize| v >= 0.0 && v <= (n - 1) as f64;
        if !(inside(pixel.x, size.width) && inside(pixel.y, size.height)) {
            return None;
        }
        let (x, y) =
            ((pixel.x as usize).min(size.width - 2), (pixel.y as usize).min(size.height - 2));
        let (u, v) = (pixel.x - x as f64, pixel.y - y as f64);
        let value = |dx: usize, dy: usize| f64::from(self.view.image.at(x + dx, y + dy));
        let row = |dy: usize| value(0, dy) * (1.0 - u) + value(1, dy) * u;
        Some(row(0) * (1.0 - v) + row(1) * v)
    }

    /// How a texel in the square of the lattice from node (x, y) on is shown, and how large a pixel is.
    fn over(&self, lattice: &Grid, [x, y]: [usize; 2]) -> (Sight, f64) {
        let mut least = Sight::Clear;
        let mut pixel_m = 0.0;
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let i = lattice.index(x + dx, y + dy);
            if self.sight[i] < least {
                least = self.sight[i];
            }
            pixel_m += 0.25 * f64::from(self.pixel_m[i]);
        }
        (least, pixel_m)
    }

    /// How much it counts by how near the edge of its image a point appears, 0 to 1.
    fn fade(&self, point: &Point3<f64>) -> f64 {
        let size = self.view.image.size();
        let last = |n: usize| (n - 1) as f64;
        let edge =
            |p: Point2<f64>| p.x.min(p.y).min(last(size.width) - p.x).min(last(size.height) - p.y);
        self.camera.project(point).map_or(0.0, |p| (edge(p) / FADE_PX).clamp(1e-3, 1.0))
    }
}

/// The gray value at a point of the ground, and the view that counts most there.
fn mixed(
    shown: &[Shown<'_>],
    gains: &[f64],
    lattice: &Grid,
    point: &Point3<f64>,
) -> Option<(u8, usize)> {
    let along = (point.xy() - lattice.origin) / lattice.resolution;
    let square = |v: f64, n: usize| (v.max(0.0) as usize).min(n - 2);
    let corner = [square(along.x, lattice.nx), square(along.y, lattice.ny)];
    let sights: Vec<(Sight, f64)> = shown.iter().map(|s| s.over(lattice, corner)).collect();
    let best =
        sights.iter().map(|(sight, _)| *sight).fold(Sight::No, |a, b| if b > a { b } else { a });
    if best == Sight::No {
        return None;
    }
    let candidates = || sights.iter().enumerate().filter(|(_, (sight, _))| *sight == best);
    let finest = candidates().map(|(_, (_, pixel_m))| *pixel_m).fold(f64::INFINITY, f64::min);
    let (mut sum, mut weights, mut most) = (0.0, 0.0, (0.0, 0));
    for (k, (_, pixel_m)) in candidates() {
        let Some(gray) = shown[k].gray_at(point) else { continue };
        let weight = shown[k].fade(point) * (finest / pixel_m).powi(FINENESS);
        sum += weight * gains[k] * gray;
        weights += weight;
        if weight > most.0 {
            most = (weight, k);
        }
    }
    (weights > 0.0).then(|| ((sum / weights).round().clamp(0.0, 255.0) as u8, most.1))
}

/// The places to ask about: the part of the map that the views may reach.
fn lattice(map: &ElevationMap, views: &[View]) -> Option<Grid> {
    let (low, high) = (map.grid().origin, map.grid().far_corner());
    let mut ends = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for view in views {
        let center = view.fit * view.camera.center();
        // The range is a depth; a point at the edge of the image is farther.
        let reach = 1.5 * view.range[1];
        for axis in 0..2 {
            ends[axis] = ends[axis].min((center[axis] - reach).max(low[axis]));
            ends[2 + axis] = ends[2 + axis].max((center[axis] + reach).min(high[axis]));
        }
    }
    let [width, depth] = [ends[2] - ends[0], ends[3] - ends[1]];
    if !(width > 0.0 && depth > 0.0) {
        return None;
    }
    let resolution = map.grid().resolution.min(PLACE_M);
    let resolution = resolution.max((width * depth / PLACES_MAX as f64).sqrt());
    let count = |length: f64| (length / resolution).floor() as usize + 1;
    let grid = Grid {
        origin: Point2::new(ends[0], ends[1]),
        resolution,
        nx: count(width),
        ny: count(depth),
    };
    (grid.nx >= 2 && grid.ny >= 2).then_some(grid)
}

/// The texels of the part that any view shows.
fn texels(lattice: &Grid, shown: &[Shown<'_>], texel_m: f64) -> Option<Grid> {
    let mut ends: Option<[usize; 4]> = None;
    for iy in 0..lattice.ny {
        for ix in 0..lattice.nx {
            let i = lattice.index(ix, iy);
            if shown.iter().any(|s| s.sight[i] != Sight::No) {
                let [x0, y0, x1, y1] = ends.unwrap_or([ix, iy, ix, iy]);
                ends = Some([x0.min(ix), y0.min(iy), x1.max(ix), y1.max(iy)]);
            }
        }
    }
    let [x0, y0, x1, y1] = ends?;
    let (low, high) = (lattice.position(x0, y0), lattice.position(x1, y1));
    let extent = high - low;
    let texel = texel_m.max((extent.x * extent.y / TEXELS_MAX as f64).sqrt());
    // Whole texels of a grid from the origin of `world` on: the same ground has them at the same places.
    let first = |v: f64| (v / texel).ceil();
    let count = |low: f64, high: f64| ((high / texel).floor() - first(low) + 1.0).max(0.0) as usize;
    let (nx, ny) = (count(low.x, high.x), count(low.y, high.y));
    let origin = Point2::new(first(low.x) * texel, first(low.y) * texel);
    (nx > 0 && ny > 0).then_some(Grid { origin, resolution: texel, nx, ny })
}
