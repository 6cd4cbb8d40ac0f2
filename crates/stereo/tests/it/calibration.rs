//! Calibration files of other programs, and the mistakes in them.

use nalgebra::{Point2, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::StereoError;
use stereo::calibration::{read_cahvor, read_middlebury, read_opencv, read_opencv_pair, read_tsai};
use stereo::camera::Camera;
use testkit::shared_data;

use crate::camera::size;

fn k10(side: &str) -> Option<Camera> {
    let bytes = shared_data("calibration", &format!("k10_stereo/black_{side}.tsai"))?;
    Some(read_tsai(std::str::from_utf8(&bytes).unwrap(), size(1024, 768)).unwrap())
}

#[test]
fn the_models_of_the_k10_rover_look_ahead_and_down_at_the_ground() {
    let (Some(left), Some(right)) = (k10("left"), k10("right")) else { return };
    // World of the files: x forward, y right, z down.
    let baseline = right.center() - left.center();
    assert!((baseline.norm() - 0.1058).abs() < 1e-4);
    assert!(baseline.y > 0.1, "the right camera is to the right");
    for camera in [left, right] {
        let forward = camera.axes() * Vector3::z();
        assert!(forward.x > 0.9 && forward.z > 0.3, "{forward}");
        assert!((camera.axes() * Vector3::x()).y > 0.99);
        for (x, y) in [(0.0, 0.0), (1023.0, 0.0), (512.0, 384.0), (1023.0, 767.0)] {
            let pixel = Point2::new(x, y);
            let ray = camera.ray(&pixel).unwrap();
            let back = camera.project(&(ray.origin + 4.0 * ray.direction.into_inner())).unwrap();
            assert!((back - pixel).norm() < 1e-6);
        }
    }
}

const TSAI: &str = "fu = 620\nfv = 622\ncu = 526\ncv = 374\nu_direction = 1 0 0\n\
    v_direction = 0 1 0\nw_direction = 0 0 1\nC = 1 2 3\nR = 0 0 1 -1 0 0 0 -1 0\n\
    k1 = -0.3\nk2 = 0.1\np1 = 0\np2 = 0\n";

#[test]
fn a_tsai_model_of_each_version_is_read() {
    let old = read_tsai(TSAI, size(1024, 768)).unwrap();
    assert_eq!(old.center(), Point3::new(1.0, 2.0, 3.0));
    assert!((old.axes() * Vector3::z() - Vector3::x()).norm() < 1e-9, "it looks along x");
    // The same camera with lengths on the sensor in millimeters.
    let new = "VERSION_4\nPINHOLE\nfu = 3.1\nfv = 3.11\ncu = 2.63\ncv = 1.87\nu_direction = 1 0 0\n\
        v_direction = 0 1 0\nw_direction = 0 0 1\nC = 1 2 3\nR = 0 0 1 -1 0 0 0 -1 0\n\
        pitch = 0.005\nTSAI\nk1 = -0.3\nk2 = 0.1\np1 = 0\np2 = 0\n";
    let new = read_tsai(new, size(1024, 768)).unwrap();
    let pixel = Point2::new(100.0, 50.0);
    assert!(old.ray(&pixel).unwrap().direction.angle(&new.ray(&pixel).unwrap().direction) < 1e-7);
}

#[test]
fn mistakes_in_a_tsai_model_are_named() {
    let wrong = |from: &str, to: &str| {
        read_tsai(&TSAI.replace(from, to), size(1024, 768)).unwrap_err().to_string()
    };
    assert!(wrong("R = 0 0 1", "R = 0 0 1.01").contains("R is no rotation"));
    assert!(wrong("R = 0 0 1", "R = 0 0 -1").contains("det R is -1.0000"), "a mirror");
    assert!(wrong("R = 0 0 1", "R = 0 0 nan").contains("nine numbers"));
    assert!(wrong("fu = 620", "fu = 620 px").contains("line 1"));
    assert!(wrong("cv = 374\n", "").contains("no cv"));
    assert!(wrong("k1 = -0.3\n", "").contains("no k1"));
    assert!(wrong("u_direction = 1", "u_direction = -1").contains("u_direction"));
    assert!(wrong("fu = 620", "VERSION_2\nfu = 620").contains("VERSION_2"));
    let long = format!("{}\nfu = 620", "VERSION_".repeat(9000));
    assert!(wrong("fu = 620", &long).len() < 300, "a message stays short");
    assert!(wrong("k1 = -0.3", "PHOTOMETRIX\nk1 = -0.3").contains("PHOTOMETRIX"));
    let small = read_tsai(TSAI, size(512, 384)).unwrap_err();
    assert!(matches!(small, StereoError::PrincipalPoint { .. }), "{small}");
    let huge = "#".repeat((1 << 20) + 1);
    assert!(matches!(read_tsai(&huge, size(64, 64)), Err(StereoError::TextTooLarge { .. })));
}

const CAHVOR: &str = "Model = CAHVOR = perspective, distortion\nDimensions = 1024 768\n\
    C = 0.1 0.2 0.3\nA = 0 0 1\nH = 620 0 512\nV = 0 622 384\nO = 0 0 1\nR = 0 -0.2 0.05\n";

#[test]
fn a_cahvor_model_is_read_with_and_without_lens() {
    let lens = read_cahvor(CAHVOR, None).unwrap();
    assert_eq!(lens.size(), size(1024, 768));
    // x = 0.5, y = 0 at z = 1: seen at 0.5 (1 - 0.2 · 0.25 + 0.05 · 0.0625) = 0.4765625.
    let seen = lens.project(&Point3::new(0.6, 0.2, 1.3)).unwrap();
    assert!((seen - Point2::new(512.0 + 620.0 * 0.476_562_5, 384.0)).norm() < 1e-9, "{seen}");
    let plain = "C = 0.1 0.2 0.3\nA = 0 0 1\nH = 620 0 512\nV = 0 622 384\n";
    let plain = read_cahvor(plain, Some(size(1024, 768))).unwrap();
    let seen = plain.project(&Point3::new(0.6, 0.2, 1.3)).unwrap();
    assert!((seen - Point2::new(822.0, 384.0)).norm() < 1e-9);
}

#[test]
fn mistakes_in_a_cahvor_model_are_named() {
    let wrong = |from: &str, to: &str| {
        read_cahvor(&CAHVOR.replace(from, to), None).unwrap_err().to_string()
    };
    assert!(wrong("A = 0 0 1", "A = 0 0 1.2").contains("A has length 1.2"));
    assert!(wrong("R = 0 -0.2 0.05", "R = 0 -0.2 0.05\nE = 1 2 3").contains("CAHVORE"));
    assert!(wrong("CAHVOR =", "CAHVORE =").contains("CAHVORE"));
    assert!(wrong("R = 0 -0.2", "R = -1 -0.2").contains("R[0] is -1"), "no pixel has a ray");
    assert!(wrong("R = 0 -0.2 0.05\n", "").contains("no R"));
    assert!(wrong("Dimensions = 1024 768\n", "").contains("size of the image"));
    assert!(wrong("Dimensions = 1024 768", "Dimensions = 1e9 1e9").contains("width and height"));
    let error = read_cahvor(CAHVOR, Some(size(512, 384))).unwrap_err().to_string();
    assert!(error.contains("512 x 384") && error.contains("1024 x 768"), "{error}");
}

/// Of places all over the image that have a ray, those that are not seen where it came from.
fn lost(camera: &Camera) -> Vec<Point2<f64>> {
    let size = camera.size();
    let share = |i: usize, n: usize| i as f64 / 40.0 * (n - 1) as f64;
    let places = (0..=40).flat_map(|i| (0..=40).map(move |j| (i, j)));
    let pixels = places.map(|(i, j)| Point2::new(share(i, size.width), share(j, size.height)));
    let is_lost = |pixel: &Point2<f64>| {
        camera.ray(pixel).is_some_and(|ray| {
            let back = camera.project(&(ray.origin + ray.direction.into_inner()));
            !back.is_some_and(|back| (back - pixel).norm() < 1e-3)
        })
    };
    pixels.filter(is_lost).collect()
}

#[test]
fn a_camera_too_far_from_its_origin_for_its_lens_is_refused() {
    // Lines of V, C and R exchanged and numbers at their ends, as fuzzing found them: each camera saw a
    // point 1 m before it a thousandth of a pixel and more beside where its ray came from.
    let far = [
        "C = 0 -956632.7307880124 384\nA = 0 0 1\nH = -5.338872985652978 0 512\n\
         V = 0 -956632.7307880124 384\nO = 0 0 1\nR = 0 -0.2 0.05\n",
        "C = 0.1 8133474.852872193 0.3\nA = 0 0 1\nH = 2 0 512\nV = 0 446073.6840770689 384\n\
         O = 0 0 1\nR = 0 -0.2 0.05\n",
        "C = 9727041.830281768 0.2 0.3\nA = 0 0 1\nH = 84464 0 512\nV = 0 622 384\nO = 0 0 1\n\
         R = 0 65537 0.05\n",
        "C = 620 368258.1207400967 512\nA = 0 0 1\nH = 620 368258.1207400967 512\nV = 2 16 384\n\
         O = 0 0 1\nR = 0 -0.2 55667\n",
    ];
    for text in far {
        let error = read_cahvor(text, Some(size(1024, 768))).unwrap_err();
        assert!(matches!(error, StereoError::CameraTooFar { .. }), "{error}");
        assert!(error.to_string().contains("nearer origin"), "{error}");
    }
    // What real ones are is taken, and holds all over the image: a rover's camera in a frame of Mars (3396 km), and an
    // orbiter's of 350 000 px.
    for (focal, lens) in [(620.0, "0 -0.2 0.05"), (3e3, "1e-4 -0.02 0.3"), (3.5e5, "0 0 0")] {
        let text = format!(
            "C = 1234567.8 -3162277.6 234567.8\nA = 0 0 1\nH = {focal} 0 512\nV = 0 {focal} 384\nO = 0 0 1\nR = {lens}\n"
        );
        let camera = read_cahvor(&text, Some(size(1024, 768))).unwrap();
        assert_eq!(lost(&camera), [], "{text}");
    }
    let tsai = OLD_TSAI_FAR.replace("FOCAL", "1e6");
    let error = read_tsai(&tsai, size(1024, 768)).unwrap_err();
    assert!(matches!(error, StereoError::CameraTooFar { .. }), "{error}");
    assert_eq!(
        lost(&read_tsai(&OLD_TSAI_FAR.replace("FOCAL", "1e3"), size(1024, 768)).unwrap()),
        []
    );
}

const OLD_TSAI_FAR: &str = "fu = FOCAL\nfv = FOCAL\ncu = 526\ncv = 374\nu_direction = 1 0 0\n\
    v_direction = 0 1 0\nw_direction = 0 0 1\nC = 9876543.21 2 3\nR = 0 0 1 -1 0 0 0 -1 0\n\
    k1 = -0.3\nk2 = 0.1\np1 = 0\np2 = 0\n";

#[test]
fn what_is_seen_at_the_very_edge_of_a_cahvor_model_is_seen_there() {
    // A file that fuzzing found: the column 502 + 10 focal lengths is at a tangent of exactly 10, where the model ends.
    let edge = "Model = CAHV\nDimensions = 1024 768\nC = 0.1 0.2 0.99999999999999999999999999\nA = 0 0 1\n\
        H = 1 0 502\nV = 0 622 384\n";
    assert_eq!(lost(&read_cahvor(edge, Some(size(1024, 768))).unwrap()), []);
    let camera = read_cahvor(edge, Some(size(1024, 768))).unwrap();
    let at = Point2::new(512.0, 384.0);
    let ray = camera.ray(&at).unwrap();
    let back = camera.project(&(ray.origin + ray.direction.into_inner())).unwrap();
    assert!((back - at).norm() < 1e-9);
    // A lens that folds the image over between two angles at which it grows has no ray beyond the first.
    // Growth 1 - 8 τ + 15.9 τ²: below 0 from τ = 0.2317 to 0.2714.
    let fold =
        "C = 0 0 0\nA = 0 0 1\nH = 200 0 512\nV = 0 200 384\nO = 0 0 1\nR = 0 -2.6666666666 3.18\n";
    let camera = read_cahvor(fold, Some(size(1024, 768))).unwrap();
    let seen_at = |tan: f64| camera.project(&Point3::new(tan, 0.0, 1.0)).is_some();
    let growth = |tau: f64| 1.0 - 8.0 * tau + 15.9 * tau * tau;
    let folds =
        (1..2000).map(|i| 1e-3 * f64::from(i)).find(|tan| growth(tan * tan) <= 0.0).unwrap();
    for tan in (1..2000).map(|i| 1e-3 * f64::from(i)) {
        assert_eq!(seen_at(tan), tan < folds, "{tan}");
    }
}

const MIDDLEBURY: &str = "cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]\n\
    cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]\ndoffs=31.086\nbaseline=193.001\n\
    width=741\nheight=500\nndisp=70\n";

#[test]
fn the_calibration_of_the_motorcycle_gives_its_depth() {
    let [left, right] = read_middlebury(MIDDLEBURY).unwrap();
    // Z = f b / (d + doffs).
    let z = 994.978 * 0.193_001 / (40.0 + 31.086);
    let at = left.ray(&Point2::new(500.0, 300.0)).unwrap();
    let point = at.origin + at.direction.into_inner() * (z / at.direction.z);
    let seen = right.project(&point).unwrap();
    assert!((seen - Point2::new(460.0, 300.0)).norm() < 1e-6, "{seen}");
    let wrong = |from: &str, to: &str| {
        read_middlebury(&MIDDLEBURY.replace(from, to)).unwrap_err().to_string()
    };
    assert!(wrong("doffs=31.086", "doffs=0").contains("cx of cam1"));
    assert!(wrong("baseline=193.001", "baseline=-1").contains("baseline is -1"));
    assert!(wrong("width=741", "width=74100").contains("74100"));
    assert!(wrong("width=741", "width=300").contains("another image size"));
}

const INTRINSICS: &str = "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
    data: [ 620., 0., 526.,\n       0., 622., 374., 0., 0., 1. ]\nD1: !!opencv-matrix\n   rows: 1\n   \
    cols: 5\n   dt: d\n   data: [ -0.3, 0.1, 1e-3, 2e-3, 0.01 ]\nM2: !!opencv-matrix\n   rows: 3\n   \
    cols: 3\n   dt: d\n   data: [ 620., 0., 526., 0., 622., 374., 0., 0., 1. ]\n\
    D2: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0., 0., 0., 0., 0. ]\n";
