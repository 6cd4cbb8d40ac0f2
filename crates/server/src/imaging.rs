//! The cameras of the live rover: orders of images, what they cost, and how they are logged.

use std::sync::Arc;

use bridge::commands::StageCommand;
use bridge::ground::CameraRecords;
use bridge::images::ReceivedImage;
use bridge::recorder::ProtobufChannel;
use bytes::Bytes;
use rover::Robot;
use sim::{Cameras, Drawing};
use stereo::rig::{CameraPair, Rig};
use wire::check::{self, At, RequestError};
use wire::foxglove::{CameraTopics, DESCRIPTORS, camera_messages};
use wire::live::{
    CommandBody, DEPTH_BITS, IMAGE_BYTES_MAX, IMAGE_RATE_BPS, ImageOrder, LinkReport, Side,
};
use wire::reconstruction::{CAMERAS_MAX, ImageCost, SCALE};

use crate::app::AppState;
use crate::live::hash_text;
use crate::robots::Robots;

/// Bytes a pixel of a PNG with 4, 5, 6, 7 and 8 bits of gray, as the simulated cameras give them on
/// boulder fields; a figure to plan with, not a bound.
const BYTES_PER_PIXEL: [f64; 5] = [0.12, 0.21, 0.33, 0.47, 0.62];
/// What a piece takes of the link beside its content, as a share of it.
const PIECE_OVERHEAD: f64 = 0.03;
/// What telemetry takes of the link at 10 frames a second (bit/s).
const TELEMETRY_BPS: f64 = 7e4;
/// Time that the rover takes for a pair of full size (s): a guess, for drawing takes what the machine has.
const TAKE_S: f64 = 6.0;
/// Largest seed: what JSON numbers of browsers hold.
const SEED_MAX: u64 = 1 << 53;

/// The rig of a robot's folder.
pub fn rig(at: &At<'_>, robots: &Robots, name: &str, robot: &Robot) -> Result<Rig, RequestError> {
    let toml = robots.toml(at, name)?;
    Rig::from_toml(&toml, robot).map_err(|error| {
        RequestError::at("robot_invalid", at, format_args!("{name:?} has a rig in which {error}"))
    })
}

/// The cameras of the simulated rover.
pub fn cameras(rig: &Arc<Rig>) -> Cameras {
    Cameras::new(Rig::clone(rig), Drawing::Aside)
}

/// The channels of the flight log that images stand on.
pub fn channels(rig: &Rig) -> Vec<ProtobufChannel> {
    let sides = rig.pairs().iter().flat_map(|pair| [(pair, Side::Left), (pair, Side::Right)]);
    let topics = sides.flat_map(|(pair, side)| CameraTopics::new(&pair.name, side).with_schemas());
    let channel = |(channel, schema): (String, &str)| ProtobufChannel {
        channel,
        schema_name: schema.to_owned(),
        descriptors: Bytes::from_static(DESCRIPTORS),
    };
    topics.map(channel).collect()
}

/// What the log keeps of each image: the PNG with calibration and place, as stock viewers take them.
pub fn records(robot: Arc<Robot>, rig: Arc<Rig>) -> CameraRecords {
    Box::new(move |ReceivedImage { head, png }| {
        let messages = match camera_messages(&robot, &rig, head, png) {
            Ok(messages) => messages,
            Err(error) => {
                tracing::warn!("an image is not in the log: {}", error.message);
                return Vec::new();
            }
        };
        let topics = CameraTopics::new(&head.image.pair, head.image.side);
        let calibration = messages.calibration.map(|content| (topics.calibration, content));
        let places = [(topics.place, messages.place), (topics.image, messages.image)];
        calibration.into_iter().chain(places).collect()
    })
}

/// An order of images, checked and complete.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// The order, with the rate that the link has where it named none.
    pub order: ImageOrder,
    /// What it is likely to cost.
    pub cost: ImageCost,
    /// How long the rover is likely to be at it (s).
    pub duration_s: f64,
}

