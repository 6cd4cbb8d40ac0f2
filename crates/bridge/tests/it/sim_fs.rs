//! A file system in memory that forgets what was not synced, tears what it was writing, runs full,
//! and loses its power at any call.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Cursor, ErrorKind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

use bridge::recorder::{LogFile, LogSource, Space, Storage};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Sectors are written whole, or not.
const SECTOR: usize = 512;

/// What happens at a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The power goes: half of a write is done, everything later fails.
    Crash,
    /// This call fails, later ones do not.
    Once(ErrorKind),
}

/// What a power cut leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Survives {
    /// Only what was synced.
    Least,
    /// Everything, as after the death of the process alone.
    Most,
    /// What was synced, some of the later changes of names in their order, and any of the later
    /// sectors, others being zeros or garbage.
    Torn(u64),
}

#[derive(Clone, Default)]
pub struct SimFs(Arc<Shared>);

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Clone, Default)]
struct Inode {
    data: Vec<u8>,
    synced: usize,
    /// A sync has failed: the pages count as clean, and no later sync saves them.
    poisoned: bool,
}

#[derive(Clone)]
enum NameChange {
    Create(String, usize),
    Rename(String, String),
    Remove(String),
}

#[derive(Default)]
struct State {
    inodes: Vec<Inode>,
    names: BTreeMap<String, usize>,
    durable: BTreeMap<String, usize>,
    pending: Vec<NameChange>,
    folders: BTreeSet<String>,
    reserves: BTreeMap<String, u64>,
    calls: u64,
    fault: Option<(u64, Fault)>,
    crashed: bool,
    /// Bytes that the disk still takes; no limit where absent.
    room: Option<u64>,
    /// What it says its size is.
    total: u64,
    /// Syncs that still succeed; no limit where absent.
    syncs: Option<usize>,
    /// Every call fails like this.
    refusal: Option<ErrorKind>,
    stalled: bool,
}

fn folder_of(name: &str) -> &str {
    name.rsplit_once('/').map_or("", |(folder, _)| folder)
}

fn apply(names: &mut BTreeMap<String, usize>, change: &NameChange) {
    match change {
        NameChange::Create(name, inode) => {
            names.insert(name.clone(), *inode);
        }
        NameChange::Rename(from, to) => {
            if let Some(inode) = names.remove(from) {
                names.insert(to.clone(), inode);
            }
        }
        NameChange::Remove(name) => {
            names.remove(name);
        }
    }
}

impl NameChange {
    fn folder(&self) -> &str {
        match self {
            NameChange::Create(name, _) | NameChange::Remove(name) => folder_of(name),
            NameChange::Rename(from, _) => folder_of(from),
        }
    }
}

