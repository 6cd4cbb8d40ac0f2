//! Where log files are kept. A trait, so that tests can cut the power at every call.
//!
//! Names are `folder/file` or `file`, made by this program and never taken from requests.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file being written.
pub trait LogFile: Send + Sync {
    /// Takes some bytes at the end; how many it took.
    fn append(&self, bytes: &[u8]) -> io::Result<usize>;

    /// Makes what was appended safe from a power cut.
    fn sync_data(&self) -> io::Result<()>;
}

/// A file being read.
pub trait LogSource: Read + Seek + Send {}
impl<T: Read + Seek + Send> LogSource for T {}

/// Room on the disk (bytes).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// What may still be written.
    pub free: u64,
    /// All of it.
    pub total: u64,
}

/// The folder of the logs. Nothing but synced data under a synced name survives a power cut.
pub trait Storage: Send + Sync {
    /// A new folder, whose name is synced; an error of kind `AlreadyExists` where it is taken.
    fn make_folder(&self, folder: &str) -> io::Result<()>;
    /// The names of all folders.
    fn folders(&self) -> io::Result<Vec<String>>;
    /// The names of the files of a folder.
    fn files(&self, folder: &str) -> io::Result<Vec<String>>;
    /// A new, empty file, held by this process; an error of kind `AlreadyExists` where the name is
    /// taken. The name is not synced.
    fn create(&self, name: &str) -> io::Result<Arc<dyn LogFile>>;
    /// Opens a file to read it.
    fn open(&self, name: &str) -> io::Result<Box<dyn LogSource>>;
    /// Gives a file another name, in place of what has that name. The name is not synced.
    fn rename(&self, from: &str, to: &str) -> io::Result<()>;
    /// Removes a file. Not synced.
    fn remove(&self, name: &str) -> io::Result<()>;
    /// Makes the names in a folder safe from a power cut.
    fn sync_folder(&self, folder: &str) -> io::Result<()>;
    /// Room on the disk.
    fn space(&self) -> io::Result<Space>;
    /// A file that does nothing but hold `bytes` of room.
    fn reserve(&self, name: &str, bytes: u64) -> io::Result<()>;
    /// True while a living process writes the file.
    fn in_use(&self, name: &str) -> io::Result<bool>;
}

/// A folder of the disk.
#[derive(Debug)]
pub struct LogFolder(PathBuf);

impl LogFolder {
    /// The folder `dir`; made with the first log.
    pub fn new(dir: &Path) -> LogFolder {
        LogFolder(dir.to_path_buf())
    }

    fn names(
        &self,
        folder: &str,
        wanted: fn(&std::fs::FileType) -> bool,
    ) -> io::Result<Vec<String>> {
        let entries = match std::fs::read_dir(self.0.join(folder)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries?,
        };
        let mut names = Vec::new();
        for entry in entries {
            let entry = entry?;
            // Names that are no text are not ours.
            if let (true, Ok(name)) = (wanted(&entry.file_type()?), entry.file_name().into_string())
            {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }
}

impl Storage for LogFolder {
    fn make_folder(&self, folder: &str) -> io::Result<()> {
        std::fs::create_dir_all(&self.0)?;
        std::fs::create_dir(self.0.join(folder))?;
        File::open(&self.0)?.sync_all()
    }

    fn folders(&self) -> io::Result<Vec<String>> {
        self.names("", std::fs::FileType::is_dir)
    }

    fn files(&self, folder: &str) -> io::Result<Vec<String>> {
        self.names(folder, std::fs::FileType::is_file)
    }

    fn create(&self, name: &str) -> io::Result<Arc<dyn LogFile>> {
        let file = OpenOptions::new().write(true).create_new(true).open(self.0.join(name))?;
        // Held until the process ends, however it ends: a recovery by another one passes it over.
        match file.try_lock() {
            Ok(()) | Err(TryLockError::WouldBlock) => {}
            Err(TryLockError::Error(error)) => tracing::warn!("{name} cannot be locked: {error}"),
        }
        Ok(Arc::new(FolderFile(file)))
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn LogSource>> {
        Ok(Box::new(File::open(self.0.join(name))?))
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        std::fs::rename(self.0.join(from), self.0.join(to))
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        std::fs::remove_file(self.0.join(name))
    }

    fn sync_folder(&self, folder: &str) -> io::Result<()> {
        File::open(self.0.join(folder))?.sync_all()
    }

    fn space(&self) -> io::Result<Space> {
        let stat = rustix::fs::statvfs(&self.0)?;
        let bytes = |blocks: u64| blocks.saturating_mul(stat.f_frsize);
        Ok(Space { free: bytes(stat.f_bavail), total: bytes(stat.f_blocks) })
    }

    fn reserve(&self, name: &str, bytes: u64) -> io::Result<()> {
        let path = self.0.join(name);
        let file = OpenOptions::new().write(true).create(true).truncate(true).open(&path)?;
        let held = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes)
            .map_err(io::Error::from);
        match held {
            Err(error) if error.kind() == io::ErrorKind::Unsupported => {
                // A file system without preallocation: zeros take the room.
                let (zeros, mut left) = (vec![0; 1 << 20], bytes);
                while left > 0 {
                    let n = left.min(zeros.len() as u64);
                    (&file).write_all(&zeros[..n as usize])?;
                    left -= n;
                }
                Ok(())
            }
            held => held,
        }
        .inspect_err(|_| {
            // A reserve that is not whole is none; what is left of it holds no room up.
            let _ = std::fs::remove_file(&path);
        })
    }

    fn in_use(&self, name: &str) -> io::Result<bool> {
        let file = OpenOptions::new().read(true).open(self.0.join(name))?;
        match file.try_lock() {
            Ok(()) => Ok(false),
            Err(TryLockError::WouldBlock) => Ok(true),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }
}

struct FolderFile(File);

impl LogFile for FolderFile {
    fn append(&self, bytes: &[u8]) -> io::Result<usize> {
        (&self.0).write(bytes)
    }

    fn sync_data(&self) -> io::Result<()> {
        self.0.sync_data()
    }
}
