//! How one observation changes one cell.

use super::{Cell, Flags, MapSettings, PairCell, Rival};

/// Where an observation comes from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stamp {
    pub time_ns: i64,
    pub source: u32,
    /// True for an imported map.
    pub is_prior: bool,
    /// Which viewpoint, as one bit.
    pub view: u32,
}

/// A height with its variance at its own time.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    height: f64,
    variance: f64,
    /// Part of it that is one error for all that a view tells, now and again.
    common: f64,
    /// Part of that which is noise that a view repeats.
    repeated: f64,
    views: u32,
    count: u16,
    time_ns: i64,
    source: u32,
}

impl Estimate {
    /// Variance at a later time (m²); its own at an earlier one.
    fn variance_at(&self, time_ns: i64, growth: f64) -> f64 {
        let age_s = time_ns.saturating_sub(self.time_ns).max(0) as f64 * 1e-9;
        self.variance + growth * age_s
    }

    /// Both at the time of the newer: variances there, and whether they agree.
    fn compare(&self, other: &Estimate, settings: &MapSettings) -> (f64, f64, bool) {
        let time = self.time_ns.max(other.time_ns);
        let a = self.variance_at(time, settings.growth_m2_s);
        let b = other.variance_at(time, settings.growth_m2_s);
        let gate = settings.gate_sigmas * settings.gate_sigmas * (a + b);
        (a, b, (self.height - other.height).powi(2) <= gate)
    }

    /// The two as one: the best linear estimate of both. Their common errors count as independent where
    /// no view is in both, else as one and the same: a view that looks again wins nothing against what it
    /// gets wrong each time.
    fn with(&self, other: &Estimate, settings: &MapSettings) -> Estimate {
        let (a, b, _) = self.compare(other, settings);
        let newer = if other.time_ns >= self.time_ns { other } else { self };
        let (a_own, b_own) = (a - self.common, b - other.common);
        let (a_std, b_std) = (self.common.sqrt(), other.common.sqrt());
        let (weight, common, repeated) = if self.views & other.views == 0 {
            let w = a / (a + b);
            let of = |a: f64, b: f64| (1.0 - w).powi(2) * a + w * w * b;
            (w, of(self.common, other.common), of(self.repeated, other.repeated))
        } else {
            let d = b_std - a_std;
            let w = ((a_own - a_std * d) / (a_own + b_own + d * d)).clamp(0.0, 1.0);
            let of = |a: f64, b: f64| ((1.0 - w) * a + w * b).powi(2);
            (w, of(a_std, b_std), of(self.repeated.sqrt(), other.repeated.sqrt()))
        };
        let own = (1.0 - weight).powi(2) * a_own + weight * weight * b_own;
        Estimate {
            height: self.height + weight * (other.height - self.height),
            variance: (own + common).max(settings.variance_min_m2),
            common,
            repeated,
            views: self.views | other.views,
            count: self.count.saturating_add(other.count),
            time_ns: newer.time_ns,
            source: newer.source,
        }
    }

    fn of_rival(rival: &Rival) -> Estimate {
        Estimate {
            height: rival.height_m.into(),
            variance: rival.variance_m2.into(),
            common: f64::from(rival.common_m2).min(rival.variance_m2.into()),
            repeated: rival.repeated_m2.into(),
            views: rival.views,
            count: rival.count,
            time_ns: rival.time_ns,
            source: rival.source,
        }
    }

    fn of_cell(cell: &Cell) -> Estimate {
        Estimate {
            height: cell.height_m.into(),
            variance: cell.variance_m2.into(),
            common: f64::from(cell.common_m2).min(cell.variance_m2.into()),
            repeated: cell.repeated_m2.into(),
            views: cell.views,
            count: cell.count,
            time_ns: cell.time_ns,
            source: cell.source,
        }
    }

    fn to_rival(self) -> Rival {
        Rival {
            height_m: self.height as f32,
            variance_m2: self.variance as f32,
            common_m2: self.common as f32,
            repeated_m2: self.repeated as f32,
            views: self.views,
            count: self.count,
            time_ns: self.time_ns,
            source: self.source,
        }
    }

    fn into_cell(self, cell: &mut Cell) {
        cell.height_m = self.height as f32;
        cell.variance_m2 = self.variance as f32;
        cell.common_m2 = self.common as f32;
        cell.repeated_m2 = self.repeated as f32;
        cell.views = self.views;
        cell.count = self.count;
        cell.time_ns = self.time_ns;
        cell.source = self.source;
    }
}

