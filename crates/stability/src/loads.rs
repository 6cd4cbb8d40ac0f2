//! How the feet share the weight: legs with their tires as vertical springs that push only.
//!
//! With more than three feet, statics alone does not fix the loads. Here every leg is a vertical
//! spring, and the rover is rigid: it sinks and tilts a little, so that each spring is pressed in by a
//! linear function of its place, and bears f = k (c₀ + c₁ x + c₂ y + d)₊: k its stiffness, d how much
//! deeper than where it just touches its foot was put down. A foot that this would pull bears nothing.
//! Of all loads that balance and push, these have the least energy, Σ f²/2k - f d.
//! Source: planning notes, load share with compliance; oracle: equal springs on a regular hexagon
//! with one leg lifted carry (5, 3, 2, 3, 5)/18 of the weight.
//!
//! [`leg_springs`] is the one model of the springs: the margin rule, the report of forces,
//! reachability, the preload of steps and the simulated rover all ask it. A leg is as stiff as its
//! joints and tire make it in the posture at hand (`rover::leg_compliance`); where `robot.toml` has one
//! figure for a leg, or none, all legs are equal springs. [`StanceSprings`] adds how far the loads may
//! be off.
//!
//! Everything is in the gravity frame `g` (z up), in meters and newtons.

use geometry::ConvexPolygon;
use nalgebra::{Point3, Vector3};
use rover::{LegId, Posture, Robot, vertical_stiffness};

use self::share::{Footprint, Spring, Springs};

mod share;

/// How well the height of a touch-down is known where the robot does not say it, as a share of the
/// deflection of a leg under its part of the weight.
const HEIGHT_ERROR: f64 = 0.2;

/// Vertical force on each contact (N, upward, none negative) of legs that are equal springs: their sum
/// is `weight_n` (N), and their moments about the center of mass vanish.
///
/// `None` if the center of mass is outside the contacts' support polygon, or there is none: such
/// a rover falls, whatever the loads.
pub fn spring_share(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
) -> Option<Vec<f64>> {
    let even = LegSpring { stiffness_n_m: 1.0, pressed_m: 0.0 };
    compliant_share(contacts_in_g, com_in_g, weight_n, &vec![even; contacts_in_g.len()])
}

/// A leg with its tire as a vertical spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegSpring {
    /// Load over deflection (N/m), above zero.
    pub stiffness_n_m: f64,
    /// How much deeper than where it just touches the foot was put down (m); negative for one that
    /// hangs above the ground. What all feet have in common, or what a tilt of the rover levels, changes
    /// nothing.
    pub pressed_m: f64,
}

/// The springs of these legs, each where it touches the ground (`world`, m), all put down where they
/// just touch.
pub fn leg_springs(
    robot: &Robot,
    posture: &Posture,
    standing: &[(LegId, Point3<f64>)],
) -> Vec<LegSpring> {
    let spring = |(leg, contact): &(LegId, Point3<f64>)| LegSpring {
        stiffness_n_m: vertical_stiffness(robot, posture, *leg, contact),
        pressed_m: 0.0,
    };
    standing.iter().map(spring).collect()
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
    let footprint = Footprint::new(contacts_in_g)?;
    let center = footprint.center(com_in_g)?;
    let springs = Springs::new(&footprint, relative(springs, weight_n)?)?;
    let mut loads = Vec::with_capacity(contacts_in_g.len());
    springs.share(&footprint, &center, &mut loads);
    loads.iter_mut().for_each(|load| *load *= weight_n);
    Some(loads)
}

