//! By how much the pairs of one stand are off each other, and all of them off the map.
//!
//! All pairs are solved for at once, where they overlap each other or the map: point to plane as in
//! [`align`](super::align()), Gauss-Newton over four unknowns a pair. One after another, each would be
//! bent to the pair before it, and the last would close the ring with the sum of all errors. Before
//! anything is seen, the pairs are expected to be off *together*, as the place of the rover is not
//! well known, and only little off each other, as far as their mounting goes. What a
//! pair has in common ([`PairCell::common_m2`](super::PairCell::common_m2)) bounds what its many cells can say.

use nalgebra::{DMatrix, DVector, Matrix4, Point2, Point3, Vector4};

use super::align::{self, AlignSettings, Alignment, Correction, Plane, Refusal};
use super::{Flags, MapVersion, PairDem};
use crate::TerrainError;

const ITERATIONS: usize = 12;
/// Steps below this (m, rad) end the search.
const STEP_MIN: f64 = 1e-5;
/// Most pairs at once.
const PAIRS_MAX: usize = 64;

/// Aligns pairs that were taken from one place to each other and to the map. A pair whose correction
/// would be out of bounds, or that has too little in common with anything, stays where it says it is,
/// and the others are fitted without it.
pub fn align_together(
    dems: &[&PairDem],
    map: &MapVersion,
    settings: &AlignSettings,
) -> Result<Vec<Alignment>, TerrainError> {
    settings.check()?;
    let n = dems.len();
    TerrainError::check("number of pairs", n as f64, [0.0, PAIRS_MAX as f64], "at most 64 pairs")?;
    let points: Vec<Vec<Seen>> = dems.iter().map(|dem| seen(dem, settings.cells_max)).collect();
    let n_points = points.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let center = points.iter().flatten().fold(Point3::origin(), |sum, p| sum + p.at.coords);
    let about_m = Point2::from(center.coords.xy() / n_points);
    let start = Correction { about_m, ..Correction::NONE };
    let mut alignments = vec![Alignment::NONE; n];
    let mut is_in = vec![true; n];
    loop {
        let mut links = Links::new(dems, &points, map, &is_in);
        let cells = links.cells(n);
        let needed = settings.cells_min.min(settings.cells_max);
        let lonely = (0..n).filter(|i| is_in[*i] && cells[*i] < needed).min_by_key(|i| cells[*i]);
        if let Some(i) = lonely {
            is_in[i] = false;
            let refusal = Some(Refusal::TooFewCells { cells: cells[i], needed });
            alignments[i] = Alignment { cells: cells[i], refusal, ..Alignment::NONE };
            continue;
        }
        if !is_in.contains(&true) {
            return Ok(alignments);
        }
        let mut at = vec![start; n];
        let before = links.fit(dems, &points, map, &at, settings);
        let mut inverse = None;
        for _ in 0..ITERATIONS {
            let found = links.fit(dems, &points, map, &at, settings);
            let (normal, right) = with_prior(&found, &at, &is_in, settings);
            let Some(inverted) = normal.try_inverse() else { break };
            let step = &inverted * right;
            for (i, at) in at.iter_mut().enumerate().filter(|(i, _)| is_in[*i]) {
                let step = step.fixed_rows::<4>(4 * i);
                at.translation_m += step.xyz();
                at.yaw_rad += step.w;
            }
            inverse = Some(inverted);
            if !step.iter().all(|v| v.is_finite()) || step.amax() < STEP_MIN {
                break;
            }
        }
        let beyond = |i: &usize| {
            let at = &at[*i];
            let share = at.translation_m.norm() / settings.shift_max_m.max(1e-9);
            share.max(at.yaw_rad.abs() / settings.yaw_max_rad.max(1e-9))
        };
        let fits = |i: &usize| beyond(i) <= 1.0;
        let out = (0..n).filter(|i| is_in[*i] && !fits(i));
        if let Some(i) = out.max_by(|a, b| beyond(a).total_cmp(&beyond(b))) {
            is_in[i] = false;
            let (shift_m, yaw_rad) = (at[i].translation_m.norm(), at[i].yaw_rad);
            let refusal = Some(Refusal::OutOfBounds { shift_m, yaw_rad });
            alignments[i] = Alignment { cells: cells[i], refusal, ..Alignment::NONE };
            continue;
        }
        let after = links.fit(dems, &points, map, &at, settings);
        let is_worse = after.cost > before.cost;
        for i in (0..n).filter(|i| is_in[*i]) {
            let sigma = |k: usize| {
                let variance =
                    inverse.as_ref().map_or(0.0, |inverse| inverse[(4 * i + k, 4 * i + k)]);
                variance.max(0.0).sqrt()
            };
            alignments[i] = Alignment {
                correction: if is_worse { Correction::NONE } else { at[i] },
                residual_before: before.rms[i],
                residual_after: if is_worse { before.rms[i] } else { after.rms[i] },
                cells: cells[i],
                sigma: [0, 1, 2, 3].map(sigma),
                refusal: is_worse.then_some(Refusal::ResidualGrows),
                is_chosen: false,
            };
        }
        return Ok(alignments);
    }
}

