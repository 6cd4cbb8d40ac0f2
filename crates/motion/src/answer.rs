//! What is asked of the step planner, and what it answers.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rover::{Configuration, LegAngles, LegId};
use stability::rule::Preference;

use crate::sbl::SblOptions;
use crate::smooth::SmoothOptions;

/// Where the leg is to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// The wheel on this point of ground (its height is taken from the map), in `world` (m).
    Ground(Point3<f64>),
    /// These joint angles (rad).
    Angles(LegAngles),
}

/// Which planner finds the transit (F53, F60).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Planner {
    /// The straight way in joint space if it is free, else the better of a few short runs of
    /// RRT-Connect, else A* on a coarse grid, else SBL (F81 began with A*).
    #[default]
    Auto,
    /// A* of the wheel on a grid in task space (F80).
    AStar,
    /// SBL (F68-F74).
    Sbl,
    /// Two rapidly growing random trees.
    RrtConnect,
    /// The wheel along a straight line in task space (F59): fragile, for comparison.
    Line,
}

/// What found a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathPlanner {
    /// The straight line in joint space.
    JointLine,
    /// A* of the wheel on a grid.
    AStar,
    /// SBL.
    Sbl,
    /// Two rapidly growing random trees.
    RrtConnect,
    /// The wheel along a straight line.
    Line,
}

/// When a search or a smoother takes an edge for free.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum EdgeRule {
    /// Certified: free at every resolution.
    #[default]
    Certified,
    /// Free at points no farther apart than this (rad, largest joint), as published (F67).
    Sampled(f64),
}

/// Safety buffers as in FootFall (m). They never raise the ground under a standing wheel, under the
/// start or under the goal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Buffers {
    /// The ground is raised by this much for the transit (F84).
    pub terrain_lift: f64,
    /// Clearance added about obstacles (F86).
    pub obstacle: f64,
    /// Added to every clearance: tracking error, predicted sag and error of the map.
    pub inflation: f64,
}

/// A request for one step, or for the transit alone.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRequest {
    /// The leg that steps.
    pub leg: LegId,
    /// Where to.
    pub target: Target,
    /// Which planner.
    pub planner: Planner,
    /// Height of the waypoints above start and goal (m) (F85).
    pub lift: f64,
    /// Clearance from ground and obstacles (m), in place of the robot's own.
    pub environment_tolerance: Option<f64>,
    /// Clearance of every pair of links (m), in place of the robot's own table.
    pub pair_tolerance: Option<f64>,
    /// Only the free motion from the start's angles to the target's: no lift, no drop, no
    /// stability.
    pub transit_only: bool,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// Coefficient of friction under all feet, for [`Preference::Friction`].
    pub friction: f64,
    /// Buffers beside the tolerances.
    pub buffers: Buffers,
    /// When an edge is taken for free.
    pub edges: EdgeRule,
    /// Cell of the A* planner (m).
    pub cell: f64,
    /// May the body be shifted first, where the margin rule asks for it?
    pub may_shift: bool,
    /// Press the wheel to its predicted load at the end.
    pub preload: bool,
    /// Wheel drives hold the standing wheels while forks pitch, instead of brakes.
    pub drive_hold: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Parameters of SBL; `max_milestones` is the work budget of the whole request.
    pub sbl: SblOptions,
    /// Parameters of smoothing.
    pub smooth: SmoothOptions,
}

impl StepRequest {
    /// A request with the defaults: automatic planner, FootFall's lift of 0.20 m for a robot of
    /// scale 1, the margin rule of the robot.
    pub fn new(leg: LegId, target: Target, scale: f64) -> StepRequest {
        StepRequest {
            leg,
            target,
            planner: Planner::Auto,
            lift: 0.20 * scale,
            environment_tolerance: None,
            pair_tolerance: None,
            transit_only: false,
            preference: Preference::Regular,
            friction: 0.7,
            buffers: Buffers::default(),
            edges: EdgeRule::Certified,
            cell: 0.20 * scale,
            may_shift: true,
            preload: true,
            drive_hold: false,
            seed: 1,
            sbl: SblOptions::default(),
            smooth: SmoothOptions::default(),
        }
    }
}

/// How planning ended. All but `Found` come without a plan that may be offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// A step that passed the final check.
    Found,
    /// No path within the work budget; there may be one.
    NoPath,
    /// The wheel cannot be put down there.
    Unreachable,
    /// The wheel can be put down, but not lifted off or brought in from above.
    NoLift,
    /// The rover would not be stable enough with the leg lifted.
    Unstable,
    /// The start or every way to put the wheel down collides or is nearer than a tolerance.
    Colliding,
    /// The ground there is unknown.
    UnknownGround,
    /// A path was found, but the final check refuses it.
    Refused,
    /// The deadline came first.
    Deadline,
    /// Cancelled.
    Cancelled,
}

