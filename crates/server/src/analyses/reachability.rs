//! Where legs can stand.

use std::collections::BTreeMap;
use std::sync::Arc;

use geometry::{Grid, Raster};
use nalgebra::Point2;
use reachability::{
    Area, GroundClasses, Mend, Obstruction, ReachGrid, ReachOptions, WheelHeading, explain,
    reach_again, reach_legs,
};
use rover::LegId;
use stability::Preference;
use wire::analysis::{
    CellExplanation, CellExplanationRequest, CellMend, REACH_CLASSES, REACH_REASONS,
    ReachabilityAnswer, ReachabilityCells, ReachabilityLegend, ReachabilityRequest,
    StabilityPreference,
};
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::scene::Scene as WireScene;

use crate::scene::{Context, Scene};
use crate::stop::Stop;
use crate::terrain_store::Version;

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
    asked(context, request, workers, stop, |scene, legs, options| {
        let (solid, configuration) = (&scene.solid, &scene.configuration);
        reach_legs(solid, configuration, scene.gravity, legs, options, &|| stop.asked())
    })
}

/// The same for one leg, given the answer `before` on ground that was the same outside of `changed`: to
/// the bit what all anew would give.
pub fn reachability_again(
    context: &Context,
    request: &ReachabilityRequest,
    before: &ReachabilityCells,
    changed: &Area,
    stop: &Stop,
) -> Result<Reached, RequestError> {
    asked(context, request, 1, stop, |scene, legs, options| {
        let (solid, configuration) = (&scene.solid, &scene.configuration);
        let (before, stop) = (grid(before)?, || stop.asked());
        let again = |leg: &LegId| {
            let (gravity, leg) = (scene.gravity, *leg);
            reach_again(&before, changed, solid, configuration, gravity, leg, options, &stop)
        };
        legs.iter().map(again).collect()
    })
}

/// The legs that a request is about, in what it asks for.
fn asked(
    context: &Context,
    request: &ReachabilityRequest,
    workers: usize,
    stop: &Stop,
    reach: impl FnOnce(&Scene, &[LegId], &ReachOptions) -> Option<Vec<ReachGrid>>,
) -> Result<Reached, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    let robot = scene.robot();
    let asked = Asked {
        lift_m: request.lift_m,
        stability: request.stability,
        unsafe_ground: request.unsafe_ground,
        wheel_heading_rad: request.wheel_heading_rad,
    };
    let ground = Ground::of(context, &request.scene);
    let options = asked.options(&scene, ground.as_ref())?;
    let resolution_m = request.resolution_m.unwrap_or(RESOLUTION_M * robot.scale());
    let resolution = check::within(&At::root("resolution_m"), resolution_m, [0.001, 10.0], " m")?;
    let options = ReachOptions { resolution, workers, ..options };
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
    match reach(&scene, &legs, &options) {
        Some(grids) => Ok(names.into_iter().zip(grids.iter().map(cells)).collect()),
        None => {
            stop.check()?;
            let text = "is too fine: the leg's reach would have more than 1 000 000 cells";
            Err(RequestError::at("too_many", &At::root("resolution_m"), text))
        }
    }
}

/// What reachability and the explanation of a cell are asked alike.
struct Asked {
    lift_m: Option<f64>,
    stability: StabilityPreference,
    unsafe_ground: bool,
    wheel_heading_rad: Option<f64>,
}

impl Asked {
    fn options<'a>(
        &self,
        scene: &Scene,
        ground: Option<&'a Ground>,
    ) -> Result<ReachOptions<'a>, RequestError> {
        let lift_m = self.lift_m.unwrap_or(LIFT_M * scene.robot().scale());
        let heading = match self.wheel_heading_rad {
            None => WheelHeading::Free,
            Some(yaw) => {
                let at = At::root("wheel_heading_rad");
                WheelHeading::Fixed(check::within(&at, yaw, [-10.0, 10.0], " rad")?)
            }
        };
        Ok(ReachOptions {
            lift: check::within(&At::root("lift_m"), lift_m, LIFT_RANGE_M, " m")?,
            preference: preference(self.stability),
            friction: scene.friction,
            heading,
            ground: ground.filter(|_| !self.unsafe_ground).and_then(Ground::classes),
            ..ReachOptions::default()
        })
    }
}

/// The server's own map, if it is the ground of a request.
struct Ground(Arc<Version>);

impl Ground {
    fn of(context: &Context, scene: &WireScene) -> Option<Ground> {
        let live = context.live.as_ref().filter(|_| scene.terrain.is_none())?;
        Some(Ground(live.version.clone()))
    }

