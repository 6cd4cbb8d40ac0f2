//! The margin rule of a step, on everything that is known of one posture.
//!
//! By default a posture may be held if the regular margin over the feet that stand is m1 or more
//! and the rover survives a settlement of any one of them. Full loss of any one leg is an
//! operator's preference (F40), and often no pose can meet it; then the verdict says so and what
//! the best would be. m1 and the settlement s are in the robot's [`StanceRules`].
//!
//! `world` with z up is the gravity frame. Meters and newtons.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::Point3;
use rover::{LegId, Posture, Robot, StanceRules};

use crate::contact::{ConeModel, Contact, ContactError};
use crate::force_region::{self, Emptiness, ForceRegion};
use crate::loads::{LoadBand, StanceSprings};
use crate::support_polygon::{self, Margin, SupportError};
use crate::torque::TorqueReport;
use crate::{safety, settlement};

/// Which loss of support the operator asks the rover to survive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Preference {
    /// The regular margin, and a settlement of any one foot.
    #[default]
    Regular,
    /// Beside these, the full loss of any one standing leg.
    Conservative,
    /// Beside these, m1 also in the region that friction holds (H9).
    Friction,
}

/// The regular support polygon with its margin.
#[derive(Debug, Clone, PartialEq)]
pub struct RegularSupport {
    /// The polygon, in x and y of `world` (m).
    pub polygon: ConvexPolygon,
    /// Margin of the center of mass; its contacts are indices into the standing legs.
    pub margin: Margin,
    /// The two legs about whose line the rover would tip first.
    pub critical: [LegId; 2],
}

/// The conservative support region with its margin.
#[derive(Debug, Clone, PartialEq)]
pub struct ConservativeSupport {
    /// The region, in x and y of `world` (m).
    pub region: ConvexRegion,
    /// Depth of the center of mass in it (m); for a point minus the distance to it, and `None` for
    /// an empty region.
    pub margin_m: Option<f64>,
    /// The two legs on whose line the nearest edge lies, if the region has edges.
    pub critical: Option<[LegId; 2]>,
}

/// What the settlement of one foot leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegSettlement {
    /// The leg whose settlement is worst.
    pub leg: LegId,
    /// What is left of the margin (m); see [`settlement::Settlement::margin_m`].
    pub margin_m: f64,
}

/// Everything that is known of the stability of one posture.
#[derive(Debug, Clone, PartialEq)]
pub struct StanceReport {
    /// The legs that stand, in the order given.
    pub standing: Vec<LegId>,
    /// Where they touch the ground, in the same order, in `world` (m).
    pub contacts: Vec<Point3<f64>>,
    /// Center of mass with payloads, in `world` (m).
    pub com: Point3<f64>,
    /// The regular polygon, or why there is none.
    pub regular: Result<RegularSupport, SupportError>,
    /// The conservative region; `None` if there is no regular polygon.
    pub conservative: Option<ConservativeSupport>,
    /// Where friction holds the center of mass; `None` where it was not asked for.
    pub friction: Option<ForceRegion>,
    /// The worst settlement of one foot by the robot's s; `None` if there is no regular polygon.
    pub settlement: Option<LegSettlement>,
    /// Vertical force on each standing wheel, legs as springs of their own stiffness; `None` if the
    /// center of mass is outside the regular polygon.
    pub loads: Option<LoadBand>,
    /// Joint torques within these loads: a stance is torque-safe if the worst is not overloaded. Without
    /// loads no wheel bears anything: then the ratios are those of a robot that hangs on its base.
    pub torque: TorqueReport,
}

/// Everything that is known of the stability of `posture` on these legs, each with the point where
/// it touches the ground (`world`, m). `gravity` (m/s²) pulls along -z.
pub fn assess(
    robot: &Robot,
    posture: &Posture,
    standing: &[(LegId, Point3<f64>)],
    gravity: f64,
) -> StanceReport {
    let legs: Vec<LegId> = standing.iter().map(|(leg, _)| *leg).collect();
    let contacts: Vec<Point3<f64>> = standing.iter().map(|(_, contact)| *contact).collect();
    let com = posture.center_of_mass(robot);
    let named = |margin: &Margin| margin.contacts.map(|i| legs[i]);

    let regular = support_polygon::regular(&contacts).map(|polygon| {
        let margin = support_polygon::margin(&polygon, &contacts, &com);
        RegularSupport { critical: named(&margin), polygon, margin }
    });
    let conservative = support_polygon::conservative(&contacts).ok().map(|region| {
        let margin_m = support_polygon::margin_of_region(&region, &com);
        let margin = region.area().map(|area| support_polygon::margin(area, &contacts, &com));
        ConservativeSupport { region, margin_m, critical: margin.as_ref().map(named) }
    });
    let settlement = settlement::worst(&contacts, &com, robot.stance().settlement)
        .map(|worst| LegSettlement { leg: legs[worst.contact], margin_m: worst.margin_m });
    let springs = StanceSprings::of(robot, posture, standing, gravity);
    let (loads, torque) =
        safety::compliant(robot, posture, &com, standing, springs.as_ref(), gravity);
    StanceReport {
        standing: legs,
        contacts,
        com,
        regular,
        conservative,
        friction: None,
        settlement,
        loads,
        torque,
    }
}

