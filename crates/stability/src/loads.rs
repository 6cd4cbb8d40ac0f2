//! How the feet share the weight: legs taken as equal vertical springs that push only.
//!
//! With more than three feet, statics alone does not fix the loads. Here every leg is the same
//! vertical spring, all without load at the stance's present shape, and the rover is rigid: it
//! sinks and tilts a little, so the loads are linear over the ground, f = c₀ + c₁ x + c₂ y, and
//! zero for a foot that this would pull. Of all loads that balance, these have the least Σ f².
//! Source: planning notes, load share with compliance; oracle: a regular hexagon with one leg
//! lifted carries (5, 3, 2, 3, 5)/18 of the weight.
//!
//! A foot that was pressed down further than the others carries more: its spring has a *preload*
//! in the stance's present shape, f = (c₀ + c₁ x + c₂ y + preload)₊.
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
    share(contacts_in_g, com_in_g, weight_n, &vec![0.0; contacts_in_g.len()])
}

/// As [`spring_share`], with the load (N) that each spring would have in the stance's present shape
/// if the rover neither sank nor tilted: stiffness times how much deeper the foot was pressed than
/// where it just touches, negative for one that hangs above the ground.
///
/// What all feet have in common, or what a tilt of the rover levels, changes nothing. `None` also
/// where there is not one finite preload for each contact.
pub fn spring_share_with_preload(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
    preload_n: &[f64],
) -> Option<Vec<f64>> {
    if preload_n.len() != contacts_in_g.len() {
        return None;
    }
    let per_weight = |load: f64| if load == 0.0 { 0.0 } else { load / weight_n };
    let preload: Vec<f64> = preload_n.iter().map(|load| per_weight(*load)).collect();
    if preload.iter().any(|load| !load.is_finite()) {
        return None;
    }
    share(contacts_in_g, com_in_g, weight_n, &preload)
}

/// `preload` as shares of the weight.
fn share(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
    preload: &[f64],
) -> Option<Vec<f64>> {
    let support = regular(contacts_in_g).ok()?;
    let known = weight_n.is_finite() && com_in_g.coords.iter().all(|v| v.is_finite());
    if !known || support.depth_of(com_in_g.xy()) < -BORDER_SLACK {
        return None;
    }
    // With the center of mass as origin, the farthest foot at 1 and the weight 1, the loads are
    // the positive parts of c · (1, x, y) + preload for the c that minimizes the convex, piecewise
    // quadratic D(c) = Σ (c · p + preload)₊² / 2 - c₀: its gradient is the unbalance.
    let offset = |p: &Point3<f64>| p.xy() - com_in_g.xy();
    let radius = contacts_in_g.iter().map(|p| offset(p).norm()).fold(0.0, f64::max);
    let foot = |(p, preload): (&Point3<f64>, &f64)| Spring {
        place: (offset(p) / radius).insert_row(0, 1.0),
        preload: *preload,
    };
    let feet: Vec<Spring> = contacts_in_g.iter().zip(preload).map(foot).collect();
    // All feet carry at the start.
    let least = preload.iter().copied().fold(f64::INFINITY, f64::min);
    let mut c = Vector3::new(1.0 / feet.len() as f64 - least, 0.0, 0.0);
    for _ in 0..MAX_ROUNDS {
        let unbalance =
            feet.iter().map(|foot| foot.place * foot.load(&c)).sum::<Vector3<f64>>() - Vector3::x();
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
    Some(feet.iter().map(|foot| foot.load(&c) * weight_n).collect())
}

/// A leg as a vertical spring.
struct Spring {
    /// Where it stands: (1, x, y).
    place: Vector3<f64>,
    preload: f64,
}

impl Spring {
    /// How far it is pressed in, times its stiffness; negative where it would pull.
    fn pressed(&self, c: &Vector3<f64>) -> f64 {
        c.dot(&self.place) + self.preload
    }

    fn load(&self, c: &Vector3<f64>) -> f64 {
        self.pressed(c).max(0.0)
    }
}

/// Newton's step towards the minimum of D, lightly damped where the feet that carry now do not
/// fix a plane.
fn newton_step(
    feet: &[Spring],
    c: &Vector3<f64>,
    unbalance: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    let carrying = feet.iter().filter(|foot| foot.pressed(c) > 0.0);
    let stiffness: Matrix3<f64> = carrying.map(|foot| foot.place * foot.place.transpose()).sum();
    let damped = stiffness + Matrix3::identity() * 1e-12;
    Some(-damped.cholesky()?.solve(unbalance))
}

/// The length along `step` at which D is least: its slope there is piecewise linear and rising.
/// Zero if rounding leaves nothing to gain.
fn exact_line_search(feet: &[Spring], c: &Vector3<f64>, step: &Vector3<f64>) -> f64 {
    let slope = |t: f64| {
        let along = c + step * t;
        feet.iter().map(|foot| foot.load(&along) * step.dot(&foot.place)).sum::<f64>() - step.x
    };
    let kink = |foot: &Spring| -foot.pressed(c) / step.dot(&foot.place);
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
