//! The rover on board: takes commands, executes one at a time, guards itself.

use collision::{Scene, survey};
use rover::{Configuration, LegAngles, LegId, Posture, Wrench, hold_torques};
use stability::support_polygon;

use crate::closure::Closure;
use crate::command::{
    BODY_KNOTS_MAX, BodyKnot, Command, ID_LENGTH_MAX, KNOTS_MAX, Motion, Refusal, WheelHold,
    body_knots, check_basis, check_count, check_knots, leg_named, times_of_pieces,
};
use crate::frame::{Event, Executing, Frame, Mode, Stage};
use crate::guard::{Fault, Guard, LOOK, look_at_shift, predict_shift, predict_support, touched};
use crate::line::wheel_line;
use crate::memory::Memory;
use crate::path::TimedPath;
use crate::stand::{Foot, feet, foot, loads, standing};

/// How much of an identity that is too long is told back (characters).
const ID_SHOWN: usize = 32;

/// Time between two looks for a stance with margin, once the ground is silent (s).
const SAFE_LOOK_S: f64 = 0.05;

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
    /// The highest authority seen.
    epoch: Option<u64>,
    /// How long the ground may be silent while the rover moves (s); for ever where absent.
    silence_max_s: Option<f64>,
    /// Time on board at which the ground was heard last.
    heard_s: f64,
    events: Vec<Event>,
}

/// The command under way.
#[derive(Debug, Clone)]
struct Execution {
    id: String,
    moving: Moving,
    path: TimedPath,
    elapsed: f64,
}

/// What moves.
#[derive(Debug, Clone)]
enum Moving {
    /// One leg; the base stays.
    Leg(LegId),
    /// Several legs; the base stays over these wheels.
    Body(Closure),
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
            Ok((moving, path)) => {
                self.tell(&id, Stage::Started, None);
                self.mode = Mode::Executing;
                self.execution = Some(Execution { id, moving, path, elapsed: 0.0 });
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

    /// Goes on by `dt_s` (s). A `dt_s` that is not a number above zero changes nothing.
    pub fn advance(&mut self, dt_s: f64) {
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return;
        }
        let end = self.time_s + dt_s;
        let silent_s = self.silence_max_s.map_or(f64::INFINITY, |most| self.heard_s + most);
        if let Some(execution) = self.execution.take() {
            self.execute(execution, end.min(silent_s.max(self.time_s)));
        }
        if self.execution.is_some() && end >= silent_s {
            self.time_s = self.time_s.max(silent_s.min(end));
            self.make_safe(end);
        }
        self.time_s = end;
    }

    /// The ground is silent: stops as soon as the stance has its margin, and holds. Until then the
    /// motion goes on, which was checked to its end; where it never has, the motion ends.
    fn make_safe(&mut self, end: f64) {
        let step = SAFE_LOOK_S;
        while !self.stands_with_margin() {
            let Some(execution) = self.execution.take() else { return };
            if self.time_s >= end {
                self.execution = Some(execution);
                return;
            }
            let until = (self.time_s + step).min(end);
            self.execute(execution, until);
        }
        if let Some(execution) = self.execution.take() {
            let most = self.silence_max_s.unwrap_or_default();
            let fault = Fault::GroundSilent { silence_s: most }.to_string();
            self.mode = Mode::Fault;
            self.tell(&execution.id, Stage::Aborted, Some(fault.clone()));
            self.fault = Some(fault);
        }
    }

