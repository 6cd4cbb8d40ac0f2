//! Images that come down in pieces: whatever the link does, an image is whole and as it was, or named as
//! missing; and nothing else waits for them.

use std::collections::BTreeMap;
use std::sync::Arc;

use bridge::bus::Bus;
use bridge::commands::StageCommand;
use bridge::ground::Ground;
use bridge::images::{CaptureState, Images};
use bridge::recorder::Recorder;
use bridge::sim_adapter::SimAdapter;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sim::{Cameras, Drawing, SettleOptions, SimRover, settle};
use stereo::rig::Rig;
use wire::live::{
    CommandBody, CommandState, DirectionModel, FailedPair, ImageDown, ImageHead, ImageName,
    ImageOrder, ImageUp, LinkConfig, Loss, PIECE_BYTES, PieceData, Side, SimulatedCameras,
};
use wire::scene::{Pose, RoverState};
use wire::time::Timestamp;

use crate::sim_adapter::athlete;
use crate::support::{TempDir, after, cases, uuid};

fn order(pairs: &[&str]) -> ImageOrder {
    ImageOrder {
        pairs: pairs.iter().map(|pair| (*pair).to_owned()).collect(),
        scale: 0.25,
        scales: BTreeMap::new(),
        depth_bits: 8,
        rate_bps: None,
        simulated: None,
    }
}

fn state() -> RoverState {
    let base = Pose { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] };
    RoverState { base, joints_rad: BTreeMap::new(), wheels_rad: BTreeMap::new() }
}

/// What a rover keeps: images of random bytes, sent as it is asked to. By its own code.
struct Kept {
    images: BTreeMap<(String, Side), Vec<u8>>,
}

impl Kept {
    fn new(rng: &mut ChaCha8Rng, pairs: &[&str]) -> Kept {
        let mut images = BTreeMap::new();
        for pair in pairs {
            for side in [Side::Left, Side::Right] {
                let n = rng.random_range(1..9 * PIECE_BYTES);
                images.insert(((*pair).to_owned(), side), (0..n).map(|_| rng.random()).collect());
            }
        }
        Kept { images }
    }

    fn name(pair: &str, side: Side) -> ImageName {
        ImageName { capture: "c".into(), pair: pair.into(), side }
    }

    fn parts(&self, pair: &str, side: Side, head: bool, pieces: &[[u32; 2]]) -> Vec<ImageDown> {
        let content = &self.images[&(pair.to_owned(), side)];
        let mut parts = Vec::new();
        if head {
            parts.push(ImageDown::Head(ImageHead {
                image: Kept::name(pair, side),
                time: after(1.0),
                state: state(),
                size_px: [16, 16],
                bytes: content.len() as u32,
                hash: blake3::hash(content).to_hex().to_string(),
            }));
        }
        for (index, data) in content.chunks(PIECE_BYTES).enumerate() {
            let index = index as u32;
            if pieces.iter().any(|[from, to]| (*from..=*to).contains(&index)) {
                let image = Kept::name(pair, side);
                parts.push(ImageDown::Piece { image, index, data: PieceData(data.to_vec()) });
            }
        }
        parts
    }

    fn all(&self) -> Vec<ImageDown> {
        let parts = self
            .images
            .keys()
            .flat_map(|(pair, side)| self.parts(pair, *side, true, &[[0, u32::MAX]]));
        parts.chain([end()]).collect()
    }

    fn answer(&self, ask: &ImageUp) -> Vec<ImageDown> {
        let ImageUp::Repeat { missing, .. } = ask else { return Vec::new() };
        let parts = missing.iter().flat_map(|m| self.parts(&m.pair, m.side, m.head, &m.pieces));
        parts.chain([end()]).collect()
    }
}

fn end() -> ImageDown {
    ImageDown::End { capture: "c".into(), failed: Vec::new() }
}

