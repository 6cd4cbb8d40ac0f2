//! The cameras of the simulated rover: images are drawn where it truly is, kept, and sent in pieces.
//!
//! A *capture* is what one order takes, all of it at one instant: the posture at the moment of the
//! order. Images are drawn one after another by a thread of their own ([`Drawing::Aside`]), so that
//! telemetry does not wait for them, and come down in pieces at the rate of the order. The images of a
//! capture are kept until the ground lets them go, so that lost pieces can be sent again.
//!
//! Bounds: [`CAPTURES_MAX`] captures are kept, and [`KEPT_BYTES_MAX`] bytes; ended ones give way to new
//! ones, oldest first. One capture is drawn at a time. What waits to be sent is never queued twice.

mod draw;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use rover::{Configuration, Posture, Robot};
use stereo::codec::DEPTH_BITS;
use stereo::rig::{CameraPair, Rig};
use stereo::{ImageSize, StereoError};
use terrain::ElevationMap;

use crate::frame::{Event, Stage};
use draw::{Drawer, Task};

/// Most pairs of an order.
pub const PAIRS_MAX: usize = 16;
/// Most captures that are kept.
pub const CAPTURES_MAX: usize = 4;
/// Most bytes of images that are kept.
pub const KEPT_BYTES_MAX: usize = 64 << 20;
/// Most bytes of one image.
pub const IMAGE_BYTES_MAX: usize = 4 << 20;
/// Bytes of a piece.
pub const PIECE_BYTES: usize = 4000;
/// Size of images as a share of the pair's own.
pub const SCALE: [f64; 2] = [0.25, 1.0];
/// Rates at which an order may be sent (bit/s).
pub const RATE_BPS: [f64; 2] = [100.0, 1e9];
/// The rate where the order names none (bit/s).
pub const RATE_DEFAULT_BPS: f64 = 2e7;

/// What a piece costs beside its content (bytes), for the rate.
const PIECE_OVERHEAD: usize = 64;
/// What a head costs (bytes), for the rate.
const HEAD_BYTES: usize = 512;

/// Who draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drawing {
    /// A thread of its own: nothing waits for it. When an image is there depends on the machine, what is
    /// in it does not.
    Aside,
    /// The call that orders, at once: for tests in which time is given.
    Here,
}

/// What to take.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageOrder {
    /// Identity of the command.
    pub id: String,
    /// Names of pairs, 1 to [`PAIRS_MAX`].
    pub pairs: Vec<String>,
    /// Size of the images as a share of the pair's own, within [`SCALE`].
    pub scale: f64,
    /// The same of single pairs, by name, where it is another.
    pub scales: BTreeMap<String, f64>,
    /// Bits of gray that are kept, 4 to 8.
    pub depth_bits: u8,
    /// Rate at which pieces are handed to the transmitter (bit/s), within [`RATE_BPS`].
    pub rate_bps: Option<f64>,
    /// What the simulated cameras do to their images.
    pub effects: Effects,
}

/// What simulated cameras do to their images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effects {
    /// Seed of the noise.
    pub seed: u64,
    /// Point spread, vignetting, shot and read noise.
    pub noise: bool,
    /// Hard shadows of the sun.
    pub shadows: bool,
    /// Errors of the calibration, as a multiple of the usual ones; 0 for none, at most 10.
    pub calibration_errors: f64,
    /// Seed of these: the same rover has the same errors each time.
    pub calibration_seed: u64,
}

impl Default for Effects {
    fn default() -> Effects {
        Effects {
            seed: 0,
            noise: true,
            shadows: true,
            calibration_errors: 0.0,
            calibration_seed: 0,
        }
    }
}

/// Which camera of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs)] // each is its name
pub enum Side {
    Left,
    Right,
}

/// Which image of a capture.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct ImageName {
    /// The capture: identity of its command.
    pub capture: String,
    /// The pair.
    pub pair: String,
    /// The camera.
    pub side: Side,
}

/// Parts of an image that are to be sent again.
#[derive(Debug, Clone, PartialEq)]
pub struct Missing {
    /// The image.
    pub image: ImageName,
    /// Its head.
    pub head: bool,
    /// Its pieces, from and to with both ends.
    pub pieces: Vec<[u32; 2]>,
}

