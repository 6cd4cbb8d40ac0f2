//! The matcher against truth, against a matcher written from the definition, and its invariants.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::matching::{Matching, Refinement, match_rectified, refine};
use stereo::{GrayImage, ImageSize, StereoError};

use crate::camera::size;
use crate::images::{gray, npz_f32};

/// Shares (%) of visible pixels with truth: invalid of all; off by more than 2 and 1 px of the valid;
/// and the root mean square error (px) of those within 5 px.
pub struct Quality {
    pub invalid: f64,
    pub bad_2: f64,
    pub bad_1: f64,
    pub rms: f64,
}

/// Pixels count that the right image shows too: no nearer surface covers them there.
pub fn quality(size: ImageSize, truth: &[f32], found: &[f32]) -> Quality {
    let width = size.width;
    let (mut n, mut invalid, mut bad_2, mut bad_1) = (0.0, 0.0, 0.0, 0.0);
    let (mut squares, mut n_close) = (0.0, 0.0);
    for (truth, found) in truth.chunks_exact(width).zip(found.chunks_exact(width)) {
        let mut nearest = vec![f32::NEG_INFINITY; width];
        let target = |x: usize, d: f32| {
            let at = x as f32 - d;
            (d.is_finite() && at >= 0.0).then(|| at.round() as usize)
        };
        for (x, d) in truth.iter().enumerate() {
            if let Some(at) = target(x, *d) {
                nearest[at] = nearest[at].max(*d);
            }
        }
        for (x, d) in truth.iter().enumerate() {
            let Some(at) = target(x, *d) else { continue };
            if nearest[at] - d > 1.0 {
                continue;
            }
            n += 1.0;
            let miss = f64::from((found[x] - d).abs());
            if found[x].is_nan() {
                invalid += 1.0;
                continue;
            }
            bad_2 += f64::from(u8::from(miss > 2.0));
            bad_1 += f64::from(u8::from(miss > 1.0));
            if miss < 5.0 {
                squares += miss * miss;
                n_close += 1.0;
            }
        }
    }
    let valid = n - invalid;
    Quality {
        invalid: 100.0 * invalid / n,
        bad_2: 100.0 * bad_2 / valid,
        bad_1: 100.0 * bad_1 / valid,
        rms: (squares / n_close).sqrt(),
    }
}

pub fn never() -> bool {
    false
}

#[test]
fn the_motorcycle_meets_its_gate() {
    let folder = "middlebury_motorcycle/motorcycle";
    let (Some(left), Some(right), Some(truth)) = (
        gray("motorcycle", &format!("{folder}_left.png")),
        gray("motorcycle", &format!("{folder}_right.png")),
        npz_f32("motorcycle", &format!("{folder}_disp.npz")),
    ) else {
        return;
    };
    let how = Matching { disparities: 64, ..Matching::default() };
    let disparity = match_rectified(&left, &right, &how, &never).unwrap();
    let q = quality(left.size(), &truth, &disparity.values());
    let Quality { invalid, bad_2, bad_1, rms } = q;
    println!(
        "motorcycle: invalid {invalid:.2} %, bad-2 {bad_2:.2} %, bad-1 {bad_1:.2} %, rms {rms:.3} px"
    );
    assert!(invalid <= 6.0, "{invalid}");
    assert!(bad_2 <= 3.7, "{bad_2}");
    assert!(rms <= 0.52, "{rms}");
    let mut finer = disparity.clone();
    refine(&left, &right, &mut finer, &Refinement::default(), 1, &never).unwrap();
    let f = quality(left.size(), &truth, &finer.values());
    println!("  refined: bad-2 {:.2} %, bad-1 {:.2} %, rms {:.3} px", f.bad_2, f.bad_1, f.rms);
    assert!(f.invalid == invalid && f.bad_2 <= bad_2 + 0.1 && f.bad_1 < bad_1 && f.rms < rms);
    // A matcher that gave the left image for the right one would have no disparity at all.
    let same = match_rectified(&left, &left, &how, &never).unwrap();
    assert!(quality(left.size(), &truth, &same.values()).bad_2 > 99.0);
}

