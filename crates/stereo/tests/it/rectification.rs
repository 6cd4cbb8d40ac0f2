//! Rectification against the projection of points, and its health against known errors.

use nalgebra::{Isometry3, Point2, Point3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::calibration::read_tsai;
use stereo::camera::{Brown, Camera, Pinhole};
use stereo::epipolar::{EpipolarHealth, SparseSearch, rectify_checked, sparse_matches};
use stereo::rectification::{Rectification, RectifyOptions, Side};
use stereo::{GrayImage, ImageSize, StereoError};
use testkit::shared_data;

use crate::camera::size;
use crate::images::gray;
use crate::matching::texture;

const LENS: Brown = Brown { k1: -0.25, k2: 0.08, p1: 1e-3, p2: -5e-4, k3: 0.0 };

/// Two cameras that look about along z with some toe-in, of other focal lengths, 0.2 m apart, in a
/// frame that is turned by `frame`.
pub fn cameras(size: ImageSize, frame: &Isometry3<f64>) -> [Camera; 2] {
    let f = 0.8 * size.width as f64;
    let center = [0.52 * size.width as f64, 0.47 * size.height as f64];
    let camera = |x: f64, f: f64, turn: [f64; 3]| {
        let turn = UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]);
        let pose = frame * Isometry3::from_parts(Vector3::new(x, 0.3 * x, -0.1 * x).into(), turn);
        Camera::Pinhole(Pinhole::new(size, [f, 1.01 * f], center, LENS, pose).unwrap())
    };
    [camera(0.0, f, [0.02, 0.03, 0.01]), camera(0.2, 1.03 * f, [-0.01, -0.04, -0.03])]
}

fn any_frame() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
    Isometry3::from_parts(Vector3::new(3.0, -2.0, 0.7).into(), turn)
}

fn image(size: ImageSize, value: impl Fn(usize, usize) -> f64) -> GrayImage {
    let pixels = (0..size.len())
        .map(|i| value(i % size.width, i / size.width).round().clamp(0.0, 255.0) as u8);
    GrayImage::new(size, pixels.collect()).unwrap()
}

/// What a camera sees of a textured plane through `at` with the normal `normal`, one ray a pixel.
pub fn see_plane(
    camera: &Camera,
    frame: &Isometry3<f64>,
    at: Point3<f64>,
    normal: Vector3<f64>,
    texture: &impl Fn(f64, f64) -> f64,
) -> GrayImage {
    image(camera.size(), |x, y| {
        let Some(ray) = camera.ray(&Point2::new(x as f64, y as f64)) else { return 0.0 };
        let origin = frame.inverse() * ray.origin;
        let direction = frame.inverse() * ray.direction.into_inner();
        let along = (at - origin).dot(&normal) / direction.dot(&normal);
        if along <= 0.0 {
            return 0.0;
        }
        let p = origin + direction * along;
        texture(100.0 + 90.0 * p.x, 100.0 + 90.0 * p.y)
    })
}

#[test]
fn a_point_is_on_the_same_row_of_both_images_with_the_disparity_of_its_depth() {
    let size = size(120, 90);
    let frame = any_frame();
    let [left, right] = cameras(size, &frame);
    let rectification = Rectification::new(&left, &right, &RectifyOptions::default()).unwrap();
    let geometry = rectification.geometry();
    assert!((geometry.baseline - (right.center() - left.center()).norm()).abs() < 1e-12);
    // Images that say where their pixels are: twice the column, and twice the row.
    let columns = image(size, |x, _| 2.0 * x as f64);
    let rows = image(size, |_, y| 2.0 * y as f64);
    let by_columns = rectification.apply(&columns, &columns).unwrap();
    let by_rows = rectification.apply(&rows, &rows).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut n_checked = 0;
    for _ in 0..2000 {
        let z = rng.random_range(1.0..10.0);
        let point =
            Point3::new(rng.random_range(-0.6..0.6) * z, rng.random_range(-0.5..0.5) * z, z);
        let point = frame * point;
        let Some((pixel, disparity)) = geometry.project(&point) else { continue };
        let depth = geometry.frame_from_rectified.inverse_transform_point(&point).z;
        assert!((geometry.depth(disparity) - depth).abs() < 1e-9);
        let seen = [(&left, pixel), (&right, pixel - Vector3::new(disparity, 0.0, 0.0).xy())];
        let images = [(&by_columns.left, &by_rows.left), (&by_columns.right, &by_rows.right)];
        let masks = [&by_columns.left_seen, &by_columns.right_seen];
        for (((camera, at), (xs, ys)), mask) in seen.into_iter().zip(images).zip(masks) {
            let (x, y) = (at.x.round(), at.y.round());
            let inside = x >= 0.0 && y >= 0.0 && x < 120.0 && y < 90.0;
            if !inside || !mask[y as usize * 120 + x as usize] {
                continue;
            }
            // The ray through the middle of that pixel, by the ideal camera.
            let raw = camera.project(&point).unwrap();
            let got = Point2::new(
                f64::from(xs.at(x as usize, y as usize)),
                f64::from(ys.at(x as usize, y as usize)),
            ) / 2.0;
            // Up to half a pixel from rounding the place, and a quarter from the gray values.
            assert!((got - raw).abs().max() < 0.85, "{got} {raw}");
            n_checked += 1;
        }
    }
    assert!(n_checked > 1000, "{n_checked}");
    // The ideal cameras agree with the geometry.
    let point = frame * Point3::new(0.3, -0.2, 3.0);
    let (pixel, disparity) = geometry.project(&point).unwrap();
    let ideal = [Side::Left, Side::Right].map(|side| geometry.camera(side).unwrap());
    assert!((ideal[0].project(&point).unwrap() - pixel).norm() < 1e-9);
    let right_pixel = ideal[1].project(&point).unwrap();
    assert!((pixel - right_pixel - Vector3::new(disparity, 0.0, 0.0).xy()).norm() < 1e-9);
}

