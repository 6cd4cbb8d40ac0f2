//! The rover on board: takes commands, executes one at a time, guards itself.

use collision::{Scene, survey};
use rover::{Configuration, LegId, Posture, Wrench, hold_torques};
use stability::{spring_share, support_polygon};

use crate::command::{
    Command, ID_LENGTH_MAX, Motion, Refusal, check_basis, check_knots, leg_named,
};
use crate::frame::{Event, Executing, Frame, Mode, Stage};
use crate::guard::{Guard, LOOK, predict_support, touched};
use crate::line::wheel_line;
use crate::memory::Memory;
use crate::path::TimedPath;
use crate::stand::{Foot, feet, foot, standing};

/// How much of an identity that is too long is told back (characters).
const ID_SHOWN: usize = 32;

/// Why a rover cannot be put down in a configuration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum StandError {
    #[error("the configuration has {n_legs} legs, but the robot has {expected}")]
    LegCount { n_legs: usize, expected: usize },
    #[error("the configuration holds a number that is not finite")]
    NotFinite,
    #[error("gravity is {gravity} m/s²; it must be finite and above zero")]
    Gravity { gravity: f64 },
    #[error("{link} would be in {what}")]
    Collides { link: String, what: String },
    #[error("{n_standing} wheels stand on the ground, and 3 are needed")]
    TooFewFeet { n_standing: usize },
    #[error("the center of mass is {outside:.2} m outside the support of the standing wheels")]
    Unsupported { outside: f64 },
}

/// Why a rover was not put elsewhere.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReseatError {
    /// Only an idle rover is moved.
    #[error("the rover is not idle; wait for the end of its command and release any stop")]
    NotIdle,
    /// It would not stand there.
    #[error(transparent)]
    Stand(#[from] StandError),
}

/// The simulated rover.
///
/// Commands, stops and releases take effect at the present time on board; time goes on in
/// [`advance`](Self::advance) only. Whatever happens to them is told by [`Event`]s.
#[derive(Clone)]
pub struct SimRover {
    scene: Scene,
    gravity: f64,
    time_s: f64,
    configuration: Configuration,
    posture: Posture,
    feet: Vec<Foot>,
    mode: Mode,
    execution: Option<Execution>,
    fault: Option<String>,
    memory: Memory,
    events: Vec<Event>,
}

/// The command under way.
#[derive(Debug, Clone)]
struct Execution {
    id: String,
    leg: LegId,
    path: TimedPath,
    elapsed: f64,
}

impl SimRover {
    /// A rover that stands on the ground of `scene` in `configuration` (see [`crate::settle`]),
    /// idle, under `gravity` (m/s², along -z of `world`). Payloads are the scene's robot's.
    pub fn new(
        scene: Scene,
        configuration: Configuration,
        gravity: f64,
    ) -> Result<SimRover, StandError> {
        if !(gravity.is_finite() && gravity > 0.0) {
            return Err(StandError::Gravity { gravity });
        }
        let (posture, feet) = stand(&scene, &configuration)?;
        Ok(SimRover {
            scene,
            gravity,
            time_s: 0.0,
            configuration,
            posture,
            feet,
            mode: Mode::Idle,
            execution: None,
            fault: None,
            memory: Memory::default(),
            events: Vec::new(),
        })
    }

    /// Puts the rover elsewhere, perhaps on other ground or with another payload: only while it is
    /// idle, and only where it stands. Time and remembered commands stay.
    pub fn reseat(
        &mut self,
        scene: Scene,
        configuration: Configuration,
    ) -> Result<(), ReseatError> {
        if self.mode != Mode::Idle {
            return Err(ReseatError::NotIdle);
        }
        (self.posture, self.feet) = stand(&scene, &configuration)?;
        (self.scene, self.configuration) = (scene, configuration);
        Ok(())
    }

    /// The scene that the rover is in.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Base pose and joint angles now.
    pub fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// What the rover is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Time on board (s), from zero at construction.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Takes a command. It is refused or begins at once.
    pub fn command(&mut self, command: Command) {
        let Command { id, motion, basis } = command;
        if !self.receive(&id) {
            return;
        }
        if motion == Motion::Stop {
            self.abort("a stop command");
            self.tell(&id, Stage::Completed, None);
            return;
        }
        let checked = self.check_ready().and_then(|()| {
            if let Some(basis) = &basis {
                check_basis(self.scene.robot(), basis, &self.configuration.legs)?;
            }
            self.plan(&motion)
        });
        match checked {
            Ok((leg, path)) => {
                self.tell(&id, Stage::Started, None);
                self.mode = Mode::Executing;
                self.execution = Some(Execution { id, leg, path, elapsed: 0.0 });
            }
            Err(refusal) => self.tell(&id, Stage::Rejected, Some(refusal.to_string())),
        }
    }