#[test]
fn refined_disparities_do_not_lag_behind_ground_that_comes_nearer() {
    let (size, texture) = (size(320, 240), texture(3));
    // Ground below the cameras: the disparity grows from row to row, and the right camera is brighter.
    let truth = |y: f64| 8.0 + 0.2 * y;
    let left = image(size, |x, y| texture(x, 2.0 * y));
    let right = image(size, |x, y| 0.97 * texture(x + truth(y), 2.0 * y) + 9.0);
    let how = Matching { disparities: 64, ..Matching::default() };
    let coarse = match_rectified(&left, &right, &how, &never).unwrap();
    let refined = |threads: usize| {
        let mut finer = coarse.clone();
        refine(&left, &right, &mut finer, &Refinement::default(), threads, &never).unwrap();
        finer
    };
    let finer = refined(1);
    assert_eq!(finer, refined(3), "threads change no bit");
    let miss = |found: &stereo::matching::Disparity| {
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for y in 8..232 {
            for x in 70..310 {
                if let Some(d) = found.at(x, y) {
                    let miss = f64::from(d) - truth(y as f64);
                    (n, sum, squares) = (n + 1.0, sum + miss, squares + miss * miss);
                }
            }
        }
        assert!(n > 0.9 * 224.0 * 240.0);
        (sum / n, f64::sqrt(squares / n))
    };
    let (before, after) = (miss(&coarse), miss(&finer));
    println!("bias and rms (px): {before:.3?}, refined {after:.3?}");
    assert!(before.0.abs() > 0.05, "there is something to mend: {before:?}");
    assert!(after.0.abs() < 0.01 && after.1 < 0.06, "{after:?}");
    let mut same = coarse.clone();
    let none = Refinement { rounds: 0, ..Refinement::default() };
    refine(&left, &right, &mut same, &none, 1, &never).unwrap();
    assert_eq!(same, coarse);
    let wide = Refinement { half: 99, ..none };
    let refused = refine(&left, &right, &mut same, &wide, 1, &never).unwrap_err();
    assert!(refused.to_string().contains("half is 99"), "{refused}");
}

/// Smooth texture of two octaves over a plane, from noise on a lattice.
pub fn texture(seed: u64) -> impl Fn(f64, f64) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let n = 512;
    let lattice: Vec<f64> = (0..n * n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let octave = move |x: f64, y: f64| {
        let (ix, iy) = (x.floor(), y.floor());
        let ease = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (ease(x - ix), ease(y - iy));
        let wrap = |i: f64| i.rem_euclid(n as f64) as usize;
        let at = |dx: f64, dy: f64| lattice[wrap(iy + dy) * n + wrap(ix + dx)];
        let row = |dy: f64| at(0.0, dy) * (1.0 - u) + at(1.0, dy) * u;
        row(0.0) * (1.0 - v) + row(1.0) * v
    };
    move |x, y| 128.0 + 60.0 * octave(x / 3.0, y / 3.0) + 40.0 * octave(x / 9.0 + 17.0, y / 9.0)
}

fn image(size: ImageSize, value: impl Fn(f64, f64) -> f64) -> GrayImage {
    let at = |i: usize| value((i % size.width) as f64, (i / size.width) as f64);
    let pixels = (0..size.len()).map(|i| at(i).round().clamp(0.0, 255.0) as u8).collect();
    GrayImage::new(size, pixels).unwrap()
}

#[test]
fn a_slanted_plane_is_found_to_a_fraction_of_a_pixel() {
    let (size, texture) = (size(320, 200), texture(1));
    // The left image is the texture; the right one shows at x what the left one shows at x + d.
    let (d0, slope) = (20.3, 0.05);
    let left = image(size, &texture);
    // x_r = x - d0 - slope x, hence x = (x_r + d0) / (1 - slope).
    let right = image(size, |x, y| texture((x + d0) / (1.0 - slope), y));
    let how = Matching { disparities: 64, ..Matching::default() };
    let disparity = match_rectified(&left, &right, &how, &never).unwrap();
    let (mut n, mut squares, mut sum) = (0.0, 0.0, 0.0);
    for y in 0..200 {
        for x in 60..320 {
            if let Some(d) = disparity.at(x, y) {
                let miss = f64::from(d) - d0 - slope * x as f64;
                (n, squares, sum) = (n + 1.0, squares + miss * miss, sum + miss);
            }
        }
    }
    let (fill, rms, bias) = (n / (200.0 * 260.0), f64::sqrt(squares / n), sum / n);
    println!("slanted plane: fill {fill:.3}, rms {rms:.3} px, bias {bias:.3} px");
    assert!(fill > 0.97 && rms < 0.2 && bias.abs() < 0.03);
}

