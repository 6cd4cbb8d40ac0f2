//! The blend of a texture by another method: for each texel a ray to every camera over a ground that is a formula, by a
//! projection written out here, and the rule of the module's documentation.

use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::GrayImage;
use stereo::camera::{Brown, Camera, Pinhole};
use stereo::ortho::{OrthoImage, OrthoOptions, View, ortho};
use terrain::{ElevationMap, Source};

use crate::camera::size;

/// A hill on gentle ground.
fn height(p: Point2<f64>) -> f64 {
    0.9 * (-0.6 * p.coords.norm_squared()).exp() + 0.1 * (0.8 * p.x + 0.5 * p.y).sin()
}

fn normal(p: Point2<f64>) -> Vector3<f64> {
    let hill = -1.2 * 0.9 * (-0.6 * p.coords.norm_squared()).exp();
    let wave = 0.1 * (0.8 * p.x + 0.5 * p.y).cos();
    Vector3::new(-(hill * p.x + 0.8 * wave), -(hill * p.y + 0.5 * wave), 1.0).normalize()
}

const WIDTH: usize = 400;
const HEIGHT: usize = 300;
const FOCAL: f64 = 260.0;
const RANGE: [f64; 2] = [0.5, 7.0];
const LENS: Brown = Brown { k1: -0.12, k2: 0.03, p1: 0.001, p2: -0.002, k3: 0.0 };

/// One camera: where it is, its axes, and what is in its image, which no other agrees with.
struct Eye {
    from: Point3<f64>,
    axes: Matrix3<f64>,
    level: f64,
    phase: f64,
}

impl Eye {
    fn new(from: [f64; 3], at: [f64; 3], level: f64, phase: f64) -> Eye {
        let (from, at) = (Point3::from(from), Point3::from(at));
        let z = (at - from).normalize();
        let x = z.cross(&Vector3::z()).normalize();
        Eye { from, axes: Matrix3::from_columns(&[x, z.cross(&x), z]), level, phase }
    }

    fn gray(&self, p: Point2<f64>) -> f64 {
        self.level + 45.0 * (p.x / 45.0 + self.phase).sin() + 40.0 * (p.y / 38.0 - self.phase).cos()
    }

    fn view(&self) -> View {
        let rotation = Rotation3::from_matrix_unchecked(self.axes);
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        let pose = Isometry3::from_parts(self.from.coords.into(), rotation);
        let middle = [0.5 * (WIDTH - 1) as f64, 0.5 * (HEIGHT - 1) as f64];
        let camera = Pinhole::new(size(WIDTH, HEIGHT), [FOCAL; 2], middle, LENS, pose).unwrap();
        let pixels =
            (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| Point2::new(x as f64, y as f64)));
        let pixels = pixels.map(|p| self.gray(p).round() as u8).collect();
        let image = GrayImage::new(size(WIDTH, HEIGHT), pixels).unwrap();
        let (camera, fit) = (Camera::Pinhole(camera), Isometry3::identity());
        View { camera, image, fit, robot: None, range: RANGE }
    }

    /// The pixel of a point and its depth, by Brown's formula as OpenCV states it.
    fn pixel(&self, point: &Point3<f64>) -> Option<(Point2<f64>, f64)> {
        let d = self.axes.transpose() * (point - self.from);
        let (x, y) = (d.x / d.z, d.y / d.z);
        let r2 = x * x + y * y;
        let radial = 1.0 + LENS.k1 * r2 + LENS.k2 * r2 * r2;
        let u = x * radial + 2.0 * LENS.p1 * x * y + LENS.p2 * (r2 + 2.0 * x * x);
        let v = y * radial + LENS.p1 * (r2 + 2.0 * y * y) + 2.0 * LENS.p2 * x * y;
        let at = Point2::new(
            FOCAL * u + 0.5 * (WIDTH - 1) as f64,
            FOCAL * v + 0.5 * (HEIGHT - 1) as f64,
        );
        (d.z > 0.0 && edge(&at) >= 0.0).then_some((at, d.z))
    }

    /// Does it show the ground at a place? The way is walked in steps of a centimeter.
    fn shows(&self, p: Point2<f64>) -> Option<Sample> {
        let point = Point3::new(p.x, p.y, height(p));
        let (pixel, depth) = self.pixel(&point)?;
        let way = self.from - point;
        let facing = way.normalize().dot(&normal(p));
        if !(RANGE[0]..=RANGE[1]).contains(&depth) || facing < 0.05 {
            return None;
        }
        let n = (way.norm() / 0.01) as usize;
        let is_free = (2..n).all(|i| {
            let q = point + way * (i as f64 / n as f64);
            q.z > height(q.xy())
        });
        is_free.then(|| Sample { pixel, pixel_m: depth / FOCAL / facing })
    }
}

/// How far a pixel is from the edge of its image (px).
fn edge(p: &Point2<f64>) -> f64 {
    p.x.min(p.y).min((WIDTH - 1) as f64 - p.x).min((HEIGHT - 1) as f64 - p.y)
}

/// Where a camera shows a place, and how large its pixel is on the ground (m).
struct Sample {
    pixel: Point2<f64>,
    pixel_m: f64,
}

/// The gray value of a place by the rule, with this power of fineness; none where no camera shows it.
fn expected(eyes: &[Eye], gains: &[f64], p: Point2<f64>, power: i32) -> Option<f64> {
    expected_sized(eyes, gains, p, p, power)
}