    /// Stops at once and refuses motion until released. Never refused, however often it comes.
    pub fn estop(&mut self, id: &str) {
        self.tell(id, Stage::Received, None);
        self.abort("an E-stop");
        self.mode = Mode::Stopped;
        self.tell(id, Stage::Completed, None);
    }

    /// Ends an E-stop and clears a fault. Each identity counts once, so that a release that
    /// arrives twice does not end a later stop.
    pub fn release(&mut self, id: &str) {
        if !self.receive(id) {
            return;
        }
        let stopped = matches!(self.mode, Mode::Stopped | Mode::Fault);
        if stopped {
            self.mode = Mode::Idle;
            self.fault = None;
        }
        let detail = (!stopped).then(|| "no stop was in force".to_owned());
        self.tell(id, Stage::Completed, detail);
    }

    /// Goes on by `dt_s` (s). A `dt_s` that is not a number above zero changes nothing.
    pub fn advance(&mut self, dt_s: f64) {
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return;
        }
        let end = self.time_s + dt_s;
        if let Some(execution) = self.execution.take() {
            self.execute(execution, end);
        }
        self.time_s = end;
    }

    /// What happened since the last call, in order.
    pub fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    /// The rover as it is now.
    pub fn frame(&self) -> Frame {
        let robot = self.scene.robot();
        let standing = standing(&self.feet);
        let contacts: Vec<_> = standing.iter().map(|(_, contact)| *contact).collect();
        let com = self.posture.center_of_mass(robot);
        let shares = spring_share(&contacts, &com, robot.mass() * self.gravity);
        let mut wheel_forces = vec![nalgebra::Vector3::zeros(); self.feet.len()];
        for ((leg, _), share) in standing.iter().zip(shares.iter().flatten()) {
            wheel_forces[leg.0].z = *share;
        }
        let torques = |leg: LegId| {
            let foot = &self.feet[leg.0];
            let wrench = Wrench { point: foot.point, force: wheel_forces[leg.0] };
            let ground = foot.stands.then_some(&wrench);
            hold_torques(robot, &self.posture, leg, self.gravity, ground)
        };
        Frame {
            time_s: self.time_s,
            configuration: self.configuration.clone(),
            contacts: self.feet.iter().map(|foot| foot.stands).collect(),
            contact_points: self.feet.iter().map(|foot| foot.point).collect(),
            joint_torques: robot.leg_ids().map(torques).collect(),
            wheel_forces,
            mode: self.mode,
            executing: self.execution.as_ref().map(Execution::progress),
            fault: self.fault.clone(),
        }
    }

    /// Moves the leg until `end` (time on board, s) or the path's, looking where it goes.
    fn execute(&mut self, mut execution: Execution, end: f64) {
        let (leg, duration) = (execution.leg, execution.path.duration());
        let started = self.time_s - execution.elapsed;
        let until = (end - started).min(duration);
        let scene = self.scene.clone();
        let feet = self.feet.clone();
        let guard = Guard::new(&scene, &self.posture, &feet, leg, &execution.path.goal());
        let step = LOOK / scene.robot().motion().joint_speed;
        let mut met = None;
        while execution.elapsed < until && met.is_none() {
            let next = (execution.elapsed + step).min(until);
            let angles = execution.path.at(next);
            let moved = self.posture.with_leg(scene.robot(), leg, &angles);
            met = guard.look(&moved);
            if met.is_none() {
                self.posture = moved;
                self.configuration.legs[leg.0] = angles;
                execution.elapsed = next;
            }
        }
        self.feet[leg.0] = foot(&scene, &self.posture, leg);
        self.time_s = started + execution.elapsed;
        if let Some(fault) = met {
            self.mode = Mode::Fault;
            self.fault = Some(fault.to_string());
            self.tell(&execution.id, Stage::Failed, self.fault.clone());
        } else if execution.elapsed >= duration {
            self.mode = Mode::Idle;
            self.tell(&execution.id, Stage::Completed, None);
        } else {
            self.execution = Some(execution);
        }
    }

    /// Takes note of an identity; false for one that is not to be acted on: a copy of what was
    /// received before, whatever came of that, or one too long to be remembered.
    fn receive(&mut self, id: &str) -> bool {
        let bytes = id.len();
        if bytes == 0 || bytes > ID_LENGTH_MAX {
            let shown: String = id.chars().take(ID_SHOWN).collect();
            self.tell(&shown, Stage::Rejected, Some(Refusal::IdLength { bytes }.to_string()));
            return false;
        }
        if self.memory.holds(id) {
            let detail = "a copy of what was received before: refused, for each counts once";
            self.tell(id, Stage::Received, Some(detail.into()));
            return false;
        }
        self.memory.keep(id);
        self.tell(id, Stage::Received, None);
        true
    }

    fn check_ready(&self) -> Result<(), Refusal> {
        match (self.mode, &self.execution) {
            (Mode::Stopped, _) => Err(Refusal::Stopped),
            (Mode::Fault, _) => {
                Err(Refusal::Faulted { fault: self.fault.clone().unwrap_or_default() })
            }
            (_, Some(execution)) => Err(Refusal::Busy { id: execution.id.clone() }),
            (Mode::Idle | Mode::Executing, None) => Ok(()),
        }
    }

    /// The timed path of a motion, checked.
    fn plan(&self, motion: &Motion) -> Result<(LegId, TimedPath), Refusal> {
        let robot = self.scene.robot();
        let (leg, knots) = match motion {
            Motion::JointPath { leg, knots } => {
                let leg = leg_named(robot, leg)?;
                let present = &self.configuration.legs[leg.0];
                check_knots(robot, leg, knots, present)?;
                (leg, std::iter::once(present).chain(knots).copied().collect())
            }
            Motion::WheelLine { leg, center } => {
                let leg = leg_named(robot, leg)?;
                let present = &self.configuration.legs[leg.0];
                (leg, wheel_line(robot, &self.posture, leg, present, center)?)
            }
            Motion::Stop => unreachable!("a stop has no path"),
        };
        let path = TimedPath::new(knots, robot.motion().joint_speed);
        predict_support(&self.scene, &self.posture, &self.feet, leg, &path)?;
        Ok((leg, path))
    }

    fn abort(&mut self, by: &str) {
        if let Some(execution) = self.execution.take() {
            self.mode = Mode::Idle;
            let percent = 100.0 * execution.progress().progress;
            let detail = format!("ended by {by} after {percent:.0} % of its time");
            self.tell(&execution.id, Stage::Aborted, Some(detail));
        }
    }

    fn tell(&mut self, id: &str, stage: Stage, detail: Option<String>) {
        self.events.push(Event { time_s: self.time_s, id: id.to_owned(), stage, detail });
    }
}

