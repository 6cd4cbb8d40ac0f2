//! The cameras of the simulated rover, in the words of the link.

use sim::{
    Effects, Event, Gate, ImageName, ImageRefusal, ImageWord, Missing, Refusal, Side, Stage,
};
use wire::convert;
use wire::live::{
    self, Downlink, FailedPair, ImageDown, ImageHead, ImageUp, PieceData, RANGES_MAX,
};

use super::SimAdapter;

impl SimAdapter {
    /// Takes images where the rover is, or refuses.
    pub(super) fn take_images(
        &mut self,
        id: String,
        epoch: Option<u64>,
        gate: Option<&Gate>,
        order: &live::ImageOrder,
    ) {
        if !self.rover.admit(&id, epoch) {
            return;
        }
        self.hear();
        let time_s = self.rover.time_s();
        if let Some(Err(why)) = gate.map(|gate| gate.0(&self.rover.frame())) {
            let refusal = Refusal::Condition { why };
            let (stage, detail) = (Stage::Rejected, Some(refusal.to_string()));
            self.say(Event { time_s, id, stage, detail });
            return;
        }
        let simulated = order.simulated.clone().unwrap_or_default();
        let order = sim::ImageOrder {
            id: id.clone(),
            pairs: order.pairs.clone(),
            scale: order.scale,
            scales: order.scales.clone(),
            depth_bits: order.depth_bits,
            rate_bps: order.rate_bps,
            effects: Effects {
                seed: simulated.seed,
                noise: simulated.noise,
                shadows: simulated.shadows,
                calibration_errors: simulated.calibration_errors,
                calibration_seed: simulated.calibration_seed,
            },
        };
        let (scene, actual) = (self.rover.scene(), self.rover.configuration());
        let reported = self.rover.frame().configuration;
        let ground = (scene.robot(), scene.map());
        let taken = match &mut self.cameras {
            Some(cameras) => cameras.take(time_s, &order, ground, actual, &reported),
            None => Err(ImageRefusal::NoCameras),
        };
        if let Err(refusal) = taken {
            let (stage, detail) = (Stage::Rejected, Some(refusal.to_string()));
            self.say(Event { time_s, id, stage, detail });
        }
    }

    /// What the ground asks of images that were taken.
    pub(super) fn ask_cameras(&mut self, ask: ImageUp) {
        let Some(cameras) = &mut self.cameras else { return };
        match ask {
            ImageUp::LetGo { capture } => cameras.let_go(&capture),
            ImageUp::Repeat { capture, missing } => {
                let mut room = RANGES_MAX;
                let missing = missing.into_iter().map(|parts| {
                    let side = match parts.side {
                        live::Side::Left => Side::Left,
                        live::Side::Right => Side::Right,
                    };
                    let pieces: Vec<[u32; 2]> = parts.pieces.into_iter().take(room).collect();
                    room -= pieces.len();
                    let image = ImageName { capture: capture.clone(), pair: parts.pair, side };
                    Missing { image, head: parts.head, pieces }
                });
                let missing: Vec<Missing> = missing.take(RANGES_MAX).collect();
                cameras.repeat(&capture, &missing);
            }
        }
    }

    /// Takes over what the cameras say.
    pub(super) fn hear_cameras(&mut self) {
        let Some(cameras) = &mut self.cameras else { return };
        for (time_s, word) in cameras.advance(self.rover.time_s()) {
            let part = match word {
                ImageWord::Stage(event) => {
                    self.say(event);
                    continue;
                }
                ImageWord::Head { image, time_s, reported, size, content } => {
                    ImageDown::Head(ImageHead {
                        image: name(image),
                        time: self.time(time_s),
                        state: convert::rover_state(self.rover.scene().robot(), &reported),
                        size_px: [size.width as u32, size.height as u32],
                        bytes: content.len() as u32,
                        hash: blake3::hash(&content).to_hex().to_string(),
                    })
                }
                ImageWord::Piece { image, index, data } => {
                    ImageDown::Piece { image: name(image), index, data: PieceData(data) }
                }
                ImageWord::End { capture, failed } => {
                    let pair = |(pair, why)| FailedPair { pair, why };
                    ImageDown::End { capture, failed: failed.into_iter().map(pair).collect() }
                }
                ImageWord::Gone { capture } => ImageDown::Gone { capture },
            };
            self.said.push((self.time(time_s), Downlink::Image(part)));
        }
    }
}

fn name(image: ImageName) -> live::ImageName {
    let side = match image.side {
        Side::Left => live::Side::Left,
        Side::Right => live::Side::Right,
    };
    live::ImageName { capture: image.capture, pair: image.pair, side }
}
