//! Images that come down in pieces: put together, checked, asked for again, kept for a while.
//!
//! ```text
//! sent ─▶ heads and pieces ─▶ end ─▶ all there ─▶ complete, let go on board
//!            ▲  silence │        │ something is missing
//!            └──────────┴────────┴─ asked for again ─▶ incomplete, by the names of its pairs
//! ```
//!
//! An image counts once all its bytes are there and their hash is that of its head. What is missing is
//! asked for when the rover says that it has sent all, and when nothing has come for as long as a word
//! takes and [`QUIET_S`]; each time that nothing comes of it, the wait is twice as long. After
//! [`TRIES_MAX`] of these, or [`ROUNDS_MAX`] requests in all, the capture is incomplete.
//!
//! No clock, no I/O. Bounds: [`CAPTURES_MAX`] captures, [`HELD_BYTES_MAX`] bytes; what has ended gives
//! way to what comes, oldest first, and remains in the flight log.

mod assembly;

use std::collections::VecDeque;
use std::sync::Arc;

use bytes::Bytes;
use wire::live::{
    AckStage, ImageDown, ImageHead, ImageName, ImageOrder, ImageUp, MissingParts, RANGES_MAX, Side,
};
use wire::reconstruction::{CaptureAnswer, CapturedImage, CapturedPair};
use wire::time::Timestamp;

use assembly::{Assembly, Step};

/// Most captures that are known.
pub const CAPTURES_MAX: usize = 64;
/// Most bytes of images that are held.
pub const HELD_BYTES_MAX: usize = 128 << 20;
/// Longest silence beyond the time of a word (s) before something is asked for again.
pub const QUIET_S: f64 = 5.0;
/// As long again until the first image is drawn (s).
const FIRST_S: f64 = 30.0;
/// Times that nothing comes of asking again.
pub const TRIES_MAX: u32 = 6;
/// Times that something is asked for again in all.
pub const ROUNDS_MAX: u32 = 40;

const SIDES: [Side; 2] = [Side::Left, Side::Right];

/// An image that is here whole.
#[derive(Debug, Clone, PartialEq)]
pub struct ReceivedImage {
    /// What it is.
    pub head: ImageHead,
    /// The image, as PNG.
    pub png: Bytes,
}

/// How a capture is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CaptureState {
    /// It is asked for.
    OnTheWay,
    /// All images are here.
    Complete,
    /// Some will not come.
    Incomplete {
        /// Why.
        why: String,
    },
    /// The ground no longer wants them.
    LetGo,
    /// The rover refused.
    Refused {
        /// What it says.
        why: String,
    },
}

/// The images of all captures.
#[derive(Debug, Default)]
pub struct Images {
    /// Oldest first.
    captures: VecDeque<Capture>,
}

#[derive(Debug)]
struct Capture {
    id: String,
    state: CaptureState,
    pairs: Vec<Pair>,
    /// When something came last, or was asked for.
    heard: Timestamp,
    /// Something came at all.
    begun: bool,
    tries: u32,
    rounds: u32,
    /// The rover has sent all that it was asked for.
    ended: bool,
}

#[derive(Debug)]
struct Pair {
    name: String,
    images: [Assembly; 2],
    failed: Option<String>,
}

impl Pair {
    fn is_settled(&self) -> bool {
        self.failed.is_some() || self.is_whole()
    }

    fn is_whole(&self) -> bool {
        self.images.iter().all(|image| image.whole().is_some())
    }
}

impl Images {
    /// A command for images was handed to the link.
    pub fn expect(&mut self, now: Timestamp, id: &str, order: &ImageOrder) {
        if self.captures.iter().any(|capture| capture.id == id) {
            return;
        }
        if self.captures.len() == CAPTURES_MAX {
            self.captures.pop_front();
        }
        let pair = |name: &String| Pair {
            name: name.clone(),
            images: [Assembly::default(), Assembly::default()],
            failed: None,
        };
        self.captures.push_back(Capture {
            id: id.to_owned(),
            state: CaptureState::OnTheWay,
            pairs: order.pairs.iter().map(pair).collect(),
            heard: now,
            begun: false,
            tries: 0,
            rounds: 0,
            ended: false,
        });
    }

