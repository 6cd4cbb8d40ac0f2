//! Camera models against closed forms and against each other.

use nalgebra::{Isometry3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::camera::{Brown, Cahvor, Camera, Pinhole};
use stereo::{GrayImage, ImageSize, StereoError};

pub fn size(width: usize, height: usize) -> ImageSize {
    ImageSize::new(width, height).unwrap()
}

const LENS: Brown = Brown { k1: -0.33, k2: 0.13, p1: -4e-4, p2: 1.1e-3, k3: -0.01 };

fn random_pose(rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let mut turn = || rng.random_range(-3.0..3.0);
    let rotation = UnitQuaternion::from_euler_angles(turn(), turn(), turn());
    Isometry3::from_parts(Vector3::new(turn(), turn(), turn()).into(), rotation)
}

fn pinhole(lens: Brown, pose: Isometry3<f64>) -> Camera {
    let camera = Pinhole::new(size(1024, 768), [620.0, 622.0], [526.0, 374.0], lens, pose);
    Camera::Pinhole(camera.unwrap())
}

/// The vectors of a pinhole without lens.
fn cahv(pose: &Isometry3<f64>, f: [f64; 2], c: [f64; 2]) -> [Vector3<f64>; 4] {
    let axis = |v: Vector3<f64>| pose.rotation * v;
    let a = axis(Vector3::z());
    let (h, v) = (axis(Vector3::x()) * f[0] + a * c[0], axis(Vector3::y()) * f[1] + a * c[1]);
    [pose.translation.vector, a, h, v]
}

#[test]
fn the_formulas_of_brown_are_those_of_opencv() {
    // By hand: X = (0.6, -0.3, 2) is (0.3, -0.15) at z = 1; r² = 0.1125; radial = 1 - 0.33·0.1125
    // + 0.13·0.1125² - 0.01·0.1125³ = 0.9645060742; 2xy = -0.09; r² + 2x² = 0.2925; r² + 2y² = 0.1575.
    let x = 0.3 * 0.964_506_074_218_75 + -4e-4 * -0.09 + 1.1e-3 * 0.2925;
    let y = -0.15 * 0.964_506_074_218_75 + -4e-4 * 0.1575 + 1.1e-3 * -0.09;
    let camera = pinhole(LENS, Isometry3::identity());
    let seen = camera.project(&Point3::new(0.6, -0.3, 2.0)).unwrap();
    let expected = Point2::new(620.0 * x + 526.0, 622.0 * y + 374.0);
    assert!((seen - expected).norm() < 1e-9, "{seen} {expected}");
}

#[test]
fn a_cahv_model_is_the_same_camera_as_its_pinhole() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..50 {
        let pose = random_pose(&mut rng);
        let plain = pinhole(Brown::default(), pose);
        let model = cahv(&pose, [620.0, 622.0], [526.0, 374.0]);
        let planetary = Camera::Cahvor(Cahvor::cahv(size(1024, 768), model).unwrap());
        assert!(plain.axes().angle_to(&planetary.axes()) < 1e-7);
        assert!((plain.focal()[1] - planetary.focal()[1]).abs() < 1e-9);
        for _ in 0..20 {
            let at = Point3::from(Vector3::from_fn(|_, _| rng.random_range(-8.0..8.0)));
            match (plain.project(&at), planetary.project(&at)) {
                (Some(a), Some(b)) if a.coords.norm() < 1e4 => {
                    assert!((a - b).norm() < 1e-6, "{a} {b}");
                }
                (None, Some(b)) | (Some(b), None) => assert!(b.coords.norm() > 3e3, "{b}"),
                _ => {}
            }
        }
    }
}

#[test]
fn radial_lens_terms_of_cahvor_are_those_of_brown_when_the_axes_agree() {
    // With O = A a point at tangent t appears at t (1 + r0 + r1 t² + r2 t⁴): r1 = k1, r2 = k2.
    let pose = random_pose(&mut ChaCha8Rng::seed_from_u64(2));
    let lens = Brown { k1: -0.2, k2: 0.05, ..Brown::default() };
    let brown = pinhole(lens, pose);
    let model = cahv(&pose, [620.0, 622.0], [526.0, 374.0]);
    let model = Cahvor::new(size(1024, 768), model, model[1], [0.0, -0.2, 0.05]);
    let cahvor = Camera::Cahvor(model.unwrap());
    for (x, y) in [(0.0, 0.0), (526.0, 374.0), (1023.0, 767.0), (300.0, 700.0)] {
        let pixel = Point2::new(x, y);
        let (a, b) = (brown.ray(&pixel).unwrap(), cahvor.ray(&pixel).unwrap());
        assert!(a.direction.angle(&b.direction) < 1e-7);
        assert!(
            (brown.project(&(a.origin + 3.0 * a.direction.into_inner())).unwrap() - pixel).norm()
                < 1e-7
        );
        assert!(
            (cahvor.project(&(b.origin + 3.0 * b.direction.into_inner())).unwrap() - pixel).norm()
                < 1e-7
        );
    }
}

#[test]
fn every_pixel_comes_back_along_its_ray() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for i in 0..40 {
        let pose = random_pose(&mut rng);
        let camera = if i % 2 == 0 {
            pinhole(LENS, pose)
        } else {
            let tilt = Rotation3::from_euler_angles(0.004, -0.003, 0.0);
            let vectors = cahv(&pose, [620.0, 622.0], [526.0, 374.0]);
            let o = tilt * vectors[1];
            let model = Cahvor::new(size(1024, 768), vectors, o, [1e-3, -0.15, 0.02]);
            Camera::Cahvor(model.unwrap())
        };
        for _ in 0..100 {
            let pixel = Point2::new(rng.random_range(0.0..1023.0), rng.random_range(0.0..767.0));
            let ray = camera.ray(&pixel).expect("the lens holds over the image");
            let far = ray.origin + ray.direction.into_inner() * rng.random_range(0.1..30.0);
            let back = camera.project(&far).unwrap();
            assert!((back - pixel).norm() < 1e-6, "{pixel} {back}");
        }
    }
}

