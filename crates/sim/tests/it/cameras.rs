//! The rover's cameras: what they draw, when it is sent, and what they refuse.

use std::collections::BTreeMap;

use rover::Posture;
use sim::{
    Cameras, Drawing, Effects, ImageName, ImageOrder, ImageRefusal, ImageWord, Missing,
    PIECE_BYTES, Side, SimRover, Stage,
};
use stereo::codec::decode;
use stereo::ray::RayScene;
use stereo::render::{RenderOptions, render};
use stereo::rig::Rig;

fn rig(rover: &SimRover) -> Rig {
    let toml = testkit::fixture_text("robots/athlete/robot.toml");
    Rig::from_toml(&toml, rover.scene().robot()).unwrap()
}

fn order(pairs: &[&str]) -> ImageOrder {
    ImageOrder {
        id: "c".into(),
        pairs: pairs.iter().map(|pair| (*pair).to_owned()).collect(),
        scale: 0.25,
        scales: BTreeMap::new(),
        depth_bits: 8,
        rate_bps: Some(400_000.0),
        effects: Effects { noise: false, ..Effects::default() },
    }
}

fn take(cameras: &mut Cameras, rover: &SimRover, order: &ImageOrder) -> Result<(), ImageRefusal> {
    let (scene, at) = (rover.scene(), rover.configuration());
    cameras.take(1.0, order, (scene.robot(), scene.map()), at, at)
}

/// The images that the words bring, put together; and how many pieces there were.
fn images(words: &[(f64, ImageWord)]) -> (BTreeMap<ImageName, Vec<u8>>, usize) {
    let (mut images, mut n) = (BTreeMap::new(), 0);
    for (_, word) in words {
        match word {
            ImageWord::Head { image, content, .. } => {
                images.insert(image.clone(), vec![0; content.len()]);
            }
            ImageWord::Piece { image, index, data } => {
                let from = *index as usize * PIECE_BYTES;
                images.get_mut(image).unwrap()[from..from + data.len()].copy_from_slice(data);
                n += 1;
            }
            _ => {}
        }
    }
    (images, n)
}

#[test]
fn they_draw_what_is_seen_from_where_the_rover_is_and_send_it_at_the_rate_of_the_order() {
    let rover = crate::on_plane();
    let mut cameras = Cameras::new(rig(&rover), Drawing::Here);
    take(&mut cameras, &rover, &order(&["haz1"])).unwrap();
    let words = cameras.advance(1000.0);
    let (brought, n_pieces) = images(&words);
    // By the renderer itself, of the ground and the posture.
    let scene = rover.scene();
    let posture = Posture::new(scene.robot(), rover.configuration());
    let pair = rig(&rover).pair("haz1").unwrap().clone();
    let size = sim::scaled(pair.left.size(), 0.25).unwrap();
    let pair = pair.resized(size).unwrap();
    let options = RenderOptions { sensor: None, ..RenderOptions::default() };
    let rays = RayScene::new(Some(scene.map()), Some((scene.robot(), &posture)));
    for (camera, side) in pair.cameras(&posture).iter().zip([Side::Left, Side::Right]) {
        let expected = render(&rays, camera, &options, 0, &|| false).unwrap();
        let name = ImageName { capture: "c".into(), pair: "haz1".into(), side };
        assert_eq!(decode(&brought[&name]).unwrap(), expected, "{side:?}");
    }
    // The last word is no earlier than the bytes take at 400 kbit/s, nor much later.
    let bytes: usize = brought.values().map(Vec::len).sum();
    let last = words.last().unwrap().0 - 1.0;
    let least = 8.0 * bytes as f64 / 400_000.0;
    assert!(last > least && last < 1.1 * least + 0.2, "{bytes} bytes in {last} s");
    assert!(words.windows(2).all(|pair| pair[0].0 <= pair[1].0), "in order of time");
    let stages: Vec<Stage> = words
        .iter()
        .filter_map(|(_, word)| match word {
            ImageWord::Stage(event) => Some(event.stage),
            _ => None,
        })
        .collect();
    assert_eq!(stages, [Stage::Started, Stage::Completed]);

    // Asked for twice, what still waits is sent once; what was let go is gone.
    let missing = Missing {
        image: ImageName { capture: "c".into(), pair: "haz1".into(), side: Side::Left },
        head: true,
        pieces: vec![[0, 0], [1, u32::MAX]],
    };
    cameras.repeat("c", &[missing.clone(), missing.clone()]);
    cameras.repeat("c", std::slice::from_ref(&missing));
    let again = cameras.advance(2000.0);
    let (left, n_again) = images(&again);
    assert_eq!(left.len(), 1);
    assert!(n_again < n_pieces && left.iter().all(|(name, content)| brought[name] == *content));
    let ends = again.iter().filter(|(_, word)| matches!(word, ImageWord::End { .. })).count();
    assert_eq!(ends, 1, "one end, behind all");
    assert!(matches!(again.last().unwrap().1, ImageWord::End { .. }));
    cameras.let_go("c");
    cameras.repeat("c", &[missing]);
    let gone = cameras.advance(3000.0);
    assert!(matches!(&gone[..], [(_, ImageWord::Gone { .. })]), "{gone:?}");
}

