//! Images and truth of the shared test data.

use std::io::Cursor;

use stereo::{GrayImage, ImageSize};
use testkit::shared_data;

/// A PNG of the shared data as gray values.
pub fn gray(test: &str, path: &str) -> Option<GrayImage> {
    let bytes = shared_data(test, path)?;
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    pixels.truncate(info.buffer_size());
    assert_eq!(info.bit_depth, png::BitDepth::Eight);
    let size = ImageSize::new(info.width as usize, info.height as usize).unwrap();
    Some(match info.color_type {
        png::ColorType::Grayscale => GrayImage::new(size, pixels).unwrap(),
        png::ColorType::Rgb => GrayImage::from_rgb(size, &pixels).unwrap(),
        png::ColorType::Rgba => {
            let rgb: Vec<u8> = pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
            GrayImage::from_rgb(size, &rgb).unwrap()
        }
        other => panic!("{other:?}"),
    })
}

/// The only array of a `.npz`, which is a zip file of one `.npy` of f32: values, row-major.
pub fn npz_f32(test: &str, path: &str) -> Option<Vec<f32>> {
    let bytes = shared_data(test, path)?;
    let u16_at = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    // The central directory knows the sizes.
    let end = (0..bytes.len() - 21).rev().find(|at| bytes[*at..].starts_with(b"PK\x05\x06"))?;
    let entry = u32_at(end + 16);
    assert!(bytes[entry..].starts_with(b"PK\x01\x02"));
    let (method, packed, local) = (u16_at(entry + 10), u32_at(entry + 20), u32_at(entry + 42));
    let start = local + 30 + u16_at(local + 26) + u16_at(local + 28);
    let content = &bytes[start..start + packed];
    let npy = match method {
        0 => content.to_vec(),
        8 => miniz_oxide::inflate::decompress_to_vec(content).unwrap(),
        other => panic!("zip method {other}"),
    };
    assert!(npy.starts_with(b"\x93NUMPY\x01"));
    let header = usize::from(u16::from_le_bytes([npy[8], npy[9]]));
    let text = std::str::from_utf8(&npy[10..10 + header]).unwrap();
    assert!(text.contains("<f4") && text.contains("'fortran_order': False"), "{text}");
    let values = npy[10 + header..].chunks_exact(4);
    Some(values.map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect())
}
