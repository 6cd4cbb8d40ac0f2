//! The body shift: the chassis moves over its planted wheels until a leg may be lifted.
//!
//! All wheels on the ground keep their places (brakes on, H22-H29 with closed-form legs), so a shift
//! is a way of the chassis' six numbers. The search looks for the smallest motion of the chassis
//! after which the margin rule holds on the feet that stay, with some to spare; all along the way it
//! must hold on all feet. What is executed is linear in the joints between knots: see
//! [`base_between`] for where the chassis then is. Frame `world`, meters, radians.

mod barrier;
mod body;
mod chain;
mod executed;
mod reach;
mod search;
mod wanted;

use collision::Scene;
use nalgebra::{Isometry3, Point3};
use rover::{Configuration, LegId};
use stability::Preference;

pub use barrier::Barrier;
pub use body::{BodyClear, CertifiedBody, SampledBody};
pub use executed::{Executed, base_between, closure_error};

use crate::footing::Footing;
use crate::watch::Watch;
pub(crate) use chain::ClosedChain;
pub(crate) use reach::{Reached, Shift};
pub(crate) use wanted::Wanted;

/// How far standing wheels may leave their places between knots (m at scale 1).
pub(crate) const CLOSURE: f64 = 0.002;

/// A wish for a body shift.
#[derive(Clone)]
pub struct ShiftRequest<'a> {
    /// Robot, ground and obstacles.
    pub scene: &'a Scene,
    /// Where the robot is; its wheels close the chain.
    pub start: &'a Configuration,
    /// All legs on the ground, with their contacts in `world` (m).
    pub standing: &'a [(LegId, Point3<f64>)],
    /// The leg to be lifted afterwards; its foot does not count as support at the end.
    pub lifted: LegId,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// Coefficient of friction under all feet, for [`Preference::Friction`].
    pub friction: f64,
    /// What the end must have to spare beyond the rule (m).
    pub wanted_spare: f64,
    /// Wheel drives hold the wheels while the forks pitch, instead of brakes.
    pub drive_hold: bool,
    /// How far wheels may leave their places between knots (m).
    pub closure: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Poses of the chassis that may be looked at.
    pub budget: usize,
}

impl<'a> ShiftRequest<'a> {
    /// A request with the defaults: 2 cm (scaled) to spare, wheels within 2 mm (scaled), brakes on.
    pub fn new(
        scene: &'a Scene,
        start: &'a Configuration,
        standing: &'a [(LegId, Point3<f64>)],
        lifted: LegId,
    ) -> ShiftRequest<'a> {
        let scale = scene.robot().scale();
        ShiftRequest {
            scene,
            start,
            standing,
            lifted,
            preference: Preference::Regular,
            friction: 0.7,
            wanted_spare: 0.02 * scale,
            drive_hold: false,
            closure: CLOSURE * scale,
            seed: 1,
            budget: 40_000,
        }
    }
}

/// Which way the chassis may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Freedom {
    /// To all sides, keeping its height and its attitude.
    Level,
    /// In all six directions.
    #[default]
    Whole,
}

impl Freedom {
    fn n_axes(self) -> usize {
        match self {
            Freedom::Level => 2,
            Freedom::Whole => 6,
        }
    }
}

/// A shift that may be executed.
#[derive(Debug, Clone, PartialEq)]
pub struct ShiftPlan {
    /// Knots with the start first; linear in the joints between them. One knot alone: nothing needs
    /// to move.
    pub configurations: Vec<Configuration>,
    /// Farthest that a wheel leaves its place on the way (m, sampled).
    pub closure_error: f64,
    /// What the feet that stay have to spare at the end (m).
    pub spare: f64,
}

/// Why there is no shift.
#[derive(Debug, Clone, PartialEq)]
pub struct NoShift {
    /// The most that the feet that stay have to spare in any pose found (m); negative infinity
    /// where no pose would do.
    pub best_spare: f64,
    /// That pose of the chassis, in `world`.
    pub pose: Isometry3<f64>,
    /// What stands in the way of more, in a sentence.
    pub why: String,
}

/// Finds the smallest motion of the chassis over its planted wheels after which `lifted` may be
/// lifted. Deterministic for the same request, unless `watch` stops it.
pub fn plan_shift(
    request: &ShiftRequest,
    body: &mut impl BodyClear,
    watch: &mut impl Watch,
) -> Result<ShiftPlan, NoShift> {
    let robot = request.scene.robot().as_ref();
    let none = |why: &str| NoShift {
        best_spare: f64::NEG_INFINITY,
        pose: request.start.world_from_base,
        why: why.into(),
    };
    let n_legs = robot.legs().len();
    if request.start.legs.len() != n_legs || request.standing.iter().any(|(l, _)| l.0 >= n_legs) {
        return Err(none("the request names legs that the robot does not have"));
    }
    let contacts: Vec<Point3<f64>> = request.standing.iter().map(|(_, p)| *p).collect();
    let mut staying = request.standing.to_vec();
    staying.retain(|(leg, _)| *leg != request.lifted);
    let footing = Footing {
        scene: request.scene,
        preference: request.preference,
        friction: request.friction,
    };
    let (Some(all), Some(staying)) = (
        footing.on_all_feet().guard(request.standing),
        Wanted::rule(&footing.contacts(&staying), robot.stance(), request.preference),
    ) else {
        return Err(none("the feet enclose no support polygon"));
    };
    let legs: Vec<LegId> = request.standing.iter().map(|(leg, _)| *leg).collect();
    let chain = ClosedChain::new(robot, request.start, &legs, request.drive_hold);
    let shift = Shift {
        chain: &chain,
        staying: &staying,
        all: &all,
        contacts: &contacts,
        wanted: request.wanted_spare,
        closure: request.closure,
        freedom: Freedom::Whole,
        seed: request.seed,
        budget: request.budget,
    };
    shift.plan(&mut shift.search(body, watch))
}