/// The cell after an observation.
///
/// - Ground that agrees within the gate is blended by variance; what does not becomes a rival, kept
///   beside. A third observation that agrees with one of the two decides for it.
/// - What was seen replaces an imported map, and an imported map never enters what was seen.
/// - A cell that the robot hides keeps its ground underneath; ground seen later uncovers it.
pub(super) fn observe(cell: &mut Cell, seen: &PairCell, stamp: Stamp, settings: &MapSettings) {
    if !seen.is_ground() {
        let mask = Flags(seen.flags.0 & Flags::MASKED.0);
        let is_newer = stamp.time_ns >= cell.masked_ns
            && (!cell.is_ground() || cell.flags.any(Flags::PRIOR) || stamp.time_ns >= cell.time_ns);
        if mask != Flags::NONE && is_newer {
            cell.flags = cell.flags.without(Flags::MASKED) | mask;
            cell.masked_ns = stamp.time_ns;
        }
        return;
    }
    if stamp.is_prior && cell.is_ground() && !cell.flags.any(Flags::PRIOR) {
        return;
    }
    if !stamp.is_prior && stamp.time_ns >= cell.masked_ns {
        cell.flags = cell.flags.without(Flags::MASKED);
    }
    let variance = f64::from(seen.variance_m2).max(settings.variance_min_m2);
    let common = f64::from(seen.common_m2).clamp(0.0, variance);
    // An imported map is one look; it repeats nothing.
    let repeated = if stamp.is_prior { 0.0 } else { settings.repeated_share * (variance - common) };
    let new = Estimate {
        height: seen.height_m.into(),
        variance,
        common: common + repeated,
        repeated,
        views: stamp.view,
        count: seen.count.max(1),
        time_ns: stamp.time_ns,
        source: stamp.source,
    };
    let replaces = !cell.is_ground() || stamp.is_prior || cell.flags.any(Flags::PRIOR);
    if replaces {
        let flags = cell.flags.without(Flags::PRIOR | Flags::MULTI | Flags::CONFLICT);
        cell.flags = if stamp.is_prior { flags | Flags::PRIOR } else { flags };
        cell.rival = None;
        new.into_cell(cell);
    } else {
        contend(cell, new, settings);
    }
    // Which surfaces a cell shows is told by whoever saw it last.
    if replaces || stamp.time_ns >= cell.time_ns {
        cell.flags = cell.flags.without(Flags::MULTI) | Flags(seen.flags.0 & Flags::MULTI.0);
        cell.lower_m = seen.lower_m;
    }
}

/// Blends ground that was seen with ground that was seen before.
fn contend(cell: &mut Cell, new: Estimate, settings: &MapSettings) {
    let old = Estimate::of_cell(cell);
    let rival = cell.rival.as_ref().map(Estimate::of_rival);
    let agrees = |other: &Estimate| other.compare(&new, settings).2;
    if agrees(&old) {
        old.with(&new, settings).into_cell(cell);
        cell.rival = None;
        cell.flags = cell.flags.without(Flags::CONFLICT);
        return;
    }
    // Where a wheel stood is not where it stood any more.
    match rival {
        Some(rival) if agrees(&rival) => {
            rival.with(&new, settings).into_cell(cell);
            cell.rival = None;
            cell.flags = cell.flags.without(Flags::CONFLICT | Flags::CONTACT);
        }
        // Three that contradict each other: the two newest are kept.
        Some(rival) if rival.time_ns > old.time_ns => {
            rival.into_cell(cell);
            cell.rival = Some(new.to_rival());
            cell.flags = cell.flags.without(Flags::CONTACT);
        }
        _ => {
            cell.rival = Some(new.to_rival());
            cell.flags |= Flags::CONFLICT;
        }
    }
}

/// The cell after a wheel stood on it at a height (m) known to a variance (m²).
pub(super) fn touch(cell: &mut Cell, height: f64, variance: f64, stamp: Stamp) {
    if cell.is_ground() && !cell.flags.any(Flags::PRIOR) && stamp.time_ns < cell.time_ns {
        return;
    }
    *cell = Cell {
        height_m: height as f32,
        variance_m2: variance as f32,
        common_m2: 0.0,
        repeated_m2: 0.0,
        views: 0,
        count: cell.count.saturating_add(1),
        time_ns: stamp.time_ns,
        source: stamp.source,
        flags: Flags::CONTACT,
        masked_ns: i64::MIN,
        lower_m: f32::NAN,
        rival: None,
    };
}

/// The cell after a wheel stood over it, below which no ground is higher than a ceiling (m); ground that is told higher
/// by more than `most` (m) is left. Tells whether anything changed.
pub(super) fn lower(
    cell: &mut Cell,
    [ceiling, most]: [f64; 2],
    variance: f64,
    stamp: Stamp,
) -> bool {
    let is_older = stamp.time_ns < cell.time_ns && !cell.flags.any(Flags::PRIOR);
    if !cell.is_ground() || is_older {
        return false;
    }
    let is_in = |height: f32| f64::from(height) > ceiling;
    match cell.rival {
        Some(rival) if is_in(cell.height_m) != is_in(rival.height_m) => {
            if is_in(cell.height_m) {
                Estimate::of_rival(&rival).into_cell(cell);
                cell.flags = cell.flags.without(Flags::CONTACT | Flags::MULTI);
                cell.lower_m = f32::NAN;
            }
            cell.rival = None;
            cell.flags = cell.flags.without(Flags::CONFLICT);
            true
        }
        // Which of the two is right is not told by a wheel above or in both.
        Some(_) => false,
        None if is_in(cell.height_m) && f64::from(cell.height_m) - ceiling <= most => {
            touch(cell, ceiling, variance, stamp);
            true
        }
        None => false,
    }
}

/// The cell after something happened near it: less sure by a variance (m²).
pub(super) fn disturb(cell: &mut Cell, variance: f64) {
    if cell.is_ground() {
        cell.variance_m2 = (f64::from(cell.variance_m2) + variance).min(1e6) as f32;
        if let Some(rival) = &mut cell.rival {
            rival.variance_m2 = (f64::from(rival.variance_m2) + variance).min(1e6) as f32;
        }
    }
}
