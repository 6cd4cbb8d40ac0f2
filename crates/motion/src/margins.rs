//! What a step, or the way to a posture, has to spare at some times along it, for people to look at.

use collision::Scene;
use nalgebra::Point3;
use rover::{Configuration, LegId, Posture};
use stability::{ConeModel, Contact, Preference, StanceMargins};

use crate::answer::{StepAnswer, Waypoint};
use crate::footing::Footing;
use crate::shift::base_between;

/// Most samples of a plan.
pub const MOST_SAMPLES: usize = 64;

/// All margins at one time, over the feet that stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarginSample {
    /// Time from the start (s).
    pub time: f64,
    /// Regular margin (m).
    pub regular: Option<f64>,
    /// Conservative margin (m); for four feet minus the distance to their one point.
    pub conservative: Option<f64>,
    /// Margin in the region that friction holds (m).
    pub friction: Option<f64>,
    /// By how much the center of mass must rise to tip over the weakest edge (m).
    pub energy_height: Option<f64>,
    /// The legs of the nearest edge of the regular polygon.
    pub critical: Option<[LegId; 2]>,
}

/// A motion of one leg, with the shift of the body before it, and the feet that it rests on.
#[derive(Debug, Clone, Copy)]
pub struct Stretch<'a> {
    /// The leg that moves by itself.
    pub leg: LegId,
    /// Where the rover is at its beginning.
    pub start: &'a Configuration,
    /// Knots with times: those with a stance shift the body, and come first.
    pub waypoints: &'a [Waypoint],
    /// Feet that bear during the shift, with their contacts (m).
    pub on_ground: &'a [(LegId, Point3<f64>)],
    /// Feet that bear while the leg moves.
    pub standing: &'a [(LegId, Point3<f64>)],
}

impl<'a> Stretch<'a> {
    /// A step of `leg` from `start`.
    pub fn of_step(start: &'a Configuration, leg: LegId, answer: &'a StepAnswer) -> Stretch<'a> {
        let StepAnswer { waypoints, on_ground, standing, .. } = answer;
        Stretch { leg, start, waypoints, on_ground, standing }
    }

    /// Its shift and its motion of the leg, as far as they are there and something bears.
    fn parts(self, begin: f64) -> Vec<Part<'a>> {
        let n_shift = self.waypoints.iter().take_while(|w| w.stance.is_some()).count();
        let (shift, stepping) =
            (&self.waypoints[..n_shift], &self.waypoints[n_shift.saturating_sub(1)..]);
        let part = |waypoints, feet, is_shift| Part { of: self, waypoints, feet, is_shift, begin };
        [part(shift, self.on_ground, true), part(stepping, self.standing, false)]
            .into_iter()
            .filter(|part| part.waypoints.len() > 1 && !part.feet.is_empty())
            .collect()
    }
}

/// Waypoints over which the same feet bear.
struct Part<'a> {
    of: Stretch<'a>,
    waypoints: &'a [Waypoint],
    feet: &'a [(LegId, Point3<f64>)],
    is_shift: bool,
    /// Time at which its stretch begins (s).
    begin: f64,
}

impl Part<'_> {
    fn duration(&self) -> f64 {
        self.waypoints[self.waypoints.len() - 1].time - self.waypoints[0].time
    }

    fn samples(&self, scene: &Scene, friction: f64, n: usize) -> Vec<MarginSample> {
        let (robot, start) = (scene.robot(), self.of.start);
        let strip = Strip::new(scene, self.feet, friction);
        let lifted = self.waypoints[0].stance.as_ref().unwrap_or(start);
        let mut posture = Posture::new(robot, lifted);
        let sample = |(time, [a, b], t): (f64, [&Waypoint; 2], f64)| {
            let com = if self.is_shift {
                let (a, b) =
                    (a.stance.as_ref().unwrap_or(start), b.stance.as_ref().unwrap_or(start));
                let here = base_between(robot, a, b, &strip.legs, t);
                Posture::new(robot, &here).center_of_mass(robot)
            } else {
                posture.move_leg(robot, self.of.leg, &a.angles.lerp(&b.angles, t));
                posture.center_of_mass(robot)
            };
            strip.sample(self.begin + time, &com)
        };
        even(self.waypoints, n).map(sample).collect()
    }
}

/// All margins along motions that follow each other without a pause, at up to [`MOST_SAMPLES`] times,
/// even in time within each shift of the body and each motion of a leg. Where other feet bear there are
/// two samples at one time, as when a leg is lifted after a shift: on all feet, and without the leg.
/// `friction` is the coefficient under all feet. What nothing bears has no samples, as a transit alone,
/// nor has what has no waypoints; of more parts than half the samples the last are left out.
pub fn margins_along(scene: &Scene, stretches: &[Stretch], friction: f64) -> Vec<MarginSample> {
    let mut begin = 0.0;
    let mut parts: Vec<Part> = Vec::new();
    for stretch in stretches {
        parts.extend(stretch.parts(begin));
        begin += stretch.waypoints.last().map_or(0.0, |w| w.time);
    }
    parts.truncate(MOST_SAMPLES / 2);
    let mut left: f64 = parts.iter().map(Part::duration).sum();
    let mut most = MOST_SAMPLES;
    let mut samples = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        // Each has its two ends; what is over is shared by time, and the last takes all of it.
        let after = parts.len() - 1 - i;
        let over = (most - 2 * (after + 1)) as f64;
        let share = if after == 0 { 1.0 } else { part.duration() / left.max(f64::MIN_POSITIVE) };
        let n = 2 + (over * share.clamp(0.0, 1.0)).round() as usize;
        samples.extend(part.samples(scene, friction, n));
        most -= n;
        left -= part.duration();
    }
    samples
}

/// `n` times, 2 or more, evenly from the first waypoint to the last, each with the waypoints before and
/// after it and the share of the way between them.
fn even(waypoints: &[Waypoint], n: usize) -> impl Iterator<Item = (f64, [&Waypoint; 2], f64)> {
    let (begin, end) = (waypoints[0].time, waypoints[waypoints.len() - 1].time);
    (0..n).map(move |i| {
        let share = i as f64 / (n - 1) as f64;
        let time = begin * (1.0 - share) + end * share;
        let after = waypoints.partition_point(|w| w.time < time).clamp(1, waypoints.len() - 1);
        let (a, b) = (&waypoints[after - 1], &waypoints[after]);
        let t = (time - a.time) / (b.time - a.time).max(f64::MIN_POSITIVE);
        (time, [a, b], t.clamp(0.0, 1.0))
    })
}

/// The feet that stand in a part of the step.
struct Strip {
    legs: Vec<LegId>,
    margins: StanceMargins,
}

impl Strip {
    fn new(scene: &Scene, feet: &[(LegId, Point3<f64>)], friction: f64) -> Strip {
        let footing = Footing { scene, preference: Preference::Friction, friction };
        let contacts: Vec<Contact> = footing.contacts(feet);
        Strip {
            legs: feet.iter().map(|(leg, _)| *leg).collect(),
            margins: StanceMargins::new(&contacts, ConeModel::default()),
        }
    }

    fn sample(&self, time: f64, com: &Point3<f64>) -> MarginSample {
        let margins = self.margins.at(com);
        MarginSample {
            time,
            regular: margins.regular.map(|margin| margin.depth_m),
            conservative: margins.conservative_m,
            friction: margins.friction_m,
            energy_height: margins.energy_m,
            critical: margins.regular.map(|margin| margin.contacts.map(|i| self.legs[i])),
        }
    }
}
