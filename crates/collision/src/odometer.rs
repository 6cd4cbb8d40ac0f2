//! How far the parts of a leg have gone, from one configuration to the next.
//!
//! What has room for a way is clear until that way has been gone, whichever; so one sum for each link tells of
//! all that hangs on it whether a closer look is due.

use nalgebra::Point3;
use rover::{Frame, JointKind, LegAngles, LegFrames};

use crate::checker::LegChecker;
use crate::follow::{change, norm_of_turn};

/// Places of a leg.
const PLACES: usize = 6;

/// Ways that grow: those of the links through `world`, then those of pairs of links, the outer one as seen from the
/// inner one.
pub(crate) struct Odometer {
    last: Option<LegFrames>,
    /// By way, more than any point of what goes it has gone (m).
    gone: Vec<f64>,
    /// By link, within which distance of its origin lies what hangs on it (m).
    radii: [f64; PLACES],
    pairs: Vec<Pair>,
    /// By link, farthest that its joint can be from that of the link before (m).
    lengths: [f64; PLACES],
    slides: [bool; PLACES],
}

/// A link as seen from one farther in.
struct Pair {
    outer: usize,
    inner: usize,
    /// Within which distance of the outer link's origin lies what counts (m).
    radius: f64,
    /// By joint, farthest that it can carry any of that while it turns by one radian, or slides by one meter (m).
    levers: LegAngles,
}

impl Odometer {
    /// For the leg of `checker`.
    pub fn new(checker: &LegChecker) -> Odometer {
        let robot = checker.scene.robot();
        let leg = robot.leg(checker.leg());
        let zero = checker.chain.frames(&LegAngles::zeros());
        let slides = std::array::from_fn(|place| {
            leg.joints.get(place).is_some_and(|j| robot.joints()[*j].kind == JointKind::Prismatic)
        });
        let lengths = std::array::from_fn(|place| {
            let inner: usize = place.saturating_sub(1);
            // A joint that turns leaves its origin where it is on the link before.
            let stroke = if slides[place] {
                leg.lower[place].abs().max(leg.upper[place].abs())
            } else {
                0.0
            };
            (zero.links[place].origin - zero.links[inner].origin).norm() + stroke
        });
        let (gone, radii, pairs) = (vec![0.0; PLACES], [0.0; PLACES], Vec::new());
        Odometer { last: None, gone, radii, pairs, lengths, slides }
    }

    /// Index of the way of what lies in a sphere of the link at `place`, through `world` or as seen from another
    /// link; none if it does not move.
    pub fn way_for(
        &mut self,
        place: usize,
        seen_from: Option<usize>,
        (center, radius): &(Point3<f64>, f64),
    ) -> Option<usize> {
        let radius = center.coords.norm() + radius;
        let Some(inner) = seen_from else {
            self.radii[place] = self.radii[place].max(radius);
            return Some(place);
        };
        if inner == place {
            return None;
        }
        let known = self.pairs.iter().position(|pair| (pair.outer, pair.inner) == (place, inner));
        let index = known.unwrap_or_else(|| {
            let levers = LegAngles::zeros();
            self.pairs.push(Pair { outer: place, inner, radius: 0.0, levers });
            self.gone.push(0.0);
            self.pairs.len() - 1
        });
        let pair = &mut self.pairs[index];
        pair.radius = pair.radius.max(radius);
        let mut lever = pair.radius;
        for joint in (inner + 1..=place).rev() {
            pair.levers[joint] = if self.slides[joint] { 1.0 } else { lever };
            lever += self.lengths[joint];
        }
        Some(PLACES + index)
    }

    /// The leg goes to another configuration.
    pub fn go_to(&mut self, frames: &LegFrames) {
        let Some(last) = &self.last else {
            self.last = Some(*frames);
            return;
        };
        for (place, gone) in self.gone[..PLACES].iter_mut().enumerate() {
            let (shift, turned) = change(&last.links[place], &frames.links[place]);
            *gone += shift.norm() + norm_of_turn(&turned) * self.radii[place];
        }
        let turned = (frames.angles - last.angles).abs();
        for (pair, gone) in self.pairs.iter().zip(&mut self.gone[PLACES..]) {
            // One joint after the other: each carries all of it along an arc about its axis.
            *gone += turned.dot(&pair.levers);
        }
        self.last = Some(*frames);
    }

    /// How much of a way has been gone (m).
    pub fn gone(&self, way: Option<usize>) -> f64 {
        way.map_or(0.0, |way| self.gone[way])
    }

    /// The frame that goes a way.
    pub fn frame(&self, way: Option<usize>, frames: &LegFrames) -> Frame {
        match way {
            None => Frame::identity(),
            Some(place) if place < PLACES => frames.links[place],
            Some(pair) => {
                let Pair { outer, inner, .. } = self.pairs[pair - PLACES];
                frames.links[inner].inverse().after(&frames.links[outer])
            }
        }
    }
}
