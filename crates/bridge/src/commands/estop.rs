//! The E-stop as the ground knows it, and its release in two steps.

use wire::live::{AckStage, EstopState, RoverMode, Uplink};
use wire::time::Timestamp;

use super::new_id;

/// How long the token of a release is valid (s).
pub const RELEASE_WINDOW_S: f64 = 10.0;

/// An E-stop without a word is sent again this long (s) after the word should have come.
const REPEAT_SLACK_S: f64 = 2.0;

/// Why a release was refused. The E-stop stays in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EstopError {
    /// Nothing to release.
    #[error("no E-stop is in force")]
    NotInForce,
    /// Wrong token, or none was given out.
    #[error("this is not the token of the first step; ask for a release without a token")]
    TokenUnknown,
    /// The second step came too late.
    #[error("the token was valid for 10 s; ask for a release without a token again")]
    TokenExpired,
    /// The link took the release no more.
    #[error("the link is full; ask again")]
    QueueFull,
}

impl EstopError {
    /// A stable word for programs.
    pub fn code(self) -> &'static str {
        match self {
            EstopError::NotInForce => "estop_not_in_force",
            EstopError::TokenUnknown => "token_unknown",
            EstopError::TokenExpired => "token_expired",
            EstopError::QueueFull => "queue_full",
        }
    }
}

/// State machine `clear → sent → confirmed → release_sent → clear`; a new E-stop is taken in every
/// state.
#[derive(Debug, Default)]
pub struct Estop {
    state: EstopState,
    /// The E-stops sent since the state was last clear, newest last.
    stop_ids: Vec<String>,
    release_id: Option<String>,
    token: Option<(String, Timestamp)>,
    /// When the last message, stop or release, reaches the rover.
    arrives: Timestamp,
    /// When an E-stop without a word from the rover is sent again.
    repeat_at: Timestamp,
    /// Taken over from an earlier session: whether a release has left is not known.
    restored: bool,
    /// What the rover showed up to here (time on board) is of before the last release.
    cleared: Timestamp,
}

/// What an earlier session left of its E-stop, from its log.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EstopMemory {
    /// Its last state.
    pub state: EstopState,
    /// The last E-stop, where the log has it.
    pub stop_id: Option<String>,
    /// The release after it.
    pub release_id: Option<String>,
}

impl EstopMemory {
    /// Takes over an uplink of the log.
    pub fn uplink(&mut self, uplink: &Uplink) {
        match uplink {
            Uplink::Estop { id } => {
                let (state, stop_id) = (EstopState::Sent, Some(id.clone()));
                *self = EstopMemory { state, stop_id, release_id: None };
            }
            Uplink::EstopRelease { id } => {
                (self.state, self.release_id) = (EstopState::ReleaseSent, Some(id.clone()));
            }
            _ => {}
        }
    }

    /// Takes over a state that the log tells of.
    pub fn report(&mut self, state: EstopState) {
        if state == EstopState::Clear {
            *self = EstopMemory::default();
        }
        self.state = state;
    }
}

/// Identities remembered; more presses than that are one E-stop still.
const MAX_STOP_IDS: usize = 64;

impl Estop {
    /// The E-stop of an earlier session: one in force stays in force, and is sent again at once until
    /// the rover's word comes. Of a release that was under way telemetry tells, which reaches the
    /// rover by `arrives`.
    pub fn restore(now: Timestamp, arrives: Timestamp, memory: EstopMemory) -> Estop {
        let EstopMemory { state, stop_id, release_id } = memory;
        if state == EstopState::Clear {
            return Estop::default();
        }
        let stop_ids = vec![stop_id.unwrap_or_else(|| new_id(now))];
        let released = state == EstopState::ReleaseSent;
        let state = if released { state } else { EstopState::Sent };
        let release_id = release_id.filter(|_| released);
        let (repeat_at, restored) = (now, released);
        Estop { state, stop_ids, release_id, arrives, repeat_at, restored, ..Estop::default() }
    }

    /// A release was taken back on its way, and has not arrived. True if the state has changed.
    pub fn release_lost(&mut self, id: &str) -> bool {
        let lost = self.release_id.as_deref() == Some(id);
        if lost {
            self.take_back_release();
        }
        lost
    }

    /// The present state.
    pub fn state(&self) -> EstopState {
        self.state
    }

    /// True while no command may go up.
    pub fn in_force(&self) -> bool {
        self.state != EstopState::Clear
    }

