//! The loads of springs that push only, over feet that stay, for one center of mass after the other.

use geometry::ConvexPolygon;
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

use crate::support_polygon::regular;

/// How far outside the support polygon (m) the center of mass may lie by rounding alone.
const BORDER_SLACK: f64 = 1e-9;

/// Residual of the balance, relative to the weight (and the stance's radius), that is accepted.
const BALANCED: f64 = 1e-13;

/// More rounds than any stance needs; each settles which feet carry.
const MAX_ROUNDS: usize = 100;

/// Where feet stand, seen along gravity: from their middle, the farthest at 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Footprint {
    support: ConvexPolygon,
    origin: Point2<f64>,
    radius: f64,
    /// (1, x, y) of each foot.
    places: Vec<Vector3<f64>>,
}

impl Footprint {
    /// `None` if these contacts (m) enclose no support polygon.
    pub fn new(contacts: &[Point3<f64>]) -> Option<Footprint> {
        let support = regular(contacts).ok()?;
        let sum: Vector2<f64> = contacts.iter().map(|p| p.xy().coords).sum();
        let origin = Point2::from(sum / contacts.len() as f64);
        let offset = |p: &Point3<f64>| p.xy() - origin;
        let radius = contacts.iter().map(|p| offset(p).norm()).fold(0.0, f64::max);
        let place = |p: &Point3<f64>| (offset(p) / radius).insert_row(0, 1.0);
        Some(Footprint { places: contacts.iter().map(place).collect(), support, origin, radius })
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// (1, x, y) of a center of mass (m) that the feet can hold; `None` outside of the support polygon.
    pub fn center(&self, com: &Point3<f64>) -> Option<Vector3<f64>> {
        let known = com.coords.iter().all(|v| v.is_finite());
        let held = known && self.support.depth_of(com.xy()) >= -BORDER_SLACK;
        held.then(|| ((com.xy() - self.origin) / self.radius).insert_row(0, 1.0))
    }

    /// The centers of mass over the feet at which none of these functions of (1, x, y) is negative.
    pub fn where_positive(
        &self,
        functions: impl IntoIterator<Item = Vector3<f64>>,
    ) -> Option<ConvexPolygon> {
        let inside = |p: &Point2<f64>| (p - self.origin) / self.radius;
        let mut ring: Vec<Vector2<f64>> = self.support.vertices().iter().map(inside).collect();
        let mut kept = Vec::with_capacity(2 * ring.len());
        for function in functions {
            let value = |p: &Vector2<f64>| function.x + function.y * p.x + function.z * p.y;
            if ring.iter().all(|p| value(p) >= 0.0) {
                continue;
            }
            for (i, p) in ring.iter().enumerate() {
                let q = &ring[(i + 1) % ring.len()];
                let (at_p, at_q) = (value(p), value(q));
                if at_p >= 0.0 {
                    kept.push(*p);
                }
                if at_p * at_q < 0.0 {
                    kept.push(p + (q - p) * (at_p / (at_p - at_q)));
                }
            }
            std::mem::swap(&mut ring, &mut kept);
            kept.clear();
        }
        ConvexPolygon::hull(ring.iter().map(|p| self.origin + p * self.radius).collect())
    }
}

/// A leg as a vertical spring: its relative stiffness, and its load in the stance's present shape as a
/// share of the weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spring {
    pub stiffness: f64,
    pub preload: f64,
}

impl Spring {
    /// How far it is pressed in, times its stiffness; negative where it would pull.
    fn pressed(&self, place: &Vector3<f64>, c: &Vector3<f64>) -> f64 {
        self.stiffness * c.dot(place) + self.preload
    }
}

/// The springs under all feet of a footprint.
///
/// With the weight 1, the loads are the positive parts of k c · (1, x, y) + preload for the c that
/// minimizes the convex, piecewise quadratic D(c) = Σ (k c · p + preload)₊² / 2k - c · (1, x, y of the
/// center of mass): its gradient is the unbalance.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Springs {
    springs: Vec<Spring>,
    /// c = `give` (center - `bears`) where all feet carry; none where that is not to be had.
    give: Option<Matrix3<f64>>,
    bears: Vector3<f64>,
}

impl Springs {
    /// `None` where a spring is not finite, or not stiffer than zero.
    pub fn new(footprint: &Footprint, springs: Vec<Spring>) -> Option<Springs> {
        let known = |s: &Spring| s.stiffness > 0.0 && (s.stiffness + s.preload.abs()).is_finite();
        if springs.len() != footprint.len() || !springs.iter().all(known) {
            return None;
        }
        let feet = || footprint.places.iter().zip(&springs);
        let stiffness: Matrix3<f64> =
            feet().map(|(place, s)| place * place.transpose() * s.stiffness).sum();
        let bears = feet().map(|(place, s)| place * s.preload).sum();
        let give = stiffness.try_inverse().filter(|m| m.iter().all(|v| v.is_finite()));
        Some(Springs { give, bears, springs })
    }

