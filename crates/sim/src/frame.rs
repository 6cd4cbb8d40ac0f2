//! What the rover reports.

use nalgebra::{Point3, Vector3};
use rover::{Configuration, LegAngles};

use crate::command::Operating;

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
    /// Force of the ground on the wheel, in `world` (N): the share of springs of each leg's own stiffness
    /// over the wheels that stand, more for one that is pressed deeper into the ground than the others; zero for
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
    /// Its mode of operation.
    pub operating: Operating,
    /// The wheels.
    pub wheels: Vec<WheelFrame>,
}

/// A wheel and its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelFrame {
    /// Is its brake on?
    pub brake: bool,
    /// Spin since the beginning (rad), positive ahead along its heading.
    pub spin: f64,
    /// Spin per second (rad/s).
    pub spin_rate: f64,
    /// Where it heads, counter-clockwise from x of the base in plan (rad), from -π to π; none for a
    /// ball, and for a wheel that lies on its side.
    pub heading: Option<f64>,
}

/// Progress of the command under way.
#[derive(Debug, Clone, PartialEq)]
pub struct Executing {
    /// The command.
    pub id: String,
    /// Share of its time that has passed, 0 to 1; of a sequence each step counts alike.
    pub progress: f64,
    /// Of a sequence: the step under way, from 1, and how many there are.
    pub step: Option<[usize; 2]>,
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
