//! The free space of one leg over real ground: limits, collisions, tolerances, stability.

use collision::{ContactZone, LegChecker, Violation};
use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Isometry3, Point3};
use rover::{LegAngles, LegId, Posture, Robot};
use stability::rule::Preference;
use stability::{settlement, support_polygon};

use crate::space::{Space, WheelSpace, edge_is_sampled_free};

/// Resolution of edges (rad, largest joint).
const EPSILON: f64 = 0.01;

/// The margin rule over fixed feet, prepared so that asking it is cheap.
#[derive(Debug, Clone)]
pub(crate) struct StanceGuard {
    contacts: Vec<Point3<f64>>,
    regular: ConvexPolygon,
    conservative: Option<ConvexRegion>,
    margin: f64,
    settlement: f64,
}

impl StanceGuard {
    /// `None` where the feet enclose no support polygon.
    pub fn new(
        robot: &Robot,
        standing: &[(LegId, Point3<f64>)],
        preference: Preference,
    ) -> Option<StanceGuard> {
        let contacts: Vec<Point3<f64>> = standing.iter().map(|(_, p)| *p).collect();
        let regular = support_polygon::regular(&contacts).ok()?;
        let conservative = match preference {
            Preference::Regular => None,
            Preference::Conservative => Some(support_polygon::conservative(&contacts).ok()?),
        };
        let rules = robot.stance();
        let (margin, settlement) = (rules.margin, rules.settlement);
        Some(StanceGuard { contacts, regular, conservative, margin, settlement })
    }

    fn holds(&self, com: &Point3<f64>) -> bool {
        let regular = self.regular.depth_of(com.xy()) >= self.margin;
        let settles = || {
            settlement::worst(&self.contacts, com, self.settlement)
                .is_some_and(|worst| worst.margin_m >= 0.0)
        };
        let survives = || match &self.conservative {
            None => true,
            Some(ConvexRegion::Area(polygon)) => polygon.depth_of(com.xy()) >= 0.0,
            Some(ConvexRegion::Point(_) | ConvexRegion::Empty) => false,
        };
        regular && settles() && survives()
    }
}

/// What a leg met on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Blocked {
    Touch(Violation),
    Unstable,
    Limits,
}

/// The leg's joint space in a scene; counts what it checks.
pub(crate) struct LegSpace<'a> {
    checker: &'a LegChecker<'a>,
    robot: &'a Robot,
    posture: Posture,
    guard: Option<&'a StanceGuard>,
    /// Where the wheel may touch, if anywhere.
    pub zone: Option<ContactZone>,
    /// Configurations checked.
    pub n_checked: u64,
    /// What blocked the last configuration that was not free.
    pub last: Option<Blocked>,
}

impl<'a> LegSpace<'a> {
    pub fn new(
        checker: &'a LegChecker<'a>,
        robot: &'a Robot,
        posture: &Posture,
        guard: Option<&'a StanceGuard>,
    ) -> LegSpace<'a> {
        let posture = posture.clone();
        LegSpace { checker, robot, posture, guard, zone: None, n_checked: 0, last: None }
    }

    /// What stands in the way at these angles.
    pub fn blocked(&mut self, angles: &LegAngles) -> Option<Blocked> {
        self.n_checked += 1;
        let leg = self.robot.leg(self.checker.leg());
        if !(*angles >= leg.lower.add_scalar(-1e-9) && *angles <= leg.upper.add_scalar(1e-9)) {
            return Some(Blocked::Limits);
        }
        self.posture.move_leg(self.robot, self.checker.leg(), angles);
        if let Some(violation) = self.checker.violation(&self.posture, self.zone.as_ref()) {
            return Some(Blocked::Touch(violation));
        }
        let unstable =
            self.guard.is_some_and(|guard| !guard.holds(&self.posture.center_of_mass(self.robot)));
        unstable.then_some(Blocked::Unstable)
    }

    /// The first thing in the way along joint-linear pieces, ends included, at points no farther
    /// apart than `epsilon` (rad, largest joint).
    pub fn blocked_along(&mut self, knots: &[LegAngles], epsilon: f64) -> Option<Blocked> {
        if let Some(first) = knots.first()
            && let Some(blocked) = self.blocked(first)
        {
            return Some(blocked);
        }
        for w in knots.windows(2) {
            let n = ((w[1] - w[0]).amax() / epsilon).ceil().max(1.0) as u64;
            for i in 1..=n {
                let t = i as f64 / n as f64;
                if let Some(blocked) = self.blocked(&(w[0] * (1.0 - t) + w[1] * t)) {
                    return Some(blocked);
                }
            }
        }
        None
    }
}

impl Space for LegSpace<'_> {
    fn lower(&self) -> &LegAngles {
        &self.robot.leg(self.checker.leg()).lower
    }

    fn upper(&self) -> &LegAngles {
        &self.robot.leg(self.checker.leg()).upper
    }

    fn is_free(&mut self, angles: &LegAngles) -> bool {
        let blocked = self.blocked(angles);
        self.last = blocked.or(self.last);
        blocked.is_none()
    }

    fn edge_is_free(&mut self, a: &LegAngles, b: &LegAngles) -> bool {
        self.is_free(a) && self.is_free(b) && edge_is_sampled_free(self, a, b, EPSILON)
    }

    fn epsilon(&self) -> Option<f64> {
        Some(EPSILON)
    }

    fn n_checked(&self) -> u64 {
        self.n_checked
    }
}

impl WheelSpace for LegSpace<'_> {
    fn wheel(&self, angles: &LegAngles) -> Isometry3<f64> {
        let leg = self.checker.leg();
        self.posture.with_leg(self.robot, leg, angles).wheel(self.robot, leg).world_from_wheel
    }

    fn angles_at(&self, wheel: &Isometry3<f64>) -> Vec<LegAngles> {
        let found = self.posture.inverse_kinematics(self.robot, self.checker.leg(), wheel);
        let within = found.iter().flatten().filter(|solution| solution.within_limits);
        within.map(|solution| solution.angles).collect()
    }
}