const EXTRINSICS: &str = "%YAML:1.0\n---\nR: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
    data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\nT: !!opencv-matrix\n   rows: 3\n   cols: 1\n   \
    dt: d\n   data: [ -120., 0., 0. ]\n";

#[test]
fn a_pair_of_opencv_is_read_in_the_unit_that_is_named() {
    let pair = read_opencv_pair(INTRINSICS, EXTRINSICS, Some(size(1024, 768)), 1e-3).unwrap();
    let [left, right] = &pair;
    assert!((right.center() - Point3::new(0.12, 0.0, 0.0)).norm() < 1e-12, "T is minus the place");
    let Camera::Pinhole(left) = left else { panic!("a pinhole") };
    assert_eq!((left.focal(), left.principal()), ([620.0, 622.0], [526.0, 374.0]));
    let lens = left.distortion();
    assert_eq!([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3], [-0.3, 0.1, 1e-3, 2e-3, 0.01]);
    let skewed = EXTRINSICS.replace("1., 0., 0., 0., 1.", "1., 0.1, 0., 0., 1.");
    let error = read_opencv_pair(INTRINSICS, &skewed, Some(size(1024, 768)), 1e-3).unwrap_err();
    assert!(matches!(error, StereoError::NotARotation { .. }), "{error}");
    assert!(read_opencv_pair(INTRINSICS, EXTRINSICS, None, 1e-3).is_err(), "no size");
}

