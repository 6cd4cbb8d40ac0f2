//! Contact forces that hold a stance: the smallest ones, and those that spare the joints most.
//!
//! With more than three contacts, or friction, forces are not unique. Two choices are made here:
//!
//! - [`least_norm`]: the least sum of squares within the friction cones;
//! - [`least_torque`]: the least largest share of a joint's torque limit (H12). It takes for granted
//!   that the legs push against each other just so, which is optimistic: the share of loads of a
//!   compliant rover ([`crate::loads`]) stands beside it, and a stance is safe if both are.
//!
//! And [`slip_margin`] tells how much friction they leave.
//!
//! Frame `g` (z up), meters, newtons.

use nalgebra::{DMatrix, DVector, Point3, Vector3};
use rover::{LegAngles, LegId, Posture, Robot, Wrench, hold_torques};

use crate::contact::{self, ConeModel, Contact, ContactError};
use crate::simplex::{Tableau, Unsolved};

/// Forces whose balance is off by more than this, in weights, do not hold.
const BALANCED: f64 = 1e-9;
/// Halvings of the interval of friction in [`slip_margin`]: to 1e-9.
const HALVINGS: usize = 34;
/// The least friction that [`slip_margin`] looks for is no more than this above what there is.
const MOST_FRICTION_MISSING: f64 = 10.0;

/// A stance and its weight, in units of both: what all balances need.
struct Wrenches<'a> {
    contacts: &'a [Contact],
    com: &'a Point3<f64>,
    center: Point3<f64>,
    size: f64,
}

impl<'a> Wrenches<'a> {
    fn new(contacts: &'a [Contact], com: &'a Point3<f64>) -> Wrenches<'a> {
        let center = contact::center(contacts.iter().map(|c| c.position));
        let radius = contacts.iter().map(|c| (c.position - com).norm()).fold(0.0, f64::max);
        Wrenches { contacts, com, center, size: if radius > 1e-9 { radius } else { 1.0 } }
    }

    /// Force and moment about the center of mass of a unit force along axis `k` at a contact.
    fn of_axis(&self, contact: usize, k: usize) -> [f64; 6] {
        let force = Vector3::ith(k, 1.0);
        let arm = (self.contacts[contact].position - self.com) / self.size;
        let moment = arm.cross(&force);
        [force.x, force.y, force.z, moment.x, moment.y, moment.z]
    }
}

fn check(
    contacts: &[Contact],
    com: &Point3<f64>,
    weight: f64,
    cone: ConeModel,
) -> Result<(), ContactError> {
    contact::check(contacts)?;
    cone.check()?;
    if !com.coords.iter().copied().all(f64::is_finite) {
        return Err(ContactError::NotFinite { contact: contacts.len() });
    }
    if weight.is_finite() && weight > 0.0 { Ok(()) } else { Err(ContactError::BadWeight) }
}

/// The forces (N) of least sum of squares that hold `weight` (N) at `com` within linearized
/// friction cones; `None` if there are none.
///
/// Least-distance programming: balanced forces are f₀ + N z with f₀ the smallest of them, and the
/// z of least length within the cones follows from non-negative least squares (Lawson & Hanson,
/// Solving Least Squares Problems, 1974, ch. 23).
pub fn least_norm(
    contacts: &[Contact],
    com: &Point3<f64>,
    weight: f64,
    cone: ConeModel,
) -> Result<Option<Vec<Vector3<f64>>>, ContactError> {
    check(contacts, com, weight, cone)?;
    let wrenches = Wrenches::new(contacts, com);
    let n = 3 * contacts.len();
    let balance = DMatrix::from_fn(6, n, |row, j| wrenches.of_axis(j / 3, j % 3)[row]);
    let load = DVector::from_column_slice(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    // The null space from the full set of right singular vectors.
    let square = DMatrix::from_fn(n.max(6), n, |i, j| if i < 6 { balance[(i, j)] } else { 0.0 });
    let svd = square.svd(true, true);
    let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else { return Ok(None) };
    let tiny = 1e-10 * svd.singular_values.max();
    let mut smallest = DVector::zeros(n);
    let mut free = Vec::new();
    for (i, s) in svd.singular_values.iter().enumerate() {
        if *s > tiny {
            let share = u.column(i).rows(0, 6).dot(&load) / s;
            smallest += v_t.row(i).transpose() * share;
        } else {
            free.push(v_t.row(i).transpose());
        }
    }
    if (&balance * &smallest - &load).amax() > BALANCED {
        return Ok(None);
    }
    let free = if free.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&free) };
    let sides = half_spaces(contacts, &wrenches.center, cone);
    let Some(z) = least_distance(&(&sides * &free), &-(&sides * &smallest)) else {
        return Ok(None);
    };
    let forces = (smallest + free * z) * weight;
    Ok(Some(forces.as_slice().chunks(3).map(Vector3::from_column_slice).collect()))
}