#[test]
fn threads_and_bands_change_no_bit() {
    let (size, texture) = (size(200, 600), texture(2));
    let left = image(size, &texture);
    let right = image(size, |x, y| texture(x + 12.0 + 4.0 * (y / 40.0).sin(), y));
    let matched = |threads| {
        let how = Matching { disparities: 32, threads, ..Matching::default() };
        match_rectified(&left, &right, &how, &never).unwrap()
    };
    let one = matched(1);
    assert!(one.fill() > 0.8, "{}", one.fill());
    for threads in [2, 3, 7] {
        assert_eq!(matched(threads), one);
    }
}

#[test]
fn the_disparity_range_is_kept_and_more_of_it_changes_little() {
    let (size, texture) = (size(240, 120), texture(3));
    let left = image(size, &texture);
    let right = image(size, |x, y| texture(x + 17.0, y));
    let matched = |disparities| {
        let how = Matching { disparities, ..Matching::default() };
        match_rectified(&left, &right, &how, &never).unwrap()
    };
    // 17 px lie within 20 disparities and not within 15.
    assert!(matched(15).values().iter().all(|d| d.is_nan() || *d < 15.0));
    assert!(matched(15).fill() < 0.2, "{}", matched(15).fill());
    for disparities in [20, 64, 96, 128] {
        let found = matched(disparities);
        let right_ones = found.values().iter().filter(|d| (**d - 17.0).abs() < 0.5).count();
        assert!(right_ones as f64 > 0.9 * (240.0 - 17.0) * 120.0, "{disparities}: {right_ones}");
    }
}

#[test]
fn noise_black_images_and_deep_shadow_stay_holes() {
    let size = size(200, 120);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut noise =
        || GrayImage::new(size, (0..size.len()).map(|_| rng.random()).collect()).unwrap();
    let (a, b) = (noise(), noise());
    let how = Matching { disparities: 64, ..Matching::default() };
    let fill = match_rectified(&a, &b, &how, &never).unwrap().fill();
    println!("two images of noise: fill {fill:.4}");
    assert!(fill < 0.05, "unrelated images: {fill}");
    let black = GrayImage::new(size, vec![0; size.len()]).unwrap();
    assert_eq!(match_rectified(&black, &black, &how, &never).unwrap().fill(), 0.0);
    let gray = GrayImage::new(size, vec![100; size.len()]).unwrap();
    assert_eq!(match_rectified(&gray, &gray, &how, &never).unwrap().fill(), 0.0);
}

#[test]
fn the_hard_shadows_of_the_rendered_boulders_stay_holes() {
    for name in ["", "3"] {
        let (Some(left), Some(right)) = (
            gray("shadows", &format!("asp_synthetic_rocks/left{name}.png")),
            gray("shadows", &format!("asp_synthetic_rocks/right{name}.png")),
        ) else {
            return;
        };
        let found = match_rectified(&left, &right, &Matching::default(), &never).unwrap();
        let values = found.values();
        let dark: Vec<usize> = (0..values.len()).filter(|i| left.pixels()[*i] < 8).collect();
        let valid = dark.iter().filter(|i| !values[**i].is_nan()).count();
        let share = valid as f64 / dark.len().max(1) as f64;
        println!(
            "boulders{name}: {} dark pixels, valid {share:.4}; fill {:.3}",
            dark.len(),
            found.fill()
        );
        assert!(share < 0.001, "{share}");
    }
}

#[test]
fn what_cannot_be_matched_is_named_and_work_can_be_stopped() {
    let image = GrayImage::new(size(64, 48), vec![9; 64 * 48]).unwrap();
    let wide = GrayImage::new(size(80, 48), vec![9; 80 * 48]).unwrap();
    let error = match_rectified(&image, &wide, &Matching::default(), &never).unwrap_err();
    assert!(error.to_string().contains("80 x 48"), "{error}");
    let wrong = |how: Matching| match_rectified(&image, &image, &how, &never).unwrap_err();
    let fine = Matching::default();
    for how in [
        Matching { disparities: 0, ..fine.clone() },
        Matching { disparities: 129, ..fine.clone() },
        Matching { p1: 0, ..fine.clone() },
        Matching { p2: 41, ..fine.clone() },
        Matching { p2_edge: 2, ..fine.clone() },
        Matching { threads: 0, ..fine.clone() },
        Matching { uniqueness_percent: 101, ..fine.clone() },
        Matching { speckle_step: f32::NAN, ..fine.clone() },
    ] {
        assert!(matches!(wrong(how), StereoError::OutOfRange { .. }));
    }
    let stopped = match_rectified(&image, &image, &fine, &|| true);
    assert_eq!(stopped, Err(StereoError::Stopped));
}
