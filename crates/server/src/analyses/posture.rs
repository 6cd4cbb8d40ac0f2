//! The posture adviser and the leg-loss rehearsal.

use std::cell::RefCell;

use motion::{
    Advice, AdviceError, AdviceOptions, Aftermath, Answer, Barrier, Change, Freedom, Limit,
    Margins, Motion, Proposal, Region, RehearsalOptions, Stopped, Stretch, Watch, WayBack, Wish,
    advise, rehearse,
};
use rover::{LegId, Robot};
use wire::analysis::{
    AdviceRequest, PlanBasis, PlanCommand, PlanPhase, PlanWaypoint, PostureAccidents,
    PostureAdvice, PostureAftermath, PostureAnswer, PostureBarrier, PostureBest, PostureChange,
    PostureCost, PostureFreedom, PostureLimit, PostureMargins, PostureMotion, PostureOutcome,
    PostureProposal, PostureRehearsal, PostureRequest, PostureWayBack, PostureWayOutcome,
    RehearsalRequest,
};
use wire::check::{self, At, RequestError};
use wire::convert;

use super::plan::{OnProgress, commands, finding, margins, phase, retreat, state_hash};
use crate::live::hash_text;
use crate::scene::{Context, Scene};
use crate::stop::{Cause, Stop};
use crate::terrain_store::version_name;

/// Range of a wished margin (m).
const WISH_M: [f64; 2] = [0.0, motion::adviser::WISH_MAX];

/// Range of the work budget.
const BUDGET: [f64; 2] = [0.0, 1e6];

/// Work budget where the request gives none.
const BUDGET_DEFAULT: usize = 120_000;

/// Advises on the posture, rehearses accidents, or both.
pub fn posture(
    context: &Context,
    request: &PostureRequest,
    stop: &Stop,
    progress: OnProgress<'_>,
) -> Result<PostureAnswer, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    if request.advice.is_none() && request.rehearsal.is_none() {
        let text = "nothing is asked for: give advice, rehearsal or both";
        return Err(RequestError::at("missing_field", &At::root("advice"), text));
    }
    let budget = match request.budget {
        Some(budget) => {
            Some(check::within(&At::root("budget"), budget as f64, BUDGET, "")? as usize)
        }
        None => None,
    };
    let parts = usize::from(request.advice.is_some()) + usize::from(request.rehearsal.is_some());
    let all = parts * budget.unwrap_or(BUDGET_DEFAULT);
    let watch = RefCell::new(Watched { stop, progress, asked: 0, all });
    let work = Work { scene: &scene, seed: request.seed, budget, stop, watch: &watch };
    Ok(PostureAnswer {
        id: None,
        advice: request.advice.as_ref().map(|advice| work.advice(advice)).transpose()?,
        rehearsal: request.rehearsal.as_ref().map(|asked| work.rehearsal(asked)).transpose()?,
        basis: PlanBasis {
            state_hash: state_hash(&scene.configuration),
            terrain_version: version_name(scene.solid.map()),
            model_hash: hash_text(scene.robot().hash()),
            seed: request.seed,
            version: env!("CARGO_PKG_VERSION").into(),
        },
    })
}

struct Work<'a> {
    scene: &'a Scene,
    seed: u64,
    budget: Option<usize>,
    stop: &'a Stop,
    watch: &'a RefCell<Watched<'a>>,
}

impl Work<'_> {
    fn advice(&self, asked: &AdviceRequest) -> Result<PostureAdvice, RequestError> {
        let scene = self.scene;
        let at = At::root("advice");
        let leg = convert::leg(&at.field("leg"), scene.robot(), &asked.leg)?;
        let margin = |name: &str, value: Option<f64>| {
            value.map(|m| check::within(&at.field(name), m, WISH_M, " m")).transpose()
        };
        let wish = Wish {
            regular: margin("regular_m", asked.regular_m)?.unwrap_or(0.0),
            conservative: margin("conservative_m", asked.conservative_m)?,
            friction: margin("friction_m", asked.friction_m)?,
        };
        let usual = AdviceOptions::default();
        let options = AdviceOptions {
            freedom: match asked.chassis {
                PostureFreedom::Level => Freedom::Level,
                PostureFreedom::Whole => Freedom::Whole,
            },
            fold: asked.fold,
            replace: asked.replace,
            drive_hold: asked.drive_hold,
            friction: scene.friction,
            seed: self.seed,
            budget: self.budget.unwrap_or(usual.budget),
        };
        let (solid, start) = (&scene.solid, &scene.configuration);
        let mut watch = self.watch.borrow_mut();
        let advice = advise(solid, start, scene.gravity, leg, &wish, &options, &mut *watch)
            .map_err(|error| self.refused("advice", &error))?;
        let teller = Teller { scene, robot: scene.robot(), drive_hold: asked.drive_hold };
        Ok(teller.advice(&asked.leg, advice))
    }

    fn rehearsal(&self, asked: &RehearsalRequest) -> Result<PostureRehearsal, RequestError> {
        let scene = self.scene;
        let at = At::root("rehearsal");
        let most = motion::rehearsal::SETTLEMENT_MAX * scene.robot().scale();
        let settlement = asked
            .settlement_m
            .map(|s| check::within(&at.field("settlement_m"), s, [0.0, most], " m"))
            .transpose()?;
        let usual = RehearsalOptions::default();
        let budget = self.budget.unwrap_or(usual.budget);
        let options = RehearsalOptions { settlement, seed: self.seed, budget };
        let (solid, start) = (&scene.solid, &scene.configuration);
        let mut watch = self.watch.borrow_mut();
        let rehearsal = rehearse(solid, start, scene.gravity, &options, &mut *watch)
            .map_err(|error| self.refused("rehearsal", &error))?;
        let teller = Teller { scene, robot: scene.robot(), drive_hold: false };
        let accidents = rehearsal.legs.iter().map(|leg| PostureAccidents {
            leg: teller.leg(leg.leg),
            lost: teller.aftermath(&leg.lost),
            settled: teller.aftermath(&leg.settled),
        });
        Ok(PostureRehearsal {
            settlement_m: rehearsal.settlement,
            legs: accidents.collect(),
            poses_looked_at: rehearsal.n_looked as u64,
        })
    }

    /// What the domain refuses is about the state; what is wrong with a figure was found before.
    fn refused(&self, asked: &str, error: &AdviceError) -> RequestError {
        if let Err(stopped) = self.stop.check() {
            return stopped;
        }
        let at = match error {
            AdviceError::BadWish { .. } | AdviceError::UnknownLeg { .. } => At::root(asked),
            _ => At::root("scene"),
        };
        RequestError::at("stance_unusable", &at, error)
    }
}