    /// The loads, as shares of the weight, with the center of mass at (1, x, y); `loads` is overwritten.
    pub fn share(&self, footprint: &Footprint, center: &Vector3<f64>, loads: &mut Vec<f64>) {
        let feet = || footprint.places.iter().zip(&self.springs);
        let mut c = match self.give {
            Some(give) => give * (center - self.bears),
            // All feet carry at the start.
            None => {
                let even = 1.0 / self.springs.len() as f64;
                let sinks = self.springs.iter().map(|s| (even - s.preload) / s.stiffness);
                Vector3::new(sinks.fold(f64::MIN, f64::max), 0.0, 0.0)
            }
        };
        for _ in 0..MAX_ROUNDS {
            let borne: Vector3<f64> =
                feet().map(|(place, s)| place * s.pressed(place, &c).max(0.0)).sum();
            let unbalance = borne - center;
            if unbalance.amax() < BALANCED {
                break;
            }
            let Some(step) = self.newton_step(footprint, &c, &unbalance) else { break };
            let length = self.exact_line_search(footprint, center, &c, &step, loads);
            if length <= 0.0 {
                break;
            }
            c += step * length;
        }
        loads.clear();
        loads.extend(feet().map(|(place, s)| s.pressed(place, &c).max(0.0)));
    }

    /// The load of each foot, as a share of the weight, as a function of (1, x, y) of the center of mass:
    /// it holds where none of them is negative. Empty where there are none.
    pub fn linear(&self, footprint: &Footprint) -> Vec<Vector3<f64>> {
        let Some(give) = self.give else { return Vec::new() };
        let feet = footprint.places.iter().zip(&self.springs);
        feet.map(|(place, s)| {
            let way = give * place * s.stiffness;
            way + Vector3::x() * (s.preload - way.dot(&self.bears))
        })
        .collect()
    }

    /// How the load of foot `of` grows where each foot is put down deeper, all else as it is and all
    /// carrying: its sign tells which feet, put down deeper, make it bear more.
    pub fn influence(&self, footprint: &Footprint, of: usize) -> Vec<f64> {
        let Some(give) = self.give else { return vec![0.0; footprint.len()] };
        let way = give * footprint.places[of] * self.springs[of].stiffness;
        let on = |(i, place): (usize, &Vector3<f64>)| f64::from(u8::from(i == of)) - way.dot(place);
        footprint.places.iter().enumerate().map(on).collect()
    }

    /// Newton's step towards the minimum of D, lightly damped where the feet that carry now do not
    /// fix a plane.
    fn newton_step(
        &self,
        footprint: &Footprint,
        c: &Vector3<f64>,
        unbalance: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let feet = footprint.places.iter().zip(&self.springs);
        let carrying = feet.filter(|(place, s)| s.pressed(place, c) > 0.0);
        let stiffness: Matrix3<f64> =
            carrying.map(|(place, s)| place * place.transpose() * s.stiffness).sum();
        let damped = stiffness + Matrix3::identity() * 1e-12;
        Some(-damped.cholesky()?.solve(unbalance))
    }

    /// The length along `step` at which D is least: its slope there is piecewise linear and rising.
    /// Zero if rounding leaves nothing to gain. `kinks` is overwritten.
    fn exact_line_search(
        &self,
        footprint: &Footprint,
        center: &Vector3<f64>,
        c: &Vector3<f64>,
        step: &Vector3<f64>,
        kinks: &mut Vec<f64>,
    ) -> f64 {
        let feet = || footprint.places.iter().zip(&self.springs);
        let slope = |t: f64| {
            let along = c + step * t;
            let borne = |(place, s): (&Vector3<f64>, &Spring)| {
                s.pressed(place, &along).max(0.0) * step.dot(place)
            };
            feet().map(borne).sum::<f64>() - step.dot(center)
        };
        let kink = |(place, s): (&Vector3<f64>, &Spring)| {
            -s.pressed(place, c) / (s.stiffness * step.dot(place))
        };
        kinks.clear();
        kinks.extend(feet().map(kink).filter(|t| t.is_finite() && *t > 0.0));
        kinks.sort_unstable_by(f64::total_cmp);
        let (mut from, mut slope_from) = (0.0, slope(0.0));
        if slope_from >= 0.0 {
            return 0.0;
        }
        // Between two kinks, and beyond the last, the slope is linear; it is negative at `from`.
        for to in kinks.iter().copied() {
            let slope_to = slope(to);
            if slope_to >= 0.0 {
                return from + (to - from) * (slope_from / (slope_from - slope_to));
            }
            (from, slope_from) = (to, slope_to);
        }
        let rise = slope(from + 1.0) - slope_from;
        if rise > 0.0 { from - slope_from / rise } else { from }
    }
}
