//! Rendered images and their truth against closed forms.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use stereo::StereoError;
use stereo::camera::{Brown, Camera, Pinhole};
use stereo::ray::RayScene;
use stereo::rectification::{Rectification, RectifyOptions};
use stereo::render::{
    CalibrationErrors, Light, RenderOptions, Sensor, Texture, pair_truth, render, truth,
};
use terrain::ElevationMap;

use crate::camera::size;
use crate::matching::never;
use crate::ray::{athlete, standing};

/// A camera at a height over the origin that looks straight down, its rows along x.
fn looking_down(x: f64, height: f64) -> Camera {
    let matrix = Matrix3::from_columns(&[Vector3::x(), -Vector3::y(), -Vector3::z()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let pose = Isometry3::from_parts(Vector3::new(x, 0.0, height).into(), rotation);
    let camera = Pinhole::new(size(96, 64), [80.0; 2], [47.5, 31.5], Brown::default(), pose);
    Camera::Pinhole(camera.unwrap())
}

fn plain() -> RenderOptions {
    RenderOptions { texture: None, sensor: None, rays: 1, ..RenderOptions::default() }
}

#[test]
fn an_even_plane_has_the_light_of_lambert() {
    let map = ElevationMap::plane(5.0, 0.1).unwrap();
    let scene = RayScene::new(Some(&map), None);
    for elevation in [0.2_f64, 0.7, 1.5] {
        let sun = Vector3::new(elevation.cos(), 0.0, elevation.sin()) * 7.0;
        let light = Light { sun, ambient: 0.0, shadows: true };
        let options = RenderOptions { light, ..plain() };
        let image = render(&scene, &looking_down(0.0, 3.0), &options, 0, &never).unwrap();
        let expected = (256.0 * 0.45 * elevation.sin()).round() as u8;
        assert!(image.pixels().iter().all(|v| *v == expected), "{} {expected}", image.at(5, 5));
    }
    let up = Light { sun: -Vector3::z(), ambient: 0.1, shadows: true };
    let options = RenderOptions { light: up, ..plain() };
    let night = render(&scene, &looking_down(0.0, 3.0), &options, 0, &never).unwrap();
    assert_eq!(night.at(10, 10), 12, "0.1 of 115");
}

#[test]
fn the_robot_casts_a_shadow_where_the_sun_is_behind_it() {
    let robot = athlete();
    let (_, posture) = standing(&robot);
    let map = ElevationMap::plane(6.0, 0.1).unwrap();
    let scene = RayScene::new(Some(&map), Some((&robot, &posture)));
    let sun = Vector3::new(0.7, 0.2, 0.9);
    let light = Light { sun, ambient: 0.0, shadows: true };
    let options = RenderOptions { light, ..plain() };
    let camera = looking_down(0.0, 8.0);
    let truth = truth(&scene, &camera, &options, &never).unwrap();
    let image = render(&scene, &camera, &options, 0, &never).unwrap();
    let robot_only = RayScene::new(None, Some((&robot, &posture)));
    let (mut n_shadow, mut n_robot) = (0, 0);
    for i in 0..truth.size.len() {
        let (x, y) = (i % 96, i / 96);
        if truth.link[i].is_some() {
            n_robot += 1;
            assert!(truth.depth[i] < 8.0);
            continue;
        }
        assert!((truth.depth[i] - 8.0).abs() < 1e-5, "the plane is at depth 8 everywhere");
        let ray = camera.ray(&nalgebra::Point2::new(x as f64, y as f64)).unwrap();
        let at = ray.origin + ray.direction.into_inner() * (8.0 / -ray.direction.z);
        let shaded = robot_only.is_blocked(&at, &sun.normalize(), 50.0);
        assert_eq!(truth.lit[i], !shaded, "({x}, {y})");
        n_shadow += usize::from(shaded);
        assert_eq!(image.pixels()[i] == 0, shaded);
    }
    assert!(n_shadow > 100 && n_robot > 100, "{n_shadow} {n_robot}");
    let light = Light { shadows: false, ..options.light.clone() };
    let open = RenderOptions { light, ..options };
    let open = render(&scene, &camera, &open, 0, &never).unwrap();
    assert!(open.pixels().iter().filter(|v| **v == 0).count() < 100, "without shadows");
}

#[test]
fn noise_is_seeded_and_as_large_as_it_should_be_and_threads_change_no_bit() {
    let map = ElevationMap::plane(5.0, 0.1).unwrap();
    let scene = RayScene::new(Some(&map), None);
    let camera = looking_down(0.0, 3.0);
    let sensor =
        Sensor { point_spread: 0.0, vignetting: 0.0, full_well: 20_000.0, read_noise: 2.0 };
    let light = Light { sun: Vector3::z(), ambient: 0.0, shadows: true };
    let options = RenderOptions { sensor: Some(sensor), light, ..plain() };
    let of = |seed, threads| {
        render(&scene, &camera, &RenderOptions { threads, ..options.clone() }, seed, &never)
            .unwrap()
    };
    let image = of(1, 1);
    assert_eq!(of(1, 3), image);
    assert_ne!(of(2, 1), image);
    let n = image.pixels().len() as f64;
    let mean = image.pixels().iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let squares = image.pixels().iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>();
    // Read noise 2, shot noise of 115.2 levels of 78.4 electrons, quantization 1/12.
    let expected = 4.0 + 115.2 * 255.0 / 20_000.0 + 1.0 / 12.0;
    assert!((mean - 115.2).abs() < 0.15, "{mean}");
    assert!((squares / n / expected - 1.0).abs() < 0.06, "{} {expected}", squares / n);
    let dim = Sensor { vignetting: 0.5, full_well: 0.0, read_noise: 0.0, ..sensor };
    let options = RenderOptions { sensor: Some(dim), ..options.clone() };
    let dim = render(&scene, &camera, &options, 1, &never).unwrap();
    assert_eq!((dim.at(0, 0), dim.at(48, 32)), (58, 115));
    let texture = Some(Texture { octaves: 0, ..Texture::default() });
    for wrong in [
        RenderOptions { rays: 5, ..options.clone() },
        RenderOptions { texture, ..options.clone() },
        RenderOptions { sensor: Some(Sensor { read_noise: -1.0, ..sensor }), ..options.clone() },
        RenderOptions {
            light: Light { sun: Vector3::zeros(), ..Light::default() },
            ..options.clone()
        },
    ] {
        let error = render(&scene, &camera, &wrong, 1, &never).unwrap_err();
        assert!(matches!(error, StereoError::OutOfRange { .. }), "{error}");
    }
    let stopped = render(&scene, &camera, &options, 1, &|| true);
    assert_eq!(stopped, Err(StereoError::Stopped));
}

#[test]
fn the_truth_of_a_pair_over_a_plane_is_one_disparity() {
    let map = ElevationMap::plane(5.0, 0.1).unwrap();
    let scene = RayScene::new(Some(&map), None);
    let (left, right) = (looking_down(0.0, 2.0), looking_down(0.3, 2.0));
    let rectification = Rectification::new(&left, &right, &RectifyOptions::default()).unwrap();
    let truth = pair_truth(&scene, rectification.geometry(), &plain(), &never).unwrap();
    // 80 px · 0.3 m / 2 m.
    for (i, d) in truth.disparity.iter().enumerate() {
        assert!((d - 12.0).abs() < 1e-4, "{d}");
        assert_eq!(truth.occluded[i], i % 96 < 12, "the right camera's image begins there");
    }
}

#[test]
fn a_misfit_pair_is_off_by_what_was_asked() {
    let pair = [&looking_down(0.0, 2.0), &looking_down(0.3, 2.0)];
    let none =
        CalibrationErrors { intrinsics_px: 0.0, relative_rad: 0.0, pair: 0.0, pair_rad: 0.0 };
    let same = none.actual(pair, 1).unwrap();
    assert!((same[1].center() - pair[1].center()).norm() < 1e-12);
    let errors = CalibrationErrors { relative_rad: 1e-3, ..none };
    let n = 400;
    let (mut squares, mut focal, mut shift) = (0.0, 0.0, 0.0);
    for seed in 0..n {
        let [left, right] = errors.actual(pair, seed).unwrap();
        assert!(left.axes().angle_to(&pair[0].axes()) < 1e-9);
        assert!((right.center() - pair[1].center()).norm() < 1e-12);
        squares += right.axes().angle_to(&pair[1].axes()).powi(2) / n as f64;
        let lens = CalibrationErrors { intrinsics_px: 0.2, ..none }.actual(pair, seed).unwrap();
        focal += (lens[0].focal()[0] - 80.0).powi(2) / n as f64;
        let moved = CalibrationErrors { pair: 0.01, ..none }.actual(pair, seed).unwrap();
        let by = moved.clone().map(|camera| camera.center());
        assert!(((by[1] - by[0]) - Vector3::new(0.3, 0.0, 0.0)).norm() < 1e-9, "both move");
        shift += (by[0] - pair[0].center()).norm_squared() / n as f64;
    }
    // Three axes of 1 mrad and of 1 cm; one focal length.
    assert!((squares.sqrt() / 3.0_f64.sqrt() / 1e-3 - 1.0).abs() < 0.1, "{squares}");
    assert!((shift.sqrt() / 3.0_f64.sqrt() / 0.01 - 1.0).abs() < 0.1, "{shift}");
    assert!((focal.sqrt() / 0.2 - 1.0).abs() < 0.15, "{focal}");
    assert_eq!(errors.actual(pair, 5).unwrap(), errors.actual(pair, 5).unwrap());
    assert!(CalibrationErrors { relative_rad: 1.0, ..none }.actual(pair, 1).is_err());
}
