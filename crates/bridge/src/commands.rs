//! The life of a command, the authority to command, and the E-stop.
//!
//! ```text
//! staged ─▶ (approved) ⇄ armed ─▶ sent ─▶ received ─▶ executing ─▶ done | failed | aborted
//!    └─────────┴───────────┴─▶ cancelled     └──── overdue ◀──┘ (a late word takes it further,
//!                              | expired                         or an operator resolves it)
//! ```
//!
//! Every transition is a [`CommandEvent`](wire::live::CommandEvent) that carries the whole record:
//! the state of a [`CommandBook`] is a fold of its events, and [`CommandBook::restore`] is that fold.
//! Nothing is ever sent again by itself: where the outcome of a command is not known, after silence or
//! a restart of the ground, it is `overdue` until a word comes or an operator resolves it.

mod authority;
mod book;
mod estop;
mod plans;
mod stages;

use std::collections::BTreeMap;

use wire::live::{CommandBody, CommandState, PlanCommandRef, Precondition};
use wire::precondition::Unmet;
use wire::time::Timestamp;

pub use authority::{Authority, AuthorityError, AuthorityRules};
pub use book::{CommandBook, Silence};
pub use estop::{Estop, EstopError, EstopMemory, RELEASE_WINDOW_S};

/// How long an armed command may be sent (s).
pub const ARM_WINDOW_S: f64 = 30.0;
/// A command without a word this long (s) after the earliest possible one is overdue.
pub const ACK_SLACK_S: f64 = 2.0;
/// A motion may take this many times as long as planned, plus [`MOTION_SLACK_S`].
pub const MOTION_STRETCH: f64 = 1.5;
/// See [`MOTION_STRETCH`] (s). Each telemetry frame that shows the motion grants as much again.
pub const MOTION_SLACK_S: f64 = 5.0;
/// An approval holds this long (s).
pub const APPROVAL_S: f64 = 600.0;
/// Most commands kept in memory; the oldest ended ones give way, and remain in the log.
pub const MAX_COMMANDS: usize = 1000;

/// What it takes to stage a command.
#[derive(Debug, Clone, PartialEq)]
pub struct StageCommand {
    /// Identity (UUID) given by the client; a new one where absent.
    pub id: Option<String>,
    /// Who stages it.
    pub operator: String,
    /// In words: `Lift leg 2`.
    pub title: String,
    /// What the rover is told.
    pub body: CommandBody,
    /// The plan it belongs to.
    pub plan: Option<PlanCommandRef>,
    /// How many commands of that plan are done, and not undone, when this one begins: forward its
    /// index, on the way back one more than the index of the command that it undoes.
    pub after: usize,
    /// How long the motion takes as planned (s).
    pub duration_s: f64,
    /// Where the legs were when it was checked: leg to joint angles (rad).
    pub basis_joints_rad: BTreeMap<String, Vec<f64>>,
    /// Largest deviation from that (rad).
    pub basis_tolerance_rad: f64,
    /// Version stamp of the robot model that it was checked with.
    pub model_hash: Option<String>,
    /// It takes a second person's word before it is armed.
    pub two_persons: bool,
    /// What must hold when it is released, and when it begins on board.
    pub preconditions: Vec<Precondition>,
}

/// The light times that a command is sent under (s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightTimes {
    /// One way up (s).
    pub up_s: f64,
    /// One way down (s).
    pub down_s: f64,
    /// How much longer the way up and down may take in all (s): jitter.
    pub spread_s: f64,
}

