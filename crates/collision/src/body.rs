//! Certificates of the whole robot: a shift of the body declared free is free at every resolution.
//!
//! As in [`crate::certificate`], with two differences. All parts move at once, so a pair is held
//! against what both can do: in `world` or as seen from the base, whichever is less; within one leg,
//! and between the base and a leg, only the joints between the two count. And the base goes where
//! the standing wheels put it; [`rover::Sway`] bounds that.
//!
//! What must be kept:
//! - Links of the robot, and links and obstacles or ground: their tolerance; where they are nearer at
//!   the start, a share of their distance there ([`Survey::kept`]). What overlaps is never free.
//! - A standing wheel may be in the ground while its center is within the contact radius of where it
//!   stood, by no more than [`DEPTH_SLACK`] of the ground tolerance. Its fork keeps its distance.
//! - Ground must be known, but below parts that nobody has seen the ground of at the start: those are
//!   held against what is known.

use nalgebra::Point3;
use rover::{BodyChain, BodyMotion, Configuration, Frame, LegId, Posture, Sway, place_of};

use crate::bisection::{Bisection, Subject};
use crate::certificate::{Certificate, FINEST};
use crate::checker::{DEPTH_SLACK, Touch, Violation};
use crate::form::Placed;
use crate::ground::{GroundNear, Kernel, near_ground};
use crate::look::{
    Ask, Look, better, look_at_ground, look_at_known_ground, look_at_pair, look_at_solids,
};
use crate::pairs::{Body, pair_tolerance};
use crate::scene::Scene;
use crate::solid::Part;
use crate::survey::{Survey, survey};

/// Way of two bodies toward each other over half a piece below which exact distances are asked for
/// (m at scale 1).
const FINE: f64 = 0.05;

/// The whole robot on its standing wheels, prepared for shifts of the body from one start; keeps its
/// memory from one motion to the next.
pub struct BodyCertifier<'a> {
    scene: &'a Scene,
    chain: BodyChain,
    parts: Vec<Moved<'a>>,
    items: Vec<Item>,
    bisection: Bisection<Item>,
    here: Vec<Option<Here>>,
}

/// A part of the robot.
struct Moved<'a> {
    part: &'a Part,
    /// What carries it: the base (`None`) or a joint of a leg.
    body: Option<(LegId, usize)>,
    body_from_part: Frame,
    /// Center of the wheel that it is, at the start, if that stands.
    stood: Option<Point3<f64>>,
    /// Nobody has seen all of the ground below it at the start.
    over_unknown: bool,
}

/// One thing to look at, and the clearance that it keeps (m).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Item {
    part: u16,
    against: Against,
    required: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Against {
    Ground,
    Solid(usize),
    Part(u16),
}

/// A part in the middle of a piece: where, and how far any of its points can get from there (m).
#[derive(Debug, Clone, Copy)]
struct Here {
    placed: Placed,
    in_world: f64,
    from_base: f64,
}

