//! Whether the rover stands while one leg is up: what [`stability::rule`] says, prepared for asking it
//! for thousands of postures of that leg.
//!
//! The other feet do not move, so the rule is a function of the center of mass alone, and the load at
//! which a joint of a standing leg is at its torque limit is known beforehand. Here is the one place
//! where a preference becomes a rule.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Matrix3, Point3, Vector3};
use rover::{LegAngles, LegChain, LegId, Posture, Robot, StanceRules, Wrench, hold_torques};
use stability::rule::Preference;
use stability::{
    ConeModel, Contact, StanceGuard, force_region, loads, settlement, support_polygon, torque,
};

use crate::answer::Reason;

/// Share of a torque limit that rounding may take: beyond, the torques are computed in full.
const NEARLY: f64 = 1.0 - 1e-9;

/// The rule for one moving leg.
pub(crate) struct Stance<'a> {
    robot: &'a Robot,
    rules: StanceRules,
    contacts: Vec<Point3<f64>>,
    legs: Vec<LegId>,
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
        let support = Support::new(standing, &rules, preference);
        let standing: Vec<_> = standing.iter().map(|(leg, c)| (*leg, c.position)).collect();
        let contacts: Vec<_> = standing.iter().map(|(_, contact)| *contact).collect();
        Stance {
            robot,
            rules,
            legs: standing.iter().map(|(leg, _)| *leg).collect(),
            support,
            torques: Torques::new(robot, posture, leg, &standing, gravity),
            contacts,
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
        self.torque_report(com, posture).worst.ratio.abs() - 1.0
    }

    /// Joint torques with the leg as in `posture`.
    pub fn torque_report(&self, com: &Point3<f64>, posture: &Posture) -> torque::TorqueReport {
        let weight = self.robot.mass() * self.gravity;
        let loads = loads::spring_share(&self.contacts, com, weight).unwrap_or_default();
        let feet = self.legs.iter().zip(&self.contacts);
        let wrench = |((leg, point), load): ((&LegId, &Point3<f64>), f64)| {
            (*leg, Wrench { point: *point, force: Vector3::new(0.0, 0.0, load) })
        };
        let wrenches: Vec<_> = feet.zip(loads).map(wrench).collect();
        torque::ratios(self.robot, posture, &wrenches, self.gravity)
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
    /// Where the loads are counted from, and their center of mass: the loads of equal springs that all
    /// carry are (1, x, y) · `share`.
    origin: Point3<f64>,
    share: Option<Matrix3<f64>>,
    weight: f64,
    feet: Vec<Foot>,
    /// True if no joint of a leg that is up can be overloaded, whatever the moving leg does.
    others_bear: bool,
}

struct Foot {
    /// (1, x, y) from the origin.
    place: Vector3<f64>,
    /// Loads between which all joints of the leg are within their limits (N).
    least: f64,
    most: f64,
}

impl Torques {
    fn new(
        robot: &Robot,
        posture: &Posture,
        moving: LegId,
        standing: &[(LegId, Point3<f64>)],
        gravity: f64,
    ) -> Torques {
        let weight = robot.mass() * gravity;
        let origin = standing.first().map_or_else(Point3::origin, |(_, contact)| *contact);
        let feet: Vec<Foot> = standing
            .iter()
            .map(|(leg, contact)| {
                let torques = |load: f64| {
                    let force = Vector3::new(0.0, 0.0, load);
                    let wrench = Wrench { point: *contact, force };
                    hold_torques(robot, posture, *leg, gravity, Some(&wrench))
                };
                let (least, most) =
                    bearable(&torques(0.0), &torques(weight), weight, &robot.leg(*leg).effort);
                let place = Vector3::new(1.0, contact.x - origin.x, contact.y - origin.y);
                Foot { place, least, most }
            })
            .collect();
        let stiffness: Matrix3<f64> = feet.iter().map(|f| f.place * f.place.transpose()).sum();
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
        Torques { origin, share: stiffness.try_inverse(), weight, feet, others_bear: up.all(bears) }
    }

    /// True if all joints are within their limits; false where that takes a closer look.
    fn surely_bears(&self, com: &Point3<f64>) -> bool {
        let Some(share) = self.share.filter(|_| self.others_bear) else { return false };
        let center = Vector3::new(1.0, com.x - self.origin.x, com.y - self.origin.y);
        let plane = share * center * self.weight;
        self.feet.iter().all(|foot| {
            let load = plane.dot(&foot.place);
            load >= 0.0 && load >= foot.least && load <= foot.most
        })
    }
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