    /// Takes what came at `now`; gives the image that it made whole.
    pub fn receive(&mut self, now: Timestamp, message: ImageDown) -> Option<Arc<ReceivedImage>> {
        match message {
            ImageDown::Head(head) => {
                let held = self.held_bytes();
                let room = HELD_BYTES_MAX.saturating_sub(held);
                if head.bytes as usize > room {
                    self.make_room(head.bytes as usize, &head.image.capture);
                }
                let room = HELD_BYTES_MAX.saturating_sub(self.held_bytes());
                let (pair, at) = self.pair_of(now, &head.image)?;
                match pair.images[at].begin(head, room) {
                    Ok(step) => done(step),
                    Err(why) => {
                        pair.failed.get_or_insert(why);
                        None
                    }
                }
            }
            ImageDown::Piece { image, index, data } => {
                let (pair, at) = self.pair_of(now, &image)?;
                done(pair.images[at].put(index, &data.0))
            }
            ImageDown::End { capture, failed } => {
                let capture = self.open(&capture)?;
                capture.hear(now);
                capture.ended = true;
                for wire::live::FailedPair { pair, why } in failed {
                    if let Some(pair) = capture.pairs.iter_mut().find(|p| p.name == pair) {
                        pair.failed.get_or_insert(why);
                    }
                }
                None
            }
            ImageDown::Gone { capture } => {
                let capture = self.open(&capture)?;
                let why = "the rover keeps nothing of this capture";
                capture.give_up(why);
                None
            }
        }
    }

    /// The rover's word on the command of a capture.
    pub fn acknowledge(&mut self, now: Timestamp, id: &str, stage: AckStage, detail: Option<&str>) {
        let Some(capture) = self.open(id) else { return };
        let why = || detail.unwrap_or("the rover does not say why").to_owned();
        match stage {
            AckStage::Rejected => capture.state = CaptureState::Refused { why: why() },
            AckStage::Failed | AckStage::Aborted => capture.give_up(&why()),
            _ => capture.hear(now),
        }
    }

    /// Gives a capture up; false if nothing of it is on the way.
    pub fn let_go(&mut self, id: &str) -> bool {
        let Some(capture) = self.open(id) else { return false };
        capture.state = CaptureState::LetGo;
        true
    }

    /// What is to be asked at `now`, where a word takes `word_s` (s) up and down, of which `spread_s` may
    /// be jitter.
    pub fn ask(&mut self, now: Timestamp, word_s: f64, spread_s: f64) -> Vec<ImageUp> {
        let mut asked = Vec::new();
        for capture in &mut self.captures {
            if capture.state == CaptureState::OnTheWay {
                asked.extend(capture.ask(now, word_s, spread_s));
            }
        }
        asked
    }

    /// Share of a capture's bytes that has come, as far as is known.
    pub fn progress(&self, id: &str) -> Option<f64> {
        let capture = self.captures.iter().find(|capture| capture.id == id)?;
        let shares = capture.pairs.iter().map(|pair| match pair.is_settled() {
            true => 1.0,
            false => pair.share(),
        });
        Some(shares.sum::<f64>() / capture.pairs.len().max(1) as f64)
    }

    /// Takes in the images of a capture of an earlier session, pair by pair, as far as there is room beside what is here;
    /// false if there is none, or the capture is known. It counts as older than all others.
    pub fn bring_back(&mut self, id: &str, images: Vec<Arc<ReceivedImage>>) -> bool {
        let bytes: usize = images.iter().map(|image| image.head.bytes as usize).sum();
        let is_known = self.captures.iter().any(|capture| capture.id == id);
        let is_full =
            self.captures.len() >= CAPTURES_MAX || self.held_bytes() + bytes > HELD_BYTES_MAX;
        if is_known || is_full || images.is_empty() {
            return false;
        }
        let heard = images.iter().map(|image| image.head.time).max().unwrap_or_default();
        let mut pairs: Vec<Pair> = Vec::new();
        for image in images {
            let name = &image.head.image.pair;
            let at = pairs.iter().position(|pair| pair.name == *name).unwrap_or_else(|| {
                let images = [Assembly::default(), Assembly::default()];
                pairs.push(Pair { name: name.clone(), images, failed: None });
                pairs.len() - 1
            });
            let side = usize::from(image.head.image.side == Side::Right);
            pairs[at].images[side] = Assembly::Whole(image);
        }
        let is_whole = pairs.iter().all(Pair::is_whole);
        for pair in pairs.iter_mut().filter(|pair| !pair.is_whole()) {
            pair.failed = Some(format!("{}: the session ended before", pair.missing_text()));
        }
        let state = match is_whole {
            true => CaptureState::Complete,
            false => CaptureState::Incomplete { why: "the session ended before".into() },
        };
        let (id, begun, ended) = (id.to_owned(), true, true);
        self.captures.push_front(Capture {
            id,
            state,
            pairs,
            heard,
            begun,
            tries: 0,
            rounds: 0,
            ended,
        });
        true
    }