    /// Is the regular margin at least what the margin rule asks?
    fn stands_with_margin(&self) -> bool {
        let contacts: Vec<_> = standing(&self.feet).into_iter().map(|(_, at)| at).collect();
        let com = self.posture.center_of_mass(self.scene.robot());
        support_polygon::regular(&contacts)
            .is_ok_and(|support| support.depth_of(com.xy()) >= self.scene.robot().stance().margin)
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
        }
    }

    /// Moves until `end` (time on board, s) or the path's, looking where it goes.
    fn execute(&mut self, mut execution: Execution, end: f64) {
        let duration = execution.path.duration();
        let started = self.time_s - execution.elapsed;
        let until = (end - started).min(duration);
        let met = match execution.moving.clone() {
            Moving::Leg(leg) => self.move_leg(&mut execution, leg, until),
            Moving::Body(closure) => self.move_body(&mut execution, &closure, until),
        };
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

    /// Moves one leg until `until` (s after the start), or to the last look at which all was well.
    fn move_leg(&mut self, execution: &mut Execution, leg: LegId, until: f64) -> Option<Fault> {
        let scene = self.scene.clone();
        let feet = self.feet.clone();
        let guard = Guard::new(&scene, &self.posture, &feet, leg, &execution.path.goal()[0]);
        let mut met = None;
        while met.is_none()
            && let Some(next) = execution.next_look(&scene, until)
        {
            let angles = execution.path.at(next)[0];
            let moved = self.posture.with_leg(scene.robot(), leg, &angles);
            met = guard.look(&moved);
            if met.is_none() {
                self.posture = moved;
                self.configuration.legs[leg.0] = angles;
                execution.elapsed = next;
            }
        }
        self.feet[leg.0] = foot(&scene, &self.posture, leg);
        met
    }

    /// As [`move_leg`](Self::move_leg) for all legs of the path, the base over its wheels.
    fn move_body(
        &mut self,
        execution: &mut Execution,
        closure: &Closure,
        until: f64,
    ) -> Option<Fault> {
        let mut met = None;
        while met.is_none()
            && let Some(next) = execution.next_look(&self.scene, until)
        {
            let angles = execution.path.at(next);
            let legs = execution.path.applied(&self.configuration.legs, &angles);
            let fit = closure.fit(self.scene.robot(), legs);
            met = look_at_shift(&self.scene, closure, &fit);
            if met.is_none() {
                (self.configuration, self.posture) = (fit.configuration, fit.posture);
                execution.elapsed = next;
            }
        }
        self.feet = feet(&self.scene, &self.posture);
        met
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
    fn plan(&self, motion: &Motion) -> Result<(Moving, TimedPath), Refusal> {
        let robot = self.scene.robot();
        let (leg, knots, times) = match motion {
            Motion::JointPath { leg, knots } => {
                let leg = leg_named(robot, leg)?;
                check_count(knots.len(), KNOTS_MAX)?;
                let times = times_of_pieces(knots.iter().map(|knot| knot.time_s))?;
                let knots: Vec<_> = knots.iter().map(|knot| vec![knot.angles]).collect();
                check_knots(robot, &[leg], &knots, &[self.configuration.legs[leg.0]])?;
                (leg, knots, times)
            }
            Motion::WheelLine { leg, center } => {
                let leg = leg_named(robot, leg)?;
                let present = &self.configuration.legs[leg.0];
                let knots = wheel_line(robot, &self.posture, leg, present, center)?;
                let times = vec![0.0; knots.len()];
                (leg, knots.into_iter().map(|angles| vec![angles]).collect(), times)
            }
            Motion::BodyPath { knots, hold } => return self.plan_shift(knots, *hold),
            Motion::Stop => unreachable!("a stop has no path"),
        };
        let path = self.timed(vec![leg], knots, &times);
        predict_support(&self.scene, &self.posture, &self.feet, leg, &path)?;
        Ok((Moving::Leg(leg), path))
    }

    fn plan_shift(
        &self,
        knots: &[BodyKnot],
        hold: WheelHold,
    ) -> Result<(Moving, TimedPath), Refusal> {
        let robot = self.scene.robot();
        check_count(knots.len(), BODY_KNOTS_MAX)?;
        let times = times_of_pieces(knots.iter().map(|knot| knot.time_s))?;
        let standing: Vec<LegId> = standing(&self.feet).into_iter().map(|(leg, _)| leg).collect();
        let (legs, stances) = body_knots(robot, knots, &standing)?;
        let all = &self.configuration.legs;
        let present: Vec<_> = legs.iter().map(|leg| all[leg.0]).collect();
        check_knots(robot, &legs, &stances, &present)?;
        let path = self.timed(legs, stances, &times);
        let closure = Closure::new(robot, &self.posture, &standing, hold);
        predict_shift(&self.scene, &closure, &self.feet, all, &path)?;
        Ok((Moving::Body(closure), path))
    }

    /// The path of these legs from where they are through the knots.
    fn timed(&self, legs: Vec<LegId>, knots: Vec<Vec<LegAngles>>, times: &[f64]) -> TimedPath {
        let present = legs.iter().map(|leg| self.configuration.legs[leg.0]).collect();
        let knots = std::iter::once(present).chain(knots).collect();
        TimedPath::new(legs, knots, times, self.scene.robot().motion().joint_speed)
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
    /// When to look next, no later than `until`: a look's way further, or where nothing moves at
    /// its end. `None` at `until`.
    fn next_look(&self, scene: &Scene, until: f64) -> Option<f64> {
        if self.elapsed >= until {
            return None;
        }
        let step = LOOK / scene.robot().motion().joint_speed;
        let passed = self.path.length_at(self.elapsed);
        let mut next = self.elapsed + step;
        // No joint is faster than the joint speed: one step more is at most one look more.
        while next < until && self.path.length_at(next + step) - passed <= LOOK {
            next += step;
        }
        Some(next.min(until))
    }

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
