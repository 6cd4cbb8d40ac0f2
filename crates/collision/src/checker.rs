//! One moving leg against the ground, the obstacles and the rest of the robot.
//!
//! The rest of the robot is placed once. Quick bounds come first ([`crate::form`]), exact shapes only
//! where these leave it open; the same look serves one configuration and a whole piece of a motion
//! ([`crate::certificate`]): for a piece every distance must exceed how far the bodies can get.

mod items;
mod looking;
mod measuring;
mod moment;

use nalgebra::{Point2, Point3, Vector3};
use rover::{Frame, LegAngles, LegChain, LegFrames, LegId, LinkId, Posture, place_of};

use self::items::inmost;
pub(crate) use self::items::{Against, Fixed, Group, Item, Moving};
pub(crate) use self::moment::{Here, Moment, Scratch};
use crate::form::Placed;
use crate::look::Look;
use crate::pairs::Body;
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

    pub(crate) fn environment(&self) -> f64 {
        let own = self.scene.robot().tolerances().environment;
        self.keep.environment.unwrap_or(own) + self.keep.inflation
    }
}