/// Inward normals of all half spaces of all cones, of length 1, as rows over all forces.
fn half_spaces(contacts: &[Contact], center: &Point3<f64>, cone: ConeModel) -> DMatrix<f64> {
    let per_contact: Vec<Vec<Vector3<f64>>> = contacts
        .iter()
        .map(|c| {
            let mut sides = cone.half_spaces(c, center);
            // Without friction these are only the axis and its mirror image: it must also push.
            sides.push(c.normal.into_inner());
            sides.into_iter().map(|side| side.normalize()).collect()
        })
        .collect();
    let rows: usize = per_contact.iter().map(Vec::len).sum();
    let mut matrix = DMatrix::zeros(rows, 3 * contacts.len());
    let mut row = 0;
    for (i, sides) in per_contact.iter().enumerate() {
        for side in sides {
            matrix.row_mut(row).columns_mut(3 * i, 3).copy_from(&side.transpose());
            row += 1;
        }
    }
    matrix
}

/// The z of least length with G z ≥ h; `None` if there is none.
fn least_distance(g: &DMatrix<f64>, h: &DVector<f64>) -> Option<DVector<f64>> {
    let n = g.ncols();
    if h.iter().all(|h| *h <= 1e-12) {
        return Some(DVector::zeros(n));
    }
    let mut e = DMatrix::zeros(n + 1, g.nrows());
    e.rows_mut(0, n).copy_from(&g.transpose());
    e.row_mut(n).copy_from(&h.transpose());
    let mut goal = DVector::zeros(n + 1);
    goal[n] = 1.0;
    let u = non_negative_least_squares(&e, &goal)?;
    let r = &e * u - goal;
    // Without anything left of the goal no z is on the right side of all half spaces.
    (-r[n] > 1e-10).then(|| r.rows(0, n) / -r[n])
}

/// The u ≥ 0 of least |E u - f| (Lawson & Hanson 1974, algorithm 23.10).
fn non_negative_least_squares(e: &DMatrix<f64>, f: &DVector<f64>) -> Option<DVector<f64>> {
    let n = e.ncols();
    let mut u: DVector<f64> = DVector::zeros(n);
    let mut used: Vec<usize> = Vec::new();
    for _ in 0..3 * n + 30 {
        let gradient = e.transpose() * (f - e * &u);
        let best = (0..n)
            .filter(|j| !used.contains(j))
            .max_by(|a, b| gradient[*a].total_cmp(&gradient[*b]))
            .filter(|j| gradient[*j] > 1e-12);
        let Some(enter) = best else { return Some(u) };
        used.push(enter);
        loop {
            let columns: Vec<_> = used.iter().map(|j| e.column(*j)).collect();
            let part = DMatrix::from_columns(&columns);
            let solved = part.svd(true, true).solve(f, 1e-13).ok()?;
            if solved.iter().all(|s| *s > 0.0) {
                u.fill(0.0);
                used.iter().zip(solved.iter()).for_each(|(j, s)| u[*j] = *s);
                break;
            }
            let step = used
                .iter()
                .zip(solved.iter())
                .filter(|(_, s)| **s <= 0.0)
                .map(|(j, s)| u[*j] / (u[*j] - s))
                .fold(1.0, f64::min);
            used.iter().zip(solved.iter()).for_each(|(j, s)| u[*j] += step * (s - u[*j]));
            used.retain(|j| u[*j] > 1e-14);
            if used.is_empty() {
                break;
            }
        }
    }
    None
}