#[test]
fn where_a_lens_model_folds_over_there_is_no_answer() {
    // r (1 - 0.5 r²) grows until r² = 2/3: beyond, two directions would share a pixel.
    let lens = Brown { k1: -0.5, ..Brown::default() };
    let camera = pinhole(lens, Isometry3::identity());
    let edge = (2.0_f64 / 3.0).sqrt();
    assert!(camera.project(&Point3::new(edge - 1e-3, 0.0, 1.0)).is_some());
    assert_eq!(camera.project(&Point3::new(edge + 1e-3, 0.0, 1.0)), None);
    let farthest = 620.0 * edge * 2.0 / 3.0 + 526.0;
    assert!(camera.ray(&Point2::new(farthest - 0.5, 374.0)).is_some());
    assert_eq!(camera.ray(&Point2::new(farthest + 0.5, 374.0)), None);
    assert_eq!(camera.project(&Point3::new(0.0, 0.0, -1.0)), None, "behind");
    assert_eq!(camera.ray(&Point2::new(f64::NAN, 0.0)), None);
    assert_eq!(camera.project(&Point3::new(f64::NAN, 0.0, 1.0)), None);
}

#[test]
fn a_moved_turned_scaled_and_resized_camera_sees_what_it_should() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let pose = random_pose(&mut rng);
    let vectors = cahv(&pose, [620.0, 622.0], [526.0, 374.0]);
    let model = Cahvor::new(size(1024, 768), vectors, vectors[1], [0.0, -0.1, 0.0]).unwrap();
    for camera in [pinhole(LENS, pose), Camera::Cahvor(model)] {
        let pixel = Point2::new(200.0, 600.0);
        let ray = camera.ray(&pixel).unwrap();
        let seen = ray.origin + 2.0 * ray.direction.into_inner();
        let motion = random_pose(&mut rng);
        let again = camera.moved(&motion).project(&(motion * seen)).unwrap();
        assert!((again - pixel).norm() < 1e-6);
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.1);
        let turned = camera.turned(&turn);
        assert!((turned.center() - camera.center()).norm() < 1e-12);
        assert!(turned.ray(&pixel).unwrap().direction.angle(&(turn * ray.direction)) < 1e-7);
        let third = camera.scaled(1.0 / 3.0);
        let seen_third = Point3::from(seen.coords / 3.0);
        assert!((third.project(&seen_third).unwrap() - pixel).norm() < 1e-6);
        // The middle of a pixel block of 2 x 2 is the middle of a pixel at half the size.
        let half = camera.resized(size(512, 384)).unwrap();
        let at = half.project(&seen).unwrap();
        assert!((at - Point2::new(99.75, 299.75)).norm() < 1e-6, "{at}");
    }
}

#[test]
fn bad_cameras_and_images_are_named() {
    let make = |focal, principal, lens| {
        Pinhole::new(size(640, 480), focal, principal, lens, Isometry3::identity())
    };
    let fine = Brown::default();
    assert!(make([500.0; 2], [320.0, 240.0], fine).is_ok());
    let error = make([0.0, 500.0], [320.0, 240.0], fine).unwrap_err();
    assert!(matches!(error, StereoError::OutOfRange { ref field, .. } if field == "fx"), "{error}");
    let error = make([500.0; 2], [700.0, 240.0], fine).unwrap_err();
    assert!(error.to_string().contains("another image size"), "{error}");
    assert!(make([500.0; 2], [320.0, 240.0], Brown { k2: f64::NAN, ..fine }).is_err());
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    let flat = [Vector3::zeros(), z, x * 500.0 + z * 320.0, x * 500.0 + z * 240.0 + y];
    assert_eq!(Cahvor::cahv(size(640, 480), flat), Err(StereoError::FlatModel));
    let long = [Vector3::zeros(), z * 2.0, x * 500.0 + z * 320.0, y * 500.0 + z * 240.0];
    let error = Cahvor::cahv(size(640, 480), long).unwrap_err();
    assert!(matches!(error, StereoError::NotAUnitVector { .. }), "{error}");
    assert!(ImageSize::new(8, 100).is_err() && ImageSize::new(8192, 8192).is_err());
    let image = GrayImage::new(size(64, 48), vec![0; 64 * 48]).unwrap();
    let camera = Camera::Pinhole(make([500.0; 2], [320.0, 240.0], fine).unwrap());
    let error = camera.check_image("left image", &image).unwrap_err();
    assert!(error.to_string().contains("640 x 480") && error.to_string().contains("64 x 48"));
    assert!(GrayImage::new(size(64, 48), vec![0; 64 * 47]).is_err());
    assert!(GrayImage::from_rgb(size(64, 48), &[0; 64 * 48]).is_err());
}

#[test]
fn gray_of_equal_channels_is_their_value() {
    let rgb: Vec<u8> = (0..16 * 16).flat_map(|i| [i as u8; 3]).collect();
    let gray = GrayImage::from_rgb(size(16, 16), &rgb).unwrap();
    assert!(gray.pixels().iter().enumerate().all(|(i, v)| *v == i as u8));
}
