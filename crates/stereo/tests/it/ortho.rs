//! Textures over ground whose brightness is a formula: what a texel must be is known without the code.

use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};
use rover::{Posture, Robot};
use stereo::camera::{Brown, Camera, Pinhole};
use stereo::ortho::{OrthoImage, OrthoOptions, View, ortho};
use stereo::ray::RayScene;
use stereo::{GrayImage, StereoError};
use terrain::{ElevationMap, Source};

use crate::camera::size;
use crate::ray::athlete;

/// How bright the ground is: smooth, and told from place to place.
fn brightness(p: Point2<f64>) -> f64 {
    110.0 + 40.0 * (1.7 * p.x + 0.4 * p.y).sin() + 30.0 * (1.1 * p.y - 0.6 * p.x).cos()
}

/// A plane that rises along x, 8 m a side.
const RISE: f64 = 0.1;

fn plane() -> ElevationMap {
    let grid = Grid { origin: Point2::new(-4.0, -4.0), resolution: 0.1, nx: 81, ny: 81 };
    let z = |ix: usize, iy: usize| (RISE * grid.position(ix, iy).x) as f32;
    ElevationMap::new(Raster::from_fn(grid, z), Source::file("plane"))
}

/// A camera at a place that looks at another.
fn camera(from: [f64; 3], at: [f64; 3], lens: Brown) -> Camera {
    let (from, at) = (Point3::from(from), Point3::from(at));
    let z = (at - from).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let pose = Isometry3::from_parts(from.coords.into(), rotation);
    Camera::Pinhole(Pinhole::new(size(400, 300), [300.0; 2], [199.5, 149.5], lens, pose).unwrap())
}

/// What the camera sees of the plane, each pixel by where its ray meets it; `gain` times as bright.
fn picture(camera: &Camera, gain: f64) -> GrayImage {
    let mut pixels = Vec::new();
    for y in 0..300 {
        for x in 0..400 {
            let ray = camera.ray(&Point2::new(f64::from(x), f64::from(y))).unwrap();
            let (o, d) = (ray.origin, ray.direction);
            let t = (RISE * o.x - o.z) / (d.z - RISE * d.x);
            let p = o + t * d.into_inner();
            let value = if t > 0.0 { gain * brightness(p.xy()) } else { 0.0 };
            pixels.push(value.round().clamp(0.0, 255.0) as u8);
        }
    }
    GrayImage::new(size(400, 300), pixels).unwrap()
}

fn view(camera: Camera, gain: f64) -> View {
    let image = picture(&camera, gain);
    View { camera, image, fit: Isometry3::identity(), robot: None, range: [0.5, 8.0] }
}

fn lay(views: &[View]) -> OrthoImage {
    ortho(&plane(), views, &OrthoOptions::default(), &|| false).unwrap().unwrap()
}

fn texels(image: &OrthoImage) -> impl Iterator<Item = (Point2<f64>, u8)> + '_ {
    let grid = image.grid;
    let all = (0..grid.ny).flat_map(move |iy| (0..grid.nx).map(move |ix| (ix, iy)));
    let known = all.filter(move |(ix, iy)| image.alpha[grid.index(*ix, *iy)] == 255);
    known.map(move |(ix, iy)| (grid.position(ix, iy), image.gray[grid.index(ix, iy)]))
}

#[test]
fn a_texel_is_as_bright_as_the_ground_and_known_where_the_image_shows_it() {
    let lens = Brown { k1: -0.1, k2: 0.02, ..Brown::default() };
    for lens in [Brown::default(), lens] {
        let view = view(camera([-3.0, 0.5, 1.5], [0.0, 0.0, 0.0], lens), 1.0);
        let image = lay(std::slice::from_ref(&view));
        let (mut n, mut worst) = (0, 0.0_f64);
        for (p, gray) in texels(&image) {
            worst = worst.max((f64::from(gray) - brightness(p)).abs());
            n += 1;
        }
        // Two roundings to whole gray values.
        assert!(worst <= 1.1, "{worst}");
        // Whether a place is shown, from the camera alone; the lattice leaves a rim of two of its squares.
        let (mut shown, mut missing) = (0, 0);
        for iy in 0..image.grid.ny {
            for ix in 0..image.grid.nx {
                let p = image.grid.position(ix, iy);
                let point = Point3::new(p.x, p.y, RISE * p.x);
                let depth = view.camera.depth_in_view(&point).filter(|d| (0.5..=8.0).contains(d));
                let is_known = image.alpha[image.grid.index(ix, iy)] == 255;
                assert!(!is_known || depth.is_some(), "{p} is not in the image");
                shown += usize::from(depth.is_some());
                missing += usize::from(depth.is_some() && !is_known);
            }
        }
        assert!(n > 20_000 && shown - missing == n);
        assert!((missing as f64) < 0.04 * shown as f64, "{missing} of {shown}");
        assert!((image.views[0].share - 1.0).abs() < 1e-12);
    }
}

