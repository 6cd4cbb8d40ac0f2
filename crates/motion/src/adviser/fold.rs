//! The lifted leg's fold: drawn in over the other feet, its mass wins margin. It is a sixth of the rover.

use collision::{Keep, LegChecker};
use nalgebra::{Translation3, Vector2, Vector3};
use rover::{LegAngles, Posture};

use super::fold_tree::FoldTree;
use super::{Attempt, Case, Motion, Place, Work};
use crate::answer::{EdgeRule, Phase, Waypoint};
use crate::failure::Teller;
use crate::leg_space::LegSpace;
use crate::line::wheel_line;
use crate::shift::{Barrier, Wanted};
use crate::smooth::{SmoothOptions, smooth};
use crate::timing::{TimingLimits, time_leg_path};
use crate::watch::Watch;

/// Heights that the wheel is lifted to, the first that is free (m at scale 1).
const LIFTS: [f64; 3] = [0.20, 0.10, 0.06];

/// What is to spare of the margin rule when the leg is lifted (m at scale 1).
const SPARE: f64 = 0.02;

/// Shares of the way to the fold at which the chassis is moved.
const SHARES: [f64; 4] = [0.0, 0.4, 0.7, 1.0];

/// The way up and to a fold.
struct FoldPath {
    lift: Vec<LegAngles>,
    fold: Vec<LegAngles>,
}

