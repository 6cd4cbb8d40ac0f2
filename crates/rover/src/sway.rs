//! How far the parts of a rover get while its joints move and planted wheels hold its base.
//!
//! The legs close chains over the ground. All joints move linearly at once; the base goes where
//! points of the standing wheels (*anchors*) fit their places best in the least squares. About the
//! middle of a piece of such a motion each point x of a part has, by the share s of the way,
//!
//! x(s) - x = s P' + R(s) (r + s (u - ū) + e - ē) - r,
//!
//! with r from the anchors' middle to x, u its velocity by the joints alone (the base held), e what
//! the joints add in second order, bars for means over the anchors, P' the velocity of the places'
//! middle, and R the turn of the base. R maximizes tr(Rᵀ Σ pᵢ yᵢᵀ) over the anchors y and their
//! places p, both from their middles: sin θ (w·a) - (1 - cos θ) wᵀMw over axes w and angles θ, with
//! a = Σ yᵢ × pᵢ and M = Σ (pᵢ·yᵢ) 1 - pᵢ yᵢᵀ (symmetrized). So R is off a guess, whose a and M are
//! bounded, by no more than atan(|a| / least eigenvalue of M). The guess turns evenly by the ω that
//! the middle asks for, which leaves an a of second order in s. The velocity P' + ω × r + u - ū is
//! that of both ends of the chain: it vanishes at a planted wheel, and at the chassis it is that of
//! the chassis. Frame `world`, meters, radians.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::chain::{Frame, LegChain, LegFrames, place_of};
use crate::model::{LegId, LinkId, Robot};
use crate::posture::{Configuration, LegAngles, Posture};

/// Added to every bound for what the fit leaves to rounding (m).
const ROUNDING: f64 = 1e-9;

/// A point of a standing wheel that holds the base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// The leg.
    pub leg: LegId,
    /// The point in the frame of the leg's last link (m).
    pub in_link: Point3<f64>,
    /// Its place in `world` at the beginning and at the end; in between evenly (m).
    pub places: [Point3<f64>; 2],
}

/// A motion of the whole robot: linear in the joints, the base where the anchors fit best.
pub trait BodyMotion {
    /// The configuration at a share of the way, 0 to 1.
    fn at(&self, share: f64) -> Configuration;

    /// How far the joints of each leg go in all (rad, or m of a prismatic joint).
    fn way(&self) -> &[LegAngles];

    /// What holds the base.
    fn anchors(&self) -> &[Anchor];
}

/// All legs of a robot, and its masses, prepared for motions of the whole body.
#[derive(Debug, Clone)]
pub struct BodyChain {
    legs: Vec<LegChain>,
    masses: Vec<Mass>,
    total_mass: f64,
}

/// A link's center of mass in the frame of the joint that carries it; in the base's frame for links
/// of the base.
#[derive(Debug, Clone, Copy)]
struct Mass {
    body: Option<(LegId, usize)>,
    center: Point3<f64>,
    mass: f64,
}

impl BodyChain {
    /// Prepares a robot.
    pub fn new(robot: &Robot) -> BodyChain {
        let home = Configuration {
            world_from_base: nalgebra::Isometry3::identity(),
            legs: vec![LegAngles::zeros(); robot.legs().len()],
        };
        let posture = Posture::new(robot, &home);
        let mass_of = |(i, link): (usize, &crate::model::Link)| {
            let id = LinkId(i);
            let in_leg = robot
                .leg_ids()
                .find_map(|leg| place_of(robot, leg, id).map(|(place, from)| (leg, place, from)));
            let (body, center) = match in_leg {
                Some((leg, place, place_from_link)) => {
                    (Some((leg, place)), place_from_link * link.com)
                }
                None => (None, posture.link(id) * link.com),
            };
            Mass { body, center, mass: link.mass }
        };
        BodyChain {
            legs: robot.leg_ids().map(|leg| LegChain::new(robot, &posture, leg)).collect(),
            masses: robot
                .links()
                .iter()
                .enumerate()
                .map(mass_of)
                .filter(|m| m.mass > 0.0)
                .collect(),
            total_mass: robot.mass(),
        }
    }

