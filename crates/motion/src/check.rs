//! The final check: whether a step may be offered. Separate from the search on purpose: it walks
//! the executed motion from its beginning to its end, asks exact shapes for distances where the
//! search asked quick bounds for verdicts, goes on by no more than these distances allow, and takes
//! stability from the full assessment instead of the search's short cut.

use collision::{
    Allowance, ContactZone, Keep, LegChecker, OverUnknown, PairDistance, Reach, Scene, Survey,
    Touch, Violation, over_unknown, survey, wheel_ground,
};
use nalgebra::Point3;
use rover::{Configuration, LegAngles, LegId, LinkId, Posture};
use stability::rule::{self, Preference};

use crate::advance::Advance;
use crate::answer::{Finding, Phase, Waypoint};
use crate::footing::Footing;

/// Most between two configurations looked at, and between two whose stability is (rad, largest joint).
const STEP: f64 = 0.03;

/// Least between two configurations looked at (rad, largest joint), however near things are.
const FINEST: f64 = 0.0001;

/// Most between two configurations of a body shift (rad, largest joint).
const SHIFT_STEP: f64 = 0.005;

/// Share of the way up to a touch that is gone to the next look: what is kept may not be broken by much
/// in between either.
const SHARE: f64 = 0.5;

/// How far beyond the tolerances distances are asked for (m at scale 1).
const REACH: f64 = 0.15;

/// How far standing wheels may leave their places in a body shift (m at scale 1).
const CLOSURE: f64 = 0.0025;

/// Distances below the tolerance by rounding alone pass (m).
const ROUNDING: f64 = 1e-7;

/// What a touch counts as missing at least (m): without tolerances nothing else would be missing.
const TOUCHING: f64 = 1e-6;

/// What is to spare (m); a touch never has anything.
fn spare(v: &Violation) -> f64 {
    let spare = v.distance - v.required;
    if v.distance > 0.0 { spare } else { spare.min(-TOUCHING) }
}

/// What the step is checked against.
pub struct CheckContext<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Where the robot is.
    pub start: &'a Configuration,
    /// Where it is when the leg begins to move: after the body shift, if there is one.
    pub stepping_from: &'a Configuration,
    /// The leg that steps.
    pub leg: LegId,
    /// The legs that stand all the while, with their contacts in `world` (m).
    pub standing: &'a [(LegId, Point3<f64>)],
    /// Gravity (m/s²).
    pub gravity: f64,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// Coefficient of friction under all feet, for [`Preference::Friction`].
    pub friction: f64,
    /// Clearances that are kept.
    pub keep: Keep,
    /// Where the wheel may touch while it is lifted.
    pub lift_zone: Option<ContactZone>,
    /// ... while it is put down.
    pub drop_zone: Option<ContactZone>,
    /// Only collisions and limits: the transit alone was asked for.
    pub transit_only: bool,
}

impl<'a> CheckContext<'a> {
    fn footing(&self) -> Footing<'a> {
        Footing { scene: self.scene, preference: self.preference, friction: self.friction }
    }
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
    let mut seen = Seen::new();
    let shifts = waypoints.iter().take_while(|w| w.stance.is_some()).count();
    let shift: Vec<&Waypoint> = waypoints[..shifts].iter().collect();
    look_along_shift(context, &shift, &mut seen);
    look_along_leg(context, &waypoints[shifts.saturating_sub(1)..], &mut seen);
    let mut findings = vec![
        start_finding(context, waypoints),
        limits_finding(context, &seen.limits),
        touch_finding(context, "clearance_links", "links of the robot", &seen.links),
        touch_finding(context, "clearance_environment", "ground and obstacles", &seen.environment),
    ];
    findings.extend(assumption(context, &seen.unknown));
    if shifts > 1 {
        findings.push(closure_finding(context, &seen.closure));
    }
    if !context.transit_only {
        findings.push(margin_finding(context, &seen.regular));
        findings.push(rule_finding(&seen.rule_spare));
        findings.push(torque_finding(context, &seen.torque));
        findings.extend(footfall_finding(context, waypoints));
    }
    CheckReport { findings, margins: seen.margins }
}