impl Case<'_> {
    /// The leg lifted and folded as little as meets the wish with a motion of the chassis, or what gets
    /// nearest to it.
    pub fn folded<W: Watch>(
        &self,
        place: &Place,
        budget: usize,
        work: &mut Work<'_, W>,
    ) -> Result<Attempt, Barrier> {
        let part = budget / (1 + SHARES.len());
        let (before, from) = self.ready_to_lift(place, part, work)?;
        let from = from.as_ref().unwrap_or(place);
        let path = self.fold_path(from, work)?;
        let mut best: Option<Attempt> = None;
        let mut failed = None;
        // A leg that is in the air already has been looked at where it is.
        let shares = if path.lift.len() > 1 { &SHARES[..] } else { &SHARES[1..] };
        for &share in shares {
            if work.watch.stopped().is_some() {
                break;
            }
            match self.at_share(from, &path, share, part, work) {
                Ok(mut attempt) => {
                    attempt.motions.splice(0..0, before.iter().cloned());
                    let (wish, rules) = (self.wish, self.scene.robot().stance());
                    if attempt.after.meet(wish, rules) {
                        return Ok(attempt);
                    }
                    let spare = |a: &Attempt| a.after.spare(wish, rules);
                    if best.as_ref().is_none_or(|best| spare(&attempt) > spare(best)) {
                        best = Some(attempt);
                    }
                }
                Err(barrier) => failed = failed.or(Some(barrier)),
            }
        }
        best.ok_or_else(|| {
            failed.unwrap_or_else(|| Barrier::new("search", "the search was stopped"))
        })
    }

    /// Where the leg may be lifted by the margin rule, after a shift if need be.
    fn ready_to_lift<W: Watch>(
        &self,
        place: &Place,
        budget: usize,
        work: &mut Work<'_, W>,
    ) -> Result<(Vec<Motion>, Option<Place>), Barrier> {
        let robot = self.scene.robot();
        let com = Posture::new(robot, &place.configuration).center_of_mass(robot);
        let footing = self.footing();
        let contacts = footing.contacts(&place.staying);
        let rule = Wanted::rule(&contacts, robot.stance(), footing.preference)
            .ok_or_else(|| Barrier::new("stability", "the feet enclose no support polygon"))?;
        if rule.spare(&com) >= 0.0 {
            return Ok((Vec::new(), None));
        }
        let attempt = self.shifted(place, &rule, SPARE * robot.scale(), budget, work)?;
        if let Some(barrier) = attempt.barrier {
            return Err(Barrier {
                text: format!("before it is lifted {}", barrier.text),
                ..barrier
            });
        }
        let there = self.place(&attempt.end).map_err(|e| Barrier::new("check", e.to_string()))?;
        Ok((attempt.motions, Some(there)))
    }

    /// The chassis moved with the leg at a share of the way to its fold.
    fn at_share<W: Watch>(
        &self,
        from: &Place,
        path: &FoldPath,
        share: f64,
        budget: usize,
        work: &mut Work<'_, W>,
    ) -> Result<Attempt, Barrier> {
        let fold = cut(&path.fold, share);
        let end = fold[fold.len() - 1];
        let mut motions = Vec::new();
        if path.lift.len() > 1 || fold.len() > 1 {
            motions.push(self.fold_motion(from, &path.lift, &fold)?);
        }
        let lifted = from.configuration.with_leg(self.leg, end);
        let place = self.place(&lifted).map_err(|e| Barrier::new("check", e.to_string()))?;
        let mut attempt = self.chassis(&place, budget, work)?;
        attempt.motions.splice(0..0, motions);
        Ok(attempt)
    }

    /// Up from the ground and to the fold that wins most.
    fn fold_path<W: Watch>(
        &self,
        from: &Place,
        work: &mut Work<'_, W>,
    ) -> Result<FoldPath, Barrier> {
        let robot = self.scene.robot().clone();
        let posture = Posture::new(&robot, &from.configuration);
        let guard = self.guard(&from.staying);
        let checker = LegChecker::keeping(self.scene, &posture, self.leg, Keep::default());
        let certified = EdgeRule::Certified;
        let mut space = LegSpace::new(&checker, &robot, &posture, guard.as_ref(), certified);
        let lift = self.lift(from, &posture, &mut space)?;
        let lifted = lift[lift.len() - 1];
        let inward = self.inward(from, &posture.center_of_mass(&robot).xy());
        let win = |space: &LegSpace, angles: &LegAngles| inward.dot(&space.center_of_mass(angles));
        let tree = FoldTree::grown(lifted, self.options.seed, &win, &mut space);
        let way = tree.way_to_best(&win, &mut space);
        let smoothed = smooth(&mut space, &way, &SmoothOptions::default(), work.watch)
            .map_err(|_| Barrier::new("search", "the search was stopped"))?;
        Ok(FoldPath { lift, fold: smoothed.path })
    }

    /// Where the center of mass is wanted, seen from where it is; else away from the leg's foot.
    fn inward(&self, from: &Place, com: &nalgebra::Point2<f64>) -> Vector2<f64> {
        let goal = from.wanted.best().map(|(goal, _)| goal - com);
        let middle = from.staying.iter().map(|(_, p)| p.coords.xy()).sum::<Vector2<f64>>()
            / from.staying.len() as f64;
        goal.and_then(|way| way.try_normalize(1e-9))
            .or_else(|| (middle - com.coords).try_normalize(1e-9))
            .unwrap_or_else(Vector2::x)
    }

    /// Knots from the ground to where the wheel is free.
    fn lift(
        &self,
        from: &Place,
        posture: &Posture,
        space: &mut LegSpace,
    ) -> Result<Vec<LegAngles>, Barrier> {
        let robot = self.scene.robot();
        let angles = from.configuration.legs[self.leg.0];
        let teller = Teller { scene: self.scene, leg: self.leg, lift: LIFTS[0] * robot.scale() };
        let Some(zone) = self.zone(from, &from.configuration) else {
            return match space.blocked(&angles) {
                None => Ok(vec![angles]),
                Some(blocked) => {
                    let text = format!("in the air {}", teller.blocked_text(&blocked));
                    Err(Barrier::new("clearance", text))
                }
            };
        };
        let normal = collision::footfall_place(self.scene, self.leg, zone.contact.xy())
            .map_or(Vector3::z_axis(), |place| place.normal);
        let wheel = posture.wheel(robot, self.leg).world_from_wheel;
        let mut why = None;
        for height in LIFTS {
            let height = height * robot.scale();
            let above = Translation3::from(normal.into_inner() * height) * wheel;
            let knots = match wheel_line(robot, posture, self.leg, &angles, &above) {
                Ok(knots) => knots,
                Err(error) => {
                    let failure =
                        Teller { lift: height, ..teller }.line_failure(0, "lifted", error);
                    why = why.or(Some(Barrier::new("reach", failure.reason)));
                    continue;
                }
            };
            space.zone = Some(zone);
            let blocked = space.blocked_along(&knots);
            space.zone = None;
            match blocked.or_else(|| space.blocked(&knots[knots.len() - 1])) {
                None => return Ok(knots),
                Some(blocked) => {
                    let text = format!("while it is lifted, {}", teller.blocked_text(&blocked));
                    why = why.or(Some(Barrier::new("clearance", text)));
                }
            }
        }
        Err(why.unwrap_or_else(|| Barrier::new("reach", "the leg cannot be lifted")))
    }

    /// The leg's motion with times, as the final check passes it.
    fn fold_motion(
        &self,
        from: &Place,
        lift: &[LegAngles],
        fold: &[LegAngles],
    ) -> Result<Motion, Barrier> {
        let robot = self.scene.robot();
        let posture = Posture::new(robot, &from.configuration);
        let guard = self.guard(&from.staying);
        let limits = TimingLimits::of(robot);
        let mut waypoints: Vec<Waypoint> = Vec::new();
        for (phase, knots) in [(Phase::Lift, lift), (Phase::Transit, fold)] {
            if knots.len() < 2 {
                continue;
            }
            let guard = guard.as_ref();
            let timed =
                time_leg_path(robot, &posture, self.leg, knots, guard, self.gravity, &limits)
                    .map_err(|why| {
                        Barrier::new("stability", format!("no way to time the fold: {why}"))
                    })?;
            let begin = waypoints.last().map_or(0.0, |w| w.time);
            let skip = usize::from(!waypoints.is_empty());
            for (angles, time) in knots.iter().zip(timed.times()).skip(skip) {
                let there = posture.with_leg(robot, self.leg, angles).center_of_mass(robot);
                let hold = guard.is_some_and(|guard| guard.spare(&there) >= 0.0);
                let time = begin + time;
                waypoints.push(Waypoint { angles: *angles, phase, time, stance: None, hold });
            }
        }
        self.checked(from, &from.configuration, waypoints)
    }
}

/// The first part of a path, by its length.
fn cut(path: &[LegAngles], share: f64) -> Vec<LegAngles> {
    let whole: f64 = path.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    let mut left = whole * share;
    let mut part = vec![path[0]];
    for w in path.windows(2) {
        let length = (w[1] - w[0]).norm();
        if left <= 0.0 {
            break;
        }
        let t = if length > left { left / length } else { 1.0 };
        part.push(w[0].lerp(&w[1], t));
        left -= length;
    }
    part
}
