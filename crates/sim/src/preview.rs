//! What a command would be refused for, and how long it would take, without doing it.

use crate::command::{Motion, Step};
use crate::phase::Phase;
use crate::refusal::Refusal;
use crate::rover::SimRover;

/// A command that would be begun.
#[derive(Debug, Clone, PartialEq)]
pub struct Preview {
    /// How long it takes (s).
    pub duration_s: f64,
    /// How long each step of a sequence takes (s); of another command itself.
    pub steps_s: Vec<f64>,
}

/// Why a command would not be carried out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{refusal}")]
pub struct PreviewError {
    /// The step of a sequence, from 0; none for the command itself.
    pub step: Option<usize>,
    /// Why.
    pub refusal: Refusal,
}

impl SimRover {
    /// What would come of a motion that began now: refusals as on board, each step of a sequence
    /// from where the one before ends. Gates are not asked, and nothing is looked at between: what a
    /// guard would stop for on the way is for the guard.
    pub fn preview(&self, motion: &Motion) -> Result<Preview, PreviewError> {
        let at = |step| move |refusal| PreviewError { step, refusal };
        let mut rover = self.clone();
        rover.check_ready().map_err(at(None))?;
        let Motion::Sequence(steps) = motion else {
            let duration_s = rover.pass(motion).map_err(at(None))?;
            return Ok(Preview { duration_s, steps_s: vec![duration_s] });
        };
        Step::check(steps).map_err(|(step, refusal)| PreviewError { step, refusal })?;
        let steps_s: Vec<f64> = steps
            .iter()
            .enumerate()
            .map(|(i, step)| rover.pass(&step.motion).map_err(at(Some(i))))
            .collect::<Result<_, _>>()?;
        Ok(Preview { duration_s: steps_s.iter().sum(), steps_s })
    }

    /// Goes to the end of a motion at once.
    fn pass(&mut self, motion: &Motion) -> Result<f64, Refusal> {
        if matches!(motion, Motion::Stop | Motion::CancelRest) {
            return Ok(0.0);
        }
        let phases = self.phases(motion)?;
        let duration_s = phases.iter().map(Phase::duration).sum();
        for phase in &phases {
            self.take_place(phase, phase.duration());
            self.look_at_feet();
            self.switch(phase);
        }
        Ok(duration_s)
    }
}
