//! The final check: whether a step may be offered. Separate from the search on purpose: it walks
//! the executed motion finer than any planner, asks for distances instead of verdicts, and takes
//! stability from the full assessment instead of the search's short cut.

use collision::{Allowance, ContactZone, LegChecker, Scene, Touch, Violation, wheel_ground};
use nalgebra::Point3;
use rover::{Configuration, LegAngles, LegId, LinkId, Posture};
use stability::rule::{self, Preference};

use crate::answer::{Finding, Phase, Waypoint};

/// Distance between the configurations looked at (rad, largest joint): half the planners' ε.
const STEP: f64 = 0.005;

/// Distances below the tolerance by rounding alone pass (m).
const ROUNDING: f64 = 1e-7;

/// What the step is checked against.
pub struct CheckContext<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Where the robot is.
    pub start: &'a Configuration,
    /// The leg that steps.
    pub leg: LegId,
    /// The legs that stand all the while, with their contacts in `world` (m).
    pub standing: &'a [(LegId, Point3<f64>)],
    /// Gravity (m/s²).
    pub gravity: f64,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// Clearance from ground and obstacles (m), in place of the robot's.
    pub environment_tolerance: Option<f64>,
    /// Clearance of pairs (m), in place of the robot's.
    pub pair_tolerance: Option<f64>,
    /// Where the wheel may touch while it is lifted.
    pub lift_zone: Option<ContactZone>,
    /// ... while it is put down.
    pub drop_zone: Option<ContactZone>,
    /// Only collisions and limits: the transit alone was asked for.
    pub transit_only: bool,
}

/// What the check says: findings, and the regular margin over time.
pub struct CheckReport {
    /// One finding a check.
    pub findings: Vec<Finding>,
    /// (time in s, regular margin in m).
    pub margins: Vec<(f64, f64)>,
}

impl CheckReport {
    /// Did every check pass?
    pub fn passed(&self) -> bool {
        self.findings.iter().all(|finding| finding.ok)
    }
}

/// The least of something along the way, and where.
struct Least<T> {
    value: f64,
    time: f64,
    what: Option<T>,
}

impl<T> Least<T> {
    fn new() -> Least<T> {
        Least { value: f64::INFINITY, time: 0.0, what: None }
    }

    fn take(&mut self, value: f64, time: f64, what: T) {
        if value < self.value {
            *self = Least { value, time, what: Some(what) };
        }
    }
}

/// Checks a step from the first waypoint to the last.
pub fn check_step(context: &CheckContext, waypoints: &[Waypoint]) -> CheckReport {
    let scene = context.scene;
    let robot = scene.robot();
    let at_rest = Posture::new(robot, context.start);
    let checker = LegChecker::new(
        scene,
        &at_rest,
        context.leg,
        context.environment_tolerance,
        context.pair_tolerance,
    );
    let model = robot.leg(context.leg);
    let mut posture = at_rest.clone();
    let mut limits = Least::new();
    let mut links: Least<Violation> = Least::new();
    let mut environment: Least<Violation> = Least::new();
    let mut regular: Least<String> = Least::new();
    let mut rule_spare: Least<rule::Verdict> = Least::new();
    let mut torque: Least<(LegId, usize)> = Least::new();
    let mut margins = Vec::new();

    for (time, angles, phase) in samples(waypoints) {
        for i in 0..model.n_joints() {
            let spare = (angles[i] - model.lower[i]).min(model.upper[i] - angles[i]);
            limits.take(spare, time, i);
        }
        posture.move_leg(robot, context.leg, &angles);
        let zone = match phase {
            Phase::Lift => context.lift_zone.as_ref(),
            Phase::Shift | Phase::Transit => None,
            Phase::Drop | Phase::Preload => context.drop_zone.as_ref(),
        };
        let clearance =
            checker.clearance(&posture, Allowance { zone, raised: false }, 0.25 * robot.scale());
        if let Some(v) = clearance.links {
            links.take(v.distance - v.required, time, v);
        }
        if let Some(v) = clearance.environment {
            environment.take(v.distance - v.required, time, v);
        }
        if context.transit_only {
            continue;
        }
        let report = rule::assess(robot, &posture, context.standing, context.gravity);
        let verdict = rule::verdict(&report, robot.stance(), context.preference);
        if let Ok(support) = &report.regular {
            margins.push((time, support.margin.depth_m));
            let legs = support.critical.map(|leg| robot.leg(leg).name.clone()).join(" and ");
            regular.take(support.margin.depth_m, time, legs);
        }
        let spare = verdict.margin_m.map_or(f64::NEG_INFINITY, |m| m - verdict.required_m);
        rule_spare.take(if verdict.ok { spare.max(0.0) } else { spare.min(-1e-12) }, time, verdict);
        let worst = report.torque.worst;
        torque.take(1.0 - worst.ratio.abs(), time, (worst.leg, worst.place));
    }

    let mut findings = vec![
        start_finding(context, waypoints),
        limits_finding(context, &limits),
        touch_finding(context, "clearance_links", "links of the robot", &links),
        touch_finding(context, "clearance_environment", "ground and obstacles", &environment),
    ];
    if !context.transit_only {
        findings.push(margin_finding(context, &regular));
        findings.push(rule_finding(&rule_spare));
        findings.push(torque_finding(context, &torque));
        findings.extend(footfall_finding(context, waypoints));
    }
    CheckReport { findings, margins }
}

