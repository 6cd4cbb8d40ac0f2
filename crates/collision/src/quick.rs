//! One leg in many configurations that are much alike: what was in the way last is looked at first.

use arrayvec::ArrayVec;
use nalgebra::{Point2, Point3};
use rover::{Frame, LegAngles, LegChain, LegFrames};

use crate::checker::{Against, Allowance, Item, LegChecker, Moment, Scratch, Touch, Violation};
use crate::follow::{SLACK, way_of};
use crate::look::Look;

/// Items remembered that were in the way lately.
const LATELY: usize = 6;

/// What was in the way last, of a configuration like the next one. Starts as nothing in particular.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hint(Option<Blocked>);

/// Something in the way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Blocked {
    /// Index of the checker's item.
    item: usize,
    touch: Touch,
    /// Where, if it was the ground.
    place: Option<Point2<f64>>,
    /// Where the moving part's frame was.
    at: Frame,
    /// The way (m) that the part may go from there and still be too near.
    depth: f64,
}

/// Answers as [`LegChecker::violation_at`] does whether a configuration is free; where it is not, it
/// names some violation, not the first. Holds what checks can use again.
pub struct QuickChecker<'c> {
    checker: &'c LegChecker<'c>,
    scratch: Scratch,
    /// Items that were in the way lately, whatever the hint; the latest first.
    lately: ArrayVec<usize, LATELY>,
    /// From the link that carries the wheel to the wheel's frame.
    wheel_from_carrier: Frame,
    /// Frames of which only the carrier's counts.
    carried: LegFrames,
}

/// What is in the way of a foot, whatever the other joints of its leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootTouch {
    /// What touches what.
    pub touch: Touch,
    /// True if it is the wheel itself, which is the same solid whatever the pitch of its fork.
    pub is_wheel: bool,
}

