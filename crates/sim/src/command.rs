//! What the rover can be told, and why it refuses.

use nalgebra::Point3;
use rover::{LegAngles, LegId, Robot};

/// Most knots of a joint path.
pub const KNOTS_MAX: usize = 10_000;
/// Most knots of a body path: each is six legs to look at.
pub const BODY_KNOTS_MAX: usize = 1000;
/// Latest time of a knot (s): a day.
pub const TIME_MAX_S: f64 = 86_400.0;
/// Longest identity of a command (bytes).
pub const ID_LENGTH_MAX: usize = 128;
/// How far a joint may be from the first knot of a path (rad); the path then begins with the piece
/// from where the leg is.
pub const START_TOLERANCE_RAD: f64 = 0.01;

/// Joint angles beyond a limit by rounding alone count as within (rad).
const LIMIT_SLACK: f64 = 1e-9;

/// A command.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Its identity: the rover executes each identity at most once.
    pub id: String,
    /// What to do.
    pub motion: Motion,
    /// Where the legs were when the command was checked; `None` where nobody checked it.
    pub basis: Option<Basis>,
    /// Number of the authority that sent it: one below the highest seen is refused, and so is none
    /// once one was seen.
    pub epoch: Option<u64>,
}

/// What to do (F93: joint-space and task-space motions).
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Move one leg joint-linearly from knot to knot. A piece takes the time between its knots, or
    /// as little longer as the robot's joint speed and acceleration ask for; knots of equal times
    /// are passed as fast as these allow.
    JointPath {
        /// Name of the leg.
        leg: String,
        /// 2 to [`KNOTS_MAX`] knots, the first one where the leg is.
        knots: Vec<JointKnot>,
    },
    /// Move all standing legs at once over their wheels: the body shifts. Timed as a joint path; the
    /// base goes where it fits best to the wheels that stand.
    BodyPath {
        /// 2 to [`BODY_KNOTS_MAX`] knots, the first one where the legs are.
        knots: Vec<BodyKnot>,
        /// What keeps the wheels where they stand.
        hold: WheelHold,
    },
    /// Move one leg's wheel along a straight line, keeping the wheel's orientation.
    WheelLine {
        /// Name of the leg.
        leg: String,
        /// Where the wheel's center goes, in `world` (m).
        center: Point3<f64>,
    },
    /// Stop where the rover is; what is under way is aborted.
    Stop,
}

/// What keeps standing wheels in place while the body shifts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum WheelHold {
    /// Brakes: a wheel is one body with its fork, and neither turns.
    #[default]
    Brakes,
    /// Drives: they turn the wheel against its fork as the fork pitches about the axle, so that the
    /// tread stays where it is.
    Drives,
}

/// A knot of one leg's path.
#[derive(Debug, Clone, PartialEq)]
pub struct JointKnot {
    /// Joint angles (rad), from the hip outward.
    pub angles: LegAngles,
    /// When it is to be reached after the start (s), not before the one before.
    pub time_s: f64,
}

/// A knot of a body's path.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyKnot {
    /// Joint angles (rad) by name of the leg: in each knot the same legs, among them all that
    /// stand. Others may move with them, or go with the base as they are.
    pub legs: Vec<(String, LegAngles)>,
    /// When it is to be reached after the start (s), not before the one before.
    pub time_s: f64,
}

/// The state that a command was checked against.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    /// Joint angles (rad) by name of the leg.
    pub legs: Vec<(String, LegAngles)>,
    /// Largest deviation of any joint from them (rad).
    pub tolerance: f64,
}