#[test]
fn views_of_other_exposure_are_balanced_and_the_finer_one_counts() {
    let near = view(camera([-1.0, -2.0, 1.2], [0.0, 0.0, 0.0], Brown::default()), 0.8);
    let far = view(camera([-3.5, 2.0, 2.5], [0.0, 0.0, 0.0], Brown::default()), 1.15);
    let image = lay(&[near.clone(), far.clone()]);
    let [a, b] = [image.views[0], image.views[1]];
    let ratio = a.gain / b.gain;
    assert!((ratio - 1.15 / 0.8).abs() < 0.01 * ratio, "{ratio}");
    assert!((a.share + b.share - 1.0).abs() < 1e-12 && a.share > 0.2 && b.share > 0.2);
    // One factor for all: no seam is left.
    let ratios: Vec<f64> =
        texels(&image).map(|(p, gray)| f64::from(gray) / brightness(p)).collect();
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    let off = ratios.iter().map(|r| (r / mean - 1.0).abs()).fold(0.0, f64::max);
    assert!(off < 0.03, "{off} of {mean}");
    // Another order of views is the same picture.
    let turned = lay(&[far, near]);
    assert_eq!(turned.alpha, image.alpha);
    assert!(turned.gray.iter().zip(&image.gray).all(|(a, b)| a.abs_diff(*b) <= 1));
}

#[test]
fn where_two_views_show_the_ground_the_finer_one_counts() {
    let near = view(camera([-1.0, -2.0, 1.2], [0.0, 0.0, 0.0], Brown::default()), 1.0);
    let mut black = view(camera([-3.5, 2.0, 2.5], [0.0, 0.0, 0.0], Brown::default()), 1.0);
    black.image = GrayImage::new(size(400, 300), vec![0; 120_000]).unwrap();
    // Black has no gray to balance by, so both gains are 1; its pixels are three times as large there.
    let image = lay(&[near, black]);
    let about = |p: &Point2<f64>| (p - Point2::new(-0.4, -0.8)).norm() < 0.2;
    let mut n = 0;
    for (p, gray) in texels(&image).filter(|(p, _)| about(p)) {
        assert!((f64::from(gray) - brightness(p)).abs() < 2.0, "{p}");
        n += 1;
    }
    assert!(n > 200, "{n}");
    assert_eq!([image.views[0].gain, image.views[1].gain], [1.0, 1.0]);
}

/// The rover at less than a third of its size, standing on the plane's middle.
fn small_rover() -> (Robot, Posture) {
    let robot = athlete().scaled(0.3).unwrap();
    let mut configuration = robot.pose("bent").unwrap();
    configuration.world_from_base = Isometry3::translation(0.0, 0.0, 0.7);
    let posture = Posture::new(&robot, &configuration);
    (robot, posture)
}

#[test]
fn the_robot_and_the_band_about_it_are_not_in_the_texture_unless_nothing_better_is() {
    let (robot, posture) = small_rover();
    let scene = RayScene::new(None, Some((&robot, &posture)));
    let from = [-3.2, 0.0, 1.6];
    let mut hidden = view(camera(from, [0.5, 0.0, 0.0], Brown::default()), 1.0);
    hidden.robot = Some(scene.clone());
    let image = lay(std::slice::from_ref(&hidden));
    let center = hidden.camera.center();
    // Oracle: rays to each texel against the solids, one by one.
    let is_blocked = |p: Point2<f64>| {
        let way = Point3::new(p.x, p.y, RISE * p.x) - center;
        let length = way.norm();
        let hits = |solid: &stereo::ray::Solid| solid.hit(&center, &(way / length), length - 0.01);
        scene.solids().iter().any(|solid| hits(solid).is_some())
    };
    let known: Vec<Point2<f64>> = texels(&image).map(|(p, _)| p).collect();
    let leaks = known.iter().filter(|p| is_blocked(**p)).count();
    let all = (0..image.grid.ny).flat_map(|iy| (0..image.grid.nx).map(move |ix| (ix, iy)));
    let blocked = all.filter(|(ix, iy)| is_blocked(image.grid.position(*ix, *iy))).count();
    assert!(blocked > 1000, "{blocked}");
    // Only what is thinner than the lattice can slip through.
    assert!(leaks * 100 <= blocked, "{leaks} of {blocked}");
    // The band is told by a second view: there the first no longer counts, even where it is much finer.
    let mut other = view(camera([0.0, 3.9, 3.0], [0.0, 0.0, 0.0], Brown::default()), 1.0);
    other.image = GrayImage::new(size(400, 300), vec![1; 120_000]).unwrap();
    let both = lay(&[hidden.clone(), other.clone()]);
    let near_blocked = |p: Point2<f64>| {
        (0..12).any(|k| {
            let turn = f64::from(k) * std::f64::consts::TAU / 12.0;
            is_blocked(p + 0.08 * nalgebra::Vector2::new(turn.cos(), turn.sin()))
        })
    };
    let (mut n, mut of_first) = (0, 0);
    for (p, gray) in texels(&both) {
        let point = Point3::new(p.x, p.y, RISE * p.x);
        let margin = 20.0;
        let inside = other.camera.project(&point).is_some_and(|q| {
            q.x > margin && q.y > margin && q.x < 399.0 - margin && q.y < 299.0 - margin
        });
        let depth = other.camera.depth_in_view(&point).is_some_and(|d| (0.6..=7.5).contains(&d));
        if inside && depth && near_blocked(p) && !is_blocked(p) {
            n += 1;
            of_first += usize::from(gray > 3);
        }
    }
    assert!(
        n > 300 && of_first == 0,
        "{of_first} of {n} are of the view beside the robot's outline"
    );
}