    /// Forward kinematics of all legs.
    fn frames(&self, configuration: &Configuration) -> Vec<LegFrames> {
        let base = Frame::from(&configuration.world_from_base);
        self.legs
            .iter()
            .zip(&configuration.legs)
            .map(|(chain, angles)| chain.frames_on(&base, angles))
            .collect()
    }
}

/// How far the parts get over a piece of a motion, from its middle either way.
#[derive(Debug, Clone)]
pub struct Sway<'m> {
    chain: &'m BodyChain,
    base: Frame,
    frames: Vec<LegFrames>,
    /// How far the joints go over the whole way, and most either way within the piece.
    way: Vec<LegAngles>,
    change: Vec<LegAngles>,
    /// Half length of the piece as a share of the way.
    half: f64,
    /// None where nothing bounds the base.
    fit: Option<Fit>,
}

/// How the base follows the anchors.
#[derive(Debug, Clone, Copy, Default)]
struct Fit {
    /// The anchors' middle.
    middle: Vector3<f64>,
    /// P' - ū.
    drift: Vector3<f64>,
    /// ω, and how far the base may be off the even turn by it (rad).
    turn: Vector3<f64>,
    slip: f64,
    /// Means of what the joints do to the anchors: velocity, and bound of the second derivative.
    mean_speed: f64,
    mean_curve: f64,
    /// What the fit in the middle itself is off (m).
    gap: f64,
}

/// An anchor in the middle of the piece.
struct Held {
    /// Where it is, and where its place is, from their middles.
    at: Vector3<f64>,
    place: Vector3<f64>,
    /// Velocity by the joints alone, and of its place, both from their means.
    speed: Vector3<f64>,
    place_speed: Vector3<f64>,
    /// Bound of its second derivative by the joints alone.
    curve: f64,
}