/// Why a command was refused. Nothing has moved then.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum Refusal {
    #[error("the command's id has {bytes} bytes; 1 to {ID_LENGTH_MAX} are allowed")]
    IdLength { bytes: usize },
    #[error(
        "the command was sent under authority {given}, but {highest} was seen: it has passed on"
    )]
    OldAuthority { given: u64, highest: u64 },
    #[error("the rover is stopped; release the stop first")]
    Stopped,
    #[error("the rover stopped for a fault; release the stop first: {fault}")]
    Faulted { fault: String },
    #[error("the rover executes {id}; wait for its end or stop it")]
    Busy { id: String },
    #[error("there is no leg {leg:?}; the legs are {known}")]
    UnknownLeg { leg: String, known: String },
    #[error("the path has {n_knots} knots; 2 to {most} are allowed")]
    KnotCount { n_knots: usize, most: usize },
    #[error("knot {knot} is timed at {time_s} s, before the {before_s} s of the one before")]
    TimeDecreases { knot: usize, time_s: f64, before_s: f64 },
    #[error("knot {knot} is timed at {time_s} s; 0 to {TIME_MAX_S} s are allowed")]
    TimeRange { knot: usize, time_s: f64 },
    #[error("knot {knot} moves {given}, but knot 0 {expected}; all knots move the same legs")]
    KnotLegs { knot: usize, given: String, expected: String },
    #[error("{leg} stands, but the body path does not move it; it moves {given}")]
    StandingLegMissing { leg: String, given: String },
    #[error(
        "{at_s:.1} s after the start {leg}'s wheel would slip by {slip:.4} m, more than {most:.4} m: the legs pull against each other"
    )]
    Slip { at_s: f64, leg: String, slip: f64, most: f64 },
    #[error(
        "{at_s:.1} s after the start the center of mass would be {outside:.3} m outside the support of {standing}"
    )]
    BodyUnsupported { at_s: f64, outside: f64, standing: String },
    #[error("{what} is not finite")]
    NotFinite { what: String },
    #[error(
        "knot {knot} takes {joint} to {angle:.4} rad, beyond its limits of {lower:.4} to {upper:.4} rad"
    )]
    JointLimit { knot: usize, joint: String, angle: f64, lower: f64, upper: f64 },
    #[error(
        "the path begins with {joint} at {wanted:.4} rad, but it is at {present:.4} rad, more than {START_TOLERANCE_RAD} rad away"
    )]
    WrongStart { joint: String, wanted: f64, present: f64 },
    #[error(
        "the command was checked with {joint} at {checked:.4} rad, but it is at {present:.4} rad, more than {tolerance} rad away: plan again"
    )]
    BasisOff { joint: String, checked: f64, present: f64, tolerance: f64 },
    #[error("the basis tolerance is {tolerance}; it must be finite and not negative")]
    BasisTolerance { tolerance: f64 },
    #[error(
        "the wheel cannot follow the line: {at:.3} m of {length:.3} m along it the goal is out of reach by {missing:.3} m"
    )]
    OutOfReach { at: f64, length: f64, missing: f64 },
    #[error(
        "the wheel cannot follow the line: {at:.3} m of {length:.3} m along it {joint} would leave its limits"
    )]
    LineLimit { at: f64, length: f64, joint: String },
    #[error(
        "the wheel cannot follow the line: {at:.3} m of {length:.3} m along it the leg would have to change its branch"
    )]
    LineBranch { at: f64, length: f64 },
    #[error(
        "{leg} would be off the ground with the center of mass {outside:.2} m outside the support of {standing}"
    )]
    Unsupported { leg: String, standing: String, outside: f64 },
    #[error("{leg} cannot leave the ground: {n_standing} other wheels stand, and 3 are needed")]
    TooFewFeet { leg: String, n_standing: usize },
}

/// The leg of that name.
pub(crate) fn leg_named(robot: &Robot, name: &str) -> Result<LegId, Refusal> {
    robot.leg_id(name).ok_or_else(|| {
        let known: Vec<&str> = robot.legs().iter().map(|leg| leg.name.as_str()).collect();
        Refusal::UnknownLeg { leg: name.chars().take(80).collect(), known: known.join(", ") }
    })
}

/// The name of a leg's joint by its place.
pub(crate) fn joint_name(robot: &Robot, leg: LegId, place: usize) -> String {
    // Beyond the last joint a leg's angles are padded with zeros: no joint's fault.
    let joint = robot.leg(leg).joints.get(place);
    joint.map_or_else(|| format!("joint {}", place + 1), |j| robot.joints()[*j].name.clone())
}

/// Refuses knots that these legs cannot take, or that do not begin where they are. Angles of knots
/// and present ones are in the order of `legs`.
pub(crate) fn check_knots(
    robot: &Robot,
    legs: &[LegId],
    knots: &[Vec<LegAngles>],
    present: &[LegAngles],
) -> Result<(), Refusal> {
    for (knot, stance) in knots.iter().enumerate() {
        for (leg, angles) in legs.iter().zip(stance) {
            check_angles(robot, *leg, knot, angles)?;
        }
    }
    let Some(first) = knots.first() else { return Ok(()) };
    for ((leg, wanted), present) in legs.iter().zip(first).zip(present) {
        let (place, off) = furthest(wanted, present);
        if off > START_TOLERANCE_RAD {
            return Err(Refusal::WrongStart {
                joint: joint_name(robot, *leg, place),
                wanted: wanted[place],
                present: present[place],
            });
        }
    }
    Ok(())
}

