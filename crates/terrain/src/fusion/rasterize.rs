//! From the points of one pair to its elevation map.

use nalgebra::{Matrix3, Point3, Vector2, Vector3};

use super::version::INDEX_MAX;
use super::{Flags, PairCell, PairDem};
use crate::TerrainError;

/// Most points of one pair.
const POINTS_MAX: usize = 50_000_000;
/// Most cells of the map of one pair.
const CELLS_MAX: usize = 16_000_000;
/// Most cells that the pixels of one pair cover, counted once for each pixel.
const USES_MAX: f64 = 5e7;

/// What a point is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tag {
    /// The ground.
    Terrain,
    /// The robot itself.
    Robot,
    /// The seam of the robot's image, where matching smears near over far.
    ShadowBand,
}

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Where it is in `world` (m).
    pub position_m: Point3<f64>,
    /// Variance of its height, given the slope there (m²).
    pub height_variance_m2: f64,
    /// Variance of its height by what all points of the view have in common, such as errors of the
    /// calibration; comes on top (m²).
    pub common_variance_m2: f64,
    /// Width of one pixel on the ground (m); 0 where that is not known.
    pub footprint_m: f64,
    /// What it is of.
    pub tag: Tag,
}

/// How points become cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterizeOptions {
    /// Distance of the nodes (m).
    pub resolution_m: f64,
    /// Points of a larger variance are dropped (m²).
    pub variance_max_m2: f64,
    /// Points that count as one observation: matching smooths over its window, so that the errors
    /// of neighboring points are the same error.
    pub correlated_points: f64,
    /// Two groups of heights in a cell farther apart than this many standard deviations, and than
    /// half the resolution, are two surfaces.
    pub split_sigmas: f64,
    /// Share of the relief about a cell that its height may be off by: matching takes windows of pixels for level, and a
    /// mean over a cell is not the height of its node. 0 counts the noise of the match alone.
    pub relief_share: f64,
}

impl Default for RasterizeOptions {
    fn default() -> RasterizeOptions {
        RasterizeOptions {
            resolution_m: 0.05,
            variance_max_m2: 0.25,
            correlated_points: 9.0,
            split_sigmas: 4.0,
            relief_share: 1.35,
        }
    }
}

/// The map of a pair, and what did not go into it.
#[derive(Debug, Clone, PartialEq)]
pub struct Rasterized {
    /// The map.
    pub dem: PairDem,
    /// Points dropped for their variance.
    pub n_dropped: usize,
}