#[test]
fn a_camera_info_of_ros_is_read_and_other_lenses_are_refused() {
    let ros = "image_width: 640\nimage_height: 480\ncamera_name: left\ncamera_matrix:\n  rows: 3\n  \
        cols: 3\n  data: [500, 0, 320, 0, 500, 240, 0, 0, 1]\ndistortion_model: plumb_bob\n\
        distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, 0]\n";
    let camera = read_opencv(ros, None).unwrap();
    assert_eq!(camera.size(), size(640, 480));
    assert_eq!(camera.focal(), [500.0; 2]);
    let rational = ros.replace("[0.1, 0, 0, 0, 0]", "[0.1, 0, 0, 0, 0, 1, 0, 0]");
    assert!(read_opencv(&rational, None).unwrap_err().to_string().contains("8 distortion"));
    let zeros = ros.replace("[0.1, 0, 0, 0, 0]", "[0.1, 0, 0, 0, 0, 0, 0, 0]");
    assert_eq!(read_opencv(&zeros, None).unwrap(), camera);
    assert!(read_opencv("{\"a\": 1}", None).unwrap_err().to_string().contains("JSON"));
    assert!(read_opencv(ros, Some(size(320, 240))).is_err());
}

#[test]
fn no_damage_to_a_file_makes_a_reader_panic_and_what_it_reads_is_usable() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let texts = [TSAI, CAHVOR, MIDDLEBURY, INTRINSICS, EXTRINSICS];
    let bits = ["nan", "-", "1e999", "=", "0", "[", "]", ":", "\n", "E", "inf", "9", " ", "é"];
    let mut n_read = 0;
    for round in 0..20_000 {
        let mut text: Vec<char> = texts[round % texts.len()].chars().collect();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..text.len());
            let to = (at + rng.random_range(0..6)).min(text.len());
            let bit = bits[rng.random_range(0..bits.len())];
            text.splice(at..to, bit.chars());
        }
        let text: String = text.into_iter().collect();
        let size = size(1024, 768);
        let mut cameras: Vec<Camera> = Vec::new();
        cameras.extend(read_tsai(&text, size));
        cameras.extend(read_cahvor(&text, None));
        cameras.extend(read_middlebury(&text).into_iter().flatten());
        cameras.extend(read_opencv(&text, Some(size)));
        cameras.extend(read_opencv_pair(&text, EXTRINSICS, Some(size), 1e-3).into_iter().flatten());
        cameras.extend(read_opencv_pair(INTRINSICS, &text, Some(size), 1e-3).into_iter().flatten());
        for camera in cameras {
            n_read += 1;
            let middle = Point2::new(500.0, 300.0);
            if let Some(ray) = camera.ray(&middle) {
                let back = camera.project(&(ray.origin + ray.direction.into_inner()));
                assert!(back.is_some_and(|back| (back - middle).norm() < 1e-3), "{text}");
            }
        }
    }
    assert!(n_read > 2000, "{n_read}");
}
