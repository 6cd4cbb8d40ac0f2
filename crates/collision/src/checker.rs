//! One moving leg against the ground, the obstacles and the rest of the robot.
//!
//! The rest of the robot is placed once. Quick bounds come first ([`crate::form`]), exact shapes only
//! where these leave it open; the same look serves one configuration and a whole piece of a motion
//! ([`crate::certificate`]): for a piece every distance must exceed how far the bodies can get.

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rover::{
    Frame, JointKind, LegAngles, LegChain, LegFrames, LegId, LinkId, Posture, Robot, place_of,
};

use crate::form::{Core, Form, Placed};
use crate::ground::{Kernel, highest_known, is_near_ground_at, near_known_ground};
use crate::look::{Ask, Look, TOUCHING, better, look_at_ground, look_at_pair, look_at_solids};
use crate::pairs::{Body, pair_tolerance};
use crate::scene::Scene;
use crate::solid::Part;

/// What touches what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// Two links of the robot.
    Links(LinkId, LinkId),
    /// A link and the ground.
    Ground(LinkId),
    /// A link and an obstacle, by its index.
    Obstacle(LinkId, usize),
    /// A link over ground that nobody has seen, or outside the map.
    UnknownGround(LinkId),
}

/// Two things nearer than they may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// What touches what.
    pub touch: Touch,
    /// Distance (m), zero where they overlap.
    pub distance: f64,
    /// Distance that must be kept (m).
    pub required: f64,
    /// Where, in `world`.
    pub place: Point3<f64>,
}

/// Where the moving wheel may touch the ground: about its start or its goal.
///
/// While the wheel is in its zone it may be in the ground, by no more than the ground tolerance,
/// and its fork need keep no distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactZone {
    /// The point of contact when the wheel stands.
    pub contact: Point3<f64>,
    /// Center of the wheel when it stands.
    pub center: Point3<f64>,
    /// The zone ends when the wheel's center is farther aside than this (m).
    pub radius: f64,
    /// ... or higher than this above where it stands (m).
    pub height: f64,
    /// How deep a standing wheel may be in the ground (m).
    pub ground_tolerance: f64,
}

/// Share of the ground tolerance that rounding, and the pieces of a line that is not quite straight,
/// may add to the depth of a standing wheel.
pub(crate) const DEPTH_SLACK: f64 = 1.25;

/// Clearances that a motion keeps beside the robot's tolerances (m).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Keep {
    /// From ground and obstacles, in place of the robot's own.
    pub environment: Option<f64>,
    /// Of every pair of links, in place of the robot's own table.
    pub pairs: Option<f64>,
    /// Added to every clearance: tracking error, sag, error of the map.
    pub inflation: f64,
    /// Added about obstacles where [`Allowance::buffered`] says so (F86).
    pub obstacle_buffer: f64,
    /// The ground is raised by this much there (F84).
    pub terrain_lift: f64,
    /// Start and goal of the moving wheel: over them the buffers do not count for the foot.
    pub footfalls: Vec<Point2<f64>>,
}

/// What is allowed, and asked, on a part of the way.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Allowance<'z> {
    /// Where the wheel may touch.
    pub zone: Option<&'z ContactZone>,
    /// The buffers count: the ground is raised by [`Keep::terrain_lift`], and
    /// [`Keep::obstacle_buffer`] is kept about obstacles.
    pub buffered: bool,
}

/// How far a part may be from round about a joint's axis, and still count as round (m at scale 1).
const ROUND_ABOUT: f64 = 1e-9;

/// One leg that moves while the rest of the robot stands.
pub struct LegChecker<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) chain: LegChain,
    leg: LegId,
    pub(crate) keep: Keep,
    /// From the wheel inward: the wheel meets things first.
    pub(crate) moving: Vec<Moving<'a>>,
    pub(crate) fixed: Vec<Fixed<'a>>,
    /// The base and each other leg: parts of `fixed` that lie together.
    pub(crate) groups: Vec<Group>,
    /// Obstacles within reach.
    pub(crate) near_solids: Vec<usize>,
    /// Highest ground within reach (m), if all of it is known.
    pub(crate) roof: Option<f64>,
    /// All that is looked at, from the wheel inward.
    pub(crate) items: Vec<Item>,
}

