//! A session that is asked to end: its log is sealed and lacks nothing (R2).

use std::collections::BTreeSet;
use std::process::Command;
use std::time::Duration;

use bridge::reader::{Limits, read_file};
use tokio::time::Instant;

use crate::command_line::footfall;
use crate::rover_process::{Process, get};
use crate::support::TempDir;

#[test]
fn a_server_that_is_asked_to_end_seals_its_log_and_loses_nothing() {
    for signal in ["TERM", "INT"] {
        let dir = TempDir::new();
        let logs = dir.path().join("logs");
        let logs = logs.to_str().unwrap();
        let server = Process::start(&["serve", "--demo", "--port", "0", "--logs", logs]);
        let begun = Instant::now();
        let latest = || get(&server, "rover")["latest"]["sequence"].as_u64().unwrap_or(0);
        while latest() < 8 {
            assert!(begun.elapsed() < Duration::from_secs(60), "no telemetry");
            std::thread::sleep(Duration::from_millis(100));
        }
        let heard = latest();
        let pid = server.pid().to_string();
        assert!(Command::new("kill").args(["-s", signal, &pid]).status().unwrap().success());
        assert_eq!(server.ended(), Some(0), "SIG{signal}");

        let verified = footfall(&["log", "verify", logs], "");
        assert_eq!(verified.status, 0, "SIG{signal}: {} {}", verified.output, verified.errors);
        let mut frames = BTreeSet::new();
        for log in bridge::catalog::list_logs(dir.path().join("logs").as_path(), None).unwrap() {
            for file in bridge::catalog::log_files(&dir.path().join("logs"), &log.id).unwrap() {
                assert!(!file.to_str().unwrap().contains(".open."), "{file:?} is not sealed");
                let content = read_file(&file, Limits::default()).unwrap();
                assert_eq!(content.damage, []);
                for message in content.messages {
                    assert_ne!(&*message.channel, "log/gap");
                    if &*message.channel == "rover/state" {
                        frames.insert(u64::from(message.sequence));
                    }
                }
            }
        }
        let last = frames.last().copied().unwrap_or(0);
        assert!(last >= heard, "SIG{signal}: {last} of what was heard, {heard}");
        let first = frames.first().copied().unwrap_or(0);
        assert_eq!(frames.len() as u64, last - first + 1, "SIG{signal}: no hole");
        assert!(first <= 1, "SIG{signal}: from the first frame, not {first}");
    }
}
