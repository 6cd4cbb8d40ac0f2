//! What a posture has to spare, and whether that meets a wish.

use geometry::ConvexRegion;
use nalgebra::Point3;
use rover::{LegId, Posture, Robot, StanceRules};
use stability::rule::StanceReport;
use stability::torque::WorstJoint;

use super::Wish;
use crate::footing::Footing;
use crate::shift::Barrier;

/// Margins are met to this (m).
const ROUNDING: f64 = 1e-9;

/// What the conservative region is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// An area.
    Area,
    /// A single point, which has no inside: four feet.
    Point,
    /// Nothing.
    Empty,
}

/// What a posture has to spare over the feet that stay, by the full assessment.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// The legs that stay.
    pub standing: Vec<LegId>,
    /// Regular margin (m); none without a support polygon.
    pub regular: Option<f64>,
    /// What the worst settlement of one foot by the robot's s leaves (m).
    pub settlement: Option<f64>,
    /// What the conservative region is.
    pub region: Region,
    /// Conservative margin (m); for a point minus the distance to it.
    pub conservative: Option<f64>,
    /// The most that the regular margin could be over these feet, wherever the center of mass were (m).
    pub regular_most: Option<f64>,
    /// The same of the conservative margin, where its region is an area.
    pub conservative_most: Option<f64>,
    /// Margin in the region that friction holds (m), where it was asked for.
    pub friction: Option<f64>,
    /// The joint that is loaded most, as a share of its limit, within the band of the compliant
    /// rover's loads.
    pub torque: WorstJoint,
}

impl Margins {
    /// Of a posture on these feet under `gravity` (m/s²).
    pub(crate) fn of(
        footing: &Footing,
        posture: &Posture,
        staying: &[(LegId, Point3<f64>)],
        gravity: f64,
    ) -> Margins {
        let report = footing.assess(posture, staying, gravity);
        let friction = report.friction.as_ref().and_then(|region| region.margin(&report.com));
        let StanceReport { standing, regular, conservative, settlement, torque, .. } = report;
        let region = match conservative.as_ref().map(|c| &c.region) {
            Some(ConvexRegion::Area(_)) => Region::Area,
            Some(ConvexRegion::Point(_)) => Region::Point,
            Some(ConvexRegion::Empty) | None => Region::Empty,
        };
        let area = conservative.as_ref().and_then(|c| c.region.area());
        let conservative_most = area.map(|area| area.deepest_point().1);
        let regular_most = regular.as_ref().ok().map(|r| r.polygon.deepest_point().1);
        Margins {
            regular_most,
            conservative_most,
            friction,
            standing,
            regular: regular.ok().map(|regular| regular.margin.depth_m),
            settlement: settlement.map(|worst| worst.margin_m),
            region,
            conservative: conservative.and_then(|conservative| conservative.margin_m),
            torque: torque.worst,
        }
    }

    /// What there is to spare of the margin rule and the wish (m), negative if something is missing.
    pub fn spare(&self, wish: &Wish, rules: &StanceRules) -> f64 {
        let regular = self.regular.map(|m| m - wish.regular.max(rules.margin));
        let conservative = wish.conservative.map(|c| self.conservative.map(|m| m - c));
        let friction = wish.friction.map(|f| self.friction.map(|m| m - f.max(rules.margin)));
        let parts = [Some(regular), Some(self.settlement), conservative, friction];
        let value = |part: Option<f64>| part.unwrap_or(f64::NEG_INFINITY);
        parts.into_iter().flatten().map(value).fold(f64::INFINITY, f64::min)
    }

    /// Is the wish met, and is the posture within the joints' torques?
    pub fn meet(&self, wish: &Wish, rules: &StanceRules) -> bool {
        // A point has no inside: even a center of mass over it has nothing to spare.
        let survives = wish.conservative.is_none() || self.region == Region::Area;
        survives && !self.torque.is_overloaded() && self.spare(wish, rules) >= -ROUNDING
    }

    /// Why a posture that has enough by the search's short cut does not do.
    pub(crate) fn barrier(&self, robot: &Robot) -> Barrier {
        if self.torque.is_overloaded() {
            return torque_barrier(robot, &self.torque);
        }
        Barrier::new("stability", "the full assessment does not confirm the margin")
    }
}

/// A joint that bears more than it can.
pub(super) fn torque_barrier(robot: &Robot, worst: &WorstJoint) -> Barrier {
    let index = robot.leg(worst.leg).joints.get(worst.place);
    let name = index.map_or("a joint", |i| robot.joints()[*i].name.as_str());
    let share = worst.ratio.abs();
    let text = format!("{name} would bear {share:.2} of its torque limit");
    Barrier::new("torque", text).missing(share - 1.0, "1")
}
