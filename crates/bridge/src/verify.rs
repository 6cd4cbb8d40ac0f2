//! Is a folder of logs as it was written? Every file against the rules of the format, every sealed
//! segment against its seal, and the chain of seals from the first to the last.
//!
//! Found: any change of a sealed file or a seal, the loss or exchange of any but the newest. The loss
//! of the newest shows only against a head that was noted elsewhere ([`Verification::head`]).

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use crate::doctor;
use crate::recorder::Storage;
use crate::seal::{self, OWN, Seal, SealRef};
use crate::segments::{self, Kind};

/// Something that is not as it was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The log.
    pub log: String,
    /// The segment.
    pub segment: u32,
    /// What is wrong.
    pub text: String,
}

/// What a verification found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Verification {
    /// Segments that were sealed and are as their seals say.
    pub sound: usize,
    /// Segments that are still open: being written, or left by a crash until the next start.
    pub open: Vec<(String, u32)>,
    /// What is wrong.
    pub problems: Vec<Problem>,
    /// The last seal of the chain; to be noted elsewhere.
    pub head: Option<SealRef>,
    /// What is said to have been lost before a segment was sealed.
    pub lost: Vec<Problem>,
}

/// Verifies all logs, or the one named; the seals of the others are looked up, not verified.
pub fn verify(storage: &dyn Storage, only: Option<&str>) -> io::Result<Verification> {
    let mut result = Verification::default();
    let listed = seal::all(storage)?;
    let head = seal::head(&listed);
    let place = |(place, seal, reference)| (place, (seal, reference));
    let seals: BTreeMap<(String, u32), (Seal, SealRef)> = listed.into_iter().map(place).collect();
    let mut all = Vec::new();
    for log in segments::logs(storage)? {
        for (number, kinds) in segments::list(storage, &log)? {
            all.push((log.clone(), number, kinds));
        }
    }
    let wanted = |log: &str| only.is_none_or(|only| only == log);
    let mut before: Option<(&str, u32)> = None;
    for (log, number, kinds) in all.iter().filter(|(log, ..)| wanted(log)) {
        let expected =
            before.filter(|(last, _)| last == log).map_or(1, |(_, n)| n.saturating_add(1));
        if *number != expected {
            result.problem(log, expected, "the segment is missing");
        }
        before = Some((log, *number));
        let read = seals.get(&(log.clone(), *number));
        match (kinds.contains(&Kind::Sealed), kinds.contains(&Kind::Seal), read) {
            (_, _, _) if kinds.contains(&Kind::Open) => result.open.push((log.clone(), *number)),
            (true, true, Some((seal, _))) => result.sealed(storage, log, *number, seal, &seals)?,
            (true, true, None) => result.problem(log, *number, "the seal cannot be read"),
            (true, false, _) => result.problem(log, *number, "the seal is missing"),
            (false, true, _) => result.problem(log, *number, "the sealed file is missing"),
            (false, false, _) => result.problem(log, *number, "there is neither file nor seal"),
        }
    }
    result.chain(&seals, wanted);
    result.head = head;
    Ok(result)
}

impl Verification {
    fn problem(&mut self, log: &str, segment: u32, text: impl Into<String>) {
        self.problems.push(Problem { log: log.into(), segment, text: text.into() });
    }

    fn sealed(
        &mut self,
        storage: &dyn Storage,
        log: &str,
        number: u32,
        seal: &Seal,
        seals: &BTreeMap<(String, u32), (Seal, SealRef)>,
    ) -> io::Result<()> {
        let before = self.problems.len();
        if (seal.log.as_str(), seal.segment) != (log, number) {
            self.problem(log, number, "the seal is that of another segment");
        }
        let file = storage.open(&segments::path(log, number, Kind::Sealed))?;
        let examination = doctor::examine(file, OWN)?;
        if (examination.bytes, &examination.blake3) != (seal.bytes, &seal.blake3) {
            self.problem(log, number, "the file is not the one that was sealed");
        }
        for finding in examination.findings.iter().take(3) {
            self.problem(log, number, format!("byte {}: {}", finding.at, finding.text));
        }
        if let Some(previous) = &seal.previous {
            match seals.get(&(previous.log.clone(), previous.segment)) {
                Some((_, reference)) if reference == previous => {}
                Some(_) => self.problem(log, number, "the seal before this one was changed"),
                None => self.problem(log, number, "the seal before this one is missing"),
            }
        }
        for text in &seal.lost {
            self.lost.push(Problem { log: log.into(), segment: number, text: text.clone() });
        }
        if self.problems.len() == before {
            self.sound += 1;
        }
        Ok(())
    }

    /// A chain has one beginning and no forks.
    fn chain(
        &mut self,
        seals: &BTreeMap<(String, u32), (Seal, SealRef)>,
        wanted: impl Fn(&str) -> bool,
    ) {
        let mut followed = BTreeSet::<Option<&SealRef>>::new();
        for (seal, _) in seals.values() {
            if !followed.insert(seal.previous.as_ref()) && wanted(&seal.log) {
                self.problem(&seal.log, seal.segment, "another seal follows the same one");
            }
        }
    }
}
