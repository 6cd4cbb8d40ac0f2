//! How short of what must be kept the leg is, over all parts of the two that are named.

use rover::LegAngles;

use super::{Against, Allowance, Item, LegChecker, Moment, Scratch, Touch, Violation};
use crate::ground::{Kernel, near_known_ground};
use crate::look::Look;
use crate::solid::Part;

impl LegChecker<'_> {
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
}