/// As [`assess`], with the region that these contacts' friction holds. Where a foot stands too steep for
/// friction to hold a vertical load, the worst joint is that of the best forces, if it is loaded more.
///
/// Errors: contacts that cannot be worked with, see [`ContactError`].
pub fn assess_with_friction(
    robot: &Robot,
    posture: &Posture,
    standing: &[(LegId, Contact)],
    gravity: f64,
    cone: ConeModel,
) -> Result<StanceReport, ContactError> {
    let points: Vec<_> = standing.iter().map(|(leg, c)| (*leg, c.position)).collect();
    let contacts: Vec<Contact> = standing.iter().map(|(_, c)| *c).collect();
    let friction = force_region::region(&force_region::cones(&contacts, cone)?, 1.0)?;
    let report = assess(robot, posture, &points, gravity);
    let best = safety::worst_by_best_forces(robot, posture, &report.com, standing, gravity, cone);
    let torque = report.torque.or_worse(best);
    Ok(StanceReport { friction: Some(friction), torque, ..report })
}

/// The parts of the margin rule, in the order in which they are asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Check {
    /// The feet enclose a support polygon.
    Support,
    /// The regular margin is m1 or more.
    Regular,
    /// The settlement of any one foot leaves a margin of zero or more.
    Settlement,
    /// The conservative margin is zero or more.
    Conservative,
    /// The margin in the friction region is m1 or more.
    Friction,
}

/// Whether a posture may be held, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// True if the rule is met.
    pub ok: bool,
    /// The first check that fails; if all are met, the one that leaves least to spare.
    pub check: Check,
    /// The margin that this check is about (m); `None` if there is nothing to have a margin over.
    pub margin_m: Option<f64>,
    /// What the check asks for (m).
    pub required_m: f64,
    /// What is missing (m), zero if met; `None` without a margin.
    pub shortfall_m: Option<f64>,
    /// For a failed check, the largest margin that a center of mass anywhere over these contacts
    /// would have (m): the depth of the deepest point. An upper bound on what a shift of the body
    /// can win, for its reach does not enter. `None` where no margin is possible, for a
    /// settlement, and for a rule that is met.
    pub best_m: Option<f64>,
    /// One sentence for people. Legs are counted from 1, lengths are in meters.
    pub explanation: String,
}

/// The verdict of the margin rule on a posture.
///
/// The settlement in `report` is for the s of the robot it was made with, whatever `rules` says.
pub fn verdict(report: &StanceReport, rules: &StanceRules, preference: Preference) -> Verdict {
    let regular = match &report.regular {
        Ok(regular) => regular,
        Err(error) => return without_support(*error, rules.margin),
    };
    let mut checks = vec![on_regular(regular, rules.margin)];
    checks.extend(report.settlement.map(|worst| on_settlement(worst, rules.settlement)));
    if preference == Preference::Conservative {
        checks.extend(report.conservative.as_ref().map(on_conservative));
    }
    if preference == Preference::Friction {
        checks.push(on_friction(report, rules.margin));
    }
    if let Some(failed) = checks.iter().position(|verdict| !verdict.ok) {
        return checks.swap_remove(failed);
    }
    let spare = |verdict: &Verdict| verdict.margin_m.unwrap_or(0.0) - verdict.required_m;
    checks
        .into_iter()
        .reduce(|a, b| if spare(&b) < spare(&a) { b } else { a })
        .expect("the regular margin is always checked")
}

fn without_support(error: SupportError, required_m: f64) -> Verdict {
    Verdict {
        ok: false,
        check: Check::Support,
        margin_m: None,
        required_m,
        shortfall_m: None,
        best_m: None,
        explanation: format!("no support: {error}"),
    }
}

