//! Every key of the configuration with its unit and range.

use super::ConfigError;

/// What a key may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// A number between two, both included.
    Number(f64, f64),
    /// Text of this kind.
    Text(&'static str),
}

/// A key.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Section and name, as `link.up_delay_s`.
    pub path: &'static str,
    /// Unit; empty for plain numbers and text.
    pub unit: &'static str,
    /// What it may be.
    pub range: Range,
}

const fn number(path: &'static str, unit: &'static str, min: f64, max: f64) -> Key {
    Key { path, unit, range: Range::Number(min, max) }
}

const fn text(path: &'static str, kind: &'static str) -> Key {
    Key { path, unit: "", range: Range::Text(kind) }
}

/// All keys, in the order of `config/demo.toml`.
#[rustfmt::skip]
pub const KEYS: [Key; 61] = [
    text("server.bind", "loopback address"),
    number("server.port", "", 0.0, 65535.0),
    text("server.terrain_dir", "folder"),
    text("server.robots_dir", "folder or empty"),
    text("server.logs_dir", "folder"),
    number("server.analyses_max", "", 1.0, 64.0),
    number("server.analyses_waiting_max", "", 0.0, 1000.0),
    number("server.listeners_max", "", 1.0, 1000.0),
    number("server.jobs_max", "", 1.0, 1000.0),
    number("server.replays_max", "", 1.0, 100.0),
    number("server.terrain_versions_max", "", 1.0, 64.0),
    text("rover.robot", "name"),
    number("rover.scale", "", 0.001, 1000.0),
    number("rover.gravity_m_s2", "m/s²", 0.01, 100.0),
    text("rover.pose", "name"),
    number("rover.place_x_m", "m", -1e6, 1e6),
    number("rover.place_y_m", "m", -1e6, 1e6),
    number("rover.heading_rad", "rad", -7.0, 7.0),
    text("rover.payload_link", "name or empty"),
    number("rover.payload_mass_kg", "kg", 0.0, 1e6),
    number("rover.payload_x_m", "m", -1000.0, 1000.0),
    number("rover.payload_y_m", "m", -1000.0, 1000.0),
    number("rover.payload_z_m", "m", -1000.0, 1000.0),
    number("rover.payload_box_x_m", "m", 0.0, 1000.0),
    number("rover.payload_box_y_m", "m", 0.0, 1000.0),
    number("rover.payload_box_z_m", "m", 0.0, 1000.0),
    text("terrain.file", "file name or empty"),
    number("terrain.crop_x_m", "m", -1.0, 1e7),
    number("terrain.crop_y_m", "m", -1.0, 1e7),
    number("terrain.crop_width_m", "m", 0.0, 1e7),
    number("terrain.detail_resolution_m", "m", 0.0, 10.0),
    text("terrain.recipe", "boulder_field, smooth_mare, rough_highlands"),
    number("terrain.width_m", "m", 1.0, 1000.0),
    number("terrain.resolution_m", "m", 0.005, 10.0),
    number("terrain.seed", "", 0.0, 4_294_967_295.0),
    number("terrain.flat_center_m", "m", 0.0, 1000.0),
    number("terrain.friction", "", 0.0, 10.0),
    number("link.up_delay_s", "s", 0.0, 1800.0),
    number("link.down_delay_s", "s", 0.0, 1800.0),
    text("commands.authority", "arming, explicit"),
    number("commands.authority_lease_s", "s", 1.0, 3600.0),
    text("commands.two_persons", "types of commands separated by spaces or empty"),
    number("commands.heartbeat_s", "s", 0.0, 3600.0),
    number("commands.silence_max_s", "s", 0.0, 86400.0),
    number("traversability.footprint_m", "m", 0.001, 1000.0),
    number("traversability.slope_lo_rad", "rad", 0.0, 1.57),
    number("traversability.slope_hi_rad", "rad", 0.0, 1.57),
    number("traversability.roughness_lo_m", "m", 0.0, 100.0),
    number("traversability.roughness_hi_m", "m", 0.0, 100.0),
    number("traversability.step_lo_m", "m", 0.0, 100.0),
    number("traversability.step_hi_m", "m", 0.0, 100.0),
    number("traversability.known_share_min", "", 0.0, 1.0),
    number("traversability.quadrant_known_min", "", 0.0, 1.0),
    number("traversability.unsafe_below", "", 0.0, 1.0),
    number("traversability.caution_below", "", 0.0, 1.0),
    number("traversability.certainty_caution_below", "", 0.0, 1.0),
    number("traversability.doubt_sigmas", "", 0.0, 10.0),
    number("unknown_ground.edge_m", "m", 0.0, 10.0),
    number("unknown_ground.rise_m", "m", 0.0, 10.0),
    number("unknown_ground.slope_rad", "rad", 0.0, 1.4),
    number("unknown_ground.reach_m", "m", 0.0, 10.0),
];