    /// How a capture is, if it is known.
    pub fn state(&self, id: &str) -> Option<&CaptureState> {
        self.captures.iter().find(|capture| capture.id == id).map(|capture| &capture.state)
    }

    /// What has come of a capture.
    pub fn answer(&self, id: &str) -> Option<CaptureAnswer> {
        self.captures.iter().find(|capture| capture.id == id).map(Capture::answer)
    }

    /// What has come of all captures, newest last.
    pub fn answers(&self) -> Vec<CaptureAnswer> {
        self.captures.iter().map(Capture::answer).collect()
    }

    /// An image that is here.
    pub fn image(&self, name: &ImageName) -> Option<Arc<ReceivedImage>> {
        let [left, right] = self.pair(&name.capture, &name.pair)?;
        match name.side {
            Side::Left => left,
            Side::Right => right,
        }
    }

    /// Both images of a pair, as far as they are here.
    pub fn pair(&self, capture: &str, pair: &str) -> Option<[Option<Arc<ReceivedImage>>; 2]> {
        let capture = self.captures.iter().find(|known| known.id == capture)?;
        let pair = capture.pairs.iter().find(|known| known.name == pair)?;
        Some([0, 1].map(|side| pair.images[side].whole().cloned()))
    }

    fn open(&mut self, id: &str) -> Option<&mut Capture> {
        let is_open = |c: &&mut Capture| c.id == id && c.state == CaptureState::OnTheWay;
        self.captures.iter_mut().find(is_open)
    }

    fn pair_of(&mut self, now: Timestamp, image: &ImageName) -> Option<(&mut Pair, usize)> {
        let capture = self.open(&image.capture)?;
        capture.hear(now);
        let pair = capture.pairs.iter_mut().find(|pair| pair.name == image.pair)?;
        Some((pair, usize::from(image.side == Side::Right)))
    }

    fn held_bytes(&self) -> usize {
        let pairs = self.captures.iter().flat_map(|capture| &capture.pairs);
        pairs.flat_map(|pair| &pair.images).map(Assembly::bytes).sum()
    }

    /// Forgets the oldest captures that have ended, until there is room.
    fn make_room(&mut self, bytes: usize, but: &str) {
        while self.held_bytes() + bytes > HELD_BYTES_MAX {
            let ended = |c: &Capture| c.state != CaptureState::OnTheWay && c.id != but;
            let Some(at) = self.captures.iter().position(ended) else { return };
            self.captures.remove(at);
        }
    }
}

fn done(step: Step) -> Option<Arc<ReceivedImage>> {
    match step {
        Step::Whole(image) => Some(image),
        Step::Missing => None,
    }
}

impl Capture {
    fn hear(&mut self, now: Timestamp) {
        self.heard = self.heard.max(now);
        (self.begun, self.tries) = (true, 0);
    }

    fn give_up(&mut self, why: &str) {
        for pair in self.pairs.iter_mut().filter(|pair| !pair.is_settled()) {
            pair.failed = Some(format!("{}: {why}", pair.missing_text()));
        }
        self.settle();
    }

    /// The state once every pair has come or failed.
    fn settle(&mut self) {
        let failed: Vec<String> = self
            .pairs
            .iter()
            .filter_map(|pair| Some(format!("{}: {}", pair.name, pair.failed.as_ref()?)))
            .collect();
        self.state = match failed.is_empty() {
            true => CaptureState::Complete,
            false => CaptureState::Incomplete { why: failed.join("; ") },
        };
    }