impl SimFs {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap()
    }

    /// Calls that change something, so far.
    pub fn calls(&self) -> u64 {
        self.lock().calls
    }

    /// Asks for a fault at the call with that number, from 1.
    pub fn fail_at(&self, call: u64, fault: Fault) {
        self.lock().fault = Some((call, fault));
    }

    /// The power goes now.
    pub fn cut(&self) {
        self.lock().crashed = true;
    }

    /// From now on every change is refused, as on a disk that has become read-only.
    pub fn set_refusal(&self, refusal: Option<ErrorKind>) {
        self.lock().refusal = refusal;
    }

    pub fn crashed(&self) -> bool {
        self.lock().crashed
    }

    /// From now on the disk takes that many bytes, over all files.
    pub fn set_room(&self, bytes: Option<usize>) {
        self.lock().room = bytes.map(|bytes| bytes as u64);
    }

    /// The size that the disk says it has; with 0, it never says that it is nearly full.
    pub fn set_total(&self, bytes: u64) {
        self.lock().total = bytes;
    }

    pub fn set_syncs(&self, syncs: Option<usize>) {
        self.lock().syncs = syncs;
    }

    /// Syncs wait until the guard is dropped.
    pub fn stall(&self) -> Stall {
        self.lock().stalled = true;
        Stall(self.clone())
    }

    /// The MCAP files as they are, by name.
    pub fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let state = self.lock();
        let logs = state.names.iter().filter(|(name, _)| name.ends_with(".mcap"));
        logs.map(|(name, &inode)| (name.clone(), state.inodes[inode].data.clone())).collect()
    }

    /// All files as they are, by name.
    pub fn all_files(&self) -> BTreeMap<String, Vec<u8>> {
        let state = self.lock();
        let all = state.names.iter();
        all.map(|(name, &inode)| (name.clone(), state.inodes[inode].data.clone())).collect()
    }

    /// Changes a file behind everybody's back.
    pub fn put(&self, name: &str, data: Vec<u8>) {
        let mut state = self.lock();
        let synced = data.len();
        state.inodes.push(Inode { data, synced, poisoned: false });
        let inode = state.inodes.len() - 1;
        state.names.insert(name.into(), inode);
        state.durable.insert(name.into(), inode);
        state.folders.insert(folder_of(name).into());
    }

    /// The disk after the power is back.
    pub fn after_crash(&self, survives: Survives) -> SimFs {
        let state = self.lock();
        let mut rng = match survives {
            Survives::Torn(seed) => Some(ChaCha8Rng::seed_from_u64(seed)),
            _ => None,
        };
        let mut names = state.durable.clone();
        let kept = match (&mut rng, survives) {
            (Some(rng), _) => rng.random_range(0..=state.pending.len()),
            (None, Survives::Most) => state.pending.len(),
            _ => 0,
        };
        state.pending[..kept].iter().for_each(|change| apply(&mut names, change));
        let after = SimFs::default();
        for (name, inode) in names {
            let inode = &state.inodes[inode];
            let data = match (&mut rng, survives) {
                (Some(rng), _) => torn(rng, inode),
                (None, Survives::Most) => inode.data.clone(),
                _ => inode.data[..inode.synced].to_vec(),
            };
            after.put(&name, data);
        }
        after.lock().folders.extend(state.folders.iter().cloned());
        after
    }
}

/// Sectors that were not synced: each there, zero, or garbage; up to any length.
fn torn(rng: &mut ChaCha8Rng, inode: &Inode) -> Vec<u8> {
    let length = rng.random_range(inode.synced..=inode.data.len());
    let mut data = inode.data[..length].to_vec();
    let mut at = inode.synced;
    while at < length {
        let end = (at / SECTOR * SECTOR + SECTOR).min(length);
        match rng.random_range(0..4) {
            0 => data[at..end].fill(0),
            1 => data[at..end].iter_mut().for_each(|byte| *byte = rng.random_range(0..=255)),
            _ => {}
        }
        at = end;
    }
    data
}

pub struct Stall(SimFs);

impl Drop for Stall {
    fn drop(&mut self) {
        self.0.lock().stalled = false;
        self.0.0.changed.notify_all();
    }
}

impl State {
    /// Counts a call; an error if it is to fail.
    fn call(&mut self) -> io::Result<()> {
        if self.crashed {
            return Err(io::Error::other("no power"));
        }
        self.calls += 1;
        if let Some(kind) = self.refusal {
            return Err(kind.into());
        }
        match self.fault {
            Some((at, Fault::Crash)) if self.calls == at => {
                self.crashed = true;
                Err(io::Error::other("no power"))
            }
            Some((at, Fault::Once(kind))) if self.calls == at => Err(kind.into()),
            _ => Ok(()),
        }
    }

    fn change(&mut self, change: NameChange) {
        apply(&mut self.names, &change);
        self.pending.push(change);
    }

    fn append(&mut self, inode: usize, bytes: &[u8]) -> usize {
        let taken = self.room.map_or(bytes.len(), |room| bytes.len().min(room as usize));
        if let Some(room) = &mut self.room {
            *room -= taken as u64;
        }
        self.inodes[inode].data.extend_from_slice(&bytes[..taken]);
        taken
    }

    fn free(&mut self, bytes: u64) {
        if let Some(room) = &mut self.room {
            *room += bytes;
        }
    }

    fn find(&self, name: &str) -> io::Result<usize> {
        self.names.get(name).copied().ok_or_else(|| ErrorKind::NotFound.into())
    }
}

impl Storage for SimFs {
    fn make_folder(&self, folder: &str) -> io::Result<()> {
        let mut state = self.lock();
        state.call()?;
        if state.folders.insert(folder.into()) {
            Ok(())
        } else {
            Err(ErrorKind::AlreadyExists.into())
        }
    }