/// Configurations along the way: (time, angles, phase).
fn samples(waypoints: &[Waypoint]) -> Vec<(f64, LegAngles, Phase)> {
    let mut samples: Vec<(f64, LegAngles, Phase)> =
        waypoints.first().map(|w| (w.time, w.angles, w.phase)).into_iter().collect();
    for w in waypoints.windows(2) {
        let n = ((w[1].angles - w[0].angles).amax() / STEP).ceil().max(1.0) as usize;
        for i in 1..=n {
            let t = i as f64 / n as f64;
            let angles = w[0].angles * (1.0 - t) + w[1].angles * t;
            samples.push((w[0].time * (1.0 - t) + w[1].time * t, angles, w[1].phase));
        }
    }
    samples
}

fn start_finding(context: &CheckContext, waypoints: &[Waypoint]) -> Finding {
    let off = waypoints
        .first()
        .map_or(f64::INFINITY, |w| (w.angles - context.start.legs[context.leg.0]).amax());
    Finding {
        check: "start",
        ok: off <= 1e-6,
        margin: None,
        place: "first waypoint".into(),
        detail: "the step begins where the leg is".into(),
    }
}

fn limits_finding(context: &CheckContext, limits: &Least<usize>) -> Finding {
    let robot = context.scene.robot();
    let joint = limits.what.map_or("", |i| &robot.joints()[robot.leg(context.leg).joints[i]].name);
    Finding {
        check: "joint_limits",
        ok: limits.value >= -1e-9,
        margin: Some(limits.value),
        place: format!("{joint} at {:.1} s", limits.time),
        detail: format!("nearest limit {:.1} deg away", limits.value.to_degrees()),
    }
}

fn touch_finding(
    context: &CheckContext,
    check: &'static str,
    others: &str,
    least: &Least<Violation>,
) -> Finding {
    let Some(v) = &least.what else {
        return Finding {
            check,
            ok: true,
            margin: None,
            place: "everywhere".into(),
            detail: format!(
                "{others} are more than {:.2} m away",
                0.25 * context.scene.robot().scale()
            ),
        };
    };
    let unknown = matches!(v.touch, Touch::UnknownGround(_));
    Finding {
        check,
        ok: least.value >= -ROUNDING && !unknown,
        margin: Some(least.value),
        place: format!("{} at {:.1} s", touch_text(context.scene, v.touch), least.time),
        detail: if unknown {
            "the leg moves over ground that nobody has seen".into()
        } else {
            format!("{:.3} m apart, {:.3} m are kept", v.distance, v.required)
        },
    }
}

fn margin_finding(context: &CheckContext, regular: &Least<String>) -> Finding {
    let required = context.scene.robot().stance().margin;
    match &regular.what {
        Some(legs) => Finding {
            check: "stability_margin",
            ok: regular.value >= required,
            margin: Some(regular.value),
            place: format!("between {legs} at {:.1} s", regular.time),
            detail: format!("least regular margin {:.3} m, {required:.3} m asked", regular.value),
        },
        None => Finding {
            check: "stability_margin",
            ok: false,
            margin: None,
            place: "everywhere".into(),
            detail: "the standing feet enclose no support polygon".into(),
        },
    }
}

fn rule_finding(spare: &Least<rule::Verdict>) -> Finding {
    match &spare.what {
        Some(verdict) => Finding {
            check: "margin_rule",
            ok: verdict.ok,
            margin: verdict.margin_m,
            place: format!("at {:.1} s", spare.time),
            detail: verdict.explanation.clone(),
        },
        None => Finding {
            check: "margin_rule",
            ok: false,
            margin: None,
            place: "everywhere".into(),
            detail: "there is nothing to judge".into(),
        },
    }
}

fn torque_finding(context: &CheckContext, torque: &Least<(LegId, usize)>) -> Finding {
    let robot = context.scene.robot();
    let joint =
        torque.what.map_or("", |(leg, place)| &robot.joints()[robot.leg(leg).joints[place]].name);
    let ratio = 1.0 - torque.value;
    Finding {
        check: "torque",
        ok: ratio <= 1.0,
        margin: Some(torque.value),
        place: format!("{joint} at {:.1} s", torque.time),
        detail: format!(
            "largest torque {:.0} % of its limit, legs as equal springs",
            100.0 * ratio
        ),
    }
}

fn footfall_finding(context: &CheckContext, waypoints: &[Waypoint]) -> Option<Finding> {
    let zone = context.drop_zone.as_ref()?;
    let last = waypoints.last()?;
    let robot = context.scene.robot();
    let posture = Posture::new(robot, &context.start.with_leg(context.leg, last.angles));
    let wheel = posture.wheel(robot, context.leg);
    let gap = wheel_ground(&wheel, context.scene.map(), |_| true).nearest;
    let height = gap.map_or(f64::INFINITY, |g| g.gap);
    Some(Finding {
        check: "footfall",
        ok: height.abs() <= zone.ground_tolerance,
        margin: Some(zone.ground_tolerance - height.abs()),
        place: format!("{} on the ground", robot.leg(context.leg).name),
        detail: format!("the wheel ends {:.1} mm above the ground of the map", 1e3 * height),
    })
}

/// A touch in words.
pub fn touch_text(scene: &Scene, touch: Touch) -> String {
    let name = |link: LinkId| scene.robot().links()[link.0].name.as_str();
    match touch {
        Touch::Links(a, b) => format!("{} and {}", name(a), name(b)),
        Touch::Ground(link) => format!("{} and the ground", name(link)),
        Touch::Obstacle(link, index) => format!("{} and obstacle {index}", name(link)),
        Touch::UnknownGround(link) => format!("{} over unknown ground", name(link)),
    }
}
