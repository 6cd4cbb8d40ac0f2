//! What a set of pairs would see, before they are asked.
//!
//! For each cell of a grid and each pair: whether both cameras have the ground there in their images,
//! within the pair's range, and nothing – neither ground nor the posed robot – is in between; and how
//! large a pixel is on the ground. Shadows and texture do not count: they are only known afterward.

use geometry::{Grid, Raster};
use nalgebra::{Point3, Vector3};
use rover::{Posture, Robot};
use terrain::ElevationMap;

use crate::StereoError;
use crate::camera::Camera;
use crate::ray::RayScene;
use crate::rig::CameraPair;

/// Most cells that are looked at for one pair.
pub const CELLS_MAX: usize = 1 << 22;

/// What one pair would see.
#[derive(Debug, Clone, PartialEq)]
pub struct PairCoverage {
    /// The pair's name.
    pub name: String,
    /// Length of a pixel on the ground (m), along the slope where it is longest; NaN where the pair
    /// sees nothing.
    pub ground_resolution: Raster<f32>,
    /// Area seen (m²).
    pub area: f64,
    /// Bytes of its two images before compression.
    pub raw_bytes: usize,
}

/// What some pairs would see on a grid of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// The cells.
    pub grid: Grid,
    /// Pair by pair, as asked.
    pub pairs: Vec<PairCoverage>,
}

impl Coverage {
    /// Number of the pairs that see each cell.
    pub fn counts(&self) -> Raster<u16> {
        Raster::from_fn(self.grid, |ix, iy| {
            let sees = |pair: &&PairCoverage| !pair.ground_resolution.at(ix, iy).is_nan();
            self.pairs.iter().filter(sees).count() as u16
        })
    }
}

/// Ground within this of the end of a ray is what was meant (m).
const SLACK: f64 = 5e-3;

/// Cells that `pairs` of a robot in a posture would see of `map` (frame `world`), on the cells of
/// `grid`. `stop` is asked once a row.
pub fn coverage(
    pairs: &[&CameraPair],
    robot: &Robot,
    posture: &Posture,
    map: &ElevationMap,
    grid: &Grid,
    stop: &dyn Fn() -> bool,
) -> Result<Coverage, StereoError> {
    let n_cells = grid.len();
    StereoError::check("cells", n_cells as f64, [1.0, CELLS_MAX as f64], "at most 4194304 cells")?;
    let scene = RayScene::new(Some(map), Some((robot, posture)));
    let mut covered = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let cameras = pair.cameras(posture);
        let mut values = Vec::with_capacity(n_cells);
        for iy in 0..grid.ny {
            if stop() {
                return Err(StereoError::Stopped);
            }
            for ix in 0..grid.nx {
                let at = grid.position(ix, iy);
                let seen = map.surface_at(at).and_then(|(z, [gx, gy])| {
                    let normal = Vector3::new(-gx, -gy, 1.0).normalize();
                    let point = Point3::new(at.x, at.y, z);
                    resolution(&cameras, pair.range, &scene, &point, &normal)
                });
                values.push(seen.unwrap_or(f64::NAN) as f32);
            }
        }
        let n_seen = values.iter().filter(|v| !v.is_nan()).count();
        let area = n_seen as f64 * grid.resolution * grid.resolution;
        let mut values = values.into_iter();
        let ground_resolution = Raster::from_fn(*grid, |_, _| values.next().unwrap_or(f32::NAN));
        let (name, raw_bytes) = (pair.name.clone(), pair.raw_bytes());
        covered.push(PairCoverage { name, ground_resolution, area, raw_bytes });
    }
    Ok(Coverage { grid: *grid, pairs: covered })
}

/// Length of a pixel on the ground at a point that both cameras see.
fn resolution(
    cameras: &[Camera; 2],
    [near, far]: [f64; 2],
    scene: &RayScene,
    point: &Point3<f64>,
    normal: &Vector3<f64>,
) -> Option<f64> {
    let mut coarsest: f64 = 0.0;
    for camera in cameras {
        let depth = camera.depth_in_view(point)?;
        let way = point - camera.center();
        let facing = -way.normalize().dot(normal);
        if !(depth >= near && depth <= far && facing > 0.0) {
            return None;
        }
        coarsest = coarsest.max(depth / camera.focal()[0] / facing.max(1e-3));
    }
    let sees = |camera: &Camera| scene.sees(&camera.center(), point, SLACK);
    cameras.iter().all(sees).then_some(coarsest)
}
