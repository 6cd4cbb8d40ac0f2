//! Which of the cells that a leg can reach a step can really be planned to.

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

/// Plans a step of the live rover to every reachable cell, the nearest to where the wheel stands
/// first, and marks the cells one by one; `told` hears of each how far the work is (0 to 1).
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
    let mut wanted: Vec<(f64, usize)> = (0..cells.class.len())
        .filter(|i| cells.class[*i] == REACHABLE)
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
