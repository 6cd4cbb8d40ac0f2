//! Margins of stances whose contacts are not known exactly.
//!
//! Friction and normals enter through the cones: the forces that lie within a cone of friction μ
//! whatever its normal within an angle δ of the nominal one are again a cone about the nominal one, of
//! half angle atan μ - δ. So one cone stands for all, and what holds with it holds with any.
//! Heights of footfalls move the levers; all combinations of highest and lowest are looked at, each from
//! the region of the one before ([`crate::kept_region`]), for one contact changes between them.
//!
//! Frame `g` (z up), meters.

use nalgebra::{Point3, Vector3};

use crate::contact::{self, ConeModel, Contact, ContactError};
use crate::energy;
use crate::force_region::ForceSet;
use crate::kept_region::KeptRegion;

/// Most contacts of a stance whose heights are varied.
const MAX_VARIED: usize = 8;

/// How well contacts are known.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Uncertainty {
    /// Heights of footfalls are within this (m).
    pub height_m: f64,
    /// Normals are within this angle (rad).
    pub normal_rad: f64,
    /// Friction coefficients are within this.
    pub friction: f64,
}

/// The least margins that a stance may have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobustMargins {
    /// In the friction region (m); `None` if some combination holds no center of mass.
    pub friction_m: Option<f64>,
    /// Rise of the center of mass to tip over (m); `None` without a support polygon.
    pub energy_m: Option<f64>,
}

/// The least margins of `com` over contacts known to within `uncertainty`.
///
/// A stance of more than 8 contacts is too large, by [`ContactError::TooManyContacts`]. Negative
/// uncertainties, and what is no number, count as none.
pub fn margins(
    contacts: &[Contact],
    com: &Point3<f64>,
    uncertainty: &Uncertainty,
    cone: ConeModel,
) -> Result<RobustMargins, ContactError> {
    let n_contacts = contacts.len();
    if n_contacts > MAX_VARIED {
        return Err(ContactError::TooManyContacts { n_contacts });
    }
    contact::check(contacts)?;
    cone.check()?;
    let (height, tilt) = (uncertainty.height_m.max(0.0), uncertainty.normal_rad.max(0.0));
    let least_friction = |c: &Contact| (c.friction - uncertainty.friction.max(0.0)).max(0.0);
    let mut varied: Vec<Contact> = contacts.to_vec();
    for c in &mut varied {
        c.friction = (least_friction(c).atan() - tilt).tan();
        c.position -= Vector3::z() * height;
    }
    // Below zero even a force along the normal may slip; no such force is left.
    let slips = varied.iter().any(|c| c.friction < 0.0);
    let center = contact::center(contacts.iter().map(|c| c.position));
    let set = |c: &Contact| ForceSet::cone(c, &center, cone);
    let mut kept = match slips {
        true => None,
        false => Some(KeptRegion::new(varied.iter().map(set).collect())?),
    };
    let mut least =
        RobustMargins { friction_m: Some(f64::INFINITY), energy_m: Some(f64::INFINITY) };
    let n_combinations = if height == 0.0 { 1 } else { 1_u32 << n_contacts };
    for k in 0..n_combinations {
        // In the order of Gray's code one contact changes its height from each to the next.
        let changed = k.trailing_zeros() as usize;
        if k > 0 {
            let contact = &mut varied[changed];
            let is_low = contact.position.z < contacts[changed].position.z;
            contact.position.z =
                contacts[changed].position.z + if is_low { height } else { -height };
            if let Some(kept) = &mut kept {
                kept.moved(changed, set(contact))?;
            }
        }
        let friction = kept.as_ref().and_then(|kept| kept.region().margin(com));
        let feet: Vec<Point3<f64>> = varied.iter().map(|c| c.position).collect();
        let energy = energy::margin(&feet, com).ok().map(|margin| margin.height_m);
        least.friction_m = least.friction_m.zip(friction).map(|(a, b)| a.min(b));
        least.energy_m = least.energy_m.zip(energy).map(|(a, b)| a.min(b));
    }
    Ok(least)
}