#[test]
fn over_links_that_lose_damage_double_and_mix_every_image_is_whole_or_told_missing() {
    let (mut n_complete, mut n_rounds, mut n_incomplete) = (0, 0, 0);
    for seed in 0..cases(3000) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let pairs = &["a", "b", "c"][..rng.random_range(1..4)];
        let kept = Kept::new(&mut rng, pairs);
        let (loss, lie, double) =
            (rng.random_range(0.0..0.6), rng.random_range(0.0..0.02), rng.random_range(0.0..0.2));
        // One in ten links is dead from a moment on.
        let dead = rng.random_bool(0.1);
        let mut images = Images::default();
        let mut now = after(0.0);
        images.expect(now, "c", &order(pairs));
        let mut under_way = kept.all();
        let mut whole = BTreeMap::new();
        for _ in 0..100_000 {
            if images.state("c") != Some(&CaptureState::OnTheWay) {
                break;
            }
            // Mixed a little: each part may come behind the next.
            for i in 1..under_way.len() {
                if rng.random_bool(0.1) {
                    under_way.swap(i - 1, i);
                }
            }
            for mut part in std::mem::take(&mut under_way) {
                now = now.plus_seconds(0.01);
                if dead || rng.random_bool(loss) {
                    continue;
                }
                if let ImageDown::Piece { data, index, .. } = &mut part
                    && rng.random_bool(lie)
                {
                    match rng.random_range(0..3) {
                        0 => data.0[0] ^= 1,
                        1 => {
                            data.0.pop();
                        }
                        _ => *index = rng.random(),
                    }
                }
                let again = rng.random_bool(double).then(|| part.clone());
                for part in std::iter::once(part).chain(again) {
                    if let Some(image) = images.receive(now, part) {
                        let name = (image.head.image.pair.clone(), image.head.image.side);
                        assert!(whole.insert(name, image).is_none(), "whole once");
                    }
                }
            }
            now = now.plus_seconds(1.0);
            for ask in images.ask(now, 2.0, 0.0) {
                n_rounds += 1;
                if !rng.random_bool(loss.min(0.3)) {
                    under_way.extend(kept.answer(&ask));
                }
            }
        }
        for (name, image) in &whole {
            assert_eq!(image.png[..], kept.images[name][..], "{seed}");
        }
        match images.state("c").unwrap() {
            CaptureState::Complete => {
                n_complete += 1;
                assert_eq!(whole.len(), kept.images.len(), "{seed}");
            }
            CaptureState::Incomplete { why } => {
                n_incomplete += 1;
                for pair in pairs {
                    let here = [Side::Left, Side::Right]
                        .iter()
                        .all(|side| whole.contains_key(&((*pair).to_owned(), *side)));
                    let named = why.split("; ").any(|w| w.starts_with(&format!("{pair}: ")));
                    assert_eq!(here, !named, "{seed}: {why}");
                }
            }
            other => panic!("{seed}: {other:?} after {n_rounds}"),
        }
    }
    let n = cases(3000);
    eprintln!("{n_complete} of {n} complete, {n_incomplete} told incomplete, {n_rounds} rounds");
    assert!(n_complete * 10 > 7 * n && n_incomplete * 20 > n, "{n_complete} {n_incomplete}");
}