    fn ask(&mut self, now: Timestamp, word_s: f64, spread_s: f64) -> Option<ImageUp> {
        if self.pairs.iter().all(Pair::is_settled) {
            self.settle();
            return Some(ImageUp::LetGo { capture: self.id.clone() });
        }
        let first_s = if self.begun { 0.0 } else { FIRST_S };
        let quiet_s = (word_s + QUIET_S + first_s) * f64::from(1_u32 << self.tries.min(16));
        let silent = now.seconds_since(self.heard) > quiet_s;
        // Where the order is not kept, pieces may come behind the end.
        let ended = self.ended && now.seconds_since(self.heard) >= spread_s;
        if !ended && !silent {
            return None;
        }
        if self.tries == TRIES_MAX || self.rounds == ROUNDS_MAX {
            let why = match self.begun {
                true => "it was asked for again and again",
                false => "the rover says nothing of it",
            };
            self.give_up(why);
            return Some(ImageUp::LetGo { capture: self.id.clone() });
        }
        self.tries += u32::from(silent);
        self.rounds += 1;
        (self.ended, self.heard) = (false, self.heard.max(now));
        Some(ImageUp::Repeat { capture: self.id.clone(), missing: self.missing() })
    }

    fn missing(&self) -> Vec<MissingParts> {
        let mut room = RANGES_MAX;
        let mut missing = Vec::new();
        for pair in self.pairs.iter().filter(|pair| pair.failed.is_none()) {
            for (image, side) in pair.images.iter().zip(SIDES) {
                if image.whole().is_some() || room == 0 {
                    continue;
                }
                let (head, pieces) = image.missing(room);
                room -= pieces.len().max(1).min(room);
                missing.push(MissingParts { pair: pair.name.clone(), side, head, pieces });
            }
        }
        missing
    }

    fn answer(&self) -> CaptureAnswer {
        let (state, why) = match &self.state {
            CaptureState::OnTheWay => ("on_the_way", None),
            CaptureState::Complete => ("complete", None),
            CaptureState::Incomplete { why } => ("incomplete", Some(why.clone())),
            CaptureState::LetGo => ("let_go", None),
            CaptureState::Refused { why } => ("refused", Some(why.clone())),
        };
        let pairs = self.pairs.iter().map(|pair| pair.answer(&self.id)).collect();
        CaptureAnswer { capture: self.id.clone(), state: state.into(), why, pairs }
    }
}

impl Pair {
    fn share(&self) -> f64 {
        self.images.iter().map(Assembly::share).sum::<f64>() / 2.0
    }

    fn missing_text(&self) -> String {
        let text = |image: &Assembly, side: Side| match image.head() {
            _ if image.whole().is_some() => format!("{side} is here"),
            None => format!("nothing of {side} has come"),
            Some(head) => {
                format!(
                    "{side} lacks {} of {} bytes",
                    head.bytes as usize - image.come(),
                    head.bytes
                )
            }
        };
        let [left, right] = &self.images;
        format!("{}, {}", text(left, Side::Left), text(right, Side::Right))
    }

    fn answer(&self, capture: &str) -> CapturedPair {
        let heads: Vec<&ImageHead> = self.images.iter().filter_map(Assembly::head).collect();
        let image = |(image, side): (&Assembly, Side)| {
            let head = &image.whole()?.head;
            Some(CapturedImage {
                side,
                url: format!("/api/v1/rover/images/{capture}/{}/{side}.png", self.name),
                size_px: head.size_px,
                bytes: head.bytes,
                hash: head.hash.clone(),
            })
        };
        CapturedPair {
            id: format!("{capture}/{}", self.name),
            pair: self.name.clone(),
            received: self.is_whole(),
            fraction: self.share(),
            bytes: self.images.iter().map(|image| image.come() as u64).sum(),
            bytes_total: (heads.len() == 2).then(|| heads.iter().map(|h| u64::from(h.bytes)).sum()),
            time: heads.first().map(|head| head.time),
            failed: self.failed.clone(),
            images: self.images.iter().zip(SIDES).filter_map(image).collect(),
        }
    }
}
