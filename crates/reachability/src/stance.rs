//! Whether the rover stands while one leg is up: what [`stability::rule`] says, prepared for asking it
//! for thousands of postures of that leg.
//!
//! The other feet do not move, so the rule is a function of the center of mass alone, and the load at
//! which a joint of a standing leg is at its torque limit is known beforehand. Here is the one place
//! where a preference becomes a rule.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Point3, Vector3};
use rover::{LegAngles, LegChain, LegId, Posture, Robot, StanceRules, Wrench, hold_torques};
use stability::rule::Preference;
use stability::{
    ConeModel, Contact, StanceGuard, StanceSprings, force_region, safety, settlement,
    support_polygon, torque,
};

use crate::answer::Reason;

/// Share of a torque limit that rounding may take: beyond, the torques are computed in full.
const NEARLY: f64 = 1.0 - 1e-9;
/// As deep (m) in a polygon, a point is in it whatever was rounded.
const INSIDE: f64 = 1e-9;

/// The rule for one moving leg.
pub(crate) struct Stance<'a> {
    robot: &'a Robot,
    rules: StanceRules,
    contacts: Vec<Point3<f64>>,
    standing: Vec<(LegId, Contact)>,
    /// None if the feet enclose no support polygon: then nothing holds.
    support: Option<Support>,
    torques: Torques,
    gravity: f64,
}

struct Support {
    hull: ConvexPolygon,
    /// The rule as the operator prefers it, and its regular part.
    guard: StanceGuard,
    regular: StanceGuard,
    /// The region that counts beside the hull, conservative or of friction, and how deep in it the
    /// center of mass must be (m).
    region: Option<(ConvexRegion, f64)>,
}

/// What fails, and by how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Refusal {
    pub reason: Reason,
    pub missing: f64,
}

impl<'a> Stance<'a> {
    /// Prepares the rule with the feet of `standing` on the ground and `leg` up.
    pub fn new(
        robot: &'a Robot,
        posture: &Posture,
        leg: LegId,
        standing: &[(LegId, Contact)],
        gravity: f64,
        preference: Preference,
    ) -> Stance<'a> {
        let rules = *robot.stance();
        // With the preference `friction`, the best forces must also do where friction asks for them.
        let on_slopes = preference == Preference::Friction && {
            let contacts: Vec<Contact> = standing.iter().map(|(_, c)| *c).collect();
            !safety::hold_verticals(&contacts, ConeModel::default())
        };
        Stance {
            robot,
            rules,
            support: Support::new(standing, &rules, preference),
            torques: Torques::new(robot, posture, leg, standing, gravity, on_slopes),
            contacts: standing.iter().map(|(_, contact)| contact.position).collect(),
            standing: standing.to_vec(),
            gravity,
        }
    }

    /// Regular margin (m); NaN without support.
    pub fn margin(&self, com: &Point3<f64>) -> f64 {
        self.support.as_ref().map_or(f64::NAN, |support| support.hull.depth_of(com.xy()))
    }

    /// False if no center of mass would do.
    pub fn has_support(&self) -> bool {
        self.support.is_some()
    }

    /// Does the rule hold, and can all joints bear it? `posture` gives the whole posture, which is
    /// seldom asked for.
    pub fn holds(&self, com: &Point3<f64>, posture: impl FnOnce() -> Posture) -> bool {
        let Some(support) = &self.support else { return false };
        if support.guard.spare(com) < 0.0 && support.refusal(self, com).is_some() {
            return false;
        }
        self.torques.surely_bears(com) || self.overload(com, &posture()) <= 0.0
    }

    /// What fails first, in the order of the rule; none if it holds.
    pub fn refusal(&self, com: &Point3<f64>, posture: &Posture) -> Option<Refusal> {
        let Some(support) = &self.support else {
            return Some(Refusal { reason: Reason::Margin, missing: f64::NAN });
        };
        if let Some(refusal) = support.refusal(self, com) {
            return Some(refusal);
        }
        let missing = self.overload(com, posture);
        (missing > 0.0).then_some(Refusal { reason: Reason::Torque, missing })
    }

    /// By how much the worst joint is beyond its torque limit, as a share of it; negative if it is
    /// not.
    fn overload(&self, com: &Point3<f64>, posture: &Posture) -> f64 {
        let worst = self.torque_report(com, posture).worst;
        if worst.ratio.is_nan() { f64::INFINITY } else { worst.ratio.abs() - 1.0 }
    }

    /// Joint torques with the leg as in `posture`.
    pub fn torque_report(&self, com: &Point3<f64>, posture: &Posture) -> torque::TorqueReport {
        let Torques { springs, on_slopes, .. } = &self.torques;
        let feet = points(&self.standing);
        let (robot, gravity) = (self.robot, self.gravity);
        let (_, report) = safety::compliant(robot, posture, com, &feet, springs.as_ref(), gravity);
        if !on_slopes {
            return report;
        }
        let cone = ConeModel::default();
        let best = safety::worst_by_best_forces(robot, posture, com, &self.standing, gravity, cone);
        report.or_worse(best)
    }
}