#[test]
fn silence_ends_by_itself_and_lies_take_no_room() {
    let mut images = Images::default();
    images.expect(after(0.0), "c", &order(&["a"]));
    let mut asked = Vec::new();
    for second in 0..10_000 {
        for ask in images.ask(after(f64::from(second)), 2.0, 0.0) {
            asked.push((second, ask));
        }
    }
    // Seven, and with the head of the first 37 s, each twice as long: over before an hour.
    assert_eq!(asked.len(), 7, "{asked:?}");
    assert!(matches!(asked[6], (at, ImageUp::LetGo { .. }) if at < 6000), "{asked:?}");
    let ended = images.state("c").unwrap();
    assert!(matches!(ended, CaptureState::Incomplete { why } if why.contains("nothing of left")));
    assert!(images.ask(after(20_000.0), 2.0, 0.0).is_empty());

    images.expect(after(0.0), "lies", &order(&["a"]));
    let head = |bytes| {
        ImageDown::Head(ImageHead {
            image: ImageName { capture: "lies".into(), pair: "a".into(), side: Side::Left },
            time: after(0.0),
            state: state(),
            size_px: [16, 16],
            bytes,
            hash: String::new(),
        })
    };
    assert!(images.receive(after(1.0), head(u32::MAX)).is_none());
    let answer = images.answer("lies").unwrap();
    assert!(answer.pairs[0].failed.as_ref().unwrap().contains("4294967295 bytes"), "{answer:?}");
    // Of a capture that nobody asked for nothing is kept.
    let strange = ImageDown::Piece {
        image: ImageName { capture: "x".into(), pair: "a".into(), side: Side::Left },
        index: u32::MAX,
        data: PieceData(vec![0; PIECE_BYTES]),
    };
    assert!(images.receive(after(1.0), strange).is_none());
    assert!(images.answer("x").is_none());
    let failed = vec![FailedPair { pair: "a".into(), why: "no light".into() }];
    images.receive(after(2.0), ImageDown::End { capture: "lies".into(), failed });
    assert_eq!(images.ask(after(2.0), 2.0, 0.0).len(), 1, "settled, and let go");
}

fn rig() -> Rig {
    Rig::from_toml(&testkit::fixture_text("robots/athlete/robot.toml"), &athlete()).unwrap()
}

/// A ground with the simulated rover over a link of this model down.
fn ground(dir: &TempDir, down: DirectionModel) -> Ground {
    let map = terrain::ElevationMap::plane(20.0, 0.5).unwrap();
    let scene = collision::Scene::new(Arc::new(athlete()), map, &[]).unwrap();
    let middle = nalgebra::Point2::origin();
    let settled = settle(&scene, middle, 0.0, "bent", &SettleOptions::default()).unwrap();
    let rover = SimRover::new(scene, settled.configuration, 1.62).unwrap();
    let cameras = Cameras::new(rig(), Drawing::Here);
    let adapter = SimAdapter::new(after(0.0), rover).with_cameras(cameras);
    let recorder = Recorder::start(dir.path(), crate::recorder::options()).unwrap();
    let link = LinkConfig { down: Some(down), ..LinkConfig::delays(1.3, 1.3) };
    let derive = Box::new(|_: &_| None);
    Ground::new(after(0.0), Box::new(adapter), link, recorder, Bus::new(64), derive).unwrap()
}

