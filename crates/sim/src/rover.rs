//! The rover on board: takes commands, executes one at a time, guards itself.

mod execute;
mod plan;

use std::collections::VecDeque;

use collision::{Scene, survey};
use rover::{Configuration, LegId, Posture, Wrench, hold_torques};
use stability::support_polygon;

use crate::command::{Basis, Command, ID_LENGTH_MAX, Motion, Operating, Step, check_basis};
use crate::frame::{Event, Frame, Mode, Stage, WheelFrame};
use crate::guard::touched;
use crate::memory::Memory;
use crate::phase::Execution;
use crate::refusal::Refusal;
use crate::stand::{Foot, feet, loads, standing};
use crate::steer::{base_heading, heading_of, wrapped};

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
    /// The hold that waits for a stance with its margin.
    holding: Option<String>,
    fault: Option<String>,
    operating: Operating,
    /// By leg.
    wheels: Vec<Wheel>,
    memory: Memory,
    /// The highest authority seen.
    epoch: Option<u64>,
    /// How long the ground may be silent while the rover moves (s); for ever where absent.
    silence_max_s: Option<f64>,
    /// Time on board at which the ground was heard last.
    heard_s: f64,
    events: Vec<Event>,
}

/// A wheel and its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Wheel {
    brake: bool,
    /// Spin since the beginning (rad).
    spin: f64,
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
        let wheels = vec![Wheel { brake: true, spin: 0.0 }; feet.len()];
        Ok(SimRover {
            scene,
            gravity,
            time_s: 0.0,
            configuration,
            posture,
            feet,
            mode: Mode::Idle,
            execution: None,
            holding: None,
            fault: None,
            operating: Operating::default(),
            wheels,
            memory: Memory::default(),
            epoch: None,
            silence_max_s: None,
            heard_s: 0.0,
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
        let Command { id, motion, basis, epoch } = command;
        if !self.admit(&id, epoch) {
            return;
        }
        match motion {
            Motion::Stop => {
                self.abort("a stop command");
                self.tell(&id, Stage::Completed, None);
            }
            Motion::Hold => self.hold(id),
            Motion::CancelRest => self.cancel_rest(&id),
            motion => self.begin(id, motion, basis.as_ref()),
        }
    }

    /// Begins a motion, or refuses it.
    fn begin(&mut self, id: String, motion: Motion, basis: Option<&Basis>) {
        let checked = self.check_ready().and_then(|()| {
            if let Some(basis) = basis {
                check_basis(self.scene.robot(), basis, &self.configuration.legs)?;
            }
            let Motion::Sequence(steps) = motion else {
                return Ok(Execution::new(id.clone(), self.phases(&motion)?));
            };
            Step::check(&steps).map_err(|(_, refusal)| refusal)?;
            let mut rest = VecDeque::from(steps);
            let n_steps = rest.len();
            let first = rest.pop_front().ok_or(Refusal::StepCount { n_steps })?;
            let phases = self.step_phases(&first)?;
            Ok(Execution { rest, n_steps, ..Execution::new(id.clone(), phases) })
        });
        match checked {
            Ok(execution) => {
                self.tell(&id, Stage::Started, None);
                self.mode = Mode::Executing;
                self.execution = Some(execution);
            }
            Err(refusal) => self.tell(&id, Stage::Rejected, Some(refusal.to_string())),
        }
    }

    /// Takes note of a command that moves nothing, as one for the cameras; false if it is a copy or
    /// came under an authority that has passed on, which is told. Whoever executes it tells the rest.
    pub fn admit(&mut self, id: &str, epoch: Option<u64>) -> bool {
        if !self.receive(id) {
            return false;
        }
        if epoch < self.epoch {
            let (given, highest) = (epoch.unwrap_or(0), self.epoch.unwrap_or(0));
            let refusal = Refusal::OldAuthority { given, highest };
            self.tell(id, Stage::Rejected, Some(refusal.to_string()));
            return false;
        }
        self.epoch = epoch;
        true
    }

    /// What is under way ends as soon as the stance has its margin.
    fn hold(&mut self, id: String) {
        if let Some(before) = self.holding.replace(id.clone()) {
            let detail = "another hold has come".to_owned();
            self.tell(&before, Stage::Aborted, Some(detail));
        }
        if self.execution.is_some() {
            self.tell(&id, Stage::Started, None);
        } else {
            self.held();
        }
    }

    /// The hold that was waited for is there.
    fn held(&mut self) {
        if let Some(id) = self.holding.take() {
            self.brake_all();
            self.tell(&id, Stage::Completed, None);
        }
    }

    fn cancel_rest(&mut self, id: &str) {
        let left = self.execution.as_mut().map(|execution| {
            execution.cut = true;
            std::mem::take(&mut execution.rest).len()
        });
        let detail = match left {
            None => "nothing was under way".to_owned(),
            Some(0) => "there was no step left".to_owned(),
            Some(left) => format!("{left} steps were cancelled"),
        };
        self.tell(id, Stage::Completed, Some(detail));
    }

    fn brake_all(&mut self) {
        self.wheels.iter_mut().for_each(|wheel| wheel.brake = true);
    }

    /// Stops at once and refuses motion until released. Never refused, however often it comes.
    pub fn estop(&mut self, id: &str) {
        self.tell(id, Stage::Received, None);
        self.abort("an E-stop");
        self.brake_all();
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

    /// Takes over what the rover knew before its computer was restarted: identities received, oldest
    /// first, the highest authority seen, and the stop in force, with its fault where it was one.
    pub fn recall(
        &mut self,
        ids: impl IntoIterator<Item = String>,
        epoch: Option<u64>,
        stop: Option<Option<String>>,
    ) {
        ids.into_iter().for_each(|id| self.memory.keep(&id));
        self.epoch = self.epoch.max(epoch);
        if let Some(fault) = stop {
            self.mode = if fault.is_some() { Mode::Fault } else { Mode::Stopped };
            self.fault = fault;
        }
    }

    /// The rover is to make itself safe when it moves and has not heard the ground for this long (s).
    pub fn set_silence_max(&mut self, silence_max_s: Option<f64>) {
        self.silence_max_s = silence_max_s;
    }

    /// Something came from the ground.
    pub fn heard_ground(&mut self) {
        self.heard_s = self.time_s;
    }

    /// What happened since the last call, in order.
    pub fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    /// The rover as it is now.
    pub fn frame(&self) -> Frame {
        let robot = self.scene.robot();
        let loads = loads(robot, &self.posture, &self.feet, self.gravity);
        let wheel_forces: Vec<_> =
            loads.into_iter().map(|load| nalgebra::Vector3::new(0.0, 0.0, load)).collect();
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
            operating: self.operating,
            wheels: self.wheel_frames(),
        }
    }

    fn wheel_frames(&self) -> Vec<WheelFrame> {
        let robot = self.scene.robot();
        let rates = self.spin_rates();
        let base = base_heading(&self.configuration.world_from_base);
        let frame = |leg: LegId| {
            let pose = self.posture.wheel(robot, leg);
            let heading = heading_of(&pose).filter(|_| !pose.ball);
            WheelFrame {
                brake: self.wheels[leg.0].brake,
                spin: self.wheels[leg.0].spin,
                spin_rate: rates[leg.0],
                heading: heading.map(|heading| wrapped(heading - base)),
            }
        };
        robot.leg_ids().map(frame).collect()
    }

    /// The rover with mode of operation, brakes and spins (rad) as reported, by leg; what is missing
    /// stays as it is.
    pub fn with_wheels(mut self, operating: Operating, wheels: &[(bool, f64)]) -> SimRover {
        self.operating = operating;
        for (wheel, (brake, spin)) in self.wheels.iter_mut().zip(wheels) {
            *wheel = Wheel { brake: *brake, spin: *spin };
        }
        self
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

    pub(crate) fn check_ready(&self) -> Result<(), Refusal> {
        match (self.mode, &self.execution) {
            (Mode::Stopped, _) => Err(Refusal::Stopped),
            (Mode::Fault, _) => {
                Err(Refusal::Faulted { fault: self.fault.clone().unwrap_or_default() })
            }
            (_, Some(execution)) => Err(Refusal::Busy { id: execution.id.clone() }),
            (Mode::Idle | Mode::Executing, None) => Ok(()),
        }
    }

    fn abort(&mut self, by: &str) {
        if let Some(execution) = self.execution.take() {
            self.mode = Mode::Idle;
            let percent = 100.0 * execution.progress().progress;
            let text = format!("ended by {by} after {percent:.0} % of its time");
            let detail = execution.of_step(&text);
            self.tell(&execution.id, Stage::Aborted, Some(detail));
        }
        if let Some(hold) = self.holding.take() {
            self.tell(&hold, Stage::Aborted, Some(format!("ended by {by}")));
        }
    }

    fn tell(&mut self, id: &str, stage: Stage, detail: Option<String>) {
        self.events.push(Event { time_s: self.time_s, id: id.to_owned(), stage, detail });
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
