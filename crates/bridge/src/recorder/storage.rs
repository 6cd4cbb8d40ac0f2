//! Where log files are made. A trait, so that tests can fill the disk at every byte.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file being written.
pub trait LogFile: Send {
    /// Where the bytes go.
    fn writer(&mut self) -> io::Result<Box<dyn Write + Send>>;

    /// Makes what was written, and flushed, safe from a power cut.
    fn sync_data(&mut self) -> io::Result<()>;
}

/// Makes log files.
pub trait Storage: Send {
    /// A new, empty file named `id` + `.mcap`; an error of kind `AlreadyExists` where the name is
    /// taken.
    fn create(&mut self, id: &str) -> io::Result<Box<dyn LogFile>>;
}

/// A folder of log files.
#[derive(Debug)]
pub struct LogFolder(PathBuf);

impl LogFolder {
    /// The folder `dir`; made with the first file.
    pub fn new(dir: &Path) -> LogFolder {
        LogFolder(dir.to_path_buf())
    }
}

impl Storage for LogFolder {
    fn create(&mut self, id: &str) -> io::Result<Box<dyn LogFile>> {
        std::fs::create_dir_all(&self.0)?;
        let path = self.0.join(format!("{id}.mcap"));
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        // The name, too, must survive a power cut.
        File::open(&self.0)?.sync_all()?;
        Ok(Box::new(FolderFile(file)))
    }
}

struct FolderFile(File);

impl LogFile for FolderFile {
    fn writer(&mut self) -> io::Result<Box<dyn Write + Send>> {
        Ok(Box::new(BufWriter::with_capacity(64 * 1024, self.0.try_clone()?)))
    }

    fn sync_data(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }
}
