//! The model of one direction, checked and ready to use.

use wire::live::{DirectionModel, Jitter, LinkClass, LinkConfig, Loss, Outage, OutageTraffic};
use wire::time::Timestamp;

/// Longest one-way delay that can be set (s): beyond Mars at its farthest.
pub const MAX_DELAY_S: f64 = 1800.0;
const JITTER_MAX_S: f64 = 60.0;
const ENTRIES_MAX: usize = 1000;
const SEED_MAX: u64 = 1 << 53;

/// A model that cannot be set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} {problem}")]
pub struct LinkError {
    /// The field of the request.
    pub field: String,
    /// What it is and what it takes.
    pub problem: String,
}

/// The model of one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    delay_ns: u64,
    /// Moment and light time (ns), in order.
    table: Vec<(u64, u64)>,
    /// Millionths of a bit per second; no limit where absent.
    rate_microbps: Option<u128>,
    model: DirectionModel,
}

/// Both directions of a link, up and down.
pub fn check(link: &LinkConfig) -> Result<[Settings; 2], LinkError> {
    Ok([
        Settings::new("up", link.up_delay_s, link.up.as_ref())?,
        Settings::new("down", link.down_delay_s, link.down.as_ref())?,
    ])
}

impl Settings {
    /// A direction of that name, with this delay (s) and model; a plain delay where there is none.
    pub fn new(
        name: &str,
        delay_s: f64,
        model: Option<&DirectionModel>,
    ) -> Result<Settings, LinkError> {
        within(&format!("{name}_delay_s"), delay_s, [0.0, MAX_DELAY_S], "s")?;
        let model = model.cloned().unwrap_or_default();
        let at = |field: &str| format!("{name}.{field}");
        check_light_times(&at("light_times"), &model)?;
        check_jitter(&at("jitter"), model.jitter)?;
        if let Some(rate_bps) = model.rate_bps {
            within(&at("rate_bps"), rate_bps, [1.0, 1e12], "bit/s")?;
        }
        within(&at("mtu_bytes"), f64::from(model.mtu_bytes), [16.0, 1_048_576.0], "bytes")?;
        check_queues(&at("queues"), &model)?;
        check_loss(&at("loss"), model.loss)?;
        for (field, value) in [("corruption", model.corruption), ("duplication", model.duplication)]
        {
            within(&at(field), value, [0.0, 1.0], "")?;
        }
        check_outages(&at("outages"), &model)?;
        if model.seed > SEED_MAX {
            return Err(error(at("seed"), format!("is {}; it takes 0 to 2^53", model.seed)));
        }
        let table = model.light_times.iter().map(|entry| (entry.time.0, nanos(entry.delay_s)));
        Ok(Settings {
            delay_ns: nanos(delay_s),
            table: table.collect(),
            rate_microbps: model.rate_bps.map(|rate| (rate * 1e6).round() as u128),
            model,
        })
    }

    /// The model beside the delay.
    pub fn model(&self) -> &DirectionModel {
        &self.model
    }

    /// The model, or none where it is a plain delay.
    pub fn beyond_delay(&self) -> Option<DirectionModel> {
        (self.model != DirectionModel::default()).then(|| self.model.clone())
    }

    /// Light time at a moment (ns).
    pub fn light_ns(&self, at: Timestamp) -> u64 {
        let after = self.table.partition_point(|(time, _)| *time <= at.0);
        match (after.checked_sub(1).map(|i| self.table[i]), self.table.get(after)) {
            (None, None) => self.delay_ns,
            (Some((_, delay)), None) => delay,
            (None, Some((_, delay))) => *delay,
            (Some((t0, d0)), Some((t1, d1))) => {
                let (span, into) = (i128::from(t1 - t0), i128::from(at.0 - t0));
                let rise = (i128::from(*d1) - i128::from(d0)) * into / span;
                (i128::from(d0) + rise) as u64
            }
        }
    }

    /// Light time at a moment (s).
    pub fn light_s(&self, at: Timestamp) -> f64 {
        self.light_ns(at) as f64 / 1e9
    }

    /// Most that jitter adds (s).
    pub fn jitter_max_s(&self) -> f64 {
        match self.model.jitter {
            Jitter::None {} => 0.0,
            Jitter::Uniform { most_s } | Jitter::TruncatedNormal { most_s, .. } => most_s,
        }
    }

    /// End of a frame that begins at `at`; whole nanoseconds, rounded up.
    pub(super) fn frame_end(&self, at: Timestamp, bytes: u32) -> Timestamp {
        let Some(rate) = self.rate_microbps else { return at };
        let ns = (u128::from(bytes) * 8 * 1_000_000_000_000_000).div_ceil(rate);
        Timestamp(at.0.saturating_add(u64::try_from(ns).unwrap_or(u64::MAX)))
    }

    /// The first moment from `at` on that is not in an outage that holds.
    pub fn open_from(&self, at: Timestamp) -> Timestamp {
        self.first_beyond(at, |outage| outage.traffic == OutageTraffic::Hold)
    }