impl<'a> BodyCertifier<'a> {
    /// Prepares for shifts from `start` on the wheels of `standing`.
    pub fn new(scene: &'a Scene, start: &Configuration, standing: &[LegId]) -> BodyCertifier<'a> {
        let robot = scene.robot();
        let posture = Posture::new(robot, start);
        let parts = scene
            .parts
            .iter()
            .map(|part| {
                let (body, body_from_link) = match part.body {
                    Body::Base => {
                        let base = &start.world_from_base;
                        (None, base.inverse() * posture.link(part.link))
                    }
                    Body::Leg { leg, place } => {
                        let from = place_of(robot, leg, part.link);
                        (Some((leg, place)), from.map_or_else(Default::default, |(_, from)| from))
                    }
                };
                let stands = body.map(|(leg, _)| leg).filter(|leg| standing.contains(leg));
                let stood = stands.filter(|_| part.is_wheel);
                Moved {
                    part,
                    body,
                    body_from_part: Frame::from(&(body_from_link * part.link_from_part)),
                    stood: stood.map(|leg| posture.wheel(robot, leg).center()),
                    over_unknown: false,
                }
            })
            .collect();
        let mut certifier = BodyCertifier {
            scene,
            chain: BodyChain::new(robot),
            parts,
            items: Vec::new(),
            bisection: Bisection::new(),
            here: vec![None; scene.parts.len()],
        };
        certifier.gather(start, &survey(scene, &posture));
        certifier
    }

    /// All that is looked at: the surroundings of each part first, then pairs of parts.
    fn gather(&mut self, start: &Configuration, at_start: &Survey) {
        let robot = self.scene.robot();
        let still = Sway::still(&self.chain, start);
        let tolerance = robot.tolerances().environment;
        for (i, moved) in self.parts.iter_mut().enumerate() {
            let (part, placed) = (moved.part, moved.placed(&still));
            let mut add = |against, touch| {
                let required = at_start.kept(touch, tolerance);
                self.items.push(Item { part: i as u16, against, required });
                required
            };
            let keeps = add(Against::Ground, Touch::Ground(part.link));
            let ground = near_ground(
                self.scene,
                part,
                &placed,
                keeps,
                keeps,
                Kernel::Quick { enough: keeps },
            );
            moved.over_unknown = matches!(ground, GroundNear::Unknown(_));
            for k in 0..self.scene.solids.len() {
                add(Against::Solid(k), Touch::Obstacle(part.link, k));
            }
        }
        for (i, a) in self.scene.parts.iter().enumerate() {
            for (j, b) in self.scene.parts.iter().enumerate().skip(i + 1) {
                if let Some(tolerance) = pair_tolerance(robot, a.body, b.body) {
                    let required = at_start.kept(Touch::Links(a.link, b.link), tolerance);
                    let against = Against::Part(j as u16);
                    self.items.push(Item { part: i as u16, against, required });
                }
            }
        }
    }

    /// Configurations looked at so far: one a piece, and one a call of [`violation`](Self::violation).
    pub fn n_looked(&self) -> u64 {
        self.bisection.n_pieces
    }

    /// The first thing nearer than it may be in one configuration.
    pub fn violation(&mut self, configuration: &Configuration) -> Option<Violation> {
        self.bisection.n_pieces += 1;
        self.here.fill(None);
        let sway = Sway::still(&self.chain, configuration);
        let (scene, parts, here) = (self.scene, &self.parts[..], &mut self.here[..]);
        let mut moment = Moment { scene, parts, here, sway: &sway };
        self.items.iter().find_map(|item| match moment.look(item) {
            Look::Violated(violation) => Some(violation),
            Look::Clear | Look::Open(_) => None,
        })
    }

    /// Is the motion free? Limits of joints are not looked at, nor whether the wheels keep to their
    /// places beyond what is said above.
    pub fn certify(&mut self, motion: &impl BodyMotion) -> Certificate {
        let finest = FINEST * self.scene.robot().scale();
        let mut walked = Walked {
            scene: self.scene,
            chain: &self.chain,
            parts: &self.parts,
            here: &mut self.here,
            motion,
            sway: Sway::still(&self.chain, &motion.at(0.0)),
        };
        self.bisection.certify(&mut walked, &self.items, finest)
    }
}

impl Moved<'_> {
    fn placed(&self, sway: &Sway) -> Placed {
        Placed::new(sway.frame(self.body).after(&self.body_from_part), &self.part.core)
    }
}

/// A motion of the body, and the piece of it that is looked at.
struct Walked<'m, 'a, M> {
    scene: &'a Scene,
    chain: &'m BodyChain,
    parts: &'m [Moved<'a>],
    here: &'m mut [Option<Here>],
    motion: &'m M,
    sway: Sway<'m>,
}

impl<M: BodyMotion> Subject for Walked<'_, '_, M> {
    type Item = Item;

    fn enter(&mut self, middle: f64, half: f64) {
        self.here.fill(None);
        self.sway = Sway::new(self.chain, self.motion, middle, half);
    }

    fn look(&mut self, item: &Item) -> Look {
        match self.moment().look(item) {
            // The bounds of a sway need not grow with the way.
            Look::Open(_) => Look::Open(0.0),
            look => look,
        }
    }