impl Outcome {
    /// The word used at every interface.
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Found => "found",
            Outcome::NoPath => "no_path",
            Outcome::Unreachable => "unreachable",
            Outcome::NoLift => "no_lift",
            Outcome::Unstable => "unstable",
            Outcome::Colliding => "colliding",
            Outcome::UnknownGround => "unknown_ground",
            Outcome::Refused => "refused",
            Outcome::Deadline => "deadline",
            Outcome::Cancelled => "cancelled",
        }
    }
}

/// Part of a step (F75).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The body moves over its feet.
    Shift,
    /// From the ground up to the lift waypoint.
    Lift,
    /// From waypoint to waypoint.
    Transit,
    /// Down to the goal.
    Drop,
    /// Pressed to the predicted load.
    Preload,
}

impl Phase {
    /// The word used at every interface.
    pub fn word(self) -> &'static str {
        match self {
            Phase::Shift => "shift",
            Phase::Lift => "lift",
            Phase::Transit => "transit",
            Phase::Drop => "drop",
            Phase::Preload => "preload",
        }
    }
}

/// A knot of the step; motion between knots is linear in the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Waypoint {
    /// Joint angles of the stepping leg (rad).
    pub angles: LegAngles,
    /// The phase that ends here; for the first waypoint the one that begins.
    pub phase: Phase,
    /// Time from the start of the step (s).
    pub time: f64,
    /// The whole robot here, where the body is being shifted.
    pub stance: Option<Configuration>,
    /// May the robot be held here for as long as one likes?
    pub hold: bool,
}

/// What is in the way, in the words of the wire.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint {
    /// `reach`, `joint_limits`, `ground`, `unknown_ground`, `clearance`, `stability` or `search`.
    pub name: &'static str,
    /// How much is missing, in `unit`.
    pub missing: Option<f64>,
    /// `m` or `rad`.
    pub unit: &'static str,
}

/// Where the wheel will stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footfall {
    /// Where it touches the ground, in `world` (m).
    pub contact: Point3<f64>,
    /// Normal of the ground's patch.
    pub normal: Unit<Vector3<f64>>,
    /// Pose of the wheel.
    pub world_from_wheel: Isometry3<f64>,
}

/// What a check found.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the check: a stable word.
    pub check: &'static str,
    /// Passed?
    pub ok: bool,
    /// What is to spare (m, rad, or share of a limit, as `detail` says); negative if it failed.
    pub margin: Option<f64>,
    /// Where on the way or on the robot.
    pub place: String,
    /// In a sentence.
    pub detail: String,
}

impl Finding {
    /// The check of ground that nobody has seen, below the leg.
    pub const UNKNOWN_GROUND: &str = "unknown_ground";

    /// Does it hold on an assumption, which its detail tells?
    pub fn is_assumption(&self) -> bool {
        self.ok && self.check == Finding::UNKNOWN_GROUND
    }
}

/// Work done and lengths reached.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Statistics {
    /// Configurations checked by search and smoothing.
    pub n_checked: u64,
    /// Milestones made by SBL.
    pub n_milestones: usize,
    /// Ways to put the wheel down that were tried.
    pub n_touchdowns: usize,
    /// Euclidean length of the first transit found (rad).
    pub first_path: f64,
    /// ... after smoothing (rad).
    pub length: f64,
    /// ... of the straight line in joint space (rad).
    pub straight: f64,
    /// What found the first path.
    pub planner: Option<PathPlanner>,
    /// Edges asked for by search and smoothing.
    pub n_edges: u64,
    /// Every piece of the motion is certified.
    pub certified: bool,
}

/// The answer to a request for a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepAnswer {
    /// How it ended.
    pub outcome: Outcome,
    /// Why, in a sentence with figures.
    pub reason: String,
    /// The knots; empty without a path. A refused path is kept so that it can be looked at.
    pub waypoints: Vec<Waypoint>,
    /// Where the wheel will stand.
    pub footfall: Option<Footfall>,
    /// What the final check found.
    pub findings: Vec<Finding>,
    /// Regular stability margin (m) along the step: (time in s, margin).
    pub margins: Vec<(f64, f64)>,
    /// All legs on the ground at the start, with their contacts in `world` (m); empty without a path.
    pub on_ground: Vec<(LegId, Point3<f64>)>,
    /// The legs that stand while this one moves, likewise.
    pub standing: Vec<(LegId, Point3<f64>)>,
    /// Work done.
    pub statistics: Statistics,
    /// Without a plan: what is in the way.
    pub constraint: Option<Constraint>,
    /// Without a plan: the nearest ground found where the wheel could be put down and lifted.
    pub nearest: Option<Point3<f64>>,
    /// Load that the wheel is pressed to (N).
    pub preload: Option<f64>,
}