impl Support {
    fn new(
        standing: &[(LegId, Contact)],
        rules: &StanceRules,
        preference: Preference,
    ) -> Option<Support> {
        let feet: Vec<Contact> = standing.iter().map(|(_, contact)| *contact).collect();
        let contacts: Vec<Point3<f64>> = feet.iter().map(|c| c.position).collect();
        let regular = StanceGuard::new(&contacts, rules, Preference::Regular)?;
        let (guard, region) = match preference {
            Preference::Regular => (regular.clone(), None),
            Preference::Conservative => {
                let region = support_polygon::conservative(&contacts).ok()?;
                (StanceGuard::new(&contacts, rules, preference)?, Some((region, 0.0)))
            }
            Preference::Friction => {
                let cones = force_region::cones(&feet, ConeModel::default()).ok()?;
                let region = force_region::region(&cones, 1.0).ok()?.region;
                (regular.clone().within(&region, rules.margin), Some((region, rules.margin)))
            }
        };
        Some(Support { hull: support_polygon::regular(&contacts).ok()?, guard, regular, region })
    }

    /// As [`stability::rule::verdict`] has it.
    fn refusal(&self, of: &Stance, com: &Point3<f64>) -> Option<Refusal> {
        let short = of.rules.margin - self.hull.depth_of(com.xy());
        if short > 0.0 {
            return Some(Refusal { reason: Reason::Margin, missing: short });
        }
        if self.regular.spare(com) < 0.0 {
            let worst = settlement::worst(&of.contacts, com, of.rules.settlement);
            if let Some(worst) = worst.filter(|worst| worst.margin_m < 0.0) {
                return Some(Refusal { reason: Reason::Settlement, missing: -worst.margin_m });
            }
        }
        let margin = Reason::Margin;
        let (region, required) = self.region.as_ref()?;
        match region {
            ConvexRegion::Empty => Some(Refusal { reason: margin, missing: f64::NAN }),
            ConvexRegion::Area(area) => {
                let short = required - area.depth_of(com.xy());
                (short > 0.0).then_some(Refusal { reason: margin, missing: short })
            }
            // A point has no inside: nothing is enough.
            ConvexRegion::Point(point) => {
                Some(Refusal { reason: margin, missing: (com.xy() - point).norm() })
            }
        }
    }
}

/// Loads that the joints of the standing legs can bear.
struct Torques {
    /// The springs under the feet, and where the center of mass may be without any joint of theirs being
    /// overloaded, whatever in their band the loads are.
    springs: Option<StanceSprings>,
    sure: Option<ConvexPolygon>,
    /// Loads between which all joints of each leg are within their limits (N).
    bearable: Vec<(f64, f64)>,
    /// True where the best forces may ask more of a joint than these loads.
    on_slopes: bool,
    /// True if no joint of a leg that is up can be overloaded, whatever the moving leg does.
    others_bear: bool,
}