/// Puts what the adviser says into the words of the wire.
struct Teller<'a> {
    scene: &'a Scene,
    robot: &'a Robot,
    drive_hold: bool,
}

impl Teller<'_> {
    fn leg(&self, leg: LegId) -> String {
        self.robot.leg(leg).name.clone()
    }

    fn advice(&self, leg: &str, advice: Advice) -> PostureAdvice {
        let (outcome, proposals, best) = match &advice.answer {
            Answer::AlreadyMet => (PostureOutcome::AlreadyMet, Vec::new(), None),
            Answer::Proposals(all) => {
                let all = all.iter().map(|proposal| self.proposal(leg, proposal)).collect();
                (PostureOutcome::Found, all, None)
            }
            Answer::Best { posture, missing, barrier } => {
                let best = PostureBest {
                    posture: self.proposal(leg, posture),
                    missing_m: missing.is_finite().then_some(*missing),
                    barrier: told(barrier),
                };
                (PostureOutcome::Best, Vec::new(), Some(best))
            }
        };
        PostureAdvice {
            leg: leg.to_owned(),
            outcome,
            before: self.margins(&advice.before),
            proposals,
            best,
            limits: advice.limits.iter().map(|limit| self.limit(limit)).collect(),
            poses_looked_at: advice.n_looked as u64,
        }
    }

    fn change(&self, change: Change) -> (PostureChange, Option<String>) {
        match change {
            Change::Chassis => (PostureChange::Chassis, None),
            Change::Fold => (PostureChange::Fold, None),
            Change::Replace(leg) => (PostureChange::Replace, Some(self.leg(leg))),
        }
    }

    fn commands(&self, motion: &Motion) -> Vec<PlanCommand> {
        let (robot, leg) = (self.robot, motion.leg);
        let mut all = commands(robot, leg, &motion.start, &motion.waypoints, self.drive_hold);
        // A leg that is moved and not put down is folded.
        if !all.iter().any(|command| command.phase == PlanPhase::Drop) {
            for command in all.iter_mut().filter(|c| c.phase == PlanPhase::Transit) {
                command.title = format!("Fold {}", self.leg(leg));
            }
        }
        all
    }

    fn proposal(&self, lifted: &str, proposal: &Proposal) -> PostureProposal {
        let (change, replaced_leg) = self.change(proposal.change);
        let cost = &proposal.cost;
        PostureProposal {
            change,
            replaced_leg,
            motion: self.motion(lifted, &proposal.motions),
            end: convert::rover_state(self.robot, &proposal.end),
            margins: self.margins(&proposal.after),
            cost: PostureCost {
                chassis_m: cost.chassis,
                turn_rad: cost.turn,
                legs_rad: cost.legs,
                duration_s: cost.duration,
            },
        }
    }

    /// Motions that follow each other; `about` is the leg where nothing moves.
    fn motion(&self, about: &str, motions: &[Motion]) -> PostureMotion {
        let forth: Vec<(String, Vec<PlanCommand>)> =
            motions.iter().map(|m| (self.leg(m.leg), self.commands(m))).collect();
        let back = forth.iter().rev().flat_map(|(leg, commands)| retreat(leg, commands));
        let findings = motions.iter().flat_map(|motion| &motion.findings);
        let leg = motions.first().map_or(about.to_owned(), |motion| self.leg(motion.leg));
        let stretches: Vec<Stretch> = motions.iter().map(Motion::stretch).collect();
        PostureMotion {
            waypoints: self.waypoints(&leg, motions),
            leg,
            retreat: back.collect(),
            commands: forth.into_iter().flat_map(|(_, commands)| commands).collect(),
            findings: findings.map(finding).collect(),
            margins_along: margins(self.scene, &stretches),
        }
    }

    /// The motions one after the other, each knot with the whole rover. `leg` is the one whose joint
    /// angles are told.
    fn waypoints(&self, leg: &str, motions: &[Motion]) -> Vec<PlanWaypoint> {
        let mut all: Vec<PlanWaypoint> = Vec::new();
        for motion in motions {
            let begin = all.last().map_or(0.0, |last| last.time_s);
            let mut stance = motion.start.clone();
            // A motion begins where the one before it has ended.
            let skip = usize::from(!all.is_empty());
            for (i, knot) in motion.waypoints.iter().enumerate() {
                if let Some(there) = &knot.stance {
                    stance.clone_from(there);
                }
                stance.legs[motion.leg.0] = knot.angles;
                if i < skip {
                    continue;
                }
                let state = convert::rover_state(self.robot, &stance);
                all.push(PlanWaypoint {
                    joints_rad: state.joints_rad.get(leg).cloned().unwrap_or_default(),
                    phase: phase(knot.phase),
                    time_s: begin + knot.time,
                    stance: Some(state),
                    hold: knot.hold,
                });
            }
        }
        all
    }

    fn limit(&self, limit: &Limit) -> PostureLimit {
        let (change, replaced_leg) = self.change(limit.change);
        PostureLimit {
            change,
            replaced_leg,
            margins: limit.margins.as_ref().map(|margins| self.margins(margins)),
            barrier: told(&limit.barrier),
        }
    }

    fn margins(&self, margins: &Margins) -> PostureMargins {
        let worst = &margins.torque;
        let joint = self.robot.leg(worst.leg).joints.get(worst.place);
        let ratio = worst.ratio.abs();
        PostureMargins {
            standing: margins.standing.iter().map(|leg| self.leg(*leg)).collect(),
            regular_m: margins.regular,
            regular_most_m: margins.regular_most,
            settlement_m: margins.settlement.filter(|margin| margin.is_finite()),
            conservative_region: match margins.region {
                Region::Area => "area",
                Region::Point => "point",
                Region::Empty => "empty",
            }
            .into(),
            conservative_m: margins.conservative,
            conservative_most_m: margins.conservative_most,
            friction_m: margins.friction,
            torque_ratio: ratio.is_finite().then_some(ratio),
            torque_joint: joint.map_or(String::new(), |i| self.robot.joints()[*i].name.clone()),
        }
    }

    fn aftermath(&self, aftermath: &Aftermath) -> PostureAftermath {
        let none = |outcome| PostureWayBack {
            outcome,
            motion: None,
            end: None,
            margins: None,
            barrier: None,
        };
        let way_back = match &aftermath.way_back {
            WayBack::NotNeeded => none(PostureWayOutcome::NotNeeded),
            WayBack::None(barrier) => {
                PostureWayBack { barrier: Some(told(barrier)), ..none(PostureWayOutcome::None) }
            }
            WayBack::Shift { motion, end, after } => PostureWayBack {
                outcome: PostureWayOutcome::Found,
                motion: Some(self.motion(&self.leg(motion.leg), std::slice::from_ref(motion))),
                end: Some(convert::rover_state(self.robot, end)),
                margins: Some(self.margins(after)),
                barrier: None,
            },
        };
        let (tips_over, rocks) = (aftermath.tips_over, aftermath.rocks);
        PostureAftermath { margin_m: aftermath.margin, tips_over, rocks, way_back }
    }
}