/// The inmost place that moves a part which is at `place_from_part` at the place given, and where it is
/// there: a round part about a joint's axis, as most joints' housings are, is where it was however that
/// joint turns.
fn inmost(
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
    place_from_part: Frame,
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

/// The leg at one configuration, and how far it may get from there.
pub(crate) struct Moment<'m> {
    pub frames: &'m LegFrames,
    /// Most that each joint moves either way (rad); zero for one configuration.
    pub change: &'m LegAngles,
    pub allowance: Allowance<'m>,
    /// Ask for exact distances where quick bounds do not tell.
    pub fine: bool,
    /// Only touching counts: no clearance is kept.
    pub touch_only: bool,
    /// Counts as a way that every body may go (m).
    pub extra: f64,
}

impl Moment<'_> {
    /// One configuration.
    pub fn still<'m>(frames: &'m LegFrames, allowance: Allowance<'m>) -> Moment<'m> {
        Moment { frames, change: &STILL, allowance, fine: true, touch_only: false, extra: 0.0 }
    }

    fn required(&self, required: f64) -> f64 {
        if self.touch_only { 0.0 } else { required }
    }
}

/// No joint moves.
static STILL: LegAngles = LegAngles::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

impl<'a> LegChecker<'a> {
    /// Prepares checks of `leg` in `scene` with the rest of the robot as in `posture`.
    ///
    /// `environment` and `pairs` (m) override the robot's own tolerances.
    pub fn new(
        scene: &'a Scene,
        posture: &Posture,
        leg: LegId,
        environment: Option<f64>,
        pairs: Option<f64>,
    ) -> LegChecker<'a> {
        let keep = Keep { environment, pairs, ..Keep::default() };
        LegChecker::keeping(scene, posture, leg, keep)
    }

    /// As [`new`](Self::new) with all clearances that the motion is to keep.
    pub fn keeping(scene: &'a Scene, posture: &Posture, leg: LegId, keep: Keep) -> LegChecker<'a> {
        let robot = scene.robot();
        let mut moving = Vec::new();
        let mut rest: Vec<&Part> = Vec::new();
        for part in scene.parts.iter() {
            match place_of(robot, leg, part.link) {
                Some((place, place_from_link)) => {
                    let at = place_from_link * part.link_from_part;
                    let link_from_part = Frame::from(&at);
                    let (place, place_from_part) = inmost(robot, leg, part, place, at);
                    moving.push(Moving {
                        part,
                        place,
                        link_from_part,
                        place_from_part: Frame::from(&place_from_part),
                        is_foot: part.body.is_outermost(robot),
                        required: Vec::new(),
                    });
                }
                None => rest.push(part),
            }
        }
        moving.reverse();
        rest.sort_by_key(|part| match part.body {
            Body::Base => None,
            Body::Leg { leg, .. } => Some(leg),
        });
        let fixed: Vec<Fixed> = rest
            .into_iter()
            .map(|part| {
                let frame = Frame::from(&(posture.link(part.link) * part.link_from_part));
                Fixed { part, placed: Placed::new(frame, &part.core), required: Vec::new() }
            })
            .collect();
        let chain = LegChain::new(robot, posture, leg);
        let mut checker = LegChecker {
            scene,
            chain,
            leg,
            keep,
            moving,
            fixed,
            groups: Vec::new(),
            near_solids: Vec::new(),
            roof: None,
            items: Vec::new(),
        };
        checker.tabulate();
        checker.gather();
        checker
    }

    /// What each moving part must keep from each fixed one, and from each other moving one.
    fn tabulate(&mut self) {
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
    fn gather(&mut self) {
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

    /// The moving leg.
    pub fn leg(&self) -> LegId {
        self.leg
    }

    /// The kinematics of the moving leg.
    pub fn chain(&self) -> &LegChain {
        &self.chain
    }

    /// The first thing nearer than it may be with the leg as in `posture`; `None` if all is free.
    pub fn violation(&self, posture: &Posture, zone: Option<&ContactZone>) -> Option<Violation> {
        self.violation_in(&self.frames_of(posture), Allowance { zone, buffered: false })
    }

    /// As [`violation`](Self::violation), but only what overlaps: distance zero.
    pub fn collision(&self, posture: &Posture, zone: Option<&ContactZone>) -> Option<Violation> {
        let frames = self.frames_of(posture);
        let moment = Moment::still(&frames, Allowance { zone, buffered: false });
        let moment = Moment { touch_only: true, ..moment };
        self.first_violation(&moment, &mut Scratch::new(self))
    }

    /// As [`violation`](Self::violation) for joint angles.
    pub fn violation_at(&self, angles: &LegAngles, allowance: Allowance) -> Option<Violation> {
        self.violation_in(&self.chain.frames(angles), allowance)
    }

    /// As [`violation_at`](Self::violation_at), with the least distance of the two that are named, over all their
    /// parts: the plain answer is content with the first parts, and the first ground, that are too near.
    pub fn measured_violation_at(
        &self,
        angles: &LegAngles,
        allowance: Allowance,
    ) -> Option<Violation> {
        let frames = self.chain.frames(angles);
        let moment = Moment::still(&frames, allowance);
        let mut scratch = Scratch::new(self);
        let mut worst = self.first_violation(&moment, &mut scratch)?;
        for item in self.items_of(worst.touch) {
            let Look::Violated(mut found) = self.look(&moment, &item, &mut scratch) else {
                continue;
            };
            if matches!(found.touch, Touch::Ground(_)) && found.required > 0.0 {
                let moving = usize::from(item.moving);
                let (part, placed) = (self.moving[moving].part, &scratch.parts[moving].placed);
                let kernel = Kernel::Quick { enough: 0.0 };
                let near = near_known_ground(self.scene, part, placed, found.required, kernel);
                if let Some(near) = near.filter(|near| near.distance < found.distance) {
                    found = Violation { distance: near.distance, place: near.place, ..found };
                }
            }
            let short = |v: &Violation| v.required - v.distance;
            if found.touch == worst.touch && short(&found) > short(&worst) {
                worst = found;
            }
        }
        Some(worst)
    }

    /// The items, and members of groups, that are about a touch.
    fn items_of(&self, touch: Touch) -> Vec<Item> {
        let (link, other) = match touch {
            Touch::Links(a, b) => (a, Some(b)),
            Touch::Ground(a) | Touch::Obstacle(a, _) | Touch::UnknownGround(a) => (a, None),
        };
        let mut found = Vec::new();
        for item in &self.items {
            if self.moving[usize::from(item.moving)].part.link != link {
                continue;
            }
            let is_other = |part: &Part| Some(part.link) == other;
            match item.against {
                Against::Group(group) => {
                    let members = self.groups[usize::from(group)].members.clone();
                    let members = members.filter(|k| is_other(self.fixed[*k].part));
                    found.extend(
                        members.map(|k| Item { against: Against::Fixed(k as u16), ..*item }),
                    );
                }
                Against::Own(j) if is_other(self.moving[usize::from(j)].part) => found.push(*item),
                Against::Ground if matches!(touch, Touch::Ground(_)) => found.push(*item),
                // Of an obstacle the plain look is by the whole part.
                _ => {}
            }
        }
        found
    }

    fn violation_in(&self, frames: &LegFrames, allowance: Allowance) -> Option<Violation> {
        self.first_violation(&Moment::still(frames, allowance), &mut Scratch::new(self))
    }

    /// The first item that is violated at a moment.
    pub(crate) fn first_violation(
        &self,
        moment: &Moment,
        scratch: &mut Scratch,
    ) -> Option<Violation> {
        self.items.iter().find_map(|item| match self.look(moment, item, scratch) {
            Look::Violated(violation) => Some(violation),
            Look::Clear | Look::Open(_) => None,
        })
    }

    pub(crate) fn frames_of(&self, posture: &Posture) -> LegFrames {
        let model = self.scene.robot().leg(self.leg);
        LegFrames {
            // Beyond the last joint stands the last link: the padding of a short leg.
            links: std::array::from_fn(|place| {
                let place = place.min(model.n_joints() - 1);
                Frame::from(posture.link(model.links[place]))
            }),
            axes: [Vector3::zeros(); 6],
            slides: [false; 6],
            angles: LegAngles::repeat(f64::NAN),
        }
    }

    /// Looks at one item. A group that is not clear as a whole is open: look at its members.
    pub(crate) fn look(&self, moment: &Moment, item: &Item, scratch: &mut Scratch) -> Look {
        let index = item.moving as usize;
        scratch.place(self, moment, index);
        let needs_foot = matches!(item.against, Against::Ground | Against::Solids)
            && self.moving[index].is_foot
            && (moment.allowance.zone.is_some() || moment.allowance.buffered);
        if needs_foot {
            scratch.place_foot(self, moment);
        }
        if let Against::Own(j) = item.against {
            scratch.place(self, moment, j as usize);
        }
        let scratch = &*scratch;
        let here = &scratch.parts[index];
        match item.against {
            Against::Ground => self.look_at_ground(moment, index, here, scratch),
            Against::Solids => self.look_at_solids(moment, index, here, scratch),
            Against::Group(group) => {
                let group = &self.groups[group as usize];
                let reach = here.placed.bound + group.radius + group.most_required + here.motion;
                if (here.placed.center() - group.center).norm_squared() >= reach * reach {
                    return Look::Clear;
                }
                let mut clear: Option<f64> = None;
                for k in group.members.clone() {
                    match self.look_at_fixed(moment, index, here, k) {
                        Look::Clear => {}
                        Look::Open(share) => {
                            clear = Some(clear.map_or(share, |clear| clear.min(share)));
                        }
                        violated @ Look::Violated(_) => return violated,
                    }
                }
                clear.map_or(Look::Clear, Look::Open)
            }
            Against::Fixed(k) => self.look_at_fixed(moment, index, here, k as usize),
            Against::Own(j) => {
                let other = &scratch.parts[j as usize];
                self.look_at_own(moment, [index, j as usize], [here, other])
            }
        }
    }

    /// Does a moving part come too near to the ground about `place`? `false` is no answer.
    pub(crate) fn is_near_ground_at(
        &self,
        frames: &LegFrames,
        index: usize,
        place: Point2<f64>,
        scratch: &mut Scratch,
    ) -> bool {
        scratch.place(self, &Moment::still(frames, Allowance::default()), index);
        let (part, placed) = (self.moving[index].part, &scratch.parts[index].placed);
        let required = self.environment().max(TOUCHING);
        is_near_ground_at(self.scene, part, placed, place, required)
    }

    /// The members of a group that are open.
    pub(crate) fn members(&self, group: u16) -> impl Iterator<Item = Against> + use<> {
        self.groups[group as usize].members.clone().map(|k| Against::Fixed(k as u16))
    }

    fn look_at_fixed(&self, moment: &Moment, index: usize, here: &Here, k: usize) -> Look {
        let (moving, fixed) = (&self.moving[index], &self.fixed[k]);
        let Some(required) = fixed.required[index] else { return Look::Clear };
        let required = moment.required(required);
        let places = [&here.placed, &fixed.placed];
        let ask = Ask { required, motion: here.motion, fine: moment.fine };
        look_at_pair([moving.part, fixed.part], places, ask)
    }

    fn look_at_own(&self, moment: &Moment, [i, j]: [usize; 2], [a, b]: [&Here; 2]) -> Look {
        let (first, second) = (&self.moving[i], &self.moving[j]);
        let Some(required) = first.required[j] else { return Look::Clear };
        // Moving parts are in the order from the wheel inward: the first one is farther out, and
        // only the joints between the two change their distance.
        let (outer, inner, here) =
            if first.place >= second.place { (first, second, a) } else { (second, first, b) };
        let [p, q] = here.placed.ends();
        let motion = moment.extra
            + moment.frames.motion_bound(
                outer.place,
                inner.place + 1,
                [&p, &q],
                here.placed.radius,
                moment.change,
            );
        let required = moment.required(required);
        let places = [&a.placed, &b.placed];
        let ask = Ask { required, motion, fine: moment.fine };
        look_at_pair([first.part, second.part], places, ask)
    }

    fn look_at_solids(
        &self,
        moment: &Moment,
        index: usize,
        here: &Here,
        scratch: &Scratch,
    ) -> Look {
        let buffer = if moment.allowance.buffered { self.keep.obstacle_buffer } else { 0.0 };
        let required = moment.required(self.environment() + buffer);
        let mut worst = self.look_at_solids_from(moment, index, here, required);
        if !self.moving[index].is_foot || matches!(worst, Look::Clear) {
            return worst;
        }
        if buffer > 0.0
            && let Some(surely) = self.over_footfall(scratch)
        {
            let required = moment.required(self.environment());
            let look = self.look_at_solids_from(moment, index, here, required);
            worst = better(worst, look, surely);
        }
        // In its zone the foot need not keep its distance from what stands beside the footfall.
        if let Some(surely) = self.zone_holds(moment, scratch) {
            let look = self.look_at_solids_from(moment, index, here, 0.0);
            worst = better(worst, look, surely);
        }
        worst
    }

    fn look_at_solids_from(
        &self,
        moment: &Moment,
        index: usize,
        here: &Here,
        required: f64,
    ) -> Look {
        let part = self.moving[index].part;
        let ask = Ask { required, motion: here.motion, fine: moment.fine };
        look_at_solids(self.scene, part, &here.placed, &self.near_solids, ask)
    }

    fn look_at_ground(
        &self,
        moment: &Moment,
        index: usize,
        here: &Here,
        scratch: &Scratch,
    ) -> Look {
        let moving = &self.moving[index];
        let lift = if moment.allowance.buffered { self.keep.terrain_lift } else { 0.0 };
        let required = moment.required(self.environment());
        // The foot may come nearer where it is allowed to touch: the usual question for a wheel that
        // stands, so it comes first.
        let zone = moment.allowance.zone.filter(|_| moving.is_foot);
        let in_zone = zone.zip(zone.and_then(|_| self.zone_holds(moment, scratch)));
        let in_zone = in_zone.map(|(zone, surely)| {
            // Who only asks for touches is told of the tolerance itself.
            let slack = if moment.touch_only { 1.0 } else { DEPTH_SLACK };
            let depth = slack * zone.ground_tolerance;
            let lift = if moving.part.is_wheel { -depth } else { 0.0 };
            (self.look_at_raised_ground(moment, moving, here, 0.0, lift), surely)
        });
        if let Some((Look::Clear, true)) = in_zone {
            return Look::Clear;
        }
        let usual = self.look_at_raised_ground(moment, moving, here, required, lift);
        if !moving.is_foot || matches!(usual, Look::Clear) {
            return usual;
        }
        // About the footfalls the ground is not raised. One of these must hold for all of the piece.
        let mut worst = usual;
        if lift > 0.0
            && let Some(surely) = self.over_footfall(scratch)
        {
            let look = self.look_at_raised_ground(moment, moving, here, required, 0.0);
            worst = better(worst, look, surely);
        }
        if let Some((look, surely)) = in_zone {
            worst = better(worst, look, surely);
        }
        worst
    }

    /// The part against ground that is raised by `lift` (m).
    fn look_at_raised_ground(
        &self,
        moment: &Moment,
        moving: &Moving,
        here: &Here,
        required: f64,
        lift: f64,
    ) -> Look {
        let placed = here.placed.raised(-lift);
        let ask = Ask { required, motion: here.motion, fine: moment.fine };
        let above = |roof| placed.frame.origin.z - placed.bound - ask.need() >= roof;
        if self.roof.is_some_and(above) {
            return Look::Clear;
        }
        look_at_ground(self.scene, moving.part, &placed, ask)
    }

    /// Is the foot over its start or goal, where the ground is not raised: as
    /// [`zone_holds`](Self::zone_holds).
    pub(crate) fn over_footfall(&self, scratch: &Scratch) -> Option<bool> {
        let wheel = &scratch.foot;
        let radius = self.scene.robot().stance().contact_radius;
        let aside = self.keep.footfalls.iter().map(|p| (wheel.center.xy() - p).norm());
        let aside = aside.fold(f64::INFINITY, f64::min);
        (aside <= radius).then_some(aside + wheel.motion <= radius)
    }

    /// Is the foot in the zone where it may touch: `None` if not, true if over all of the piece.
    pub(crate) fn zone_holds(&self, moment: &Moment, scratch: &Scratch) -> Option<bool> {
        let zone = moment.allowance.zone?;
        let wheel = &scratch.foot;
        let aside = (wheel.center.xy() - zone.center.xy()).norm();
        let above = wheel.center.z - zone.center.z;
        (aside <= zone.radius && above <= zone.height)
            .then_some(aside + wheel.motion <= zone.radius && above + wheel.motion <= zone.height)
    }

    pub(crate) fn environment(&self) -> f64 {
        let own = self.scene.robot().tolerances().environment;
        self.keep.environment.unwrap_or(own) + self.keep.inflation
    }

    fn pair_required(&self, a: &Part, b: &Part) -> Option<f64> {
        let required = pair_tolerance(self.scene.robot(), a.body, b.body)?;
        Some(self.keep.pairs.unwrap_or(required) + self.keep.inflation)
    }
}

/// A moving part at a moment: where, and how far any of its points can get from there (m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Here {
    pub placed: Placed,
    pub motion: f64,
}

/// The center of the moving wheel at a moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foot {
    pub center: Point3<f64>,
    pub motion: f64,
}

