//! Pictures of the pairs of the last reconstructions, as PNG, to be looked at: the images as they came, as
//! they were rectified, and the disparities.

use std::collections::{BTreeMap, VecDeque};

use bytes::Bytes;
use stereo::GrayImage;
use stereo::matching::Disparity;
use stereo::pair::Reconstruction;

/// Reconstructions whose pictures are kept.
const KEPT_MAX: usize = 6;
/// Most bytes of all pictures; the oldest reconstruction gives way.
const BYTES_MAX: usize = 64 << 20;

/// The names of the pictures of a pair.
pub const PICTURES: [&str; 5] = ["left", "right", "rectified_left", "rectified_right", "disparity"];

/// The pictures of one pair, by their names.
pub type PairPictures = BTreeMap<&'static str, Bytes>;

/// The pictures that are kept.
#[derive(Default)]
pub struct Pictures {
    kept: VecDeque<(String, BTreeMap<String, PairPictures>)>,
}

impl Pictures {
    /// Keeps the pictures of a reconstruction, as far as there is room.
    pub fn keep(&mut self, id: &str, pairs: BTreeMap<String, PairPictures>) {
        self.kept.push_back((id.to_owned(), pairs));
        while self.kept.len() > KEPT_MAX || (self.kept.len() > 1 && self.bytes() > BYTES_MAX) {
            self.kept.pop_front();
        }
    }

    /// A picture of a pair of a reconstruction.
    pub fn get(&self, id: &str, pair: &str, picture: &str) -> Option<Bytes> {
        let (_, pairs) = self.kept.iter().find(|(of, _)| of == id)?;
        pairs.get(pair)?.get(picture).cloned()
    }

    fn bytes(&self) -> usize {
        let pairs = self.kept.iter().flat_map(|(_, pairs)| pairs.values());
        pairs.flat_map(BTreeMap::values).map(Bytes::len).sum()
    }
}

/// Draws the pictures of a pair. What cannot be encoded is left out.
pub fn draw(images: &[GrayImage; 2], found: &Reconstruction) -> PairPictures {
    let [left, right] = images;
    let pictures = [
        ("left", gray(left)),
        ("right", gray(right)),
        ("rectified_left", gray(&found.images.left)),
        ("rectified_right", gray(&found.images.right)),
        ("disparity", disparity(&found.disparity)),
    ];
    let encoded = pictures.into_iter().filter_map(|(name, png)| Some((name, png.ok()?)));
    encoded.collect()
}

fn gray(image: &GrayImage) -> Result<Bytes, png::EncodingError> {
    encode(image.size().width, image.size().height, image.pixels(), None)
}

/// Near is bright, far dark; a hole is transparent.
fn disparity(disparity: &Disparity) -> Result<Bytes, png::EncodingError> {
    let size = disparity.size();
    let places = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
    let values: Vec<Option<f32>> = places.map(|(x, y)| disparity.at(x, y)).collect();
    let (low, high) = values
        .iter()
        .flatten()
        .fold((f32::MAX, f32::MIN), |(low, high), d| (low.min(*d), high.max(*d)));
    let span = (high - low).max(1e-3);
    let index = |d: &Option<f32>| match d {
        None => 0,
        Some(d) => 1 + (254.0 * (d - low) / span).round().clamp(0.0, 254.0) as u8,
    };
    let pixels: Vec<u8> = values.iter().map(index).collect();
    encode(size.width, size.height, &pixels, Some(&palette()))
}

/// A perceptually even scale from dark blue over green to yellow; the first entry is the hole.
fn palette() -> [[u8; 3]; 256] {
    const STOPS: [[f32; 3]; 5] = [
        [68.0, 1.0, 84.0],
        [59.0, 82.0, 139.0],
        [33.0, 145.0, 140.0],
        [94.0, 201.0, 98.0],
        [253.0, 231.0, 37.0],
    ];
    let mut colors = [[0; 3]; 256];
    for (i, color) in colors.iter_mut().enumerate().skip(1) {
        let along = (i - 1) as f32 / 254.0 * (STOPS.len() - 1) as f32;
        let at = (along as usize).min(STOPS.len() - 2);
        let share = along - at as f32;
        let mix = |c: usize| STOPS[at][c] + share * (STOPS[at + 1][c] - STOPS[at][c]);
        *color = [0, 1, 2].map(|c| mix(c).round() as u8);
    }
    colors
}

fn encode(
    width: usize,
    height: usize,
    pixels: &[u8],
    palette: Option<&[[u8; 3]; 256]>,
) -> Result<Bytes, png::EncodingError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    match palette {
        None => encoder.set_color(png::ColorType::Grayscale),
        Some(colors) => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(colors.concat());
            encoder.set_trns(vec![0_u8]);
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(out.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_reconstruction_gives_way_by_number_and_by_bytes() {
        let mut pictures = Pictures::default();
        let one = |n: usize| {
            let picture = BTreeMap::from([("left", Bytes::from(vec![0; n]))]);
            BTreeMap::from([("nav1".to_owned(), picture)])
        };
        for i in 0..KEPT_MAX + 1 {
            pictures.keep(&i.to_string(), one(10));
        }
        assert!(pictures.get("0", "nav1", "left").is_none());
        assert_eq!(pictures.get("1", "nav1", "left").map(|b| b.len()), Some(10));
        assert!(pictures.get("1", "nav2", "left").is_none());
        assert!(pictures.get("1", "nav1", "disparity").is_none());
        pictures.keep("large", one(BYTES_MAX));
        assert!(pictures.get(&KEPT_MAX.to_string(), "nav1", "left").is_none());
        assert!(pictures.get("large", "nav1", "left").is_some());
    }

    #[test]
    fn a_png_has_the_pixels_back() {
        let pixels: Vec<u8> = (0..32 * 16).map(|i| (i * 7 % 251) as u8).collect();
        let png = encode(32, 16, &pixels, None).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&png[..])).read_info().unwrap();
        let mut back = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut back).unwrap();
        assert_eq!((info.width, info.height), (32, 16));
        assert_eq!(back, pixels);
    }
}