/// Plain ground of a pair.
struct Seen {
    at: Point3<f64>,
    /// Of its height: noise, and what the pair has in common (m²).
    own: f64,
    common: f64,
}

fn seen(dem: &PairDem, most: usize) -> Vec<Seen> {
    let c = dem.resolution_m();
    let plain = || dem.indexed().filter(|(_, cell)| cell.is_ground() && cell.flags == Flags::NONE);
    let stride = plain().count().div_ceil(most.max(1)).max(1);
    let of = |([ix, iy], cell): ([i32; 2], &super::PairCell)| {
        let z = f64::from(cell.height_m);
        let common = f64::from(cell.common_m2);
        let own = (f64::from(cell.variance_m2) - common).max(1e-9);
        Seen { at: Point3::new(c * f64::from(ix), c * f64::from(iy), z), own, common }
    };
    plain().step_by(stride).map(of).collect()
}

/// Which points of which pair lie on ground of which other one, or of the map.
struct Links(Vec<Link>);

struct Link {
    of: usize,
    /// The other pair; none for the map.
    on: Option<usize>,
    points: Vec<u32>,
}

struct Fit {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// Robust RMS residual of each pair (standard deviations).
    rms: Vec<f64>,
    cost: f64,
}

impl Links {
    fn new(dems: &[&PairDem], points: &[Vec<Seen>], map: &MapVersion, is_in: &[bool]) -> Links {
        let mut links = Vec::new();
        for (i, own) in points.iter().enumerate().filter(|(i, _)| is_in[*i]) {
            for on in (i + 1..dems.len()).filter(|j| is_in[*j]).map(Some).chain([None]) {
                let is_on = |p: &&Seen| match on {
                    Some(j) => align::plane(&of_dem(dems[j]), dems[j].resolution_m(), p.at.xy()),
                    None => align::plane(&align::of_map(map), map.resolution_m(), p.at.xy()),
                };
                let numbered = own.iter().enumerate().filter(|(_, p)| is_on(p).is_some());
                let points: Vec<u32> = numbered.map(|(k, _)| k as u32).collect();
                if !points.is_empty() {
                    links.push(Link { of: i, on, points });
                }
            }
        }
        Links(links)
    }

    /// Cells of each pair that were compared with anything.
    fn cells(&self, n: usize) -> Vec<usize> {
        let mut cells = vec![0; n];
        for link in &self.0 {
            for i in [Some(link.of), link.on].into_iter().flatten() {
                cells[i] += link.points.len();
            }
        }
        cells
    }