#[test]
fn a_thread_aside_draws_the_same_images_and_ends_when_they_are_let_go() {
    let rover = crate::on_plane();
    let noisy = ImageOrder {
        effects: Effects { seed: 4, calibration_errors: 1.0, ..Effects::default() },
        ..order(&["haz2"])
    };
    let mut here = Cameras::new(rig(&rover), Drawing::Here);
    take(&mut here, &rover, &noisy).unwrap();
    let (expected, _) = images(&here.advance(1e4));
    let mut aside = Cameras::new(rig(&rover), Drawing::Aside);
    take(&mut aside, &rover, &noisy).unwrap();
    let busy = take(&mut aside, &rover, &noisy);
    assert!(matches!(busy, Err(ImageRefusal::Busy { .. })), "{busy:?}");
    let (mut words, mut now_s) = (Vec::new(), 1.0);
    while !words.iter().any(|(_, word)| matches!(word, ImageWord::End { .. })) {
        assert!(now_s < 1e6, "it draws for ever");
        now_s += 10.0;
        words.extend(aside.advance(now_s));
        std::thread::yield_now();
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert_eq!(images(&words).0, expected);
    // Another seed is other noise.
    let other = ImageOrder { effects: Effects { seed: 5, ..noisy.effects }, ..noisy.clone() };
    take(&mut here, &rover, &other).unwrap();
    assert_ne!(images(&here.advance(2e4)).0, expected);

    let large = ImageOrder { scale: 1.0, id: "d".into(), ..order(&["nav1", "nav2"]) };
    take(&mut aside, &rover, &large).unwrap();
    aside.let_go("d");
    let words = aside.advance(now_s + 1.0);
    let aborted =
        |word: &ImageWord| matches!(word, ImageWord::Stage(event) if event.stage == Stage::Aborted);
    assert!(words.iter().any(|(_, word)| aborted(word)), "{words:?}");
    assert!(take(&mut aside, &rover, &noisy).is_ok(), "the place is free again");
}

#[test]
fn orders_that_cannot_be_are_refused_by_name() {
    let rover = crate::on_plane();
    let mut cameras = Cameras::new(rig(&rover), Drawing::Here);
    let good = order(&["haz1"]);
    let bad = [
        (ImageOrder { pairs: Vec::new(), ..good.clone() }, "0 pairs"),
        (order(&["haz1", "haz1"]), "twice"),
        (order(&["front"]), "there is no pair \"front\""),
        (ImageOrder { scale: f64::NAN, ..good.clone() }, "scale is NaN"),
        (ImageOrder { scale: 1.1, ..good.clone() }, "scale is 1.1"),
        (ImageOrder { scales: [("haz1".into(), 9.0)].into(), ..good.clone() }, "scales is 9"),
        (ImageOrder { depth_bits: 9, ..good.clone() }, "depth_bits is 9"),
        (ImageOrder { rate_bps: Some(0.0), ..good.clone() }, "rate_bps is 0"),
        (
            ImageOrder {
                effects: Effects { calibration_errors: -1.0, ..Effects::default() },
                ..good.clone()
            },
            "calibration_errors is -1",
        ),
    ];
    for (order, expected) in bad {
        let error = take(&mut cameras, &rover, &order).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let mut none = Cameras::new(Rig::new(Vec::new()), Drawing::Here);
    assert_eq!(take(&mut none, &rover, &good), Err(ImageRefusal::NoCameras));
    assert!(cameras.advance(10.0).is_empty(), "nothing was taken");
}
