//! What a step has to spare at some times along it, for people to look at.

use collision::Scene;
use nalgebra::Point3;
use rover::{Configuration, LegId, Posture};
use stability::{ConeModel, Contact, Preference, StanceMargins};

use crate::answer::{StepAnswer, Waypoint};
use crate::footing::Footing;
use crate::shift::base_between;

/// Most samples of a step.
pub const MOST_SAMPLES: usize = 64;

/// All margins of a step at one time, over the feet that stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarginSample {
    /// Time from the start of the step (s).
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

/// All margins of `answer`, a step of `leg` from `start`, at up to [`MOST_SAMPLES`] times, even in
/// time within the body shift and within the motion of the leg. Where the leg is lifted after a shift
/// there are two samples at one time: on all feet, and without the leg. `friction` is the coefficient
/// under all feet. Empty where nothing stands: for a transit alone, and without waypoints.
pub fn margins_along(
    scene: &Scene,
    start: &Configuration,
    leg: LegId,
    answer: &StepAnswer,
    friction: f64,
) -> Vec<MarginSample> {
    let waypoints = &answer.waypoints[..];
    let n_shift = waypoints.iter().take_while(|w| w.stance.is_some()).count();
    let stepping = &waypoints[n_shift.saturating_sub(1)..];
    let (Some(first), Some(lifted), Some(last)) =
        (waypoints.first(), stepping.first(), waypoints.last())
    else {
        return Vec::new();
    };
    let robot = scene.robot();
    let strip = |feet: &[(LegId, Point3<f64>)]| Strip::new(scene, feet, friction);
    let mut samples = Vec::new();
    let mut most = MOST_SAMPLES;
    if n_shift > 1 && !answer.on_ground.is_empty() {
        let strip = strip(&answer.on_ground);
        let share = (lifted.time - first.time) / (last.time - first.time).max(f64::MIN_POSITIVE);
        let n = ((MOST_SAMPLES as f64 * share).round() as usize).clamp(2, MOST_SAMPLES - 2);
        most -= n;
        samples.extend(even(&waypoints[..n_shift], n).map(|(time, [a, b], t)| {
            let (a, b) = (a.stance.as_ref().unwrap_or(start), b.stance.as_ref().unwrap_or(start));
            let here = base_between(robot, a, b, &strip.legs, t);
            strip.sample(time, &Posture::new(robot, &here).center_of_mass(robot))
        }));
    }
    if stepping.len() > 1 && !answer.standing.is_empty() {
        let strip = strip(&answer.standing);
        let mut posture = Posture::new(robot, lifted.stance.as_ref().unwrap_or(start));
        samples.extend(even(stepping, most).map(|(time, [a, b], t)| {
            posture.move_leg(robot, leg, &a.angles.lerp(&b.angles, t));
            strip.sample(time, &posture.center_of_mass(robot))
        }));
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
