//! What the feet stand on, as far as the margin rule asks for it.

use collision::{Scene, ground_normal};
use nalgebra::Point3;
use rover::{LegId, Posture};
use stability::rule::{self, StanceReport};
use stability::{ConeModel, Contact, Preference, StanceGuard};

/// The margin rule as the operator prefers it, and the ground that it is asked on.
#[derive(Clone, Copy)]
pub(crate) struct Footing<'a> {
    pub scene: &'a Scene,
    pub preference: Preference,
    /// Coefficient of friction under all feet.
    pub friction: f64,
}

impl<'a> Footing<'a> {
    /// The rule while nothing is lifted yet: to survive the loss of a leg is a wish about the step, but
    /// a rover that slides does so on all its feet too.
    pub fn on_all_feet(self) -> Footing<'a> {
        let preference = match self.preference {
            Preference::Friction => Preference::Friction,
            Preference::Regular | Preference::Conservative => Preference::Regular,
        };
        Footing { preference, ..self }
    }

    /// The ground under feet that touch at these points (m). Only friction asks for its normals.
    pub fn contacts(&self, feet: &[(LegId, Point3<f64>)]) -> Vec<Contact> {
        let contact = |(leg, position): &(LegId, Point3<f64>)| match self.preference {
            Preference::Friction => {
                let normal = ground_normal(self.scene, *leg, position);
                Contact { position: *position, normal, friction: self.friction }
            }
            Preference::Regular | Preference::Conservative => {
                Contact::level(*position, self.friction)
            }
        };
        feet.iter().map(contact).collect()
    }

    /// The rule over these feet; `None` where they enclose no support polygon.
    pub fn guard(&self, feet: &[(LegId, Point3<f64>)]) -> Option<StanceGuard> {
        StanceGuard::over(&self.contacts(feet), self.scene.robot().stance(), self.preference)
    }

    /// The full assessment of a posture on these feet under `gravity` (m/s²).
    pub fn assess(
        &self,
        posture: &Posture,
        feet: &[(LegId, Point3<f64>)],
        gravity: f64,
    ) -> StanceReport {
        let robot = self.scene.robot();
        if self.preference == Preference::Friction {
            let contacts = feet.iter().map(|(leg, _)| *leg).zip(self.contacts(feet));
            let standing: Vec<(LegId, Contact)> = contacts.collect();
            let cone = ConeModel::default();
            let report = rule::assess_with_friction(robot, posture, &standing, gravity, cone);
            if let Ok(report) = report {
                return report;
            }
        }
        // Contacts that cannot be worked with have no friction region, and the verdict says so.
        rule::assess(robot, posture, feet, gravity)
    }
}