    fn folders(&self) -> io::Result<Vec<String>> {
        Ok(self.lock().folders.iter().cloned().collect())
    }

    fn files(&self, folder: &str) -> io::Result<Vec<String>> {
        let state = self.lock();
        let inside = state.names.keys().filter(|name| folder_of(name) == folder);
        Ok(inside.map(|name| name[folder.len()..].trim_start_matches('/').to_owned()).collect())
    }

    fn create(&self, name: &str) -> io::Result<Arc<dyn LogFile>> {
        let mut state = self.lock();
        state.call()?;
        if state.names.contains_key(name) {
            return Err(ErrorKind::AlreadyExists.into());
        }
        state.inodes.push(Inode::default());
        let inode = state.inodes.len() - 1;
        state.change(NameChange::Create(name.into(), inode));
        Ok(Arc::new(SimFile { fs: self.clone(), inode }))
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn LogSource>> {
        let state = self.lock();
        if state.crashed {
            return Err(io::Error::other("no power"));
        }
        let data = state.inodes[state.find(name)?].data.clone();
        Ok(Box::new(Cursor::new(data)))
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        let mut state = self.lock();
        state.call()?;
        state.find(from)?;
        if let Ok(old) = state.find(to) {
            let bytes = state.inodes[old].data.len() as u64;
            state.free(bytes);
        }
        state.change(NameChange::Rename(from.into(), to.into()));
        Ok(())
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        let mut state = self.lock();
        if let Some(bytes) = state.reserves.remove(name) {
            state.call()?;
            state.free(bytes);
            return Ok(());
        }
        let inode = state.find(name)?;
        state.call()?;
        let bytes = state.inodes[inode].data.len() as u64;
        state.free(bytes);
        state.change(NameChange::Remove(name.into()));
        Ok(())
    }

    fn sync_folder(&self, folder: &str) -> io::Result<()> {
        let mut state = self.lock();
        state.call()?;
        let (done, left) =
            std::mem::take(&mut state.pending).into_iter().partition(|c| c.folder() == folder);
        state.pending = left;
        let done: Vec<NameChange> = done;
        done.iter().for_each(|change| apply(&mut state.durable, change));
        Ok(())
    }

    fn space(&self) -> io::Result<Space> {
        let state = self.lock();
        Ok(Space { free: state.room.unwrap_or(u64::MAX / 2), total: state.total })
    }

    fn reserve(&self, name: &str, bytes: u64) -> io::Result<()> {
        let mut state = self.lock();
        state.call()?;
        if let Some(room) = &mut state.room {
            *room = room.checked_sub(bytes).ok_or(ErrorKind::StorageFull)?;
        }
        state.reserves.insert(name.into(), bytes);
        Ok(())
    }

    fn in_use(&self, _: &str) -> io::Result<bool> {
        Ok(false)
    }
}

struct SimFile {
    fs: SimFs,
    inode: usize,
}

impl LogFile for SimFile {
    fn append(&self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.fs.lock();
        let goes_now = !state.crashed && state.fault == Some((state.calls + 1, Fault::Crash));
        if let Err(error) = state.call() {
            if goes_now {
                state.append(self.inode, &bytes[..bytes.len() / 2]);
            }
            return Err(error);
        }
        match state.append(self.inode, bytes) {
            0 if !bytes.is_empty() => Err(ErrorKind::StorageFull.into()),
            taken => Ok(taken),
        }
    }

    fn sync_data(&self) -> io::Result<()> {
        let state = self.fs.lock();
        let mut state = self.fs.0.changed.wait_while(state, |s| s.stalled).unwrap();
        let inode = self.inode;
        let mut outcome = state.call();
        match &mut state.syncs {
            Some(0) => outcome = Err(io::Error::other("sync failed")),
            Some(left) => *left -= 1,
            None => {}
        }
        if outcome.is_err() {
            state.inodes[inode].poisoned = true;
        } else if !state.inodes[inode].poisoned {
            state.inodes[inode].synced = state.inodes[inode].data.len();
        }
        outcome
    }
}
