//! One look at one item: which rules hold for it, and what they ask.

use nalgebra::Point2;
use rover::LegFrames;

use super::{Against, Allowance, DEPTH_SLACK, Here, Item, LegChecker, Moment, Moving, Scratch};
use crate::ground::is_near_ground_at;
use crate::look::{Ask, Look, TOUCHING, better, look_at_ground, look_at_pair, look_at_solids};

impl LegChecker<'_> {
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
}
