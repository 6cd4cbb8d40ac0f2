//! Two processes, as an operator starts them: `footfall rover-sim` and `footfall serve --rover`. Either
//! is killed in the middle of a command.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use crate::command_line::footfall;
use crate::support::TempDir;

/// A process that is killed when it is let go.
pub struct Process {
    child: Child,
    address: String,
}

impl Process {
    /// Starts the program and waits for the address that it tells.
    pub fn start(arguments: &[&str]) -> Process {
        let mut child = Command::new(env!("CARGO_BIN_EXE_footfall"))
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let mut said = String::new();
        let address = lines.by_ref().map_while(Result::ok).find_map(|line| {
            said += &line;
            said.push('\n');
            let (_, rest) = line.split_once("://")?;
            Some(rest.split([' ', '/']).next()?.to_owned())
        });
        let address = address.unwrap_or_else(|| panic!("no address: {said}"));
        // What it says later is read, or it would wait.
        std::thread::spawn(move || lines.for_each(drop));
        Process { child, address }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Waits for its end; its status.
    pub fn ended(mut self) -> Option<i32> {
        self.child.wait().unwrap().code()
    }

    fn kill(mut self) -> String {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        self.address.clone()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn rover(dir: &Path, address: &str) -> Process {
    let state = dir.join("rover");
    Process::start(&["rover-sim", "--listen", address, "--state", state.to_str().unwrap()])
}

fn server(dir: &Path, rover: &str, port: &str) -> Process {
    let (logs, rover) = (dir.join("logs"), format!("tcp://{rover}"));
    let logs = logs.to_str().unwrap();
    Process::start(&["serve", "--demo", "--rover", &rover, "--port", port, "--logs", logs])
}

/// One request; status and JSON.
fn ask(server: &Process, method: &str, path: &str, body: &Value, header: &str) -> (u16, Value) {
    let mut stream = TcpStream::connect(&server.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let body = if body.is_null() { String::new() } else { body.to_string() };
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Type: application/json\r\n\
         {header}Content-Length: {}\r\n\r\n{body}",
        server.address,
        body.len()
    )
    .unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = String::from_utf8_lossy(&answer);
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    let body = if head.to_lowercase().contains("transfer-encoding: chunked") {
        let mut whole = String::new();
        let mut rest = body;
        while let Some((size, after)) = rest.split_once("\r\n") {
            let size = usize::from_str_radix(size.trim(), 16).unwrap();
            whole += &after[..size];
            rest = after[size..].trim_start_matches("\r\n");
        }
        whole
    } else {
        body.to_owned()
    };
    (status, serde_json::from_str(&body).unwrap_or(Value::Null))
}

pub fn get(server: &Process, path: &str) -> Value {
    ask(server, "GET", &format!("/api/v1/{path}"), &Value::Null, "").1
}

fn post(server: &Process, path: &str, body: &Value) -> (u16, Value) {
    ask(server, "POST", &format!("/api/v1/{path}"), body, "")
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    for _ in 0..600 {
        if done() {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("{what} did not come within 30 s");
}

fn carrier(server: &Process) -> Value {
    get(server, "link")["carrier"]["state"].clone()
}

/// Sends a motion of so many seconds that leaves leg 1 where it is; gives its id, or the refusal.
fn send(server: &Process, seconds: f64) -> Result<String, Value> {
    let joints = get(server, "rover")["latest"]["frame"]["state"]["joints_rad"]["leg1"].clone();
    let knot = |time_s: f64| json!({ "joints_rad": joints, "time_s": time_s });
    let body = json!({ "type": "joint_path", "leg": "leg1", "knots": [knot(0.0), knot(seconds)] });
    let (status, staged) = post(server, "commands", &json!({ "body": body }));
    assert_eq!(status, 201, "{staged}");
    let id = staged["id"].as_str().unwrap().to_owned();
    let (status, armed) = post(server, &format!("commands/{id}/arm"), &json!({}));
    assert_eq!(status, 200, "{armed}");
    let (status, sent) = post(server, &format!("commands/{id}/send"), &json!({}));
    if status == 200 {
        return Ok(id);
    }
    // It stays armed, and would be sent once the rover is back.
    assert_eq!(post(server, &format!("commands/{id}/cancel"), &json!({})).0, 200);
    Err(sent["error"]["code"].clone())
}

fn state(server: &Process, id: &str) -> Value {
    get(server, &format!("commands/{id}"))["state"].clone()
}

fn ready(server: &Process) {
    until("telemetry", || ask(server, "GET", "/ready", &Value::Null, "").0 == 200);
}

#[test]
fn either_process_is_killed_in_the_middle_of_a_command_and_the_truth_is_told() {
    let dir = TempDir::new();
    let mut sim = rover(dir.path(), "127.0.0.1:0");
    let mut ground = server(dir.path(), &sim.address, "0");
    ready(&ground);
    let link = json!({ "up_delay_s": 0.1, "down_delay_s": 0.1 });
    assert_eq!(ask(&ground, "PUT", "/api/v1/link", &link, "").0, 200);
    assert_eq!(carrier(&ground), "up");

    // The rover's process dies.
    let first = send(&ground, 20.0).unwrap();
    until("the motion", || state(&ground, &first) == "executing");
    let address = sim.kill();
    until("its being told", || carrier(&ground) == "reconnecting");
    assert_eq!(send(&ground, 1.0), Err(json!("rover_unreachable")));
    let heard = get(&ground, "link")["carrier"]["heard"].clone();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(get(&ground, "link")["carrier"]["heard"], heard, "nothing is heard meanwhile");
    sim = rover(dir.path(), &address);
    until("the connection", || carrier(&ground) == "up");
    until("the rover's word", || state(&ground, &first) == "aborted");
    let why = get(&ground, &format!("commands/{first}"))["why"].to_string();
    assert!(why.contains("process ended"), "{why}");
    until("an idle rover", || get(&ground, "rover")["latest"]["frame"]["mode"] == "idle");
    let second = send(&ground, 1.0).unwrap();
    until("the next motion", || state(&ground, &second) == "done");

    // The server dies; the rover ends the motion alone.
    let third = send(&ground, 4.0).unwrap();
    until("the motion", || state(&ground, &third) == "executing");
    let port = ground.kill().rsplit_once(':').unwrap().1.to_owned();
    ground = server(dir.path(), &sim.address, &port);
    // Restored as unknown; the rover's own word makes it known. Nobody sends it again.
    until("the truth", || state(&ground, &third) == "done");
    assert_eq!(state(&ground, &first), "aborted");
    let journal = std::fs::read_to_string(dir.path().join("rover/rover.journal")).unwrap();
    let begun =
        |id: &str| journal.lines().filter(|l| l.contains("\"begin\"") && l.contains(id)).count();
    assert_eq!((begun(&second), begun(&third)), (1, 1));

    // An E-stop stays in force over the end of either.
    assert_eq!(post(&ground, "estop", &json!({})).0, 200);
    until("the rover's word", || get(&ground, "link")["estop"] == "confirmed");
    let port = ground.kill().rsplit_once(':').unwrap().1.to_owned();
    let address = sim.kill();
    ground = server(dir.path(), &address, &port);
    assert_ne!(get(&ground, "link")["estop"], "clear", "from the log, without any rover");
    sim = rover(dir.path(), &address);
    until("the rover's word", || get(&ground, "link")["estop"] == "confirmed");
    assert_eq!(get(&ground, "rover")["latest"]["frame"]["mode"], "stopped");
    let token = post(&ground, "estop/release", &json!({})).1["token"].clone();
    assert_eq!(post(&ground, "estop/release", &json!({ "token": token })).0, 200);
    until("the release", || get(&ground, "link")["estop"] == "clear");
    let last = send(&ground, 0.5).unwrap();
    until("a motion after it", || state(&ground, &last) == "done");

    // Run-time management, from this machine alone.
    let report = get(&ground, "admin");
    assert_eq!(report["adapter"]["kind"], "remote");
    assert_eq!(report["adapter"]["carrier"]["state"], "up");
    assert!(report["queues"].as_array().unwrap().len() >= 8, "{report}");
    let forwarded = "X-Forwarded-For: 10.1.2.3\r\n";
    for (method, path, body) in [
        ("GET", "admin", Value::Null),
        ("PUT", "admin/log-level", json!({ "filter": "info" })),
        ("POST", "admin/reconnect", json!({})),
    ] {
        let (status, answer) = ask(&ground, method, &format!("/api/v1/{path}"), &body, forwarded);
        assert_eq!((status, &answer["error"]["code"]), (403, &json!("admin_refused")), "{path}");
    }
    let level = |filter: &str| {
        let filter = json!({ "filter": filter });
        ask(&ground, "PUT", "/api/v1/admin/log-level", &filter, "")
    };
    let (status, set) = level("warn,bridge=debug");
    assert_eq!((status, set["filter"].as_str().unwrap().contains("bridge=debug")), (200, true));
    assert_eq!(get(&ground, "admin")["log_filter"], set["filter"]);
    for bad in ["", "bridge=loud", &"a,".repeat(300)] {
        let (status, answer) = level(bad);
        assert_eq!((status, &answer["error"]["code"]), (422, &json!("out_of_range")), "{bad}");
    }
    let connections =
        |ground: &Process| get(ground, "link")["carrier"]["counters"]["connections"].as_u64();
    let before = connections(&ground);
    assert_eq!(post(&ground, "admin/reconnect", &json!({})).0, 200);
    until("another connection", || connections(&ground) > before && carrier(&ground) == "up");
    // A ground map alone cannot be exchanged under a rover that stands elsewhere.
    let import = json!({ "recipe": { "name": "smooth_mare" }, "seed": 1 });
    let (status, refused) = post(&ground, "terrain/imports", &import);
    assert_eq!((status, &refused["error"]["code"]), (409, &json!("rover_remote")));
    drop(sim);
}

#[test]
fn what_cannot_be_started_is_refused_in_one_sentence() {
    for address in [
        "127.0.0.1:7400",
        "http://127.0.0.1:1",
        "tcp://",
        "tcp://host",
        "tcp://h:0",
        "tcp://h:99999",
    ] {
        let run = footfall(&["serve", "--rover", address, "--port", "0"], "");
        assert_eq!((run.status, run.errors.lines().count()), (2, 1), "{}", run.errors);
        assert!(run.errors.contains("tcp://host:port"), "{}", run.errors);
    }
    let run = footfall(&["rover-sim", "--listen", "0.0.0.0:0"], "");
    assert_eq!((run.status, run.errors.lines().count()), (2, 1), "{}", run.errors);
    assert!(run.errors.contains("loopback"), "{}", run.errors);
}