/// How much the friction of all contacts may fall before nothing holds the stance; negative: how
/// much more they would need at least. `None` if no friction up to 10 more would do.
///
/// Friction coefficients never fall below zero: the margin is at most the largest of them.
pub fn slip_margin(
    contacts: &[Contact],
    com: &Point3<f64>,
    cone: ConeModel,
) -> Result<Option<f64>, ContactError> {
    check(contacts, com, 1.0, cone)?;
    let holds = |change: f64| {
        let changed: Vec<Contact> = contacts
            .iter()
            .map(|c| Contact { friction: (c.friction + change).max(0.0), ..*c })
            .collect();
        holds(&changed, com, cone)
    };
    let most = contacts.iter().map(|c| c.friction).fold(0.0, f64::max);
    // Holds at `enough`, not at `little`.
    let (mut enough, mut little) =
        if holds(0.0) { (0.0, -most) } else { (MOST_FRICTION_MISSING, 0.0) };
    if !holds(enough) {
        return Ok(None);
    }
    if holds(little) {
        return Ok(Some(-little));
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (enough + little);
        if holds(middle) { enough = middle } else { little = middle }
    }
    Ok(Some(-enough))
}

/// Whether forces within the cones hold a center of mass.
fn holds(contacts: &[Contact], com: &Point3<f64>, cone: ConeModel) -> bool {
    let wrenches = Wrenches::new(contacts, com);
    let mut columns = Vec::new();
    for (i, c) in contacts.iter().enumerate() {
        for ray in cone.rays(c, &wrenches.center) {
            let ray = ray.normalize();
            let mut rows = vec![0.0; 6];
            for k in 0..3 {
                let of_axis = wrenches.of_axis(i, k);
                rows.iter_mut().zip(of_axis).for_each(|(row, part)| *row += ray[k] * part);
            }
            columns.push((rows, [0.0, 0.0]));
        }
    }
    Tableau::new(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0], &columns).find_feasible().is_ok()
}

/// How a leg's joint torques follow from the force on its foot: own + per_force · f.
#[derive(Debug, Clone, PartialEq)]
pub struct LegStatics {
    /// The leg.
    pub leg: LegId,
    /// Torques that hold the leg's own links (N m).
    pub own: LegAngles,
    /// Torques per newton along x, y and z of `g` (N m / N).
    pub per_force: [LegAngles; 3],
    /// The torque limits (N m).
    pub limits: LegAngles,
}

impl LegStatics {
    /// Of a leg whose foot touches at `contact`, under `gravity` (m/s²).
    pub fn new(
        robot: &Robot,
        posture: &Posture,
        leg: LegId,
        contact: &Point3<f64>,
        gravity: f64,
    ) -> LegStatics {
        let own = hold_torques(robot, posture, leg, gravity, None);
        let per_force = [0, 1, 2].map(|k| {
            let wrench = Wrench { point: *contact, force: Vector3::ith(k, 1.0) };
            hold_torques(robot, posture, leg, gravity, Some(&wrench)) - own
        });
        LegStatics { leg, own, per_force, limits: robot.leg(leg).effort }
    }

    /// Torques of the joints with this force on the foot (N m).
    pub fn torques(&self, force: &Vector3<f64>) -> LegAngles {
        (0..3).fold(self.own, |sum, k| sum + self.per_force[k] * force[k])
    }

    /// The joint loaded most with this force on the foot, and its share of the limit; a joint without
    /// limit above zero that bears anything has an infinite share.
    pub fn worst(&self, force: &Vector3<f64>) -> (usize, f64) {
        let torques = self.torques(force);
        let share = |i: usize| crate::torque::share(torques[i], self.limits[i]).abs();
        (0..self.own.len())
            .map(|i| (i, share(i)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, 0.0))
    }
}

