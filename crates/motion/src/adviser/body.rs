//! The chassis over its planted feet, for the adviser: searched, certified, timed and checked.

use collision::{ContactZone, Keep, Scene};
use nalgebra::Point3;
use rover::{Configuration, LegId, Posture, Robot};
use stability::rule;

use super::margins::{Margins, torque_barrier};
use super::{Attempt, Case, Motion, Place, Work};
use crate::answer::{Constraint, Phase, Waypoint};
use crate::check::{CheckContext, check_step};
use crate::shift::{
    Barrier, BodyClear, CLOSURE, CertifiedBody, ClosedChain, Reached, Shift, Wanted,
};
use crate::timing::{TimingLimits, time_body_path};
use crate::watch::Watch;

/// What an end has to spare beyond the wish (m), so that rounding does not undo it.
const BEYOND: f64 = 1e-6;

/// Clear, and within the joints' torques: the ends on the feet that stay, the way on those that bear.
struct Feasible<'a> {
    body: CertifiedBody<'a>,
    robot: &'a Robot,
    gravity: f64,
    bearing: &'a [(LegId, Point3<f64>)],
    staying: &'a [(LegId, Point3<f64>)],
    /// Largest ratio that a way may come to: a start that bears too much may not come to bear more.
    on_the_way: f64,
    constraint: Constraint,
}

impl<'a> Feasible<'a> {
    fn new(scene: &'a Scene, place: &'a Place, gravity: f64) -> Feasible<'a> {
        let legs: Vec<LegId> = place.on_ground.iter().map(|(leg, _)| *leg).collect();
        let body = CertifiedBody::new(scene, &place.configuration, &legs);
        let robot = scene.robot().as_ref();
        let posture = Posture::new(robot, &place.configuration);
        let at_start = rule::assess(robot, &posture, &place.bearing, gravity).torque.worst;
        let constraint = body.constraint();
        let (bearing, staying) = (&place.bearing[..], &place.staying[..]);
        let on_the_way = at_start.ratio.abs().max(1.0);
        Feasible { body, robot, gravity, bearing, staying, on_the_way, constraint }
    }
}

impl BodyClear for Feasible<'_> {
    fn piece(&mut self, a: &Configuration, b: &Configuration) -> Result<(), String> {
        if let Err(text) = self.body.piece(a, b) {
            self.constraint = self.body.constraint();
            return Err(text);
        }
        let (feet, most) =
            if a == b { (self.staying, 1.0) } else { (self.bearing, self.on_the_way) };
        let posture = Posture::new(self.robot, b);
        let worst = rule::assess(self.robot, &posture, feet, self.gravity).torque.worst;
        if worst.ratio.abs() > most + 1e-9 {
            let Barrier { constraint, text } = torque_barrier(self.robot, &worst);
            self.constraint = constraint;
            return Err(text);
        }
        Ok(())
    }

    fn constraint(&self) -> Constraint {
        self.constraint.clone()
    }
}

