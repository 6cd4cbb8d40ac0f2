//! The ends of a step: up from the ground, the ways down to the goal, and the nearest place that would
//! work where there is none.

use collision::{ContactZone, Touchdown, touchdowns};
use nalgebra::{Isometry3, Point2, Point3, Translation3, Unit, Vector3};
use rover::{LegAngles, Posture};

use crate::answer::{Footfall, Outcome, Target};
use crate::failure::{Failure, outcome_of};
use crate::leg_space::{Blocked, LegSpace};
use crate::line::{LineError, wheel_line};
use crate::step::Planning;
use crate::watch::Watch;

/// Ways to put the wheel down that are looked at.
const MOST_TOUCHDOWNS: usize = 16;

/// Clearance beyond what must be kept that a way to put the wheel down is preferred for (m at
/// scale 1).
const ROOM: f64 = 0.05;

/// Distances at which a place is sought for which there would be a step (m at scale 1), and
/// directions at each.
const RINGS: [f64; 6] = [0.05, 0.1, 0.2, 0.35, 0.6, 1.0];
const DIRECTIONS: usize = 8;
/// Halvings of the way between two rings.
const HALVINGS: usize = 3;

/// The part of the way that all goals share.
pub(crate) struct Departure {
    /// Knots from the start to the lift waypoint.
    pub knots: Vec<LegAngles>,
    pub zone: Option<ContactZone>,
}

/// A way to end the step.
pub(crate) struct Arrival {
    /// Knots from the drop waypoint to the goal.
    pub knots: Vec<LegAngles>,
    pub zone: Option<ContactZone>,
    pub footfall: Option<Footfall>,
}

/// Why a wheel cannot be moved away from where it stands.
enum Away {
    Line(LineError),
    Blocked(Blocked),
}

pub(crate) enum Goal {
    Touchdown(Touchdown),
    Angles(LegAngles),
}

fn footfall_of(touchdown: &Touchdown) -> Footfall {
    Footfall {
        contact: touchdown.contact,
        normal: touchdown.place.normal,
        world_from_wheel: touchdown.wheel.world_from_wheel,
    }
}