/// The least of everything along the way.
struct Seen {
    limits: Least<(LegId, usize)>,
    links: Least<Violation>,
    environment: Least<Violation>,
    unknown: Least<OverUnknown>,
    closure: Least<()>,
    regular: Least<String>,
    rule_spare: Least<rule::Verdict>,
    torque: Least<(LegId, usize)>,
    margins: Vec<(f64, f64)>,
}

impl Seen {
    fn new() -> Seen {
        Seen {
            limits: Least::new(),
            links: Least::new(),
            environment: Least::new(),
            unknown: Least::new(),
            closure: Least::new(),
            regular: Least::new(),
            rule_spare: Least::new(),
            torque: Least::new(),
            margins: Vec::new(),
        }
    }

    fn limits_of(&mut self, context: &CheckContext, leg: LegId, angles: &LegAngles, time: f64) {
        let model = context.scene.robot().leg(leg);
        for i in 0..model.n_joints() {
            let spare = (angles[i] - model.lower[i]).min(model.upper[i] - angles[i]);
            self.limits.take(spare, time, (leg, i));
        }
    }

    fn stability_of(
        &mut self,
        context: &CheckContext,
        posture: &Posture,
        standing: &[(LegId, Point3<f64>)],
        footing: Footing,
        time: f64,
    ) {
        let robot = context.scene.robot();
        let report = footing.assess(posture, standing, context.gravity);
        let verdict = rule::verdict(&report, robot.stance(), footing.preference);
        if let Ok(support) = &report.regular {
            self.margins.push((time, support.margin.depth_m));
            let legs = support.critical.map(|leg| robot.leg(leg).name.clone()).join(" and ");
            self.regular.take(support.margin.depth_m, time, legs);
        }
        let spare = verdict.margin_m.map_or(f64::NEG_INFINITY, |m| m - verdict.required_m);
        self.rule_spare.take(
            if verdict.ok { spare.max(0.0) } else { spare.min(-1e-12) },
            time,
            verdict,
        );
        let worst = report.torque.worst;
        self.torque.take(1.0 - worst.ratio.abs(), time, (worst.leg, worst.place));
    }
}

/// The leg from the end of the shift on: forward, never by more than the clearance seen allows.
fn look_along_leg(context: &CheckContext, waypoints: &[Waypoint], seen: &mut Seen) {
    let Some(first) = waypoints.first() else { return };
    let robot = context.scene.robot();
    let at_rest = Posture::new(robot, context.stepping_from);
    let checker = LegChecker::keeping(context.scene, &at_rest, context.leg, context.keep.clone());
    let advance = Advance::new(robot, context.leg);
    let mut walk = Walk { context, checker, advance, posture: at_rest, speed: 0.0, seen };
    // The first waypoint stands for the phase that begins there, after a shift too.
    let next = waypoints.get(1).unwrap_or(first);
    let mut free = walk.look(first.time, &first.angles, &Piece::between(first, next), next.phase);
    walk.weigh(first.time);
    for w in waypoints.windows(2) {
        let (a, b) = (&w[0], &w[1]);
        let piece = Piece::between(a, b);
        walk.speed = walk.speed_along(&piece);
        let (mut t, mut weighed) = (0.0, 0.0);
        while t < 1.0 {
            // Nothing can be met before some point of the leg has gone as far as was free, and no
            // distance is less than half of what was seen; where nearly nothing is free, as near as
            // rounding.
            let share = if walk.speed > 0.0 { SHARE * free / walk.speed } else { 1.0 };
            let to_weigh = (weighed + piece.coarsest).min(1.0);
            t = (t + share.max(piece.finest)).min(to_weigh);
            let angles = a.angles * (1.0 - t) + b.angles * t;
            let time = a.time * (1.0 - t) + b.time * t;
            free = walk.look(time, &angles, &piece, b.phase);
            if t >= to_weigh {
                walk.weigh(time);
                weighed = t;
            }
        }
    }
}

/// A joint-linear piece of the way of the leg.
struct Piece {
    way: LegAngles,
    /// Least and most between two configurations looked at, as shares of the piece.
    finest: f64,
    coarsest: f64,
}

