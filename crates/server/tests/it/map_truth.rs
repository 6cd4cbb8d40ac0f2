//! The map that the server makes of nine pairs with errors of calibration, against the ground that they stand on
//! (G5): what an operator is shown, cell by cell.

use geometry::Grid;
use nalgebra::Point2;
use rover::Posture;
use serde_json::json;
use stereo::coverage::coverage;
use stereo::rig::{CameraPair, Rig};
use terrain::traversability::{CAUTION, Limits, SAFE, UNKNOWN, UNSAFE, traversability};
use wire::tile::HEADER_LEN;

use crate::support::Ground;

/// Share of the visible cells that may be called safe and are not.
const GATE: f64 = 0.005;

#[tokio::test]
async fn unsafe_ground_is_hardly_ever_called_safe_by_the_server() {
    let ground = Ground::with(|config| config.terrain.width_m = 24.0).await;
    let app = ground.app().clone();
    let truth = app.store.current().map.clone();
    let names: Vec<&str> = app.live.rig().pairs().iter().map(|pair| pair.name.as_str()).collect();
    assert_eq!(names.len(), 9);
    let wish = json!({
        "cameras": names, "scale": 0.5, "seed": 3, "keep_prior": false,
        "simulated": { "calibration_errors": 1.0, "calibration_seed": 5 },
    });
    let accepted = ground.post("terrain/reconstructions", &wish).await;
    assert_eq!(accepted.status, 202, "{}", accepted.json());
    let job = format!("/api/v1/jobs/{}", accepted.json()["id"].as_str().unwrap());
    // 18 images are drawn and matched: that takes its time on a busy machine.
    let mut report = ground.get(&job).await.json();
    for _ in 0..6000 {
        if ["done", "failed", "cancelled"].map(Into::into).contains(&report["state"]) {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
        report = ground.get(&job).await.json();
    }
    assert_eq!(report["state"], "done", "{report}");
    let answer = ground.get(report["result"].as_str().unwrap()).await.json();
    assert!(answer["hip_turns_rad"].is_null(), "legs hang as reported: {answer}");
    let version = app.store.current();
    assert_eq!(answer["terrain_version"], version.info.version);

    // Cells that a pair sees by rays, and what they are in truth.
    let robot = app.live.robot().clone();
    let toml = testkit::fixture_text("robots/athlete/robot.toml");
    let rig = Rig::from_toml(&toml, &robot).unwrap();
    let pairs: Vec<&CameraPair> = rig.pairs().iter().collect();
    let grid = Grid { origin: Point2::new(-9.0, -9.0), resolution: 0.1, nx: 181, ny: 181 };
    let posture = Posture::new(&robot, &app.live.configuration().unwrap());
    let seen = coverage(&pairs, &robot, &posture, &truth, &grid, &|| false).unwrap().counts();
    let real = traversability(&truth, 0.55, &Limits::default()).unwrap();
    let layers = version.layers().unwrap();
    let [mut visible, mut known, mut safe, mut bad, mut wrong, mut plain_wrong] = [0.0; 6];
    let mut sampled = Vec::new();
    for (ix, iy) in (0..grid.ny).flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy))) {
        let p = grid.position(ix, iy);
        let is = real.class.nearest(p).unwrap_or(UNKNOWN);
        if *seen.at(ix, iy) == 0 || is == UNKNOWN {
            continue;
        }
        let class = layers.class.nearest(p).unwrap_or(UNKNOWN);
        let count = |yes: bool| f64::from(u8::from(yes));
        visible += 1.0;
        known += count(class != UNKNOWN);
        safe += count(class == SAFE);
        bad += count(is == UNSAFE);
        wrong += count(is == UNSAFE && class == SAFE);
        // As it would look without doubt.
        let looks =
            layers.goodness.nearest(p).filter(|g| *g >= Limits::default().caution_below as f32);
        let certain = layers.certainty.nearest(p).is_some_and(|c| c >= 0.5);
        plain_wrong += count(is == UNSAFE && looks.is_some() && certain);
        if (ix + 7 * iy) % 601 == 0 {
            sampled.push((p, class));
        }
    }
    eprintln!(
        "{visible} visible cells, classed {:.1} %, called safe {:.1} %, truly unsafe {:.1} %, called safe {:.3} % \
         of visible, without doubt {:.3} %",
        100.0 * known / visible,
        100.0 * safe / visible,
        100.0 * bad / visible,
        100.0 * wrong / visible,
        100.0 * plain_wrong / visible,
    );
    assert!(visible > 15_000.0 && bad > 0.01 * visible, "{visible} {bad}");
    assert!(known > 0.7 * visible, "most of it is known: {known} of {visible}");
    assert!(safe > 0.1 * visible, "a map that calls nothing safe is none: {safe} of {visible}");
    assert!(wrong <= GATE * visible, "{wrong} of {visible}");

    // The layer that is drawn, the cell that is read out and what legs are judged by are of one class.
    let path = |rest: String| format!("/api/v1/terrain/{}/{rest}", version.info.version);
    let tile = ground.get(&path("tiles/class/0/0/0".into())).await.bytes;
    let columns = 257.min(version.map.grid().nx);
    let mut told_of_doubt = 0;
    for (p, class) in sampled {
        let cell = ground.get(&path(format!("cell?x_m={}&y_m={}", p.x, p.y))).await.json();
        assert_eq!(cell["class"], class, "{cell}");
        if let Some((ix, iy)) = version.map.grid().nearest(p).filter(|(x, y)| x.max(y) < &257) {
            assert_eq!(tile[HEADER_LEN + iy * columns + ix], class, "{p}");
        }
        let doubt = &cell["doubt"];
        if class == UNKNOWN {
            assert!(doubt.is_null(), "{cell}");
            continue;
        }
        assert_eq!(doubt["sigmas"], 0.5, "{cell}");
        let as_seen = doubt["class_as_seen"].as_u64().unwrap();
        assert!(as_seen >= u64::from(class), "doubt makes nothing better: {cell}");
        let (may_be, looks) = (doubt["step_m"].as_f64(), cell["step_m"].as_f64().unwrap());
        assert!(may_be.is_none_or(|step| step > looks), "{cell}");
        if as_seen == u64::from(SAFE) && class == CAUTION {
            told_of_doubt += 1;
        }
    }
    assert!(told_of_doubt > 0, "doubt matters somewhere");
}