    /// Stops; gives the identity of the uplink message, which reaches the rover at `arrives`.
    pub fn stop(&mut self, now: Timestamp, arrives: Timestamp) -> String {
        let id = new_id(now);
        if self.state == EstopState::ReleaseSent {
            // What the rover says of earlier stops says nothing of what it does after the release.
            self.stop_ids.clear();
        }
        if self.stop_ids.len() == MAX_STOP_IDS {
            self.stop_ids.remove(0);
        }
        self.stop_ids.push(id.clone());
        self.release_id = None;
        self.restored = false;
        self.token = None;
        if self.state != EstopState::Confirmed {
            self.state = EstopState::Sent;
            self.arrives = arrives;
        }
        id
    }

    /// The E-stop to be sent again at `now`, if the rover has given no word for so long: stopping twice
    /// is stopping, so this one message is repeated by itself. `word_s` is how long a word takes (s).
    pub fn repeat(&mut self, now: Timestamp, word_s: f64) -> Option<String> {
        if self.state != EstopState::Sent || now < self.repeat_at {
            return None;
        }
        self.repeat_at = now.plus_seconds(word_s + REPEAT_SLACK_S);
        self.stop_ids.last().cloned()
    }

    /// An E-stop was handed to the link at `now`; see [`Estop::repeat`].
    pub fn expect_word(&mut self, now: Timestamp, word_s: f64) {
        self.repeat_at = now.plus_seconds(word_s + REPEAT_SLACK_S);
    }

    /// First step of a release: gives the token for the second.
    pub fn ask_release(&mut self, now: Timestamp) -> Result<String, EstopError> {
        if !self.in_force() {
            return Err(EstopError::NotInForce);
        }
        let token = new_id(now);
        self.token = Some((token.clone(), now.plus_seconds(RELEASE_WINDOW_S)));
        Ok(token)
    }

    /// Second step: gives the identity of the uplink message, which reaches the rover at
    /// `arrives`.
    pub fn release(
        &mut self,
        now: Timestamp,
        token: &str,
        arrives: Timestamp,
    ) -> Result<String, EstopError> {
        if !self.in_force() {
            return Err(EstopError::NotInForce);
        }
        match self.token.take() {
            Some((expected, until)) if expected == token => {
                if now > until {
                    return Err(EstopError::TokenExpired);
                }
            }
            kept => {
                self.token = kept;
                return Err(EstopError::TokenUnknown);
            }
        }
        let id = new_id(now);
        self.release_id = Some(id.clone());
        self.state = EstopState::ReleaseSent;
        self.arrives = arrives;
        Ok(id)
    }

    /// The release never came to the link: the E-stop stays in force.
    pub fn take_back_release(&mut self) {
        self.release_id = None;
        self.restored = false;
        self.state = EstopState::Confirmed;
    }

    /// The rover's word, of the given time on board, on an uplink message; true if the state has
    /// changed.
    pub fn acknowledged(&mut self, onboard: Timestamp, id: &str, stage: AckStage) -> bool {
        let refused = matches!(stage, AckStage::Rejected | AckStage::Failed | AckStage::Aborted);
        if self.release_id.as_deref() == Some(id) {
            if refused {
                self.take_back_release();
            } else {
                self.clear(onboard);
            }
            return true;
        }
        !refused && self.stop_ids.iter().any(|stop| stop == id) && self.confirm()
    }

    /// Telemetry of the given time on board shows the rover stopped, or not; a word too, once the
    /// last message has reached it. True if the state has changed.
    pub fn seen(&mut self, onboard: Timestamp, mode: RoverMode) -> bool {
        if onboard <= self.arrives {
            return false;
        }
        match (self.state, mode == RoverMode::Stopped) {
            (EstopState::Sent, true) => self.confirm(),
            (EstopState::ReleaseSent, false) => {
                self.clear(onboard);
                true
            }
            (EstopState::ReleaseSent, true) if self.restored => {
                self.take_back_release();
                true
            }
            // Another ground, or one whose log is gone, has stopped it.
            (EstopState::Clear, true) if onboard > self.cleared => {
                self.state = EstopState::Confirmed;
                true
            }
            _ => false,
        }
    }

    fn clear(&mut self, onboard: Timestamp) {
        *self = Estop { cleared: onboard, ..Estop::default() };
    }

    /// True if `id` is an E-stop or release of this state machine.
    pub fn knows(&self, id: &str) -> bool {
        self.release_id.as_deref() == Some(id) || self.stop_ids.iter().any(|stop| stop == id)
    }

    fn confirm(&mut self) -> bool {
        let confirms = self.state == EstopState::Sent;
        if confirms {
            self.state = EstopState::Confirmed;
        }
        confirms
    }
}
