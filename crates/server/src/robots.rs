//! Robot folders: those of the configured folders, then the ones built into the program.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use rover::Robot;
use rust_embed::RustEmbed;
use wire::check::{At, RequestError};

/// Largest file of a robot's folder that is read (bytes).
const FILE_BYTES_MAX: u64 = 16 << 20;

#[derive(RustEmbed)]
#[folder = "../../fixtures/robots/"]
struct BuiltIn;

/// The robots that there are.
pub struct Robots {
    dirs: Vec<PathBuf>,
    loaded: Mutex<HashMap<String, Arc<Robot>>>,
}

/// True if `name` may be a folder's name: `[A-Za-z0-9_-]`, 1 to 64 characters.
pub fn is_robot_name(name: &str) -> bool {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b == b'-';
    (1..=64).contains(&name.len()) && name.bytes().all(plain)
}

impl Robots {
    /// The robots of these folders, the first one that has a name winning, and the built-in ones.
    pub fn new(dirs: Vec<PathBuf>) -> Robots {
        Robots { dirs, loaded: Mutex::default() }
    }

    /// The robot of that name at the scale of its folder. Loaded once.
    pub fn load(&self, at: &At<'_>, name: &str) -> Result<Arc<Robot>, RequestError> {
        if let Some(robot) = self.loaded().get(name) {
            return Ok(robot.clone());
        }
        let toml = self.text(name, "robot.toml").ok_or_else(|| self.unknown(at, name))?;
        let robot =
            Robot::from_folder(&toml, |file| self.text(name, file), |mesh| self.bytes(name, mesh))
                .map_err(|error| {
                    RequestError::at(
                        "robot_invalid",
                        at,
                        format_args!("names a robot in which {error}"),
                    )
                })?;
        let robot = Arc::new(robot);
        self.loaded().insert(name.into(), robot.clone());
        Ok(robot)
    }

    /// The URDF of a robot, as it stands in its folder.
    pub fn urdf(&self, at: &At<'_>, name: &str) -> Result<String, RequestError> {
        self.load(at, name)?;
        let toml = self.text(name, "robot.toml").ok_or_else(|| self.unknown(at, name))?;
        let file = toml
            .parse::<toml::Table>()
            .ok()
            .and_then(|table| Some(table.get("urdf")?.as_str()?.to_owned()));
        file.and_then(|file| self.text(name, &file)).ok_or_else(|| self.unknown(at, name))
    }

    /// The `robot.toml` of a robot, as it stands in its folder.
    pub fn toml(&self, at: &At<'_>, name: &str) -> Result<String, RequestError> {
        self.load(at, name)?;
        self.text(name, "robot.toml").ok_or_else(|| self.unknown(at, name))
    }

    /// Names of all robots, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = BuiltIn::iter()
            .filter_map(|path| path.strip_suffix("/robot.toml").map(str::to_owned))
            .collect();
        for dir in &self.dirs {
            let entries = std::fs::read_dir(dir).into_iter().flatten().flatten();
            names.extend(
                entries
                    .filter(|entry| entry.path().join("robot.toml").is_file())
                    .filter_map(|entry| entry.file_name().into_string().ok()),
            );
        }
        names.sort();
        names.dedup();
        names
    }

    fn loaded(&self) -> std::sync::MutexGuard<'_, HashMap<String, Arc<Robot>>> {
        self.loaded.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn unknown(&self, at: &At<'_>, name: &str) -> RequestError {
        let name: String = name.chars().take(64).collect();
        let names = self.names().join(", ");
        let text = format_args!("names the robot {name:?}; there is {names} (see --robots)");
        RequestError::at("robot_unknown", at, text)
    }

    fn text(&self, robot: &str, file: &str) -> Option<String> {
        String::from_utf8(self.bytes(robot, file)?).ok()
    }

    /// A file of a robot's folder: a plain relative path that stays inside.
    fn bytes(&self, robot: &str, file: &str) -> Option<Vec<u8>> {
        let inside = |part: &str| !part.is_empty() && part != "." && part != "..";
        let plain = !file.contains(['\\', '\0', ':']) && file.split('/').all(inside);
        if !is_robot_name(robot) || !plain {
            return None;
        }
        let folder = self.dirs.iter().map(|dir| dir.join(robot)).find(|d| d.is_dir());
        match folder {
            Some(folder) => read_inside(&folder, file),
            None => BuiltIn::get(&format!("{robot}/{file}")).map(|file| file.data.into_owned()),
        }
    }
}

/// Reads a file below `folder`, also behind symbolic links only if they stay below it.
fn read_inside(folder: &Path, file: &str) -> Option<Vec<u8>> {
    let folder = folder.canonicalize().ok()?;
    let path = folder.join(file).canonicalize().ok()?;
    let size = std::fs::metadata(&path).ok().filter(|m| m.is_file())?.len();
    (path.starts_with(&folder) && size <= FILE_BYTES_MAX).then(|| std::fs::read(path).ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn athlete_is_built_in_and_its_urdf_can_be_had() {
        let robots = Robots::new(Vec::new());
        let at = At::root("robot");
        assert_eq!(robots.load(&at, "athlete").unwrap().legs().len(), 6);
        assert!(robots.urdf(&at, "athlete").unwrap().contains("<robot"));
        assert!(robots.names().contains(&"athlete".to_owned()));
    }

    #[test]
    fn names_that_are_no_plain_names_are_unknown_robots() {
        let robots = Robots::new(vec![testkit::project_dir().join("fixtures/robots")]);
        let at = At::root("robot");
        for name in ["", "..", "../robots/athlete", "athlete/", "a\0b", "nobody"] {
            assert_eq!(robots.load(&at, name).unwrap_err().code, "robot_unknown", "{name:?}");
        }
        assert!(robots.bytes("athlete", "../athlete/robot.toml").is_none());
    }
}