/// Checks an order against the rig, and completes it by the link.
pub fn check(
    at: &At<'_>,
    rig: &Rig,
    link: &LinkReport,
    order: &ImageOrder,
) -> Result<Checked, RequestError> {
    let pairs_at = at.field("pairs");
    check::not_empty(&pairs_at, order.pairs.len())?;
    check::at_most(&pairs_at, order.pairs.len(), CAMERAS_MAX)?;
    let mut pairs: Vec<&CameraPair> = Vec::with_capacity(order.pairs.len());
    for (i, name) in order.pairs.iter().enumerate() {
        let pair = pair_of(&pairs_at.index(i), rig, name)?;
        if pairs.iter().any(|other| other.name == pair.name) {
            let text = format_args!("names {name:?} a second time; give each pair once");
            return Err(RequestError::at("command_invalid", &pairs_at.index(i), text));
        }
        pairs.push(pair);
    }
    check::within(&at.field("scale"), order.scale, SCALE, "")?;
    for (name, scale) in &order.scales {
        let at = at.field("scales");
        if pairs.iter().all(|pair| pair.name != *name) {
            let name: String = name.chars().take(64).collect();
            let text = format_args!("names the pair {name:?}, which is not asked for");
            return Err(RequestError::at("camera_unknown", &at, text));
        }
        check::within(&at.field(name), *scale, SCALE, "")?;
    }
    let sized: Vec<(&CameraPair, f64)> = pairs
        .iter()
        .map(|pair| (*pair, order.scales.get(&pair.name).copied().unwrap_or(order.scale)))
        .collect();
    let [least, most] = DEPTH_BITS.map(f64::from);
    check::within(&at.field("depth_bits"), order.depth_bits.into(), [least, most], " bits")?;
    if let Some(rate) = order.rate_bps {
        check::within(&at.field("rate_bps"), rate, IMAGE_RATE_BPS, " bit/s")?;
    }
    if let Some(simulated) = &order.simulated {
        let at = at.field("simulated");
        let seeds = [("seed", simulated.seed), ("calibration_seed", simulated.calibration_seed)];
        for (name, seed) in seeds {
            let range = [0.0, SEED_MAX as f64];
            check::within(&at.field(name), seed as f64, range, "")?;
        }
        let errors = simulated.calibration_errors;
        check::within(&at.field("calibration_errors"), errors, [0.0, 10.0], "")?;
    }
    for (i, (pair, scale)) in sized.iter().enumerate() {
        let pixels = pair.left.size().len() as f64 * scale * scale;
        if pixels > IMAGE_BYTES_MAX as f64 {
            let text = format_args!(
                "has images of {pixels:.0} px at this scale; at most {IMAGE_BYTES_MAX} px are sent: \
                 give a smaller scale"
            );
            return Err(RequestError::at("too_many", &pairs_at.index(i), text));
        }
    }
    let cost = cost(&sized, order.depth_bits, link);
    let beside = rate_beside_telemetry(link);
    let rate_bps = order.rate_bps.or(beside.map(|rate| {
        let [least, most] = IMAGE_RATE_BPS;
        rate.clamp(least, most)
    }));
    let order = ImageOrder { rate_bps, ..order.clone() };
    let sending_s = rate_bps.map_or(0.0, |rate| 8.0 * cost.bytes as f64 / rate);
    let duration_s = (take_s(&sized) + sending_s).min(86_400.0);
    Ok(Checked { order, cost, duration_s })
}

fn pair_of<'a>(at: &At<'_>, rig: &'a Rig, name: &str) -> Result<&'a CameraPair, RequestError> {
    rig.pair(name).ok_or_else(|| {
        let name: String = name.chars().take(64).collect();
        let known: Vec<&str> = rig.pairs().iter().map(|pair| pair.name.as_str()).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        let text = format_args!("names the pair {name:?}; the robot has {known}");
        RequestError::at("camera_unknown", at, text)
    })
}

/// What images are likely to cost over the link as it is.
pub fn cost(pairs: &[(&CameraPair, f64)], depth_bits: u8, link: &LinkReport) -> ImageCost {
    let pixels: f64 = pairs.iter().map(|(pair, scale)| pixels_of(pair, *scale)).sum();
    let place = usize::from(depth_bits.clamp(DEPTH_BITS[0], DEPTH_BITS[1]) - DEPTH_BITS[0]);
    let bytes = pixels * BYTES_PER_PIXEL[place] * (1.0 + PIECE_OVERHEAD);
    let downlink_s = rate_beside_telemetry(link).map(|rate| 8.0 * bytes / rate);
    let light_s = link.config.up_delay_s + link.config.down_delay_s;
    // Drawing and sending go on side by side.
    let total_s = light_s + take_s(pairs).max(downlink_s.unwrap_or(0.0));
    ImageCost { bytes: bytes.ceil() as usize, downlink_s, total_s }
}

/// Pixels of both images.
fn pixels_of(pair: &CameraPair, scale: f64) -> f64 {
    pair.raw_bytes() as f64 * scale * scale
}

fn take_s(pairs: &[(&CameraPair, f64)]) -> f64 {
    const FULL_PX: f64 = 2.0 * 1024.0 * 768.0;
    pairs.iter().map(|(pair, scale)| TAKE_S * pixels_of(pair, *scale) / FULL_PX).sum()
}

/// What the downlink has beside telemetry (bit/s); no limit where it has none. Never less than half.
fn rate_beside_telemetry(link: &LinkReport) -> Option<f64> {
    let rate = link.config.down.as_ref()?.rate_bps?;
    Some((rate - TELEMETRY_BPS).max(0.5 * rate))
}

/// The command that an order is.
pub fn command(
    app: &AppState,
    who: &str,
    id: Option<String>,
    at: &At<'_>,
    order: &ImageOrder,
) -> Result<StageCommand, RequestError> {
    let link = app.live.locked().0.link();
    let Checked { order, cost, duration_s } = check(at, app.live.rig(), &link, order)?;
    let title = format!(
        "Take images of {} at {:.0} %, about {:.1} MB",
        order.pairs.join(", "),
        100.0 * order.scale,
        cost.bytes as f64 / 1e6
    );
    let body = CommandBody::Image(order);
    Ok(StageCommand {
        id,
        operator: who.into(),
        title,
        plan: None,
        after: 0,
        duration_s,
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: Some(hash_text(app.live.robot().hash())),
        preconditions: Vec::new(),
        two_persons: app.config.commands.takes_two(&body),
        body,
    })
}
