//! What the tests share: folders, a disk with faults, a scripted rover.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use bridge::adapter::RoverAdapter;
use bridge::commands::StageCommand;
use bridge::recorder::Record;
use wire::live::{
    AckStage, CommandBody, Downlink, Executing, JointKnot, PlanCommandRef, RoverMode,
    RoverTelemetry, Uplink,
};
use wire::scene::{Pose, RoverState};
use wire::time::Timestamp;

/// 2001-09-09T01:46:40Z.
pub const START: Timestamp = Timestamp(1_000_000_000_000_000_000);

pub fn after(seconds: f64) -> Timestamp {
    START.plus_seconds(seconds)
}

/// How many cases of a property to look at: all with `FOOTFALL_FULL=1`, else a tenth of them.
pub fn cases(full: u64) -> u64 {
    if std::env::var_os("FOOTFALL_FULL").is_some() { full } else { full / 10 }
}

/// A folder of its own, gone when the test ends.
pub struct TempDir(PathBuf);

impl TempDir {
    pub fn new(name: &str) -> TempDir {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let unique = format!("bridge-{}-{number}-{name}", std::process::id());
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(unique);
        std::fs::create_dir_all(&path).unwrap();
        TempDir(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for TempDir {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

pub fn record(channel: &str, sequence: u64, at: Timestamp, json: String) -> Record {
    Record {
        channel: channel.into(),
        sequence,
        log_time: at,
        publish_time: at.plus_seconds(-1.3),
        data: json.into(),
    }
}

/// Files in memory, with the faults that a test asks for.
pub type FaultyDisk = crate::sim_fs::SimFs;

pub fn frame(mode: RoverMode, executing: Option<Executing>) -> RoverTelemetry {
    let base = Pose { position_m: [0.0, 0.0, 1.968], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] };
    let joints_rad = BTreeMap::from([("leg1".into(), vec![0.0, 0.5, 0.5, 0.0, 0.6, 0.0])]);
    RoverTelemetry {
        state: RoverState { base, joints_rad, wheels_rad: BTreeMap::new() },
        contacts: BTreeMap::from([("leg1".into(), true)]),
        contact_points_m: BTreeMap::new(),
        wheel_forces_n: BTreeMap::new(),
        joint_torques_nm: BTreeMap::new(),
        mode,
        executing,
        fault: None,
        operation: None,
    }
}

/// A command to move leg 1 for `duration_s`.
pub fn motion(id: &str, duration_s: f64, plan: Option<(&str, usize)>) -> StageCommand {
    let knot = |time_s| JointKnot { joints_rad: vec![0.0; 6], time_s };
    StageCommand {
        id: Some(id.into()),
        operator: "ada".into(),
        title: "Lift leg 1".into(),
        body: CommandBody::JointPath {
            leg: "leg1".into(),
            knots: vec![knot(0.0), knot(duration_s)],
        },
        plan: plan.map(|(id, index)| PlanCommandRef { plan_id: id.into(), index, retreat: false }),
        after: plan.map_or(0, |(_, index)| index),
        duration_s,
        basis_joints_rad: BTreeMap::from([("leg1".into(), vec![0.0; 6])]),
        basis_tolerance_rad: 0.02,
        model_hash: None,
        two_persons: false,
        preconditions: Vec::new(),
    }
}

/// The part of a plan's way back that undoes its command `undoes`, of `n`.
pub fn back(id: &str, plan_id: &str, undoes: usize, n: usize) -> StageCommand {
    let (plan_id, index) = (plan_id.into(), n - 1 - undoes);
    let plan = Some(PlanCommandRef { plan_id, index, retreat: true });
    StageCommand { plan, after: undoes + 1, ..motion(id, 1.0, None) }
}

/// The UUID with the given number.
pub fn uuid(number: u64) -> String {
    format!("01890a5d-ac96-774b-bcce-{number:012x}")
}

/// What a scripted rover got, and when.
pub type Received = Arc<Mutex<Vec<(Timestamp, Uplink)>>>;

/// A rover that does what it is told: acknowledges, moves for as long as the last knot says, sends
/// telemetry at 10 Hz.
pub struct FakeRover {
    now: Timestamp,
    next_frame: Timestamp,
    stopped: bool,
    /// Command, begin and end of its motion.
    motion: Option<(String, Timestamp, Timestamp)>,
    said: VecDeque<(Timestamp, Downlink)>,
    received: Received,
    /// Says nothing of commands, only telemetry.
    mute: bool,
}

impl FakeRover {
    pub fn new() -> (FakeRover, Received) {
        let received = Received::default();
        let rover = FakeRover {
            now: START,
            next_frame: START,
            stopped: false,
            motion: None,
            said: VecDeque::new(),
            received: received.clone(),
            mute: false,
        };
        (rover, received)
    }

    pub fn mute() -> (FakeRover, Received) {
        let (rover, received) = FakeRover::new();
        (FakeRover { mute: true, ..rover }, received)
    }

    fn say(&mut self, at: Timestamp, id: &str, stage: AckStage) {
        if !self.mute {
            self.said.push_back((at, Downlink::Ack { id: id.into(), stage, detail: None }));
        }
    }

    fn frame(&self, at: Timestamp) -> RoverTelemetry {
        let moving = self.motion.as_ref().filter(|_| !self.mute);
        let executing = moving.map(|(id, begin, end)| Executing {
            command_id: id.clone(),
            progress: at.seconds_since(*begin) / end.seconds_since(*begin).max(1e-9),
            step: None,
        });
        let mode = match (&executing, self.stopped) {
            (_, true) => RoverMode::Stopped,
            (Some(_), _) => RoverMode::Executing,
            _ => RoverMode::Idle,
        };
        frame(mode, executing)
    }
}

impl RoverAdapter for FakeRover {
    fn uplink(&mut self, now: Timestamp, message: Uplink) {
        assert!(now >= self.now, "calls come in order of time");
        self.received.lock().unwrap().push((now, message.clone()));
        match message {
            Uplink::Command { id, .. } if self.stopped => self.say(now, &id, AckStage::Rejected),
            Uplink::Command { id, body, .. } => {
                let CommandBody::JointPath { knots, .. } = body else { panic!("not scripted") };
                self.say(now, &id, AckStage::Received);
                self.say(now, &id, AckStage::Started);
                let end = now.plus_seconds(knots.last().unwrap().time_s);
                self.motion = Some((id, now, end));
            }
            Uplink::Estop { id } => {
                self.stopped = true;
                if let Some((moving, ..)) = self.motion.take() {
                    self.say(now, &moving, AckStage::Aborted);
                }
                self.say(now, &id, AckStage::Received);
            }
            Uplink::Heartbeat {} | Uplink::Image(_) => {}
            Uplink::EstopRelease { id } => {
                self.stopped = false;
                self.say(now, &id, AckStage::Completed);
            }
        }
    }

    fn advance(&mut self, now: Timestamp) -> Vec<(Timestamp, Downlink)> {
        while self.next_frame <= now {
            if let Some((id, _, end)) = self.motion.clone().filter(|m| m.2 <= self.next_frame) {
                self.motion = None;
                self.say(end, &id, AckStage::Completed);
            }
            let frame = self.frame(self.next_frame);
            self.said.push_back((self.next_frame, Downlink::Telemetry(frame)));
            self.next_frame = self.next_frame.plus_seconds(0.1);
        }
        self.now = now;
        self.said.drain(..).collect()
    }
}