/// Why a command operation was refused. Nothing has changed then.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// No such command in memory.
    #[error("there is no command {id}; it never was, or has ended and is in the flight log only")]
    Unknown {
        /// The command.
        id: String,
    },
    /// Sending takes an armed command.
    #[error("command {id} is {state:?}, not armed; arm it first")]
    NotArmed {
        /// The command.
        id: String,
        /// Its state.
        state: CommandState,
    },
    /// Arming takes a staged command.
    #[error("command {id} is {state:?}; only a staged command can be armed")]
    NotStaged {
        /// The command.
        id: String,
        /// Its state.
        state: CommandState,
    },
    /// The window to send it has passed.
    #[error("command {id} was armed until {until:?} and is staged again; arm it once more")]
    ArmExpired {
        /// The command.
        id: String,
        /// End of the window.
        until: Timestamp,
    },
    /// Another command is armed.
    #[error("command {armed} is armed; send or cancel it before {id} is armed")]
    OtherArmed {
        /// The command to be armed.
        id: String,
        /// The armed one.
        armed: String,
    },
    /// Not the next of its plan.
    #[error(
        "command {id} is number {index} of its plan, and the next is {next}; a plan's commands go in order, each after the one before is done"
    )]
    Order {
        /// The command.
        id: String,
        /// Its index in the plan.
        index: usize,
        /// The index that is next.
        next: usize,
    },
    /// Not the next part of its plan's way back.
    #[error(
        "command {id} undoes number {undoes} of its plan, and commands done and not undone are {done}; the way back goes in order, undoing the last one first"
    )]
    BackOrder {
        /// The command.
        id: String,
        /// Index of the command that it undoes.
        undoes: usize,
        /// How many of the plan's commands are done and not undone.
        done: usize,
    },
    /// There is nothing to undo.
    #[error(
        "this part of the way back undoes number {undoes} of its plan, and commands done and not undone are {done}; only what is done is undone"
    )]
    NotExecuted {
        /// Index of the command that it undoes.
        undoes: usize,
        /// How many of the plan's commands are done and not undone.
        done: usize,
    },
    /// The plan goes back only.
    #[error("the plan is being backed out and goes back only; to go forward, plan the step anew")]
    BackingOut,
    /// Nobody knows where the rover will be.
    #[error("command {other} of the same plan is under way; wait for its end")]
    PlanUnderWay {
        /// The command under way.
        other: String,
    },
    /// No command goes up while an E-stop is in force.
    #[error("an E-stop is in force; release it first")]
    EstopInForce,
    /// The command has ended, or is beyond recall.
    #[error("command {id} is {state:?}, which can no longer be changed")]
    AlreadyTerminal {
        /// The command.
        id: String,
        /// Its state.
        state: CommandState,
    },
    /// The authority to command is another's.
    #[error(transparent)]
    Authority(#[from] AuthorityError),
    /// A second person must approve it.
    #[error("command {id} takes the approval of a second person{}; approve it first", if *.lapsed { " again, for the last one has lapsed" } else { "" })]
    ApprovalNeeded {
        /// The command.
        id: String,
        /// There was one.
        lapsed: bool,
    },
    /// The approver is its author.
    #[error("command {id} was staged by {who}; its approval is for another person")]
    SelfApproval {
        /// The command.
        id: String,
        /// Its author.
        who: String,
    },
    /// What was approved is another content.
    #[error("command {id} has content {content_hash}, not the one approved; look at it again")]
    ApprovalOfOther {
        /// The command.
        id: String,
        /// Hash of its content.
        content_hash: String,
    },
    /// Nothing to approve.
    #[error("command {id} takes no approval")]
    ApprovalNotNeeded {
        /// The command.
        id: String,
    },
    /// Only an unknown outcome is resolved.
    #[error("command {id} is {state:?}; only an overdue command is resolved by hand")]
    NotOverdue {
        /// The command.
        id: String,
        /// Its state.
        state: CommandState,
    },
    /// Telemetry does not show what it waits for.
    #[error("what the command waits for does not hold: {0}")]
    Precondition(#[from] Unmet),
    /// The identity belongs to another command.
    #[error("command {id} was staged with another content; use a new id")]
    IdReused {
        /// The identity.
        id: String,
    },
    /// Not a UUID.
    #[error("{id:?} is not a UUID")]
    IdInvalid {
        /// The beginning of what was given.
        id: String,
    },
    /// A duration that is none.
    #[error("duration_s is {duration_s}; it takes a finite value from 0 to 86400")]
    DurationInvalid {
        /// The value (s).
        duration_s: f64,
    },
    /// No room in memory or on the link.
    #[error("{what} full: wait until commands have ended, or cancel some")]
    QueueFull {
        /// What is full.
        what: &'static str,
    },
    /// The flight log cannot be written, so nothing may be sent.
    #[error("the flight log cannot be written ({reason}); no command is taken until it can")]
    LogUnavailable {
        /// Why.
        reason: String,
    },
    /// The rover is a process of its own, and there is no connection to it.
    #[error(
        "there is no connection to the rover, so no command is sent ({why}); it is sent once the connection is back, and an E-stop is taken in any case"
    )]
    RoverUnreachable {
        /// Why.
        why: String,
    },
}

impl CommandError {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            CommandError::Unknown { .. } => "command_unknown",
            CommandError::NotArmed { .. } => "not_armed",
            CommandError::NotStaged { .. } => "not_staged",
            CommandError::ArmExpired { .. } => "arm_expired",
            CommandError::OtherArmed { .. } => "other_armed",
            CommandError::Order { .. } | CommandError::BackOrder { .. } => "order",
            CommandError::NotExecuted { .. } => "not_executed",
            CommandError::BackingOut => "backing_out",
            CommandError::PlanUnderWay { .. } => "plan_under_way",
            CommandError::EstopInForce => "estop_in_force",
            CommandError::AlreadyTerminal { .. } => "already_terminal",
            CommandError::Authority(error) => error.code(),
            CommandError::ApprovalNeeded { .. } => "approval_needed",
            CommandError::SelfApproval { .. } => "self_approval",
            CommandError::ApprovalOfOther { .. } => "approval_of_other",
            CommandError::ApprovalNotNeeded { .. } => "approval_not_needed",
            CommandError::NotOverdue { .. } => "not_overdue",
            CommandError::Precondition(unmet) => unmet.code(),
            CommandError::IdReused { .. } => "id_reused",
            CommandError::IdInvalid { .. } => "id_invalid",
            CommandError::DurationInvalid { .. } => "duration_invalid",
            CommandError::QueueFull { .. } => "queue_full",
            CommandError::LogUnavailable { .. } => "log_unavailable",
            CommandError::RoverUnreachable { .. } => "rover_unreachable",
        }
    }
}

/// True for the states that a command never leaves.
pub fn is_terminal(state: CommandState) -> bool {
    use CommandState::{Aborted, Cancelled, Done, Expired, Failed};
    matches!(state, Done | Failed | Aborted | Cancelled | Expired)
}

/// True from the moment a command is handed to the link until it has ended.
pub fn is_outstanding(state: CommandState) -> bool {
    use CommandState::{Executing, Overdue, Received, Sent};
    matches!(state, Sent | Received | Executing | Overdue)
}

/// A new identity (UUID v7) of the given time.
pub(crate) fn new_id(now: Timestamp) -> String {
    let (seconds, nanos) = (now.0 / 1_000_000_000, (now.0 % 1_000_000_000) as u32);
    uuid::Uuid::new_v7(uuid::Timestamp::from_unix(uuid::NoContext, seconds, nanos)).to_string()
}