fn told(barrier: &Barrier) -> PostureBarrier {
    PostureBarrier {
        name: barrier.constraint.name.into(),
        missing: barrier.constraint.missing.filter(|missing| missing.is_finite()),
        unit: barrier.constraint.unit.into(),
        detail: barrier.text.clone(),
    }
}

/// Tells of the work each time so many poses have been looked at.
const TOLD_EACH: usize = 500;

/// Stops the work when nobody waits for it, or its time is over, and tells how far it is.
struct Watched<'a> {
    stop: &'a Stop,
    progress: OnProgress<'a>,
    /// How often it was asked: about once for each pose.
    asked: usize,
    /// Poses that may be looked at.
    all: usize,
}

impl Watch for Watched<'_> {
    fn stopped(&mut self) -> Option<Stopped> {
        self.asked += 1;
        if self.asked.is_multiple_of(TOLD_EACH) {
            // The search ends early more often than not: the share is that of its budget.
            let share = (self.asked as f64 / self.all.max(1) as f64).min(0.99);
            (self.progress)(share, &format!("has looked at {} postures", self.asked));
        }
        self.stop.cause().map(|cause| match cause {
            Cause::Deadline => Stopped::Deadline,
            Cause::Cancelled => Stopped::Cancelled,
        })
    }
}
