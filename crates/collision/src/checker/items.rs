//! What is looked at: the parts of the leg, what they are held against, and what each pair must keep.

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rover::{Frame, JointKind, LegAngles, LegId, Robot, place_of};

use super::LegChecker;
use crate::form::{Form, Placed};
use crate::ground::highest_known;
use crate::pairs::{Body, pair_tolerance};
use crate::solid::Part;

/// How far a part may be from round about a joint's axis, and still count as round (m at scale 1).
const ROUND_ABOUT: f64 = 1e-9;

/// The inmost place that moves a part which is at `place_from_part` at the place given, and where it is
/// there: a round part about a joint's axis, as most joints' housings are, is where it was however that
/// joint turns.
pub(super) fn inmost(
    robot: &Robot,
    leg: LegId,
    part: &Part,
    mut place: usize,
    mut place_from_part: Isometry3<f64>,
) -> (usize, Isometry3<f64>) {
    let model = robot.leg(leg);
    let slack = ROUND_ABOUT * robot.scale();
    while place > 0 {
        let joint = &robot.joints()[model.joints[place]];
        let center = place_from_part.translation.vector;
        let is_on_axis = center.cross(&joint.axis).norm() <= slack;
        let along = place_from_part * Vector3::y();
        let is_round = match part.form {
            Form::Sphere { .. } => true,
            Form::Cylinder { .. } | Form::Capsule { .. } => {
                along.cross(&joint.axis).norm() * part.core.half.norm().max(part.core.radius)
                    <= slack
            }
            Form::Box { .. } | Form::Hull { .. } => false,
        };
        let carrier = place_of(robot, leg, joint.parent);
        match carrier {
            Some((inner, inner_from_parent))
                if joint.kind == JointKind::Revolute && is_on_axis && is_round =>
            {
                place_from_part = inner_from_parent * joint.parent_from_joint * place_from_part;
                place = inner;
            }
            _ => break,
        }
    }
    (place, place_from_part)
}

/// A part of the moving leg.
pub(crate) struct Moving<'a> {
    pub part: &'a Part,
    /// The place of the leg that moves it: see [`inmost`].
    pub place: usize,
    pub(super) place_from_part: Frame,
    /// Where the part is on the link of its body.
    pub link_from_part: Frame,
    pub is_foot: bool,
    /// Clearance that each other moving part keeps from it (m).
    pub required: Vec<Option<f64>>,
}

impl Moving<'_> {
    /// Where the part is in the frame of the link that moves it.
    pub fn place_from_part(&self) -> &Frame {
        &self.place_from_part
    }

    /// A sphere in the frame of the link that moves it that holds the part: center and radius (m).
    pub fn sphere_in_place(&self) -> (Point3<f64>, f64) {
        let core = &self.part.core;
        (Point3::from(self.place_from_part.origin), core.half.norm() + core.radius)
    }
}

pub(crate) struct Fixed<'a> {
    pub part: &'a Part,
    pub placed: Placed,
    /// Clearance that each moving part keeps from it (m); none for pairs that are not checked.
    pub required: Vec<Option<f64>>,
}

pub(crate) struct Group {
    pub center: Point3<f64>,
    pub radius: f64,
    pub members: std::ops::Range<usize>,
    /// Greatest clearance that any of its pairs keeps (m).
    pub most_required: f64,
}

/// One thing to look at: a moving part and what it is held against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Item {
    pub moving: u16,
    pub against: Against,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Against {
    Ground,
    Solids,
    Group(u16),
    Fixed(u16),
    Own(u16),
}