impl<'c> QuickChecker<'c> {
    /// Prepares quick checks.
    pub fn new(checker: &'c LegChecker<'c>) -> QuickChecker<'c> {
        let wheel = &checker.scene.robot().leg(checker.leg()).wheel;
        QuickChecker {
            checker,
            scratch: Scratch::new(checker),
            lately: ArrayVec::new(),
            wheel_from_carrier: Frame::from(&wheel.carrier_from_wheel.inverse()),
            carried: checker.chain().frames(&LegAngles::zeros()),
        }
    }

    /// The kinematics of the moving leg.
    pub fn chain(&self) -> &'c LegChain {
        self.checker.chain()
    }

    /// Something nearer than it may be; `None` if all is free. `frames` are of the checker's
    /// [`chain`](Self::chain).
    pub fn touch(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<Touch> {
        if let Some(touch) = self.touch_lately(frames, allowance, hint) {
            return Some(touch);
        }
        let lately = self.lately.clone();
        (0..self.checker.items.len())
            .filter(|place| !lately.contains(place))
            .find_map(|place| self.look_at(place, frames, allowance, hint))
    }

    /// As [`touch`](Self::touch), but looks only at what the hint says, and at what was in the way lately.
    pub fn touch_lately(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<Touch> {
        let known = hint.0.map(|blocked| blocked.item);
        if let Some(touch) = self.touch_at(frames, allowance, hint) {
            return Some(touch);
        }
        let lately = self.lately.clone();
        lately
            .into_iter()
            .filter(|place| Some(*place) != known)
            .find_map(|place| self.look_at(place, frames, allowance, hint))
    }

    /// Looks at one item, where the leg has been placed.
    fn look_at(
        &mut self,
        place: usize,
        frames: &LegFrames,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<Touch> {
        let (checker, moment) = (self.checker, Moment::still(frames, allowance));
        let look = checker.look(&moment, &checker.items[place], &mut self.scratch);
        let Look::Violated(violation) = look else { return None };
        self.lately.retain(|other| *other != place);
        self.lately.truncate(LATELY - 1);
        self.lately.insert(0, place);
        *hint = Hint(Some(blocked(checker, place, &moment, &violation)));
        Some(violation.touch)
    }

    /// As [`touch`](Self::touch), but looks only at what the hint says.
    pub fn touch_at(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<Touch> {
        self.scratch.clear();
        self.touch_by(frames, allowance, hint)
    }

    /// Looks at what a hint says, where nothing else has been placed.
    fn touch_by(
        &mut self,
        frames: &LegFrames,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<Touch> {
        let (checker, scratch) = (self.checker, &mut self.scratch);
        let before = hint.0?;
        let item = checker.items.get(before.item)?;
        let moment = Moment::still(frames, allowance);
        if holds_still(item, &allowance) {
            let (now, sphere) = moved(checker, item, frames);
            if way_of(&before.at, &now, &sphere) < before.depth {
                return Some(before.touch);
            }
            // The same piece of ground is nearly always in the way still.
            let index = usize::from(item.moving);
            if let Some(place) = before.place
                && checker.is_near_ground_at(frames, index, place, scratch)
            {
                return Some(before.touch);
            }
        }
        match checker.look(&moment, item, scratch) {
            Look::Violated(violation) => {
                *hint = Hint(Some(blocked(checker, before.item, &moment, &violation)));
                Some(violation.touch)
            }
            Look::Clear | Look::Open(_) => None,
        }
    }

    /// As [`touch_at`](Self::touch_at) for a wheel in `world`, before its leg's joint angles are known:
    /// nothing unless the hint is about the wheel, or what is fixed to its fork, and about what does not
    /// move with the leg.
    pub fn foot_touch_at(
        &mut self,
        wheel: &Frame,
        allowance: Allowance,
        hint: &mut Hint,
    ) -> Option<FootTouch> {
        let item = self.checker.items.get(hint.0?.item)?;
        let moving = &self.checker.moving[usize::from(item.moving)];
        if !moving.is_foot || matches!(item.against, Against::Own(_)) {
            return None;
        }
        let carrier = wheel.after(&self.wheel_from_carrier);
        self.carried.links.fill(carrier);
        self.carried.angles.fill(f64::NAN);
        if moving.place + 1 < self.checker.scene.robot().leg(self.checker.leg()).n_joints() {
            // A part that does not turn with the last joint: where that link would have to be.
            let part = carrier.after(&moving.link_from_part);
            self.carried.links[moving.place] = part.after(&moving.place_from_part().inverse());
        }
        let (is_wheel, carried) = (moving.part.is_wheel, self.carried);
        self.scratch.clear();
        self.touch_by(&carried, allowance, hint).map(|touch| FootTouch { touch, is_wheel })
    }
}

/// Is what an item must keep the same wherever the leg is? A zone goes along with the wheel.
fn holds_still(item: &Item, allowance: &Allowance) -> bool {
    let of_surroundings = matches!(item.against, Against::Ground | Against::Solids);
    !of_surroundings || *allowance == Allowance::default()
}

fn blocked(checker: &LegChecker, item: usize, moment: &Moment, violation: &Violation) -> Blocked {
    let of = &checker.items[item];
    let touch = violation.touch;
    let depth = match touch {
        _ if !holds_still(of, &moment.allowance) => 0.0,
        Touch::UnknownGround(_) => 0.0,
        _ => violation.required - violation.distance - SLACK,
    };
    let of_ground = matches!(touch, Touch::Ground(_));
    let place = of_ground.then(|| violation.place.xy());
    Blocked { item, touch, place, at: moved(checker, of, moment.frames).0, depth }
}

/// The frame by whose way alone an item's distance changes, and a sphere in it that holds the part: a
/// link's, or that of the outer one of two links as seen from the inner one.
fn moved(checker: &LegChecker, item: &Item, frames: &LegFrames) -> (Frame, (Point3<f64>, f64)) {
    let part = &checker.moving[usize::from(item.moving)];
    let Against::Own(other) = item.against else {
        return (frames.links[part.place], part.sphere_in_place());
    };
    let other = &checker.moving[usize::from(other)];
    let (outer, inner) = if part.place >= other.place { (part, other) } else { (other, part) };
    let seen = frames.links[inner.place].inverse().after(&frames.links[outer.place]);
    (seen, outer.sphere_in_place())
}
