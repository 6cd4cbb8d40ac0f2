//! What the feet that stay are asked to have to spare.

use nalgebra::{Point2, Point3};
use rover::StanceRules;
use stability::{
    ConeModel, Contact, ForceRegion, Preference, StanceGuard, force_region, support_polygon,
};

use crate::adviser::Wish;

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

    /// The margin rule with the margins that are wished for, the regular one and that of friction at
    /// least m1.
    pub fn margins(contacts: &[Contact], rules: &StanceRules, wish: &Wish) -> Option<Wanted> {
        let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
        let margin = wish.regular.max(rules.margin);
        let of = |margin, settlement, preference| {
            let rules = StanceRules { margin, settlement, ..*rules };
            StanceGuard::new(&points, &rules, preference)
        };
        let mut parts = vec![(of(margin, rules.settlement, Preference::Regular)?, 0.0)];
        let mut best = best_regular(&points, margin);
        if let Some(wanted) = wish.conservative {
            parts.push((of(0.0, 0.0, Preference::Conservative)?, wanted));
            best = lesser(best, best_conservative(&points, wanted));
        }
        if let Some(wanted) = wish.friction {
            let (wanted, found) = (wanted.max(rules.margin), friction_region(contacts)?);
            let guard = of(0.0, 0.0, Preference::Regular)?.within(&found.region, wanted);
            parts.push((guard, 0.0));
            best = lesser(best, best_on_friction(contacts, wanted));
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

fn friction_region(contacts: &[Contact]) -> Option<ForceRegion> {
    let cones = force_region::cones(contacts, ConeModel::default()).ok()?;
    force_region::region(&cones, 1.0).ok()
}

fn best_on_friction(contacts: &[Contact], wanted: f64) -> Best {
    let found = friction_region(contacts)?;
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