    fn fit(
        &mut self,
        dems: &[&PairDem],
        points: &[Vec<Seen>],
        map: &MapVersion,
        at: &[Correction],
        settings: &AlignSettings,
    ) -> Fit {
        let n = at.len();
        let mut fit = Fit {
            normal: DMatrix::zeros(4 * n, 4 * n),
            right: DVector::zeros(4 * n),
            rms: vec![0.0; n],
            cost: 0.0,
        };
        let mut counts = vec![0.0_f64; n];
        for link in &self.0 {
            let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
            let (mut own, mut common, mut m, mut cost) = (0.0, 0.0, 0.0, 0.0);
            for k in &link.points {
                let p = &points[link.of][*k as usize];
                let moved = at[link.of].apply(p.at);
                let on = match link.on {
                    Some(j) => {
                        let q = at[j].undo_xy(moved.xy());
                        let plane = align::plane(&of_dem(dems[j]), dems[j].resolution_m(), q);
                        plane.map(|plane| Plane {
                            height: plane.height + at[j].translation_m.z,
                            ..plane
                        })
                    }
                    None => align::plane(&align::of_map(map), map.resolution_m(), moved.xy()),
                };
                let Some(plane) = on else { continue };
                let [a, b] = plane.gradient;
                let residual = plane.height - moved.z;
                let own_here = p.own + (plane.variance - plane.common).max(0.0);
                let off = residual.abs() / (own_here + p.common + plane.common).sqrt();
                let weight = if off > align::HUBER { align::HUBER / off } else { 1.0 };
                let arm = moved.xy() - at[link.of].about_m;
                let j = Vector4::new(-a, -b, 1.0, a * arm.y - b * arm.x);
                let w = weight / own_here;
                normal += w * j * j.transpose();
                right += w * residual * j;
                own += own_here;
                common += p.common + plane.common;
                m += 1.0;
                let h = align::HUBER;
                cost += if off > h { h * (2.0 * off - h) } else { off * off };
            }
            if m == 0.0 {
                continue;
            }
            // The mean of so many cells is as sure as their noise allows, and what they share.
            let noise = own / m * settings.correlated_cells.min(m) / m;
            let share = noise / (noise + common / m) / settings.correlated_cells.min(m);
            let (i, j) = (4 * link.of, link.on.map(|j| 4 * j));
            let mut add = |row: usize, column: usize, sign: f64| {
                let mut block = fit.normal.fixed_view_mut::<4, 4>(row, column);
                block += sign * share * normal;
            };
            add(i, i, 1.0);
            if let Some(j) = j {
                add(j, j, 1.0);
                add(i, j, -1.0);
                add(j, i, -1.0);
            }
            let mut add = |row: usize, sign: f64| {
                let mut block = fit.right.fixed_rows_mut::<4>(row);
                block += sign * share * right;
            };
            add(i, 1.0);
            if let Some(j) = j {
                add(j, -1.0);
            }
            fit.cost += cost * share;
            for i in [Some(link.of), link.on].into_iter().flatten() {
                fit.rms[i] += cost;
                counts[i] += m;
            }
        }
        for (rms, count) in fit.rms.iter_mut().zip(counts) {
            *rms = (*rms / count.max(1.0)).sqrt();
        }
        fit
    }
}

/// What is expected before anything is seen: for each unknown a pair's own part and one of all pairs.
fn with_prior(
    fit: &Fit,
    at: &[Correction],
    is_in: &[bool],
    settings: &AlignSettings,
) -> (DMatrix<f64>, DVector<f64>) {
    let (mut normal, mut right) = (fit.normal.clone(), fit.right.clone());
    let n = is_in.iter().filter(|is_in| **is_in).count() as f64;
    let shift = (settings.pair_shift_sigma_m, settings.shift_sigma_m);
    let yaw = (settings.pair_yaw_sigma_rad, settings.yaw_sigma_rad);
    for (k, (own, all)) in [shift, shift, shift, yaw].into_iter().enumerate() {
        let (own, all) = (own * own, all * all);
        // Inverse of own I + all 1 1' (Sherman and Morrison).
        let shared = all / (own * (own + n * all));
        let value = |i: usize| {
            let at = &at[i];
            [at.translation_m.x, at.translation_m.y, at.translation_m.z, at.yaw_rad][k]
        };
        let total: f64 = (0..at.len()).filter(|i| is_in[*i]).map(value).sum();
        for i in 0..at.len() {
            let row = 4 * i + k;
            if !is_in[i] {
                // Not asked: stays zero.
                normal[(row, row)] = 1.0;
                continue;
            }
            for j in (0..at.len()).filter(|j| is_in[*j]) {
                let diagonal = if i == j { 1.0 / own } else { 0.0 };
                normal[(row, 4 * j + k)] += diagonal - shared;
            }
            right[row] -= value(i) / own - shared * total;
        }
    }
    (normal, right)
}

fn of_dem(dem: &PairDem) -> impl Fn([i32; 2]) -> Option<[f64; 3]> + '_ {
    move |index| {
        let cell = dem.at(index);
        let is_plain = cell.is_ground() && cell.flags == Flags::NONE;
        is_plain.then(|| [cell.height_m, cell.variance_m2, cell.common_m2].map(f64::from))
    }
}
