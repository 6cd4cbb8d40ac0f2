//! What the feet that stay are asked to have to spare.

use nalgebra::{Point2, Point3};
use rover::StanceRules;
use stability::{ConeModel, Contact, Preference, StanceGuard, force_region, support_polygon};

/// One or two margin rules over the same contacts, each with what it must have beyond itself (m).
pub(crate) struct Wanted {
    parts: Vec<(StanceGuard, f64)>,
    best: Best,
}

impl Wanted {
    /// The margin rule alone; `None` where the contacts enclose no polygon.
    pub fn rule(
        contacts: &[Contact],
        rules: &StanceRules,
        preference: Preference,
    ) -> Option<Wanted> {
        let part = (StanceGuard::over(contacts, rules, preference)?, 0.0);
        let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
        let best = best_regular(&points, rules.margin);
        let best = match preference {
            Preference::Regular => best,
            Preference::Friction => lesser(best, best_on_friction(contacts, rules.margin)),
            Preference::Conservative => best_conservative(&points, 0.0).or(best),
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
            best = lesser(best, best_conservative(contacts, wanted));
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

type Best = Option<(Point2<f64>, f64)>;

/// The nearer of two goals decides; without a region for the second nothing can be had.
fn lesser(first: Best, second: Best) -> Best {
    match (first, second) {
        (Some(a), Some(b)) => Some(if b.1 <= a.1 { b } else { a }),
        (a, None) => a.map(|(p, _)| (p, f64::NEG_INFINITY)),
        (None, b) => b,
    }
}

fn best_on_friction(contacts: &[Contact], wanted: f64) -> Best {
    let cones = force_region::cones(contacts, ConeModel::default()).ok()?;
    let found = force_region::region(&cones, 1.0).ok()?;
    let (point, depth) = found.region.area()?.deepest_point();
    Some((point, depth - wanted.max(0.0)))
}

fn best_regular(contacts: &[Point3<f64>], margin: f64) -> Best {
    let (point, depth) = support_polygon::regular(contacts).ok()?.deepest_point();
    Some((point, depth - margin.max(0.0)))
}

fn best_conservative(contacts: &[Point3<f64>], wanted: f64) -> Best {
    let region = support_polygon::conservative(contacts).ok()?;
    let (point, depth) = region.area()?.deepest_point();
    Some((point, depth - wanted))
}