impl Execution {
    fn progress(&self) -> Executing {
        let duration = self.path.duration();
        let progress = if duration > 0.0 { self.elapsed / duration } else { 1.0 };
        Executing { id: self.id.clone(), progress }
    }
}

/// The posture and the wheels of a configuration that stands.
fn stand(scene: &Scene, configuration: &Configuration) -> Result<(Posture, Vec<Foot>), StandError> {
    let robot = scene.robot();
    let (n_legs, expected) = (configuration.legs.len(), robot.legs().len());
    if n_legs != expected {
        return Err(StandError::LegCount { n_legs, expected });
    }
    let base = &configuration.world_from_base;
    let numbers = base.translation.vector.iter().chain(base.rotation.coords.iter());
    let angles = configuration.legs.iter().flat_map(|leg| leg.iter());
    if !numbers.chain(angles).all(|v| v.is_finite()) {
        return Err(StandError::NotFinite);
    }
    let posture = Posture::new(robot, configuration);
    let feet = feet(scene, &posture);
    let contacts: Vec<_> = standing(&feet).into_iter().map(|(_, contact)| contact).collect();
    let Ok(support) = support_polygon::regular(&contacts) else {
        return Err(StandError::TooFewFeet { n_standing: contacts.len() });
    };
    let depth = support.depth_of(posture.center_of_mass(robot).xy());
    if depth < 0.0 {
        return Err(StandError::Unsupported { outside: -depth });
    }
    let seen = survey(scene, &posture);
    if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
        let (link, what) = touched(robot, pair.touch);
        return Err(StandError::Collides { link, what });
    }
    Ok((posture, feet))
}
