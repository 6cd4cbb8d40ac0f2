//! The free space of one leg over real ground: limits, collisions, tolerances, stability.

use collision::{Allowance, Certificate, Certifier, ContactZone, LegChecker, Violation};
use nalgebra::Isometry3;
use rover::{LegAngles, Posture, Robot};
use stability::StanceGuard;

use crate::answer::EdgeRule;
use crate::space::{Space, WheelSpace, edge_is_sampled_free};

/// What a leg met on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Blocked {
    /// Something is nearer than it may be.
    Touch(Violation),
    /// The margin rule does not hold; what is missing (m).
    Unstable(f64),
    /// A joint is beyond its limits.
    Limits,
    /// Free where it was looked at, but too near to something to be certified.
    Grazing,
}

/// Way of the center of mass over half a piece below which its stability is not looked at any finer
/// (m at scale 1).
const FINEST: f64 = 1e-5;

/// The leg's joint space in a scene; counts what it checks.
pub(crate) struct LegSpace<'a> {
    certifier: Certifier<'a, 'a>,
    robot: &'a Robot,
    posture: &'a Posture,
    guard: Option<&'a StanceGuard>,
    rule: EdgeRule,
    /// Where the wheel may touch, if anywhere.
    pub zone: Option<ContactZone>,
    /// The ground counts as raised by the request's buffer (F84).
    pub buffered: bool,
    n_stable: u64,
    /// What blocked the last configuration or edge that was not free.
    pub last: Option<Blocked>,
}

impl<'a> LegSpace<'a> {
    pub fn new(
        checker: &'a LegChecker<'a>,
        robot: &'a Robot,
        posture: &'a Posture,
        guard: Option<&'a StanceGuard>,
        rule: EdgeRule,
    ) -> LegSpace<'a> {
        let certifier = Certifier::new(checker);
        LegSpace {
            certifier,
            robot,
            posture,
            guard,
            rule,
            zone: None,
            buffered: false,
            n_stable: 0,
            last: None,
        }
    }

    /// The whole robot's center of mass with the leg at these angles, seen along gravity (m).
    pub fn center_of_mass(&self, angles: &LegAngles) -> nalgebra::Vector2<f64> {
        let chain = self.certifier.checker().chain();
        chain.center_of_mass(&chain.frames(angles)).coords.xy()
    }

    /// What stands in the way at these angles.
    pub fn blocked(&mut self, angles: &LegAngles) -> Option<Blocked> {
        let checker = self.certifier.checker();
        let leg = self.robot.leg(checker.leg());
        if !(*angles >= leg.lower.add_scalar(-1e-9) && *angles <= leg.upper.add_scalar(1e-9)) {
            self.n_stable += 1;
            return Some(Blocked::Limits);
        }
        let frames = checker.chain().frames(angles);
        let allowance = Allowance { zone: self.zone.as_ref(), buffered: self.buffered };
        if let Some(violation) = self.certifier.violation_in(&frames, allowance) {
            return Some(Blocked::Touch(violation));
        }
        let spare = self.guard.map(|guard| guard.spare(&checker.chain().center_of_mass(&frames)));
        spare.filter(|spare| *spare < 0.0).map(|spare| Blocked::Unstable(-spare))
    }

    /// Do all parts of the leg but the wheel on its ground keep `extra` (m) beyond what they must?
    pub fn is_roomy(&mut self, angles: &LegAngles, extra: f64) -> bool {
        let allowance = Allowance { zone: self.zone.as_ref(), buffered: self.buffered };
        self.certifier.is_roomy(angles, allowance, extra)
    }

    /// What stands in the way of the straight motion from `a` to `b`, ends included, by the space's
    /// rule. The limits hold between angles within them.
    fn edge_blocked(&mut self, a: &LegAngles, b: &LegAngles) -> Option<Blocked> {
        if let EdgeRule::Sampled(epsilon) = self.rule {
            let ends = self.blocked(a).or_else(|| self.blocked(b));
            return ends.or_else(|| {
                let free = edge_is_sampled_free(self, a, b, epsilon);
                (!free).then(|| self.last.unwrap_or(Blocked::Grazing))
            });
        }
        let leg = self.robot.leg(self.certifier.checker().leg());
        let (lower, upper) = (leg.lower.add_scalar(-1e-9), leg.upper.add_scalar(1e-9));
        if ![a, b].iter().all(|q| **q >= lower && **q <= upper) {
            return Some(Blocked::Limits);
        }
        if let Some(missing) = self.unstable_along(a, b) {
            return Some(Blocked::Unstable(missing));
        }
        let allowance = Allowance { zone: self.zone.as_ref(), buffered: self.buffered };
        match self.certifier.certify(a, b, allowance) {
            Certificate::Free => None,
            Certificate::Blocked { violation, .. } => Some(Blocked::Touch(violation)),
            Certificate::Open { .. } => Some(Blocked::Grazing),
        }
    }

    /// Where the margin rule does not surely hold along the motion: what is missing (m). Pieces are
    /// cut until what the rule has to spare in their middle exceeds the way that the center of mass
    /// can go within them.
    fn unstable_along(&mut self, a: &LegAngles, b: &LegAngles) -> Option<f64> {
        let guard = self.guard?;
        let chain = self.certifier.checker().chain();
        let finest = FINEST * self.robot.scale();
        let mut pieces = vec![(0.5, 0.5)];
        while let Some((middle, half)) = pieces.pop() {
            self.n_stable += 1;
            let frames = chain.frames(&(a * (1.0 - middle) + b * middle));
            let way = chain.com_motion(&((b - a) * half));
            let spare = guard.spare(&chain.center_of_mass(&frames));
            if spare >= way {
                continue;
            }
            if spare < 0.0 || way < finest {
                return Some((-spare).max(0.0));
            }
            let half = 0.5 * half;
            pieces.extend([(middle + half, half), (middle - half, half)]);
        }
        None
    }

    /// The first thing in the way along joint-linear pieces, ends included, by the space's rule.
    pub fn blocked_along(&mut self, knots: &[LegAngles]) -> Option<Blocked> {
        if let [only] = knots {
            return self.blocked(only);
        }
        knots.windows(2).find_map(|w| self.edge_blocked(&w[0], &w[1]))
    }
}

