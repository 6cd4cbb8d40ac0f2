//! What the feet that stay are asked to have to spare.

use nalgebra::{Point2, Point3};
use rover::StanceRules;
use stability::{Preference, StanceGuard, support_polygon};

/// One or two margin rules over the same contacts, each with what it must have beyond itself (m).
pub(crate) struct Wanted {
    parts: Vec<(StanceGuard, f64)>,
    best: Option<(Point2<f64>, f64)>,
}

impl Wanted {
    /// The margin rule alone; `None` where the contacts enclose no polygon.
    pub fn rule(
        contacts: &[Point3<f64>],
        rules: &StanceRules,
        preference: Preference,
    ) -> Option<Wanted> {
        let part = (StanceGuard::new(contacts, rules, preference)?, 0.0);
        let best = match preference {
            // Friction needs normals, which are not known here: callers refuse it.
            Preference::Regular | Preference::Friction => best_regular(contacts, rules.margin),
            Preference::Conservative => {
                best_conservative(contacts, 0.0).or_else(|| best_regular(contacts, rules.margin))
            }
        };
        Some(Wanted { parts: vec![part], best })
    }

    /// The margin rule with a regular margin of `regular` (m), or m1 if that is more, and a conservative
    /// one of `conservative` (m) if asked for.
    pub fn margins(
        contacts: &[Point3<f64>],
        rules: &StanceRules,
        regular: f64,
        conservative: Option<f64>,
    ) -> Option<Wanted> {
        let margin = regular.max(rules.margin);
        let of = |margin, settlement, preference| {
            let rules = StanceRules { margin, settlement, ..*rules };
            StanceGuard::new(contacts, &rules, preference)
        };
        let mut parts = vec![(of(margin, rules.settlement, Preference::Regular)?, 0.0)];
        let mut best = best_regular(contacts, margin);
        if let Some(wanted) = conservative {
            parts.push((of(0.0, 0.0, Preference::Conservative)?, wanted));
            let survives = best_conservative(contacts, wanted);
            // The nearer of the two goals decides; without a region nothing can be had.
            best = match (best, survives) {
                (Some(a), Some(b)) => Some(if b.1 <= a.1 { b } else { a }),
                (a, None) => a.map(|(p, _)| (p, f64::NEG_INFINITY)),
                (None, b) => b,
            };
        }
        Some(Wanted { parts, best })
    }

    /// What there is to spare (m) with the center of mass at `com`; see [`StanceGuard::spare`].
    pub fn spare(&self, com: &Point3<f64>) -> f64 {
        let spare = |(guard, more): &(StanceGuard, f64)| guard.spare(com) - more;
        self.parts.iter().map(spare).fold(f64::INFINITY, f64::min)
    }

    /// Where the center of mass would best be, and a bound on what there is to spare anywhere (m).
    pub fn best(&self) -> Option<(Point2<f64>, f64)> {
        self.best
    }
}

fn best_regular(contacts: &[Point3<f64>], margin: f64) -> Option<(Point2<f64>, f64)> {
    let (point, depth) = support_polygon::regular(contacts).ok()?.deepest_point();
    Some((point, depth - margin.max(0.0)))
}

fn best_conservative(contacts: &[Point3<f64>], wanted: f64) -> Option<(Point2<f64>, f64)> {
    let region = support_polygon::conservative(contacts).ok()?;
    let (point, depth) = region.area()?.deepest_point();
    Some((point, depth - wanted))
}