impl LegChecker<'_> {
    /// What each moving part must keep from each fixed one, and from each other moving one.
    pub(super) fn tabulate(&mut self) {
        let of = |part: &Part, moving: &[Moving]| -> Vec<Option<f64>> {
            moving.iter().map(|m| self.pair_required(m.part, part)).collect()
        };
        let fixed: Vec<_> = self.fixed.iter().map(|f| of(f.part, &self.moving)).collect();
        let own: Vec<_> = self.moving.iter().map(|m| of(m.part, &self.moving)).collect();
        for (fixed, required) in self.fixed.iter_mut().zip(fixed) {
            fixed.required = required;
        }
        for (moving, required) in self.moving.iter_mut().zip(own) {
            moving.required = required;
        }
    }

    /// Groups of fixed parts, obstacles within reach, and the list of items.
    pub(super) fn gather(&mut self) {
        let body_of = |fixed: &Fixed| match fixed.part.body {
            Body::Base => None,
            Body::Leg { leg, .. } => Some(leg),
        };
        let mut start = 0;
        while start < self.fixed.len() {
            let same = |f: &&Fixed| body_of(f) == body_of(&self.fixed[start]);
            let end = start + self.fixed[start..].iter().take_while(same).count();
            let members = &self.fixed[start..end];
            let sum = members.iter().fold(Vector3::zeros(), |sum, f| sum + f.placed.frame.origin);
            let center = Point3::from(sum / members.len() as f64);
            let radius = members
                .iter()
                .map(|f| (f.placed.center() - center).norm() + f.placed.bound)
                .fold(0.0, f64::max);
            let most_required = self
                .moving
                .iter()
                .flat_map(|m| members.iter().filter_map(|f| self.pair_required(m.part, f.part)))
                .fold(f64::NEG_INFINITY, f64::max);
            if most_required.is_finite() {
                self.groups.push(Group { center, radius, members: start..end, most_required });
            }
            start = end;
        }
        let hip = self.chain.frames(&LegAngles::zeros()).links[0].origin;
        let reaches = self.reach_of_parts();
        let leg_reach = reaches.iter().copied().fold(0.0, f64::max);
        let reach = leg_reach + self.environment() + self.keep.obstacle_buffer;
        let beside = nalgebra::Vector2::repeat(reach);
        let center = Point2::new(hip.x, hip.y);
        self.roof = highest_known(self.scene, center - beside, center + beside);
        self.near_solids = (0..self.scene.solids.len())
            .filter(|i| {
                let placed = &self.scene.solids[*i].placed;
                let center: Point3<f64> = placed.center();
                (center.coords - hip).norm() <= reach + placed.bound
            })
            .collect();
        for (i, moving) in self.moving.iter().enumerate() {
            let item = |against| Item { moving: i as u16, against };
            self.items.push(item(Against::Ground));
            if !self.near_solids.is_empty() {
                self.items.push(item(Against::Solids));
            }
            // Most legs are out of reach of most parts, whatever the angles.
            let near = |group: &Group| {
                let reach = reaches[i] + group.radius + group.most_required;
                (group.center.coords - hip).norm() <= reach
            };
            let near = (0..self.groups.len()).filter(|g| near(&self.groups[*g]));
            self.items.extend(near.map(|g| item(Against::Group(g as u16))));
            for (j, other) in self.moving.iter().enumerate().skip(i + 1) {
                if self.pair_required(moving.part, other.part).is_some() {
                    self.items.push(item(Against::Own(j as u16)));
                }
            }
        }
    }

    /// Farthest that any point of each moving part can be from the leg's first joint (m).
    fn reach_of_parts(&self) -> Vec<f64> {
        let robot = self.scene.robot();
        let joints = robot.leg(self.leg).joints.iter().map(|j| &robot.joints()[*j]);
        let mut to_places = Vec::new();
        let mut to_place = 0.0;
        for (place, joint) in joints.enumerate() {
            if place > 0 {
                to_place += joint.parent_from_joint.translation.vector.norm();
            }
            if joint.kind == JointKind::Prismatic {
                to_place += joint.lower.abs().max(joint.upper.abs());
            }
            to_places.push(to_place);
        }
        let reach = |m: &Moving| {
            let core = &m.part.core;
            to_places[m.place] + m.place_from_part.origin.norm() + core.half.norm() + core.radius
        };
        self.moving.iter().map(reach).collect()
    }

    fn pair_required(&self, a: &Part, b: &Part) -> Option<f64> {
        let required = pair_tolerance(self.scene.robot(), a.body, b.body)?;
        Some(self.keep.pairs.unwrap_or(required) + self.keep.inflation)
    }
}