impl Planning<'_> {
    fn zone(&self, contact: Point3<f64>, wheel: &Isometry3<f64>) -> ContactZone {
        let rules = self.scene.robot().stance();
        ContactZone {
            contact,
            center: wheel.translation.vector.into(),
            radius: rules.contact_radius,
            height: rules.contact_height,
            ground_tolerance: rules.ground_tolerance,
        }
    }

    /// The waypoint above a standing wheel, along the ground's normal.
    fn above(&self, wheel: &Isometry3<f64>, normal: &Unit<Vector3<f64>>) -> Isometry3<f64> {
        Translation3::from(normal.into_inner() * self.request.lift) * wheel
    }

    /// From the start up to the lift waypoint; a leg that is in the air already stays there.
    pub fn departure(
        &self,
        posture: &Posture,
        contact: Option<Point3<f64>>,
        space: &mut LegSpace,
    ) -> Result<Departure, Failure> {
        let Some(contact) = contact else {
            return match space.blocked(&self.angles()) {
                None => Ok(Departure { knots: vec![self.angles()], zone: None }),
                Some(blocked) => {
                    let text = format!("at the start {}", self.teller().blocked_text(&blocked));
                    Err(Failure::new(1, Outcome::Colliding, text).by_blocked(&blocked))
                }
            };
        };
        let wheel = posture.wheel(self.scene.robot(), self.leg()).world_from_wheel;
        let zone = self.zone(contact, &wheel);
        let normal = collision::footfall_place(self.scene, self.leg(), contact.xy())
            .map_or(Vector3::z_axis(), |place| place.normal);
        self.away_from_ground(posture, &self.angles(), &wheel, &zone, &normal, space)
            .map(|knots| Departure { knots, zone: Some(zone) })
            .map_err(|away| match away {
                Away::Line(e) => self.teller().line_failure(2, "lifted", e),
                Away::Blocked(blocked) => {
                    let outcome = outcome_of(&blocked, Outcome::NoLift);
                    let text =
                        format!("while it is lifted, {}", self.teller().blocked_text(&blocked));
                    Failure::new(2, outcome, text).by_blocked(&blocked)
                }
            })
    }

    /// Knots from a standing wheel to the waypoint above it: along the ground's normal, or straight
    /// up where that fails.
    fn away_from_ground(
        &self,
        posture: &Posture,
        angles: &LegAngles,
        wheel: &Isometry3<f64>,
        zone: &ContactZone,
        normal: &Unit<Vector3<f64>>,
        space: &mut LegSpace,
    ) -> Result<Vec<LegAngles>, Away> {
        let robot = self.scene.robot();
        let mut along = |normal: &Unit<Vector3<f64>>| {
            let above = self.above(wheel, normal);
            let knots =
                wheel_line(robot, posture, self.leg(), angles, &above).map_err(Away::Line)?;
            space.zone = Some(*zone);
            let blocked = space.blocked_along(&knots);
            space.zone = None;
            // The waypoint belongs to the transit: there the wheel may touch nothing.
            space.buffered = true;
            let blocked = blocked.or_else(|| space.blocked(&knots[knots.len() - 1]));
            space.buffered = false;
            blocked.map_or(Ok(knots), |blocked| Err(Away::Blocked(blocked)))
        };
        let first = along(normal);
        let tilted = normal.dot(&Vector3::z()) < 1.0 - 1e-9;
        match first {
            Err(failed) if tilted => along(&Vector3::z_axis()).map_err(|_| failed),
            first => first,
        }
    }

    /// Joint angles to end with: as given, or the ways to put the wheel down at the target, those
    /// with room about the leg first.
    pub fn goals(&self, posture: &Posture, space: &mut LegSpace) -> Result<Vec<Goal>, Failure> {
        match self.request.target {
            Target::Angles(angles) => Ok(vec![Goal::Angles(angles)]),
            Target::Ground(ground) => {
                let mut goals = self.touchdowns_at(posture, ground.xy())?;
                goals.sort_by_cached_key(|goal| {
                    space.zone = Some(self.zone(goal.contact, &goal.wheel.world_from_wheel));
                    !space.is_roomy(&goal.angles, ROOM * self.scene.robot().scale())
                });
                space.zone = None;
                Ok(goals.into_iter().map(Goal::Touchdown).collect())
            }
        }
    }

    fn touchdowns_at(&self, posture: &Posture, p: Point2<f64>) -> Result<Vec<Touchdown>, Failure> {
        let near = self.angles();
        touchdowns(self.scene, posture, self.leg(), p, &near, MOST_TOUCHDOWNS)
            .map_err(|none| self.teller().no_touchdown(none))
    }

    /// The way down to a goal, checked.
    pub fn arrival(
        &self,
        posture: &Posture,
        goal: &Goal,
        space: &mut LegSpace,
    ) -> Result<Arrival, Failure> {
        if let (Goal::Angles(angles), true) = (goal, self.request.transit_only) {
            return match space.blocked(angles) {
                None => Ok(Arrival { knots: vec![*angles], zone: None, footfall: None }),
                Some(blocked) => {
                    let text = format!("at the goal {}", self.teller().blocked_text(&blocked));
                    Err(Failure::new(4, Outcome::Colliding, text).by_blocked(&blocked))
                }
            };
        }
        let (angles, footfall) = match goal {
            Goal::Touchdown(t) => (t.angles, footfall_of(t)),
            Goal::Angles(angles) => (*angles, self.footfall_at(posture, angles)?),
        };
        let wheel = &footfall.world_from_wheel;
        let zone = self.zone(footfall.contact, wheel);
        space.zone = Some(zone);
        let blocked = space.blocked(&angles);
        space.zone = None;
        if let Some(blocked) = blocked {
            let text = format!("with the wheel there {}", self.teller().blocked_text(&blocked));
            let outcome = outcome_of(&blocked, Outcome::Colliding);
            return Err(Failure::new(4, outcome, text).by_blocked(&blocked));
        }
        let away = self.away_from_ground(posture, &angles, wheel, &zone, &footfall.normal, space);
        let mut knots = away.map_err(|away| match away {
            Away::Line(e) => self.teller().line_failure(5, "raised above the goal", e),
            Away::Blocked(blocked) => {
                let outcome = outcome_of(&blocked, Outcome::NoLift);
                let text = format!("on the way down {}", self.teller().blocked_text(&blocked));
                Failure::new(6, outcome, text).by_blocked(&blocked)
            }
        })?;
        knots.reverse();
        Ok(Arrival { knots, zone: Some(zone), footfall: Some(footfall) })
    }

    /// Where the wheel stands with these angles; it must stand.
    fn footfall_at(&self, posture: &Posture, angles: &LegAngles) -> Result<Footfall, Failure> {
        let robot = self.scene.robot();
        let posture = posture.with_leg(robot, self.leg(), angles);
        let wheel = posture.wheel(robot, self.leg());
        let below = collision::wheel_ground(&wheel, self.scene.map(), |_| true);
        let Some(gap) = below.nearest.filter(|_| !below.unknown) else {
            let text = "the ground below the goal is unknown";
            let failure = Failure::new(3, Outcome::UnknownGround, text);
            return Err(failure.by("unknown_ground", None, "m"));
        };
        if gap.gap.abs() > robot.stance().ground_tolerance {
            let (far, side) = (gap.gap.abs(), if gap.gap > 0.0 { "above" } else { "in" });
            let text = format!("with these angles the wheel is {far:.3} m {side} the ground");
            let failure = Failure::new(3, Outcome::Unreachable, text);
            return Err(failure.by("ground", Some(far), "m"));
        }
        let contact = collision::contact_center(&wheel, self.scene.map(), &gap);
        let place = collision::footfall_place(self.scene, self.leg(), contact.xy());
        let normal = place.map_or(nalgebra::Vector3::z_axis(), |place| place.normal);
        Ok(Footfall { contact, normal, world_from_wheel: wheel.world_from_wheel })
    }

    /// The nearest ground where the wheel could be put down and lifted again, if it is the place
    /// that is in the way.
    pub fn nearest_place(
        &self,
        posture: &Posture,
        failure: &Failure,
        space: &mut LegSpace,
        watch: &mut impl Watch,
    ) -> Option<Point3<f64>> {
        let Target::Ground(ground) = self.request.target else { return None };
        let of_place = [
            Outcome::Unreachable,
            Outcome::Colliding,
            Outcome::NoLift,
            Outcome::UnknownGround,
            Outcome::Unstable,
        ];
        if !of_place.contains(&failure.outcome) {
            return None;
        }
        let scale = self.scene.robot().scale();
        // First toward where the wheel is now: most places that fail are too far out.
        let wheel = posture.wheel(self.scene.robot(), self.leg()).center();
        let home = wheel.xy() - ground.xy();
        let heading = home.y.atan2(home.x);
        let mut works = |p: Point2<f64>| {
            let ways = self.touchdowns_at(posture, p).ok()?;
            let mut ways = ways.into_iter().take(2);
            ways.any(|way| self.arrival(posture, &Goal::Touchdown(way), space).is_ok()).then_some(p)
        };
        let mut within: f64 = 0.0;
        for ring in RINGS {
            for k in 0..DIRECTIONS {
                if watch.stopped().is_some() {
                    return None;
                }
                let side = if k % 2 == 0 { 1.0 } else { -1.0 };
                let turn = k.div_ceil(2) as f64 * side / DIRECTIONS as f64;
                let angle = heading + std::f64::consts::TAU * turn;
                let toward = nalgebra::Vector2::new(angle.cos(), angle.sin());
                let reach = (ring * scale).min(if k == 0 { home.norm() } else { f64::INFINITY });
                let Some(mut best) = works(ground.xy() + toward * reach) else { continue };
                // Rings are far apart: nearer in this direction, by halves of what is between.
                let (mut near, mut far) = (within.min(reach), reach);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (near + far);
                    match works(ground.xy() + toward * middle) {
                        Some(nearer) => (best, far) = (nearer, middle),
                        None => near = middle,
                    }
                }
                return self.scene.map().height_at(best).map(|z| Point3::new(best.x, best.y, z));
            }
            within = ring * scale;
        }
        None
    }
}