impl Space for LegSpace<'_> {
    fn lower(&self) -> &LegAngles {
        &self.robot.leg(self.certifier.checker().leg()).lower
    }

    fn upper(&self) -> &LegAngles {
        &self.robot.leg(self.certifier.checker().leg()).upper
    }

    fn is_free(&mut self, angles: &LegAngles) -> bool {
        let blocked = self.blocked(angles);
        self.last = blocked.or(self.last);
        blocked.is_none()
    }

    fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
        let blocked = self.edge_blocked(a, b);
        self.last = blocked.or(self.last);
        blocked.is_none()
    }

    fn epsilon(&self) -> Option<f64> {
        match self.rule {
            EdgeRule::Certified => None,
            EdgeRule::Sampled(epsilon) => Some(epsilon),
        }
    }

    fn n_checked(&self) -> u64 {
        self.certifier.n_looked() + self.n_stable
    }
}

impl WheelSpace for LegSpace<'_> {
    fn wheel(&self, angles: &LegAngles) -> Isometry3<f64> {
        let checker = self.certifier.checker();
        let wheel = &self.robot.leg(checker.leg()).wheel;
        checker.chain().frames(angles).links[5].to_isometry() * wheel.carrier_from_wheel
    }

    fn angles_at(&self, wheel: &Isometry3<f64>) -> Vec<LegAngles> {
        let leg = self.certifier.checker().leg();
        let found = self.posture.inverse_kinematics(self.robot, leg, wheel);
        let within = found.iter().flatten().filter(|solution| solution.within_limits);
        within.map(|solution| solution.angles).collect()
    }
}
