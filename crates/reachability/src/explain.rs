//! One cell in full: what stands in the way, by name, and the nearest mend.

use collision::{LegChecker, Scene, Touch, Touchdown, Violation};
use nalgebra::{Point2, Point3};
use rover::{Configuration, LegAngles, LegId, LinkId, Posture};
use stability::{ConeModel, rule};

use crate::answer::{CellClass, ReachOptions, Reason};
use crate::cell::{Found, Rank, Searcher, Way};
use crate::look::{Look, seen};
use crate::mend::{Mend, mends};

/// What stands in the way, by name.
#[derive(Debug, Clone, PartialEq)]
pub enum Obstruction {
    /// A joint beyond its limit.
    Joint {
        /// The joint that is furthest beyond it, in the solution that is least.
        joint: String,
        /// By how much (rad; m of a prismatic joint).
        overrun: f64,
    },
    /// A joint beyond its torque limit.
    Torque {
        /// The joint.
        joint: String,
        /// Its torque over its limit, signed.
        ratio: f64,
    },
    /// Two bodies too near to each other.
    Bodies {
        /// The part of the leg.
        link: String,
        /// The other: a link, "ground", "unknown ground" or "obstacle 1", counted from 1.
        other: String,
        /// Where, in `world` (m).
        place: Point3<f64>,
        /// Their distance, and what must be kept (m).
        distance: f64,
        /// The distance that must be kept (m).
        required: f64,
        /// True if at the waypoint above, false if at the place itself.
        lifted: bool,
    },
    /// Too little to stand on, as the stance rule has it.
    Stance {
        /// What the rule says, in one sentence.
        text: String,
        /// The two legs about whose line the rover would tip first, if there is one.
        critical: Option<[LegId; 2]>,
        /// The leg whose settlement the rover would not survive, if that is what fails.
        settling: Option<LegId>,
    },
}

/// Everything that is known of one cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// Its class: that of [`reach`](crate::reach).
    pub class: CellClass,
    /// Why.
    pub reason: Reason,
    /// What is missing, in the unit of the reason.
    pub missing: Option<f64>,
    /// Regular margin with the leg there (m).
    pub margin_m: Option<f64>,
    /// What stands in the way, where it has a name.
    pub obstruction: Option<Obstruction>,
    /// The way that speaks for the cell: one that works, or the one that gets furthest.
    pub way: Option<Touchdown>,
    /// Joint angles at the waypoint above it, as far as that was looked at.
    pub raised: Option<LegAngles>,
    /// What would help, nearest first; each has been tried.
    pub mends: Vec<Mend>,
    /// One or two sentences for people: lengths in meters, legs counted from 1.
    pub text: String,
}

/// Explains the cell at `p`: as [`reach`](crate::reach) answers it, and more. `None` for a place that is
/// not a number.
pub fn explain(
    scene: &Scene,
    configuration: &Configuration,
    gravity: f64,
    leg: LegId,
    p: Point2<f64>,
    options: &ReachOptions,
) -> Option<Explanation> {
    if !(p.x.is_finite() && p.y.is_finite()) {
        return None;
    }
    let seen = seen(scene, configuration);
    let look = Look::new(scene, configuration, &seen, gravity, leg, options);
    let checker = LegChecker::new(scene, &look.posture, leg, None, None);
    let mut searcher = Searcher::new(&look, &checker);
    let found = searcher.cell(p, &[]);
    let obstruction = look.obstruction(&checker, p, &found, gravity);
    let mends = match found.cell.class {
        CellClass::Reachable => Vec::new(),
        _ => mends(&mut searcher, &look, configuration, gravity, p),
    };
    let number = |v: f32| v.is_finite().then_some(f64::from(v));
    let cell = found.cell;
    let text = text(cell.reason, number(cell.missing), obstruction.as_ref(), &mends);
    Some(Explanation {
        class: cell.class,
        reason: cell.reason,
        missing: number(cell.missing),
        margin_m: number(cell.margin),
        way: found.way.and_then(|(_, way)| searcher.touchdown(p, &way)),
        raised: found.way.and_then(|(_, way)| way.raised),
        obstruction,
        mends,
        text,
    })
}