impl Piece {
    fn between(a: &Waypoint, b: &Waypoint) -> Piece {
        let way = b.angles - a.angles;
        let most = way.amax();
        let (finest, coarsest) = (FINEST / most.max(FINEST), STEP / most.max(STEP));
        Piece { way, finest, coarsest }
    }
}

/// The leg on its way.
struct Walk<'w> {
    context: &'w CheckContext<'w>,
    checker: LegChecker<'w>,
    advance: Advance,
    posture: Posture,
    /// How far any point of the leg gets per share of the piece under way (m), from here on.
    speed: f64,
    seen: &'w mut Seen,
}

impl Walk<'_> {
    fn speed_along(&self, piece: &Piece) -> f64 {
        self.advance.speed(&self.posture, &piece.way, piece.coarsest)
    }

    /// Looks at one configuration; how far any point of the leg may go from there (m).
    fn look(&mut self, time: f64, angles: &LegAngles, piece: &Piece, phase: Phase) -> f64 {
        let context = self.context;
        let robot = context.scene.robot();
        self.seen.limits_of(context, context.leg, angles, time);
        self.posture.move_leg(robot, context.leg, angles);
        self.speed = self.speed_along(piece);
        let zone = match phase {
            Phase::Lift => context.lift_zone.as_ref(),
            Phase::Shift | Phase::Transit => None,
            Phase::Drop | Phase::Preload => context.drop_zone.as_ref(),
        };
        let allowance = Allowance { zone, buffered: phase == Phase::Transit };
        let clearance = self.checker.clearance_within(&self.posture, allowance, self.reach(piece));
        if let Some(v) = clearance.links {
            self.seen.links.take(spare(&v), time, v);
        }
        if let Some(v) = clearance.environment {
            self.seen.environment.take(spare(&v), time, v);
        }
        if let Some(over) = over_unknown(context.scene, &self.posture, context.leg) {
            self.seen.unknown.take(over.above, time, over);
        }
        clearance.room
    }

    /// Takes the stability of the configuration that was looked at.
    fn weigh(&mut self, time: f64) {
        let context = self.context;
        if !context.transit_only {
            let standing = context.standing;
            self.seen.stability_of(context, &self.posture, standing, context.footing(), time);
        }
    }

    /// Distances beyond the least seen so far are of no use, but for the longest step to the next
    /// look.
    fn reach(&self, piece: &Piece) -> Reach {
        let most = REACH * self.context.scene.robot().scale();
        let next = piece.coarsest * self.speed / SHARE;
        let reach = |least: f64| least.max(next).min(most);
        Reach {
            links: reach(self.seen.links.value),
            environment: reach(self.seen.environment.value),
        }
    }
}

/// The whole robot while the body is shifted.
fn look_along_shift(context: &CheckContext, waypoints: &[&Waypoint], seen: &mut Seen) {
    let robot = context.scene.robot();
    let knots: Vec<(f64, &Configuration)> =
        waypoints.iter().filter_map(|w| Some((w.time, w.stance.as_ref()?))).collect();
    let Some((_, first)) = knots.first() else { return };
    let at_start = survey(context.scene, &Posture::new(robot, first));
    let contacts = at_start.contacts(context.scene, &Posture::new(robot, first));
    let legs: Vec<LegId> = contacts.iter().map(|(leg, _)| *leg).collect();
    for w in knots.windows(2) {
        let ((from, a), (to, b)) = (w[0], w[1]);
        let change = a.legs.iter().zip(&b.legs).map(|(a, b)| (b - a).amax()).fold(0.0, f64::max);
        let n = (change / SHIFT_STEP).ceil().max(1.0) as usize;
        let closure = crate::shift::closure_error(robot, a, b, &legs);
        seen.closure.take(CLOSURE * robot.scale() - closure, from, ());
        for i in 0..=n {
            let t = i as f64 / n as f64;
            let time = from * (1.0 - t) + to * t;
            let here = crate::shift::base_between(robot, a, b, &legs, t);
            for leg in robot.leg_ids() {
                seen.limits_of(context, leg, &here.legs[leg.0], time);
            }
            let posture = Posture::new(robot, &here);
            look_at_body(context, &posture, &at_start, seen, time);
            let footing = context.footing().on_all_feet();
            seen.stability_of(context, &posture, &contacts, footing, time);
        }
    }
}

