//! Who may command: one operator at a time, by a lease with a fencing number.
//!
//! The number (epoch) grows with every change of holder and goes up with every command. It is checked
//! where commands are released, the one place that all pass, and again on board, so that what an
//! earlier holder sent is refused however late it comes. Epochs begin with the time (ms), so that they
//! grow over restarts too. E-stops need no authority.

use wire::live::AuthorityReport;
use wire::time::Timestamp;

/// A request to its holder stands this long (s).
pub const ASKED_S: f64 = 60.0;

/// How authority is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AuthorityRules {
    /// It must be acquired before a command is armed; else arming acquires it where nobody has it.
    pub explicit: bool,
    /// It lapses after this time (s) without a word of its holder.
    pub lease_s: f64,
}

impl Default for AuthorityRules {
    fn default() -> Self {
        AuthorityRules { explicit: false, lease_s: 30.0 }
    }
}

/// Why somebody has no authority.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AuthorityError {
    /// Somebody else has it.
    #[error("{holder} has the authority to command until {}; ask for its release, or take over", until.to_rfc3339())]
    Held {
        /// Who.
        holder: String,
        /// Until when, unless it is renewed.
        until: Timestamp,
    },
    /// Nobody has it, and it must be acquired first.
    #[error("nobody has the authority to command; acquire it first")]
    Needed,
    /// It was another holder's, or has lapsed.
    #[error("{who} does not have the authority to command; acquire it first")]
    NotHolder {
        /// Who asked.
        who: String,
    },
    /// Its holder is to have it.
    #[error("{who} has the authority to command already; name another operator")]
    HasIt {
        /// Who.
        who: String,
    },
    /// It has passed on since the command was sent.
    #[error("the authority has passed on since")]
    PassedOn,
}

impl AuthorityError {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            AuthorityError::Held { .. } => "authority_held",
            AuthorityError::Needed | AuthorityError::NotHolder { .. } => "authority_needed",
            AuthorityError::HasIt { .. } => "authority_has_it",
            AuthorityError::PassedOn => "authority_passed_on",
        }
    }
}

#[derive(Debug, Clone)]
struct Holder {
    operator: String,
    until: Timestamp,
}

/// The authority over one rover.
#[derive(Debug, Clone)]
pub struct Authority {
    rules: AuthorityRules,
    holder: Option<Holder>,
    /// Who asks the holder for it, and until when.
    asked: Option<Holder>,
    epoch: u64,
}

impl Authority {
    /// Nobody has it. Epochs are beyond those of any session begun earlier than `now`, and beyond
    /// `last`.
    pub fn new(now: Timestamp, rules: AuthorityRules, last: u64) -> Authority {
        Authority { rules, holder: None, asked: None, epoch: last.max(now.0 / 1_000_000) }
    }

    /// Takes or renews it; gives its epoch.
    pub fn acquire(&mut self, now: Timestamp, who: &str) -> Result<u64, AuthorityError> {
        match self.alive(now) {
            Some(holder) if holder.operator != who => {
                Err(AuthorityError::Held { holder: holder.operator.clone(), until: holder.until })
            }
            Some(_) => self.renew(now, who),
            None => Ok(self.give(now, who)),
        }
    }

    /// Takes it from whoever has it.
    pub fn take_over(&mut self, now: Timestamp, who: &str) -> u64 {
        match self.alive(now) {
            Some(holder) if holder.operator == who => self.epoch,
            _ => self.give(now, who),
        }
    }

    /// Asks its holder for it, for a minute; true if that is news. Where nobody has it, it is taken.
    pub fn ask(&mut self, now: Timestamp, who: &str) -> Result<bool, AuthorityError> {
        match self.alive(now) {
            None => {
                self.give(now, who);
                Ok(false)
            }
            Some(holder) if holder.operator == who => {
                Err(AuthorityError::HasIt { who: who.into() })
            }
            Some(_) => {
                let news = self.asking(now).is_none_or(|asked| asked.operator != who);
                let until = now.plus_seconds(ASKED_S);
                self.asked = Some(Holder { operator: who.into(), until });
                Ok(news)
            }
        }
    }

    /// Gives it from its holder to another, who need not have asked; gives the new epoch.
    pub fn hand_over(
        &mut self,
        now: Timestamp,
        who: &str,
        to: &str,
    ) -> Result<u64, AuthorityError> {
        if self.alive(now).is_none_or(|holder| holder.operator != who) {
            return Err(AuthorityError::NotHolder { who: who.into() });
        }
        if who == to {
            return Err(AuthorityError::HasIt { who: who.into() });
        }
        Ok(self.give(now, to))
    }

    /// Prolongs the lease of its holder.
    pub fn renew(&mut self, now: Timestamp, who: &str) -> Result<u64, AuthorityError> {
        let until = now.plus_seconds(self.rules.lease_s);
        match &mut self.holder {
            Some(holder) if holder.operator == who && holder.until >= now => {
                holder.until = holder.until.max(until);
                Ok(self.epoch)
            }
            _ => Err(AuthorityError::NotHolder { who: who.into() }),
        }
    }

    /// Gives it up.
    pub fn release(&mut self, now: Timestamp, who: &str) -> Result<(), AuthorityError> {
        self.renew(now, who)?;
        (self.holder, self.asked) = (None, None);
        Ok(())
    }

    /// The epoch under which `who` commands now; acquires it where the rules allow.
    pub fn exercise(&mut self, now: Timestamp, who: &str) -> Result<u64, AuthorityError> {
        match self.alive(now) {
            None if self.rules.explicit => Err(AuthorityError::Needed),
            _ => self.acquire(now, who),
        }
    }

    /// As [`Authority::exercise`], changing nothing.
    pub fn may(&self, now: Timestamp, who: &str) -> Result<(), AuthorityError> {
        self.clone().exercise(now, who).map(|_| ())
    }

    /// An error unless this epoch still holds.
    pub fn check(&self, now: Timestamp, epoch: u64) -> Result<(), AuthorityError> {
        if self.alive(now).is_some() && self.epoch == epoch {
            return Ok(());
        }
        Err(AuthorityError::PassedOn)
    }

    /// How it is given.
    pub fn rules(&self) -> AuthorityRules {
        self.rules
    }

    /// How things stand.
    pub fn report(&self, now: Timestamp) -> AuthorityReport {
        let (holder, asked) = (self.alive(now), self.asking(now));
        AuthorityReport {
            holder: holder.map(|h| h.operator.clone()),
            until: holder.map(|h| h.until),
            epoch: self.epoch,
            explicit: self.rules.explicit,
            lease_s: self.rules.lease_s,
            asked_by: asked.map(|a| a.operator.clone()),
            asked_until: asked.map(|a| a.until),
        }
    }

    /// Who asks for it; a request to a holder who has it no more is none.
    fn asking(&self, now: Timestamp) -> Option<&Holder> {
        self.alive(now)?;
        self.asked.as_ref().filter(|asked| asked.until >= now)
    }

    fn alive(&self, now: Timestamp) -> Option<&Holder> {
        self.holder.as_ref().filter(|holder| holder.until >= now)
    }

    fn give(&mut self, now: Timestamp, who: &str) -> u64 {
        self.epoch += 1;
        let until = now.plus_seconds(self.rules.lease_s);
        self.holder = Some(Holder { operator: who.into(), until });
        self.asked = None;
        self.epoch
    }
}