impl Look<'_> {
    fn obstruction(
        &self,
        checker: &LegChecker,
        p: Point2<f64>,
        found: &Found,
        gravity: f64,
    ) -> Option<Obstruction> {
        match (found.cell.reason, found.way) {
            (Reason::JointLimit, _) => self.joint_limit(p),
            (Reason::Torque, Some((_, way))) => Some(self.overloaded(&way)),
            (Reason::Margin | Reason::Settlement, Some((_, way))) => {
                Some(self.stance_text(&way, gravity))
            }
            (_, Some((Rank::Collides, way))) => {
                self.collision(checker, &way).map(|v| self.bodies(&v, false))
            }
            (_, Some((Rank::LiftCollides, way))) => {
                self.lift_collision(checker, &way).map(|v| self.bodies(&v, true))
            }
            _ => None,
        }
    }

    fn joint_name(&self, leg: LegId, place: usize) -> String {
        let joints = &self.robot.leg(leg).joints;
        joints.get(place).map_or_else(String::new, |j| self.robot.joints()[*j].name.clone())
    }

    /// The joint that is in the way of the solution that is least beyond its limits.
    fn joint_limit(&self, p: Point2<f64>) -> Option<Obstruction> {
        let model = self.robot.leg(self.leg);
        let footings =
            collision::Footings::new(self.scene, &self.posture, self.leg, self.options.heading);
        let footing = footings.at(p)?;
        let mut least: Option<(f64, usize)> = None;
        for orientation in 0..footings.n_orientations() {
            let wheel = footing.unseated_wheel(orientation).world_from_wheel;
            let all = self.posture.inverse_kinematics(self.robot, self.leg, &wheel);
            for s in all.into_iter().flatten().filter(|s| !s.within_limits) {
                let over = (s.angles - model.upper).sup(&(model.lower - s.angles));
                let (place, overrun) = over.argmax();
                if least.is_none_or(|(least, _)| overrun < least) {
                    least = Some((overrun, place));
                }
            }
        }
        let (overrun, place) = least?;
        Some(Obstruction::Joint { joint: self.joint_name(self.leg, place), overrun })
    }

    fn with_way(&self, way: &Way) -> Posture {
        self.posture.with_leg(self.robot, self.leg, &way.angles)
    }

    fn overloaded(&self, way: &Way) -> Obstruction {
        let worst = self.stance.torque_report(&way.com, &self.with_way(way)).worst;
        Obstruction::Torque { joint: self.joint_name(worst.leg, worst.place), ratio: worst.ratio }
    }

    fn stance_text(&self, way: &Way, gravity: f64) -> Obstruction {
        let (posture, cone) = (self.with_way(way), ConeModel::default());
        let report =
            rule::assess_with_friction(self.robot, &posture, &self.standing, gravity, cone)
                .unwrap_or_else(|_| {
                    let points: Vec<_> =
                        self.standing.iter().map(|(leg, c)| (*leg, c.position)).collect();
                    rule::assess(self.robot, &posture, &points, gravity)
                });
        let verdict = rule::verdict(&report, self.robot.stance(), self.options.preference);
        let (critical, settling) = match verdict.check {
            rule::Check::Settlement => (None, report.settlement.map(|worst| worst.leg)),
            rule::Check::Friction => (None, None),
            rule::Check::Conservative => (report.conservative.and_then(|c| c.critical), None),
            _ => (report.regular.ok().map(|regular| regular.critical), None),
        };
        Obstruction::Stance { text: verdict.explanation, critical, settling }
    }

    fn bodies(&self, violation: &Violation, lifted: bool) -> Obstruction {
        let name = |link: LinkId| self.robot.links()[link.0].name.clone();
        let (link, other) = match violation.touch {
            Touch::Links(a, b) => (name(a), name(b)),
            Touch::Ground(a) => (name(a), "ground".into()),
            Touch::UnknownGround(a) => (name(a), "unknown ground".into()),
            Touch::Obstacle(a, index) => (name(a), format!("obstacle {}", index + 1)),
        };
        let Violation { distance, required, place, .. } = *violation;
        Obstruction::Bodies { link, other, place, distance, required, lifted }
    }
}

fn text(
    reason: Reason,
    missing: Option<f64>,
    obstruction: Option<&Obstruction>,
    mends: &[Mend],
) -> String {
    let what = obstruction.map_or_else(|| plain(reason, missing), named);
    let mends: Vec<String> = mends.iter().map(Mend::text).collect();
    match (reason, mends.is_empty()) {
        (Reason::None, _) => what,
        (_, true) => format!("{what}; no mend was found"),
        (_, false) => format!("{what}; {}", mends.join(", or ")),
    }
}

fn named(obstruction: &Obstruction) -> String {
    match obstruction {
        Obstruction::Joint { joint, overrun } => {
            format!("joint {joint} would be {:.1} degrees beyond its limit", overrun.to_degrees())
        }
        Obstruction::Torque { joint, ratio } => {
            format!("joint {joint} would bear {:.0} % of its limit", 100.0 * ratio.abs())
        }
        Obstruction::Bodies { link, other, distance, required, lifted, .. } => {
            let at = if *lifted { " at the waypoint above" } else { "" };
            format!("{link} comes to {distance:.2} m of {other}{at}, {required:.2} m must be kept")
        }
        Obstruction::Stance { text, .. } => text.clone(),
    }
}

fn plain(reason: Reason, missing: Option<f64>) -> String {
    let short = missing.map_or_else(|| "some".into(), |m| format!("{m:.2} m"));
    match reason {
        Reason::None => "the wheel can stand here".into(),
        Reason::OutOfReach => format!("out of reach, {short} short"),
        Reason::UnknownGround => "the ground here is unknown".into(),
        Reason::LiftOutOfReach => format!("the waypoint above is out of reach, {short} short"),
        Reason::Uneven => format!("the ground is too uneven: the wheel sits {short} off its place"),
        Reason::StartLift => "the leg cannot be lifted where it stands".into(),
        Reason::Traversability => "the ground here is unsafe for a wheel".into(),
        Reason::JointLimit => "a joint would be beyond its limit".into(),
        Reason::Margin | Reason::Settlement | Reason::Torque => "the stance would not hold".into(),
        Reason::EnvironmentCollision | Reason::SelfCollision | Reason::LiftCollides => {
            "something is in the way".into()
        }
    }
}
