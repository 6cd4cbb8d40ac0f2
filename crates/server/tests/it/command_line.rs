//! The program itself.

use std::io::Write;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::support::TempDir;

pub struct Run {
    pub status: i32,
    pub output: String,
    pub errors: String,
}

/// Runs the program with these arguments and this standard input.
pub fn footfall(arguments: &[&str], input: &str) -> Run {
    let mut child = Command::new(env!("CARGO_BIN_EXE_footfall"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_owned();
    let writer = std::thread::spawn(move || {
        // A program that refuses early does not read to the end.
        let _ = stdin.write_all(input.as_bytes());
    });
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    Run {
        status: output.status.code().unwrap(),
        output: String::from_utf8(output.stdout).unwrap(),
        errors: String::from_utf8(output.stderr).unwrap(),
    }
}

fn contacts(points: &[[f64; 2]]) -> Value {
    points.iter().map(|[x, y]| json!({ "position_m": [x, y, 0.0] })).collect()
}

#[test]
fn the_exit_status_tells_yes_no_and_unusable() {
    let triangle = contacts(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let case = |x: f64| json!({ "contacts": triangle, "com_m": [x, 0.2, 1.0] });
    let cases = |list: &[Value]| json!({ "cases": list }).to_string();
    assert_eq!(footfall(&["stability", "-"], &cases(&[case(0.2)])).status, 0);
    assert_eq!(footfall(&["stability", "-"], &cases(&[case(2.0)])).status, 1);
    assert_eq!(footfall(&["stability", "-"], &cases(&[case(2.0), case(0.2)])).status, 0);
    let refused = footfall(&["stability", "-", "--json"], "{\"case\": []}");
    assert_eq!(refused.status, 2);
    let error: Value = serde_json::from_str(&refused.output).unwrap();
    assert_eq!(error["error"]["code"], "unknown_field");
    assert_eq!(refused.errors.lines().count(), 1, "{}", refused.errors);
    let plain = footfall(&["stability", "-"], "{\"case\": []}");
    assert_eq!((plain.status, plain.output.as_str()), (2, ""));
    assert_eq!(footfall(&["stability", "no-such-file.json"], "").status, 2);
    assert_eq!(footfall(&["dance"], "").status, 2);
    assert_eq!(footfall(&["--help"], "").status, 0);
}

#[test]
fn a_terrain_file_is_found_beside_its_request() {
    let dir = TempDir::new();
    let out = dir.path().join("ground.tif");
    let generate =
        ["terrain", "generate", "--recipe", "smooth_mare", "--seed", "3", "--width-m", "8"];
    let run = footfall(&[&generate[..], &["--out", out.to_str().unwrap()]].concat(), "");
    assert_eq!(run.status, 0, "{}", run.errors);
    let request = dir.path().join("request.json");
    let body = json!({ "terrain": { "file": "ground.tif" }, "footprint_m": 0.45 });
    std::fs::write(&request, body.to_string()).unwrap();
    let layers = dir.path().join("layers.tif");
    let arguments =
        ["traversability", request.to_str().unwrap(), "--out", layers.to_str().unwrap()];
    let run = footfall(&arguments, "");
    assert_eq!(run.status, 0, "{}", run.errors);
    let answer: Value = serde_json::from_str(&run.output).unwrap();
    let names = json!(["slope_rad", "roughness_m", "step_m", "goodness", "certainty", "class"]);
    assert_eq!((&answer["layers"], &answer["window"]), (&names, &json!(9)));
    assert_eq!(answer["class"], Value::Null);
    assert_eq!(&std::fs::read(layers).unwrap()[..4], b"II*\0");
}

#[test]
fn terrain_files_are_read_and_written_in_other_formats() {
    let dir = TempDir::new();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let answer = |arguments: &[&str]| -> Value {
        let run = footfall(&[&["terrain"], arguments].concat(), "");
        assert_eq!(run.status, 0, "{}", run.errors);
        serde_json::from_str(&run.output).unwrap()
    };
    let tif = path("ground.tif");
    let made = answer(&["generate", "--width-m", "6", "--out", &tif]);
    let obj = path("ground.obj");
    let written = answer(&["export", &tif, "--out", &obj]);
    assert_eq!(written["version"], made["version"]);
    let again = answer(&["import", &obj, "--out", &path("again.tif")]);
    assert_eq!((&again["size"], &again["z_range_m"]), (&made["size"], &made["z_range_m"]));
    let part = answer(&["import", &tif, "--crop-m", "2", "--center-m", "1.5,3"]);
    assert_eq!(part["size"], json!([41, 41]));
    let simple = answer(&["export", &tif, "--out", &path("a.ply"), "--error-m", "0.02"]);
    let whole = answer(&["export", &tif, "--out", &path("b.ply")]);
    assert!(simple["bytes"].as_u64().unwrap() < whole["bytes"].as_u64().unwrap());
    let layers = answer(&["export", &tif, "--out", &path("l.tif"), "--footprint-m", "0.75"]);
    let bands = std::fs::read(path("l.tif")).unwrap();
    assert_eq!(layers["bytes"].as_u64(), Some(bands.len() as u64));
    assert!(bands.windows(9).any(|text| text == b"certainty"));
    for arguments in [
        &["export", tif.as_str(), "--out", "a.dxf"][..],
        &["export", tif.as_str(), "--out", "a.obj", "--error-m", "-1"],
        &["import", "nothing.tif"],
        &["import", tif.as_str(), "--center-m", "1,2"],
    ] {
        assert_eq!(footfall(&[&["terrain"], arguments].concat(), "").status, 2, "{arguments:?}");
    }
}

#[test]
fn a_repeated_request_gives_each_answer_with_its_statistics() {
    let request = json!({ "cases": [{ "contacts": [], "com_m": [0, 0, 0] }] }).to_string();
    let run = footfall(&["stability", "-", "--repeat", "3"], &request);
    let runs: Value = serde_json::from_str(&run.output).unwrap();
    let runs = runs["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 3);
    assert!(runs.iter().all(|run| run["statistics"]["total_ms"].is_number()));
    assert!(runs.iter().all(|run| run["cases"] == runs[0]["cases"]));
}

#[test]
fn a_server_that_cannot_listen_says_so_in_one_sentence() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let dir = TempDir::new();
    let logs = dir.path().to_str().unwrap();
    let run = footfall(&["serve", "--demo", "--port", &port, "--logs", logs], "");
    assert_eq!((run.status, run.errors.lines().count()), (2, 1), "{}", run.errors);
    assert!(run.errors.contains("in use"), "{}", run.errors);
    for address in ["0.0.0.0", "192.168.1.5", "::", "example.com"] {
        let run = footfall(&["serve", "--bind", address, "--port", "0", "--logs", logs], "");
        assert_eq!((run.status, run.errors.lines().count()), (2, 1), "{}", run.errors);
        assert!(run.errors.contains("loopback"), "{}", run.errors);
    }
    let run = footfall(&["serve", "--config", "no-such.toml"], "");
    assert_eq!((run.status, run.errors.lines().count()), (2, 1), "{}", run.errors);
}

#[test]
fn a_log_is_described_and_its_damage_told() {
    let dir = TempDir::new();
    let file = dir.path().join("no.mcap");
    std::fs::write(&file, b"not a log").unwrap();
    let run = footfall(&["log", "info", file.to_str().unwrap(), "--json"], "");
    assert_eq!(run.status, 2, "{}", run.output);
    let error: Value = serde_json::from_str(&run.output).unwrap();
    assert_eq!(error["error"]["code"], "log_damaged");
}

#[test]
fn logs_are_verified_recovered_and_clipped() {
    use bridge::recorder::{Record, Recorder, RecorderOptions};
    use wire::time::Timestamp;
    let dir = TempDir::new();
    let start = Timestamp(1_000_000_000_000_000_000);
    let options = RecorderOptions { start, reserve_bytes: 0, ..RecorderOptions::default() };
    let mut recorder = Recorder::start(dir.path(), options).unwrap();
    for sequence in 0..200_u64 {
        let time = start.plus_seconds(sequence as f64);
        let channel = if sequence % 2 == 0 { "rover/state" } else { "event" };
        let json = format!("{{\"n\":{sequence}}}").into();
        let record = Record {
            channel: channel.into(),
            sequence,
            log_time: time,
            publish_time: time,
            data: json,
        };
        recorder.record_durable(record).unwrap().wait_blocking().unwrap();
    }
    let open =
        std::fs::read(bridge::catalog::log_path(dir.path(), &recorder.status().log.id).unwrap());
    let log = recorder.finish().unwrap().log.id;
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let run = |arguments: &[&str]| {
        let run = footfall(&[&["log"], arguments, &["--json"]].concat(), "");
        let value = serde_json::from_str::<Value>(&run.output).unwrap_or_default();
        (run.status, value)
    };

    let (status, found) = run(&["verify", &path("")]);
    assert_eq!((status, &found["sound"], &found["problems"]), (0, &json!(1), &json!([])));
    let (status, found) = run(&["info", &path(&log)]);
    assert_eq!((status, &found["messages"], &found["id"]), (0, &json!(200), &json!(log)));
    let sealed = path(&format!("{log}/seg-000001.mcap"));
    let (status, found) = run(&["verify", &sealed]);
    assert_eq!((status, &found["findings"], &found["messages"]), (0, &json!([]), &json!(200)));

    // A file as a crash leaves it: whole chunks, then half of one.
    let open = open.unwrap();
    std::fs::write(path("torn.mcap"), &open[..open.len() - 20]).unwrap();
    let (status, found) = run(&["recover", &path("torn.mcap"), "--out", &path("whole.mcap")]);
    assert_eq!((status, &found["damage"][0]["code"]), (3, &json!("log_torn")));
    let messages = found["messages"].as_u64().unwrap();
    assert!((190..=200).contains(&messages), "{messages}");
    let (status, found) = run(&["verify", &path("whole.mcap")]);
    assert_eq!((status, &found["messages"]), (0, &json!(messages)));
    let (status, _) = run(&["recover", &sealed, "--out", &path("same.mcap")]);
    assert_eq!(status, 0);
    let (status, _) = run(&["recover", &sealed, "--out", &path("same.mcap")]);
    assert_eq!(status, 2, "what is there is not written over");
    std::fs::write(path("no.mcap"), b"not a log").unwrap();
    let (status, _) = run(&["recover", &path("no.mcap"), "--out", &path("none.mcap")]);
    assert_eq!(status, 1);
    assert_eq!(run(&["recover", &path("absent.mcap"), "--out", &path("none2.mcap")]).0, 2);

    let (from, to) = ("2001-09-09T01:46:50Z", "2001-09-09T01:46:59Z");
    let clip = path("clip.mcap");
    let out = ["--out", clip.as_str()];
    let part = ["clip", &path(&log), "--from", from, "--to", to, "--channel", "rover/state"];
    let (status, found) = run(&[&part[..], &out[..]].concat());
    assert_eq!(
        (status, &found["messages"], &found["channels"]),
        (0, &json!(5), &json!({ "rover/state": 5 }))
    );
    assert_eq!(run(&["verify", &clip]).0, 0);
    assert_eq!(run(&["clip", &path(&log), "--from", "soon", "--out", &path("x.mcap")]).0, 2);
    let late = ["clip", &path(&log), "--from", "2030-01-01T00:00:00Z", "--out", &path("y.mcap")];
    assert_eq!(run(&late).0, 1);

    let mut changed = std::fs::read(&sealed).unwrap();
    let middle = changed.len() / 2;
    changed[middle] ^= 1;
    std::fs::write(&sealed, changed).unwrap();
    let (status, found) = run(&["verify", &path("")]);
    assert_eq!((status, found["problems"].as_array().unwrap().is_empty()), (1, false));
}

#[test]
fn planners_are_compared_and_the_document_has_its_plots() {
    let dir = TempDir::new();
    let out = dir.path().join("figures.md");
    let arguments = ["compare", "--scenes", "1", "--quality-seconds", "0", "--date", "2026-01-02"];
    let run = footfall(&[&arguments[..], &["--out", out.to_str().unwrap()]].concat(), "");
    assert_eq!(run.status, 0, "{}", run.errors);
    let text = std::fs::read_to_string(&out).unwrap();
    assert!(text.contains("on 2026-01-02"), "{text}");
    for planner in ["line", "astar", "sbl", "rrt_connect", "auto"] {
        // One table of all scenes, and one of each kind.
        assert_eq!(text.matches(&format!("\n| `{planner}` |")).count(), 6, "{text}");
    }
    for name in ["success", "time", "length", "clearance"] {
        let link = format!("images/compare-{name}.svg");
        assert!(text.contains(&link), "{link}");
        let plot = std::fs::read_to_string(dir.path().join(&link)).unwrap();
        assert!(plot.starts_with("<svg") && plot.ends_with("</svg>\n"), "{name}");
    }
}
