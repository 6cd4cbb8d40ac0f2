//! What friction, joint torques and energy say of one posture, beside the polygons of [`crate::rule`].

use nalgebra::{Point3, Vector3};
use rover::{LegId, Posture, Robot};

use crate::contact::{self, ConeModel, Contact, ContactError};
use crate::contact_forces::{self, LeastTorque, LegStatics};
use crate::energy::{self, EnergyMargin};
use crate::force_region::{self, Emptiness, ForceRegion, ForceSet};
use crate::loads::{LoadBand, StanceSprings};
use crate::{support_polygon::SupportError, torque};

/// Friction, forces, torques and energy of one posture. All lists go by the legs that stand, in the
/// order given.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceReport {
    /// The legs that stand.
    pub standing: Vec<LegId>,
    /// Center of mass (m).
    pub com: Point3<f64>,
    /// Weight (N).
    pub weight: f64,
    /// Where friction alone holds the center of mass (H9).
    pub friction: ForceRegion,
    /// What is left of it should any one leg be lost.
    pub friction_conservative: ForceRegion,
    /// Where friction and joint torques hold it (H12), at the present joint angles.
    pub torque: ForceRegion,
    /// How much the friction may fall (negative: must rise); `None` if none would do.
    pub slip_margin: Option<f64>,
    /// The smallest forces that hold it (N); `None` if none do.
    pub least_norm: Option<Vec<Vector3<f64>>>,
    /// The forces that spare the joints most; `None` if none hold it.
    pub least_torque: Option<LeastTorque>,
    /// Loads of the compliant rover with their band; `None` if it tips.
    pub load_band: Option<LoadBand>,
    /// The largest share of a torque limit within that band, and its joint (index into `standing`,
    /// place in the leg).
    pub load_torque: Option<(f64, (usize, usize))>,
    /// The largest share of a torque limit of a leg that does not stand.
    pub lifted_torque: f64,
    /// The energy margin, or why there is none.
    pub energy: Result<EnergyMargin, SupportError>,
}

impl ForceReport {
    /// Whether no joint is loaded beyond its limit: neither by the best forces nor by those of the
    /// compliant rover, whatever in its band they are, nor in a leg that is lifted.
    pub fn is_torque_safe(&self) -> bool {
        let best = self.least_torque.as_ref().is_some_and(|t| !torque::is_beyond(t.ratio));
        let compliant = self.load_torque.is_some_and(|(ratio, _)| !torque::is_beyond(ratio));
        best && compliant && !torque::is_beyond(self.lifted_torque)
    }
}

/// The report of `posture` on these contacts, under `gravity` (m/s², along -z).
pub fn forces(
    robot: &Robot,
    posture: &Posture,
    standing: &[(LegId, Contact)],
    gravity: f64,
    cone: ConeModel,
) -> Result<ForceReport, ContactError> {
    let contacts: Vec<Contact> = standing.iter().map(|(_, contact)| *contact).collect();
    let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
    let (com, weight) = (posture.center_of_mass(robot), robot.mass() * gravity);
    let legs: Vec<LegStatics> = standing
        .iter()
        .map(|(leg, c)| LegStatics::new(robot, posture, *leg, &c.position, gravity))
        .collect();
    let cones = force_region::cones(&contacts, cone)?;
    let feet: Vec<(LegId, Point3<f64>)> =
        standing.iter().map(|(leg, c)| (*leg, c.position)).collect();
    let springs = StanceSprings::of(robot, posture, &feet, gravity);
    let load_band = springs.and_then(|springs| springs.band(&com));
    let lifted = robot.leg_ids().filter(|leg| standing.iter().all(|(other, _)| other != leg));
    let hanging = torque::ratios(robot, posture, &[], gravity).ratios;
    Ok(ForceReport {
        standing: standing.iter().map(|(leg, _)| *leg).collect(),
        friction: force_region::region(&cones, weight)?,
        friction_conservative: force_region::conservative(&cones, weight)?,
        torque: torque_region(&legs, &contacts, weight, cone)?,
        slip_margin: contact_forces::slip_margin(&contacts, &com, cone)?,
        least_norm: contact_forces::least_norm(&contacts, &com, weight, cone)?,
        least_torque: contact_forces::least_torque(&legs, &contacts, &com, weight, cone)?,
        load_torque: load_band.as_ref().map(|band| worst_within(&legs, band)),
        load_band,
        lifted_torque: lifted.map(|leg| hanging[leg.0].amax()).fold(0.0, f64::max),
        energy: energy::margin(&points, &com),
        com,
        weight,
    })
}

/// Where friction and the torques of these legs hold the center of mass, at the present joint
/// angles: as if a load on the chassis were moved, not the chassis itself.
pub fn torque_region(
    legs: &[LegStatics],
    contacts: &[Contact],
    weight: f64,
    cone: ConeModel,
) -> Result<ForceRegion, ContactError> {
    contact::check(contacts)?;
    cone.check()?;
    let center = contact::center(contacts.iter().map(|c| c.position));
    let sets: Option<Vec<ForceSet>> = legs
        .iter()
        .zip(contacts)
        .map(|(leg, c)| force_region::within_torque(c, &center, cone, leg, weight))
        .collect();
    match sets {
        Some(sets) => force_region::region(&sets, weight),
        None => Ok(ForceRegion::empty(Emptiness::Overloaded)),
    }
}

/// The largest share of a torque limit with any of a band's vertical loads, and its joint. Torques
/// are linear in the load, so the ends of the band tell.
fn worst_within(legs: &[LegStatics], band: &LoadBand) -> (f64, (usize, usize)) {
    let ends = band.least_n.iter().zip(&band.most_n);
    legs.iter()
        .zip(ends)
        .enumerate()
        .flat_map(|(i, (leg, (least, most)))| {
            [*least, *most].map(|load| {
                let (place, ratio) = leg.worst(&Vector3::new(0.0, 0.0, load));
                (ratio, (i, place))
            })
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((0.0, (0, 0)))
}
