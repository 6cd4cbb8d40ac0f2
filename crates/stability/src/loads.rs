//! How the feet share the weight: legs taken as equal vertical springs that push only.
//!
//! With more than three feet, statics alone does not fix the loads. Here every leg is the same
//! vertical spring, all without load at the stance's present shape, and the rover is rigid: it
//! sinks and tilts a little, so the loads are linear over the ground, f = c₀ + c₁ x + c₂ y, and
//! zero for a foot that this would pull. Of all loads that balance, these have the least Σ f².
//! Source: planning notes, load share with compliance; oracle: a regular hexagon with one leg
//! lifted carries (5, 3, 2, 3, 5)/18 of the weight.
//!
//! Everything is in the gravity frame `g` (z up), in meters and newtons.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::support_polygon::regular;

/// How far outside the support polygon (m) the center of mass may lie by rounding alone.
const BORDER_SLACK: f64 = 1e-9;

/// Residual of the balance, relative to the weight (and the stance's radius), that is accepted.
const BALANCED: f64 = 1e-13;

/// More rounds than any stance needs; each settles which feet carry.
const MAX_ROUNDS: usize = 100;

/// Vertical force on each contact (N, upward, none negative): their sum is `weight_n` (N), and
/// their moments about the center of mass vanish.
///
/// `None` if the center of mass is outside the contacts' support polygon, or there is none: such
/// a rover falls, whatever the loads.
pub fn spring_share(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
) -> Option<Vec<f64>> {
    let support = regular(contacts_in_g).ok()?;
    let known = weight_n.is_finite() && com_in_g.coords.iter().all(|v| v.is_finite());
    if !known || support.depth_of(com_in_g.xy()) < -BORDER_SLACK {
        return None;
    }
    // With the center of mass as origin, the farthest foot at 1 and the weight 1, the loads are
    // the positive parts of c · (1, x, y) for the c that minimizes the convex, piecewise quadratic
    // D(c) = Σ (c · p)₊² / 2 - c₀: its gradient is the unbalance.
    let offset = |p: &Point3<f64>| p.xy() - com_in_g.xy();
    let radius = contacts_in_g.iter().map(|p| offset(p).norm()).fold(0.0, f64::max);
    let feet: Vec<Vector3<f64>> =
        contacts_in_g.iter().map(|p| (offset(p) / radius).insert_row(0, 1.0)).collect();
    let mut c = Vector3::new(1.0 / feet.len() as f64, 0.0, 0.0);
    for _ in 0..MAX_ROUNDS {
        let unbalance =
            feet.iter().map(|p| p * c.dot(p).max(0.0)).sum::<Vector3<f64>>() - Vector3::x();
        if unbalance.amax() < BALANCED {
            break;
        }
        let Some(step) = newton_step(&feet, &c, &unbalance) else { break };
        let length = exact_line_search(&feet, &c, &step);
        if length <= 0.0 {
            break;
        }
        c += step * length;
    }
    Some(feet.iter().map(|p| c.dot(p).max(0.0) * weight_n).collect())
}

/// Newton's step towards the minimum of D, lightly damped where the feet that carry now do not
/// fix a plane.
fn newton_step(
    feet: &[Vector3<f64>],
    c: &Vector3<f64>,
    unbalance: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    let carrying = feet.iter().filter(|p| c.dot(p) > 0.0);
    let stiffness: Matrix3<f64> = carrying.map(|p| p * p.transpose()).sum();
    let damped = stiffness + Matrix3::identity() * 1e-12;
    Some(-damped.cholesky()?.solve(unbalance))
}

/// The length along `step` at which D is least: its slope there is piecewise linear and rising.
/// Zero if rounding leaves nothing to gain.
fn exact_line_search(feet: &[Vector3<f64>], c: &Vector3<f64>, step: &Vector3<f64>) -> f64 {
    let slope = |t: f64| {
        feet.iter().map(|p| (c + step * t).dot(p).max(0.0) * step.dot(p)).sum::<f64>() - step.x
    };
    let kink = |p: &Vector3<f64>| -c.dot(p) / step.dot(p);
    let mut kinks: Vec<f64> = feet.iter().map(kink).filter(|t| t.is_finite() && *t > 0.0).collect();
    kinks.sort_by(f64::total_cmp);
    let (mut from, mut slope_from) = (0.0, slope(0.0));
    if slope_from >= 0.0 {
        return 0.0;
    }
    // Between two kinks, and beyond the last, the slope is linear; it is negative at `from`.
    for to in kinks {
        let slope_to = slope(to);
        if slope_to >= 0.0 {
            return from + (to - from) * (slope_from / (slope_from - slope_to));
        }
        (from, slope_from) = (to, slope_to);
    }
    let rise = slope(from + 1.0) - slope_from;
    if rise > 0.0 { from - slope_from / rise } else { from }
}
