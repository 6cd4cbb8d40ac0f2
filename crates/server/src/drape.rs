//! What is laid over the ground: textures of camera images, and imported rasters; their tiles.

mod overlays;
mod texture;

use bytes::Bytes;
use geometry::Grid;
use wire::drape::{DrapeShape, TILE_TEXELS};

pub use overlays::Overlays;
pub use texture::{PlacedShot, Shot, Shots, Texture};

/// Tiles along an axis of so many texels.
fn n_tiles(n_texels: usize) -> usize {
    n_texels.div_ceil(TILE_TEXELS).max(1)
}

/// Where texels with these middles lie.
fn shape_of(grid: &Grid) -> DrapeShape {
    let half = 0.5 * grid.resolution;
    DrapeShape {
        origin_m: [grid.origin.x - half, grid.origin.y - half],
        texel_m: grid.resolution,
        size: [grid.nx, grid.ny],
        tiles: [n_tiles(grid.nx), n_tiles(grid.ny)],
    }
}

/// A tile as PNG, the greatest y first: `texel` gives the `N` bytes of a texel. None if there is no such tile.
fn tile<const N: usize>(
    grid: &Grid,
    [x, y]: [usize; 2],
    color: png::ColorType,
    texel: impl Fn(usize) -> [u8; N],
) -> Option<Result<Bytes, png::EncodingError>> {
    if x >= n_tiles(grid.nx) || y >= n_tiles(grid.ny) {
        return None;
    }
    let span = |i: usize, n: usize| i * TILE_TEXELS..((i + 1) * TILE_TEXELS).min(n);
    let (columns, rows) = (span(x, grid.nx), span(y, grid.ny));
    let (width, height) = (columns.len() as u32, rows.len() as u32);
    let mut pixels = Vec::with_capacity(N * columns.len() * rows.len());
    for iy in rows.rev() {
        for ix in columns.clone() {
            pixels.extend(texel(grid.index(ix, iy)));
        }
    }
    let encode = || {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, width, height);
        encoder.set_color(color);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&pixels)?;
        writer.finish()?;
        Ok(out.into())
    };
    Some(encode())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;

    #[test]
    fn tiles_cover_all_texels_once_with_the_greatest_y_first() {
        let grid = Grid { origin: Point2::new(0.5, -0.5), resolution: 1.0, nx: 300, ny: 257 };
        let shape = shape_of(&grid);
        assert_eq!((shape.origin_m, shape.size, shape.tiles), ([0.0, -1.0], [300, 257], [2, 2]));
        let value = |i: usize| [(i % 251) as u8];
        let mut seen = vec![0; grid.len()];
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let png = tile(&grid, [x, y], png::ColorType::Grayscale, value).unwrap().unwrap();
            let mut reader = png::Decoder::new(std::io::Cursor::new(&png[..])).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut pixels).unwrap();
            let (w, h) = (info.width as usize, info.height as usize);
            for (k, pixel) in pixels[..w * h].iter().enumerate() {
                let (ix, iy) = (256 * x + k % w, 256 * y + (h - 1 - k / w));
                let i = grid.index(ix, iy);
                assert_eq!([*pixel], value(i));
                seen[i] += 1;
            }
        }
        assert!(seen.iter().all(|n| *n == 1));
        assert!(tile(&grid, [2, 0], png::ColorType::Grayscale, value).is_none());
    }
}