#[test]
fn ground_behind_ground_is_not_painted() {
    // A wall of 1 m at x = 0, seen from the left: the plane behind it is hidden.
    let grid = Grid { origin: Point2::new(-4.0, -4.0), resolution: 0.1, nx: 81, ny: 81 };
    let z = |ix: usize, _| if (40..=41).contains(&ix) { 1.0 } else { 0.0 };
    let map = ElevationMap::new(Raster::from_fn(grid, z), Source::file("wall"));
    let camera = camera([-3.0, 0.0, 0.8], [0.0, 0.0, 0.3], Brown::default());
    let image = GrayImage::new(size(400, 300), vec![90; 120_000]).unwrap();
    let fit = Isometry3::identity();
    let view = View { camera, image, fit, robot: None, range: [0.5, 10.0] };
    let texture = ortho(&map, &[view], &OrthoOptions::default(), &|| false).unwrap().unwrap();
    let behind = texels(&texture).filter(|(p, _)| p.x > 0.2).count();
    let before = texels(&texture).filter(|(p, _)| p.x < -0.15).count();
    assert!(behind == 0 && before > 5000, "{behind}, {before}");
}

#[test]
fn a_fit_moves_the_picture_with_the_camera() {
    let reported = camera([-3.0, 0.5, 1.5], [0.0, 0.0, 0.0], Brown::default());
    let mut view = view(reported.clone(), 1.0);
    // The camera truly was 5 cm beside where it was reported.
    let fit = Isometry3::translation(0.03, 0.04, 0.003);
    view.image = picture(&reported.moved(&fit), 1.0);
    view.fit = fit;
    let image = lay(&[view]);
    let worst = texels(&image).map(|(p, gray)| (f64::from(gray) - brightness(p)).abs());
    assert!(worst.fold(0.0, f64::max) <= 1.1);
}

#[test]
fn what_is_asked_wrongly_is_refused_and_what_sees_nothing_is_none() {
    let view = view(camera([-3.0, 0.5, 1.5], [0.0, 0.0, 0.0], Brown::default()), 1.0);
    let lay = |views: &[View], options: OrthoOptions| ortho(&plane(), views, &options, &|| false);
    assert_eq!(lay(&[], OrthoOptions::default()).unwrap(), None);
    let far = View { fit: Isometry3::translation(1e3, 0.0, 0.0), ..view.clone() };
    assert_eq!(lay(&[far], OrthoOptions::default()).unwrap(), None);
    for (texel_m, band_m) in [(0.0, 0.1), (f64::NAN, 0.1), (0.02, -1.0), (11.0, 0.1)] {
        let refused = lay(std::slice::from_ref(&view), OrthoOptions { texel_m, band_m });
        assert!(matches!(refused, Err(StereoError::OutOfRange { .. })), "{texel_m} {band_m}");
    }
    let small = GrayImage::new(size(32, 32), vec![0; 1024]).unwrap();
    let refused = lay(&[View { image: small, ..view.clone() }], OrthoOptions::default());
    assert!(matches!(refused, Err(StereoError::SizeMismatch { .. })));
    let stopped = ortho(&plane(), &[view], &OrthoOptions::default(), &|| true);
    assert_eq!(stopped, Err(StereoError::Stopped));
}
