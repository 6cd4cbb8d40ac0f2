//! Triangulated points against the plane they were drawn from, and their covariance against chance.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::StereoError;
use stereo::matching::Matching;
use stereo::pair::{PairOptions, reconstruct};
use stereo::rectification::RectifiedGeometry;
use stereo::surface::{TriangulateOptions, ground_plane, triangulate_pixel};

use crate::camera::size;
use crate::matching::{never, texture};
use crate::rectification::{cameras, k10, see_plane};

fn geometry() -> RectifiedGeometry {
    let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
    RectifiedGeometry {
        size: size(640, 480),
        focal: 600.0,
        principal: Point2::new(320.0, 230.0),
        baseline: 0.2,
        frame_from_rectified: Isometry3::from_parts(Vector3::new(1.0, 2.0, 3.0).into(), turn),
    }
}

/// About normal, from the sum of twelve.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

#[test]
fn depth_noise_is_what_the_formula_of_the_field_says() {
    let options = TriangulateOptions { sigma_disparity: 0.3, ..TriangulateOptions::default() };
    for (z, sigma) in [(2.0, 0.010), (4.0, 0.040), (8.0, 0.160)] {
        let geometry = geometry();
        let at = [320.0, 230.0];
        let (p, covariance) = triangulate_pixel(&geometry, at, 600.0 * 0.2 / z, &options);
        let back = geometry.frame_from_rectified.inverse_transform_point(&p);
        assert!((back - Point3::new(0.0, 0.0, z)).norm() < 1e-12);
        let look = geometry.frame_from_rectified * Vector3::z();
        let along = look.dot(&(covariance * look)).sqrt();
        assert!((along - sigma).abs() < 1e-9, "{along}");
    }
}

#[test]
fn a_covariance_is_the_spread_of_points_of_noisy_pixels() {
    let geometry = geometry();
    let options = TriangulateOptions::default();
    let (at, d) = ([500.0, 100.0], 40.0);
    let (mean, covariance) = triangulate_pixel(&geometry, at, d, &options);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let n = 40_000;
    let mut spread = Matrix3::zeros();
    for _ in 0..n {
        let mut noisy = |value: f64, sigma: f64| value + sigma * normal(&mut rng);
        let pixel = [noisy(at[0], options.sigma_pixel), noisy(at[1], options.sigma_pixel)];
        let (p, _) =
            triangulate_pixel(&geometry, pixel, noisy(d, options.sigma_disparity), &options);
        spread += (p - mean) * (p - mean).transpose() / f64::from(n);
    }
    let off = (spread - covariance).norm() / covariance.norm();
    assert!(off < 0.03, "{off}");
    // The inverse of the projection.
    let (pixel, disparity) = geometry.project(&mean).unwrap();
    assert!((pixel - Point2::from(at)).norm() < 1e-9 && (disparity - d).abs() < 1e-9);
}

#[test]
fn a_plane_seen_by_two_distorted_cameras_is_where_it_is() {
    let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
    let frame = Isometry3::from_parts(Vector3::new(3.0, -2.0, 0.7).into(), turn);
    let [left, right] = cameras(size(480, 360), &frame);
    let texture = texture(7);
    let at = Point3::new(0.0, 0.0, 2.5);
    let across = Vector3::new(0.1, -0.5, -1.0).normalize();
    let see = |camera| see_plane(camera, &frame, at, across, &|x, y| texture(1.5 * x, 1.5 * y));
    let images = [see(&left), see(&right)];
    let options = PairOptions {
        matching: Matching { disparities: 64, ..Matching::default() },
        ..PairOptions::default()
    };
    let cameras = [&left, &right];
    let found = reconstruct(cameras, [&images[0], &images[1]], &options, &never).unwrap();
    let (expected, offset) = (frame * across, (frame * across).dot(&(frame * at).coords));
    let mut misses: Vec<f64> = Vec::new();
    let mut squares = 0.0;
    for point in &found.surface.points {
        let miss = expected.dot(&point.position.coords) - offset;
        let variance = expected.dot(&(point.covariance * expected));
        misses.push(miss.abs());
        squares += miss * miss / variance;
    }
    misses.sort_unstable_by(f64::total_cmp);
    let (middle, most) = (misses[misses.len() / 2], misses[misses.len() * 99 / 100]);
    let normalized = (squares / misses.len() as f64).sqrt();
    let health = found.health;
    println!(
        "plane: {} points, median {middle:.4} m, 99 % {most:.4} m, z/sigma {normalized:.2}, {health:?}",
        misses.len()
    );
    // At 2.5 m, f = 398 px, b = 0.21 m an eighth of a pixel is 9 mm.
    assert!(health.fill > 0.7 && middle < 0.010 && most < 0.04);
    assert!(normalized < 1.0, "noise-free images are better than the assumed 0.3 px");
    let plane = health.ground.unwrap();
    assert!(plane.normal.angle(&expected) < 0.01 && (plane.offset - offset).abs() < 0.01);
    assert!(plane.residual < 0.012 && plane.inlier_share > 0.8);
    // Seen from another frame the plane moves along.
    let motion = frame.inverse();
    let moved = ground_plane(&found.surface.moved(&motion)).unwrap();
    assert!(moved.normal.angle(&across) < 0.01 && (moved.residual - plane.residual).abs() < 1e-3);
    // Ranges are kept.
    let triangulate = TriangulateOptions { range: [2.4, 2.6], ..TriangulateOptions::default() };
    let near = PairOptions { triangulate, ..options.clone() };
    let near = reconstruct(cameras, [&images[0], &images[1]], &near, &never).unwrap();
    assert!(near.surface.points.len() < found.surface.points.len());
    for point in &near.surface.points {
        let z =
            near.surface.geometry.frame_from_rectified.inverse_transform_point(&point.position).z;
        assert!((2.4..=2.6).contains(&z));
    }
    let wrong = TriangulateOptions { sigma_disparity: 0.0, ..TriangulateOptions::default() };
    let wrong = PairOptions { triangulate: wrong, ..options.clone() };
    let error = reconstruct(cameras, [&images[0], &images[1]], &wrong, &never).map(|_| ());
    assert!(matches!(error, Err(StereoError::OutOfRange { .. })));
    let stopped = reconstruct(cameras, [&images[0], &images[1]], &options, &|| true).map(|_| ());
    assert_eq!(stopped, Err(StereoError::Stopped));
}

#[test]
fn the_k10_rover_sees_the_ground_it_stands_on() {
    let Some((cameras, images)) = k10() else { return };
    let options = PairOptions {
        triangulate: TriangulateOptions { range: [1.0, 4.0], ..TriangulateOptions::default() },
        ..PairOptions::default()
    };
    let found = reconstruct([&cameras[0], &cameras[1]], [&images[0], &images[1]], &options, &never);
    let found = found.unwrap();
    let health = found.health;
    let plane = health.ground.unwrap();
    let (fill, residual) = (health.fill, plane.residual);
    let up = -plane.normal.z;
    // Height of the ground below the left camera's place over the world's origin: z is down.
    let z = (plane.offset - plane.normal.x * 1.5) / plane.normal.z;
    println!(
        "k10: fill {fill:.2}, {} points, residual {residual:.4} m, z {z:.3} m, tilt {:.1} deg, {plane:?}",
        found.surface.points.len(),
        up.acos().to_degrees()
    );
    // The data's description: 49 % of the image filled, 2.6 cm, ground at z = -0.07 m.
    assert!(fill > 0.49 && residual < 0.035, "{fill} {residual}");
    assert!(up > 0.998 && (z + 0.07).abs() < 0.06, "{up} {z}");
}