/// What the cameras say.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageWord {
    /// What happened to the order.
    Stage(Event),
    /// What an image is: comes before its pieces.
    Head {
        /// The image.
        image: ImageName,
        /// Time on board of the exposure (s).
        time_s: f64,
        /// Where the rover says that it was.
        reported: Configuration,
        /// Width and height.
        size: ImageSize,
        /// The whole image, as PNG.
        content: Arc<[u8]>,
    },
    /// A part of an image.
    Piece {
        /// The image.
        image: ImageName,
        /// Its place: it begins at this many times [`PIECE_BYTES`].
        index: u32,
        /// The bytes.
        data: Vec<u8>,
    },
    /// All that was asked for of a capture has been sent.
    End {
        /// The capture.
        capture: String,
        /// Pairs that could not be taken, and why.
        failed: Vec<(String, String)>,
    },
    /// Nothing is kept of that capture.
    Gone {
        /// The capture.
        capture: String,
    },
}

/// Why an order is refused. Nothing was taken then.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum ImageRefusal {
    #[error("the rover has no cameras")]
    NoCameras,
    #[error("the order names {n} pairs; 1 to {PAIRS_MAX} are taken")]
    PairCount { n: usize },
    #[error("there is no pair {pair:?}; the pairs are {known}")]
    UnknownPair { pair: String, known: String },
    #[error("the order names the pair {pair:?} twice")]
    Twice { pair: String },
    #[error("{field} is {value}; {least} to {most} are taken")]
    Range { field: &'static str, value: f64, least: f64, most: f64 },
    #[error("the images would have {bytes} bytes; at most {most} are kept: take fewer or smaller")]
    TooLarge { bytes: usize, most: usize },
    #[error("images of {id} are being taken; wait for their end or let them go")]
    Busy { id: String },
    #[error("pair {pair}: {error}")]
    Pair { pair: String, error: StereoError },
}

/// The cameras.
#[derive(Debug)]
pub struct Cameras {
    rig: Rig,
    drawing: Drawing,
    captures: VecDeque<Capture>,
    /// What waits to be sent, in order.
    queue: VecDeque<Part>,
    /// The same, for the question whether it does.
    queued: BTreeSet<Part>,
    now_s: f64,
    /// When the transmitter takes the next part (s).
    free_s: f64,
    said: Vec<(f64, ImageWord)>,
}

#[derive(Debug)]
struct Capture {
    id: String,
    time_s: f64,
    rate_bps: f64,
    reported: Configuration,
    pairs: Vec<String>,
    images: BTreeMap<ImageName, Image>,
    failed: Vec<(String, String)>,
    drawer: Option<Drawer>,
    /// The end of the order was told.
    told: bool,
}

#[derive(Debug)]
struct Image {
    size: ImageSize,
    content: Arc<[u8]>,
}

/// What is sent as one.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Head(ImageName),
    Piece(ImageName, u32),
    End(String),
}

impl Part {
    fn capture(&self) -> &str {
        match self {
            Part::Head(image) | Part::Piece(image, _) => &image.capture,
            Part::End(capture) => capture,
        }
    }
}

impl Cameras {
    /// The cameras of a rig.
    pub fn new(rig: Rig, drawing: Drawing) -> Cameras {
        Cameras {
            rig,
            drawing,
            captures: VecDeque::new(),
            queue: VecDeque::new(),
            queued: BTreeSet::new(),
            now_s: 0.0,
            free_s: 0.0,
            said: Vec::new(),
        }
    }

    /// Takes images at time `now_s` on board of the ground `map` and the robot, which is at `actual` and
    /// reports itself at `reported`. What comes of it is said by [`Cameras::advance`].
    pub fn take(
        &mut self,
        now_s: f64,
        order: &ImageOrder,
        (robot, map): (&Arc<Robot>, &ElevationMap),
        actual: &Configuration,
        reported: &Configuration,
    ) -> Result<(), ImageRefusal> {
        let pairs = self.check(order)?;
        if let Some(busy) = self.captures.iter().find(|capture| !capture.told) {
            return Err(ImageRefusal::Busy { id: busy.id.clone() });
        }
        self.now_s = self.now_s.max(now_s);
        self.captures.retain(|capture| capture.id != order.id);
        while self.captures.len() >= CAPTURES_MAX {
            self.let_go_first();
        }
        let task = Task {
            capture: order.id.clone(),
            pairs,
            rig: self.rig.clone(),
            robot: robot.clone(),
            map: map.clone(),
            posture: Posture::new(robot, actual),
            depth_bits: order.depth_bits,
            effects: order.effects,
        };
        let drawer = match self.drawing {
            Drawing::Aside => Drawer::aside(task),
            Drawing::Here => Drawer::here(task),
        };
        self.captures.push_back(Capture {
            id: order.id.clone(),
            time_s: now_s,
            rate_bps: order.rate_bps.unwrap_or(RATE_DEFAULT_BPS),
            reported: reported.clone(),
            pairs: order.pairs.clone(),
            images: BTreeMap::new(),
            failed: Vec::new(),
            drawer: Some(drawer),
            told: false,
        });
        let event =
            Event { time_s: now_s, id: order.id.clone(), stage: Stage::Started, detail: None };
        self.said.push((now_s, ImageWord::Stage(event)));
        Ok(())
    }

