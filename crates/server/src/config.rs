//! The configuration: `config/demo.toml` is both its documentation and its defaults.

mod keys;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bridge::commands::AuthorityRules;
use serde::Deserialize;
use terrain::cover::CoverLimits;
use terrain::traversability::Limits;
use wire::live::{CommandBody, LinkConfig};
use wire::scene::{Payload, PayloadShape};

pub use keys::{KEYS, Key, Range};

/// The text of `config/demo.toml`, which holds the default of every key.
pub const DEMO: &str = include_str!("../../../config/demo.toml");

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("the configuration {path} cannot be read: {reason}")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
    /// Not TOML, an unknown key, or a value of another type.
    #[error("the configuration is not usable: {0}")]
    Toml(String),
    /// A value out of range.
    #[error("the configuration has {key} = {value}, but it takes {allowed}")]
    OutOfRange {
        /// The key.
        key: &'static str,
        /// The value.
        value: String,
        /// What is allowed.
        allowed: String,
    },
}

/// All settings of the ground server. See `config/demo.toml` for what each is.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)] // documented in config/demo.toml, held by a test
pub struct Config {
    pub server: ServerConfig,
    pub rover: RoverConfig,
    pub terrain: TerrainConfig,
    pub link: LinkConfig,
    pub commands: CommandsConfig,
    pub traversability: TraversabilityConfig,
    pub unknown_ground: UnknownGroundConfig,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct ServerConfig {
    pub bind: String,
    pub port: u16,
    pub terrain_dir: PathBuf,
    pub robots_dir: PathBuf,
    pub logs_dir: PathBuf,
    pub analyses_max: usize,
    pub analyses_waiting_max: usize,
    pub listeners_max: usize,
    pub jobs_max: usize,
    pub replays_max: usize,
    pub terrain_versions_max: usize,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct RoverConfig {
    pub robot: String,
    pub scale: f64,
    pub gravity_m_s2: f64,
    pub pose: String,
    pub place_x_m: f64,
    pub place_y_m: f64,
    pub heading_rad: f64,
    pub payload_link: String,
    pub payload_mass_kg: f64,
    pub payload_x_m: f64,
    pub payload_y_m: f64,
    pub payload_z_m: f64,
    pub payload_box_x_m: f64,
    pub payload_box_y_m: f64,
    pub payload_box_z_m: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct TerrainConfig {
    pub file: String,
    pub crop_x_m: f64,
    pub crop_y_m: f64,
    pub crop_width_m: f64,
    pub detail_resolution_m: f64,
    pub recipe: String,
    pub width_m: f64,
    pub resolution_m: f64,
    pub seed: u64,
    pub flat_center_m: f64,
    pub friction: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct TraversabilityConfig {
    pub footprint_m: f64,
    pub slope_lo_rad: f64,
    pub slope_hi_rad: f64,
    pub roughness_lo_m: f64,
    pub roughness_hi_m: f64,
    pub step_lo_m: f64,
    pub step_hi_m: f64,
    pub known_share_min: f64,
    pub quadrant_known_min: f64,
    pub unsafe_below: f64,
    pub caution_below: f64,
    pub certainty_caution_below: f64,
    pub doubt_sigmas: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct UnknownGroundConfig {
    pub edge_m: f64,
    pub rise_m: f64,
    pub slope_rad: f64,
    pub reach_m: f64,
}

impl UnknownGroundConfig {
    /// What unknown ground is taken to do at most.
    pub fn limits(&self) -> CoverLimits {
        let UnknownGroundConfig { edge_m, rise_m, slope_rad, reach_m } = *self;
        CoverLimits { edge_m, rise_m, slope: slope_rad.tan(), reach_m }
    }
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct CommandsConfig {
    pub authority: String,
    pub authority_lease_s: f64,
    pub two_persons: String,
    pub heartbeat_s: f64,
    pub silence_max_s: f64,
}

/// Types of commands that two persons can be asked for; a stop is never held up.
const TWO_PERSON_TYPES: [&str; 12] = [
    "joint_path",
    "body_path",
    "wheel_line",
    "joint_move",
    "wheel_move",
    "body_move",
    "wheel_brake",
    "wheel_roll",
    "wheel_steer",
    "drive_arc",
    "mode",
    "sequence",
];

impl CommandsConfig {
    /// Refuses a word that is no type of command: it would protect nothing.
    fn check(&self) -> Result<(), ConfigError> {
        let unknown = |word: &&str| !TWO_PERSON_TYPES.contains(word);
        match self.two_persons.split_whitespace().find(unknown) {
            None => Ok(()),
            Some(word) => Err(ConfigError::OutOfRange {
                key: "commands.two_persons",
                value: word.chars().take(80).collect(),
                allowed: format!("types of commands: {}", TWO_PERSON_TYPES.join(" ")),
            }),
        }
    }

    /// How the authority to command is given.
    pub fn authority_rules(&self) -> AuthorityRules {
        let explicit = self.authority == "explicit";
        AuthorityRules { explicit, lease_s: self.authority_lease_s }
    }

    /// Does a command of this body take a second person's word?
    pub fn takes_two(&self, body: &CommandBody) -> bool {
        let of_type = serde_json::to_value(body).ok();
        let of_type = of_type.as_ref().and_then(|body| body.get("type")?.as_str());
        let steps = match body {
            CommandBody::Sequence { steps } => &steps[..],
            _ => &[],
        };
        // A sequence takes what any of its steps takes; nested ones are refused elsewhere.
        self.two_persons.split_whitespace().any(|word| Some(word) == of_type)
            || steps.iter().any(|step| {
                !matches!(step.body, CommandBody::Sequence { .. }) && self.takes_two(&step.body)
            })
    }

    /// Time between heartbeats (s), if there are any.
    pub fn heartbeat_s(&self) -> Option<f64> {
        (self.heartbeat_s > 0.0).then_some(self.heartbeat_s)
    }

    /// How long a moving rover does without the ground (s), if there is a limit.
    pub fn silence_max_s(&self) -> Option<f64> {
        (self.silence_max_s > 0.0).then_some(self.silence_max_s)
    }
}

impl Config {
    /// The demo mission.
    pub fn demo() -> Config {
        Config::parse("").expect("config/demo.toml is usable, as a test holds")
    }

    /// Reads a file.
    pub fn load(path: &Path) -> Result<Config, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|e| ConfigError::Unreadable {
            path: path.display().to_string(),
            reason: e.to_string(),
        })?;
        Config::parse(&text)
    }

    /// Reads TOML; what it leaves out is as in the demo.
    pub fn parse(text: &str) -> Result<Config, ConfigError> {
        let toml_error = |e: toml::de::Error| ConfigError::Toml(e.to_string().trim_end().into());
        let mut table: toml::Table = DEMO.parse().map_err(toml_error)?;
        let changes: toml::Table = text.parse().map_err(toml_error)?;
        for (section, values) in changes {
            match (table.get_mut(&section), values) {
                (Some(toml::Value::Table(base)), toml::Value::Table(values)) => base.extend(values),
                (_, values) => {
                    table.insert(section, values);
                }
            }
        }
        keys::check(&table)?;
        let config = Config::deserialize(toml::Value::Table(table)).map_err(toml_error)?;
        config.commands.check()?;
        Ok(config)
    }
}

impl RoverConfig {
    /// The payloads that the rover carries.
    pub fn payloads(&self) -> Vec<Payload> {
        if self.payload_link.is_empty() {
            return Vec::new();
        }
        let box_m = [self.payload_box_x_m, self.payload_box_y_m, self.payload_box_z_m];
        vec![Payload {
            link: self.payload_link.clone(),
            mass_kg: self.payload_mass_kg,
            com_m: [self.payload_x_m, self.payload_y_m, self.payload_z_m],
            shape: box_m.iter().all(|edge| *edge > 0.0).then_some(PayloadShape { box_m }),
            shapes: Vec::new(),
            limits_rad: BTreeMap::new(),
        }]
    }
}

impl TraversabilityConfig {
    /// The thresholds.
    pub fn limits(&self) -> Limits {
        Limits {
            slope_lo_rad: self.slope_lo_rad,
            slope_hi_rad: self.slope_hi_rad,
            roughness_lo_m: self.roughness_lo_m,
            roughness_hi_m: self.roughness_hi_m,
            step_lo_m: self.step_lo_m,
            step_hi_m: self.step_hi_m,
            known_share_min: self.known_share_min,
            quadrant_known_min: self.quadrant_known_min,
            unsafe_below: self.unsafe_below,
            caution_below: self.caution_below,
            certainty_caution_below: self.certainty_caution_below,
        }
    }
}
