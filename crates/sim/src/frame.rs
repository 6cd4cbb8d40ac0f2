//! What the rover reports.

use nalgebra::{Point3, Vector3};
use rover::{Configuration, LegAngles};

/// What the rover is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Stands still and takes commands.
    Idle,
    /// Executes a command.
    Executing,
    /// Stopped by an E-stop; refuses motion until released.
    Stopped,
    /// A fault stopped it; refuses motion until released.
    Fault,
}

/// The rover at one instant. Lists are by leg.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Time on board (s), from zero at construction.
    pub time_s: f64,
    /// Pose of the base and joint angles.
    pub configuration: Configuration,
    /// Does the wheel stand: is its gap to the ground within the robot's ground tolerance?
    pub contacts: Vec<bool>,
    /// The wheel's point that is nearest to the ground; of a standing wheel the middle of its
    /// contact, in `world` (m).
    pub contact_points: Vec<Point3<f64>>,
    /// Force of the ground on the wheel, in `world` (N): the share of equal springs over the wheels
    /// that stand, more for one that is pressed deeper into the ground than the others; zero for
    /// wheels that do not stand.
    pub wheel_forces: Vec<Vector3<f64>>,
    /// Joint torques (N m) that hold the robot under these forces, from the hip outward.
    pub joint_torques: Vec<LegAngles>,
    /// What the rover is doing.
    pub mode: Mode,
    /// The command under way.
    pub executing: Option<Executing>,
    /// Why the rover stopped itself, until it is released.
    pub fault: Option<String>,
}

/// Progress of the command under way.
#[derive(Debug, Clone, PartialEq)]
pub struct Executing {
    /// The command.
    pub id: String,
    /// Share of its time that has passed, 0 to 1.
    pub progress: f64,
}

/// What the rover says of a command, stop or release.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Time on board (s).
    pub time_s: f64,
    /// Identity of the command, stop or release.
    pub id: String,
    /// What happened.
    pub stage: Stage,
    /// Why, where there is something to say.
    pub detail: Option<String>,
}

/// What happened to a command, stop or release.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Arrived and understood. A copy of what was received before says this again, with a detail,
    /// and nothing follows: it is refused, but `Rejected` would belie the first one, which may be
    /// under way or done.
    Received,
    /// Refused; nothing has moved.
    Rejected,
    /// Motion has begun.
    Started,
    /// Ended as commanded.
    Completed,
    /// Ended by a fault.
    Failed,
    /// Ended by a stop or E-stop.
    Aborted,
}