    /// Sends parts again. Those that still wait to be sent are not sent twice.
    pub fn repeat(&mut self, capture: &str, missing: &[Missing]) {
        let Some(kept) = self.captures.iter().find(|kept| kept.id == capture) else {
            let gone = ImageWord::Gone { capture: capture.to_owned() };
            self.said.push((self.now_s, gone));
            return;
        };
        let mut parts = Vec::new();
        for Missing { image, head, pieces } in missing.iter().take(2 * PAIRS_MAX) {
            // What was not drawn yet comes by itself.
            let Some(found) = kept.images.get(image) else { continue };
            if *head {
                parts.push(Part::Head(image.clone()));
            }
            let last = n_pieces(found.content.len()) - 1;
            for [from, to] in pieces {
                let range = (*from).min(last + 1)..=(*to).min(last);
                parts.extend(range.map(|index| Part::Piece(image.clone(), index)));
            }
        }
        let told = kept.told;
        parts.into_iter().for_each(|part| self.enqueue(part));
        if told {
            // Behind what it is the end of.
            let end = Part::End(capture.to_owned());
            if self.queued.remove(&end) {
                self.queue.retain(|part| *part != end);
            }
            self.enqueue(end);
        }
    }

    /// Forgets a capture: it is not drawn on, and nothing more of it is sent.
    pub fn let_go(&mut self, capture: &str) {
        let Some(at) = self.captures.iter().position(|kept| kept.id == capture) else { return };
        if let Some(kept) = self.captures.remove(at)
            && !kept.told
        {
            let detail = Some("the ground let the images go".to_owned());
            let (id, stage) = (kept.id.clone(), Stage::Aborted);
            let event = Event { time_s: self.now_s, id, stage, detail };
            self.said.push((self.now_s, ImageWord::Stage(event)));
        }
        self.forget_parts(capture);
    }

    /// The order that is under way, and the share of its images that is drawn.
    pub fn under_way(&self) -> Option<(&str, f64)> {
        let capture = self.captures.iter().find(|capture| !capture.told)?;
        let share = capture.images.len() as f64 / (2 * capture.pairs.len()).max(1) as f64;
        Some((&capture.id, share))
    }

    /// Goes on to time `to_s` on board; gives what was said since the last call, each with its time,
    /// in order.
    pub fn advance(&mut self, to_s: f64) -> Vec<(f64, ImageWord)> {
        self.gather();
        self.free_s = self.free_s.max(self.now_s);
        while self.free_s <= to_s {
            let Some(part) = self.queue.pop_front() else { break };
            self.queued.remove(&part);
            self.send(&part);
        }
        self.now_s = self.now_s.max(to_s);
        std::mem::take(&mut self.said)
    }

    fn check(&self, order: &ImageOrder) -> Result<Vec<CameraPair>, ImageRefusal> {
        if self.rig.pairs().is_empty() {
            return Err(ImageRefusal::NoCameras);
        }
        let n = order.pairs.len();
        if !(1..=PAIRS_MAX).contains(&n) {
            return Err(ImageRefusal::PairCount { n });
        }
        let within = |field, value: f64, [least, most]: [f64; 2]| {
            // NaN is out of range too.
            let inside = (least..=most).contains(&value);
            inside.then_some(()).ok_or(ImageRefusal::Range { field, value, least, most })
        };
        within("scale", order.scale, SCALE)?;
        for scale in order.scales.values() {
            within("scales", *scale, SCALE)?;
        }
        within("depth_bits", order.depth_bits.into(), DEPTH_BITS.map(f64::from))?;
        within("rate_bps", order.rate_bps.unwrap_or(RATE_DEFAULT_BPS), RATE_BPS)?;
        within("calibration_errors", order.effects.calibration_errors, [0.0, 10.0])?;
        let mut pairs: Vec<CameraPair> = Vec::with_capacity(n);
        let mut bytes = 0;
        for name in &order.pairs {
            let short = || name.chars().take(64).collect::<String>();
            let Some(pair) = self.rig.pair(name) else {
                let known: Vec<&str> = self.rig.pairs().iter().map(|p| p.name.as_str()).collect();
                return Err(ImageRefusal::UnknownPair { pair: short(), known: known.join(", ") });
            };
            if pairs.iter().any(|other| other.name == *name) {
                return Err(ImageRefusal::Twice { pair: short() });
            }
            let refuse = |error| ImageRefusal::Pair { pair: short(), error };
            let scale = order.scales.get(name).copied().unwrap_or(order.scale);
            let size = scaled(pair.left.size(), scale).map_err(refuse)?;
            let pair = pair.resized(size).map_err(refuse)?;
            if size.len() > IMAGE_BYTES_MAX {
                return Err(ImageRefusal::TooLarge { bytes: size.len(), most: IMAGE_BYTES_MAX });
            }
            bytes += pair.raw_bytes();
            pairs.push(pair);
        }
        if bytes > KEPT_BYTES_MAX {
            return Err(ImageRefusal::TooLarge { bytes, most: KEPT_BYTES_MAX });
        }
        Ok(pairs)
    }

