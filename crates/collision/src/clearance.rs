//! How far a moving leg is from everything, by exact shapes: what verdicts rest on, apart from the quick
//! looks of searches.

use rover::Posture;

use crate::checker::{Allowance, DEPTH_SLACK, LegChecker, Moment, Scratch, Touch, Violation};
use crate::form::apart;
use crate::gjk::{Separation, separation};
use crate::ground::{GroundNear, Kernel, near_ground};
use crate::look::{TOUCHING, near_solid, violation};
use crate::solid::{near, pose_of};

/// Nearest distances of the moving leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// To another link, less what that pair must keep (m); the pair and the plain distance.
    pub links: Option<Violation>,
    /// To ground or obstacles; touching inside a contact zone does not count.
    pub environment: Option<Violation>,
    /// Nothing is met before some point of the leg has gone as far as this (m), no more than the reach
    /// that was asked for; in its contact zone the wheel is as deep as it may be when it meets the
    /// ground.
    pub room: f64,
}

/// How far beyond the tolerances distances are asked for (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// ... to other links.
    pub links: f64,
    /// ... to ground and obstacles.
    pub environment: f64,
}

impl LegChecker<'_> {
    /// Nearest distances within `reach` (m) beyond the tolerances, from exact shapes.
    pub fn clearance(&self, posture: &Posture, allowance: Allowance, reach: f64) -> Clearance {
        self.clearance_within(posture, allowance, Reach { links: reach, environment: reach })
    }

    /// As [`clearance`](Self::clearance), with a reach of its own for either kind of distance.
    pub fn clearance_within(
        &self,
        posture: &Posture,
        allowance: Allowance,
        reach: Reach,
    ) -> Clearance {
        let frames = self.frames_of(posture);
        let moment = Moment::still(&frames, allowance);
        let mut scratch = Scratch::new(self);
        let room = reach.links.min(reach.environment);
        let mut nearest = Clearance { links: None, environment: None, room };
        for index in 0..self.moving.len() {
            let of_part = (&moment, index);
            self.environment_clearance(of_part, reach.environment, &mut scratch, &mut nearest);
            self.links_clearance(of_part, reach.links, &mut scratch, &mut nearest);
        }
        // No pair has less to spare than the nearest one, and each keeps its clearance beyond that.
        if let Some(links) = nearest.links {
            let required =
                |of: &[Option<f64>]| of.iter().flatten().fold(f64::INFINITY, |a, b| a.min(*b));
            let own = self.moving.iter().map(|m| required(&m.required));
            let least = own.chain(self.fixed.iter().map(|f| required(&f.required)));
            let room = spare(&links) + least.fold(f64::INFINITY, f64::min);
            nearest.room = nearest.room.min(room);
        }
        if let Some(environment) = nearest.environment {
            let least = if allowance.zone.is_some() { 0.0 } else { self.environment() };
            nearest.room = nearest.room.min(spare(&environment) + least);
        }
        nearest.room = nearest.room.max(0.0);
        nearest
    }

    fn environment_clearance(
        &self,
        (moment, index): (&Moment, usize),
        reach: f64,
        scratch: &mut Scratch,
        nearest: &mut Clearance,
    ) {
        let moving = &self.moving[index];
        scratch.place(self, moment, index);
        scratch.place_foot(self, moment);
        let placed = scratch.parts[index].placed;
        let in_zone = moving.is_foot && self.zone_holds(moment, scratch).is_some();
        let lift = if moment.allowance.buffered { self.keep.terrain_lift } else { 0.0 };
        // The rules that apply; the one that leaves most to spare counts.
        let mut rules = vec![(self.environment(), lift)];
        if moving.is_foot && lift > 0.0 && self.over_footfall(scratch).is_some() {
            rules.push((self.environment(), 0.0));
        }
        if let (true, Some(zone)) = (in_zone, moment.allowance.zone) {
            let depth = DEPTH_SLACK * zone.ground_tolerance;
            rules.push((0.0, if moving.part.is_wheel { -depth } else { 0.0 }));
        }
        let link = moving.part.link;
        let least = within(reach, &nearest.environment);
        let of_rule = |(required, lift): (f64, f64)| {
            let at = placed.raised(-lift);
            match near_ground(
                self.scene,
                moving.part,
                &at,
                required,
                (required + least).max(TOUCHING),
                Kernel::Exact,
            ) {
                GroundNear::Clear => None,
                GroundNear::Near(near) => Some(violation(Touch::Ground(link), near, required)),
                GroundNear::Unknown(place) => {
                    let touch = Touch::UnknownGround(link);
                    Some(Violation { touch, distance: 0.0, required, place })
                }
            }
        };
        let spare_of = |v: &Option<Violation>| v.as_ref().map_or(f64::INFINITY, spare);
        let ground = rules
            .into_iter()
            .map(of_rule)
            .max_by(|a, b| spare_of(a).total_cmp(&spare_of(b)))
            .flatten();
        // Touching within the zone is what the zone is for.
        let touches = in_zone && ground.is_some_and(|v| v.required == 0.0 && v.distance > 0.0);
        match ground {
            Some(ground) if touches => nearest.room = nearest.room.min(ground.distance),
            _ => nearest.environment = nearer(nearest.environment, ground),
        }
        let buffered =
            moment.allowance.buffered && !(moving.is_foot && self.over_footfall(scratch).is_some());
        let buffer = if buffered { self.keep.obstacle_buffer } else { 0.0 };
        let required = if in_zone { 0.0 } else { self.environment() + buffer };
        for &i in &self.near_solids {
            let solid = &self.scene.solids[i];
            let limit = (required + within(reach, &nearest.environment)).max(TOUCHING);
            if !apart(&placed, &moving.part.form, &solid.placed, &solid.form, limit) {
                let near = near_solid(&placed, moving.part, solid, limit);
                let found = near.map(|near| violation(Touch::Obstacle(link, i), near, required));
                nearest.environment = nearer(nearest.environment, found);
            }
        }
    }

    fn links_clearance(
        &self,
        (moment, index): (&Moment, usize),
        reach: f64,
        scratch: &mut Scratch,
        nearest: &mut Clearance,
    ) {
        for j in index..self.moving.len() {
            scratch.place(self, moment, j);
        }
        let part = self.moving[index].part;
        let placed = &scratch.parts[index].placed;
        let own = self.moving.iter().zip(&scratch.parts).skip(index + 1);
        let own = own.map(|(m, here)| (m.part, &here.placed, m.required[index]));
        let fixed = self.fixed.iter().map(|f| (f.part, &f.placed, f.required[index]));
        for (other, at, required) in own.chain(fixed) {
            let Some(required) = required else { continue };
            let limit = required + within(reach, &nearest.links);
            if limit <= 0.0 || apart(placed, &part.form, at, &other.form, limit) {
                continue;
            }
            // parry is asked where our bound leaves doubt.
            if separation(&(placed, &part.form), &(at, &other.form), limit) == Separation::Apart {
                continue;
            }
            let [pose, other_pose] = [placed, at].map(|p| pose_of(&p.frame));
            let found = near(&pose, &*part.shape.0, &other_pose, &*other.shape.0, limit)
                .map(|near| violation(Touch::Links(part.link, other.link), near, required));
            nearest.links = nearer(nearest.links, found);
        }
    }
}

/// What a distance has beyond what must be kept (m).
fn spare(v: &Violation) -> f64 {
    v.distance - v.required
}

/// How much a distance may have to spare (m) to be the nearest so far.
fn within(reach: f64, nearest: &Option<Violation>) -> f64 {
    nearest.as_ref().map_or(reach, spare).min(reach)
}

/// Of two the one that has less to spare.
fn nearer(a: Option<Violation>, b: Option<Violation>) -> Option<Violation> {
    a.into_iter().chain(b).min_by(|a, b| spare(a).total_cmp(&spare(b)))
}
