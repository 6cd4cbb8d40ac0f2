//! The order of the commands of a plan, forward and back.

use std::collections::{HashMap, VecDeque};

use wire::live::PlanCommandRef;

use super::MAX_COMMANDS;

/// How far a plan has come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PlanProgress {
    /// Its commands that are done and not undone.
    pub done: usize,
    /// One was undone: the plan goes back only.
    pub backing_out: bool,
}

impl PlanProgress {
    /// Is a command of the plan next that begins when `after` commands are done?
    pub fn is_next(self, plan: &PlanCommandRef, after: usize) -> bool {
        after == self.done && (plan.retreat || !self.backing_out)
    }
}

/// How far each plan has come. The newest plans are kept.
#[derive(Debug, Default)]
pub struct PlanOrder {
    progress: HashMap<String, PlanProgress>,
    begun: VecDeque<String>,
}

impl PlanOrder {
    /// How far the plan of `plan` has come.
    pub fn of(&self, plan: &PlanCommandRef) -> PlanProgress {
        self.progress.get(&plan.plan_id).copied().unwrap_or_default()
    }

    /// The command of `plan` that began after `after` others is done; false if it was not next.
    pub fn done(&mut self, plan: &PlanCommandRef, after: usize) -> bool {
        let before = self.of(plan);
        if !before.is_next(plan, after) {
            return false;
        }
        let now = if plan.retreat {
            PlanProgress { done: after.saturating_sub(1), backing_out: true }
        } else {
            PlanProgress { done: after + 1, ..before }
        };
        if self.progress.insert(plan.plan_id.clone(), now).is_none() {
            self.begun.push_back(plan.plan_id.clone());
        }
        if self.begun.len() > MAX_COMMANDS
            && let Some(oldest) = self.begun.pop_front()
        {
            self.progress.remove(&oldest);
        }
        true
    }
}