fn check_angles(robot: &Robot, leg: LegId, knot: usize, angles: &LegAngles) -> Result<(), Refusal> {
    let model = robot.leg(leg);
    for (place, angle) in angles.iter().enumerate() {
        let joint = || joint_name(robot, leg, place);
        if !angle.is_finite() {
            return Err(Refusal::NotFinite { what: format!("{} of knot {knot}", joint()) });
        }
        let (lower, upper) = (model.lower[place], model.upper[place]);
        if *angle < lower - LIMIT_SLACK || *angle > upper + LIMIT_SLACK {
            return Err(Refusal::JointLimit { knot, joint: joint(), angle: *angle, lower, upper });
        }
    }
    Ok(())
}

/// The least time of each piece (s), that to the first knot included; refuses times that go back.
pub(crate) fn times_of_pieces(times_s: impl Iterator<Item = f64>) -> Result<Vec<f64>, Refusal> {
    let mut before_s = 0.0;
    times_s
        .enumerate()
        .map(|(knot, time_s)| {
            if !time_s.is_finite() {
                return Err(Refusal::NotFinite { what: format!("the time of knot {knot}") });
            }
            if !(0.0..=TIME_MAX_S).contains(&time_s) {
                return Err(Refusal::TimeRange { knot, time_s });
            }
            if time_s < before_s {
                return Err(Refusal::TimeDecreases { knot, time_s, before_s });
            }
            let piece_s = time_s - before_s;
            before_s = time_s;
            Ok(piece_s)
        })
        .collect()
}

/// Refuses too few knots, or too many.
pub(crate) fn check_count(n_knots: usize, most: usize) -> Result<(), Refusal> {
    if (2..=most).contains(&n_knots) {
        return Ok(());
    }
    Err(Refusal::KnotCount { n_knots, most })
}

/// The legs of a body's path in the order of the robot, and their angles (rad) at each knot in that
/// order. `standing` must be among them.
pub(crate) fn body_knots(
    robot: &Robot,
    knots: &[BodyKnot],
    standing: &[LegId],
) -> Result<(Vec<LegId>, Vec<Vec<LegAngles>>), Refusal> {
    let mut legs = Vec::new();
    let mut stances = Vec::with_capacity(knots.len());
    for (knot, BodyKnot { legs: given, .. }) in knots.iter().enumerate() {
        let mut of_knot = given
            .iter()
            .map(|(name, angles)| Ok((leg_named(robot, name)?, *angles)))
            .collect::<Result<Vec<_>, Refusal>>()?;
        of_knot.sort_by_key(|(leg, _)| leg.0);
        let ids: Vec<LegId> = of_knot.iter().map(|(leg, _)| *leg).collect();
        if knot == 0 {
            legs = ids.clone();
            legs.dedup();
        }
        if ids != legs {
            let (given, expected) = (names(robot, &ids), names(robot, &legs));
            return Err(Refusal::KnotLegs { knot, given, expected });
        }
        stances.push(of_knot.into_iter().map(|(_, angles)| angles).collect());
    }
    if let Some(leg) = standing.iter().find(|leg| !legs.contains(leg)) {
        let leg = robot.leg(*leg).name.clone();
        return Err(Refusal::StandingLegMissing { leg, given: names(robot, &legs) });
    }
    Ok((legs, stances))
}

/// Names of legs for people.
pub(crate) fn names(robot: &Robot, legs: &[LegId]) -> String {
    if legs.is_empty() {
        return "no leg".into();
    }
    let names: Vec<&str> = legs.iter().map(|leg| robot.leg(*leg).name.as_str()).collect();
    names.join(", ")
}

/// Refuses a command whose basis no longer holds.
pub(crate) fn check_basis(
    robot: &Robot,
    basis: &Basis,
    present: &[LegAngles],
) -> Result<(), Refusal> {
    let tolerance = basis.tolerance;
    if !(tolerance.is_finite() && tolerance >= 0.0) {
        return Err(Refusal::BasisTolerance { tolerance });
    }
    for (name, checked) in &basis.legs {
        let leg = leg_named(robot, name)?;
        if let Some(place) = checked.iter().position(|angle| !angle.is_finite()) {
            let what = format!("{} of the basis", joint_name(robot, leg, place));
            return Err(Refusal::NotFinite { what });
        }
        let (place, off) = furthest(checked, &present[leg.0]);
        if off > tolerance {
            return Err(Refusal::BasisOff {
                joint: joint_name(robot, leg, place),
                checked: checked[place],
                present: present[leg.0][place],
                tolerance,
            });
        }
    }
    Ok(())
}

/// The joint that differs most, and by how much (rad).
fn furthest(a: &LegAngles, b: &LegAngles) -> (usize, f64) {
    let off = (a - b).abs();
    (off.imax(), off.max())
}
