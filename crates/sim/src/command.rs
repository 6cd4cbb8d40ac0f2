//! What the rover can be told, and why it refuses.

use nalgebra::Point3;
use rover::{LegAngles, LegId, Robot};

/// Most knots of a joint path.
pub const KNOTS_MAX: usize = 10_000;
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
}

/// What to do (F93: joint-space and task-space motions).
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Move one leg joint-linearly from knot to knot, each piece in the time that its slowest
    /// joint needs at the robot's joint speed.
    JointPath {
        /// Name of the leg.
        leg: String,
        /// Joint angles (rad), 2 to [`KNOTS_MAX`] of them, the first one where the leg is.
        knots: Vec<LegAngles>,
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
    #[error("the rover is stopped; release the stop first")]
    Stopped,
    #[error("the rover stopped for a fault; release the stop first: {fault}")]
    Faulted { fault: String },
    #[error("the rover executes {id}; wait for its end or stop it")]
    Busy { id: String },
    #[error("there is no leg {leg:?}; the legs are {known}")]
    UnknownLeg { leg: String, known: String },
    #[error("the path has {n_knots} knots; 2 to {KNOTS_MAX} are allowed")]
    KnotCount { n_knots: usize },
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

/// Refuses knots that the leg cannot take, or that do not begin where it is.
pub(crate) fn check_knots(
    robot: &Robot,
    leg: LegId,
    knots: &[LegAngles],
    present: &LegAngles,
) -> Result<(), Refusal> {
    let n_knots = knots.len();
    if !(2..=KNOTS_MAX).contains(&n_knots) {
        return Err(Refusal::KnotCount { n_knots });
    }
    let model = robot.leg(leg);
    for (knot, angles) in knots.iter().enumerate() {
        for (place, angle) in angles.iter().enumerate() {
            let joint = || joint_name(robot, leg, place);
            if !angle.is_finite() {
                return Err(Refusal::NotFinite { what: format!("{} of knot {knot}", joint()) });
            }
            let (lower, upper) = (model.lower[place], model.upper[place]);
            if *angle < lower - LIMIT_SLACK || *angle > upper + LIMIT_SLACK {
                return Err(Refusal::JointLimit {
                    knot,
                    joint: joint(),
                    angle: *angle,
                    lower,
                    upper,
                });
            }
        }
    }
    match furthest(&knots[0], present) {
        (place, off) if off > START_TOLERANCE_RAD => Err(Refusal::WrongStart {
            joint: joint_name(robot, leg, place),
            wanted: knots[0][place],
            present: present[place],
        }),
        _ => Ok(()),
    }
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