impl Key {
    /// What stands in brackets behind the key in `config/demo.toml`.
    pub fn allowed(&self) -> String {
        match self.range {
            Range::Number(min, max) if self.unit.is_empty() => format!("{min} to {max}"),
            Range::Number(min, max) => format!("{}, {min} to {max}", self.unit),
            Range::Text(kind) => kind.into(),
        }
    }

    fn check(&self, value: &toml::Value) -> Result<(), ConfigError> {
        let number = value.as_float().or_else(|| value.as_integer().map(|i| i as f64));
        let inside = match self.range {
            Range::Number(min, max) => number.is_some_and(|v| (min..=max).contains(&v)),
            Range::Text("name") => value.as_str().is_some_and(|s| !s.is_empty()),
            Range::Text(list) if list.contains(", ") => {
                value.as_str().is_some_and(|s| list.split(", ").any(|item| item == s))
            }
            Range::Text(_) => value.is_str(),
        };
        if inside {
            return Ok(());
        }
        let value = value.to_string().chars().take(80).collect();
        let allowed = match self.range {
            Range::Number(min, max) if self.unit.is_empty() => format!("{min} to {max}"),
            Range::Number(min, max) => format!("{min} to {max} {}", self.unit),
            Range::Text(kind) => kind.into(),
        };
        Err(ConfigError::OutOfRange { key: self.path, value, allowed })
    }
}

/// Checks all values that are there; missing and unknown ones are for the parser.
pub(super) fn check(table: &toml::Table) -> Result<(), ConfigError> {
    for key in &KEYS {
        let (section, name) = key.path.split_once('.').expect("a key has a section");
        if let Some(value) = table.get(section).and_then(|section| section.get(name)) {
            key.check(value)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::{Config, DEMO};
    use super::*;

    /// The keys of the demo's file with the comments behind them.
    fn documented() -> Vec<(String, String)> {
        let mut section = String::new();
        let mut keys = Vec::new();
        for line in DEMO.lines() {
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                section = name.into();
            } else if let Some((key, rest)) = line.split_once(" = ")
                && !line.starts_with('#')
            {
                let comment = rest.split_once(" # ").map_or("", |(_, comment)| comment);
                keys.push((format!("{section}.{}", key.trim()), comment.into()));
            }
        }
        keys
    }

    #[test]
    fn the_file_documents_every_key_with_unit_and_range() {
        let documented = documented();
        let names: Vec<&str> = documented.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, KEYS.map(|key| key.path));
        for ((name, comment), key) in documented.iter().zip(&KEYS) {
            let brackets = format!(" [{}]", key.allowed());
            assert!(comment.ends_with(&brackets), "{name}: {comment:?} does not end in {brackets}");
        }
    }

    #[test]
    fn every_key_is_checked_against_its_range() {
        for key in KEYS {
            let (section, name) = key.path.split_once('.').unwrap();
            let bad = match key.range {
                Range::Number(_, max) => vec![format!("{}", max * 2.0 + 1.0), "nan".into()],
                Range::Text(_) => vec!["5".into()],
            };
            for value in bad {
                let refused = Config::parse(&format!("[{section}]\n{name} = {value}\n"));
                let expected = matches!(&refused, Err(ConfigError::OutOfRange { key: k, .. }) if *k == key.path);
                assert!(expected, "{} = {value}: {refused:?}", key.path);
            }
        }
    }

    #[test]
    fn unknown_keys_and_sections_are_refused() {
        for text in ["[link]\ndelay = 1.0\n", "[links]\n", "port = 1\n", "[server]\nport = 1.5\n"] {
            assert!(matches!(Config::parse(text), Err(ConfigError::Toml(_))), "{text}");
        }
    }

    #[test]
    fn what_is_left_out_is_as_in_the_demo() {
        let config = Config::parse("[link]\nup_delay_s = 5.0\n").unwrap();
        assert_eq!(config.link.up_delay_s, 5.0);
        assert_eq!(config.link.down_delay_s, Config::demo().link.down_delay_s);
        assert_eq!(config.traversability.footprint_m, 0.55);
    }

    #[test]
    fn a_word_that_is_no_type_of_command_is_refused() {
        let config =
            |words: &str| Config::parse(&format!("[commands]\ntwo_persons = \"{words}\"\n"));
        assert!(config("joint_path  wheel_line").is_ok());
        let refused = config("joint_path jointpath").unwrap_err().to_string();
        assert!(refused.contains("commands.two_persons = jointpath"), "{refused}");
        assert!(config("stop").is_err(), "a stop waits for nobody");
    }
}