    /// The first moment from `at` on that is not in any outage.
    pub fn clear_from(&self, at: Timestamp) -> Timestamp {
        self.first_beyond(at, |_| true)
    }

    fn first_beyond(&self, at: Timestamp, which: impl Fn(&Outage) -> bool) -> Timestamp {
        let first = self.model.outages.partition_point(|outage| outage.end <= at);
        let mut at = at;
        for outage in &self.model.outages[first..] {
            if outage.begin > at || !which(outage) {
                break;
            }
            at = outage.end;
        }
        at
    }

    /// Outages as they are noticed at the other end: from when to when nothing arrives.
    pub fn silences(&self) -> impl Iterator<Item = [Timestamp; 2]> {
        let arrival = |at: Timestamp| Timestamp(at.0.saturating_add(self.light_ns(at)));
        self.model.outages.iter().map(move |outage| [outage.begin, outage.end].map(arrival))
    }

    /// Is what begins at `at` lost in an outage?
    pub(super) fn loses(&self, at: Timestamp) -> bool {
        let first = self.model.outages.partition_point(|outage| outage.end <= at);
        let outage = self.model.outages.get(first);
        outage.is_some_and(|o| o.begin <= at && o.traffic == OutageTraffic::Lose)
    }
}

fn check_light_times(at: &str, model: &DirectionModel) -> Result<(), LinkError> {
    at_most(at, model.light_times.len())?;
    for (i, entry) in model.light_times.iter().enumerate() {
        within(&format!("{at}[{i}].delay_s"), entry.delay_s, [0.0, MAX_DELAY_S], "s")?;
        if i > 0 && entry.time <= model.light_times[i - 1].time {
            let problem = "is not after the entry before; list them in order of time";
            return Err(error(format!("{at}[{i}].time"), problem.into()));
        }
    }
    Ok(())
}

fn check_jitter(at: &str, jitter: Jitter) -> Result<(), LinkError> {
    let most = |most_s| within(&format!("{at}.most_s"), most_s, [0.0, JITTER_MAX_S], "s");
    match jitter {
        Jitter::None {} => Ok(()),
        Jitter::Uniform { most_s } => most(most_s),
        Jitter::TruncatedNormal { sigma_s, most_s } => {
            within(&format!("{at}.sigma_s"), sigma_s, [0.0, JITTER_MAX_S], "s")?;
            most(most_s)
        }
    }
}

fn check_queues(at: &str, model: &DirectionModel) -> Result<(), LinkError> {
    for class in LinkClass::ALL {
        let rule = model.queues.of(class);
        let at = format!("{at}.{}", format!("{class:?}").to_lowercase());
        within(&format!("{at}.bytes"), rule.bytes as f64, [1.0, (64_u64 << 20) as f64], "bytes")?;
        let Some(ttl_s) = rule.ttl_s else { continue };
        let at = format!("{at}.ttl_s");
        if class == LinkClass::Estop {
            return Err(error(at, "is not allowed: an E-stop never expires; leave it out".into()));
        }
        within(&at, ttl_s, [0.001, 86_400.0], "s")?;
    }
    Ok(())
}

fn check_loss(at: &str, loss: Loss) -> Result<(), LinkError> {
    let probability = |name: &str, value| within(&format!("{at}.{name}"), value, [0.0, 1.0], "");
    match loss {
        Loss::None {} => Ok(()),
        Loss::Bernoulli { probability: p } => probability("probability", p),
        Loss::GilbertElliott { to_bad, to_good, loss_good, loss_bad } => {
            probability("to_bad", to_bad)?;
            probability("to_good", to_good)?;
            probability("loss_good", loss_good)?;
            probability("loss_bad", loss_bad)
        }
    }
}

fn check_outages(at: &str, model: &DirectionModel) -> Result<(), LinkError> {
    at_most(at, model.outages.len())?;
    for (i, outage) in model.outages.iter().enumerate() {
        if outage.end <= outage.begin {
            let problem = "is not after its begin";
            return Err(error(format!("{at}[{i}].end"), problem.into()));
        }
        if i > 0 && outage.begin < model.outages[i - 1].end {
            let problem =
                "is before the end of the outage before; list them in order, without overlap";
            return Err(error(format!("{at}[{i}].begin"), problem.into()));
        }
    }
    Ok(())
}

fn at_most(at: &str, n: usize) -> Result<(), LinkError> {
    if n <= ENTRIES_MAX {
        return Ok(());
    }
    Err(error(at.into(), format!("has {n} entries; at most {ENTRIES_MAX} are taken")))
}

fn within(field: &str, value: f64, [least, most]: [f64; 2], unit: &str) -> Result<(), LinkError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let space = if unit.is_empty() { "" } else { " " };
    let problem = format!("is {value}{space}{unit}; it takes {least} to {most}{space}{unit}");
    Err(error(field.into(), problem))
}

fn error(field: String, problem: String) -> LinkError {
    LinkError { field, problem }
}

fn nanos(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
