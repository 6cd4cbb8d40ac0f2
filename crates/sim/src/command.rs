//! What the rover can be told, and why it refuses.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use rover::{LegAngles, LegId, Robot};

use crate::frame::Frame;
use crate::refusal::Refusal;

/// Most knots of a joint path.
pub const KNOTS_MAX: usize = 10_000;
/// Most knots of a body path: each is six legs to look at.
pub const BODY_KNOTS_MAX: usize = 1000;
/// Latest time of a knot (s): a day.
pub const TIME_MAX_S: f64 = 86_400.0;
/// Longest identity of a command (bytes).
pub const ID_LENGTH_MAX: usize = 128;
/// Most steps of a sequence.
pub const STEPS_MAX: usize = 100;
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
    /// Move named joints of one leg to angles, joint-linear.
    JointMove {
        /// Names of joints with their goals (rad; m for one that slides).
        joints: Vec<(String, f64)>,
        /// Speed of the joint that moves most (rad/s); the robot's joint speed where absent.
        speed: Option<f64>,
    },
    /// Move one leg's wheel along a straight line, turning it evenly.
    WheelMove {
        /// Name of the leg.
        leg: String,
        /// What the goal is given in.
        frame: GoalFrame,
        /// Where the wheel's center goes, in `frame` (m).
        position: Vector3<f64>,
        /// By how much the wheel turns: axis times angle (rad), about axes of the base in frame
        /// `Base`, else of `world`.
        rotation: Vector3<f64>,
        /// Speed of its center (m/s); as fast as the joints allow where absent.
        speed: Option<f64>,
    },
    /// Move the chassis over the wheels that stand, which stay.
    BodyMove {
        /// By how much, in the base's frame (m).
        translation: Vector3<f64>,
        /// Turn about axes of the base: axis times angle (rad).
        rotation: Vector3<f64>,
        /// Speed of the base's origin (m/s); as fast as the joints allow where absent.
        speed: Option<f64>,
    },
    /// Put wheel brakes on, or release them.
    WheelBrake {
        /// Names of the legs; all where empty.
        legs: Vec<String>,
        /// On or off.
        on: bool,
    },
    /// Roll a wheel that is off the ground.
    WheelRoll {
        /// Name of the leg.
        leg: String,
        /// By how much (rad), positive as in driving ahead along its heading.
        angle: f64,
        /// Spin (rad/s).
        speed: Option<f64>,
    },
    /// Turn wheels about the vertical through their centers until they head there.
    WheelSteer {
        /// Names of legs with headings: counter-clockwise from x of the base (rad). A wheel heads
        /// both ways, so that it turns by a quarter at most where its limits allow.
        headings: Vec<(String, f64)>,
    },
    /// Steer all wheels about the center of an arc and drive along it (F7).
    DriveArc(DriveArc),
    /// End what is under way as soon as the stance has its margin, and put all brakes on.
    Hold,
    /// Take another mode of operation.
    Mode(Operating),
    /// Finish the step of the sequence under way; the rest of it is cancelled.
    CancelRest,
    /// Steps one after another; the first that fails ends it.
    Sequence(Vec<Step>),
    /// Stop where the rover is; what is under way is aborted.
    Stop,
}

/// What the goal of a wheel is given in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum GoalFrame {
    /// `world`.
    #[default]
    World,
    /// The base as it is now.
    Base,
    /// From where the wheel's center is, along the axes of `world`.
    Offset,
}

/// An arc of the base's origin over the ground: in plan, from where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveArc {
    /// Length (m); negative is backward, zero turns on the spot.
    pub distance: f64,
    /// Change of heading (rad), counter-clockwise; zero drives straight.
    pub turn: f64,
    /// Direction of travel at the beginning, counter-clockwise from x of the base (rad).
    pub course: f64,
    /// Speed of the fastest wheel (m/s).
    pub speed: Option<f64>,
}

/// A mode of operation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Operating {
    /// Brakes on; only modes, holds and stops are taken.
    Safe,
    /// Legs and body move over braked wheels.
    #[default]
    Ready,
    /// Wheels may be released, steered, rolled and driven.
    Driving,
}

impl Operating {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Operating::Safe => "safe",
            Operating::Ready => "ready",
            Operating::Driving => "driving",
        }
    }
}

/// A step of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// What to do.
    pub motion: Motion,
    /// What must hold before it begins.
    pub gate: Option<Gate>,
}

/// What must hold before a motion begins, told by the frame of that instant; else why not.
#[derive(Clone)]
pub struct Gate(pub Arc<GateFn>);

/// See [`Gate`].
pub type GateFn = dyn Fn(&Frame) -> Result<(), String> + Send + Sync;

impl std::fmt::Debug for Gate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Gate")
    }
}

impl PartialEq for Gate {
    fn eq(&self, other: &Gate) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
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
