//! Why the rover refuses.

use crate::command::{ID_LENGTH_MAX, START_TOLERANCE_RAD, STEPS_MAX, TIME_MAX_S};

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
    #[error("there is no joint {joint:?} in a leg; they are named like {example}")]
    UnknownJoint { joint: String, example: String },
    #[error("the command moves joints of {a} and {b}; it takes those of one leg")]
    MixedLegs { a: String, b: String },
    #[error("the command names no {what}; give one or more")]
    Nothing { what: &'static str },
    #[error("{what} is {given}; {least} to {most} {unit} are allowed")]
    Range { what: &'static str, given: f64, least: f64, most: f64, unit: &'static str },
    #[error("{what} needs mode {needed}, and the rover is in {present}; command that mode first")]
    WrongMode { what: &'static str, needed: &'static str, present: &'static str },
    #[error("the brake of {leg}'s wheel is on; release it first")]
    BrakeOn { leg: String },
    #[error("the brake of {leg}'s wheel is off; a leg moves over braked wheels only")]
    BrakeOff { leg: String },
    #[error("{leg}'s wheel is off the ground; the rover drives on all its wheels")]
    WheelLifted { leg: String },
    #[error(
        "{leg}'s wheel stands: rolling it alone would drag the others; drive, or lift it first"
    )]
    WheelStands { leg: String },
    #[error("{leg} has no wheel that could roll")]
    NoWheel { leg: String },
    #[error("{leg}'s wheel cannot turn to a heading of {heading:.3} rad: {why}")]
    CannotSteer { leg: String, heading: f64, why: String },
    #[error(
        "{leg}'s wheel is {distance:.3} m from the arc's center, where it would turn on the spot; {least:.3} m are needed: take another radius"
    )]
    Pivot { leg: String, distance: f64, least: f64 },
    #[error("{at:.2} m along the way the ground under {leg}'s wheel is unknown")]
    GroundUnknown { leg: String, at: f64 },
    #[error(
        "{at:.2} m along the way the ground under {leg}'s wheel slopes by {slope:.3} rad, more than {most:.3} rad"
    )]
    GroundSteep { leg: String, at: f64, slope: f64, most: f64 },
    #[error(
        "{at:.2} m along the way {leg}'s wheel meets a step of more than a quarter of its diameter: {rise:.3} m in {way:.3} m"
    )]
    GroundStep { leg: String, at: f64, rise: f64, way: f64 },
    #[error("{at:.2} m along the way {leg} cannot keep its wheel on the ground: {why}")]
    DriveReach { leg: String, at: f64, why: String },
    #[error("{at:.2} m along the way the margin would be {margin:.3} m, less than {least:.3} m")]
    DriveMargin { at: f64, margin: f64, least: f64 },
    #[error("{leg} cannot hold its wheel where it stands as the body moves: {why}")]
    BodyReach { leg: String, why: String },
    #[error("the sequence has {n_steps} steps; 1 to {STEPS_MAX} are allowed")]
    StepCount { n_steps: usize },
    #[error("a {what} is no step of a sequence; send it by itself")]
    NoStep { what: &'static str },
    #[error("a condition does not hold: {why}")]
    Condition { why: String },
}
