//! How far the parts of a leg have gone, from one configuration to the next.
//!
//! What has room for a way is clear until that way has been gone, whichever; so one sum for each link tells of
//! all that hangs on it whether a closer look is due.

use nalgebra::Point3;
use rover::{Frame, LegFrames};

use crate::follow::{change, norm_of_turn};

/// Places of a leg.
const PLACES: usize = 6;

/// Ways that grow: those of the links through `world`, then those of pairs of links, the outer one as seen from the
/// inner one.
#[derive(Default)]
pub(crate) struct Odometer {
    last: Option<[Frame; PLACES]>,
    /// By way, more than any point of what goes it has gone (m).
    gone: Vec<f64>,
    /// By link, within which distance of its origin lies what hangs on it (m).
    radii: [f64; PLACES],
    /// Outer and inner link of each pair.
    pairs: Vec<(usize, usize)>,
}

impl Odometer {
    /// Index of the way of what lies in a sphere of the link at `place`, through `world` or as seen from another
    /// link; none if it does not move.
    pub fn way_for(
        &mut self,
        place: usize,
        seen_from: Option<usize>,
        (center, radius): &(Point3<f64>, f64),
    ) -> Option<usize> {
        self.radii[place] = self.radii[place].max(center.coords.norm() + radius);
        let way = match seen_from {
            None => place,
            Some(inner) if inner == place => return None,
            Some(inner) => {
                let pair = (place, inner);
                PLACES
                    + self.pairs.iter().position(|known| *known == pair).unwrap_or_else(|| {
                        self.pairs.push(pair);
                        self.pairs.len() - 1
                    })
            }
        };
        self.gone.resize(PLACES + self.pairs.len(), 0.0);
        Some(way)
    }

    /// The leg goes to another configuration.
    pub fn go_to(&mut self, frames: &LegFrames) {
        let Some(last) = &self.last else {
            self.last = Some(frames.links);
            return;
        };
        let mut moved = [(0.0, 0.0); PLACES];
        for (place, moved) in moved.iter_mut().enumerate() {
            let (shift, turned) = change(&last[place], &frames.links[place]);
            *moved = (shift.norm(), norm_of_turn(&turned));
        }
        let way = |place: usize, radius: f64| moved[place].0 + moved[place].1 * radius;
        for (place, radius) in self.radii.iter().enumerate() {
            self.gone[place] += way(place, *radius);
        }
        for ((outer, inner), gone) in self.pairs.iter().zip(&mut self.gone[PLACES..]) {
            // As seen from the inner link a point goes by its own way and by that of the place where it was, carried
            // by that link.
            let from_inner = (last[*outer].origin - last[*inner].origin).norm();
            let radius = self.radii[*outer];
            *gone += way(*outer, radius) + way(*inner, from_inner + radius);
        }
        self.last = Some(frames.links);
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
                let (outer, inner) = self.pairs[pair - PLACES];
                frames.links[inner].inverse().after(&frames.links[outer])
            }
        }
    }
}
