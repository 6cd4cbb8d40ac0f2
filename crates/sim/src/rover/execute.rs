//! Time goes on: phases are carried out and looked at.

use collision::survey;
use rover::{LegId, Posture};
use stability::support_polygon;

use super::SimRover;
use crate::closure::Closure;
use crate::command::Operating;
use crate::drive::Track;
use crate::frame::{Mode, Stage};
use crate::guard::{Fault, Guard, look_at_rolling, look_at_shift};
use crate::path::TimedPath;
use crate::phase::{Execution, Phase, Switch};
use crate::stand::{feet, foot, standing};

/// Time between two looks for a stance with margin, once one is waited for (s).
const SAFE_LOOK_S: f64 = 0.05;

impl SimRover {
    /// Goes on by `dt_s` (s). A `dt_s` that is not a number above zero changes nothing.
    pub fn advance(&mut self, dt_s: f64) {
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return;
        }
        let end = self.time_s + dt_s;
        if self.holding.is_some() {
            self.make_safe(end, None);
        }
        let silent_s = self.silence_max_s.map_or(f64::INFINITY, |most| self.heard_s + most);
        if let Some(execution) = self.execution.take() {
            self.execute(execution, end.min(silent_s.max(self.time_s)));
        }
        if self.execution.is_some() && end >= silent_s {
            self.time_s = self.time_s.max(silent_s.min(end));
            let most = self.silence_max_s.unwrap_or_default();
            self.make_safe(end, Some(Fault::GroundSilent { silence_s: most }));
        }
        self.time_s = end;
    }

    /// Stops as soon as the stance has its margin, and holds: for a fault, or for a hold. Until then
    /// the motion goes on, which was checked to its end; where it never has, the motion ends.
    fn make_safe(&mut self, end: f64, fault: Option<Fault>) {
        while !self.stands_with_margin() {
            let Some(execution) = self.execution.take() else { break };
            if self.time_s >= end {
                self.execution = Some(execution);
                return;
            }
            let until = (self.time_s + SAFE_LOOK_S).min(end);
            self.execute(execution, until);
        }
        if let Some(execution) = self.execution.take() {
            let text = match &fault {
                Some(fault) => fault.to_string(),
                None => "ended by a hold".to_owned(),
            };
            self.mode = if fault.is_some() { Mode::Fault } else { Mode::Idle };
            self.brake_all();
            let told = execution.of_step(&text);
            self.tell(&execution.id, Stage::Aborted, Some(told));
            self.fault = fault.map(|_| text);
        }
        self.held();
    }

    /// Is the regular margin at least what the margin rule asks?
    fn stands_with_margin(&self) -> bool {
        let contacts: Vec<_> = standing(&self.feet).into_iter().map(|(_, at)| at).collect();
        let com = self.posture.center_of_mass(self.scene.robot());
        support_polygon::regular(&contacts)
            .is_ok_and(|support| support.depth_of(com.xy()) >= self.scene.robot().stance().margin)
    }

    /// Moves until `end` (time on board, s) or the command's, looking where it goes.
    fn execute(&mut self, mut execution: Execution, end: f64) {
        loop {
            let Some(phase) = execution.phases.pop_front() else {
                if !self.go_on(&mut execution) {
                    return;
                }
                continue;
            };
            let duration = phase.duration();
            let started = self.time_s - execution.elapsed;
            let until = (end - started).min(duration);
            let met = self.carry_out(&phase, &mut execution.elapsed, until);
            self.time_s = started + execution.elapsed;
            if let Some(fault) = met {
                self.mode = Mode::Fault;
                self.brake_all();
                let told = execution.of_step(&fault.to_string());
                self.fault = Some(fault.to_string());
                self.tell(&execution.id, Stage::Failed, Some(told));
                return;
            }
            if execution.elapsed < duration {
                execution.phases.push_front(phase);
                self.execution = Some(execution);
                return;
            }
            self.switch(&phase);
            execution.passed += duration;
            execution.elapsed = 0.0;
        }
    }

    /// Goes on to the next step; false where there is none, or it is refused: the command has ended.
    fn go_on(&mut self, execution: &mut Execution) -> bool {
        let Some(step) = execution.rest.pop_front() else {
            self.mode = Mode::Idle;
            if execution.cut && execution.step < execution.n_steps {
                let text = execution.of_step("done; the rest was cancelled");
                self.tell(&execution.id, Stage::Aborted, Some(text));
            } else {
                self.tell(&execution.id, Stage::Completed, None);
            }
            return false;
        };
        match self.step_phases(&step) {
            Ok(phases) => {
                execution.next_step(phases);
                true
            }
            Err(refusal) => {
                self.mode = Mode::Idle;
                execution.step += 1;
                let text = execution.of_step(&refusal.to_string());
                self.tell(&execution.id, Stage::Failed, Some(text));
                false
            }
        }
    }

    /// Carries a phase out until `until` (s after its start), or to the last look at which all was
    /// well.
    fn carry_out(&mut self, phase: &Phase, elapsed: &mut f64, until: f64) -> Option<Fault> {
        match phase {
            Phase::Leg(leg, path) => self.move_leg(phase, elapsed, until, *leg, path),
            Phase::Body(closure, path) => self.move_body(phase, elapsed, until, closure, path),
            Phase::Steer(_) | Phase::Drive(_) => self.move_wheels(phase, elapsed, until),
            Phase::Roll { .. } | Phase::Switch(_) => {
                self.take_place(phase, until);
                *elapsed = until;
                None
            }
        }
    }

    fn move_leg(
        &mut self,
        phase: &Phase,
        elapsed: &mut f64,
        until: f64,
        leg: LegId,
        path: &TimedPath,
    ) -> Option<Fault> {
        let scene = self.scene.clone();
        let feet = self.feet.clone();
        let guard = Guard::new(&scene, &self.posture, &feet, leg, &path.goal()[0]);
        let mut met = None;
        while met.is_none()
            && let Some(next) = phase.next_look(&scene, *elapsed, until)
        {
            let angles = path.at(next)[0];
            let moved = self.posture.with_leg(scene.robot(), leg, &angles);
            met = guard.look(&moved);
            if met.is_none() {
                self.posture = moved;
                self.configuration.legs[leg.0] = angles;
                *elapsed = next;
            }
        }
        self.feet[leg.0] = foot(&scene, &self.posture, leg);
        met
    }

    /// As [`move_leg`](Self::move_leg) for all legs of the path, the base over its wheels.
    fn move_body(
        &mut self,
        phase: &Phase,
        elapsed: &mut f64,
        until: f64,
        closure: &Closure,
        path: &TimedPath,
    ) -> Option<Fault> {
        let mut met = None;
        while met.is_none()
            && let Some(next) = phase.next_look(&self.scene, *elapsed, until)
        {
            let legs = path.applied(&self.configuration.legs, &path.at(next));
            let fit = closure.fit(self.scene.robot(), legs);
            met = look_at_shift(&self.scene, closure, &fit);
            if met.is_none() {
                (self.configuration, self.posture) = (fit.configuration, fit.posture);
                *elapsed = next;
            }
        }
        self.look_at_feet();
        met
    }

    /// As [`move_leg`](Self::move_leg) for wheels that are steered or driven.
    fn move_wheels(&mut self, phase: &Phase, elapsed: &mut f64, until: f64) -> Option<Fault> {
        let scene = self.scene.clone();
        while let Some(next) = phase.next_look(&scene, *elapsed, until) {
            let before = (self.configuration.clone(), self.posture.clone());
            let spins = self.wheels.clone();
            self.take_place(phase, next);
            let met = look_at_rolling(&scene, &self.posture, &survey(&scene, &self.posture));
            if met.is_some() {
                (self.configuration, self.posture) = before;
                self.wheels = spins;
                self.look_at_feet();
                return met;
            }
            *elapsed = next;
        }
        self.look_at_feet();
        None
    }

    /// Goes to where a phase is `t` seconds after its start, looking at nothing.
    pub(crate) fn take_place(&mut self, phase: &Phase, t: f64) {
        let robot = self.scene.robot();
        match phase {
            Phase::Leg(_, path) | Phase::Steer(path) => {
                self.configuration.legs = path.applied(&self.configuration.legs, &path.at(t));
            }
            Phase::Body(closure, path) => {
                let legs = path.applied(&self.configuration.legs, &path.at(t));
                self.configuration = closure.fit(robot, legs).configuration;
            }
            Phase::Drive(track) => {
                self.configuration = track.at(track.share_at(t));
                self.spin_along(track, t);
            }
            Phase::Roll { leg, from, by, ramped } => {
                self.wheels[leg.0].spin = from + by * ramped.share_at(t);
                return;
            }
            Phase::Switch(_) => return,
        }
        self.posture = Posture::new(self.scene.robot(), &self.configuration);
    }

    fn spin_along(&mut self, track: &Track, t: f64) {
        for (wheel, spin) in self.wheels.iter_mut().zip(track.spins_at(track.share_at(t))) {
            wheel.spin = spin;
        }
    }

    pub(crate) fn look_at_feet(&mut self) {
        self.feet = feet(&self.scene, &self.posture);
    }

    /// Switches what a phase switches at its end.
    pub(crate) fn switch(&mut self, phase: &Phase) {
        match phase {
            Phase::Switch(Switch::Brakes { legs, on }) => {
                legs.iter().for_each(|leg| self.wheels[leg.0].brake = *on);
            }
            Phase::Switch(Switch::Mode(operating)) => {
                self.operating = *operating;
                if *operating != Operating::Driving {
                    self.brake_all();
                }
            }
            _ => {}
        }
    }

    /// By leg how fast its wheel spins now (rad/s).
    pub(super) fn spin_rates(&self) -> Vec<f64> {
        let still = || vec![0.0; self.wheels.len()];
        let Some(execution) = &self.execution else { return still() };
        match execution.phases.front() {
            Some(Phase::Drive(track)) => track.spin_rates_at(execution.elapsed).collect(),
            Some(Phase::Roll { leg, by, ramped, .. }) => {
                let mut rates = still();
                rates[leg.0] = by * ramped.speed_at(execution.elapsed) * ramped.length_inverse();
                rates
            }
            _ => still(),
        }
    }
}
