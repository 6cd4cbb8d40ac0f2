//! Links to begin with.

use wire::live::{DirectionModel, Jitter, LinkConfig};

/// Names of the presets with what they are.
pub const PRESETS: [(&str, &str); 4] = [
    ("lab", "no delay, no limits"),
    ("moon", "Moon, direct: 1.28 s of light time; 16 kbit/s up, 256 kbit/s down"),
    ("moon_relay", "Moon through a relay that stores and forwards: 2.0 s and up to 0.5 s more"),
    ("mars", "Mars at its mean distance: 750 s; 2 kbit/s up, 32 kbit/s down"),
];

/// A preset. Light times are distance over speed of light: Moon 384 400 km (1.19 to 1.36 s over a
/// month), Mars 55 to 401 million km (3 to 22.4 min), here 225. Relays of lunar missions add 0.3 to 1.5 s.
/// Rates are typical of small missions, chosen, not those of one spacecraft.
pub fn preset(name: &str) -> Option<LinkConfig> {
    let link = |delay_s, up_bps: f64, down_bps: f64, jitter| {
        let model = |rate_bps, mtu_bytes| {
            let rate_bps = Some(rate_bps);
            Some(DirectionModel { rate_bps, mtu_bytes, jitter, ..DirectionModel::default() })
        };
        LinkConfig {
            up_delay_s: delay_s,
            down_delay_s: delay_s,
            up: model(up_bps, 256),
            down: model(down_bps, 1024),
        }
    };
    match name {
        "lab" => Some(LinkConfig::delays(0.0, 0.0)),
        "moon" => Some(link(1.28, 16e3, 256e3, Jitter::None {})),
        "moon_relay" => {
            let jitter = Jitter::TruncatedNormal { sigma_s: 0.1, most_s: 0.5 };
            Some(link(2.0, 16e3, 256e3, jitter))
        }
        "mars" => Some(link(750.0, 2e3, 32e3, Jitter::None {})),
        _ => None,
    }
}
