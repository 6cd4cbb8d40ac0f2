//! Images as PNG, there and back.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stereo::codec::{decode, encode};
use stereo::{GrayImage, ImageSize, StereoError};

fn noise(seed: u64, width: usize, height: usize) -> GrayImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let size = ImageSize::new(width, height).unwrap();
    GrayImage::new(size, (0..size.len()).map(|_| rng.random()).collect()).unwrap()
}

#[test]
fn with_8_bits_nothing_is_lost_and_with_fewer_at_most_half_a_step() {
    for seed in 0..20 {
        let image = noise(seed, 16 + seed as usize * 7, 40);
        assert_eq!(decode(&encode(&image, 8).unwrap()).unwrap(), image);
        for bits in 4..8_u8 {
            let kept = decode(&encode(&image, bits).unwrap()).unwrap();
            let half = 255.0 / f64::from((1_u32 << bits) - 1) / 2.0;
            for (a, b) in image.pixels().iter().zip(kept.pixels()) {
                // Half a step, and half a gray value of rounding.
                assert!((f64::from(*a) - f64::from(*b)).abs() <= half + 0.5, "{bits}: {a} {b}");
            }
            let mut levels = kept.pixels().to_vec();
            levels.sort_unstable();
            levels.dedup();
            assert!(levels.len() <= 1 << bits);
        }
    }
}

#[test]
fn fewer_bits_are_fewer_bytes() {
    let image = noise(3, 64, 64);
    let sizes = [4, 5, 6, 7, 8].map(|bits| encode(&image, bits).unwrap().len());
    assert!(sizes.windows(2).all(|pair| pair[0] < pair[1]), "{sizes:?}");
    assert!(matches!(encode(&image, 3), Err(StereoError::OutOfRange { .. })));
    assert!(matches!(encode(&image, 9), Err(StereoError::OutOfRange { .. })));
}

#[test]
fn what_is_no_gray_png_is_refused_by_name_whatever_its_header_says() {
    let good = encode(&noise(1, 32, 32), 8).unwrap();
    for end in 0..good.len() {
        // All but the end of the file is needed.
        let cut = decode(&good[..end]);
        assert!(cut.is_err() || end >= good.len() - 16, "{end}");
    }
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for _ in 0..2000 {
        let mut bytes = good.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random();
        }
        // Whatever comes of it, it neither panics nor is larger than it may be.
        if let Ok(image) = decode(&bytes) {
            assert!(image.size().len() <= stereo::MAX_PIXELS);
        }
    }
    assert!(matches!(decode(b""), Err(StereoError::Png { .. })));
    for (width, height) in [(u32::MAX, u32::MAX), (1, 1), (60_000, 16), (8192, 8192)] {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width.min(64), height.min(64));
        encoder.set_color(png::ColorType::Grayscale);
        let n = (width.min(64) * height.min(64)) as usize;
        encoder.write_header().unwrap().write_image_data(&vec![0; n]).unwrap();
        // A header that lies, with the checksum that goes with it.
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let crc = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        assert!(decode(&bytes).is_err(), "{width} x {height}");
    }
}

/// The checksum of PNG chunks (ISO 3309), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    !crc
}