    fn motion(&mut self, item: &Item) -> f64 {
        self.moment().motion(item)
    }
}

impl<M> Walked<'_, '_, M> {
    fn moment(&mut self) -> Moment<'_> {
        Moment { scene: self.scene, parts: self.parts, here: self.here, sway: &self.sway }
    }
}

/// The robot over one piece; each part is placed when it is first asked for.
struct Moment<'m> {
    scene: &'m Scene,
    parts: &'m [Moved<'m>],
    here: &'m mut [Option<Here>],
    sway: &'m Sway<'m>,
}

impl Moment<'_> {
    fn place(&mut self, index: u16) {
        let index = usize::from(index);
        let (moved, sway) = (&self.parts[index], self.sway);
        self.here[index].get_or_insert_with(|| {
            let placed = moved.placed(sway);
            let [a, b] = placed.ends();
            let ends = [&a, &b];
            let from_base = |body| sway.bound_since(0, body, ends, placed.radius);
            Here {
                placed,
                in_world: sway.bound(moved.body, ends, placed.radius),
                from_base: moved.body.map_or(0.0, from_base),
            }
        });
    }

    fn at(&self, index: u16) -> (&Moved<'_>, &Here) {
        let index = usize::from(index);
        (&self.parts[index], self.here[index].as_ref().expect("looked at where it is placed"))
    }

    fn look(&mut self, item: &Item) -> Look {
        self.place(item.part);
        if let Against::Part(other) = item.against {
            self.place(other);
        }
        let (moved, here) = self.at(item.part);
        let motion = self.motion(item);
        let fine = motion < FINE * self.scene.robot().scale();
        let ask = Ask { required: item.required, motion, fine };
        match item.against {
            Against::Ground => self.look_at_ground(moved, &here.placed, ask),
            Against::Solid(k) => look_at_solids(self.scene, moved.part, &here.placed, &[k], ask),
            Against::Part(other) => {
                let (other, there) = self.at(other);
                look_at_pair([moved.part, other.part], [&here.placed, &there.placed], ask)
            }
        }
    }

    /// How far the two of an item that has been looked at can get toward each other (m).
    fn motion(&self, item: &Item) -> f64 {
        let (moved, a) = self.at(item.part);
        let Against::Part(other) = item.against else { return a.in_world };
        let (other, b) = self.at(other);
        if let (Some((leg, p)), Some((other_leg, q))) = (moved.body, other.body)
            && leg == other_leg
        {
            // Seen from the inner one only the joints up to the outer one move it.
            let (inner, outer, placed) = if p <= q { (p, q, &b.placed) } else { (q, p, &a.placed) };
            let [x, y] = placed.ends();
            return self.sway.bound_since(inner + 1, (leg, outer), [&x, &y], placed.radius);
        }
        (a.in_world + b.in_world).min(a.from_base + b.from_base)
    }

    fn look_at_ground(&self, moved: &Moved, placed: &Placed, ask: Ask) -> Look {
        let ground = |placed: &Placed, ask: Ask| {
            if moved.over_unknown {
                look_at_known_ground(self.scene, moved.part, placed, ask)
            } else {
                look_at_ground(self.scene, moved.part, placed, ask)
            }
        };
        let usual = ground(placed, ask);
        let (Some(stood), Some((leg, place))) = (moved.stood, moved.body) else { return usual };
        if matches!(usual, Look::Clear) {
            return usual;
        }
        let robot = self.scene.robot();
        let rules = robot.stance();
        let in_link = Point3::from(robot.leg(leg).wheel.carrier_from_wheel.translation.vector);
        let center = self.sway.frame(moved.body).point(&in_link);
        let aside = (center.xy() - stood.xy()).norm();
        if aside > rules.contact_radius {
            return usual;
        }
        let motion = self.sway.bound(Some((leg, place)), [&center, &center], 0.0);
        let raised = placed.raised(DEPTH_SLACK * rules.ground_tolerance);
        let look = ground(&raised, Ask { required: 0.0, ..ask });
        better(usual, look, aside + motion <= rules.contact_radius)
    }
}