#[test]
fn a_rectified_pair_is_not_changed() {
    let size = size(64, 48);
    let pose = |x| Isometry3::translation(x, 0.0, 0.0);
    let camera = |x| {
        let camera = Pinhole::new(size, [60.0; 2], [31.5, 23.5], Brown::default(), pose(x));
        Camera::Pinhole(camera.unwrap())
    };
    let rectification =
        Rectification::new(&camera(0.0), &camera(0.1), &RectifyOptions::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let noise = GrayImage::new(size, (0..size.len()).map(|_| rng.random()).collect()).unwrap();
    let pair = rectification.apply(&noise, &noise).unwrap();
    assert_eq!((&pair.left, &pair.right), (&noise, &noise));
    assert!(pair.left_seen.iter().chain(&pair.right_seen).all(|seen| *seen), "borders too");
}

#[test]
fn pairs_that_are_none_are_refused_by_name() {
    let size = size(64, 48);
    let camera = |pose| {
        let camera = Pinhole::new(size, [60.0; 2], [31.5, 23.5], Brown::default(), pose);
        Camera::Pinhole(camera.unwrap())
    };
    let at = |x, y, z| camera(Isometry3::translation(x, y, z));
    let refused = |left: &Camera, right: &Camera| {
        Rectification::new(left, right, &RectifyOptions::default()).unwrap_err()
    };
    let origin = at(0.0, 0.0, 0.0);
    assert_eq!(refused(&origin, &at(-0.1, 0.0, 0.0)), StereoError::Swapped);
    assert!(refused(&origin, &at(0.0, 0.1, 0.0)).to_string().contains("above or behind"));
    assert!(refused(&origin, &at(0.0, 0.0, 0.1)).to_string().contains("above or behind"));
    assert!(matches!(refused(&origin, &origin), StereoError::NoBaseline { .. }));
    let away = camera(Isometry3::new(Vector3::x() * 0.1, Vector3::y() * 1.0));
    assert!(refused(&origin, &away).to_string().contains("40 degrees"));
    let zoomed = RectifyOptions { zoom: f64::NAN, ..RectifyOptions::default() };
    assert!(Rectification::new(&origin, &at(0.1, 0.0, 0.0), &zoomed).is_err());
    let rectification =
        Rectification::new(&origin, &at(0.1, 0.0, 0.0), &RectifyOptions::default()).unwrap();
    let fine = image(size, |_, _| 0.0);
    let other = image(ImageSize::new(48, 64).unwrap(), |_, _| 0.0);
    let error = rectification.apply(&fine, &other).unwrap_err().to_string();
    assert!(error.contains("right image") && error.contains("48 x 64"), "{error}");
}

/// A tilted textured plane as both cameras see it, when the right one is turned off its calibration.
fn scene(turn: Vector3<f64>) -> ([Camera; 2], [GrayImage; 2], Isometry3<f64>) {
    let frame = any_frame();
    let [left, right] = cameras(size(480, 360), &frame);
    let texture = texture(7);
    let normal = Unit::new_normalize(Vector3::new(0.1, -0.5, -1.0)).into_inner();
    let see = |camera: &Camera| {
        see_plane(camera, &frame, Point3::new(0.0, 0.0, 2.5), normal, &|x, y| {
            texture(1.5 * x, 1.5 * y)
        })
    };
    let actual = right.turned(&UnitQuaternion::from_scaled_axis(frame.rotation * turn));
    let images = [see(&left), see(&actual)];
    ([left, right], images, frame)
}

fn checked(
    cameras: &[Camera; 2],
    images: [&GrayImage; 2],
) -> Result<stereo::epipolar::Checked, StereoError> {
    let (options, search) = (RectifyOptions::default(), SparseSearch::default());
    rectify_checked([&cameras[0], &cameras[1]], images, &options, &search)
}

#[test]
fn a_good_calibration_is_healthy_and_left_alone() {
    let (cameras, images, _) = scene(Vector3::zeros());
    let checked = checked(&cameras, [&images[0], &images[1]]).unwrap();
    let health = checked.health.unwrap();
    println!("good calibration: {health:?}");
    assert!(health.n_matches > 100 && health.median_abs_dy < 0.15 && health.mad_dy < 0.15);
    assert!(health.negative_share < 0.02);
    assert_eq!(checked.correction, Vector3::zeros());
}

#[test]
fn a_turned_camera_shows_in_the_health_and_is_found_out() {
    // Pitch and roll of 0.3 and 0.4 degrees: 2 px and more at this focal length.
    let turn = Vector3::new(0.3_f64, 0.0, -0.4).map(f64::to_radians);
    let (cameras, images, frame) = scene(turn);
    let checked = checked(&cameras, [&images[0], &images[1]]).unwrap();
    let before = checked.health_as_calibrated.unwrap();
    let after = checked.health.unwrap();
    println!("turned camera: {before:?}\n            -> {after:?}");
    assert!(before.median_abs_dy > 1.5, "{before:?}");
    assert!(after.median_abs_dy < 0.15, "{after:?}");
    // In rectified axes; about y nothing can be told, and nothing is turned.
    let axes = checked.rectification.geometry().frame_from_rectified.rotation.inverse();
    let found = (axes * checked.correction).map(f64::to_degrees);
    let turn = (axes * (frame.rotation * turn)).map(f64::to_degrees);
    assert!((found.x - turn.x).abs() < 0.01 && (found.z - turn.z).abs() < 0.05, "{found} {turn}");
    assert!(found.y.abs() < 0.005, "{found}");
}

#[test]
fn swapped_images_are_found_out() {
    let (cameras, images, _) = scene(Vector3::zeros());
    let error = checked(&cameras, [&images[1], &images[0]]).map(|c| c.health).unwrap_err();
    assert_eq!(error, StereoError::Swapped);
    let swapped = [cameras[1].clone(), cameras[0].clone()];
    let error = checked(&swapped, [&images[0], &images[1]]).map(|c| c.health).unwrap_err();
    assert_eq!(error, StereoError::Swapped);
}

#[test]
fn black_images_have_no_health() {
    let (cameras, images, _) = scene(Vector3::zeros());
    let black = image(images[0].size(), |_, _| 0.0);
    let checked = checked(&cameras, [&black, &black]).unwrap();
    assert_eq!(checked.health, None);
    let few = [stereo::epipolar::Match { left: Point2::origin(), right: Point2::origin() }; 19];
    assert_eq!(EpipolarHealth::of(size(64, 48), &few), None);
}

/// Cameras and images of the K10 rover.
pub fn k10() -> Option<([Camera; 2], [GrayImage; 2])> {
    let camera = |side: &str| {
        let bytes = shared_data("k10", &format!("k10_stereo/black_{side}.tsai"))?;
        Some(read_tsai(std::str::from_utf8(&bytes).unwrap(), size(1024, 768)).unwrap())
    };
    let cameras = [camera("left")?, camera("right")?];
    Some((cameras, [gray("k10", "k10_stereo/left4.png")?, gray("k10", "k10_stereo/right4.png")?]))
}

#[test]
fn the_pair_of_the_k10_rover_is_mended() {
    let Some((cameras, images)) = k10() else { return };
    let checked = checked(&cameras, [&images[0], &images[1]]).unwrap();
    let (before, after) = (checked.health_as_calibrated.unwrap(), checked.health.unwrap());
    println!(
        "k10: {before:?}\n  -> {after:?}, turn {:.3} deg",
        checked.correction.norm().to_degrees()
    );
    // The data's description: about 1.2 px with its own calibration.
    assert!(before.median_abs_dy > 0.5 && before.median_abs_dy < 3.0);
    // What is left is its lenses': no rotation mends that.
    assert!(after.median_abs_dy < 0.75 * before.median_abs_dy && after.median_abs_dy < 1.1);
    let error = rectify_checked(
        [&cameras[0], &cameras[1]],
        [&images[1], &images[0]],
        &RectifyOptions::default(),
        &SparseSearch::default(),
    );
    assert_eq!(error.map(|c| c.health), Err(StereoError::Swapped));
    let wide = SparseSearch { rows: 0, ..SparseSearch::default() };
    assert!(sparse_matches(&checked.images, &wide).is_err());
}