impl Case<'_> {
    /// The smallest motion of the chassis that meets the wish, or gets nearest to it.
    pub fn chassis<W: Watch>(
        &self,
        place: &Place,
        budget: usize,
        work: &mut Work<'_, W>,
    ) -> Result<Attempt, Barrier> {
        self.shifted(place, &place.wanted, BEYOND * self.scene.robot().scale(), budget, work)
    }

    /// The same for what is `wanted`, with this much to spare (m).
    pub fn shifted<W: Watch>(
        &self,
        place: &Place,
        wanted: &Wanted,
        spare: f64,
        budget: usize,
        work: &mut Work<'_, W>,
    ) -> Result<Attempt, Barrier> {
        let robot = self.scene.robot().as_ref();
        let contacts: Vec<Point3<f64>> = place.on_ground.iter().map(|(_, p)| *p).collect();
        let legs: Vec<LegId> = place.on_ground.iter().map(|(leg, _)| *leg).collect();
        let chain = ClosedChain::new(robot, &place.configuration, &legs, self.options.drive_hold);
        let shift = Shift {
            chain: &chain,
            staying: wanted,
            all: &place.on_the_way,
            contacts: &contacts,
            wanted: spare,
            closure: CLOSURE * robot.scale(),
            freedom: self.options.freedom,
            seed: self.options.seed,
            budget,
        };
        let mut body = Feasible::new(self.scene, place, self.gravity);
        let mut search = shift.search(&mut body, work.watch);
        let reached = shift.reach(&mut search);
        work.n_looked += search.looked;
        let Reached { plan, barrier } = reached?;
        let end = plan.configurations[plan.configurations.len() - 1].clone();
        let mut motions = Vec::new();
        if plan.configurations.len() > 1 {
            motions.push(self.shift_motion(place, &plan.configurations)?);
        }
        let posture = Posture::new(robot, &end);
        let after = Margins::of(&self.footing(), &posture, &place.staying, self.gravity);
        Ok(Attempt { motions, end, after, barrier })
    }

    /// A shift with times, as the final check passes it.
    fn shift_motion(&self, place: &Place, knots: &[Configuration]) -> Result<Motion, Barrier> {
        let robot = self.scene.robot().as_ref();
        let guard = &place.on_the_way;
        let legs: Vec<LegId> = place.on_ground.iter().map(|(leg, _)| *leg).collect();
        let limits = TimingLimits::of(robot);
        let timed = time_body_path(robot, knots, &legs, Some(guard), self.gravity, &limits)
            .map_err(|why| Barrier::new("stability", format!("no way to time the shift: {why}")))?;
        let hold = |knot: &Configuration| {
            let com = Posture::new(robot, knot).center_of_mass(robot);
            guard.spare(&com) >= 0.0
        };
        let waypoint = |(knot, time): (&Configuration, f64)| Waypoint {
            angles: knot.legs[self.leg.0],
            phase: Phase::Shift,
            time,
            hold: hold(knot),
            stance: Some(knot.clone()),
        };
        let waypoints: Vec<Waypoint> = knots.iter().zip(timed.times()).map(waypoint).collect();
        let end = &knots[knots.len() - 1];
        self.checked(place, end, waypoints)
    }

    /// A motion as the final check passes it. `stepping_from` is where the leg begins to move.
    pub fn checked(
        &self,
        place: &Place,
        stepping_from: &Configuration,
        waypoints: Vec<Waypoint>,
    ) -> Result<Motion, Barrier> {
        let context = CheckContext {
            scene: self.scene,
            start: &place.configuration,
            stepping_from,
            leg: self.leg,
            standing: &place.staying,
            gravity: self.gravity,
            preference: self.footing().preference,
            friction: self.options.friction,
            keep: Keep::default(),
            lift_zone: self.zone(place, stepping_from),
            drop_zone: None,
            transit_only: false,
        };
        // After a shift alone the leg's wheel is still where it stood: there it may touch, as when it is
        // about to be lifted.
        let mut looked_at = waypoints.clone();
        let about_to_lift = waypoints.last().filter(|w| w.phase == Phase::Shift);
        looked_at.extend(about_to_lift.map(|w| Waypoint {
            phase: if context.lift_zone.is_some() { Phase::Lift } else { Phase::Transit },
            stance: None,
            ..w.clone()
        }));
        let findings = check_step(&context, &looked_at).findings;
        if let Some(failed) = findings.iter().find(|finding| !finding.ok) {
            let text = format!("the final check refuses it: {} ({})", failed.detail, failed.place);
            return Err(Barrier::new("check", text));
        }
        Ok(Motion {
            leg: self.leg,
            start: place.configuration.clone(),
            waypoints,
            findings,
            on_ground: place.bearing.clone(),
            standing: place.staying.clone(),
        })
    }

    /// Where the leg's wheel may touch while it is lifted; none if it is in the air.
    pub fn zone(&self, place: &Place, at: &Configuration) -> Option<ContactZone> {
        let robot = self.scene.robot();
        let rules = robot.stance();
        let (_, contact) = place.on_ground.iter().find(|(leg, _)| *leg == self.leg)?;
        Some(ContactZone {
            contact: *contact,
            center: Posture::new(robot, at).wheel(robot, self.leg).center(),
            radius: rules.contact_radius,
            height: rules.contact_height,
            ground_tolerance: rules.ground_tolerance,
        })
    }
}
