//! Where legs can stand.

use std::collections::BTreeMap;

use reachability::{ReachGrid, ReachOptions, reach};
use stability::Preference;
use wire::analysis::{
    ReachabilityAnswer, ReachabilityCells, ReachabilityLegend, ReachabilityRequest,
    StabilityPreference,
};
use wire::check::{self, At, RequestError};
use wire::convert;

use crate::scene::{Context, Scene};
use crate::stop::Stop;

/// Lift where the request gives none, for a robot of scale 1 (m).
pub const LIFT_M: f64 = 0.2;
/// Distance between cells where the request gives none, for a robot of scale 1 (m).
const RESOLUTION_M: f64 = 0.1;
/// Range of the lift (m).
pub const LIFT_RANGE_M: [f64; 2] = [0.0, 2.0];

/// Each leg with its cells, in the order asked for.
pub type Reached = Vec<(String, ReachabilityCells)>;

/// Where each leg can stand, computed by `workers` threads.
pub fn reachability(
    context: &Context,
    request: &ReachabilityRequest,
    workers: usize,
    stop: &Stop,
) -> Result<Reached, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    let robot = scene.robot();
    let scale = robot.scale();
    let resolution_m = request.resolution_m.unwrap_or(RESOLUTION_M * scale);
    let resolution = check::within(&At::root("resolution_m"), resolution_m, [0.001, 10.0], " m")?;
    let lift_m = request.lift_m.unwrap_or(LIFT_M * scale);
    let lift = check::within(&At::root("lift_m"), lift_m, LIFT_RANGE_M, " m")?;
    let preference = preference(&At::root("stability"), request.stability)?;
    let options = ReachOptions { resolution, lift, preference, workers, ..ReachOptions::default() };
    let names = match &request.legs {
        Some(names) => names.clone(),
        None => robot.legs().iter().map(|leg| leg.name.clone()).collect(),
    };
    let at = At::root("legs");
    check::not_empty(&at, names.len())?;
    check::at_most(&at, names.len(), robot.legs().len())?;
    let legs = names.iter().enumerate();
    let legs: Vec<_> =
        legs.map(|(i, name)| convert::leg(&at.index(i), robot, name)).collect::<Result<_, _>>()?;
    names
        .into_iter()
        .zip(legs)
        .map(|(name, leg)| Ok((name, of_leg(&scene, leg, &options, stop)?)))
        .collect()
}

fn of_leg(
    scene: &Scene,
    leg: rover::LegId,
    options: &ReachOptions,
    stop: &Stop,
) -> Result<ReachabilityCells, RequestError> {
    let asked = || stop.asked();
    let grid = reach(&scene.solid, &scene.configuration, scene.gravity, leg, options, &asked);
    match grid {
        Some(grid) => Ok(cells(&grid)),
        None => {
            stop.check()?;
            let text = "is too fine: the leg's reach would have more than 1 000 000 cells";
            Err(RequestError::at("too_many", &At::root("resolution_m"), text))
        }
    }
}

fn cells(grid: &ReachGrid) -> ReachabilityCells {
    let place = grid.grid();
    ReachabilityCells {
        origin_m: [place.origin.x, place.origin.y],
        resolution_m: place.resolution,
        size: [place.nx, place.ny],
        class: grid.class.values().to_vec(),
        reason: grid.reason.values().to_vec(),
        missing: grid.missing.values().to_vec(),
        margin: grid.margin.values().to_vec(),
    }
}

/// As JSON has it.
pub fn reachability_answer(reached: &Reached) -> ReachabilityAnswer {
    let legs: BTreeMap<_, _> =
        reached.iter().map(|(name, cells)| (name.clone(), cells.to_grid())).collect();
    ReachabilityAnswer { legs, legend: ReachabilityLegend::new() }
}

/// The preference of a request, in the domain's terms.
pub fn preference(
    at: &At<'_>,
    preference: StabilityPreference,
) -> Result<Preference, RequestError> {
    match preference {
        StabilityPreference::Regular => Ok(Preference::Regular),
        StabilityPreference::Conservative => Ok(Preference::Conservative),
        StabilityPreference::Friction => {
            let text = "is \"friction\", which this version does not do; take \"regular\" or \
                        \"conservative\"";
            Err(RequestError::at("not_supported", at, text))
        }
    }
}

#[cfg(test)]
mod tests {
    use reachability::{CellClass, Reason};
    use wire::analysis::{REACH_CLASSES, REACH_REASONS};

    #[test]
    fn the_names_on_the_wire_are_those_of_the_domain() {
        let class = |class: CellClass| REACH_CLASSES[class as usize];
        assert_eq!(class(CellClass::NoLift), "no_lift");
        assert_eq!(class(CellClass::Reachable), "reachable");
        assert_eq!(class(CellClass::Colliding), "colliding");
        let reason = |reason: Reason| REACH_REASONS[reason as usize];
        assert_eq!(reason(Reason::OutOfReach), "out_of_reach");
        assert_eq!(reason(Reason::Settlement), "settlement");
        assert_eq!(reason(Reason::LiftCollides), "lift_collision");
        assert_eq!(reason(Reason::StartLift), "start_lift");
        assert_eq!(reason(Reason::Traversability), "traversability");
        assert_eq!(Reason::ALL.len(), REACH_REASONS.len());
        assert_eq!(CellClass::ALL.len(), REACH_CLASSES.len());
    }
}
