//! Gray images as PNG: how images of the rover travel and are kept.

use std::io::Cursor;

use png::{BitDepth, ColorType};

use crate::StereoError;
use crate::image::{GrayImage, ImageSize};

/// Fewest and most bits of gray that are kept.
pub const DEPTH_BITS: [u8; 2] = [4, 8];

/// The image as the bytes of a PNG of 8 bits of gray, of which the `depth_bits` highest tell (4 to
/// 8): with 8 nothing is lost, with fewer the noise is, and with it most of the bytes. The same image
/// gives the same bytes.
pub fn encode(image: &GrayImage, depth_bits: u8) -> Result<Vec<u8>, StereoError> {
    let [least, most] = DEPTH_BITS.map(f64::from);
    StereoError::check("depth_bits", depth_bits.into(), [least, most], "4 to 8 bits")?;
    let size = image.size();
    let mut bytes = Vec::new();
    let (width, height) = (size.width as u32, size.height as u32);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    let pixels: Vec<u8> = image.pixels().iter().map(|v| coarse(*v, depth_bits)).collect();
    let refuse = |error: png::EncodingError| StereoError::Png { what: error.to_string() };
    let mut writer = encoder.write_header().map_err(refuse)?;
    writer.write_image_data(&pixels).map_err(refuse)?;
    writer.finish().map_err(refuse)?;
    Ok(bytes)
}

/// The image of a PNG of 8 bits of gray. What the header says is checked before anything is
/// allocated for it.
pub fn decode(bytes: &[u8]) -> Result<GrayImage, StereoError> {
    let refuse = |error: png::DecodingError| StereoError::Png { what: error.to_string() };
    let limits = png::Limits { bytes: 4 * crate::MAX_PIXELS };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(refuse)?;
    let info = reader.info();
    let kind = (info.color_type, info.bit_depth);
    if kind != (ColorType::Grayscale, BitDepth::Eight) {
        let what = format!("it has {:?} bits of {:?}: give 8 bits of gray", kind.1, kind.0);
        return Err(StereoError::Png { what });
    }
    let size = ImageSize::new(info.width as usize, info.height as usize)?;
    let mut pixels = vec![0; size.len()];
    reader.next_frame(&mut pixels).map_err(refuse)?;
    GrayImage::new(size, pixels)
}

/// The middle of the step that a gray value falls into, black and white kept.
fn coarse(value: u8, depth_bits: u8) -> u8 {
    let levels = (1_u32 << depth_bits) - 1;
    let step = (u32::from(value) * levels + 127) / 255;
    ((step * 255 + levels / 2) / levels) as u8
}
