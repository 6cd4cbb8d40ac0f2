//! Calibrations, and images of the rover.

use nalgebra::Point2;
use stereo::calibration::{read_cahvor, read_middlebury, read_opencv, read_opencv_pair, read_tsai};
use stereo::camera::Camera;
use stereo::{GrayImage, ImageSize, StereoError, codec};

use super::answered;
use crate::mutate::{Kind, Seed};
use crate::run::{Answer, Reader};

const TSAI: &str = "VERSION_4\nPINHOLE\nfu = 3.1\nfv = 3.11\ncu = 2.63\ncv = 1.87\nu_direction = 1 0 0\n\
    v_direction = 0 1 0\nw_direction = 0 0 1\nC = 1 2 3\nR = 0 0 1 -1 0 0 0 -1 0\n\
    pitch = 0.005\nTSAI\nk1 = -0.3\nk2 = 0.1\np1 = 0\np2 = 0\n";
const OLD_TSAI: &str = "fu = 620\nfv = 622\ncu = 526\ncv = 374\nu_direction = 1 0 0\n\
    v_direction = 0 1 0\nw_direction = 0 0 1\nC = 1 2 3\nR = 0 0 1 -1 0 0 0 -1 0\n\
    k1 = -0.3\nk2 = 0.1\np1 = 0\np2 = 0\n";
const CAHVOR: &str = "Model = CAHVOR = perspective, distortion\nDimensions = 1024 768\n\
    C = 0.1 0.2 0.3\nA = 0 0 1\nH = 620 0 512\nV = 0 622 384\nO = 0 0 1\nR = 0 -0.2 0.05\n";
const CAHV: &str = "Model = CAHV\nDimensions = 1024 768\nC = 0.1 0.2 0.3\nA = 0 0 1\nH = 620 0 512\n\
    V = 0 622 384\n";
const MIDDLEBURY: &str = "cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]\n\
    cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]\ndoffs=31.086\nbaseline=193.001\n\
    width=741\nheight=500\nndisp=70\n";
const ROS: &str = "image_width: 640\nimage_height: 480\ncamera_name: left\ncamera_matrix:\n  rows: 3\n  \
    cols: 3\n  data: [500, 0, 320, 0, 500, 240, 0, 0, 1]\ndistortion_model: plumb_bob\n\
    distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, 0]\n";
const INTRINSICS: &str = "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
    data: [ 620., 0., 526.,\n       0., 622., 374., 0., 0., 1. ]\nD1: !!opencv-matrix\n   rows: 1\n   \
    cols: 5\n   dt: d\n   data: [ -0.3, 0.1, 1e-3, 2e-3, 0.01 ]\nM2: !!opencv-matrix\n   rows: 3\n   \
    cols: 3\n   dt: d\n   data: [ 620., 0., 526., 0., 622., 374., 0., 0., 1. ]\n\
    D2: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0., 0., 0., 0., 0. ]\n";
const EXTRINSICS: &str = "%YAML:1.0\n---\nR: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
    data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\nT: !!opencv-matrix\n   rows: 3\n   cols: 1\n   \
    dt: d\n   data: [ -120., 0., 0. ]\n";

const MEMORY_MAX: usize = 64 << 20;
const SECONDS_MAX: f64 = 2.0;

pub fn readers() -> Vec<Reader> {
    vec![
        texts("tsai", &[TSAI, OLD_TSAI], |_, text| {
            cameras(read_tsai(text, size()).map(|c| vec![c]))
        }),
        texts("cahvor", &[CAHVOR, CAHV], |_, text| {
            cameras(read_cahvor(text, None).map(|c| vec![c]))
        }),
        texts("middlebury", &[MIDDLEBURY], |_, text| cameras(read_middlebury(text).map(Vec::from))),
        texts("opencv", &[ROS, INTRINSICS, EXTRINSICS], |i, text| match i {
            0 => cameras(read_opencv(text, None).map(|c| vec![c])),
            1 => pair(text, EXTRINSICS),
            _ => pair(INTRINSICS, text),
        }),
        images(),
    ]
}

fn pair(intrinsics: &str, extrinsics: &str) -> Answer {
    cameras(read_opencv_pair(intrinsics, extrinsics, Some(size()), 1e-3).map(Vec::from))
}

fn size() -> ImageSize {
    ImageSize::new(1024, 768).unwrap()
}

fn texts(
    name: &'static str,
    seeds: &[&str],
    read: impl Fn(usize, &str) -> Answer + 'static,
) -> Reader {
    let seeds = seeds.iter().map(|text| Seed::new(name, Kind::Text, *text)).collect();
    // Who reads the file for them has made text of it.
    let read = move |i: usize, bytes: &[u8]| read(i, &String::from_utf8_lossy(bytes));
    let (memory_max, seconds_max) = (MEMORY_MAX, SECONDS_MAX);
    Reader { name, seeds, read: Box::new(read), memory_max, seconds_max }
}

/// What is read is a camera that may be used: a place of the image that has a ray is seen there.
fn cameras(result: Result<Vec<Camera>, StereoError>) -> Answer {
    for camera in result.iter().flatten() {
        let size = camera.size();
        for (u, v) in [(0.5, 0.5), (0.1, 0.2), (0.9, 0.7)] {
            let pixel = Point2::new(u * size.width as f64, v * size.height as f64);
            if let Some(ray) = camera.ray(&pixel) {
                let back = camera.project(&(ray.origin + ray.direction.into_inner()));
                if !back.is_some_and(|back| (back - pixel).norm() < 1e-3) {
                    return Err(format!("its camera sees {pixel} at {back:?}"));
                }
            }
        }
    }
    answered(&result)
}

fn images() -> Reader {
    let size = ImageSize::new(60, 40).unwrap();
    let pixels = (0..2400_u32).map(|i| (i * i / 77) as u8).collect();
    let image = GrayImage::new(size, pixels).unwrap();
    let seeds =
        [4, 8].map(|bits| Seed::new("image", Kind::Png, codec::encode(&image, bits).unwrap()));
    Reader {
        name: "camera image",
        seeds: Vec::from(seeds),
        read: Box::new(|_, bytes| {
            let image = codec::decode(bytes);
            if let Ok(image) = &image
                && image.pixels().len() != image.size().len()
            {
                return Err("it has not as many pixels as its size says".to_owned());
            }
            answered(&image)
        }),
        // The most pixels that an image may have, decoded and kept.
        memory_max: 8 * stereo::MAX_PIXELS,
        seconds_max: SECONDS_MAX,
    }
}