impl<'m> Sway<'m> {
    /// One configuration: nothing moves.
    pub fn still(chain: &'m BodyChain, configuration: &Configuration) -> Sway<'m> {
        let still = vec![LegAngles::zeros(); configuration.legs.len()];
        Sway {
            chain,
            base: Frame::from(&configuration.world_from_base),
            frames: chain.frames(configuration),
            way: still.clone(),
            change: still,
            half: 0.0,
            fit: Some(Fit::default()),
        }
    }

    /// The piece from `share - half` to `share + half` of a motion.
    pub fn new(chain: &'m BodyChain, motion: &impl BodyMotion, share: f64, half: f64) -> Sway<'m> {
        let configuration = motion.at(share);
        let frames = chain.frames(&configuration);
        let way = motion.way().to_vec();
        let fit = Fit::new(&frames, &way, motion.anchors(), share, half);
        Sway {
            chain,
            base: Frame::from(&configuration.world_from_base),
            frames,
            change: way.iter().map(|way| way.abs() * half).collect(),
            way,
            half,
            fit,
        }
    }

    /// Where a body is in the middle of the piece: the base (`None`) or what hangs on a joint of a leg.
    pub fn frame(&self, body: Option<(LegId, usize)>) -> &Frame {
        match body {
            Some((leg, place)) => &self.frames[leg.0].links[place],
            None => &self.base,
        }
    }

    /// How far any point of a body can get from where it is in the middle of the piece (m); infinite
    /// where the anchors do not hold the base well enough to bound its turn: the piece is too long,
    /// or there are too few of them.
    ///
    /// The body lies within `radius` of the segment between two points (`world`, m).
    pub fn bound(&self, body: Option<(LegId, usize)>, ends: [&Point3<f64>; 2], radius: f64) -> f64 {
        let Some(fit) = &self.fit else { return f64::INFINITY };
        let turn = fit.turn + body.map_or_else(Vector3::zeros, |body| self.turn_of_joints(body));
        let speed = ends.map(|p| self.speed(fit, body, p).norm());
        let steady = speed[0].max(speed[1]) + radius * turn.norm();
        self.half * steady + self.bend(fit, body, ends, radius)
    }

    /// As [`bound`](Self::bound), as seen from the link of the same leg at place `since` - 1 (from
    /// the base if 0).
    pub fn bound_since(
        &self,
        since: usize,
        (leg, place): (LegId, usize),
        ends: [&Point3<f64>; 2],
        radius: f64,
    ) -> f64 {
        self.frames[leg.0].motion_bound(place, since, ends, radius, &self.change[leg.0])
    }

    /// The center of mass of the whole robot in the middle of the piece, and how far it can get (m).
    pub fn center_of_mass(&self) -> (Point3<f64>, f64) {
        let total = self.chain.total_mass;
        if total <= 0.0 {
            let origin = Point3::from(self.base.origin);
            return (origin, self.bound(None, [&origin, &origin], 0.0));
        }
        let fit = self.fit.unwrap_or_default();
        let (mut moment, mut speed, mut bend) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        for m in &self.chain.masses {
            let center = self.frame(m.body).point(&m.center);
            moment += center.coords * m.mass;
            speed += self.speed(&fit, m.body, &center) * m.mass;
            bend += self.bend(&fit, m.body, [&center, &center], 0.0) * m.mass;
        }
        let bound = (self.half * speed.norm() + bend) / total;
        let bound = if self.fit.is_some() { bound } else { f64::INFINITY };
        (Point3::from(moment / total), bound)
    }

    /// Velocity of a point in the middle of the piece (m a way).
    fn speed(&self, fit: &Fit, body: Option<(LegId, usize)>, p: &Point3<f64>) -> Vector3<f64> {
        let by_joints = body.map_or_else(Vector3::zeros, |(leg, place)| {
            speed_of(&self.frames[leg.0], place, &self.way[leg.0], p)
        });
        fit.drift + fit.turn.cross(&(p.coords - fit.middle)) + by_joints
    }

    fn turn_of_joints(&self, (leg, place): (LegId, usize)) -> Vector3<f64> {
        let (frames, way) = (&self.frames[leg.0], &self.way[leg.0]);
        (0..=place).filter(|j| !frames.slides[*j]).map(|j| frames.axes[j] * way[j]).sum()
    }

    /// How far points of a body can be from where their velocity in the middle leads (m).
    fn bend(
        &self,
        fit: &Fit,
        body: Option<(LegId, usize)>,
        ends: [&Point3<f64>; 2],
        radius: f64,
    ) -> f64 {
        let swept = body.map_or_else(Swept::default, |(leg, place)| {
            sweep(&self.frames[leg.0], place, ends, radius, &self.way[leg.0], self.half)
        });
        let far = ends.map(|p| (p.coords - fit.middle).norm());
        let far = far[0].max(far[1]) + radius;
        let (h, turn) = (self.half, fit.turn.norm());
        far * (fit.slip + 0.5 * h * h * turn * turn)
            + (h * turn + fit.slip) * h * (swept.speed + fit.mean_speed)
            + 0.5 * h * h * (swept.curve + fit.mean_curve)
            + fit.gap
    }
}

impl Fit {
    fn new(
        frames: &[LegFrames],
        way: &[LegAngles],
        anchors: &[Anchor],
        share: f64,
        half: f64,
    ) -> Option<Fit> {
        if anchors.is_empty() {
            return None;
        }
        let mut held: Vec<Held> = anchors
            .iter()
            .map(|anchor| {
                let (frames, way) = (&frames[anchor.leg.0], &way[anchor.leg.0]);
                let last = frames.links.len() - 1;
                let at = frames.links[last].point(&anchor.in_link);
                let [from, to] = anchor.places;
                Held {
                    at: at.coords,
                    place: from.coords.lerp(&to.coords, share),
                    speed: speed_of(frames, last, way, &at),
                    place_speed: to - from,
                    curve: sweep(frames, last, [&at, &at], 0.0, way, half).curve,
                }
            })
            .collect();
        let n = held.len() as f64;
        let mean = |of: fn(&Held) -> Vector3<f64>| held.iter().map(of).sum::<Vector3<f64>>() / n;
        let (middle, place_middle) = (mean(|h| h.at), mean(|h| h.place));
        let (mean_speed, place_speed) = (mean(|h| h.speed), mean(|h| h.place_speed));
        let mean_curve = held.iter().map(|h| h.curve).sum::<f64>() / n;
        for h in &mut held {
            h.at -= middle;
            h.place -= place_middle;
            h.speed -= mean_speed;
            h.place_speed -= place_speed;
        }
        let (turn, slip) = turn_of(&held, half)?;
        Some(Fit {
            middle,
            drift: place_speed - mean_speed,
            turn,
            slip,
            mean_speed: mean_speed.norm(),
            mean_curve,
            gap: (middle - place_middle).norm() + ROUNDING,
        })
    }
}

/// The rate at which the base turns in the middle of the piece (rad a way), and how far it can be
/// off that even turn (rad).
fn turn_of(held: &[Held], half: f64) -> Option<(Vector3<f64>, f64)> {
    let mut stiffness = Matrix3::zeros();
    let mut asked = Vector3::zeros();
    for h in held {
        let both = h.at * h.place.transpose();
        stiffness += Matrix3::identity() * h.at.dot(&h.place) - (both + both.transpose()) * 0.5;
        asked += h.speed.cross(&h.place) + h.at.cross(&h.place_speed);
    }
    let least = stiffness.symmetric_eigenvalues().min();
    if least.is_nan() || least <= 0.0 {
        return None;
    }
    let turn = stiffness.cholesky()?.solve(&asked);
    let (mut still, mut steady) = (Vector3::zeros(), Vector3::zeros());
    let (mut rest, mut softer) = (0.0, 0.0);
    for h in held {
        let slide = h.speed + turn.cross(&h.at);
        still += h.at.cross(&h.place);
        steady += slide.cross(&h.place) + h.at.cross(&h.place_speed);
        // How far the anchor is from where `slide` leads, and from the middle, in the guess's frame.
        let (w, speed) = (turn.norm(), h.speed.norm());
        let bend = half * half * (0.5 * (h.curve + w * w * h.at.norm()) + w * speed);
        let moved = half * slide.norm() + bend;
        let place = h.place.norm() + half * h.place_speed.norm();
        rest += half * half * slide.norm() * h.place_speed.norm() + bend * place;
        softer += moved * place + half * h.place_speed.norm() * h.at.norm();
    }
    let off = still.norm() + half * steady.norm() + rest;
    (least > softer).then(|| (turn, (off / (least - softer)).atan()))
}

/// What the joints alone do to a body over a piece.
#[derive(Default)]
struct Swept {
    /// Bound of the velocity of any of its points (m a way).
    speed: f64,
    /// Bound of the second derivative (m a way squared).
    curve: f64,
}

/// As [`LegFrames::motion_bound`] from the base on, for rates instead of ways. The second derivative
/// of a point by joints j and l, j not farther out, is the axis of j across the velocity by l.
fn sweep(
    frames: &LegFrames,
    place: usize,
    [a, b]: [&Point3<f64>; 2],
    radius: f64,
    way: &LegAngles,
    half: f64,
) -> Swept {
    let turns = |j: usize| if frames.slides[j] { 0.0 } else { way[j].abs() };
    let mut swept = Swept::default();
    let mut inward: f64 = (0..=place).map(turns).sum();
    for joint in (0..=place).rev() {
        inward -= turns(joint);
        let rate = way[joint].abs();
        if rate == 0.0 {
            continue;
        }
        let lever = if frames.slides[joint] {
            1.0
        } else {
            let (axis, origin) = (&frames.axes[joint], &frames.links[joint].origin);
            let from_axis = |p: &Point3<f64>| axis.cross(&(p.coords - origin)).norm_squared();
            // By then the joints farther out have added their part.
            from_axis(a).max(from_axis(b)).sqrt() + radius + half * swept.speed
        };
        swept.speed += rate * lever;
        swept.curve += rate * lever * (turns(joint) + 2.0 * inward.max(0.0));
    }
    swept
}

/// Velocity of a point of the link at `place` by the leg's joints alone (m a way).
fn speed_of(frames: &LegFrames, place: usize, way: &LegAngles, p: &Point3<f64>) -> Vector3<f64> {
    (0..=place)
        .map(|j| {
            let axis = &frames.axes[j];
            let along = if frames.slides[j] {
                *axis
            } else {
                axis.cross(&(p.coords - frames.links[j].origin))
            };
            along * way[j]
        })
        .sum()
}
