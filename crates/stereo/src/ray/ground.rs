//! Rays against the triangulated surface of an elevation map.

use nalgebra::{Point3, Vector3};
use terrain::ElevationMap;

/// An elevation map with the highest ground of blocks of 2^k squares.
#[derive(Debug, Clone)]
pub(super) struct GroundRays {
    map: ElevationMap,
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    nx: usize,
    highest: Vec<f32>,
}

impl GroundRays {
    pub fn new(map: &ElevationMap) -> GroundRays {
        let grid = map.grid();
        let (mut nx, mut ny) = (grid.nx.saturating_sub(1), grid.ny.saturating_sub(1));
        let heights = map.heights();
        let mut highest = Vec::with_capacity(nx * ny);
        for iy in 0..ny {
            for ix in 0..nx {
                let corner = |dx: usize, dy: usize| *heights.at(ix + dx, iy + dy);
                // f32::max passes over what is unknown.
                let top = corner(0, 0).max(corner(1, 0)).max(corner(0, 1)).max(corner(1, 1));
                highest.push(if top.is_nan() { f32::NEG_INFINITY } else { top });
            }
        }
        let mut levels = vec![Level { nx, highest }];
        while nx > 1 || ny > 1 {
            let below = &levels[levels.len() - 1];
            let (wide, deep) = (nx.div_ceil(2), ny.div_ceil(2));
            let mut highest = vec![f32::NEG_INFINITY; wide * deep];
            for iy in 0..ny {
                for ix in 0..nx {
                    let to = &mut highest[iy / 2 * wide + ix / 2];
                    *to = to.max(below.highest[iy * nx + ix]);
                }
            }
            levels.push(Level { nx: wide, highest });
            (nx, ny) = (wide, deep);
        }
        GroundRays { map: map.clone(), levels }
    }

    /// Distance and normal of the first triangle along the ray within `reach`.
    pub fn hit(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        reach: f64,
    ) -> Option<(f64, Vector3<f64>)> {
        let grid = self.map.grid();
        let (nx, ny) = (grid.nx.checked_sub(1)?, grid.ny.checked_sub(1)?);
        if nx == 0 || ny == 0 {
            return None;
        }
        // In squares: position u0 + du t.
        let c = grid.resolution;
        let start = [(origin.x - grid.origin.x) / c, (origin.y - grid.origin.y) / c];
        let slope = [direction.x / c, direction.y / c];
        let (mut t, mut end) = (0.0_f64, reach);
        for ((start, slope), n) in start.into_iter().zip(slope).zip([nx, ny]) {
            let (a, b) = ((0.0 - start) / slope, (n as f64 - start) / slope);
            if slope == 0.0 {
                if !(0.0..=n as f64).contains(&start) {
                    return None;
                }
            } else {
                t = t.max(a.min(b));
                end = end.min(a.max(b));
            }
        }
        if t > end {
            return None;
        }
        let cell = |axis: usize, t: f64, low: usize, high: usize| {
            let at = (start[axis] + slope[axis] * t).floor();
            (at.max(low as f64) as usize).min(high)
        };
        let (mut ix, mut iy) = (cell(0, t, 0, nx - 1), cell(1, t, 0, ny - 1));
        let mut level = self.levels.len() - 1;
        loop {
            let (bx, by) = (ix >> level, iy >> level);
            let (x0, y0) = (bx << level, by << level);
            let (x1, y1) = ((x0 + (1 << level)).min(nx), (y0 + (1 << level)).min(ny));
            let leave = |axis: usize, low: usize, high: usize| match slope[axis] {
                s if s > 0.0 => (high as f64 - start[axis]) / s,
                s if s < 0.0 => (low as f64 - start[axis]) / s,
                _ => f64::INFINITY,
            };
            let (tx, ty) = (leave(0, x0, x1), leave(1, y0, y1));
            let out = tx.min(ty).min(end);
            let lowest = origin.z + direction.z * if direction.z < 0.0 { out } else { t };
            let Level { nx: wide, highest } = &self.levels[level];
            if lowest <= f64::from(highest[by * wide + bx]) {
                if level > 0 {
                    level -= 1;
                    continue;
                }
                if let Some(hit) = self.square(ix, iy, origin, direction, [t, out]) {
                    return Some(hit);
                }
            }
            if out >= end {
                return None;
            }
            // On to the next block, over the side that the ray leaves by.
            if tx <= ty {
                ix = if slope[0] > 0.0 { x1 } else { x0.wrapping_sub(1) };
                iy = cell(1, out, y0, y1 - 1);
            } else {
                iy = if slope[1] > 0.0 { y1 } else { y0.wrapping_sub(1) };
                ix = cell(0, out, x0, x1 - 1);
            }
            if ix >= nx || iy >= ny {
                return None;
            }
            t = out.max(t);
            level = (level + 1).min(self.levels.len() - 1);
        }
    }

    /// The nearer hit with the two triangles of a square within `span` of the ray.
    fn square(
        &self,
        ix: usize,
        iy: usize,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        span: [f64; 2],
    ) -> Option<(f64, Vector3<f64>)> {
        let grid = self.map.grid();
        let c = grid.resolution;
        let z = |dx: usize, dy: usize| f64::from(*self.map.heights().at(ix + dx, iy + dy));
        let (z10, z01) = (z(1, 0), z(0, 1));
        let corner = grid.position(ix, iy);
        let slack = 1e-9 * (1.0 + span[1]);
        // Height at the lower corner of the square, and slopes, of each triangle's plane.
        let (z00, z11) = (z(0, 0), z(1, 1));
        let planes = [(z00, z10 - z00, z01 - z00), (z10 + z01 - z11, z11 - z01, z11 - z10)];
        let mut best: Option<(f64, Vector3<f64>)> = None;
        for (upper, (base, dzx, dzy)) in planes.into_iter().enumerate() {
            let (gx, gy) = (dzx / c, dzy / c);
            let rate = direction.z - gx * direction.x - gy * direction.y;
            let above = origin.z - base - gx * (origin.x - corner.x) - gy * (origin.y - corner.y);
            let t = -above / rate;
            // What is unknown makes NaN, which fails here.
            if !(t >= span[0] - slack && t <= span[1] + slack && t >= 0.0) {
                continue;
            }
            let u = (origin.x + direction.x * t - corner.x) / c;
            let v = (origin.y + direction.y * t - corner.y) / c;
            let inside = if upper == 0 { u + v <= 1.0 + 1e-9 } else { u + v >= 1.0 - 1e-9 };
            if inside && best.is_none_or(|(least, _)| t < least) {
                best = Some((t, Vector3::new(-gx, -gy, 1.0).normalize()));
            }
        }
        best
    }
}
