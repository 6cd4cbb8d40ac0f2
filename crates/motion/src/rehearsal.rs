//! The leg-loss rehearsal: what is left if a leg fails now, or the ground settles under a foot, and the way
//! back to a safe stance.
//!
//! - **Lost**: the leg bears nothing any more. What is left is the regular margin over the other feet; the
//!   way back is the smallest shift of the chassis after which the margin rule holds on them. The leg's
//!   joints still follow, so that its wheel stays where it is: a leg whose joints are stuck is dragged, and
//!   that is not rehearsed.
//! - **Settled**: the ground under the foot goes down by s. What is left is the margin after the rover has
//!   rocked onto it, if it does. The way back is the smallest shift, from the stance as it is now, after
//!   which the rule holds on all feet for that s.
//!
//! On a way back the regular margin over the feet that bear stays at m1, or, where it is less already, gets
//! less by a centimeter (scaled) at most and never negative. A way is offered only certified, timed and passed by the final check, as a proposal of
//! [`crate::adviser`]. Deterministic for the same arguments unless the watch stops it. Frame `world`.

mod settle;

use collision::Scene;
use nalgebra::Point3;
use rover::{Configuration, LegId, Posture, StanceRules};
use stability::{Preference, StanceGuard};

use crate::adviser::{
    AdviceError, AdviceOptions, Case, Margins, Motion, Place, Wish, Work, validate,
};
use crate::shift::{Barrier, Wanted};
use crate::watch::{Stage, Watch};
use settle::settled;

/// Largest settlement that is rehearsed (m at scale 1).
pub const SETTLEMENT_MAX: f64 = 2.0;

/// What the end of a way back has to spare (m at scale 1).
const SPARE: f64 = 0.001;

/// By how much the margin may get less on the way (m at scale 1): a motion that must lose nothing at all can
/// neither be certified nor timed.
const GIVES_WAY: f64 = 0.01;

/// What is rehearsed.
#[derive(Debug, Clone, PartialEq)]
pub struct RehearsalOptions {
    /// How far the ground settles (m); the robot's s where nothing is said.
    pub settlement: Option<f64>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Poses of the chassis that may be looked at, by all searches together.
    pub budget: usize,
}

impl Default for RehearsalOptions {
    fn default() -> RehearsalOptions {
        RehearsalOptions { settlement: None, seed: 1, budget: 120_000 }
    }
}

/// The way back to a safe stance.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // made a dozen times a request
pub enum WayBack {
    /// The stance is safe as it is.
    NotNeeded,
    /// This shift leads there.
    Shift {
        /// The motion.
        motion: Motion,
        /// The posture after it.
        end: Configuration,
        /// Its margins over the feet that bear.
        after: Margins,
    },
    /// None was found; what stands in the way.
    None(Barrier),
}

/// What an accident leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct Aftermath {
    /// The regular margin that is left (m), negative if the rover tips over; none without a polygon.
    pub margin: Option<f64>,
    /// Does it tip over?
    pub tips_over: bool,
    /// Does it rock onto the foot that has settled?
    pub rocks: bool,
    /// The way back.
    pub way_back: WayBack,
}

/// One leg's accidents.
#[derive(Debug, Clone, PartialEq)]
pub struct LegRehearsal {
    /// The leg.
    pub leg: LegId,
    /// It fails and bears nothing.
    pub lost: Aftermath,
    /// The ground settles under it.
    pub settled: Aftermath,
}

/// The accidents of every standing leg.
#[derive(Debug, Clone, PartialEq)]
pub struct Rehearsal {
    /// How far the ground settles (m).
    pub settlement: f64,
    /// By leg.
    pub legs: Vec<LegRehearsal>,
    /// Poses of the chassis looked at.
    pub n_looked: usize,
}

/// What is left if any one standing leg fails, or the ground settles under it, and the ways back.
pub fn rehearse(
    scene: &Scene,
    start: &Configuration,
    gravity: f64,
    options: &RehearsalOptions,
    watch: &mut impl Watch,
) -> Result<Rehearsal, AdviceError> {
    let wish = Wish::default();
    validate(scene, start, gravity, LegId(0), &wish)?;
    let robot = scene.robot();
    let settlement = options.settlement.unwrap_or(robot.stance().settlement);
    if !(0.0..=SETTLEMENT_MAX * robot.scale()).contains(&settlement) {
        return Err(AdviceError::BadSettlement { value: settlement });
    }
    watch.entered(Stage::Shift);
    let feet = feet(scene, start)?;
    let part = options.budget / (2 * feet.len());
    let advice = AdviceOptions { seed: options.seed, budget: part, ..AdviceOptions::default() };
    let mut work = Work { watch, n_looked: 0 };
    let mut legs = Vec::new();
    for (leg, _) in &feet {
        let case = Case { scene, gravity, leg: *leg, wish: &wish, options: &advice };
        let accident = Accident { case: &case, start, feet: &feet };
        let lost = accident.lost(&mut work);
        let settled = accident.settled(settlement, &mut work);
        if let Some(stopped) = work.watch.stopped() {
            return Err(AdviceError::Stopped(stopped));
        }
        legs.push(LegRehearsal { leg: *leg, lost, settled });
    }
    Ok(Rehearsal { settlement, legs, n_looked: work.n_looked })
}

