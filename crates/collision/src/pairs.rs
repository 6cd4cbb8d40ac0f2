//! Which pairs of bodies are checked, and how far apart they must stay (F64, F65).

use rover::{LegId, LinkId, Robot};

/// A body: the base, or a moving part of a leg; the wheel is of one body with its fork (F64).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Body {
    /// The base link and what is fixed to it.
    Base,
    /// The part of a leg that the joint at `place` (from 0 at the hip) carries.
    Leg {
        /// The leg.
        leg: LegId,
        /// Its place from the hip outward.
        place: usize,
    },
}

impl Body {
    /// The body that a link belongs to: its own, or that of the link it is fixed to.
    pub fn of(robot: &Robot, link: LinkId) -> Body {
        match robot.body_of(link) {
            Some((leg, place)) => Body::Leg { leg, place },
            None => Body::Base,
        }
    }
}

impl Body {
    /// True for the outermost body of a leg, which has the wheel or the foot.
    pub(crate) fn is_outermost(self, robot: &Robot) -> bool {
        matches!(self, Body::Leg { leg, place } if place + 1 == robot.leg(leg).n_joints())
    }
}

/// Clearance that a pair must keep (m), or `None` for a pair that is not checked: bodies that
/// share a joint, and bodies of one leg across a single joint, for which the joint limits stand.
pub(crate) fn pair_tolerance(robot: &Robot, a: Body, b: Body) -> Option<f64> {
    let t = robot.tolerances();
    match (a.min(b), a.max(b)) {
        (Body::Base, Body::Base) => None,
        (Body::Base, outer @ Body::Leg { place, .. }) => match place {
            0 => None,
            _ if outer.is_outermost(robot) => Some(t.base_wheel),
            1 => Some(t.base_thigh),
            _ => Some(t.pair),
        },
        (Body::Leg { leg: l, place: p }, Body::Leg { leg: m, place: q }) => {
            if l != m {
                Some(t.leg_leg)
            } else {
                (p.abs_diff(q) > 2).then_some(t.within_leg)
            }
        }
        (Body::Leg { .. }, Body::Base) => None, // cannot be: the base sorts first
    }
}
