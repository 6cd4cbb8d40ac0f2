//! Which of the cells that a leg can reach a step can really be planned to.
//!
//! A plan takes far longer than a cell, and cells are finer than plans are of use: one reachable cell of each
//! square of `SPACING_M` is planned to and speaks for its square. Its neighbors stay `reachable`.

use std::collections::BTreeMap;

use nalgebra::Point3;
use wire::analysis::{
    NO_PLAN, NOT_PLANNABLE, PLANNABLE, REACHABLE, ReachabilityCells, StabilityPreference,
};
use wire::check::{At, RequestError};
use wire::convert;
use wire::scene::Scene as WireScene;

use super::{is_plannable, preference};
use crate::scene::Context;
use crate::stop::Stop;

/// Side of the squares of cells of which one is planned to, for a robot of scale 1 (m).
const SPACING_M: f64 = 0.1;

/// Plans a step of the live rover to one reachable cell of each square of `SPACING_M`, the nearest to
/// where the wheel stands first, and marks the cells one by one; `told` hears of each how far the work is
/// (0 to 1).
pub fn plannable(
    context: &Context,
    leg: &str,
    stability: StabilityPreference,
    mut cells: ReachabilityCells,
    stop: &Stop,
    told: &mut dyn FnMut(f64, &ReachabilityCells),
) -> Result<(), RequestError> {
    let scene = context.scene(&At::root("scene"), &WireScene::default())?;
    let id = convert::leg(&At::root("leg"), scene.robot(), leg)?;
    let preference = preference(stability);
    let posture = rover::Posture::new(scene.robot(), &scene.configuration);
    let foot = posture.wheel(scene.robot(), id).center();
    let place = |i: usize, cells: &ReachabilityCells| {
        let [x, y] = [i % cells.size[0], i / cells.size[0]].map(|n| n as f64 * cells.resolution_m);
        Point3::new(cells.origin_m[0] + x, cells.origin_m[1] + y, 0.0)
    };
    let mut wanted: Vec<(f64, usize)> = to_plan(&cells, SPACING_M * scene.robot().scale())
        .into_iter()
        .map(|i| ((place(i, &cells) - foot).xy().norm(), i))
        .collect();
    wanted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = wanted.len().max(1) as f64;
    for (done, (_, i)) in wanted.into_iter().enumerate() {
        let Some(found) = is_plannable(&scene, id, place(i, &cells), preference, stop) else {
            return stop.check();
        };
        if found {
            cells.class[i] = PLANNABLE;
        } else {
            (cells.class[i], cells.reason[i]) = (NOT_PLANNABLE, NO_PLAN);
        }
        told((done + 1) as f64 / n, &cells);
    }
    Ok(())
}

/// The cells to plan to: of each square with sides of about `spacing` (m) the cell nearest to its middle
/// that can be reached. Squares whose cell was planned to before are done.
fn to_plan(cells: &ReachabilityCells, spacing: f64) -> Vec<usize> {
    let n = (spacing / cells.resolution_m).round().max(1.0) as usize;
    let mut nearest: BTreeMap<(usize, usize), (usize, usize)> = BTreeMap::new();
    for (i, class) in cells.class.iter().enumerate() {
        if ![REACHABLE, PLANNABLE, NOT_PLANNABLE].contains(class) {
            continue;
        }
        let (ix, iy) = (i % cells.size[0], i / cells.size[0]);
        // Twice the distance from the middle, squared: whole numbers, so equals go by their order.
        let off = |i: usize| (2 * (i % n) + 1).abs_diff(n);
        let far = off(ix).pow(2) + off(iy).pow(2);
        let best = nearest.entry((iy / n, ix / n)).or_insert((far, i));
        *best = (*best).min((far, i));
    }
    let cells_of = nearest.into_values().map(|(_, i)| i);
    cells_of.filter(|i| cells.class[*i] == REACHABLE).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_cell_of_each_square_is_planned_to_and_the_nearest_to_its_middle() {
        let size = [12, 10];
        let n = size[0] * size[1];
        let mut cells = ReachabilityCells {
            origin_m: [0.0; 2],
            resolution_m: 0.02,
            size,
            class: vec![REACHABLE; n],
            reason: vec![0; n],
            missing: vec![f32::NAN; n],
            margin: vec![0.0; n],
        };
        let at = |ix: usize, iy: usize| iy * size[0] + ix;
        // Squares of five cells; the last column of squares is cut off after two.
        let all = [at(2, 2), at(7, 2), at(11, 2), at(2, 7), at(7, 7), at(11, 7)];
        assert_eq!(to_plan(&cells, 0.1), all);
        // A refused middle: the first of the nearest stands for the square.
        cells.class[at(7, 7)] = 2;
        assert_eq!(to_plan(&cells, 0.1), [all[0], all[1], all[2], all[3], at(7, 6), all[5]]);
        // A square that was planned to is done, and one where nothing can be reached has no cell.
        (cells.class[all[0]], cells.class[all[1]]) = (PLANNABLE, NOT_PLANNABLE);
        for i in 0..25 {
            cells.class[at(i % 5, 5 + i / 5)] = 1;
        }
        assert_eq!(to_plan(&cells, 0.1), [all[2], at(7, 6), all[5]]);
        // Cells as wide as the squares, or wider, are all planned to.
        cells.resolution_m = 0.25;
        let open = cells.class.iter().filter(|class| **class == REACHABLE).count();
        assert_eq!(to_plan(&cells, 0.1).len(), open);
    }
}