/// The standing legs with their contacts, of a posture that touches nothing else.
fn feet(scene: &Scene, start: &Configuration) -> Result<Vec<(LegId, Point3<f64>)>, AdviceError> {
    let posture = Posture::new(scene.robot(), start);
    let seen = collision::survey(scene, &posture);
    if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
        let what = crate::check::touch_text(scene, pair.touch);
        return Err(AdviceError::Colliding { what });
    }
    let feet = seen.contacts(scene, &posture);
    if feet.len() < 3 {
        return Err(AdviceError::TooFewFeet { n_staying: feet.len() });
    }
    let contacts: Vec<Point3<f64>> = feet.iter().map(|(_, p)| *p).collect();
    stability::support_polygon::regular(&contacts).map_err(|_| AdviceError::NoSupport)?;
    Ok(feet)
}

/// One leg, and what stands.
struct Accident<'a> {
    case: &'a Case<'a>,
    start: &'a Configuration,
    feet: &'a [(LegId, Point3<f64>)],
}

impl Accident<'_> {
    fn rules(&self) -> &StanceRules {
        self.case.scene.robot().stance()
    }

    /// The leg bears nothing.
    fn lost<W: Watch>(&self, work: &mut Work<'_, W>) -> Aftermath {
        let mut staying = self.feet.to_vec();
        staying.retain(|(leg, _)| *leg != self.case.leg);
        let robot = self.case.scene.robot();
        let posture = Posture::new(robot, self.start);
        let now = Margins::of(&self.case.footing(), &posture, &staying, self.case.gravity);
        let margin = now.regular;
        let tips_over = margin.is_none_or(|margin| margin < 0.0);
        let way_back = match margin {
            Some(margin) if !tips_over => {
                if now.meet(self.case.wish, self.rules()) {
                    WayBack::NotNeeded
                } else {
                    self.way_back(staying, margin, self.rules(), now, work)
                }
            }
            _ => falls(),
        };
        Aftermath { margin, tips_over, rocks: false, way_back }
    }

    /// The ground goes down under the leg's foot.
    fn settled<W: Watch>(&self, settlement: f64, work: &mut Work<'_, W>) -> Aftermath {
        let robot = self.case.scene.robot();
        let posture = Posture::new(robot, self.start);
        let com = posture.center_of_mass(robot);
        let contacts: Vec<Point3<f64>> = self.feet.iter().map(|(_, p)| *p).collect();
        let foot = self.feet.iter().position(|(leg, _)| *leg == self.case.leg).unwrap_or(0);
        let left = settled(&contacts, foot, &com, settlement);
        let tips_over = left.margin < 0.0;
        let rules = StanceRules { settlement, ..*self.rules() };
        let holds = StanceGuard::new(&contacts, &rules, Preference::Regular)
            .is_some_and(|guard| guard.spare(&com) >= 0.0);
        let now = Margins::of(&self.case.footing(), &posture, self.feet, self.case.gravity);
        let way_back = match now.regular {
            _ if holds => WayBack::NotNeeded,
            Some(margin) if margin >= 0.0 => {
                self.way_back(self.feet.to_vec(), margin, &rules, now, work)
            }
            _ => falls(),
        };
        let margin = left.margin.is_finite().then_some(left.margin);
        Aftermath { margin, tips_over, rocks: left.rocks, way_back }
    }

    /// The smallest shift after which `rules` hold on the feet that bear, whose margin is `margin` (m) now.
    fn way_back<W: Watch>(
        &self,
        bearing: Vec<(LegId, Point3<f64>)>,
        margin: f64,
        rules: &StanceRules,
        margins: Margins,
        work: &mut Work<'_, W>,
    ) -> WayBack {
        let robot = self.case.scene.robot();
        let contacts: Vec<Point3<f64>> = bearing.iter().map(|(_, p)| *p).collect();
        let margin = (margin.min(rules.margin) - GIVES_WAY * robot.scale()).max(0.0);
        let kept = StanceRules { margin, settlement: 0.0, ..*rules };
        let footing = self.case.footing();
        let (Some(on_the_way), Some(wanted)) = (
            StanceGuard::new(&contacts, &kept, Preference::Regular),
            Wanted::rule(&footing.contacts(&bearing), rules, Preference::Regular),
        ) else {
            return falls();
        };
        let place = Place {
            configuration: self.start.clone(),
            on_ground: self.feet.to_vec(),
            staying: bearing.clone(),
            bearing,
            on_the_way,
            wanted,
            margins,
        };
        let budget = self.case.options.budget;
        let spare = SPARE * robot.scale();
        match self.case.shifted(&place, &place.wanted, spare, budget, work) {
            Err(barrier) | Ok(crate::adviser::Attempt { barrier: Some(barrier), .. }) => {
                WayBack::None(barrier)
            }
            Ok(attempt) => {
                let confirmed = attempt.after.meet(self.case.wish, self.rules());
                match attempt.motions.into_iter().next() {
                    Some(motion) if confirmed => {
                        WayBack::Shift { motion, end: attempt.end, after: attempt.after }
                    }
                    _ => WayBack::None(attempt.after.barrier(robot)),
                }
            }
        }
    }
}

fn falls() -> WayBack {
    WayBack::None(Barrier::new("stability", "the rover tips over before anything can be moved"))
}
