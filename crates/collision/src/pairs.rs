//! Which pairs of bodies are checked, and how far apart they must stay (F64, F65).

use rover::{LegId, LinkId, Robot};

/// A body: the base, or a moving part of a leg; the wheel is of one body with its fork (F64).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Body {
    /// The base link and what is fixed to it.
    Base,
    /// The part of a leg that the joint at `place` (0 to 5 from the hip) carries.
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
        let mut link = link;
        loop {
            if let Some((leg, place)) = robot.body_of(link) {
                return Body::Leg { leg, place };
            }
            match robot.links()[link.0].parent_joint {
                Some(joint) => link = robot.joints()[joint].parent,
                None => return Body::Base,
            }
        }
    }
}

/// Clearance that a pair must keep (m), or `None` for a pair that is not checked: bodies that
/// share a joint, and bodies of one leg across a single joint, for which the joint limits stand.
pub(crate) fn pair_tolerance(robot: &Robot, a: Body, b: Body) -> Option<f64> {
    let t = robot.tolerances();
    match (a.min(b), a.max(b)) {
        (Body::Base, Body::Base) => None,
        (Body::Base, Body::Leg { place, .. }) => match place {
            0 => None,
            1 => Some(t.base_thigh),
            5 => Some(t.base_wheel),
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