    /// Takes over what has been drawn.
    fn gather(&mut self) {
        let Some(at) = self.captures.iter().position(|capture| capture.drawer.is_some()) else {
            return;
        };
        let capture = &mut self.captures[at];
        let Some(drawer) = &capture.drawer else { return };
        let (drawn, ended) = drawer.take();
        let mut parts = Vec::new();
        for (name, outcome) in drawn {
            match outcome {
                Ok((size, content)) => {
                    parts.push(Part::Head(name.clone()));
                    let pieces = 0..n_pieces(content.len());
                    parts.extend(pieces.map(|index| Part::Piece(name.clone(), index)));
                    capture.images.insert(name, Image { size, content: content.into() });
                }
                Err(why) => capture.failed.push((name.pair, why)),
            }
        }
        if ended {
            capture.drawer = None;
            parts.push(Part::End(capture.id.clone()));
        }
        parts.into_iter().for_each(|part| self.enqueue(part));
        while self.kept_bytes() > KEPT_BYTES_MAX && self.captures.len() > 1 {
            self.let_go_first();
        }
    }

    fn send(&mut self, part: &Part) {
        let time_s = self.free_s;
        let id = part.capture();
        let Some(capture) = self.captures.iter_mut().find(|capture| capture.id == id) else {
            return;
        };
        let mut bytes = PIECE_OVERHEAD;
        let word = match part {
            Part::Head(image) => {
                let Some(Image { size, content }) = capture.images.get(image) else { return };
                bytes = HEAD_BYTES;
                ImageWord::Head {
                    image: image.clone(),
                    time_s: capture.time_s,
                    reported: capture.reported.clone(),
                    size: *size,
                    content: content.clone(),
                }
            }
            Part::Piece(image, index) => {
                let Some(Image { content, .. }) = capture.images.get(image) else { return };
                let from = *index as usize * PIECE_BYTES;
                let to = (from + PIECE_BYTES).min(content.len());
                let Some(data) = content.get(from..to) else { return };
                bytes += data.len();
                ImageWord::Piece { image: image.clone(), index: *index, data: data.to_vec() }
            }
            Part::End(id) => {
                let failed = capture.failed.clone();
                if !std::mem::replace(&mut capture.told, true) {
                    let event = capture.end(time_s);
                    self.said.push((time_s, ImageWord::Stage(event)));
                }
                ImageWord::End { capture: id.clone(), failed }
            }
        };
        self.free_s = time_s + 8.0 * bytes as f64 / capture.rate_bps;
        self.said.push((time_s, word));
    }

    fn enqueue(&mut self, part: Part) {
        if self.queued.insert(part.clone()) {
            self.queue.push_back(part);
        }
    }

    fn kept_bytes(&self) -> usize {
        let images = self.captures.iter().flat_map(|capture| capture.images.values());
        images.map(|image| image.content.len()).sum()
    }

    fn let_go_first(&mut self) {
        if let Some(first) = self.captures.pop_front() {
            self.forget_parts(&first.id);
        }
    }

    fn forget_parts(&mut self, capture: &str) {
        self.queue.retain(|part| part.capture() != capture);
        self.queued.retain(|part| part.capture() != capture);
    }
}

impl Capture {
    /// How the order ended.
    fn end(&self, time_s: f64) -> Event {
        let why: Vec<String> =
            self.failed.iter().map(|(pair, why)| format!("{pair}: {why}")).collect();
        let all_failed = self.pairs.iter().all(|pair| self.failed.iter().any(|(p, _)| p == pair));
        let stage = if all_failed { Stage::Failed } else { Stage::Completed };
        let detail = (!why.is_empty()).then(|| why.join("; "));
        Event { time_s, id: self.id.clone(), stage, detail }
    }
}

/// The size of images at a scale.
pub fn scaled(size: ImageSize, scale: f64) -> Result<ImageSize, StereoError> {
    let side = |n: usize| (n as f64 * scale).round() as usize;
    ImageSize::new(side(size.width), side(size.height))
}

/// Pieces of an image of so many bytes.
fn n_pieces(bytes: usize) -> u32 {
    bytes.div_ceil(PIECE_BYTES) as u32
}
