//! Linear programs of another author's solver: what the crate's own are compared with.

use std::f64::consts::TAU;

use microlp::{ComparisonOp, Error, OptimizationDirection, Problem, Variable};
use nalgebra::{Point3, Rotation3, Vector3};
use stability::Contact;
use stability::contact_forces::LegStatics;
use stability::force_region::FORCE_CAP;

/// Edges of a cone, written down once more: towards the middle of the stance first.
pub fn edges(contact: &Contact, all: &[Contact], n: usize) -> Vec<Vector3<f64>> {
    let middle = all.iter().map(|c| c.position.coords).sum::<Vector3<f64>>() / all.len() as f64;
    let normal = contact.normal.into_inner();
    let towards = middle - contact.position.coords;
    let first = (towards - normal * towards.dot(&normal)).normalize();
    (0..n)
        .map(|i| {
            let turn = Rotation3::from_axis_angle(&contact.normal, TAU * i as f64 / n as f64);
            (normal + turn * first * contact.friction).normalize()
        })
        .collect()
}

/// Farthest center of mass (m) in direction (a, b) that forces within the cones hold; `None` if
/// there is none.
pub fn support(contacts: &[Contact], n_edges: usize, a: f64, b: f64) -> Option<f64> {
    let mut problem = Problem::new(OptimizationDirection::Maximize);
    let free = (f64::NEG_INFINITY, f64::INFINITY);
    let (x, y) = (problem.add_var(a, free), problem.add_var(b, free));
    let mut rows: [Vec<(Variable, f64)>; 7] = Default::default();
    for contact in contacts {
        for f in edges(contact, contacts, n_edges) {
            let share = problem.add_var(0.0, (0.0, f64::INFINITY));
            let moment = contact.position.coords.cross(&f);
            let parts = [f.x, f.y, f.z, moment.z, moment.x, moment.y, 1.0];
            rows.iter_mut().zip(parts).for_each(|(row, part)| row.push((share, part)));
        }
    }
    // The weight 1 at (x, y) has the moment (-y, x, 0).
    rows[4].push((y, -1.0));
    rows[5].push((x, 1.0));
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.add_constraint(&rows[6], ComparisonOp::Le, FORCE_CAP);
    match problem.solve() {
        Ok(outcome) => Some(outcome.into_solution().expect("no limit is set").objective()),
        Err(Error::Infeasible) => None,
        Err(other) => panic!("{other:?}"),
    }
}

/// The least largest share of a torque limit, by a linear program in forces.
pub fn least_ratio(legs: &[LegStatics], ground: &[Contact], com: &Point3<f64>, weight: f64) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let t = problem.add_var(1.0, (0.0, f64::INFINITY));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    for (leg, contact) in legs.iter().zip(ground) {
        let shares: Vec<(Variable, Vector3<f64>)> = edges(contact, ground, 8)
            .into_iter()
            .map(|f| (problem.add_var(0.0, (0.0, f64::INFINITY)), f))
            .collect();
        for (share, f) in &shares {
            let moment = (contact.position - com).cross(f);
            let wrench = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(wrench).for_each(|(row, part)| row.push((*share, part)));
        }
        for joint in 0..leg.own.len() {
            let limit = leg.limits[joint];
            for sign in [1.0, -1.0] {
                let mut row: Vec<(Variable, f64)> = vec![(t, -1.0)];
                for (share, f) in &shares {
                    let torque = leg.torques(&(f * weight))[joint] - leg.own[joint];
                    row.push((*share, sign * torque / limit));
                }
                let own = sign * leg.own[joint] / limit;
                problem.add_constraint(&row, ComparisonOp::Le, -own);
            }
        }
    }
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.solve().expect("it is feasible").into_solution().expect("no limit is set").objective()
}

/// Farthest center of mass (m) in direction (a, b) that friction and joint torques hold; `None` if
/// joints must be overloaded. Overload is allowed at a price that nobody pays who need not, so that
/// the solver need not prove that there is nothing.
pub fn torque_support(
    legs: &[LegStatics],
    ground: &[Contact],
    weight: f64,
    a: f64,
    b: f64,
) -> Option<f64> {
    let mut problem = Problem::new(OptimizationDirection::Maximize);
    let free = (f64::NEG_INFINITY, f64::INFINITY);
    let (x, y) = (problem.add_var(a, free), problem.add_var(b, free));
    let overload = problem.add_var(-1000.0, (0.0, f64::INFINITY));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    for (leg, contact) in legs.iter().zip(ground) {
        let shares: Vec<(Variable, Vector3<f64>)> = edges(contact, ground, 8)
            .into_iter()
            .map(|f| (problem.add_var(0.0, (0.0, f64::INFINITY)), f))
            .collect();
        for (share, f) in &shares {
            let moment = contact.position.coords.cross(f);
            let wrench = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            let sized = |part: &f64| part.abs() > 1e-9;
            let parts = rows.iter_mut().zip(wrench).filter(|(_, part)| sized(part));
            parts.for_each(|(row, part)| row.push((*share, part)));
        }
        for joint in 0..leg.own.len() {
            let limit = leg.limits[joint];
            let row: Vec<(Variable, f64)> = shares
                .iter()
                .map(|(share, f)| (*share, (leg.torques(&(f * weight)) - leg.own)[joint] / limit))
                .collect();
            let own = leg.own[joint] / limit;
            // The solver asks for numbers of one size: levers of rounding only are none.
            let mut row: Vec<_> = row.into_iter().filter(|(_, part)| part.abs() > 1e-9).collect();
            row.push((overload, -1.0));
            problem.add_constraint(&row, ComparisonOp::Le, 1.0 - own);
            row.last_mut().expect("it was just put there").1 = 1.0;
            problem.add_constraint(&row, ComparisonOp::Ge, -1.0 - own);
        }
    }
    rows[3].push((y, -1.0));
    rows[4].push((x, 1.0));
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    let solution = problem.solve().expect("it is feasible").into_solution();
    let solution = solution.expect("no limit is set");
    (solution.var_value(overload) < 1e-7).then(|| solution.objective())
}

/// Forces of least largest share of a cone's edge, in weights, from a linear program.
pub fn spread_forces(contacts: &[Contact], com: &Point3<f64>) -> Vec<Vector3<f64>> {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let most = problem.add_var(1.0, (0.0, f64::INFINITY));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    let mut parts = Vec::new();
    for (i, contact) in contacts.iter().enumerate() {
        for f in edges(contact, contacts, 8) {
            let share = problem.add_var(0.0, (0.0, f64::INFINITY));
            let moment = (contact.position - com).cross(&f);
            let wrench = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(wrench).for_each(|(row, part)| row.push((share, part)));
            problem.add_constraint([(share, 1.0), (most, -1.0)], ComparisonOp::Le, 0.0);
            parts.push((i, share, f));
        }
    }
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    let solution =
        problem.solve().expect("it is feasible").into_solution().expect("no limit is set");
    let mut forces = vec![Vector3::zeros(); contacts.len()];
    parts.iter().for_each(|(i, share, f)| forces[*i] += f * solution.var_value(*share));
    forces
}