/// The elevation map of a pair: in each cell the mean of its points' heights, weighted by their
/// variances.
///
/// A point counts in the cell that it lies in, and in those whose node its pixel covers. A cell
/// with points of the robot (shadow band) and none of the ground is flagged. A cell whose heights
/// are in two groups, of two points or more each, has the upper one as height and the lower one
/// beside it. Points that are not finite, and extents of more than 16 million cells, are refused.
pub fn rasterize(
    points: &[Measurement],
    options: &RasterizeOptions,
) -> Result<Rasterized, TerrainError> {
    check(points, options)?;
    let c = options.resolution_m;
    let node = |v: f64| (v / c).round() as i32;
    let kept = |p: &&Measurement| p.height_variance_m2 <= options.variance_max_m2;
    let n_dropped = points.len() - points.iter().filter(kept).count();
    // The cells of a point: those whose node its pixel covers, and its own.
    let span = |v: f64, footprint: f64| {
        let half = 0.5 * footprint / c;
        let (low, high) = ((v / c - half).ceil() as i32, (v / c + half).floor() as i32);
        low.min(node(v))..=high.max(node(v))
    };
    let mut ends = [i32::MAX, i32::MAX, i32::MIN, i32::MIN];
    for p in points.iter().filter(kept) {
        let xs = span(p.position_m.x, p.footprint_m);
        let ys = span(p.position_m.y, p.footprint_m);
        ends = [
            ends[0].min(*xs.start()),
            ends[1].min(*ys.start()),
            ends[2].max(*xs.end()),
            ends[3].max(*ys.end()),
        ];
    }
    if ends[0] > ends[2] {
        return Err(TerrainError::NoKnownHeight);
    }
    let (nx, ny) = ((ends[2] - ends[0]) as usize + 1, (ends[3] - ends[1]) as usize + 1);
    TerrainError::check_nodes(nx as f64 * ny as f64, CELLS_MAX)?;
    let n_uses: f64 = points
        .iter()
        .filter(kept)
        .map(|p| {
            let [xs, ys] = [p.position_m.x, p.position_m.y].map(|v| span(v, p.footprint_m));
            (xs.end() - xs.start() + 1) as f64 * (ys.end() - ys.start() + 1) as f64
        })
        .sum();
    let expected = "pixels that cover at most 5e7 cells in all: use a coarser resolution";
    TerrainError::check("footprint_m (cells covered)", n_uses, [0.0, USES_MAX], expected)?;
    // Points by cell: counted, then sorted into one list in the order they came.
    let each_use = |visit: &mut dyn FnMut(usize, u32)| {
        for (i, p) in points.iter().enumerate().filter(|(_, p)| kept(p)) {
            for iy in span(p.position_m.y, p.footprint_m) {
                for ix in span(p.position_m.x, p.footprint_m) {
                    visit((iy - ends[1]) as usize * nx + (ix - ends[0]) as usize, i as u32);
                }
            }
        }
    };
    let mut starts = vec![0_u32; nx * ny + 1];
    each_use(&mut |cell, _| starts[cell + 1] += 1);
    for i in 0..nx * ny {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut order = vec![0_u32; starts[nx * ny] as usize];
    each_use(&mut |cell, point| {
        order[next[cell] as usize] = point;
        next[cell] += 1;
    });
    let mut heights = Vec::new();
    let mut cells: Vec<PairCell> = (0..nx * ny)
        .map(|i| {
            let own = &order[starts[i] as usize..starts[i + 1] as usize];
            cell(own.iter().map(|point| &points[*point as usize]), options, &mut heights)
        })
        .collect();
    if options.relief_share > 0.0 {
        add_relief(&mut cells, nx, options.relief_share);
    }
    let dem = PairDem::new(c, [ends[0], ends[1]], nx, cells).ok_or(TerrainError::NoKnownHeight)?;
    Ok(Rasterized { dem, n_dropped })
}

/// Makes each cell less sure by a share of the relief about it: how far its neighbors and it are from one plane (RMS),
/// beyond what their noise explains.
fn add_relief(cells: &mut [PairCell], nx: usize, share: f64) {
    let ny = cells.len() / nx;
    let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    let more: Vec<f32> = (0..cells.len())
        .map(|i| {
            let (ix, iy) = (i % nx, i / nx);
            if !cells[i].is_ground() {
                return 0.0;
            }
            let near = around(iy, ny).flat_map(|y| around(ix, nx).map(move |x| (x, y)));
            let near = near.filter(|(x, y)| cells[y * nx + x].is_ground()).map(|(x, y)| {
                let cell = &cells[y * nx + x];
                let noise = f64::from(cell.variance_m2) - f64::from(cell.common_m2);
                ([x as f64 - ix as f64, y as f64 - iy as f64, f64::from(cell.height_m)], noise)
            });
            (share * share * relief_m2(near)) as f32
        })
        .collect();
    for (cell, more) in cells.iter_mut().zip(more) {
        cell.variance_m2 += more;
    }
}

/// Mean square distance of heights from their plane (m²), less their mean variance; with too few for a plane, from
/// their mean.
fn relief_m2(near: impl Iterator<Item = ([f64; 3], f64)>) -> f64 {
    let (mut n, mut mean, mut noise) = (0.0_f64, Vector3::zeros(), 0.0);
    let mut kept = [Vector3::zeros(); 9];
    for (i, ([x, y, z], variance)) in near.enumerate() {
        kept[i] = Vector3::new(x, y, z);
        (n, mean, noise) = (n + 1.0, mean + kept[i], noise + variance);
    }
    if n < 2.0 {
        return 0.0;
    }
    mean /= n;
    let spread: Matrix3<f64> =
        kept[..n as usize].iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let level = spread.fixed_view::<2, 2>(0, 0).into_owned();
    let rise = Vector2::new(spread[(0, 2)], spread[(1, 2)]);
    let (square, freedom) = match level.try_inverse().filter(|_| n >= 4.0) {
        Some(inverse) => (spread[(2, 2)] - rise.dot(&(inverse * rise)), n - 3.0),
        None => (spread[(2, 2)], n - 1.0),
    };
    (square / freedom - noise / n).max(0.0)
}

fn check(points: &[Measurement], options: &RasterizeOptions) -> Result<(), TerrainError> {
    let check = TerrainError::check;
    let c = options.resolution_m;
    check("resolution_m", c, [1e-3, 1e3], "a length from 0.001 to 1000 m")?;
    check("variance_max_m2", options.variance_max_m2, [1e-12, 1e4], "a variance up to 1e4 m²")?;
    check("correlated_points", options.correlated_points, [1.0, 1e6], "a number of 1 or more")?;
    check("relief_share", options.relief_share, [0.0, 10.0], "a share from 0 to 10")?;
    check("split_sigmas", options.split_sigmas, [1.0, 1e3], "a number from 1 to 1000")?;
    check("number of points", points.len() as f64, [1.0, POINTS_MAX as f64], "1 to 5e7 points")?;
    let limit = 0.5 * c * f64::from(INDEX_MAX);
    for (index, p) in points.iter().enumerate() {
        let values = [
            ("position_m.x", p.position_m.x, [-limit, limit]),
            ("position_m.y", p.position_m.y, [-limit, limit]),
            ("position_m.z", p.position_m.z, [-1e7, 1e7]),
            ("height_variance_m2", p.height_variance_m2, [1e-12, f64::INFINITY]),
            ("common_variance_m2", p.common_variance_m2, [0.0, 1e6]),
            ("footprint_m", p.footprint_m, [0.0, 1e3 * c]),
        ];
        for (field, value, [low, high]) in values {
            if !(value >= low && value <= high) {
                return Err(TerrainError::Point { index, field, value, low, high });
            }
        }
    }
    Ok(())
}

/// The height of a point (m), with its variances (m²).
struct Height {
    z: f64,
    variance: f64,
    common: f64,
}

/// The height of a cell (m), with its variances (m²).
struct Mean {
    height: f64,
    noise: f64,
    common: f64,
}

/// One cell from its points.
fn cell<'a>(
    points: impl Iterator<Item = &'a Measurement>,
    options: &RasterizeOptions,
    heights: &mut Vec<Height>,
) -> PairCell {
    heights.clear();
    let mut mask = Flags::NONE;
    for p in points {
        match p.tag {
            Tag::Terrain => heights.push(Height {
                z: p.position_m.z,
                variance: p.height_variance_m2,
                common: p.common_variance_m2,
            }),
            Tag::Robot => mask |= Flags::ROBOT,
            Tag::ShadowBand => mask |= Flags::SHADOW_BAND,
        }
    }
    if heights.is_empty() {
        return PairCell { flags: mask, ..PairCell::EMPTY };
    }
    heights.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.variance.total_cmp(&b.variance)));
    let upper = split(heights, options);
    let Mean { height, noise, common } = mean(&heights[upper..], options.correlated_points);
    let is_multi = upper > 0;
    let lower = if is_multi { mean(&heights[..upper], 1.0).height as f32 } else { f32::NAN };
    PairCell {
        height_m: height as f32,
        lower_m: lower,
        variance_m2: (noise + common) as f32,
        common_m2: common as f32,
        count: (heights.len() - upper).min(usize::from(u16::MAX)) as u16,
        flags: if is_multi { Flags::MULTI } else { Flags::NONE },
    }
}

/// Where the upper of two groups of sorted heights begins; 0 if there is one group.
fn split(heights: &[Height], options: &RasterizeOptions) -> usize {
    if heights.len() < 4 {
        return 0;
    }
    let sigma2 = heights.iter().map(|h| h.variance).sum::<f64>() / heights.len() as f64;
    let least = (options.split_sigmas * sigma2.sqrt()).max(0.5 * options.resolution_m);
    let gaps = (2..heights.len() - 1).map(|i| (heights[i].z - heights[i - 1].z, i));
    let widest = gaps.fold((least, 0), |best, gap| if gap.0 > best.0 { gap } else { best });
    widest.1
}

/// Weighted mean of heights, where `correlated` points have one error of matching. What is common to
/// all of them no mean lessens.
fn mean(heights: &[Height], correlated: f64) -> Mean {
    let (mut weight, mut sum, mut common) = (0.0, 0.0, 0.0);
    for h in heights {
        let w = 1.0 / h.variance;
        weight += w;
        sum += h.z * w;
        common += h.common.sqrt() * w;
    }
    Mean {
        height: sum / weight,
        noise: correlated.min(heights.len() as f64) / weight,
        common: (common / weight).powi(2),
    }
}