fn send(ground: &mut Ground, now: Timestamp, id: &str, order: ImageOrder) {
    let command = StageCommand {
        id: Some(id.into()),
        operator: "ada".into(),
        title: "Take images".into(),
        body: CommandBody::Image(order),
        plan: None,
        after: 0,
        duration_s: 20.0,
        basis_joints_rad: BTreeMap::new(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        two_persons: false,
        preconditions: Vec::new(),
    };
    ground.stage(now, command).unwrap().written_blocking().unwrap();
    ground.arm(now, id, "ada").unwrap().written_blocking().unwrap();
    let _ = ground.send(now, id, "ada").unwrap();
    ground.release_blocking(now);
}

/// Steps at every event until the capture has ended; gives when, and the longest way of a frame (s).
fn run_until_ended(ground: &mut Ground, from: Timestamp, id: &str) -> (Timestamp, f64) {
    let (mut now, mut longest, limit) = (from, 0.0_f64, from.plus_seconds(3000.0));
    while ground.images().state(id) == Some(&CaptureState::OnTheWay) && now < limit {
        now = ground.next_step().max(Timestamp(now.0 + 1));
        ground.step(now);
        if let Some(frame) = ground.latest() {
            longest = longest.max(frame.received_time.seconds_since(frame.onboard_time));
        }
    }
    (now, longest)
}

#[test]
fn over_a_narrow_lossy_link_images_come_whole_and_frames_do_not_wait_for_them() {
    let dir = TempDir::new("images");
    let down = DirectionModel {
        rate_bps: Some(400_000.0),
        loss: Loss::Bernoulli { probability: 0.01 },
        seed: 3,
        ..DirectionModel::default()
    };
    let mut ground = ground(&dir, down);
    ground.step(after(5.0));
    let simulated = Some(SimulatedCameras { seed: 2, ..SimulatedCameras::default() });
    let wanted = ImageOrder { rate_bps: Some(330_000.0), simulated, ..order(&["haz1", "nav1"]) };
    send(&mut ground, after(5.0), &uuid(1), wanted);
    let (ended, longest) = run_until_ended(&mut ground, after(5.0), &uuid(1));
    let answer = ground.images().answer(&uuid(1)).unwrap();
    assert_eq!(answer.state, "complete", "{answer:?}");
    let bytes: u64 = answer.pairs.iter().map(|pair| pair.bytes).sum();
    // No faster than the rate, and what was lost took one or two rounds more.
    let took = ended.seconds_since(after(5.0));
    let pixels = 4 * 256 * 192;
    eprintln!("{:.3} bytes a pixel in {took:.1} s", bytes as f64 / f64::from(pixels));
    let least = 2.6 + 8.0 * bytes as f64 / 400_000.0;
    assert!(took > least && took < 2.0 * least + 15.0, "{bytes} bytes in {took} s");
    // A frame waits for one frame of 1 kB on the link at most, and its own time.
    assert!(longest < 1.3 + 0.06, "{longest} s");
    let record = ground.commands().get(&uuid(1)).unwrap();
    assert_eq!(record.state, CommandState::Done, "{record:?}");
    for pair in ["haz1", "nav1"] {
        for image in ground.images().pair(&uuid(1), pair).unwrap() {
            let image = image.unwrap();
            let decoded = stereo::codec::decode(&image.png).unwrap();
            assert_eq!(
                [decoded.size().width as u32, decoded.size().height as u32],
                image.head.size_px
            );
            assert!(image.head.time.seconds_since(after(6.3)).abs() < 0.06, "taken on arrival");
        }
    }
}

#[test]
fn the_rover_refuses_what_it_cannot_take_and_stops_when_the_ground_lets_go() {
    let dir = TempDir::new("images-let-go");
    let mut ground = ground(&dir, DirectionModel::default());
    ground.step(after(1.0));
    send(&mut ground, after(1.0), &uuid(1), order(&["haz9"]));
    run_until_ended(&mut ground, after(1.0), &uuid(1));
    let answer = ground.images().answer(&uuid(1)).unwrap();
    assert_eq!(answer.state, "refused");
    assert!(answer.why.as_ref().unwrap().contains("haz9"), "{answer:?}");
    assert_eq!(ground.commands().get(&uuid(1)).unwrap().state, CommandState::Failed);

    // At 20 kbit/s an image takes its time; let go, nothing more of it is sent.
    let slow = ImageOrder { rate_bps: Some(20_000.0), ..order(&["haz1"]) };
    send(&mut ground, after(10.0), &uuid(2), slow);
    ground.step(after(16.0));
    assert!(ground.images().progress(&uuid(2)).unwrap() > 0.0);
    assert!(ground.let_images_go(after(16.0), "ada", &uuid(2)));
    assert!(!ground.let_images_go(after(16.0), "ada", &uuid(2)), "once");
    ground.step(after(20.0));
    let sent = ground.link().down.bytes_sent;
    ground.step(after(24.0));
    // Forty frames of telemetry, and no piece.
    let frame = ground.link().down.bytes_sent - sent;
    assert!(frame < 40 * 1100, "{frame} bytes");
    assert_eq!(ground.commands().get(&uuid(2)).unwrap().state, CommandState::Aborted);
    assert_eq!(ground.images().answer(&uuid(2)).unwrap().state, "let_go");
}