/// Pairs that are nearer than they may be. What already was at the start may stay as near.
fn look_at_body(
    context: &CheckContext,
    posture: &Posture,
    at_start: &Survey,
    seen: &mut Seen,
    time: f64,
) {
    let now = survey(context.scene, posture);
    let place = posture.link(rover::LinkId(0)).translation.vector.into();
    let violation = |pair: &PairDistance| {
        let required = at_start.kept(pair.touch, pair.tolerance);
        Violation { touch: pair.touch, distance: pair.distance, required, place }
    };
    for v in now.links.iter().map(violation) {
        seen.links.take(spare(&v), time, v);
    }
    for v in now.environment.iter().map(violation) {
        seen.environment.take(spare(&v), time, v);
    }
}

fn closure_finding(context: &CheckContext, closure: &Least<()>) -> Finding {
    let allowed = CLOSURE * context.scene.robot().scale();
    Finding {
        check: "closure",
        ok: closure.value >= 0.0,
        margin: Some(closure.value),
        place: format!("from {:.1} s", closure.time),
        detail: format!(
            "standing wheels leave their places by {:.1} mm at most, {:.1} mm are allowed",
            1e3 * (allowed - closure.value),
            1e3 * allowed
        ),
    }
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

fn limits_finding(context: &CheckContext, limits: &Least<(LegId, usize)>) -> Finding {
    let robot = context.scene.robot();
    let joint = limits.what.map_or("", |(leg, i)| &robot.joints()[robot.leg(leg).joints[i]].name);
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
                REACH * context.scene.robot().scale()
            ),
        };
    };
    let unknown = matches!(v.touch, Touch::UnknownGround(_));
    let (x, y) = (v.place.x, v.place.y);
    Finding {
        check,
        ok: least.value >= -ROUNDING && !unknown,
        margin: Some(least.value),
        place: format!("{} at {:.1} s", touch_text(context.scene, v.touch), least.time),
        detail: if unknown {
            format!("the leg moves over ground that nobody has seen, at ({x:.2}, {y:.2}) m")
        } else {
            format!("{:.3} m apart, {:.3} m are kept", v.distance, v.required)
        },
    }
}

/// That the leg passes over ground which nobody has seen, and what that is taken to be. Where there is no bound of it the
/// clearance fails.
fn assumption(context: &CheckContext, unknown: &Least<OverUnknown>) -> Option<Finding> {
    let over = unknown.what?;
    let link = &context.scene.robot().links()[over.link.0].name;
    let Point3 { coords: place, .. } = over.place;
    Some(Finding {
        check: Finding::UNKNOWN_GROUND,
        ok: over.above.is_finite(),
        margin: Some(over.above),
        place: format!("{link} at {:.1} s, over ({:.2}, {:.2}) m", unknown.time, place.x, place.y),
        detail: format!(
            "the leg passes over ground that nobody has seen: it is taken to be no higher than {:.2} m there, \
             which follows from the ground about it",
            place.z
        ),
    })
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
            "largest torque {:.0} % of its limit, legs as springs within their error",
            100.0 * ratio
        ),
    }
}

fn footfall_finding(context: &CheckContext, waypoints: &[Waypoint]) -> Option<Finding> {
    let zone = context.drop_zone.as_ref()?;
    let last = waypoints.last()?;
    let robot = context.scene.robot();
    let posture = Posture::new(robot, &context.stepping_from.with_leg(context.leg, last.angles));
    let wheel = posture.wheel(robot, context.leg);
    let gap = wheel_ground(&wheel, context.scene.map(), |_| true).nearest;
    let height = gap.map_or(f64::INFINITY, |g| g.gap);
    Some(Finding {
        check: "footfall",
        ok: height.abs() <= zone.ground_tolerance,
        margin: Some(zone.ground_tolerance - height.abs()),
        place: format!("{} on the ground", robot.leg(context.leg).name),
        detail: if height < 0.0 {
            format!("the wheel ends pressed {:.1} mm into the ground of the map", -1e3 * height)
        } else {
            format!("the wheel ends {:.1} mm above the ground of the map", 1e3 * height)
        },
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