/// The forces that spare the joints most, and what is left.
#[derive(Debug, Clone, PartialEq)]
pub struct LeastTorque {
    /// The largest share of a torque limit over all joints of these legs: feasible below 1 (H12).
    pub ratio: f64,
    /// The joint that has it: index into the legs given, and place in the leg.
    pub joint: (usize, usize),
    /// The forces (N), in the order of the contacts.
    pub forces: Vec<Vector3<f64>>,
}

/// The forces within linearized friction cones that hold `weight` (N) at `com` with the least
/// largest share of a torque limit (H12), for legs that stand on these contacts; `None` if no forces
/// hold the stance.
///
/// A joint without a torque limit above zero takes no part. The linear program's dual is solved,
/// which has far fewer balances: three a foot, of which the six of the rover are used up by its
/// free multipliers.
pub fn least_torque(
    legs: &[LegStatics],
    contacts: &[Contact],
    com: &Point3<f64>,
    weight: f64,
    cone: ConeModel,
) -> Result<Option<LeastTorque>, ContactError> {
    check(contacts, com, weight, cone)?;
    let wrenches = Wrenches::new(contacts, com);
    let n = contacts.len();
    let rows = 3 * n + 1;
    let mut columns: Vec<(Vec<f64>, [f64; 2])> = Vec::new();
    // Free multipliers of force and moment: minus the balance's transpose.
    for k in 0..6 {
        let mut column = vec![0.0; rows];
        for (j, cell) in column.iter_mut().enumerate().take(3 * n) {
            *cell = -wrenches.of_axis(j / 3, j % 3)[k];
        }
        columns.push((column, [if k == 2 { 1.0 } else { 0.0 }, 0.0]));
    }
    for (i, contact) in contacts.iter().enumerate() {
        let mut sides = cone.half_spaces(contact, &wrenches.center);
        if contact.friction == 0.0 {
            sides.push(contact.normal.into_inner());
        }
        for side in sides {
            let mut column = vec![0.0; rows];
            column[3 * i..3 * i + 3].copy_from_slice((-side).as_slice());
            columns.push((column, [0.0, 0.0]));
        }
    }
    for (i, leg) in legs.iter().enumerate().take(n) {
        for joint in 0..leg.own.len() {
            let limit = leg.limits[joint] / weight;
            if limit <= 0.0 {
                continue;
            }
            let own = leg.own[joint] / weight;
            for sign in [1.0, -1.0] {
                // In shares of the limit, so that all multipliers are of one size.
                let mut column = vec![0.0; rows];
                for k in 0..3 {
                    column[3 * i + k] = sign * leg.per_force[k][joint] / limit;
                }
                column[rows - 1] = 1.0;
                columns.push((column, [sign * own / limit, 0.0]));
            }
        }
    }
    let real = columns.len();
    for i in 0..rows {
        let mut unit = vec![0.0; rows];
        unit[i] = 1.0;
        columns.push((unit, [0.0, 0.0]));
    }
    let mut right_side = vec![0.0; rows];
    right_side[rows - 1] = 1.0;
    let mut program = Tableau::new(&right_side, &columns);
    program.keep_out_from(real);
    if !program.eliminate_free(6) {
        return Ok(None);
    }
    match program.find_feasible().and_then(|()| program.maximize([1.0, 0.0])) {
        Ok(()) => {}
        Err(Unsolved::Unbounded | Unsolved::Infeasible | Unsolved::TooManyPivots) => {
            return Ok(None);
        }
    }
    // The multipliers of the dual's balances are minus the forces.
    let multipliers: Vec<f64> = program.multipliers_from(real).collect();
    let forces: Vec<Vector3<f64>> =
        multipliers[..3 * n].chunks(3).map(|f| Vector3::from_column_slice(f) * -weight).collect();
    let worst = (0..legs.len().min(n))
        .map(|i| (i, legs[i].worst(&forces[i])))
        .max_by(|a, b| a.1.1.total_cmp(&b.1.1));
    Ok(worst.map(|(leg, (place, ratio))| LeastTorque { ratio, joint: (leg, place), forces }))
}
