//! Whether the whole body is clear while it is shifted.

use collision::{BodyCertifier, Certificate, Scene, Survey, Touch, Violation, survey};
use rover::{Configuration, LegId, Posture};

use super::executed::Executed;
use crate::answer::Constraint;
use crate::check::touch_text;

/// Largest change of a joint between two configurations looked at (rad).
const STEP: f64 = 0.01;

/// Distances below the tolerance by rounding alone pass (m).
const ROUNDING: f64 = 1e-7;

/// Says whether pieces of a shift are free of collisions.
pub trait BodyClear {
    /// Is the executed motion between two knots free? The error says what is in the way, in words.
    fn piece(&mut self, a: &Configuration, b: &Configuration) -> Result<(), String>;

    /// What the last error was about, in the words of the wire, and how much was missing.
    fn constraint(&self) -> Constraint {
        Constraint { name: "clearance", missing: None, unit: "m" }
    }
}

/// Certified: free at every resolution, by [`BodyCertifier`].
///
/// Every pair keeps its tolerance, or, where it is nearer than that already, does not come nearer
/// than at the start (by more than a tenth of its distance there).
pub struct CertifiedBody<'a> {
    scene: &'a Scene,
    standing: Vec<LegId>,
    certifier: BodyCertifier<'a>,
    missing: Option<f64>,
}

impl<'a> CertifiedBody<'a> {
    /// Prepares for shifts from `start` with these legs standing.
    pub fn new(scene: &'a Scene, start: &Configuration, standing: &[LegId]) -> CertifiedBody<'a> {
        let certifier = BodyCertifier::new(scene, start, standing);
        CertifiedBody { scene, standing: standing.to_vec(), certifier, missing: None }
    }

    /// What is known of the executed motion between two knots.
    pub fn certificate(&mut self, a: &Configuration, b: &Configuration) -> Certificate {
        self.certifier.certify(&Executed::new(self.scene.robot(), a, b, &self.standing))
    }
}

impl BodyClear for CertifiedBody<'_> {
    fn piece(&mut self, a: &Configuration, b: &Configuration) -> Result<(), String> {
        let found = if a == b {
            self.certifier.violation(a)
        } else {
            match self.certificate(a, b) {
                Certificate::Free => None,
                Certificate::Blocked { violation, .. } => Some(violation),
                Certificate::Open { .. } => {
                    self.missing = None;
                    let text = "something is too near to what must be kept to be told from a touch";
                    return Err(text.into());
                }
            }
        };
        self.missing = found.as_ref().map(|v| v.required - v.distance);
        let text = |v: Violation| near_text(self.scene, v.touch, v.distance, v.required);
        found.map_or(Ok(()), |v| Err(text(v)))
    }

    fn constraint(&self) -> Constraint {
        Constraint { name: "clearance", missing: self.missing, unit: "m" }
    }
}

/// Surveys the whole robot at points no farther apart than 0.01 rad: what is thinner than the way
/// between two points can be missed.
///
/// Every pair keeps its tolerance, or, where it is nearer than that already, does not come nearer
/// than at the start (by more than a tenth of its distance there).
pub struct SampledBody<'a> {
    scene: &'a Scene,
    standing: Vec<LegId>,
    at_start: Survey,
}

impl<'a> SampledBody<'a> {
    /// Prepares for shifts from `start` with these legs standing.
    pub fn new(scene: &'a Scene, start: &Configuration, standing: &[LegId]) -> SampledBody<'a> {
        let at_start = survey(scene, &Posture::new(scene.robot(), start));
        SampledBody { scene, standing: standing.to_vec(), at_start }
    }

    fn posture(&self, configuration: &Configuration) -> Result<(), String> {
        let seen = survey(self.scene, &Posture::new(self.scene.robot(), configuration));
        for pair in seen.links.iter().chain(&seen.environment) {
            let kept = self.at_start.kept(pair.touch, pair.tolerance);
            if pair.distance <= 0.0 || pair.distance < kept - ROUNDING {
                return Err(near_text(self.scene, pair.touch, pair.distance, kept));
            }
        }
        Ok(())
    }
}

fn near_text(scene: &Scene, touch: Touch, distance: f64, required: f64) -> String {
    let text = touch_text(scene, touch);
    if distance <= 0.0 { text } else { format!("{text}: {distance:.3} m apart of {required:.3} m") }
}

impl BodyClear for SampledBody<'_> {
    fn piece(&mut self, a: &Configuration, b: &Configuration) -> Result<(), String> {
        let change = a.legs.iter().zip(&b.legs).map(|(a, b)| (b - a).amax()).fold(0.0, f64::max);
        let n = (change / STEP).ceil().clamp(1.0, 1e6) as usize;
        if change == 0.0 {
            return self.posture(a);
        }
        let executed = Executed::new(self.scene.robot(), a, b, &self.standing);
        (0..=n).try_for_each(|i| self.posture(&executed.at(i as f64 / n as f64).0))
    }
}