/// The same with the size of pixels at another place `q`.
fn expected_sized(
    eyes: &[Eye],
    gains: &[f64],
    p: Point2<f64>,
    q: Point2<f64>,
    power: i32,
) -> Option<f64> {
    let sized = |eye: &Eye| {
        let Sample { pixel_m, .. } = eye.shows(q)?;
        Some(Sample { pixel_m, ..eye.shows(p)? })
    };
    let samples: Vec<Option<Sample>> = eyes.iter().map(sized).collect();
    let finest = samples.iter().flatten().map(|s| s.pixel_m).fold(f64::INFINITY, f64::min);
    let (mut sum, mut weights) = (0.0, 0.0);
    for ((eye, gain), sample) in eyes.iter().zip(gains).zip(&samples) {
        let Some(sample) = sample else { continue };
        let fade = (edge(&sample.pixel) / 24.0).clamp(1e-3, 1.0);
        let weight = fade * (finest / sample.pixel_m).powi(power);
        sum += weight * gain * eye.gray(sample.pixel);
        weights += weight;
    }
    (weights > 0.0).then(|| sum / weights)
}

/// Is a place shown by the same cameras as all about it? The lattice decides for squares of 5 cm.
fn is_clear(eyes: &[Eye], p: Point2<f64>) -> bool {
    let about = |eye: &Eye| {
        let here = eye.shows(p).is_some();
        (0..8).all(|k| {
            let turn = f64::from(k) * std::f64::consts::FRAC_PI_4;
            let q = p + 0.08 * nalgebra::Vector2::new(turn.cos(), turn.sin());
            eye.shows(q).is_some() == here
        })
    };
    eyes.iter().all(about)
}

fn texture(eyes: &[Eye]) -> OrthoImage {
    let grid = Grid { origin: Point2::new(-3.0, -3.0), resolution: 0.05, nx: 121, ny: 121 };
    let heights = Raster::from_fn(grid, |ix, iy| height(grid.position(ix, iy)) as f32);
    let map = ElevationMap::new(heights, Source::file("hill"));
    let views: Vec<View> = eyes.iter().map(Eye::view).collect();
    ortho(&map, &views, &OrthoOptions::default(), &|| false).unwrap().unwrap()
}

#[test]
fn texels_are_what_rays_to_the_cameras_give_by_the_rule() {
    let eyes = [
        Eye::new([-2.6, -0.8, 1.3], [0.2, 0.2, 0.0], 115.0, 0.3),
        Eye::new([2.2, -1.9, 1.6], [0.0, 0.3, 0.0], 120.0, 2.1),
        Eye::new([0.6, 2.9, 1.1], [0.0, -0.2, 0.1], 130.0, 4.0),
    ];
    let image = texture(&eyes);
    let gains: Vec<f64> = image.views.iter().map(|view| view.gain).collect();
    assert!(gains.iter().all(|gain| (0.4..2.5).contains(gain)), "{gains:?}");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut n_known, mut n_hidden, mut n_edge, mut n_mixed) = (0, 0, 0, 0);
    let (mut off, mut worst, mut off_by_other) = (0.0, 0.0_f64, [0.0; 2]);
    for _ in 0..6000 {
        let (ix, iy) = (rng.random_range(0..image.grid.nx), rng.random_range(0..image.grid.ny));
        let p = image.grid.position(ix, iy);
        if !is_clear(&eyes, p) {
            n_edge += 1;
            continue;
        }
        let i = image.grid.index(ix, iy);
        let Some(gray) = expected(&eyes, &gains, p, 8) else {
            assert_eq!(image.alpha[i], 0, "{p} is shown by no camera");
            n_hidden += 1;
            continue;
        };
        assert_eq!(image.alpha[i], 255, "{p} is shown by a camera");
        let found = f64::from(image.gray[i]);
        n_known += 1;
        n_mixed += usize::from(eyes.iter().filter(|eye| eye.shows(p).is_some()).count() > 1);
        off += (found - gray).abs();
        worst = worst.max((found - gray).abs());
        // How large a pixel is counts as it is on the lattice about the texel, of 5 cm.
        let near = [-0.05, 0.0, 0.05];
        let near = near.into_iter().flat_map(|y| near.map(|x| p + nalgebra::Vector2::new(x, y)));
        let values = near.filter_map(|q| expected_sized(&eyes, &gains, p, q, 8));
        let [low, high] = values.fold([gray; 2], |[low, high], v| [low.min(v), high.max(v)]);
        assert!((low - 1.5..=high + 1.5).contains(&found), "{p}: {found}, not {low} to {high}");
        for (sum, power) in off_by_other.iter_mut().zip([4, 12]) {
            *sum += (found - expected(&eyes, &gains, p, power).unwrap()).abs();
        }
    }
    let n = n_known as f64;
    let told = format!(
        "{n_known} known ({n_mixed} by several), {n_hidden} hidden, {n_edge} at edges; off by {:.2} on average, {worst:.2} at most; \
         by other powers {:.2?}",
        off / n,
        off_by_other.map(|sum| sum / n)
    );
    assert!(n_known > 2500 && n_mixed > 1200 && n_hidden > 100 && n_edge < 2500, "{told}");
    // Rounding of the image and of the texel is half a gray value each; the size of a pixel is the mean of a square's corners.
    assert!(off / n < 0.6, "{told}");
    // It would show if the rule were another one.
    assert!(off_by_other.iter().all(|sum| sum > &(1.5 * off)), "{told}");
}