impl Torques {
    fn new(
        robot: &Robot,
        posture: &Posture,
        moving: LegId,
        standing: &[(LegId, Contact)],
        gravity: f64,
        on_slopes: bool,
    ) -> Torques {
        let weight = robot.mass() * gravity;
        let standing = points(standing);
        let bearable: Vec<(f64, f64)> = standing
            .iter()
            .map(|(leg, contact)| {
                let torques = |load: f64| {
                    let force = Vector3::new(0.0, 0.0, load);
                    let wrench = Wrench { point: *contact, force };
                    hold_torques(robot, posture, *leg, gravity, Some(&wrench))
                };
                bearable(&torques(0.0), &torques(weight), weight, &robot.leg(*leg).effort)
            })
            .collect();
        let springs = StanceSprings::of(robot, posture, &standing, gravity);
        let sure = springs.as_ref().and_then(|springs| springs.surely_within(&bearable));
        let mut up = robot.leg_ids().filter(|leg| standing.iter().all(|(other, _)| other != leg));
        let bears = |leg: LegId| {
            let effort = &robot.leg(leg).effort;
            let torques = if leg == moving {
                most_own_torques(robot, posture, leg, gravity)
            } else {
                hold_torques(robot, posture, leg, gravity, None)
            };
            torques.iter().zip(effort.iter()).all(|(t, limit)| t.abs() <= limit * NEARLY)
        };
        Torques { springs, sure, bearable, on_slopes, others_bear: up.all(bears) }
    }

    /// True if all joints are within their limits; false where that takes a closer look.
    fn surely_bears(&self, com: &Point3<f64>) -> bool {
        if self.on_slopes || !self.others_bear {
            return false;
        }
        if self.sure.as_ref().is_some_and(|sure| sure.depth_of(com.xy()) >= INSIDE) {
            return true;
        }
        let Some(band) = self.springs.as_ref().and_then(|s| s.band(com)) else { return false };
        let ends = band.least_n.iter().zip(&band.most_n);
        ends.zip(&self.bearable).all(|((least, most), bears)| *least >= bears.0 && *most <= bears.1)
    }
}

/// Where feet touch (m).
fn points(standing: &[(LegId, Contact)]) -> Vec<(LegId, Point3<f64>)> {
    standing.iter().map(|(leg, contact)| (*leg, contact.position)).collect()
}

/// The loads between which torques that go linearly from `unloaded` to what they are under `weight` (N)
/// are within their limits.
fn bearable(
    unloaded: &LegAngles,
    loaded: &LegAngles,
    weight: f64,
    effort: &LegAngles,
) -> (f64, f64) {
    let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
    for ((t0, t1), limit) in unloaded.iter().zip(loaded.iter()).zip(effort.iter()) {
        let limit = limit.max(0.0) * NEARLY;
        let slope = (t1 - t0) / weight;
        if slope.abs() > 0.0 && slope.is_finite() {
            let ends = [(-limit - t0) / slope, (limit - t0) / slope];
            least = least.max(ends[0].min(ends[1]));
            most = most.min(ends[0].max(ends[1]));
        } else if t0.abs() > limit {
            most = f64::NEG_INFINITY;
        }
    }
    (least, most)
}

/// Most that holding its own links can ask of each joint of a leg, at any angles (N m).
fn most_own_torques(robot: &Robot, posture: &Posture, leg: LegId, gravity: f64) -> LegAngles {
    let chain = LegChain::new(robot, posture, leg);
    let weight = robot.mass() * gravity.abs();
    LegAngles::from_fn(|i, _| {
        let mut one = LegAngles::zeros();
        one[i] = 1.0;
        chain.com_motion(&one) * weight
    })
}
