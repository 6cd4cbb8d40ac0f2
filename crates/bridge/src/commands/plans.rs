//! The order of the commands of a plan.

use std::collections::{HashMap, VecDeque};

use wire::live::PlanCommandRef;

use super::MAX_COMMANDS;

/// How far each plan has come: the index of its next command. The newest plans are kept.
#[derive(Debug, Default)]
pub struct PlanOrder {
    next: HashMap<String, usize>,
    begun: VecDeque<String>,
}

impl PlanOrder {
    /// The index that is next in the plan of `plan`.
    pub fn next_of(&self, plan: &PlanCommandRef) -> usize {
        self.next.get(&plan.plan_id).copied().unwrap_or(0)
    }

    /// The command of `plan` is done.
    pub fn done(&mut self, plan: &PlanCommandRef) {
        if plan.index != self.next_of(plan) {
            return;
        }
        if self.next.insert(plan.plan_id.clone(), plan.index + 1).is_none() {
            self.begun.push_back(plan.plan_id.clone());
        }
        if self.begun.len() > MAX_COMMANDS
            && let Some(oldest) = self.begun.pop_front()
        {
            self.next.remove(&oldest);
        }
    }
}