/// What has been placed at the present moment: each part when it is first asked for.
pub(crate) struct Scratch {
    pub parts: Vec<Here>,
    /// Which of them hold.
    placed: Vec<bool>,
    foot: Foot,
    foot_placed: bool,
}

impl Scratch {
    pub fn new(checker: &LegChecker) -> Scratch {
        let nowhere = Placed::new(Frame::identity(), &Core::default());
        let n = checker.moving.len();
        Scratch {
            parts: vec![Here { placed: nowhere, motion: 0.0 }; n],
            placed: vec![false; n],
            foot: Foot { center: Point3::origin(), motion: 0.0 },
            foot_placed: false,
        }
    }

    /// Another moment begins.
    pub fn clear(&mut self) {
        self.placed.fill(false);
        self.foot_placed = false;
    }

    pub fn place(&mut self, checker: &LegChecker, moment: &Moment, index: usize) {
        if self.placed[index] {
            return;
        }
        self.placed[index] = true;
        let moving = &checker.moving[index];
        let frame = moment.frames.links[moving.place].after(&moving.place_from_part);
        let placed = Placed::new(frame, &moving.part.core);
        let [a, b] = placed.ends();
        let motion = if std::ptr::eq(moment.change, &STILL) {
            moment.extra
        } else {
            moment.frames.motion_bound(moving.place, 0, [&a, &b], placed.radius, moment.change)
        };
        self.parts[index] = Here { placed, motion };
    }

    pub fn place_foot(&mut self, checker: &LegChecker, moment: &Moment) {
        self.foot_motion(checker, moment.frames, moment.change);
    }

    /// How far the foot's center can get (m).
    pub fn foot_motion(
        &mut self,
        checker: &LegChecker,
        frames: &LegFrames,
        change: &LegAngles,
    ) -> f64 {
        if !self.foot_placed {
            self.foot_placed = true;
            let wheel = &checker.scene.robot().leg(checker.leg).wheel;
            let center = Point3::from(wheel.carrier_from_wheel.translation.vector);
            let center = frames.links[5].point(&center);
            let motion = frames.motion_bound(5, 0, [&center, &center], 0.0, change);
            self.foot = Foot { center, motion };
        }
        self.foot.motion
    }

    /// How far the part that has been looked at can get (m).
    pub fn motion(&self, index: usize) -> f64 {
        self.parts[index].motion
    }
}