/// Stiffness as shares of the largest, preload as a share of the weight; `None` for a weight that is not
/// a number.
fn relative(springs: &[LegSpring], weight_n: f64) -> Option<Vec<Spring>> {
    let stiffest = springs.iter().map(|s| s.stiffness_n_m).fold(0.0, f64::max);
    let spring = |s: &LegSpring| Spring {
        stiffness: s.stiffness_n_m / stiffest,
        // Nothing is nothing without weight too.
        preload: match s.pressed_m == 0.0 {
            true => 0.0,
            false => s.stiffness_n_m * s.pressed_m / weight_n,
        },
    };
    weight_n.is_finite().then(|| springs.iter().map(spring).collect())
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

impl SpringError {
    /// As `robot.toml` says it of a rover of this weight (N): where it says nothing of heights, they are
    /// known to a fifth of the deflection of a leg under its part of the weight.
    pub fn of(robot: &Robot, springs: &[LegSpring], weight_n: f64) -> SpringError {
        let compliance = robot.compliance();
        let deflection = weight_n / springs.iter().map(|s| s.stiffness_n_m).sum::<f64>();
        SpringError {
            stiffness: compliance.stiffness_error,
            height_m: compliance.touchdown_error.unwrap_or(HEIGHT_ERROR * deflection),
        }
    }
}

/// Most contacts for which all combinations of errors are looked at.
const MAX_COMBINED: usize = 8;
/// Most contacts for which there is a band: as many as a robot can have legs.
const MAX_BAND_CONTACTS: usize = 16;

/// The springs under feet that stay, with all combinations of errors that matter, prepared for asking
/// for the loads of many centers of mass.
///
/// Looked at are all combinations of feet that are stiffer and put down deeper, and feet that are
/// softer and less deep: a foot carries more the stiffer and deeper it is itself. Of more than 8 feet,
/// looked at are for each foot the combination at which it bears most, and that at which it bears least,
/// as far as all feet carry and errors are small.
#[derive(Debug, Clone, PartialEq)]
pub struct StanceSprings {
    footprint: Footprint,
    weight_n: f64,
    expected: Springs,
    off: Vec<Springs>,
}

impl StanceSprings {
    /// Of springs on these contacts (m) under `weight_n` (N).
    ///
    /// `None` where the contacts enclose no support polygon or are more than 16, there is not one finite
    /// spring of stiffness above zero for each, or an error is not a number from 0 (to below 1 for the
    /// stiffness).
    pub fn new(
        contacts_in_g: &[Point3<f64>],
        weight_n: f64,
        springs: &[LegSpring],
        error: &SpringError,
    ) -> Option<StanceSprings> {
        let known = (0.0..1.0).contains(&error.stiffness) && (0.0..1e3).contains(&error.height_m);
        if !known || contacts_in_g.len() > MAX_BAND_CONTACTS {
            return None;
        }
        let footprint = Footprint::new(contacts_in_g)?;
        let expected = Springs::new(&footprint, relative(springs, weight_n)?)?;
        let with_firm = |firm: u32| {
            let off = springs.iter().enumerate().map(|(i, spring)| {
                let sign = if firm >> i & 1 == 1 { 1.0 } else { -1.0 };
                LegSpring {
                    stiffness_n_m: spring.stiffness_n_m * (1.0 + sign * error.stiffness),
                    pressed_m: spring.pressed_m + sign * error.height_m,
                }
            });
            Springs::new(&footprint, relative(&off.collect::<Vec<_>>(), weight_n)?)
        };
        let firm = firm_sets(&footprint, &expected);
        let off = firm.into_iter().map(with_firm).collect::<Option<Vec<_>>>()?;
        Some(StanceSprings { footprint, weight_n, expected, off })
    }

    /// Of the legs that stand, each with the point where it touches the ground (`world`, m), under
    /// `gravity` (m/s²): see [`leg_springs`] and [`SpringError::of`]. `None` without a support polygon.
    pub fn of(
        robot: &Robot,
        posture: &Posture,
        standing: &[(LegId, Point3<f64>)],
        gravity: f64,
    ) -> Option<StanceSprings> {
        let contacts: Vec<Point3<f64>> = standing.iter().map(|(_, contact)| *contact).collect();
        let (weight, springs) = (robot.mass() * gravity, leg_springs(robot, posture, standing));
        let error = SpringError::of(robot, &springs, weight);
        StanceSprings::new(&contacts, weight, &springs, &error)
    }

    /// The loads with the center of mass at `com` (m); `None` if it is outside of the support polygon.
    pub fn band(&self, com_in_g: &Point3<f64>) -> Option<LoadBand> {
        let center = self.footprint.center(com_in_g)?;
        let mut loads = Vec::with_capacity(self.footprint.len());
        self.expected.share(&self.footprint, &center, &mut loads);
        let expected_n: Vec<f64> = loads.iter().map(|load| load * self.weight_n).collect();
        let (mut least_n, mut most_n) = (expected_n.clone(), expected_n.clone());
        for springs in &self.off {
            springs.share(&self.footprint, &center, &mut loads);
            for (i, load) in loads.iter().enumerate() {
                least_n[i] = least_n[i].min(load * self.weight_n);
                most_n[i] = most_n[i].max(load * self.weight_n);
            }
        }
        Some(LoadBand { expected_n, least_n, most_n })
    }

    /// Centers of mass at which all feet carry, and each no less and no more than it may (N, one pair a
    /// foot), whatever in the band the loads are. Elsewhere they may do so too: ask
    /// [`band`](Self::band). `None` if there is no such area.
    pub fn surely_within(&self, least_and_most_n: &[(f64, f64)]) -> Option<ConvexPolygon> {
        let mut conditions = Vec::new();
        for springs in std::iter::once(&self.expected).chain(&self.off) {
            // Without a linear share nothing is sure.
            let loads = springs.linear(&self.footprint);
            if loads.len() != least_and_most_n.len() {
                return None;
            }
            for (load, (least, most)) in loads.iter().zip(least_and_most_n) {
                let above = least.max(0.0) / self.weight_n;
                conditions.push(load - Vector3::x() * above);
                if most.is_finite() {
                    conditions.push(Vector3::x() * (most / self.weight_n) - load);
                } else if *most < 0.0 {
                    return None;
                }
            }
        }
        let known = conditions.iter().all(|c| c.iter().all(|v| v.is_finite()));
        known.then(|| self.footprint.where_positive(conditions))?
    }
}

/// Which feet are stiffer and deeper than said, as bits, in each combination that is looked at.
fn firm_sets(footprint: &Footprint, expected: &Springs) -> Vec<u32> {
    let n = footprint.len();
    if n <= MAX_COMBINED {
        return (0..1 << n).collect();
    }
    let of_foot = |foot| {
        let influence = expected.influence(footprint, foot);
        let bit = |(i, v): (usize, &f64)| u32::from(*v > 0.0) << i;
        let firm: u32 = influence.iter().enumerate().map(bit).sum();
        [firm, !firm]
    };
    (0..n).flat_map(of_foot).collect()
}

/// [`compliant_share`] with an error band over stiffness and touch-down height: see [`StanceSprings`].
pub fn load_band(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    weight_n: f64,
    springs: &[LegSpring],
    error: &SpringError,
) -> Option<LoadBand> {
    StanceSprings::new(contacts_in_g, weight_n, springs, error)?.band(com_in_g)
}