    /// Its traversability, if it has been computed.
    fn classes(&self) -> Option<GroundClasses<'_>> {
        let layers = self.0.layers().ok()?;
        Some(GroundClasses { layers, unsafe_below: self.0.unsafe_below() })
    }
}

/// Why a leg can not stand at a place, and what would help.
pub fn explain_cell(
    context: &Context,
    request: &CellExplanationRequest,
) -> Result<CellExplanation, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    let robot = scene.robot();
    let leg = convert::leg(&At::root("leg"), robot, &request.leg)?;
    let asked = Asked {
        lift_m: request.lift_m,
        stability: request.stability,
        unsafe_ground: request.unsafe_ground,
        wheel_heading_rad: request.wheel_heading_rad,
    };
    let ground = Ground::of(context, &request.scene);
    let options = asked.options(&scene, ground.as_ref())?;
    let [x, y] = request.position_m;
    check::position(&At::root("position_m"), [x, y, 0.0])?;
    let (solid, configuration) = (&scene.solid, &scene.configuration);
    let p = Point2::new(x, y);
    let found = explain(solid, configuration, scene.gravity, leg, p, &options)
        .ok_or_else(|| RequestError::at("not_finite", &At::root("position_m"), "is no place"))?;
    let (obstruction, obstruction_at_m) = found.obstruction.as_ref().map_or((None, None), named);
    Ok(CellExplanation {
        class: REACH_CLASSES[found.class as usize].into(),
        reason: REACH_REASONS[found.reason as usize].into(),
        missing: found.missing,
        margin_m: found.margin_m,
        obstruction,
        obstruction_at_m,
        mends: found.mends.iter().map(mend).collect(),
        text: found.text,
    })
}

/// What stands in the way, and where.
fn named(obstruction: &Obstruction) -> (Option<String>, Option<[f64; 3]>) {
    let text = match obstruction {
        Obstruction::Joint { joint, overrun } => {
            format!("{joint} would be {overrun:.2} rad beyond its limit")
        }
        Obstruction::Torque { joint, ratio } => {
            format!("{joint} would bear {:.0} % of its torque limit", 100.0 * ratio.abs())
        }
        Obstruction::Bodies { link, other, distance, required, lifted, .. } => {
            let place = if *lifted { " at the waypoint above" } else { "" };
            format!("{link} would be {distance:.2} m from {other}{place}; {required:.2} m are kept")
        }
        Obstruction::Stance { text, .. } => text.clone(),
    };
    let at = match obstruction {
        Obstruction::Bodies { place, .. } => Some(convert::point(place)),
        _ => None,
    };
    (Some(text), at)
}

fn mend(mend: &Mend) -> CellMend {
    match mend {
        Mend::Shift(by) => CellMend { shift_m: Some((*by).into()), place_m: None },
        Mend::Place { at, .. } => CellMend { shift_m: None, place_m: Some([at.x, at.y]) },
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

/// The cells as an answer of the domain; `None` if they are not as many as their size says.
fn grid(cells: &ReachabilityCells) -> Option<ReachGrid> {
    let ([x, y], [nx, ny]) = (cells.origin_m, cells.size);
    let grid = Grid { origin: Point2::new(x, y), resolution: cells.resolution_m, nx, ny };
    Some(ReachGrid {
        class: Raster::new(grid, cells.class.clone())?,
        reason: Raster::new(grid, cells.reason.clone())?,
        missing: Raster::new(grid, cells.missing.clone())?,
        margin: Raster::new(grid, cells.margin.clone())?,
    })
}

/// As JSON has it.
pub fn reachability_answer(reached: &Reached) -> ReachabilityAnswer {
    let legs: BTreeMap<_, _> =
        reached.iter().map(|(name, cells)| (name.clone(), cells.to_grid())).collect();
    ReachabilityAnswer { legs, legend: ReachabilityLegend::new() }
}

/// The preference of a request, in the domain's terms.
pub fn preference(preference: StabilityPreference) -> Preference {
    match preference {
        StabilityPreference::Regular => Preference::Regular,
        StabilityPreference::Conservative => Preference::Conservative,
        StabilityPreference::Friction => Preference::Friction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reachability::{CellClass, Reason};

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
        // Behind those of the domain are what the server finds by planning.
        assert_eq!(REACH_REASONS[Reason::ALL.len()..], ["no_plan"]);
        assert_eq!(REACH_CLASSES[CellClass::ALL.len()..], ["plannable", "not_plannable"]);
    }
}