/// A verdict on a margin that exists; the callers add what they know.
fn on_margin(check: Check, margin_m: f64, required_m: f64, explanation: String) -> Verdict {
    Verdict {
        ok: margin_m >= required_m,
        check,
        margin_m: Some(margin_m),
        required_m,
        shortfall_m: Some((required_m - margin_m).max(0.0)),
        best_m: None,
        explanation,
    }
}

fn on_regular(regular: &RegularSupport, required_m: f64) -> Verdict {
    let margin_m = regular.margin.depth_m;
    let text = format!(
        "regular margin {margin_m:.2} m of {required_m:.2} m over {}",
        legs_text(regular.critical)
    );
    let verdict = on_margin(Check::Regular, margin_m, required_m, text);
    if verdict.ok {
        return verdict;
    }
    with_best(verdict, regular.polygon.deepest_point().1)
}

fn on_settlement(worst: LegSettlement, settlement_m: f64) -> Verdict {
    let (leg, margin_m) = (worst.leg.0 + 1, worst.margin_m);
    let text = if margin_m >= 0.0 {
        format!("margin {margin_m:.2} m is left if leg {leg} settles by {settlement_m:.2} m")
    } else {
        format!(
            "the rover tips over if leg {leg} settles by {settlement_m:.2} m: {:.2} m are missing",
            -margin_m
        )
    };
    on_margin(Check::Settlement, margin_m, 0.0, text)
}

fn on_conservative(conservative: &ConservativeSupport) -> Verdict {
    let check = Check::Conservative;
    match (&conservative.region, conservative.margin_m) {
        (ConvexRegion::Area(polygon), Some(margin_m)) => {
            let over = conservative.critical.map(legs_text).unwrap_or_default();
            let text = format!("conservative margin {margin_m:.2} m of 0.00 m over {over}");
            let verdict = on_margin(check, margin_m, 0.0, text);
            if verdict.ok { verdict } else { with_best(verdict, polygon.deepest_point().1) }
        }
        (ConvexRegion::Point(_), Some(margin_m)) => {
            let text = format!(
                "no pose on these feet survives the loss of a leg: the conservative region is a \
                 single point, {:.2} m from the center of mass; best is 0.00 m",
                -margin_m
            );
            // A point has no inside: even a center of mass over it has nothing to spare.
            Verdict { ok: false, best_m: Some(0.0), ..on_margin(check, margin_m, 0.0, text) }
        }
        _ => Verdict {
            ok: false,
            check,
            margin_m: None,
            required_m: 0.0,
            shortfall_m: None,
            best_m: None,
            explanation: "no pose on these feet survives the loss of a leg: the conservative \
                          region is empty"
                .into(),
        },
    }
}

fn on_friction(report: &StanceReport, required_m: f64) -> Verdict {
    let check = Check::Friction;
    let refused = |text: &str| Verdict {
        ok: false,
        check,
        margin_m: None,
        required_m,
        shortfall_m: None,
        best_m: None,
        explanation: text.into(),
    };
    let Some(friction) = &report.friction else {
        return refused("friction and normals of the contacts are not known");
    };
    match (friction.margin(&report.com), friction.region.area()) {
        (Some(margin_m), Some(area)) => {
            let who: Vec<String> = friction
                .critical(&report.com)
                .iter()
                .filter_map(|i| Some((report.standing.get(*i)?.0 + 1).to_string()))
                .collect();
            let text = format!(
                "friction margin {margin_m:.2} m of {required_m:.2} m, borne by legs {}",
                who.join("-")
            );
            let verdict = on_margin(check, margin_m, required_m, text);
            if verdict.ok { verdict } else { with_best(verdict, area.deepest_point().1) }
        }
        (Some(margin_m), None) => Verdict {
            ok: false,
            best_m: Some(0.0),
            ..on_margin(
                check,
                margin_m,
                required_m,
                "friction holds the center of mass in a single point only".into(),
            )
        },
        (None, _) => refused(match friction.emptiness {
            Some(Emptiness::Twists) => {
                "no forces within friction keep the rover from turning about gravity"
            }
            _ => "the ground is too steep for its friction: no forces hold the rover",
        }),
    }
}

fn with_best(verdict: Verdict, best_m: f64) -> Verdict {
    let explanation = format!("{}; best over this stance {best_m:.2} m", verdict.explanation);
    Verdict { best_m: Some(best_m), explanation, ..verdict }
}

fn legs_text([a, b]: [LegId; 2]) -> String {
    format!("legs {}-{}", a.0 + 1, b.0 + 1)
}
