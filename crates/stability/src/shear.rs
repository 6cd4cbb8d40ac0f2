//! What accelerations ask of friction: the horizontal force and the twist that they use up.
//!
//! Masses mᵢ at pᵢ that accelerate with aᵢ need the force Σ mᵢ (g + aᵢ) and, about the center of mass,
//! the moment Σ (pᵢ - c) × mᵢ aᵢ from the contacts (Newton and Euler for point masses). Where the
//! zero-moment point lies says nothing of the horizontal part of that force, nor of the moment about
//! gravity. Here both count: forces within the linearized cones must give all six.
//!
//! The set of wrenches that cones can give is convex, so what is held at two accelerations is held at
//! every mix of them. Frame `g` (z up), meters; forces in weights.

use nalgebra::{Point3, Vector3};

use crate::contact::{self, ConeModel, Contact};
use crate::force_region::{ForceSet, cones, unit_force};
use crate::simplex::{Tableau, Unsolved};

/// Three forces, three moments, the cap on all forces together.
const BALANCES: usize = 7;

/// Force and moment about the center of mass, for each unit of what is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// In weights.
    pub force: Vector3<f64>,
    /// In weights times meters.
    pub moment: Vector3<f64>,
}

/// Friction cones that hold a rover that accelerates.
#[derive(Debug, Clone, PartialEq)]
pub struct Footholds {
    cones: Vec<ForceSet>,
    /// Size of the stance (m), for numbers of order one.
    size: f64,
}

impl Footholds {
    /// `None` for contacts that cannot be worked with, see [`crate::ContactError`].
    pub fn new(contacts: &[Contact], cone: ConeModel) -> Option<Footholds> {
        let cones = cones(contacts, cone).ok()?;
        let center = contact::center(contacts.iter().map(|c| c.position));
        let away = contacts.iter().map(|c| (c.position - center).norm()).fold(0.0, f64::max);
        Some(Footholds { cones, size: if away > 1e-9 { away } else { 1.0 } })
    }

    /// The largest t for which the contacts give what holds the weight with the center of mass at `com`
    /// (m), and t times `more`. Zero where they do not even hold it at rest; bounded, for all forces
    /// together are capped at [`FORCE_CAP`](crate::force_region::FORCE_CAP) times the weight. Infinity
    /// where nothing more is asked for.
    pub fn most(&self, com: &Point3<f64>, more: &Wrench) -> f64 {
        let moment = more.moment / self.size;
        let asked = more.force.norm().hypot(moment.norm());
        if asked <= f64::MIN_POSITIVE {
            return f64::INFINITY;
        }
        if !asked.is_finite() || !com.coords.iter().all(|v| v.is_finite()) {
            return 0.0;
        }
        let (force, moment) = (more.force / asked, moment / asked);
        let given = |set: &ForceSet, ray: &Vector3<f64>| {
            let arm = (set.position - com) / self.size;
            let ray = ray.normalize();
            let ([x, y, z, twist, cap], _) = unit_force(&arm, &ray);
            let moment = arm.cross(&ray);
            ([x, y, z, moment.x, moment.y, twist, cap], [0.0, 0.0])
        };
        let mut columns: Vec<([f64; BALANCES], [f64; 2])> = self
            .cones
            .iter()
            .flat_map(|set| set.rays.iter().map(move |ray| given(set, ray)))
            .collect();
        // What is left of the cap; then t, which takes from what the contacts give.
        columns.push(([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, 0.0]));
        let taken = [force.x, force.y, force.z, moment.x, moment.y, moment.z, 0.0];
        columns.push((taken.map(|v| -v), [1.0, 0.0]));
        let mut program = Tableau::new(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], &columns);
        // t begins at zero: at rest the contacts must do without it.
        let mut at_rest = program.clone();
        at_rest.keep_out_from(columns.len() - 1);
        if at_rest.find_feasible().is_err() {
            return 0.0;
        }
        if at_rest.basis().len() == BALANCES {
            program = at_rest;
            program.keep_out_from(columns.len());
        } else if program.find_feasible().is_err() {
            // A balance to which no contact gives anything, as without friction, may still hold t.
            return 0.0;
        }
        match program.maximize([1.0, 0.0]) {
            Ok(()) => program.values()[0].max(0.0) / asked,
            Err(Unsolved::Unbounded) => f64::INFINITY,
            Err(_) => 0.0,
        }
    }
}
