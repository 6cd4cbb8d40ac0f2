//! Gray images.

use std::fmt;

use crate::StereoError;

/// Width and height of an image (px).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {} px", self.width, self.height)
    }
}

/// Fewest columns and rows of an image.
const SIDE_MIN: usize = 16;
/// Most columns and rows of an image.
const SIDE_MAX: usize = 8192;
/// Most pixels of an image: bounds the memory of everything in this crate.
pub const MAX_PIXELS: usize = 1 << 24;

impl ImageSize {
    /// A size within the bounds of this crate: 16 to 8192 a side, at most [`MAX_PIXELS`].
    pub fn new(width: usize, height: usize) -> Result<ImageSize, StereoError> {
        let size = ImageSize { width, height };
        let sides = [width, height].iter().all(|side| (SIDE_MIN..=SIDE_MAX).contains(side));
        if sides && size.len() <= MAX_PIXELS {
            Ok(size)
        } else {
            Err(StereoError::ImageSize { size })
        }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// True if there is no pixel; never so for a size from [`ImageSize::new`].
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An image of 8-bit gray values, row-major from the upper left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GrayImage {
    size: ImageSize,
    pixels: Vec<u8>,
}

impl GrayImage {
    /// An image of these gray values.
    pub fn new(size: ImageSize, pixels: Vec<u8>) -> Result<GrayImage, StereoError> {
        let size = ImageSize::new(size.width, size.height)?;
        if pixels.len() != size.len() {
            let (expected, given) = (size.len(), pixels.len());
            return Err(StereoError::PixelCount { size, expected, given });
        }
        Ok(GrayImage { size, pixels })
    }

    /// The luma (ITU-R BT.601) of interleaved 8-bit RGB values.
    pub fn from_rgb(size: ImageSize, rgb: &[u8]) -> Result<GrayImage, StereoError> {
        let size = ImageSize::new(size.width, size.height)?;
        if rgb.len() != 3 * size.len() {
            let (expected, given) = (3 * size.len(), rgb.len());
            return Err(StereoError::PixelCount { size, expected, given });
        }
        let luma = |p: &[u8]| {
            let [r, g, b] = [p[0], p[1], p[2]].map(u32::from);
            ((19595 * r + 38470 * g + 7471 * b + 32768) >> 16) as u8
        };
        Ok(GrayImage { size, pixels: rgb.chunks_exact(3).map(luma).collect() })
    }

    /// Width and height.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// The gray values, row-major.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// One row; panics outside the image.
    pub fn row(&self, y: usize) -> &[u8] {
        &self.pixels[y * self.size.width..][..self.size.width]
    }

    /// The gray value at column `x`, row `y`; panics outside the image.
    pub fn at(&self, x: usize, y: usize) -> u8 {
        self.row(y)[x]
    }
}
