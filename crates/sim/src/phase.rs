//! What a command is made of: phases, one after another.

use std::collections::VecDeque;

use collision::Scene;
use rover::LegId;

use crate::arc::Ramped;
use crate::closure::Closure;
use crate::command::{Operating, Step};
use crate::drive::Track;
use crate::frame::Executing;
use crate::guard::LOOK;
use crate::path::TimedPath;

/// How long brakes and modes take (s).
pub(crate) const SWITCH_S: f64 = 0.5;

/// A part of a motion.
#[derive(Debug, Clone)]
pub(crate) enum Phase {
    /// One leg moves; the base stays.
    Leg(LegId, TimedPath),
    /// Several legs move; the base stays over these wheels.
    Body(Closure, TimedPath),
    /// All legs move so that wheels turn in place; the base stays.
    Steer(TimedPath),
    /// All wheels roll.
    Drive(Track),
    /// A wheel rolls in the air: from this spin on by so much (rad).
    Roll { leg: LegId, from: f64, by: f64, ramped: Ramped },
    /// Nothing moves; at the end something is switched.
    Switch(Switch),
}

/// What is switched.
#[derive(Debug, Clone)]
pub(crate) enum Switch {
    /// The brakes of these wheels.
    Brakes { legs: Vec<LegId>, on: bool },
    /// The mode of operation.
    Mode(Operating),
}

impl Phase {
    /// How long it takes (s).
    pub fn duration(&self) -> f64 {
        match self {
            Phase::Leg(_, path) | Phase::Body(_, path) | Phase::Steer(path) => path.duration(),
            Phase::Drive(track) => track.duration(),
            Phase::Roll { ramped, .. } => ramped.duration(),
            Phase::Switch(_) => SWITCH_S,
        }
    }

    /// When to look next after `elapsed` (s), no later than `until`: a look's way further, or where
    /// nothing moves at its end. `None` at `until`.
    pub fn next_look(&self, scene: &Scene, elapsed: f64, until: f64) -> Option<f64> {
        if elapsed >= until {
            return None;
        }
        let (step, most) = match self {
            Phase::Leg(..) | Phase::Body(..) | Phase::Steer(_) => {
                (LOOK / scene.robot().motion().joint_speed, LOOK)
            }
            Phase::Drive(track) => {
                let look = 1.0 / track.n_looks() as f64;
                (0.1 * track.duration() * look, look)
            }
            Phase::Roll { .. } | Phase::Switch(_) => return Some(until),
        };
        let way = |t: f64| match self {
            Phase::Leg(_, path) | Phase::Body(_, path) | Phase::Steer(path) => path.length_at(t),
            Phase::Drive(track) => track.share_at(t),
            Phase::Roll { .. } | Phase::Switch(_) => t,
        };
        let passed = way(elapsed);
        let mut next = elapsed + step;
        // No joint is faster than the joint speed: one step more is at most one look more.
        while next < until && way(next + step) - passed <= most {
            next += step;
        }
        Some(next.min(until))
    }
}

/// The command under way.
#[derive(Debug, Clone)]
pub(crate) struct Execution {
    pub id: String,
    /// The phase under way and those after it.
    pub phases: VecDeque<Phase>,
    /// Time in the phase under way (s).
    pub elapsed: f64,
    /// Time of the phases that have passed of this step (s).
    pub passed: f64,
    /// Time that all phases of this step take (s).
    pub total: f64,
    /// The steps after this one.
    pub rest: VecDeque<Step>,
    /// The step under way, from 1.
    pub step: usize,
    /// How many steps it was told to take: zero for a command that is no sequence.
    pub n_steps: usize,
    /// The rest was cancelled.
    pub cut: bool,
}

impl Execution {
    /// A command whose first phases are these.
    pub fn new(id: String, phases: VecDeque<Phase>) -> Execution {
        let total = phases.iter().map(Phase::duration).sum();
        Execution {
            id,
            phases,
            elapsed: 0.0,
            passed: 0.0,
            total,
            rest: VecDeque::new(),
            step: 1,
            n_steps: 0,
            cut: false,
        }
    }

    /// Goes on to the next step, which has these phases.
    pub fn next_step(&mut self, phases: VecDeque<Phase>) {
        self.total = phases.iter().map(Phase::duration).sum();
        (self.phases, self.passed, self.elapsed) = (phases, 0.0, 0.0);
        self.step += 1;
    }

    /// How far it is.
    pub fn progress(&self) -> Executing {
        let share = if self.total > 0.0 { (self.passed + self.elapsed) / self.total } else { 1.0 };
        let is_sequence = self.n_steps > 1;
        let progress = if is_sequence {
            ((self.step - 1) as f64 + share) / self.n_steps as f64
        } else {
            share
        };
        let step = is_sequence.then_some([self.step, self.n_steps]);
        Executing { id: self.id.clone(), progress: progress.clamp(0.0, 1.0), step }
    }

    /// Begins a text about the step under way.
    pub fn of_step(&self, text: &str) -> String {
        if self.n_steps < 2 {
            return text.to_owned();
        }
        let left = self.n_steps - self.step;
        let rest = match left {
            0 => String::new(),
            1 => format!("; step {} was not begun", self.n_steps),
            _ => format!("; steps {} to {} were not begun", self.step + 1, self.n_steps),
        };
        format!("step {} of {}: {text}{rest}", self.step, self.n_steps)
    }
}
