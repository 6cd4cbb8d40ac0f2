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
//! in the stance's present shape, f = (c₀ + c₁ x + c₂ y + preload)₊. Where legs differ in stiffness
//! k, the loads are k times as much, and have the least Σ f²/k. [`crate::rule`] takes equal springs, as the
//! preload of steps and the simulated rover do; [`crate::report`] takes each leg's own.
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
    share(contacts_in_g, com_in_g, weight_n, &vec![[1.0, 0.0]; contacts_in_g.len()])
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
    let springs: Vec<[f64; 2]> = preload_n.iter().map(|load| [1.0, per_weight(*load)]).collect();
    share(contacts_in_g, com_in_g, weight_n, &springs)
}

/// A leg with its tire as a vertical spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegSpring {
    /// Load over deflection (N/m), above zero.
    pub stiffness_n_m: f64,
    /// How much deeper than where it just touches the foot was put down (m); negative for one that
    /// hangs above the ground.
    pub pressed_m: f64,
}

/// As [`spring_share`], for springs of different stiffness that were put down at different heights.
///
/// `None` also where there is not one finite spring of stiffness above zero for each contact.
pub fn compliant_share(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
    springs: &[LegSpring],
) -> Option<Vec<f64>> {
    let stiffest = springs.iter().map(|s| s.stiffness_n_m).fold(0.0, f64::max);
    let all_push = springs.iter().all(|s| s.stiffness_n_m > 0.0);
    if springs.len() != contacts_in_g.len() || !all_push {
        return None;
    }
    let relative =
        |s: &LegSpring| [s.stiffness_n_m / stiffest, s.stiffness_n_m * s.pressed_m / weight_n];
    share(contacts_in_g, com_in_g, weight_n, &springs.iter().map(relative).collect::<Vec<_>>())
}

/// The loads of a compliant rover, and how far they may be off.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadBand {
    /// With the springs as they are said to be (N).
    pub expected_n: Vec<f64>,
    /// The least that each foot carries (N).
    pub least_n: Vec<f64>,
    /// The most that each foot carries (N).
    pub most_n: Vec<f64>,
}

/// How well springs are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpringError {
    /// Stiffness is within this share of what it is said to be, 0 to below 1.
    pub stiffness: f64,
    /// Touch-down heights are within this (m).
    pub height_m: f64,
}

/// Most contacts for which a band is computed: all combinations of their errors are looked at.
const MAX_BAND_CONTACTS: usize = 8;

/// [`compliant_share`] with an error band over stiffness and touch-down height.
///
/// Looked at are all combinations of feet that are stiffer and put down deeper, and feet that are
/// softer and less deep: a foot carries more the stiffer and deeper it is itself. `None` also for
/// more than 8 contacts, or an error that is not a number from 0 (to below 1 for the stiffness).
pub fn load_band(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
    springs: &[LegSpring],
    error: &SpringError,
) -> Option<LoadBand> {
    let known = (0.0..1.0).contains(&error.stiffness) && (0.0..1e3).contains(&error.height_m);
    if !known || springs.len() > MAX_BAND_CONTACTS {
        return None;
    }
    let expected_n = compliant_share(contacts_in_g, com_in_g, weight_n, springs)?;
    let (mut least_n, mut most_n) = (expected_n.clone(), expected_n.clone());
    for firm in 0_u32..1 << springs.len() {
        let off: Vec<LegSpring> = springs
            .iter()
            .enumerate()
            .map(|(i, spring)| {
                let sign = if firm >> i & 1 == 1 { 1.0 } else { -1.0 };
                LegSpring {
                    stiffness_n_m: spring.stiffness_n_m * (1.0 + sign * error.stiffness),
                    pressed_m: spring.pressed_m + sign * error.height_m,
                }
            })
            .collect();
        let loads = compliant_share(contacts_in_g, com_in_g, weight_n, &off)?;
        for (i, load) in loads.iter().enumerate() {
            least_n[i] = least_n[i].min(*load);
            most_n[i] = most_n[i].max(*load);
        }
    }
    Some(LoadBand { expected_n, least_n, most_n })
}

/// `springs` are relative stiffness, and preload as a share of the weight.
fn share(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
    springs: &[[f64; 2]],
) -> Option<Vec<f64>> {
    let support = regular(contacts_in_g).ok()?;
    let known = weight_n.is_finite()
        && com_in_g.coords.iter().all(|v| v.is_finite())
        && springs.iter().flatten().all(|v| v.is_finite());
    if !known || support.depth_of(com_in_g.xy()) < -BORDER_SLACK {
        return None;
    }
    // With the center of mass as origin, the farthest foot at 1 and the weight 1, the loads are
    // the positive parts of k c · (1, x, y) + preload for the c that minimizes the convex, piecewise
    // quadratic D(c) = Σ (k c · p + preload)₊² / 2k - c₀: its gradient is the unbalance.
    let offset = |p: &Point3<f64>| p.xy() - com_in_g.xy();
    let radius = contacts_in_g.iter().map(|p| offset(p).norm()).fold(0.0, f64::max);
    let foot = |(p, [stiffness, preload]): (&Point3<f64>, &[f64; 2])| Spring {
        place: (offset(p) / radius).insert_row(0, 1.0),
        stiffness: *stiffness,
        preload: *preload,
    };
    let feet: Vec<Spring> = contacts_in_g.iter().zip(springs).map(foot).collect();
    // All feet carry at the start.
    let even = 1.0 / feet.len() as f64;
    let sink = feet.iter().map(|f| (even - f.preload) / f.stiffness).fold(f64::MIN, f64::max);
    let mut c = Vector3::new(sink, 0.0, 0.0);
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
    stiffness: f64,
    preload: f64,
}

impl Spring {
    /// How far it is pressed in, times its stiffness; negative where it would pull.
    fn pressed(&self, c: &Vector3<f64>) -> f64 {
        self.stiffness * c.dot(&self.place) + self.preload
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
    let stiffness: Matrix3<f64> =
        carrying.map(|foot| foot.place * foot.place.transpose() * foot.stiffness).sum();
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
    let kink = |foot: &Spring| -foot.pressed(c) / (foot.stiffness * step.dot(&foot.place));
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
